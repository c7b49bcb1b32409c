"""Flight envelope of an aircraft: trims over altitude and Mach number, and path commands flown from the trim points."""

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.f16 import AbstractF16
from anser.analysis.airframes import valid_airspeed_range
from anser.analysis.surveys import (
    OUTCOMES,
    REASONS,
    FlightRows,
    Survey,
    SurveyResult,
    flight_attributes,
    flight_coordinates,
    sample_count,
    select_rows,
    trim_stop,
)
from anser.analysis.trim_points import Inversion, map_points, require_inversion, survey_gains
from anser.control.limits import FlightLimits
from anser.environment.environment import Environment
from anser.missions.batches import Progress
from anser.results.variable_labels import scatter_rows, unit_attributes
from anser.steady.trim import TrimMapPoint, TrimTarget, trim_target
from anser.units import DEG_RAD, RAD_DEG

RESERVE_MIN = 0.1
"""Least reserve of a trim point "with reserve": fraction of full power, up and down, and of each surface's travel."""

GRID_DIMENSIONS = ("condition", "altitude", "mach")
"""Dimensions of the grid of steady flights."""


class TrimMap(NamedTuple):
    """Trims of all steady flights in `CONDITIONS` (level, climb, ...) over a grid of altitudes (m) and Mach numbers."""

    # axes of the grid: altitude in m, and Mach number
    altitudes: np.ndarray
    machs: np.ndarray
    airspeeds: np.ndarray  # true airspeed, m/s, shape (altitude, mach)
    # trim target and trim of every point; leaves of shape (points, ...), in the order (condition, altitude, mach)
    targets: TrimTarget
    points: TrimMapPoint
    is_commanded: tuple[bool, ...]  # whether each surface is commanded; False: on a schedule

    def gridded(self, values: Any) -> np.ndarray:
        """Reshape values from (points, ...) to the axes of the grid, (condition, altitude, mach, ...)."""
        array = np.asarray(values)
        return array.reshape(len(CONDITIONS), *self.airspeeds.shape, *array.shape[1:])

    def variable(self, values: Any, unit: str, long_name: str, *dimensions: str) -> Any:
        """Return values of shape (points, ...) as a dataset variable over the grid, with `unit` and `long_name`.

        `dimensions` are the names of the axes that follow the axis of the points.
        """
        return (*GRID_DIMENSIONS, *dimensions), self.gridded(values), unit_attributes(unit, long_name)

    def with_reserve(self) -> Any:
        """Return a dataset variable: True if a flyable trim leaves a tenth (`RESERVE_MIN`) of power and travel."""
        points = self.points
        power_reserve = np.minimum(np.asarray(points.power_margin), np.asarray(points.power_above_idle))
        reserve = np.minimum(power_reserve, np.asarray(points.surface_margin)[:, list(self.is_commanded)].min(axis=1))
        long_name = "Whether a tenth of power and surfaces is left"
        return self.variable(np.asarray(points.trimmable) & (reserve >= RESERVE_MIN), "1", long_name)

    def coordinates(self, condition: str) -> dict[str, Any]:
        """Return the dataset coordinates of the grid; `condition` is the label of the axis of steady flights."""
        return {
            "condition": ("condition", np.array([c.name for c in CONDITIONS]), unit_attributes("", condition)),
            "condition_meaning": ("condition", np.array([c.meaning for c in CONDITIONS])),
            "altitude": ("altitude", self.altitudes, unit_attributes("m", "Geometric altitude")),
            "mach": ("mach", self.machs, unit_attributes("1", "Mach number")),
            "airspeed_m_s": (("altitude", "mach"), self.airspeeds, unit_attributes("m s-1", "True airspeed")),
        }


@dataclasses.dataclass(frozen=True)
class SteadyFlight:
    """Type of steady flight: climb angle (deg), and load factor of a coordinated turn to the right (1: straight)."""

    name: str
    meaning: str
    path_angle_deg: float = 0.0
    turn_load_factor: float = 1.0


@dataclasses.dataclass(frozen=True)
class StepCommand:
    """Step of the commanded airspeed (m/s), path angle (deg) and course (deg); 0: no step of the channel."""

    name: str
    meaning: str
    speed_m_s: float = 0.0
    path_angle_deg: float = 0.0
    course_deg: float = 0.0

    @property
    def size(self) -> tuple[float, float, float]:
        """Step of airspeed (m/s), path angle and course (rad)."""
        return self.speed_m_s, self.path_angle_deg * DEG_RAD, self.course_deg * DEG_RAD


