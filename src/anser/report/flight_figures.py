"""Figures of a flight for print, by name: written to files, or returned by methods such as `flown.plot.tracks()`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import xarray as xr

from anser.report.adaptation_figures import draw_adaptation
from anser.report.derived_variables import has_certified_paths, recorded_table
from anser.report.estimates import has_estimates
from anser.report.flight_histories import (
    GOAL_VELOCITIES,
    Curve,
    draw_goal_velocities,
    draw_knowledge,
    draw_miss,
    draw_network,
    draw_ranges,
    draw_separation,
    draw_time_histories,
    has_changing_goals,
)
from anser.report.flight_sheet import FigureFormat, FlightSheet
from anser.report.flight_tracks import draw_tracks
from anser.report.style import FIGURE_SUFFIXES, PRINT_STYLE, draw_for_print, save_drawings
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
_POSITIONS = tuple(
    f"{prefix}{axis}_m" for prefix in ("", "reference_", "goal_", "rendezvous_") for axis in ("north", "east")
)
_VELOCITIES = tuple(f"velocity_{axis}_m_s" for axis in ("north", "east", "down"))
_DRAWN = tuple(name for curve in _CURVES for name in (curve.name, curve.reference) if name is not None)
_OTHERS = ("range_to_rendezvous_m", "rendezvous_altitude_m", "phase")
NEEDED_VARIABLES = tuple(dict.fromkeys((*_POSITIONS, *_VELOCITIES, *_DRAWN, *_OTHERS)))
"""Names of the variables that a dataset must contain for the figures of a flight, besides those of the surfaces."""


def _always(_: xr.Dataset) -> str:
    return ""


@dataclass(frozen=True)
class FlightFigure:
    """A type of figure of a flight."""

    draw: Callable[[FlightSheet], "Figure"]  # returns the figure of one flight
    unavailable_reason: Callable[[xr.Dataset], str] = _always  # why a flight has no such figure; empty: it has one


def _histories(curves: Sequence[Curve], heading: str, reference_name: str = "") -> FlightFigure:
    return FlightFigure(lambda sheet: draw_time_histories(sheet, curves, heading, reference_name))


def _surfaces(sheet: FlightSheet) -> "Figure":
    curves = [Curve(f"{name}_deg", f"{name}_command_deg", stop_surface=name) for name in surface_names(sheet.dataset)]
    return draw_time_histories(sheet, curves, "control surfaces", "commanded")


def _plan(sheet: FlightSheet) -> "Figure":
    if has_certified_paths(sheet.scenario):  # certified paths have no lateral bend
        return draw_time_histories(sheet, _PLAN[1:], "length and arrival time of the plan")
    return draw_time_histories(sheet, _PLAN, "shape parameter, length and arrival time of the plan")


FLIGHT_FIGURES: dict[str, FlightFigure] = {
    "tracks": FlightFigure(draw_tracks),
    "profile": _histories((_ALTITUDE, _AIRSPEED), "altitude and airspeed", "planned, commanded"),
    "altitudes": _histories((_ALTITUDE,), "altitudes", "planned"),
    "airspeed": _histories((_AIRSPEED,), "airspeeds", "commanded"),
    "bank": _histories((_BANK,), "bank angles", "commanded"),
    "load-factor": _histories((_LOAD_FACTOR,), "load factors"),
    "surfaces": FlightFigure(_surfaces),
    "separation": FlightFigure(
        draw_separation, lambda dataset: "" if dataset.sizes["aircraft"] > 1 else "one aircraft flies alone"
    ),
    "ranges": FlightFigure(draw_ranges),
    "miss": FlightFigure(draw_miss),
    "guidance": _histories(_GUIDANCE, "guidance commands and responses", "commanded"),
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
    "adaptation": FlightFigure(
        draw_adaptation, lambda dataset: "" if has_estimates(dataset) else "no aircraft has an adaptive inversion"
    ),
    "network": FlightFigure(
        draw_network,
        lambda dataset: "" if recorded_table(dataset, "network") else "a centre plans for all its aircraft",
    ),
}
"""Types of figures of a flight, by name."""


def available_figures(dataset: xr.Dataset) -> tuple[str, ...]:
    """Return the names of the figures that can be drawn of a flight."""
    return tuple(name for name, figure in FLIGHT_FIGURES.items() if not figure.unavailable_reason(dataset))


def select_figures(dataset: xr.Dataset, names: Sequence[str]) -> dict[str, FlightFigure]:
    """Return the figures with the requested names, by name; hyphens and underscores are equivalent.

    Raises ValueError if a name is unknown, or if the figure cannot be drawn of the flight.
    """
    figures = {}
    for requested_name in names:
        name = requested_name.replace("_", "-")
        expected = f"expected one of {', '.join(available_figures(dataset))}"
        if name not in FLIGHT_FIGURES:
            raise ValueError(f"arrived {requested_name!r}; {expected}")
        if reason := FLIGHT_FIGURES[name].unavailable_reason(dataset):
            raise ValueError(f"arrived {requested_name!r}, which there is not of this flight: {reason}; {expected}")
        figures[name] = FLIGHT_FIGURES[name]
    return figures


def draw_flight(
    dataset: xr.Dataset,
    name: str,
    folder: Path,
    suffixes: Sequence[str] = FIGURE_SUFFIXES,
    *,
    selection: Mapping[str, FlightFigure] | None = None,
    figure_format: FigureFormat | None = None,
) -> tuple[Path, ...]:
    """Draw figures of a flight into new files `<name>-<figure><suffix>` of a folder; return the paths of the files.

    `selection` is a result of `select_figures`; None draws every available figure. `figure_format` sets width and
    title, by default 165 mm with a title. Raises FileExistsError if one of the files exists.
    """
    sheet = FlightSheet(dataset, figure_format)
    figures = select_figures(dataset, available_figures(dataset)) if selection is None else selection
    drawings = {
        f"{name}-{key}": lambda _, flight_figure=figure: flight_figure.draw(sheet) for key, figure in figures.items()
    }
    return save_drawings(drawings, dataset, PRINT_STYLE, folder, suffixes)


_WIDTH_MM = FigureFormat().width_mm


def _method(name: str, description: str) -> "Callable[..., Figure]":

    def draw(self: "FlightPlots", *, width_mm: float = _WIDTH_MM, title: bool = True) -> "Figure":
        return self(name, width_mm=width_mm, title=title)

    draw.__name__ = draw.__qualname__ = name.replace("-", "_")
    draw.__doc__ = f"{description}\n\n        Arguments and errors as of a call of `FlightPlots` itself."
    return draw


class FlightPlots:
    """Figures of one flight as `matplotlib.figure.Figure`, which a notebook displays and `savefig` writes to a file.

    `flown.plot("guidance")` draws the figure of this name; `flown.plot.names` lists the available names.
    """

    def __init__(self, dataset: xr.Dataset) -> None:
        self._dataset = dataset

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the figures that can be drawn of this flight."""
        return available_figures(self._dataset)

    def __call__(self, name: str, *, width_mm: float = _WIDTH_MM, title: bool = True) -> "Figure":
        """Return the figure with a name of `names`; `title` says whether the flight's title is drawn.

        Raises ValueError if no figure of this name can be drawn of the flight, or the width is not 60 to 400 mm.
        """
        try:
            selection = select_figures(self._dataset, [name])
        except ValueError as error:
            raise ValueError(f"plot: {error}") from None
        try:
            figure_format = FigureFormat(width_mm, title)
        except ValueError as error:
            raise ValueError(f"width_mm: {error}") from None
        (flight_figure,) = selection.values()
        return draw_for_print(lambda dataset: flight_figure.draw(FlightSheet(dataset, figure_format)), self._dataset)

    def __repr__(self) -> str:
        return f"figures of a flight: {', '.join(self.names)}"

    tracks = _method("tracks", "Tracks over ground up to the arrivals, with the goals'.")
    profile = _method("profile", "Altitude and airspeed against time, with commands and limits.")
    altitudes = _method("altitudes", "Altitude against time, with the planned one and the limits.")
    airspeed = _method("airspeed", "True airspeed against time, with its command and limits.")
    bank = _method("bank", "Bank angle about the velocity against time, with its command and limits.")
    load_factor = _method("load-factor", "Normal load factor against time, with its limits.")
    surfaces = _method("surfaces", "Each control surface against time, with its command and stops.")
    separation = _method(
        "separation", "Least distance of each aircraft to any other, and over the required separation."
    )
    ranges = _method("ranges", "Range to the rendezvous against time, linear and logarithmic.")
    miss = _method("miss", "Zero-effort miss of the rendezvous against time, with the miss that is required.")
    guidance = _method("guidance", "Airspeed, path angle and course against time, with their commands.")
    goal_velocity = _method("goal-velocity", "Velocity of goals that change it, as the aircraft estimate it.")
    plan = _method("plan", "The plan's parameters against time, as it is renewed.")
    knowledge = _method("knowledge", "How well the aircraft know where their goals are.")
    adaptation = _method("adaptation", "Estimates of the adaptive autopilots, with bands and the truth.")
    network = _method("network", "Links and clocks of a fleet without a centre.")
