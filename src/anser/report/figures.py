"""The figures of a report, each drawn from a dataset of results alone."""

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
import xarray as xr
from plotly.subplots import make_subplots

from anser.report.style import LAYOUT
from anser.report.traces import Pen, axis_title, spread_indices, time_trace

__all__ = ["NEEDED_VARIABLES", "ground_tracks", "range_figure", "time_panels"]

NEEDED_VARIABLES = (
    *(f"{place}{axis}_m" for place in ("", "reference_", "goal_", "rendezvous_") for axis in ("north", "east")),
    "range_to_rendezvous_m",
)
"""Variables that `ground_tracks` and `range_figure` draw."""

_ARRIVAL_LINE = {"line": {"color": "#8c959f", "width": 1}, "layer": "below"}


def ground_tracks(dataset: xr.Dataset, pens: Sequence[Pen], arrivals_s: Sequence[float], height: int) -> go.Figure:
    """Tracks over ground, East to the right and North up, in equal scales, with starts, goals and rendezvous.

    Parameters
    ----------
    dataset
        A flight.
    pens
        One for each aircraft.
    arrivals_s
        Time of arrival of each aircraft, s: where its rendezvous and the end of its goal's track are drawn.
    height
        Height of the figure, pixels.
    """
    figure = go.Figure()
    for pen, arrival in zip(pens, arrivals_s, strict=True):
        meeting = int(np.searchsorted(dataset["time"].values, arrival).clip(0, dataset.sizes["time"] - 1))
        flown = spread_indices(dataset.sizes["time"], pen.points)
        until = spread_indices(meeting + 1, pen.points // 4)
        goal = _line(dataset, pen, "goal_", until, {"width": 1.6, "dash": "1px,3px"})
        # Up to the arrival only: in the hold the planned point is one of the circle.
        plan = _line(dataset, pen, "reference_", until[until < max(meeting, 1)], {"width": 1.2, "dash": "4px,3px"})
        track = _line(dataset, pen, "", flown, {"width": 2})
        start = _mark(dataset, pen, "", 0, {"symbol": "circle", "size": 9})
        # The name stands behind the aircraft, clear of its track.
        northward = dataset["north_m"].values[flown[:2], pen.index]
        behind = "bottom center" if northward[-1] > northward[0] else "top center"
        start.update(mode="markers+text", text=[pen.name], textposition=behind, cliponaxis=False)
        goal_start = _mark(dataset, pen, "goal_", 0, {"symbol": "square-open", "size": 9, "line": {"width": 1.8}})
        rendezvous = _mark(dataset, pen, "rendezvous_", meeting, {"symbol": "diamond", "size": 11})
        figure.add_traces([goal, plan, track, start, goal_start, rendezvous])
    figure.update_layout(LAYOUT, height=height, hovermode="closest", dragmode="pan")
    figure.update_xaxes(LAYOUT["xaxis"], title={"text": axis_title(dataset["east_m"])})
    figure.update_yaxes(LAYOUT["yaxis"], title={"text": axis_title(dataset["north_m"])}, scaleanchor="x", scaleratio=1)
    return figure


def range_figure(dataset: xr.Dataset, pens: Sequence[Pen], arrivals_s: Sequence[float], height: int) -> go.Figure:
    """Range to the rendezvous over time, with buttons for a linear and a logarithmic axis."""
    figure = time_panels(dataset, pens, [("range_to_rendezvous_m", None)], 1, arrivals_s, height)
    buttons = [
        {"label": label, "method": "relayout", "args": [{"yaxis.type": kind, "yaxis.autorange": True}]}
        for label, kind in (("linear", "linear"), ("log", "log"))
    ]
    figure.update_layout(
        updatemenus=[
            {
                "type": "buttons",
                "direction": "left",
                "buttons": buttons,
                # Between the title, on the left, and plotly's own buttons, on the right.
                "x": 0.78,
                "xanchor": "right",
                "y": 1.0,
                "yanchor": "bottom",
                "pad": {"t": 0, "b": 4},
                "bgcolor": "white",
                "bordercolor": "#c8ced6",
                "font": {"size": 11},
            }
        ]
    )
    return figure


def time_panels(
    dataset: xr.Dataset,
    pens: Sequence[Pen],
    panels: Sequence[tuple[str, str | None]],
    columns: int,
    arrivals_s: Sequence[float],
    height: int,
) -> go.Figure:
    """Panels over a common time axis, each with a response (solid) and, where there is one, its command (dashed).

    Parameters
    ----------
    dataset
        A flight.
    pens
        One for each aircraft.
    panels
        Names of the response and of its command, or None, row by row.
    columns
        Panels in a row.
    arrivals_s
        Times at which a thin line marks an arrival, s.
    height
        Height of the figure, pixels.
    """
    rows = -(-len(panels) // columns)
    figure = make_subplots(
        rows,
        columns,
        shared_xaxes="all",  # pyright: ignore[reportArgumentType]
        horizontal_spacing=0.065,
        vertical_spacing=60.0 / height if rows > 1 else 0.0,
        subplot_titles=[axis_title(dataset[response]) for response, _ in panels],
    )
    for place, (response, command) in enumerate(panels):
        row, column = place // columns + 1, place % columns + 1
        traces = [time_trace(dataset[response], pen) for pen in pens]
        if command is not None:
            traces += [time_trace(dataset[command], pen, dashed=True) for pen in pens]
        figure.add_traces(traces, rows=row, cols=column)
        for arrival in dict.fromkeys(round(time, 1) for time in arrivals_s):
            figure.add_vline(arrival, row=row, col=column, **_ARRIVAL_LINE)  # pyright: ignore[reportArgumentType]
    few = len(pens) <= 4
    figure.update_layout(LAYOUT, height=height, hovermode="x unified" if few else "closest")
    figure.update_xaxes(LAYOUT["xaxis"], showticklabels=True, unifiedhovertitle={"text": _time_hover(dataset, "x")})
    figure.update_xaxes(title={"text": axis_title(dataset["time"])}, row=rows)
    figure.update_yaxes(LAYOUT["yaxis"])
    _move_titles_left(figure)
    return figure


def _move_titles_left(figure: go.Figure) -> None:
    for axis, title in zip(figure.select_xaxes(), figure.layout.annotations, strict=False):
        title.update(x=axis.domain[0], xanchor="left", font={"size": 13}, yshift=4)


def _line(dataset: xr.Dataset, pen: Pen, place: str, kept: np.ndarray, line: dict[str, object]) -> go.Scatter:
    north, east = dataset[f"{place}north_m"], dataset[f"{place}east_m"]
    return go.Scatter(
        x=east.values[kept, pen.index].astype(np.float32),
        y=north.values[kept, pen.index].astype(np.float32),
        customdata=dataset["time"].values[kept].astype(np.float32),
        mode="lines",
        line=line | {"color": pen.color},
        name=pen.name,
        legendgroup=pen.group,
        hovertemplate=_hover(dataset, pen, place),
    )


def _mark(dataset: xr.Dataset, pen: Pen, place: str, at: int, marker: dict[str, object]) -> go.Scatter:
    north, east = dataset[f"{place}north_m"], dataset[f"{place}east_m"]
    return go.Scatter(
        x=[float(east.values[at, pen.index])],
        y=[float(north.values[at, pen.index])],
        customdata=[float(dataset["time"].values[at])],
        mode="markers",
        marker=marker | {"color": pen.color},
        name=pen.name,
        legendgroup=pen.group,
        hovertemplate=_hover(dataset, pen, place),
    )


def _hover(dataset: xr.Dataset, pen: Pen, place: str) -> str:
    rows = [f"<b>{pen.name}</b>"]
    for name, number in (("north_m", "y"), ("east_m", "x")):
        rows.append(f"{axis_title(dataset[place + name])}: %{{{number}:,.0f}}")
    rows.append(_time_hover(dataset, "customdata"))
    return "<br>".join(rows) + "<extra></extra>"


def _time_hover(dataset: xr.Dataset, place: str) -> str:
    return f"{axis_title(dataset['time'])}: %{{{place}:.2f}}"