CONDITIONS = (
    SteadyFlight("level", "level"),
    SteadyFlight("climb", "climb at 5 deg", path_angle_deg=5.0),
    SteadyFlight("descent", "descent at 5 deg", path_angle_deg=-5.0),
    SteadyFlight("turn_2g", "level turn, 2 g", turn_load_factor=2.0),
    SteadyFlight("turn_4g", "level turn, 4 g", turn_load_factor=4.0),
)
COMMANDS = (
    StepCommand("faster", "speed +10 m/s", speed_m_s=10.0),
    StepCommand("slower", "speed -10 m/s", speed_m_s=-10.0),
    StepCommand("up", "path angle +3 deg", path_angle_deg=3.0),
    StepCommand("down", "path angle -3 deg", path_angle_deg=-3.0),
    StepCommand("right", "course +20 deg", course_deg=20.0),
    StepCommand("all", "+10 m/s, +3 deg, +20 deg", speed_m_s=10.0, path_angle_deg=3.0, course_deg=20.0),
)
ALTITUDES_M = np.array([250.0, *np.arange(1000.0, 15001.0, 1000.0)])
"""Default altitudes, m. The lowest is above 0, the lower bound of the data: a descent from 0 would leave the data."""
MACHS = np.linspace(0.15, 0.95, 18)
_COARSE_MACHS = [0, 4, 8, 13, 17]
_F16_SPEED_M_S = 150.0
"""Airspeed of the F-16's step tests, to which the sizes of the speed steps refer, m/s."""
TOLERANCE_SHARE, TOLERANCE = 0.05, (0.5, 0.3 * DEG_RAD, 0.3 * DEG_RAD)
"""Accepted errors of airspeed, path angle, course: fraction of the step, but at least the values in m/s, rad, rad."""


def trim_map(
    survey: Survey, altitudes_m: Sequence[float] | None, machs: Sequence[float] | None, *, coarse: bool
) -> TrimMap:
    """Return the trims of all steady flights in `CONDITIONS` over a grid of altitudes (m) and Mach numbers.

    If `altitudes_m` is None, the altitudes are `default_altitudes`; if `machs` is None, the Mach numbers are
    `default_machs` at the lowest altitude of the grid. Raises ValueError if an axis does not consist of finite,
    increasing numbers, if a Mach number is negative, if no default altitude is within the aircraft's data, or if no
    point of the grid is trimmable.
    """
    survey.report("trimming", 0.0)
    airframe, environment = survey.airframe, survey.environment
    altitudes = (
        default_altitudes(airframe, coarse=coarse) if altitudes_m is None else _grid_axis(altitudes_m, "altitudes_m")
    )
    lowest = float(altitudes[0])
    mach = (
        default_machs(airframe, environment, lowest, coarse=coarse)
        if machs is None
        else _grid_axis(machs, "machs", 0.0)
    )
    speed_of_sound = np.asarray(jax.vmap(lambda h: environment.atmosphere.at(h).speed_of_sound)(jnp.asarray(altitudes)))
    airspeeds = speed_of_sound[:, None] * mach[None, :]
    targets = _steady_targets(altitudes, airspeeds, float(environment.gravity))
    points = survey.call(map_points, (airframe, environment), (targets, None))
    if not np.any(points.trimmable):
        raise ValueError("no point of the grid can be flown steadily: there is nothing to survey")
    return TrimMap(altitudes, mach, airspeeds, targets, points, airframe.actuators.is_commanded)


def default_altitudes(airframe: AbstractAirframe, *, coarse: bool) -> np.ndarray:
    """Return the values of `ALTITUDES_M` (m) within the aircraft's data; every fifth of them if `coarse`.

    Raises ValueError if no such altitude is within the data.
    """
    if isinstance(airframe, AbstractF16):
        return ALTITUDES_M[5::5] if coarse else ALTITUDES_M
    low, high = getattr(getattr(airframe, "validity", None), "altitude", (-np.inf, np.inf))
    altitudes = ALTITUDES_M[(float(low) <= ALTITUDES_M) & (float(high) >= ALTITUDES_M)]
    if not altitudes.size:
        raise ValueError(f"altitudes_m: arrived None; expected altitudes within the data, {low:g} to {high:g} m")
    return altitudes[::5] if coarse else altitudes


