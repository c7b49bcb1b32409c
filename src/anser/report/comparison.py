"""Differences between two runs as an HTML section: figures of the flights, and values in the scenarios."""

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
_MISSING = "–"
_DIFFERENCES_MAX = 200


def difference_table(runs: Sequence[tuple[str, Mapping[str, Any]]], scenarios: Sequence[Mapping[str, Any]]) -> str:
    """Tabulate the figures of two runs (label, summary) with their difference, and the differing scenario keys."""
    first_summary, second_summary = (summary for _, summary in runs)
    accuracies = [arrival_accuracy(summary) for summary in (first_summary, second_summary)]
    table_rows = [
        _figure_row(
            figure_name, "s", 4, *(accuracy.value_s if accuracy.kind == kind else None for accuracy in accuracies)
        )
        for kind, figure_name in _ARRIVALS.items()
        if any(accuracy.kind == kind for accuracy in accuracies)
    ]
    table_rows += [
        _figure_row(figure_name, unit, digits, first_summary["fleet"].get(key), second_summary["fleet"].get(key))
        for key, figure_name, unit, digits in _FIGURES
        if any(summary["fleet"].get(key) is not None for summary in (first_summary, second_summary))
    ]
    for key, figure_name, unit, digits, worst in _WORST:
        table_rows.append(
            _figure_row(
                figure_name,
                unit,
                digits,
                *(_worst_value(summary, key, worst) for summary in (first_summary, second_summary)),
            )
        )
    headings = "".join(f"<th>{escape_html(label)}</th>" for label, _ in runs)
    table = scroll_table(f'<th class="text">Figure</th>{headings}<th>second less first</th>', "".join(table_rows))
    return (
        f'<section id="differences"><h2>What differs</h2>{table}{_scenario_difference_table(runs, scenarios)}</section>'
    )


def _worst_value(summary: Mapping[str, Any], key: str, worst: Callable[[list[float]], float]) -> float | None:
    """Worst value among the aircraft still in the fleet; None if one of the values is missing."""
    values = [aircraft[key] for aircraft in summary["aircraft"] if "left_s" not in aircraft]
    return None if not values or None in values else worst(values)


def scenario_differences(first_value: Any, second_value: Any, path: str = "") -> list[tuple[str, Any, Any]]:
    """Find the keys with different values: key path, first value, second value.

    Entries of a list of tables are compared by name.

    Parameters
    ----------
    first_value, second_value
        Scenarios, or parts of scenarios; None stands for a missing value.
    path
        Key path of the two values.
    """
    first_table, second_table = _entries_by_name(first_value), _entries_by_name(second_value)
    if isinstance(first_table, dict) and isinstance(second_table, dict):
        keys = list(dict.fromkeys([*first_table, *second_table]))
        return [
            difference
            for key in keys
            for difference in scenario_differences(
                first_table.get(key), second_table.get(key), f"{path}.{key}" if path else str(key)
            )
        ]
    return [] if first_value == second_value else [(path, first_value, second_value)]


def _entries_by_name(value: Any) -> Any:
    if isinstance(value, list) and value and all(isinstance(entry, dict) and "name" in entry for entry in value):
        return {str(entry["name"]): {k: v for k, v in entry.items() if k != "name"} for entry in value}
    return value


def _scenario_difference_table(
    runs: Sequence[tuple[str, Mapping[str, Any]]], scenarios: Sequence[Mapping[str, Any]]
) -> str:
    differences = scenario_differences(scenarios[0], scenarios[1])
    if not differences:
        return '<p class="caption">The scenarios are the same.</p>'
    headings = "".join(f'<th class="text">{escape_html(label)}</th>' for label, _ in runs)
    body = "".join(
        f'<tr><td class="text"><code>{escape_html(path)}</code></td>{_value(first_value)}{_value(second_value)}</tr>'
        for path, first_value, second_value in differences[:_DIFFERENCES_MAX]
    )
    hidden_note = (
        f'<p class="caption">and {len(differences) - _DIFFERENCES_MAX} more</p>'
        if len(differences) > _DIFFERENCES_MAX
        else ""
    )
    return scroll_table(f'<th class="text">Key of the scenario</th>{headings}', body) + hidden_note


def _value(value: Any) -> str:
    text = _MISSING if value is None else str(value)
    return f'<td class="text free">{escape_html(text if len(text) <= 160 else text[:159] + "…")}</td>'


def _figure_row(name: str, unit: str, digits: int, first_value: float | None, second_value: float | None) -> str:
    change = (
        _MISSING if first_value is None or second_value is None else format_number(second_value - first_value, digits)
    )
    label = f"{name} ({unit})" if unit else name
    cells = "".join(
        f"<td>{cell}</td>" for cell in (format_number(first_value, digits), format_number(second_value, digits), change)
    )
    return f'<tr><td class="text">{label}</td>{cells}</tr>'
