"""Differences between two runs as an HTML section: results of the flights, and values in the scenarios."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from anser.report.page_templates import MISSING, render
from anser.results.arrival import arrival_accuracy

if TYPE_CHECKING:
    from markupsafe import Markup

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
_DIFFERENCES_MAX, _VALUE_LENGTH_MAX = 200, 160


def difference_table(runs: Sequence[tuple[str, Mapping[str, Any]]], scenarios: Sequence[Mapping[str, Any]]) -> "Markup":
    """Return a table of the results of two runs and their differences, and of the scenario keys that differ, as HTML.

    Parameters
    ----------
    runs
        Label and summary of the two runs.
    scenarios
        Scenarios of the two runs.
    """
    summaries = [summary for _, summary in runs]
    accuracies = [arrival_accuracy(summary) for summary in summaries]
    figures = [
        _figure_row(
            figure_name, "s", 4, [accuracy.value_s if accuracy.kind == kind else None for accuracy in accuracies]
        )
        for kind, figure_name in _ARRIVALS.items()
        if any(accuracy.kind == kind for accuracy in accuracies)
    ]
    figures += [
        _figure_row(figure_name, unit, digits, [summary["fleet"].get(key) for summary in summaries])
        for key, figure_name, unit, digits in _FIGURES
        if any(summary["fleet"].get(key) is not None for summary in summaries)
    ]
    figures += [
        _figure_row(figure_name, unit, digits, [_worst_value(summary, key, worst) for summary in summaries])
        for key, figure_name, unit, digits, worst in _WORST
    ]
    differences = scenario_differences(scenarios[0], scenarios[1])
    return render(
        "differences.html",
        labels=[label for label, _ in runs],
        figures=figures,
        differences=[(path, list(map(_value_text, values))) for path, *values in differences[:_DIFFERENCES_MAX]],
        hidden_count=max(0, len(differences) - _DIFFERENCES_MAX),
    )


def _worst_value(summary: Mapping[str, Any], key: str, worst: Callable[[list[float]], float]) -> float | None:
    """Return the worst value of a summary entry over the aircraft still in the fleet; None if a value is missing."""
    values = [aircraft[key] for aircraft in summary["aircraft"] if "left_s" not in aircraft]
    return None if not values or None in values else worst(values)


def scenario_differences(first_value: Any, second_value: Any, path: str = "") -> list[tuple[str, Any, Any]]:
    """Return the keys with different values, as (key path, first value, second value).

    Entries of a list of tables are matched by name.

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


def _value_text(value: Any) -> str:
    text = MISSING if value is None else str(value)
    return text if len(text) <= _VALUE_LENGTH_MAX else text[: _VALUE_LENGTH_MAX - 1] + "…"


def _figure_row(name: str, unit: str, digits: int, values: Sequence[float | None]) -> dict[str, Any]:
    first_value, second_value = values
    change = None if first_value is None or second_value is None else second_value - first_value
    return {"name": f"{name} ({unit})" if unit else name, "digits": digits, "numbers": [*values, change]}