def default_machs(
    airframe: AbstractAirframe, environment: Environment, altitude_m: float, *, coarse: bool
) -> np.ndarray:
    """Return the Mach numbers of a grid: `MACHS` for an F-16, otherwise the valid airspeeds at `altitude_m`.

    If `coarse`, the result has five Mach numbers.
    """
    machs = MACHS
    if not isinstance(airframe, AbstractF16):
        slowest, fastest = valid_airspeed_range(airframe)
        speed_of_sound = float(environment.atmosphere.at(altitude_m).speed_of_sound)
        # within the data in spite of rounding
        machs = np.linspace(slowest * (1 + 1e-9), fastest * (1 - 1e-9), len(MACHS)) / speed_of_sound
    return machs[_COARSE_MACHS] if coarse else machs


def speed_scale(airframe: AbstractAirframe, airspeeds: np.ndarray) -> np.ndarray:
    """Return factors on speed steps and accepted speed errors: airspeed / (150 m/s), or 1 for an F-16."""
    return np.ones_like(airspeeds) if isinstance(airframe, AbstractF16) else airspeeds / _F16_SPEED_M_S


def command_meanings(airframe: AbstractAirframe) -> list[str]:
    """Return the descriptions of `COMMANDS`; for any aircraft but an F-16, 10 m/s becomes 1/15 of the airspeed."""
    if isinstance(airframe, AbstractF16):
        return [command.meaning for command in COMMANDS]
    return [command.meaning.replace("10 m/s", "1/15 of the airspeed") for command in COMMANDS]


def accepted_errors(size: np.ndarray, scale: np.ndarray | float = 1.0) -> np.ndarray:
    """Return the accepted errors of airspeed (m/s), path angle and course (rad) for steps of `size`, shape (..., 3).

    The errors are 5 % of the step, but at least 0.5 m/s times `scale` (from `speed_scale`) and 0.3 deg.
    """
    tolerance = np.broadcast_to(TOLERANCE, np.shape(size)).copy()
    tolerance[..., 0] *= scale
    return np.maximum(TOLERANCE_SHARE * np.abs(size), tolerance)


def survey_limits(airframe: AbstractAirframe | None = None, airspeeds: ArrayLike = (0.0,)) -> FlightLimits:
    """Return the autopilot limits of the surveys, wide enough not to interfere with the commands.

    The greatest bank is 78 deg; the load factor is from -2 to 7.

    - F-16, or `airframe` None: airspeed 40 to 340 m/s, alpha -5 to 25 deg (of an F-16, within its data as well)
    - Another airframe: airspeed from half the least to twice the greatest of `airspeeds` (m/s), alpha within its data
    """
    limits = FlightLimits(
        speed_min=jnp.asarray(40.0),
        speed_max=jnp.asarray(340.0),
        # a level turn at 4 g has 75.5 deg; beyond 78.5 deg the autopilot commands too little lift for the path
        bank_max=jnp.asarray(78 * DEG_RAD),
        alpha_min=jnp.asarray(-5 * DEG_RAD),
        alpha_max=jnp.asarray(25 * DEG_RAD),
        load_factor_min=jnp.asarray(-2.0),
        load_factor_max=jnp.asarray(7.0),
        rates_max=jnp.asarray([120.0, 60.0, 60.0]) * DEG_RAD,
    )
    if airframe is None:
        return limits
    alpha_min, alpha_max = airframe.alpha_range
    if isinstance(airframe, AbstractF16):
        alpha_min, alpha_max = jnp.maximum(limits.alpha_min, alpha_min), jnp.minimum(limits.alpha_max, alpha_max)
        return dataclasses.replace(limits, alpha_min=alpha_min, alpha_max=alpha_max)
    speeds = np.asarray(airspeeds, dtype=float)
    slowest, fastest = jnp.asarray(0.5 * speeds.min()), jnp.asarray(2.0 * speeds.max())
    return dataclasses.replace(limits, speed_min=slowest, speed_max=fastest, alpha_min=alpha_min, alpha_max=alpha_max)


