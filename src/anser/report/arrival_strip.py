"""Who arrived when, beside one another: a dot for each aircraft, in SVG."""

import html
from collections.abc import Mapping
from typing import Any

import numpy as np

from anser.report.style import page_color_of

_WIDTH, _NAMES, _RIGHT, _FOOT = 560, 128, 16, 34
_INK, _GRID = "var(--quiet)", "var(--grid)"
_TALL, _ROW_MAX, _ROW_MIN, _ROW_NAMED = 260.0, 24.0, 4.0, 11.0


def arrival_strip(summary: Mapping[str, Any]) -> str:
    """Draw the arrivals of a `summary.json` against the planned ones: early to the left, late to the right.

    Empty where fewer than two aircraft have both times.
    """
    rows = [
        (k, str(row["name"]), float(row["arrival_s"]) - float(row["planned_arrival_s"]))
        for k, row in enumerate(summary["aircraft"])
        if row["arrival_s"] is not None and row["planned_arrival_s"] is not None
    ]
    if len(rows) < 2:
        return ""
    offsets = np.array([offset for *_, offset in rows])
    factor, unit = (1000.0, "ms") if np.abs(offsets).max() < 0.0995 else (1.0, "s")
    ticks = _ticks(float(min(offsets.min(), 0.0)) * factor, float(max(offsets.max(), 0.0)) * factor)
    row_tall = float(np.clip(_TALL / len(rows), _ROW_MIN, _ROW_MAX))
    bottom = row_tall * len(rows) + 4

    def x(value: float) -> float:
        return _NAMES + (value - ticks[0]) / (ticks[-1] - ticks[0]) * (_WIDTH - _NAMES - _RIGHT)

    parts = [
        f'<line x1="{x(t):.1f}" x2="{x(t):.1f}" y1="0" y2="{bottom:.1f}" stroke="{_INK if t == 0 else _GRID}"/>'
        f'<text x="{x(t):.1f}" y="{bottom + 14:.1f}" text-anchor="middle">{f"{t:.6g}".replace("-", "−")}</text>'
        for t in ticks
    ]
    for place, (k, name, offset) in enumerate(rows):
        y = row_tall * (place + 0.5) + 2
        if row_tall >= _ROW_NAMED:
            shown = name if len(name) <= 18 else name[:17] + "…"
            parts.append(f'<text x="0" y="{y + 4:.1f}" class="who-name">{html.escape(shown)}</text>')
        radius = min(5.0, 0.42 * row_tall)
        parts.append(
            f'<line x1="{x(0.0):.1f}" x2="{x(offset * factor):.1f}" y1="{y:.1f}" y2="{y:.1f}" '
            f'stroke="{page_color_of(k)}" stroke-width="1.5"/>'
            f'<circle cx="{x(offset * factor):.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="{page_color_of(k)}"/>'
        )
    parts.append(
        f'<text x="{(_NAMES + _WIDTH - _RIGHT) / 2:.0f}" y="{bottom + 30:.1f}" text-anchor="middle">'
        f"arrival less planned arrival ({unit})</text>"
    )
    return (
        f'<svg class="strip" viewBox="0 0 {_WIDTH} {bottom + _FOOT:.0f}" role="img" '
        f'aria-label="Arrival less planned arrival of each aircraft">{"".join(parts)}</svg>'
    )


def _ticks(low: float, high: float) -> list[float]:
    """Three to eight round numbers from below `low` to above `high`, 0 among them."""
    reach = max(high - low, 1e-9)
    size = 10.0 ** np.floor(np.log10(reach))
    step = next(size * m for m in (0.2, 0.25, 0.5, 1.0, 2.0, 5.0) if reach / (size * m) <= 5.5)
    first, last = int(np.floor(low / step + 1e-9)), int(np.ceil(high / step - 1e-9))
    return [float(k * step) for k in range(first, last + 1)]
