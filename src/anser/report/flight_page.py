"""Report page of a flight, or of two flights side by side, as one self-contained HTML file."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from anser.files import write_file
from anser.report.derived_variables import add_derived_variables, recorded_table
from anser.report.flight_data import SECTIONS, check_flight, flight_data, goal_form_legend, scene_keep_outs
from anser.report.flight_margins import Margin, closest_pair, find_flight_margins
from anser.report.page_templates import MISSING, format_number, render, render_page
from anser.report.style import COLORS
from anser.report.svg_charts import arrival_strip, links_strip
from anser.results.arrival import arrival_accuracy, format_duration
from anser.results.faults import fault_lines
from anser.results.separation import NO_SEPARATION, is_judged_by_separation, proximity_warning

if TYPE_CHECKING:
    from markupsafe import Markup


_CARDS_PER_ROW = 4


def verdict_html(
    summary: Mapping[str, Any], scenario: Mapping[str, Any], margins: Sequence[Margin] = (), warning: str = ""
) -> "Markup":
    """Return the verdict on a flight as HTML: arrivals, accuracy, failed aircraft, unmet requirements and limits.

    `margins` is the result of `find_flight_margins`; `warning` is a text such as the result of `proximity_warning`.
    """
    fleet, spread_s, accuracy = summary["aircraft"], summary["fleet"]["arrival_spread_s"], arrival_accuracy(summary)
    not_arrived = [aircraft for aircraft in fleet if aircraft["status"] != "arrived" and "left_s" not in aircraft]
    unmet = [entry["name"] for entry in summary["requirements"] if not entry["met"]]
    spread_max_s = next((e["limit"] for e in summary["requirements"] if e["name"] == "arrival_spread_max_s"), None)
    is_together = (
        accuracy.kind == "spread"
        and spread_s is not None
        and (spread_max_s is not None or scenario.get("arrival", {}).get("rule") in ("together", "at"))
    )
    exceeded = [margin for margin in margins if margin.kind == "limit" and not margin.is_met]
    verdict = "bad" if not_arrived or unmet else "mixed" if exceeded or warning else "good"
    return render(
        "verdict.html",
        css_class=verdict,
        mark={"bad": "✗", "mixed": "!", "good": "✓"}[verdict],
        fleet_size=len(fleet),
        not_arrived=not_arrived,
        departed=[aircraft for aircraft in fleet if "left_s" in aircraft],
        accuracy=accuracy,
        is_together=is_together,
        spread_s=spread_s,
        spread_max_s=spread_max_s,
        unmet=unmet,
        events=summary.get("events", ()),
        faults=fault_lines(summary),
        network=summary.get("network"),
        is_judged_by_separation=is_judged_by_separation(summary),
        no_separation=NO_SEPARATION.capitalize(),
        warning=warning,
        exceeded=[_margin_row(margin) for margin in exceeded],
    )


def summary_cards(dataset: xr.Dataset, summary: Mapping[str, Any]) -> "Markup":
    """Return the main results of a flight as HTML cards: arrival, accuracy, greatest miss, separation, distance."""
    aircraft_rows, fleet = summary["aircraft"], summary["fleet"]
    is_single = len(aircraft_rows) == 1
    arrivals = [aircraft["arrival_s"] for aircraft in aircraft_rows if aircraft["arrival_s"] is not None]
    cards = []
    if arrivals:
        cards.append(("Arrival", format_number(min(arrivals), 2), "s", "" if is_single else "of the first"))
    accuracy = arrival_accuracy(summary)
    if accuracy.value_s is not None:
        name, note = {
            "spread": ("Arrival spread", "first to last"),
            "spacing": ("Spacing error", f"greatest, of {accuracy.required_spacing_s or 0:g} s required"),
            "error": ("Off the planned time", "" if is_single else "greatest"),
        }[accuracy.kind]
        value, unit = format_duration(accuracy.value_s).split(" ")
        cards.append((name, value, unit, note))
    misses = [(aircraft["miss_m"], aircraft["name"]) for aircraft in aircraft_rows if "left_s" not in aircraft]
    never_arrived = [name for miss_m, name in misses if miss_m is None]
    if never_arrived:
        others_text = f" and {len(never_arrived) - 1} more" if len(never_arrived) > 1 else ""
        cards.append(("Greatest miss", MISSING, "", f"{never_arrived[0]}{others_text} never arrived"))
    elif misses:
        miss_m, name = max(misses)
        cards.append(("Greatest miss", format_number(miss_m, 2), "m", name))
    ratio = fleet.get("separation_ratio_min")
    if ratio is not None:
        cards.append(("Separation kept", format_number(ratio, 2), "×", "of the required, holds included"))
    pair = closest_pair(dataset)
    if pair is not None and fleet["separation_min_m"] is not None:
        pair_arrivals = [aircraft["arrival_s"] for aircraft in aircraft_rows if aircraft["name"] in pair[2:]]
        has_arrived = any(arrival_s is not None and pair[1] > arrival_s for arrival_s in pair_arrivals)
        phase_text = ", after arriving" if has_arrived else ""
        note = f"at {format_number(pair[1], 1)} s{phase_text}: {pair[2]}, {pair[3]}"
        cards.append(("Least distance of two", format_number(fleet["separation_min_m"], 0), "m", note))
    return cards_html(cards)


def cards_html(cards: Sequence[tuple[str, str, str, str]]) -> "Markup":
    """Return cards as HTML, in one or two rows; a card is (heading, value, unit, note)."""
    columns = len(cards) if len(cards) <= _CARDS_PER_ROW else -(-len(cards) // 2)  # two rows of almost equal length
    return render("cards.html", cards=cards, columns=columns)


def margins_list(margins: Sequence[Margin]) -> "Markup":
    """Return the utilization of each requirement and limit as HTML, as bars in the order of `margins`."""
    return render("margins.html", margins=[_margin_row(margin) for margin in margins])


def aircraft_table(fleet: Sequence[Mapping[str, Any]]) -> "Markup":
    """Return the entries `aircraft` of a summary as an HTML table."""
    has_paths = all(aircraft.get("path") is not None for aircraft in fleet)
    return render("aircraft.html", fleet=fleet, columns=_COLUMNS, has_paths=has_paths)


_COLUMNS = [
    dict(zip(("key", "heading", "unit", "digits"), column, strict=True))
    for column in (
        ("planned_arrival_s", "Planned", "s", 2),
        ("arrival_s", "Arrived", "s", 2),
        ("miss_m", "Miss", "m", 2),
        ("speed_min_m_s", "Slowest", "m/s", 1),
        ("speed_mean_m_s", "Mean", "m/s", 1),
        ("speed_max_m_s", "Fastest", "m/s", 1),
        ("clearance_min_m", "Nearest to goal", "m", 1),
        ("position_error_max_m", "Off the plan", "m", 1),
        ("tables_left_s", "Outside tables", "s", 2),
    )
]
"""Columns of numbers in the table of the aircraft: key of an aircraft's entry in a summary, heading, unit, decimals."""