def _steady_targets(altitudes: np.ndarray, airspeeds: np.ndarray, gravity: float) -> TrimTarget:
    """Return the trim targets of `CONDITIONS` as one batch, Mach number varying fastest, then altitude; SI units."""
    climbs = np.array([condition.path_angle_deg * DEG_RAD for condition in CONDITIONS])[:, None, None]
    bank_tangents = np.sqrt([condition.turn_load_factor**2 - 1 for condition in CONDITIONS])[:, None, None]
    turn_rates = gravity * bank_tangents / airspeeds
    numbers = np.broadcast_arrays(airspeeds, altitudes[:, None], climbs, 0.0, turn_rates)
    return jax.vmap(trim_target)(*(jnp.asarray(values.ravel(), dtype=float) for values in numbers))


def _grid_axis(values: Sequence[float], name: str, minimum: float = -np.inf) -> np.ndarray:
    """Return `values` as an axis of the grid; raise ValueError if they do not increase from `minimum` or above."""
    axis = np.asarray(values, dtype=float)
    increases = axis.ndim == 1 and axis.size and np.isfinite(axis).all() and (np.diff(axis) > 0).all()
    if not increases or axis[0] < minimum:
        raise ValueError(f"{name}: arrived {values}; expected finite numbers in increasing order")
    return axis


@dataclasses.dataclass(frozen=True)
class EnvelopeSurvey(SurveyResult):
    """Result of `survey_envelope`: dataset with trims over (condition, altitude, mach) and flights from the trims.

    Variables of the flights also have the axis (command). Without a flight, their numbers are NaN and their codes 0.
    """

    def counts(self, *, with_reserve: bool = False) -> dict[str, dict[str, int]]:
        """Return the number of flights by "outcome: reason", then by condition (level, climb, ...).

        If `with_reserve` is True, only flights from trims with a reserve (`TrimMap.with_reserve`) count.
        """
        outcome, reason = self.dataset["outcome"].values, self.dataset["reason"].values
        if with_reserve:
            outcome = np.where(self.dataset["with_reserve"].values[..., None], outcome, 0)
        counts = {}
        for outcome_index, outcome_name in enumerate(OUTCOMES[1:], start=1):
            for reason_index, reason_name in enumerate(REASONS):
                number = ((outcome == outcome_index) & (reason == reason_index)).sum(axis=(1, 2, 3))
                if number.any():
                    name = outcome_name if reason_name == "none" else f"{outcome_name}: {reason_name}"
                    counts[name] = dict(zip(self.dataset["condition"].values.tolist(), number.tolist(), strict=True))
        return counts

    def shortfalls(self) -> list[str]:
        """Return a line for each failed flight that no limit explains.

        Only flights from trims with a reserve (`TrimMap.with_reserve`) count.
        """
        data = self.dataset
        unexplained = data["with_reserve"] & (data["reason"] == REASONS.index("unexplained"))
        lines = []
        for c, a, m, k in np.argwhere(unexplained.transpose("condition", "altitude", "mach", "command").values):
            flight = data.isel(condition=c, altitude=a, mach=m, command=k)
            lines.append(
                f"{flight.condition_meaning.item()}, {flight.altitude.item():.0f} m, Mach {flight.mach.item():.3f}, "
                f"{flight.command_meaning.item()}: no limit explains why it failed"
            )
        return lines


