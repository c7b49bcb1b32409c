"""What an output of a campaign depends on: a bar and an interval for each input, in SVG."""

import html
from collections.abc import Mapping, Sequence
from typing import Any

from anser.report.style import page_color_of

_WIDTH, _NAMES, _RIGHT, _HEAD, _FOOT, _ROW = 560, 200, 14, 4, 34, 24.0
_INK, _GRID = "var(--quiet)", "var(--grid)"
_LONGEST = 30
_SOBOL = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
_RANK = (-1.0, -0.5, 0.0, 0.5, 1.0)
_TITLES = {"first": "part of the variance: first index (narrow), total index (wide)", "rank": "rank correlation"}


def influence_strip(found: Sequence[Mapping[str, Any]], output: str) -> str:
    """Draw the influences on one output, the greatest first; empty where there are none.

    Parameters
    ----------
    found
        As `Influences.as_dict` has them.
    output
        Name of the output.
    """
    rows: dict[str, dict[str, Mapping[str, Any]]] = {}
    for one in found:
        if one["output"] == output:
            rows.setdefault(one["path"], {})[one["measure"]] = one
    if not rows:
        return ""
    ranks = "rank" in next(iter(rows.values()))
    ticks, measure = (_RANK, "rank") if ranks else (_SOBOL, "total")
    ordered = sorted(rows.items(), key=lambda row: -abs(row[1][measure]["value"]))
    bottom = _HEAD + _ROW * len(ordered)

    def x(value: float) -> float:
        within = min(max(value, ticks[0]), ticks[-1])
        return _NAMES + (within - ticks[0]) / (ticks[-1] - ticks[0]) * (_WIDTH - _NAMES - _RIGHT)

    parts = [
        f'<line x1="{x(t):.1f}" x2="{x(t):.1f}" y1="0" y2="{bottom:.1f}" stroke="{_INK if t == 0 else _GRID}"/>'
        f'<text x="{x(t):.1f}" y="{bottom + 14:.1f}" text-anchor="middle">{f"{t:g}".replace("-", "−")}</text>'
        for t in ticks
    ]
    for place, (path, measures) in enumerate(ordered):
        y = _HEAD + _ROW * (place + 0.5)
        shown = path if len(path) <= _LONGEST else "…" + path[1 - _LONGEST :]
        words = "; ".join(
            f"{name} {one['value']:.3f} ({one['low']:.3f} to {one['high']:.3f})" for name, one in measures.items()
        )
        title = f"<title>{html.escape(f'{path}: {words}')}</title>"
        bars = (
            _bar(x, measures["rank"], y, 9.0, page_color_of(0))
            if ranks
            else _bar(x, measures["total"], y, 15.0, page_color_of(5))
            + _bar(x, measures["first"], y, 6.0, page_color_of(0))
        )
        name = f'<text x="0" y="{y + 4:.1f}" class="who-name">{html.escape(shown)}</text>'
        parts.append(f"<g>{title}{name}{bars}</g>")
    words = _TITLES["rank" if ranks else "first"]
    middle = (_NAMES + _WIDTH - _RIGHT) / 2
    parts.append(f'<text x="{middle:.0f}" y="{bottom + 30:.1f}" text-anchor="middle">{words}</text>')
    return (
        f'<svg class="strip" viewBox="0 0 {_WIDTH} {bottom + _FOOT:.0f}" role="img" '
        f'aria-label="{html.escape(output)}: {words}">{"".join(parts)}</svg>'
    )


def _bar(x: Any, one: Mapping[str, Any], y: float, tall: float, color: str) -> str:
    """A bar from 0, and the interval as a line across its end."""
    left, right = sorted((x(0.0), x(one["value"])))
    return (
        f'<rect x="{left:.1f}" y="{y - 0.5 * tall:.1f}" width="{max(right - left, 0.8):.1f}" height="{tall:g}" '
        f'fill="{color}"/><path d="M{x(one["low"]):.1f} {y:.1f}H{x(one["high"]):.1f}" stroke="var(--ink)" '
        f'stroke-width="1.2" fill="none"/>'
    )