def _margin_row(margin: Margin) -> dict[str, Any]:
    utilization = margin.utilization
    is_near = margin.after_arrival or (margin.is_met and utilization is not None and utilization > 0.9)
    unit = f" {margin.unit}" if margin.unit not in ("", "°") else margin.unit
    limit = f"{'at most' if margin.is_upper else 'at least'} {margin.limit:,g}".replace("-", "−") + unit
    time = "" if margin.time_s is None else f"{format_number(margin.time_s, 1)} s"
    return {
        "description": margin.description,
        "after_arrival": margin.after_arrival,
        "state": "near" if is_near else "kept" if margin.is_met else "over",
        "limit_text": limit if margin.kind == "requirement" else f"limit; {limit}",
        "value_text": MISSING if margin.value is None else f"{_significant(margin.value)}{unit}",
        "utilization_text": _percent(utilization),
        "bar_percent": 0.0 if utilization is None else min(100.0, 100.0 * utilization),
        "remark": "" if margin.is_met else "passed after the arrival" if margin.after_arrival else "not met",
        "context": ", ".join(text for text in (margin.aircraft, time) if text),
    }


def _percent(share: float | None) -> str:
    return MISSING if share is None else ">999 %" if share > 9.99 else f"{100 * share:.0f} %"


def _significant(value: float) -> str:
    """Format a number with three significant digits and at most five decimals; 1000 or more as an integer."""
    if not np.isfinite(value) or abs(value) >= 1000:
        return format_number(value, 0)
    return format_number(value, max(0, min(5, 2 - int(np.floor(np.log10(max(abs(value), 1e-4)))))))


