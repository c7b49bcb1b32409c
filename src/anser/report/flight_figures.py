"""Figures of a flight for print, by name.

The available ones, how they are written to files, and the same figures as methods for Python
(`flown.plot.tracks()`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import xarray as xr

from anser.report.derived_variables import has_certified_paths
from anser.report.flight_histories import (
    GOAL_VELOCITIES,
    Curve,
    draw_goal_velocities,
    draw_miss,
    draw_ranges,
    draw_separation,
    draw_time_histories,
    has_changing_goals,
)
from anser.report.flight_knowledge import draw_knowledge, draw_network
from anser.report.flight_sheet import FigureFormat, FlightSheet
from anser.report.flight_tracks import draw_tracks
from anser.report.style import FIGURE_SUFFIXES, PRINT_STYLE, draw_for_print, save_drawings
from anser.report.svg_charts import recorded_network
from anser.results.dataset import surface_names

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_ALTITUDE = Curve("altitude_m", "reference_altitude_m", "altitude_min_m", "altitude_max_m")
_AIRSPEED = Curve("airspeed_m_s", "airspeed_command_m_s", "speed_min_m_s", "speed_max_m_s")
_BANK = Curve("bank_deg", "bank_command_deg", "-bank_max_deg", "bank_max_deg")
_LOAD_FACTOR = Curve("load_factor", None, "load_factor_min", "load_factor_max")
_GUIDANCE = (
    Curve("airspeed_m_s", "airspeed_command_m_s"),
    Curve("path_angle_deg", "path_angle_command_deg"),
    Curve("course_deg", "course_command_deg"),
)
_PLAN = (
    Curve("lateral_bend_m", label="Lateral bend of the plan"),
    Curve("planned_length_m", label="Length of the path"),
    Curve("arrival_time_s"),
)
_CURVES = (_ALTITUDE, _AIRSPEED, _BANK, _LOAD_FACTOR, *_GUIDANCE, *_PLAN, *GOAL_VELOCITIES)
NEEDED_VARIABLES = tuple(
    dict.fromkeys(
        (
            *(f"{of}{axis}_m" for of in ("", "reference_", "goal_", "rendezvous_") for axis in ("north", "east")),
            *(f"velocity_{axis}_m_s" for axis in ("north", "east", "down")),
            *(name for curve in _CURVES for name in (curve.name, curve.reference) if name is not None),
            *("range_to_rendezvous_m", "rendezvous_altitude_m", "phase"),
        )
    )
)
"""Variables of a flight that these figures draw, besides those of its surfaces."""


def _always(_: xr.Dataset) -> str:
    return ""


@dataclass(frozen=True)
class FlightFigure:
    """A figure.

    Attributes
    ----------
    draw
        Draws it on a sheet.
    lacking
        Why there is none of a flight; empty where there is one.
    """

    draw: Callable[[FlightSheet], "Figure"]
    unavailable_reason: Callable[[xr.Dataset], str] = _always


def _surfaces(sheet: FlightSheet) -> "Figure":
    curves = [Curve(f"{name}_deg", f"{name}_command_deg", stop_surface=name) for name in surface_names(sheet.dataset)]
    return draw_time_histories(sheet, curves, "control surfaces", "commanded")


def _plan(sheet: FlightSheet) -> "Figure":
    if has_certified_paths(sheet.scenario):  # its paths have no such parameter
        return draw_time_histories(sheet, _PLAN[1:], "length and arrival time of the plan")
    return draw_time_histories(sheet, _PLAN, "shape parameter, length and arrival time of the plan")


FLIGHT_FIGURES: dict[str, FlightFigure] = {
    "tracks": FlightFigure(draw_tracks),
    "profile": FlightFigure(
        lambda sheet: draw_time_histories(sheet, (_ALTITUDE, _AIRSPEED), "altitude and airspeed", "planned, commanded")
    ),
    "altitudes": FlightFigure(lambda sheet: draw_time_histories(sheet, (_ALTITUDE,), "altitudes", "planned")),
    "airspeed": FlightFigure(lambda sheet: draw_time_histories(sheet, (_AIRSPEED,), "airspeeds", "commanded")),
    "bank": FlightFigure(lambda sheet: draw_time_histories(sheet, (_BANK,), "bank angles", "commanded")),
    "load-factor": FlightFigure(lambda sheet: draw_time_histories(sheet, (_LOAD_FACTOR,), "load factors")),
    "surfaces": FlightFigure(_surfaces),
    "separation": FlightFigure(
        draw_separation, lambda dataset: "" if dataset.sizes["aircraft"] > 1 else "one aircraft flies alone"
    ),
    "ranges": FlightFigure(draw_ranges),
    "miss": FlightFigure(draw_miss),
    "guidance": FlightFigure(
        lambda sheet: draw_time_histories(sheet, _GUIDANCE, "guidance commands and responses", "commanded")
    ),
    "goal-velocity": FlightFigure(
        draw_goal_velocities,
        lambda dataset: (
            "" if has_changing_goals(dataset) else "every goal stands or keeps its velocity, and the aircraft know it"
        ),
    ),
    "plan": FlightFigure(_plan),
    "knowledge": FlightFigure(
        draw_knowledge, lambda dataset: "" if "goal_sigma_north_m" in dataset else "its sensors have no errors"
    ),
    "network": FlightFigure(
        draw_network, lambda dataset: "" if recorded_network(dataset) else "a centre plans for all its aircraft"
    ),
}
"""Each figure by its name."""


def available_figures(dataset: xr.Dataset) -> tuple[str, ...]:
    """Names of the figures that can be drawn of a flight."""
    return tuple(name for name, figure in FLIGHT_FIGURES.items() if not figure.unavailable_reason(dataset))


def select_figures(dataset: xr.Dataset, names: Sequence[str]) -> dict[str, FlightFigure]:
    """Figures of a flight by their names, with hyphens or underscores.

    Raises
    ------
    ValueError
        There is none of a name, at all or of this flight; the message says which there are.
    """
    found = {}
    for arrived in names:
        name = arrived.replace("_", "-")
        expected = f"expected one of {', '.join(available_figures(dataset))}"
        if name not in FLIGHT_FIGURES:
            raise ValueError(f"arrived {arrived!r}; {expected}")
        if why := FLIGHT_FIGURES[name].unavailable_reason(dataset):
            raise ValueError(f"arrived {arrived!r}, which there is not of this flight: {why}; {expected}")
        found[name] = FLIGHT_FIGURES[name]
    return found


def draw_flight(
    dataset: xr.Dataset,
    name: str,
    folder: Path,
    suffixes: Sequence[str] = FIGURE_SUFFIXES,
    *,
    selection: Mapping[str, FlightFigure] | None = None,
    figure_format: FigureFormat | None = None,
) -> tuple[Path, ...]:
    """Draw figures of a flight into `NAME-FIGURE` of a folder.

    Parameters
    ----------
    dataset
        The flight, as `flight.nc` holds it.
    name
        What the names of the files begin with.
    folder
        To write into; returns the paths of its new files.
    suffixes
        Kinds of files, of `FIGURE_SUFFIXES`.
    chosen
        As `select_figures` has them; None: all that can be drawn.
    paper
        What they are drawn on; None: as wide as a page's text, with titles.
    """
    sheet = FlightSheet(dataset, figure_format or FigureFormat())
    figures = select_figures(dataset, available_figures(dataset)) if selection is None else selection
    drawings = {f"{name}-{key}": lambda _, of=figure: of.draw(sheet) for key, figure in figures.items()}
    return save_drawings(drawings, dataset, PRINT_STYLE, folder, suffixes)


_WIDTH_MM = FigureFormat().width_mm


def _method(name: str, words: str) -> "Callable[..., Figure]":
    """Method that draws one figure."""

    def draw(self: "FlightPlots", *, width_mm: float = _WIDTH_MM, title: bool = True) -> "Figure":
        return self(name, width_mm=width_mm, title=title)

    draw.__name__ = draw.__qualname__ = name.replace("-", "_")
    draw.__doc__ = f"{words}\n\n        Arguments and errors as of a call of `FlightPlots` itself."
    return draw


class FlightPlots:
    """Figures of one flight, each a new `matplotlib.figure.Figure`, which a notebook shows and `savefig` writes.

    `flown.plot("guidance")` draws any figure of `anser figures`; `flown.plot.names` are those that there are.
    """

    def __init__(self, dataset: xr.Dataset) -> None:
        self._dataset = dataset

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the figures that can be drawn of this flight."""
        return available_figures(self._dataset)

    def __call__(self, name: str, *, width_mm: float = _WIDTH_MM, title: bool = True) -> "Figure":
        """Draw a figure by its name.

        Parameters
        ----------
        name
            One of `names`.
        width_mm
            Width of the figure; letters keep their size.
        title
            Whether the flight's title stands above it.

        Raises
        ------
        ValueError
            There is none of this name, or the width is none of a figure.
        """
        try:
            figure = select_figures(self._dataset, [name])
        except ValueError as error:
            raise ValueError(f"plot: {error}") from None
        try:
            paper = FigureFormat(width_mm, title)
        except ValueError as error:
            raise ValueError(f"width_mm: {error}") from None
        (one,) = figure.values()
        return draw_for_print(lambda dataset: one.draw(FlightSheet(dataset, paper)), self._dataset)

    def __repr__(self) -> str:
        return f"figures of a flight: {', '.join(self.names)}"

    tracks = _method("tracks", "Tracks over ground up to the arrivals, with the goals'.")
    profile = _method("profile", "Altitude and airspeed against time, with what was asked for and the limits.")
    altitudes = _method("altitudes", "Altitude against time, with the planned one and the limits.")
    airspeed = _method("airspeed", "True airspeed against time, with its command and limits.")
    bank = _method("bank", "Bank angle about the velocity against time, with its command and limits.")
    load_factor = _method("load-factor", "Normal load factor against time, with its limits.")
    surfaces = _method("surfaces", "Each control surface against time, with its command and stops.")
    separation = _method(
        "separation", "Least distance of each aircraft to any other, and over the separation asked for."
    )
    ranges = _method("ranges", "Range to the rendezvous against time, linear and logarithmic.")
    miss = _method("miss", "Zero-effort miss of the rendezvous against time, with the miss that is required.")
    guidance = _method("guidance", "Airspeed, path angle and course against time, with their commands.")
    goal_velocity = _method("goal-velocity", "Velocity of goals that change it, as the aircraft estimate it.")
    plan = _method("plan", "The plan's parameters against time, as it is renewed.")
    knowledge = _method("knowledge", "How well the aircraft know where their goals are.")
    network = _method("network", "Links and clocks of a fleet without a centre.")
