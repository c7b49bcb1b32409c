"""Report page of a flight, or of two flights side by side: one self-contained HTML file."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import xarray as xr

from anser.report.comparison import difference_table
from anser.report.derived_variables import add_derived_variables, recorded_scenario
from anser.report.flight_data import SECTIONS, check_flight, flight_data
from anser.report.flight_margins import find_flight_margins
from anser.report.flight_overview import (
    aircraft_table,
    escape_html,
    format_number,
    margins_list,
    summary_cards,
    verdict_html,
)
from anser.report.page_frame import EVENTS_KEY, TRANSPORT, assemble_page, scene_key, toolbar, write_page
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
    dataset
        The flight: content of `flight.nc`.
    summary
        Content of `summary.json`.
    path
        HTML file to write.
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
    """Write the report of two flights side by side, over a common time, with equal axes.

    Parameters
    ----------
    runs
        Two runs: name on the page, dataset, summary.
    path, overwrite
        As in `write_report`.

    Raises
    ------
    FileExistsError, ValueError
        As in `write_report`; ValueError also if `runs` does not have two entries.
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
    flights = [
        (add_derived_variables(run[1], scenario), run[2], scenario)
        for run, scenario in zip(runs, scenarios, strict=True)
    ]
    data = {
        "colors": len(COLORS),
        "runs": [flight_data(*flight, run[0]) for flight, run in zip(flights, runs, strict=True)],
    }
    forms = {entry["form"] for run in data["runs"] for entry in run["aircraft"]}
    stage = "stage few" if all(len(run["aircraft"]) <= _LIST_BELOW_MAX for run in data["runs"]) else "stage"
    single = len(runs) == 1
    labels = [escape_html(label) for label, _, _ in runs]
    title = labels[0] if single else f"{labels[0]} beside {labels[1]}"
    openings = [_opening(None if single else label, *flight) for label, flight in zip(labels, flights, strict=True)]
    lead = (
        escape_html(runs[0][1].attrs.get("description", "")) if single else "Two runs over one time, with equal axes."
    )
    differences = "" if single else difference_table([(label, summary) for label, _, summary in runs], scenarios)
    tables = [aircraft_table(summary["aircraft"]) for _, _, summary in runs]
    sections = "".join(
        f'<section id="{section.key}"><h2>{section.title}</h2>'
        f'<p class="caption">{section.caption}<span class="who"></span></p>'
        f'<div class="plots" data-section="{section.key}"></div></section>'
        for section in SECTIONS
        if any(section.key == entry["key"] for run in data["runs"] for entry in run["sections"])
    )
    contents = f"""<main>
<header>
<h1>{title}</h1>
<p class="lead">{lead}</p>
<p id="fault" class="fault" hidden></p>
</header>
<div class="runs">{"".join(openings)}</div>
{differences}
<section id="scene">
<h2>The flight</h2>
{toolbar()}
<div class="runs">{_run_boxes(labels, stage, _stage)}</div>
{scene_key(forms, any(s.get("keep_out") for s in scenarios))}
</section>
<section id="aircraft">
<h2>Aircraft</h2>
<div class="runs">{_run_boxes(labels, "", lambda k: tables[k])}</div>
</section>
<section id="events">
<h2>What happened when</h2>
<p class="caption">One lane for each aircraft<span class="of-screen">; move over it for the words, click
to bring the aircraft into focus</span>.</p>
<div class="runs">{_run_boxes(labels, "timeline-place", lambda k: "")}</div>
{EVENTS_KEY}
</section>
{_network(labels, [dataset for dataset, *_ in flights])}
<div class="toolbar"><span class="group">Time axis
<button type="button" data-zoom="all">all</button><button type="button" data-zoom="approach">up to the arrival</button>
<button type="button" data-zoom="last">last 15 s</button></span>
<span class="caption">Drag in a plot to zoom, double-click for all. Dotted line: arrival.</span></div>
{sections}
<section id="provenance">
<h2>Scenario, versions, seed</h2>
<div class="runs">{_run_boxes(labels, "", lambda k: _provenance(runs[k], scenarios[k], data["runs"][k]["every"]))}</div>
</section>
</main>
{TRANSPORT}"""
    return assemble_page(
        f"{title} · anser flight report",
        body_class="single" if single else "pair",
        styles=_STYLES,
        scripts=_SCRIPTS,
        contents=contents,
        data=("flights", data),
    )