_FIGURES = (
    ("separation_min_m", "Least distance of two aircraft", "m", 1),
    ("separation_ratio_min", "Separation kept over required", "", 3),
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


def difference_table(
    labels: Sequence[str], summaries: Sequence[Mapping[str, Any]], scenarios: Sequence[Mapping[str, Any]]
) -> "Markup":
    """Return two tables as HTML: results of two flights, and the scenario keys in which the flights differ.

    `labels` has the names of the flights.
    """
    accuracies = [arrival_accuracy(summary) for summary in summaries]
    figures = []
    for kind, name in _ARRIVALS.items():
        if any(accuracy.kind == kind for accuracy in accuracies):
            values = [accuracy.value_s if accuracy.kind == kind else None for accuracy in accuracies]
            figures.append(_figure_row(name, "s", 4, values))
    for key, name, unit, digits in _FIGURES:
        values = [summary["fleet"].get(key) for summary in summaries]
        if values != [None, None]:
            figures.append(_figure_row(name, unit, digits, values))
    for key, name, unit, digits, worst in _WORST:
        figures.append(_figure_row(name, unit, digits, [_worst_value(summary, key, worst) for summary in summaries]))
    differences = scenario_differences(scenarios[0], scenarios[1])
    return render(
        "differences.html",
        labels=labels,
        figures=figures,
        differences=[(path, list(map(_value_text, values))) for path, *values in differences[:_DIFFERENCES_MAX]],
        hidden_count=max(0, len(differences) - _DIFFERENCES_MAX),
    )


def _worst_value(summary: Mapping[str, Any], key: str, worst: Callable[[list[float]], float]) -> float | None:
    """Return the `worst` (`max` or `min`) value of a key over the aircraft that stayed in the fleet.

    None if one of these aircraft has no value, or all aircraft have left.
    """
    values = [aircraft[key] for aircraft in summary["aircraft"] if "left_s" not in aircraft]
    return None if not values or None in values else worst(values)


def scenario_differences(first_value: Any, second_value: Any, path: str = "") -> list[tuple[str, Any, Any]]:
    """Return the keys with different values in two scenarios, as (key path, first value, second value).

    A missing value is None. Entries of a list of tables are matched by name. `path` is the prefix of the key paths.
    """
    first_table, second_table = _entries_by_name(first_value), _entries_by_name(second_value)
    if isinstance(first_table, dict) and isinstance(second_table, dict):
        differences = []
        for key in dict.fromkeys([*first_table, *second_table]):
            key_path = f"{path}.{key}" if path else str(key)
            differences += scenario_differences(first_table.get(key), second_table.get(key), key_path)
        return differences
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


_LIST_BELOW_MAX = 6  # a larger fleet is listed beside the scene
_MARGINS_SHOWN = 6  # the remaining margins are folded
_STYLES = ("vendor/uplot.min.css", "page.css")
_SCRIPTS = (
    *("vendor/uplot.min.js", "vendor/three.min.js"),
    *("theme.js", "inflate.js", "store.js", "timeline.js", "plots.js"),
    *("scene_parts.js", "scene_goals.js", "scene_eyes.js", "scene_labels.js", "scene.js", "page.js"),
)

_Run = tuple[str, xr.Dataset, Mapping[str, Any]]


def write_report(dataset: xr.Dataset, summary: Mapping[str, Any], path: Path, *, overwrite: bool = False) -> None:
    """Write the report of a flight as one HTML page: verdict, animated scene, plots, scenario.

    Raises FileExistsError if `path` exists and `overwrite` is False. Raises ValueError if dataset or summary lack data,
    or belong to different flights.
    """
    check_flight(dataset, summary)
    _write([(str(summary["scenario"]["name"]), dataset, summary)], path, overwrite)


def write_comparison(runs: Sequence[_Run], path: Path, *, overwrite: bool = False) -> None:
    """Write the report of two flights side by side as one HTML page, over a common time, with equal axes.

    `runs` must have two entries (name, dataset, summary). Raises FileExistsError if `path` exists and `overwrite` is
    False. Raises ValueError if `runs` does not have two entries, or if a dataset and its summary lack data or differ.
    """
    if len(runs) != 2:
        raise ValueError(f"two runs stand side by side, not {len(runs)}")
    for _, dataset, summary in runs:
        check_flight(dataset, summary)
    _write(list(runs), path, overwrite)


def _write(runs: list[_Run], path: Path, overwrite: bool) -> None:
    if path.exists() and not overwrite:  # fail early
        raise FileExistsError(f"{path} exists and is not overwritten")
    write_file(path, flight_page(runs), overwrite=overwrite)


def flight_page(runs: Sequence[_Run]) -> str:
    """Return the HTML of the report page of one flight, or of two side by side; a run is (name, dataset, summary)."""
    scenarios = [recorded_table(dataset) for _, dataset, _ in runs]
    datasets = [add_derived_variables(run[1], scenario) for run, scenario in zip(runs, scenarios, strict=True)]
    labels, summaries = [run[0] for run in runs], [run[2] for run in runs]
    data = list(map(flight_data, datasets, summaries, scenarios, labels))
    single = len(runs) == 1
    description = runs[0][1].attrs.get("description", "")
    links_charts = [links_strip(dataset) for dataset in datasets]
    section_keys = {section["key"] for flight in data for section in flight["sections"]}
    return render_page(
        "flight.html",
        body_class="single" if single else "pair",
        styles=_STYLES,
        scripts=_SCRIPTS,
        data=("flights", {"colors": len(COLORS), "runs": data}),
        title=" beside ".join(labels),
        lead=description if single else "Two runs over one time, with equal axes.",
        runs=[
            {
                "label": label,
                "summary": summary,
                "links_chart": chart,
                "stride": flight["every"],
                "aircraft_table": aircraft_table(summary["aircraft"]),
                **_opening(dataset, summary, scenario),
                **_provenance(dataset, scenario),
            }
            for label, summary, dataset, scenario, flight, chart in zip(
                labels, summaries, datasets, scenarios, data, links_charts, strict=True
            )
        ],
        differences="" if single else difference_table(labels, summaries, scenarios),
        has_few_aircraft=all(len(flight["aircraft"]) <= _LIST_BELOW_MAX for flight in data),
        goal_forms=goal_form_legend({entry["form"] for flight in data for entry in flight["aircraft"]}),
        has_keep_outs=any(scene_keep_outs(scenario) for scenario in scenarios),
        has_network=any(links_charts),
        sections=[section for section in SECTIONS if section.key in section_keys],
    )


def _opening(dataset: xr.Dataset, summary: Mapping[str, Any], scenario: Mapping[str, Any]) -> dict[str, Any]:
    margins = find_flight_margins(dataset, summary)
    warning = proximity_warning([summary["fleet"].get("separation_min_m")], dataset.attrs)
    return {
        "verdict": verdict_html(summary, scenario, margins, warning),
        "cards": summary_cards(dataset, summary),
        "arrival_chart": arrival_strip(summary),
        "tightest_margins": margins_list(margins[:_MARGINS_SHOWN]),
        "hidden_margins": margins_list(margins[_MARGINS_SHOWN:]),
        "hidden_margin_count": len(margins[_MARGINS_SHOWN:]),
    }


def _provenance(dataset: xr.Dataset, scenario: Mapping[str, Any]) -> dict[str, str]:
    time = dataset["time"].values
    return {
        "record_period": f"{float(time[1] - time[0]):g} s" if time.size > 1 else "once",
        "scenario_json": json.dumps(scenario, indent=2, ensure_ascii=False) if scenario else "",
    }
