"""What differs between two runs, as an HTML table: their figures and their scenarios."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from anser.report.flight_overview import escape_html, format_number, scroll_table
from anser.results.arrival import arrival_accuracy

_FIGURES = (
    ("separation_min_m", "Least distance of two aircraft", "m", 1),
    ("separation_ratio_min", "Separation kept over asked for", "", 3),
)
_ARRIVALS = {
    "spread": "Arrival spread",
    "spacing": "Greatest spacing error of the arrivals",
    "error": "Greatest difference of an arrival from its planned time",
}
_WORST = (
    ("miss_m", "Greatest miss", "m", 3, max),
    ("position_error_max_m", "Greatest distance to the planned point", "m", 2, max),
    ("speed_min_m_s", "Lowest airspeed", "m/s", 1, min),
    ("speed_max_m_s", "Highest airspeed", "m/s", 1, max),
    ("clearance_min_m", "Nearest to a goal", "m", 1, min),
)
_NOTHING = "–"
_MOST = 200  # rows of differing keys


def difference_table(runs: Sequence[tuple[str, Mapping[str, Any]]], scenarios: Sequence[Mapping[str, Any]]) -> str:
    """Figures of two runs (label, summary) with their difference, then every key in which the scenarios differ."""
    first, second = (summary for _, summary in runs)
    fits = [arrival_accuracy(summary) for summary in (first, second)]
    rows = [
        _row(words, "s", 4, *(one.value_s if one.kind == kind else None for one in fits))
        for kind, words in _ARRIVALS.items()
        if any(one.kind == kind for one in fits)
    ]
    rows += [
        _row(words, unit, digits, first["fleet"].get(key), second["fleet"].get(key))
        for key, words, unit, digits in _FIGURES
        if any(summary["fleet"].get(key) is not None for summary in (first, second))
    ]
    for key, words, unit, digits, worst in _WORST:
        rows.append(_row(words, unit, digits, *(_worst_value(summary, key, worst) for summary in (first, second))))
    heads = "".join(f"<th>{escape_html(label)}</th>" for label, _ in runs)
    table = scroll_table(f'<th class="text">Figure</th>{heads}<th>second less first</th>', "".join(rows))
    return f'<section id="differences"><h2>What differs</h2>{table}{_keys(runs, scenarios)}</section>'


def _worst_value(summary: Mapping[str, Any], key: str, worst: Callable[[list[float]], float]) -> float | None:
    """Worst value of a flight's aircraft; None if one of them has none, unless it left the fleet."""
    values = [row[key] for row in summary["aircraft"] if "left_s" not in row]
    return None if not values or None in values else worst(values)


def scenario_differences(first: Any, second: Any, path: str = "") -> list[tuple[str, Any, Any]]:
    """Keys whose values differ, with both values; the entries of lists of tables go by their names.

    Parameters
    ----------
    first, second
        Scenarios, or parts of them. What one lacks is None there.
    path
        Where they stand.
    """
    one, other = _named(first), _named(second)
    if isinstance(one, dict) and isinstance(other, dict):
        keys = list(dict.fromkeys([*one, *other]))
        return [
            found
            for key in keys
            for found in scenario_differences(one.get(key), other.get(key), f"{path}.{key}" if path else str(key))
        ]
    return [] if first == second else [(path, first, second)]


def _named(value: Any) -> Any:
    if isinstance(value, list) and value and all(isinstance(entry, dict) and "name" in entry for entry in value):
        return {str(entry["name"]): {k: v for k, v in entry.items() if k != "name"} for entry in value}
    return value


def _keys(runs: Sequence[tuple[str, Mapping[str, Any]]], scenarios: Sequence[Mapping[str, Any]]) -> str:
    found = scenario_differences(scenarios[0], scenarios[1])
    if not found:
        return '<p class="caption">The scenarios are the same.</p>'
    heads = "".join(f'<th class="text">{escape_html(label)}</th>' for label, _ in runs)
    body = "".join(
        f'<tr><td class="text"><code>{escape_html(path)}</code></td>{_value(one)}{_value(other)}</tr>'
        for path, one, other in found[:_MOST]
    )
    rest = f'<p class="caption">and {len(found) - _MOST} more</p>' if len(found) > _MOST else ""
    return scroll_table(f'<th class="text">Key of the scenario</th>{heads}', body) + rest


def _value(value: Any) -> str:
    shown = _NOTHING if value is None else str(value)
    return f'<td class="text free">{escape_html(shown if len(shown) <= 160 else shown[:159] + "…")}</td>'


def _row(words: str, unit: str, digits: int, one: float | None, other: float | None) -> str:
    change = _NOTHING if one is None or other is None else format_number(other - one, digits)
    label = f"{words} ({unit})" if unit else words
    cells = "".join(f"<td>{cell}</td>" for cell in (format_number(one, digits), format_number(other, digits), change))
    return f'<tr><td class="text">{label}</td>{cells}</tr>'