def _run_boxes(labels: Sequence[str], kind: str, inner: Any) -> str:
    head = "" if len(labels) == 1 else '<p class="run-name"><b>{}</b></p>'
    return "".join(
        f'<div>{head.format(label) if head else ""}<div class="{kind}" data-run="{k}">{inner(k)}</div></div>'
        for k, label in enumerate(labels)
    )


def _network(labels: Sequence[str], datasets: Sequence[xr.Dataset]) -> str:
    """Section on the communication of a fleet without a centre; otherwise empty."""
    strips = [links_strip(dataset) for dataset in datasets]
    if not any(strips):
        return ""
    return (
        '<section id="links"><h2>Who heard whom</h2><p class="caption">One row for each pair, filled while the two '
        "hear each other; below, the quality of service of the network: 1 where all always hear all, 0 where it falls "
        f'apart.</p><div class="runs">{_run_boxes(labels, "", lambda k: strips[k])}</div></section>'
    )


def _stage(k: int) -> str:
    return f'<div class="scene-place" data-run="{k}"></div><div class="list-place" data-run="{k}"></div>'


def _opening(label: str | None, dataset: xr.Dataset, summary: Mapping[str, Any], scenario: Mapping[str, Any]) -> str:
    name = f'<p class="run-name"><b>{label}</b></p>' if label is not None else ""
    margins = find_flight_margins(dataset, summary)
    warning = proximity_warning([summary["fleet"].get("separation_min_m")], dataset.attrs)
    hidden_margins = margins[_MARGINS_SHOWN:]
    hidden_list = (
        f'<details class="more"><summary>{len(hidden_margins)} more</summary>{margins_list(hidden_margins)}</details>'
        if hidden_margins
        else ""
    )
    return (
        f'<section class="opening"><div>{name}'
        f"{verdict_html(summary, scenario, margins, warning)}{summary_cards(dataset, summary)}"
        f"{arrival_strip(summary)}</div>"
        '<div><h2 class="tight">What was tight</h2><p class="caption">Part of the way to each requirement and limit; '
        f"full at the limit.</p>{margins_list(margins[:_MARGINS_SHOWN])}{hidden_list}</div></section>"
    )


def _provenance(run: _Run, scenario: Mapping[str, Any], stride: int) -> str:
    _, dataset, summary = run
    software = ", ".join(f"{escape_html(name)} {escape_html(version)}" for name, version in summary["versions"].items())
    seed = "none" if summary["seed"] is None else escape_html(summary["seed"])
    period = (
        f"{float(dataset['time'].values[1] - dataset['time'].values[0]):g} s" if dataset.sizes["time"] > 1 else "once"
    )
    thinning = (
        "every record is drawn" if stride == 1 else f"one record in {stride} is drawn; figures are of the whole run"
    )
    whole = (
        f'<pre tabindex="0">{escape_html(json.dumps(scenario, indent=2, ensure_ascii=False))}</pre>' if scenario else ""
    )
    return (
        f'<div class="facts"><div>Scenario <b>{escape_html(summary["scenario"]["name"])}</b></div>'
        f"<div>Hash <code>{escape_html(summary['scenario']['hash'])}</code></div><div>Seed {seed}</div>"
        f"<div>{software}</div><div>{format_number(summary['fleet']['simulated_s'], 0)} s flown, computed in "
        f"{format_number(summary['fleet']['wall_s'], 1)} s</div><div>Recorded every {period}; {thinning}</div></div>"
        + (
            f'<details class="more"><summary>the whole scenario, defaults included</summary>{whole}</details>'
            if whole
            else ""
        )
    )
