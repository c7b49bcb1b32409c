"""The report of a flight: one page that needs nothing else, not even a network."""

import html
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import plotly.graph_objects as go
import plotly.io
import xarray as xr
from plotly.offline import get_plotlyjs

from anser.report.figures import NEEDED_VARIABLES, ground_tracks, range_figure, time_panels
from anser.report.style import CONFIG, SCRIPT, STYLE_SHEET
from anser.report.tables import about, aircraft_table, requirements_table, verdict
from anser.report.traces import Pen, pens_of

__all__ = ["write_report"]

_RESPONSES = ("airspeed_m_s", "alpha_deg", "path_angle_deg", "bank_deg", "course_deg", "beta_deg")
_SURFACES = ("elevator_deg", "aileron_deg", "rudder_deg")


def _with_command(name: str) -> tuple[str, str]:
    # The suffix of the unit comes last: course_deg, course_command_deg.
    key, suffix = name.split("_m_s")[0].removesuffix("_deg"), "_m_s" if name.endswith("_m_s") else "_deg"
    return name, f"{key}_command{suffix}"


_ALTITUDE_PANEL = (("altitude_m", "reference_altitude_m"),)
_RESPONSE_PANELS = tuple(_with_command(name) for name in _RESPONSES)
_CONTROL_PANELS = (*(_with_command(name) for name in _SURFACES), ("throttle", None))


def write_report(dataset: xr.Dataset, summary: Mapping[str, Any], path: Path, *, overwrite: bool = False) -> None:
    """Write the report of a flight as one HTML page with interactive figures.

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
        The dataset lacks a variable, or dataset and summary name different aircraft.
    """
    pairs = (*_ALTITUDE_PANEL, *_RESPONSE_PANELS, *_CONTROL_PANELS)
    panels = [name for pair in pairs for name in pair if name is not None]
    missing = [name for name in (*NEEDED_VARIABLES, *panels) if name not in dataset.data_vars]
    if missing:
        raise ValueError(f"the dataset lacks {', '.join(missing)}, which the report draws")
    flown, told = [str(name) for name in dataset["aircraft"].values], [row["name"] for row in summary["aircraft"]]
    if flown != told:
        raise ValueError(f"the dataset holds the aircraft {flown}, the summary {told}")
    page = _page(dataset, summary)
    if path.exists() and not overwrite:
        raise FileExistsError(f"{path} exists and is not overwritten")
    path.write_text(page, encoding="utf-8")


def _page(dataset: xr.Dataset, summary: Mapping[str, Any]) -> str:
    pens = pens_of(dataset)
    rows = summary["aircraft"]
    planned = [row["planned_arrival_s"] for row in rows if row["planned_arrival_s"] is not None]
    end = float(dataset["time"].values[-1])
    arrivals = [next(t for t in (row["arrival_s"], row["planned_arrival_s"], end) if t is not None) for row in rows]

    tracks = _figure(ground_tracks(dataset, pens, arrivals, 640), "ground-tracks")
    altitude = _figure(time_panels(dataset, pens, _ALTITUDE_PANEL, 1, planned, 320), "altitude")
    distance = _figure(range_figure(dataset, pens, planned, 320), "range")
    responses = _figure(time_panels(dataset, pens, _RESPONSE_PANELS, 2, planned, 880), "responses")
    controls = _figure(time_panels(dataset, pens, _CONTROL_PANELS, 2, planned, 600), "controls")
    name = html.escape(str(summary["scenario"]["name"]))
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{name} · anser flight report</title>
<link rel="icon" href="data:,">
<style>{STYLE_SHEET}</style>
<script>{get_plotlyjs()}</script>
</head>
<body>
<main>
<header>
<h1>{name}</h1>
{about(summary)}
{verdict(summary)}
</header>
{aircraft_table(rows)}
{requirements_table(summary["requirements"])}
{_selector(pens, [str(row["name"]) for row in rows])}
<div class="columns">
<section>
<h2>Ground tracks</h2>
<p class="caption">● start  ◆ rendezvous at arrival  ☐ goal at the start; solid flown, dashed planned, dotted goal</p>
{tracks}
</section>
<section>
<h2>Height and range</h2>
<p class="caption">Solid flown, dashed planned; grey line: planned arrival</p>
{altitude}
{distance}
</section>
</div>
<section>
<h2>Commands and responses</h2>
<p class="caption">Solid response, dashed command; grey line: planned arrival</p>
{responses}
</section>
<section>
<h2>Surfaces and throttle</h2>
<p class="caption">Solid position, dashed command; grey line: planned arrival</p>
{controls}
</section>
</main>
<script>{SCRIPT}</script>
</body>
</html>
"""


def _selector(pens: Sequence[Pen], names: Sequence[str]) -> str:
    chips = "".join(
        f'<label><input type="checkbox" checked data-aircraft="{pen.group}">'
        f'<span class="swatch" style="background:{pen.color}"></span>{html.escape(name)}</label>'
        for pen, name in zip(pens, names, strict=True)
    )
    buttons = '<button type="button" data-all="1">all</button><button type="button" data-all="0">none</button>'
    return f'<nav class="selector" aria-label="Aircraft shown">{chips}{buttons}</nav>'


def _figure(figure: go.Figure, name: str) -> str:
    return plotly.io.to_html(
        figure, CONFIG, include_plotlyjs=False, include_mathjax=False, full_html=False, div_id=name
    )
