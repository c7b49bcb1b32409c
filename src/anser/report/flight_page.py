"""The report of a flight, or of two side by side: one page that needs nothing else, not even a network."""

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

_LISTED_BELOW = 6  # so many aircraft are listed below the scene, more beside it
_TIGHTEST = 6  # margins shown before the rest is unfolded
_STYLES = ("vendor/uplot.min.css", "page.css")
_SCRIPTS = (
    *("vendor/uplot.min.js", "vendor/three.min.js"),
    *("theme.js", "inflate.js", "store.js", "timeline.js", "plots.js"),
    *("scene_parts.js", "scene_goals.js", "scene_eyes.js", "scene_labels.js", "scene.js", "page.js"),
)

_Run = tuple[str, xr.Dataset, Mapping[str, Any]]


def write_report(dataset: xr.Dataset, summary: Mapping[str, Any], path: Path, *, overwrite: bool = False) -> None:
    """Write the report of a flight as one HTML page: the answer, a scene that moves, plots, the scenario.

    Parameters
    ----------
    dataset
        The flight, as `flight.nc` holds it.
    summary
        Its summary, as `summary.json` holds it.
    path
        Where to write the page.
    overwrite
        Whether a page that stands there may be replaced.

    Raises
    ------
    FileExistsError
        `path` exists and may not be replaced.
    ValueError
        The dataset lacks a variable, or dataset and summary are not of one flight.
    """
    check_flight(dataset, summary)
    _write([(str(summary["scenario"]["name"]), dataset, summary)], path, overwrite)


def write_comparison(runs: Sequence[_Run], path: Path, *, overwrite: bool = False) -> None:
    """Write the report of two flights side by side, over one time, with equal axes.

    Parameters
    ----------
    runs
        Two of: what the run is called on the page, its dataset, its summary.
    path, overwrite
        As in `write_report`.

    Raises
    ------
    FileExistsError, ValueError
        As in `write_report`; ValueError too where there are not two runs.
    """
    if len(runs) != 2:
        raise ValueError(f"two runs stand side by side, not {len(runs)}")
    for _, dataset, summary in runs:
        check_flight(dataset, summary)
    _write(list(runs), path, overwrite)


def _write(runs: list[_Run], path: Path, overwrite: bool) -> None:
    if path.exists() and not overwrite:  # before all the work
        raise FileExistsError(f"{path} exists and is not overwritten")
    write_page(_page(runs), path, overwrite=overwrite)