def survey_envelope(
    aircraft: str | AbstractAirframe = "f16",
    variant: str = "textbook",
    *,
    inversion: Inversion = "model",
    coarse: bool = False,
    altitudes_m: Sequence[float] | None = None,
    machs: Sequence[float] | None = None,
    limits: FlightLimits | None = None,
    duration_s: float = 30.0,
    step_s: float = 0.01,
    progress: Progress | None = None,
) -> EnvelopeSurvey:
    """Trim an aircraft over its flight envelope, and fly step commands of the path from every trim point.

    Level flight, climb, descent and turns (`anser.analysis.envelope.CONDITIONS`) are trimmed at each altitude and Mach
    number in the standard atmosphere and still air. From each trimmable point the autopilot flies steps of airspeed,
    path angle and course (`COMMANDS`). An F-16 has the published gains; another aircraft has gains derived at the
    point, and its speed steps are in proportion to the airspeed.

    Raises ValueError if the aircraft is unknown, an axis does not consist of increasing numbers, no point can be
    trimmed, or a flight has fewer than 100 samples.

    Parameters
    ----------
    aircraft, variant
        Name of an airframe, path of an aircraft file, or an airframe; variant of the F-16.
    inversion
        "model": dynamic inversion of the onboard model; "incremental": inversion from measured accelerations.
    coarse
        Coarse grid; for the F-16 3 x 5 instead of 16 x 18 points.
    altitudes_m, machs
        Axes of the grid; None: 250 m to 15 km and Mach 0.15 to 0.95 for the F-16; for another aircraft, see
        `default_altitudes` and `default_machs`.
    limits
        Limits of the autopilot; None: `survey_limits`.
    duration_s, step_s
        Duration of a flight; sampling period of the autopilot.
    progress
        Called with a description of the current work and the completed part, 0 to 1; None: no reports.
    """
    count = sample_count(duration_s, step_s)
    require_inversion(inversion)
    survey = Survey(aircraft, variant, progress)
    airframe = survey.airframe
    trims = trim_map(survey, altitudes_m, machs, coarse=coarse)
    limits = survey_limits(airframe, trims.airspeeds) if limits is None else limits
    is_flown = np.repeat(np.asarray(trims.points.trimmable)[:, None], len(COMMANDS), axis=1)
    point_index, command_index = np.nonzero(is_flown)
    trim, target = select_rows((trims.points.trim, trims.targets), point_index)
    gains, row_gains = survey_gains(airframe, survey.environment, trim, step_s, inversion)
    scale = speed_scale(airframe, np.asarray(target.speed))
    sizes = np.array([command.size for command in COMMANDS])[command_index]
    sizes[:, 0] *= scale
    flights = FlightRows(trim, target, jnp.asarray(sizes), jnp.asarray(accepted_errors(sizes, scale)), row_gains)
    variables = survey.fly(f"flying {len(point_index)} flights", flights, gains, limits, step_s, count)
    data = _map_variables(trims)
    for name, (values, labels, dimensions) in variables.items():
        data[name] = ((*GRID_DIMENSIONS, "command", *dimensions), trims.gridded(scatter_rows(values, is_flown)), labels)
    coordinates = {
        **trims.coordinates("Steady flight that is left"),
        "command": ("command", np.array([c.name for c in COMMANDS]), unit_attributes("", "Step of the path command")),
        "command_meaning": ("command", np.array(command_meanings(airframe))),
        **flight_coordinates(airframe.actuators.names),
    }
    attributes = {"inversion": inversion, **flight_attributes(count, step_s, limits)}
    return survey.result(EnvelopeSurvey, data, coordinates, attributes)


def _map_variables(trims: TrimMap) -> dict[str, Any]:
    points, trim = trims.points, trims.points.trim
    solved = np.asarray(trim.converged)
    stops, stop_labels = trim_stop(points, "What stops the steady flight, the first of several")
    data = {
        "trimmable": trims.variable(points.trimmable, "1", "Whether the steady flight can be flown"),
        "trim_stop": (GRID_DIMENSIONS, trims.gridded(stops), stop_labels),
        "with_reserve": trims.with_reserve(),
        "is_commanded": ("surface", np.array(trims.is_commanded), unit_attributes("1", "Whether it is commanded")),
    }
    for name, values, unit, long_name, *dimensions in (
        ("alpha_deg", trim.alpha, "degree", "Angle of attack"),
        ("bank_deg", trim.mu, "degree", "Bank about the velocity vector"),
        ("power_percent", trim.power, "percent", "Engine power"),
        ("load_factor", points.load_factor, "1", "Normal load factor"),
        ("surface_deg", trim.state.surfaces, "degree", "Deflection", "surface"),
        ("power_left", points.power_margin, "1", "Power left up to the full, part of it"),
        ("power_spare", points.power_above_idle, "1", "Power that can be taken back, part of the full"),
        ("surface_left", points.surface_margin, "1", "Way left to the stop, part of that from the middle", "surface"),
    ):
        solved_values = scatter_rows(np.asarray(values)[solved], solved)
        factor = RAD_DEG if unit == "degree" else 1.0
        data[name] = trims.variable(solved_values * factor, unit, long_name, *dimensions)
    return data
