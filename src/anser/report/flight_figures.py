"""Figures of a flight for print, by name: which there are, of which flights, and how they are written."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import xarray as xr

from anser.report.flight_curves import Curve, draw_over_time
from anser.report.flight_distances import draw_miss, draw_ranges, draw_separation
from anser.report.flight_goals import GOAL_VELOCITIES, draw_goal_velocities, has_changing_goals
from anser.report.flight_knowledge import draw_knowledge, draw_network
from anser.report.flight_paper import Paper, Sheet
from anser.report.flight_tracks import draw_tracks
from anser.report.flown_beside_plan import is_certified
from anser.report.links_strip import network_of
from anser.report.print_style import FIGURE_SUFFIXES, PRINT_STYLE, save_drawings
from anser.results import surfaces_of

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
    Curve("lateral_bend_m", words="Lateral bend of the plan"),
    Curve("planned_length_m", words="Length of the path"),
    Curve("arrival_time_s"),
)
_CURVES = (_ALTITUDE, _AIRSPEED, _BANK, _LOAD_FACTOR, *_GUIDANCE, *_PLAN, *GOAL_VELOCITIES)
NEEDED_VARIABLES = tuple(
    dict.fromkeys(
        (
            *(f"{of}{axis}_m" for of in ("", "reference_", "goal_", "rendezvous_") for axis in ("north", "east")),
            *(f"velocity_{axis}_m_s" for axis in ("north", "east", "down")),
            *(name for curve in _CURVES for name in (curve.name, curve.wanted) if name is not None),
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

    draw: Callable[[Sheet], "Figure"]
    lacking: Callable[[xr.Dataset], str] = _always


def _surfaces(sheet: Sheet) -> "Figure":
    curves = [Curve(f"{name}_deg", f"{name}_command_deg", stops_of=name) for name in surfaces_of(sheet.dataset)]
    return draw_over_time(sheet, curves, "control surfaces", "commanded")


def _plan(sheet: Sheet) -> "Figure":
    if is_certified(sheet.scenario):  # its paths have no such parameter
        return draw_over_time(sheet, _PLAN[1:], "length and arrival time of the plan")
    return draw_over_time(sheet, _PLAN, "shape parameter, length and arrival time of the plan")


FLIGHT_FIGURES: dict[str, FlightFigure] = {
    "tracks": FlightFigure(draw_tracks),
    "profile": FlightFigure(
        lambda sheet: draw_over_time(sheet, (_ALTITUDE, _AIRSPEED), "altitude and airspeed", "planned, commanded")
    ),
    "altitudes": FlightFigure(lambda sheet: draw_over_time(sheet, (_ALTITUDE,), "altitudes", "planned")),
    "airspeed": FlightFigure(lambda sheet: draw_over_time(sheet, (_AIRSPEED,), "airspeeds", "commanded")),
    "bank": FlightFigure(lambda sheet: draw_over_time(sheet, (_BANK,), "bank angles", "commanded")),
    "load-factor": FlightFigure(lambda sheet: draw_over_time(sheet, (_LOAD_FACTOR,), "load factors")),
    "surfaces": FlightFigure(_surfaces),
    "separation": FlightFigure(
        draw_separation, lambda dataset: "" if dataset.sizes["aircraft"] > 1 else "one aircraft flies alone"
    ),
    "ranges": FlightFigure(draw_ranges),
    "miss": FlightFigure(draw_miss),
    "guidance": FlightFigure(
        lambda sheet: draw_over_time(sheet, _GUIDANCE, "guidance commands and responses", "commanded")
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
        draw_network, lambda dataset: "" if network_of(dataset) else "a centre plans for all its aircraft"
    ),
}
"""Each figure by its name."""


def figures_of(dataset: xr.Dataset) -> tuple[str, ...]:
    """Names of the figures that can be drawn of a flight."""
    return tuple(name for name, figure in FLIGHT_FIGURES.items() if not figure.lacking(dataset))


def chosen_figures(dataset: xr.Dataset, names: Sequence[str]) -> dict[str, FlightFigure]:
    """Figures of a flight by their names, with hyphens or underscores.

    Raises
    ------
    ValueError
        There is none of a name, at all or of this flight; the message says which there are.
    """
    found = {}
    for arrived in names:
        name = arrived.replace("_", "-")
        expected = f"expected one of {', '.join(figures_of(dataset))}"
        if name not in FLIGHT_FIGURES:
            raise ValueError(f"arrived {arrived!r}; {expected}")
        if why := FLIGHT_FIGURES[name].lacking(dataset):
            raise ValueError(f"arrived {arrived!r}, which there is not of this flight: {why}; {expected}")
        found[name] = FLIGHT_FIGURES[name]
    return found


def draw_flight(
    dataset: xr.Dataset,
    name: str,
    folder: Path,
    suffixes: Sequence[str] = FIGURE_SUFFIXES,
    *,
    chosen: Mapping[str, FlightFigure] | None = None,
    paper: Paper | None = None,
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
        As `chosen_figures` has them; None: all that can be drawn.
    paper
        What they are drawn on; None: as wide as a page's text, with titles.
    """
    sheet = Sheet(dataset, paper or Paper())
    figures = chosen_figures(dataset, figures_of(dataset)) if chosen is None else chosen
    drawings = {f"{name}-{key}": lambda _, of=figure: of.draw(sheet) for key, figure in figures.items()}
    return save_drawings(drawings, dataset, PRINT_STYLE, folder, suffixes)
