"""Report page of a flight, or of two flights side by side: one self-contained HTML file."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import xarray as xr

from anser.report.comparison import difference_table
from anser.report.derived_variables import add_derived_variables, recorded_scenario
from anser.report.flight_data import SECTIONS, check_flight, flight_data, goal_form_legend
from anser.report.flight_margins import find_flight_margins
from anser.report.flight_overview import aircraft_table, margins_list, summary_cards, verdict_html
from anser.report.page_frame import render_page, write_page
from anser.report.style import COLORS
from anser.report.svg_charts import arrival_strip, links_strip
from anser.results.separation import proximity_warning

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

    Parameters
    ----------
    dataset, summary
        The flight: contents of `flight.nc` and `summary.json`.
    path
        File to write.
    overwrite
        Whether an existing file may be replaced.

    Raises
    ------
    FileExistsError
        If `path` exists and `overwrite` is false.
    ValueError
        If the dataset lacks a variable, or if dataset and summary belong to different flights.
    """
    check_flight(dataset, summary)
    _write([(str(summary["scenario"]["name"]), dataset, summary)], path, overwrite)


def write_comparison(runs: Sequence[_Run], path: Path, *, overwrite: bool = False) -> None:
    """Write the report of two flights side by side, over a common time, with equal axes, as one HTML page.

    Parameters
    ----------
    runs
        Two runs: name on the page, dataset, summary.
    path
        File to write.
    overwrite
        Whether an existing file may be replaced.

    Raises
    ------
    FileExistsError
        If `path` exists and `overwrite` is false.
    ValueError
        If `runs` does not have two entries, a dataset lacks a variable, or a dataset and its summary belong to
        different flights.
    """
    if len(runs) != 2:
        raise ValueError(f"two runs stand side by side, not {len(runs)}")
    for _, dataset, summary in runs:
        check_flight(dataset, summary)
    _write(list(runs), path, overwrite)


def _write(runs: list[_Run], path: Path, overwrite: bool) -> None:
    if path.exists() and not overwrite:  # fail early
        raise FileExistsError(f"{path} exists and is not overwritten")
    write_page(_page(runs), path, overwrite=overwrite)


def _page(runs: list[_Run]) -> str:
    scenarios = [recorded_scenario(dataset) for _, dataset, _ in runs]
    datasets = [add_derived_variables(run[1], scenario) for run, scenario in zip(runs, scenarios, strict=True)]
    data = [
        flight_data(dataset, summary, scenario, label)
        for dataset, (label, _, summary), scenario in zip(datasets, runs, scenarios, strict=True)
    ]
    labels = [label for label, *_ in runs]
    single = len(runs) == 1
    description = runs[0][1].attrs.get("description", "")
    links_charts = [links_strip(dataset) for dataset in datasets]
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
            for (label, _, summary), dataset, scenario, flight, chart in zip(
                runs, datasets, scenarios, data, links_charts, strict=True
            )
        ],
        differences="" if single else difference_table([(label, summary) for label, _, summary in runs], scenarios),
        has_few_aircraft=all(len(flight["aircraft"]) <= _LIST_BELOW_MAX for flight in data),
        goal_forms=goal_form_legend({entry["form"] for flight in data for entry in flight["aircraft"]}),
        has_keep_outs=any(scenario.get("keep_out") for scenario in scenarios),
        has_network=any(links_charts),
        sections=[
            section
            for section in SECTIONS
            if any(section.key == entry["key"] for flight in data for entry in flight["sections"])
        ],
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