def _page(runs: list[_Run]) -> str:
    scenarios = [recorded_scenario(dataset) for _, dataset, _ in runs]
    shown = [
        (add_derived_variables(run[1], scenario), run[2], scenario)
        for run, scenario in zip(runs, scenarios, strict=True)
    ]
    data = {"colors": len(COLORS), "runs": [flight_data(*of, run[0]) for of, run in zip(shown, runs, strict=True)]}
    forms = {one["form"] for run in data["runs"] for one in run["aircraft"]}
    stage = "stage few" if all(len(run["aircraft"]) <= _LISTED_BELOW for run in data["runs"]) else "stage"
    single = len(runs) == 1
    labels = [escape_html(label) for label, _, _ in runs]
    title = labels[0] if single else f"{labels[0]} beside {labels[1]}"
    openings = [_opening(None if single else label, *of) for label, of in zip(labels, shown, strict=True)]
    lead = (
        escape_html(runs[0][1].attrs.get("description", "")) if single else "Two runs over one time, with equal axes."
    )
    beside = "" if single else difference_table([(label, summary) for label, _, summary in runs], scenarios)
    tables = [aircraft_table(summary["aircraft"]) for _, _, summary in runs]
    sections = "".join(
        f'<section id="{section.key}"><h2>{section.title}</h2>'
        f'<p class="caption">{section.caption}<span class="who"></span></p>'
        f'<div class="plots" data-section="{section.key}"></div></section>'
        for section in SECTIONS
        if any(section.key == one["key"] for run in data["runs"] for one in run["sections"])
    )
    contents = f"""<main>
<header>
<h1>{title}</h1>
<p class="lead">{lead}</p>
<p id="fault" class="fault" hidden></p>
</header>
<div class="runs">{"".join(openings)}</div>
{beside}
<section id="scene">
<h2>The flight</h2>
{toolbar()}
<div class="runs">{_places(labels, stage, _stage)}</div>
{scene_key(forms, any(s.get("keep_out") for s in scenarios))}
</section>
<section id="aircraft">
<h2>Aircraft</h2>
<div class="runs">{_places(labels, "", lambda k: tables[k])}</div>
</section>
<section id="events">
<h2>What happened when</h2>
<p class="caption">One lane for each aircraft<span class="of-screen">; move over it for the words, click
to bring the aircraft into focus</span>.</p>
<div class="runs">{_places(labels, "timeline-place", lambda k: "")}</div>
{EVENTS_KEY}
</section>
{_network(labels, [dataset for dataset, *_ in shown])}
<div class="toolbar"><span class="group">Time axis
<button type="button" data-zoom="all">all</button><button type="button" data-zoom="approach">up to the arrival</button>
<button type="button" data-zoom="last">last 15 s</button></span>
<span class="caption">Drag in a plot to zoom, double-click for all. Dotted line: arrival.</span></div>
{sections}
<section id="provenance">
<h2>Scenario, versions, seed</h2>
<div class="runs">{_places(labels, "", lambda k: _provenance(runs[k], scenarios[k], data["runs"][k]["every"]))}</div>
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


def _places(labels: Sequence[str], kind: str, inner: Any) -> str:
    head = "" if len(labels) == 1 else '<p class="run-name"><b>{}</b></p>'
    return "".join(
        f'<div>{head.format(label) if head else ""}<div class="{kind}" data-run="{k}">{inner(k)}</div></div>'
        for k, label in enumerate(labels)
    )


def _network(labels: Sequence[str], datasets: Sequence[xr.Dataset]) -> str:
    """Section of a fleet without a centre; empty where there is none."""
    strips = [links_strip(dataset) for dataset in datasets]
    if not any(strips):
        return ""
    return (
        '<section id="links"><h2>Who heard whom</h2><p class="caption">One row for each pair, filled while the two '
        "hear each other; below, the quality of service of the network: 1 where all always hear all, 0 where it falls "
        f'apart.</p><div class="runs">{_places(labels, "", lambda k: strips[k])}</div></section>'
    )


def _stage(k: int) -> str:
    return f'<div class="scene-place" data-run="{k}"></div><div class="list-place" data-run="{k}"></div>'


def _opening(label: str | None, dataset: xr.Dataset, summary: Mapping[str, Any], scenario: Mapping[str, Any]) -> str:
    name = f'<p class="run-name"><b>{label}</b></p>' if label is not None else ""
    margins = find_flight_margins(dataset, summary)
    warning = proximity_warning([summary["fleet"].get("separation_min_m")], dataset.attrs)
    rest = margins[_TIGHTEST:]
    more = f'<details class="more"><summary>{len(rest)} more</summary>{margins_list(rest)}</details>' if rest else ""
    return (
        f'<section class="opening"><div>{name}'
        f"{verdict_html(summary, scenario, margins, warning)}{summary_cards(dataset, summary)}"
        f"{arrival_strip(summary)}</div>"
        '<div><h2 class="tight">What was tight</h2><p class="caption">Part of the way to each requirement and limit; '
        f"full at the limit.</p>{margins_list(margins[:_TIGHTEST])}{more}</div></section>"
    )


def _provenance(run: _Run, scenario: Mapping[str, Any], every: int) -> str:
    _, dataset, summary = run
    software = ", ".join(f"{escape_html(name)} {escape_html(version)}" for name, version in summary["versions"].items())
    seed = "none" if summary["seed"] is None else escape_html(summary["seed"])
    period = (
        f"{float(dataset['time'].values[1] - dataset['time'].values[0]):g} s" if dataset.sizes["time"] > 1 else "once"
    )
    drawn = "every record is drawn" if every == 1 else f"one record in {every} is drawn; figures are of the whole run"
    whole = (
        f'<pre tabindex="0">{escape_html(json.dumps(scenario, indent=2, ensure_ascii=False))}</pre>' if scenario else ""
    )
    return (
        f'<div class="facts"><div>Scenario <b>{escape_html(summary["scenario"]["name"])}</b></div>'
        f"<div>Hash <code>{escape_html(summary['scenario']['hash'])}</code></div><div>Seed {seed}</div>"
        f"<div>{software}</div><div>{format_number(summary['fleet']['simulated_s'], 0)} s flown, computed in "
        f"{format_number(summary['fleet']['wall_s'], 1)} s</div><div>Recorded every {period}; {drawn}</div></div>"
        + (
            f'<details class="more"><summary>the whole scenario, defaults included</summary>{whole}</details>'
            if whole
            else ""
        )
    )
