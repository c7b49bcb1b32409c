"""The tables of a report, as HTML, from a summary."""

import html
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from anser.report.style import color_of

__all__ = ["about", "aircraft_table", "requirements_table", "verdict"]

_NOTHING = "–"


def _digits(count: int) -> Callable[[Any], str]:
    return lambda value: _NOTHING if value is None else f"{value:,.{count}f}"


# Key of the summary's row of an aircraft: heading, unit, how it is printed.
_COLUMNS: tuple[tuple[str, str, str, Callable[[Any], str]], ...] = (
    ("planned_arrival_s", "Planned arrival", "s", _digits(2)),
    ("arrival_s", "Arrival", "s", _digits(2)),
    ("miss_m", "Miss", "m", _digits(2)),
    ("speed_mean_m_s", "Mean speed", "m/s", _digits(1)),
    ("speed_min_m_s", "Least speed", "m/s", _digits(1)),
    ("speed_max_m_s", "Greatest speed", "m/s", _digits(1)),
    ("clearance_min_m", "Least clearance", "m", _digits(1)),
    ("position_error_max_m", "Greatest position error", "m", _digits(1)),
    ("tables_left_s", "Outside tables", "s", _digits(2)),
    ("lateral_bend_m", "Lateral bend", "m", _digits(0)),
)
_FLEET: tuple[tuple[str, str, str, Callable[[Any], str]], ...] = (
    ("arrival_spread_s", "Arrival spread", "s", _digits(3)),
    ("separation_min_m", "Least separation", "m", _digits(0)),
    ("simulated_s", "Simulated", "s", _digits(1)),
    ("wall_s", "Computed in", "s", _digits(1)),
)


def about(summary: Mapping[str, Any]) -> str:
    """Print what was flown, by which software, and the numbers of the fleet."""
    software = " ".join(f"<span>{_text(name)} {_text(number)}</span>" for name, number in summary["versions"].items())
    seed = _NOTHING if summary["seed"] is None else _text(summary["seed"])
    fleet = " ".join(
        f"<span>{heading} <b>{show(summary['fleet'][key])}</b> {unit}</span>" for key, heading, unit, show in _FLEET
    )
    return (
        f'<p class="about"><span>Scenario hash <code>{_text(summary["scenario"]["hash"])}</code></span> '
        f"<span>Seed {seed}</span> {software}</p>\n"
        f'<p class="about">{fleet}</p>'
    )


def verdict(summary: Mapping[str, Any]) -> str:
    """Print in one line whether all aircraft arrived and all requirements were met."""
    stray = [row["name"] for row in summary["aircraft"] if row["status"] != "arrived"]
    unmet = [entry["name"] for entry in summary["requirements"] if not entry["met"]]
    if not stray and not unmet:
        return '<p class="verdict good">✓ All aircraft arrived, all requirements met</p>'
    parts = []
    if stray:
        parts.append(f"Not arrived as planned: {', '.join(map(_text, stray))}")
    if unmet:
        parts.append(f"Requirements not met: {', '.join(map(_text, unmet))}")
    return f'<p class="verdict bad">✗ {". ".join(parts)}</p>'


def aircraft_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """One row for each aircraft of the summary."""
    heads = "".join(f"<th>{heading}<small>{unit}</small></th>" for _, heading, unit, _ in _COLUMNS)
    body = "".join(_aircraft_row(index, row) for index, row in enumerate(rows))
    return (
        '<div class="scroll"><table><thead><tr><th class="text">Aircraft</th><th class="text">Goal</th>'
        f'{heads}<th class="text">Path</th><th class="text">Status</th></tr></thead><tbody>{body}</tbody></table></div>'
    )


def requirements_table(requirements: Sequence[Mapping[str, Any]]) -> str:
    """One row for each requirement of the summary; nothing where there is none."""
    if not requirements:
        return ""
    body = "".join(
        f'<tr><td class="text"><code>{_text(entry["name"])}</code></td><td>{_number(entry["limit"])}</td>'
        f"<td>{_number(entry['value'])}</td>"
        + (
            '<td class="text good-text">✓ met</td></tr>'
            if entry["met"]
            else '<td class="text bad-text">✗ not met</td></tr>'
        )
        for entry in requirements
    )
    return (
        '<div class="scroll narrow"><table><thead><tr><th class="text">Requirement</th><th>Limit</th><th>Value</th>'
        f'<th class="text">Verdict</th></tr></thead><tbody>{body}</tbody></table></div>'
    )


def _aircraft_row(index: int, row: Mapping[str, Any]) -> str:
    numbers = "".join(f"<td>{show(row[key])}</td>" for key, _, _, show in _COLUMNS)
    path = "nominal" if row["nominal"] else "detour"
    fine = "good-text" if row["status"] == "arrived" else "bad-text"
    return (
        f'<tr><td class="text name"><span class="swatch" style="background:{color_of(index)}"></span>'
        f'{_text(row["name"])}</td><td class="text">{_text(row["goal"])}</td>{numbers}'
        f'<td class="text">{path}</td><td class="text {fine}">{_text(row["status"])}</td></tr>'
    )


def _number(value: float | None) -> str:
    return _NOTHING if value is None else f"{value:,.5g}"


def _text(value: object) -> str:
    return html.escape(str(value))
