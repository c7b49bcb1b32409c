"""Trim maps: steady flights over altitude and Mach number.

Also the step commands and autopilot limits of the surveys, whose flights start at points of a trim map.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.f16 import AbstractF16
from anser.analysis.airframes import valid_airspeed_range
from anser.analysis.surveys import Survey
from anser.analysis.trim_points import map_points
from anser.control.limits import FlightLimits
from anser.environment.environment import Environment
from anser.results.variable_labels import unit_attributes
from anser.steady.trim import TrimMapPoint, TrimTarget
from anser.units import DEG_RAD

RESERVE_MIN = 0.1
"""Least reserve of a point "with reserve": fraction of the power, up and down, and of each surface's travel."""

GRID_DIMENSIONS = ("condition", "altitude", "mach")
"""Dimensions of the grid."""


class TrimMap(NamedTuple):
    """Steady flights over a grid of condition (kind of steady flight), altitude and Mach number.

    Attributes
    ----------
    conditions
        Meanings of the kinds of steady flight by name.
    altitudes, machs
        Axes of the grid: altitude in m, and Mach number.
    airspeeds
        True airspeed, m/s, shape (altitude, mach).
    targets, points
        Trim targets and trim points; leaves of shape (conditions x altitudes x machs, ...), Mach number fastest.
    surfaces
        Names of the airframe's control surfaces.
    """

    conditions: Mapping[str, str]
    altitudes: np.ndarray
    machs: np.ndarray
    airspeeds: np.ndarray
    targets: TrimTarget
    points: TrimMapPoint
    surfaces: tuple[str, ...]

    def gridded(self, values: Any) -> np.ndarray:
        """Reshape values of the trim points, shape (points, ...), to shape (condition, altitude, mach, ...)."""
        array = np.asarray(values)
        return array.reshape(len(self.conditions), *self.airspeeds.shape, *array.shape[1:])

    def variable(self, values: Any, unit: str, long_name: str, *dimensions: str) -> Any:
        """Return a dataset variable as (dimension names, values, attributes).

        The values of the trim points are reshaped to the grid; `dimensions` names the further axes.
        """
        return (*GRID_DIMENSIONS, *dimensions), self.gridded(values), unit_attributes(unit, long_name)

    def with_reserve(self) -> Any:
        """Return the dataset variable that is true at points with at least `RESERVE_MIN` in reserve."""
        points = self.points
        power_reserve = np.minimum(np.asarray(points.power_margin), np.asarray(points.power_above_idle))
        reserve = np.minimum(power_reserve, np.asarray(points.surface_margin).min(axis=1))
        long_name = "Whether a tenth of power and surfaces is left"
        return self.variable(np.asarray(points.trimmable) & (reserve >= RESERVE_MIN), "1", long_name)

    def coordinates(self, condition: str) -> dict[str, Any]:
        """Return the dataset coordinates of the grid; `condition` is the long name of the axis of steady flights."""
        return {
            "condition": ("condition", np.array(list(self.conditions)), unit_attributes("", condition)),
            "condition_meaning": ("condition", np.array(list(self.conditions.values()))),
            "altitude": (
                "altitude",
                np.asarray(self.altitudes, dtype=float),
                unit_attributes("m", "Geometric altitude"),
            ),
            "mach": ("mach", np.asarray(self.machs, dtype=float), unit_attributes("1", "Mach number")),
            "airspeed_m_s": (("altitude", "mach"), self.airspeeds, unit_attributes("m s-1", "True airspeed")),
        }


@dataclasses.dataclass(frozen=True)
class SteadyFlight:
    """Kind of steady flight: climb angle (deg), and load factor of a coordinated level turn to the right."""

    name: str
    meaning: str
    path_angle_deg: float = 0.0
    turn_load_factor: float = 1.0


@dataclasses.dataclass(frozen=True)
class StepCommand:
    """Step of the commanded path: airspeed (m/s), path angle (deg) and course (deg)."""

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
"""Default altitudes. The lowest is above 0, the bound of the data: from 0 any command would leave the data."""
MACHS = np.linspace(0.15, 0.95, 18)
_COARSE_MACHS = [0, 4, 8, 13, 17]
_F16_SPEED_M_S = 150.0
"""Airspeed of the F-16's step tests, for which the speed steps are chosen."""
TOLERANCE_SHARE, TOLERANCE = 0.05, (0.5, 0.3 * DEG_RAD, 0.3 * DEG_RAD)
"""Accepted error: the greater of a part of the step and an absolute error, m/s and rad."""


def trim_map(
    survey: Survey,
    airframe: AbstractAirframe,
    environment: Environment,
    altitudes_m: Sequence[float] | None,
    machs: Sequence[float] | None,
    *,
    coarse: bool,
) -> TrimMap:
    """Trim `CONDITIONS` over a grid with the given axes, or with the default axes, thinned if `coarse`.

    Raises
    ------
    ValueError
        An axis is not of increasing numbers, or the grid has no trimmable point.
    """
    survey.start("trimming")
    default_altitudes, default_machs = default_axes(airframe, environment, coarse=coarse)
    altitudes = grid_axis("altitudes_m", altitudes_m, default_altitudes)
    mach = grid_axis("machs", machs, default_machs)
    speed_of_sound = np.asarray(jax.vmap(lambda h: environment.atmosphere.at(h).speed_of_sound)(jnp.asarray(altitudes)))
    airspeeds = speed_of_sound[:, None] * mach[None, :]
    targets = steady_targets(altitudes, airspeeds, float(environment.gravity))
    points = survey.call(map_points, airframe, environment, targets)
    if not np.any(points.trimmable):
        raise ValueError("no point of the grid can be flown steadily: there is nothing to survey")
    conditions = {condition.name: condition.meaning for condition in CONDITIONS}
    return TrimMap(conditions, altitudes, mach, airspeeds, targets, points, airframe.actuators.names)


def default_axes(
    airframe: AbstractAirframe, environment: Environment, *, coarse: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return the default altitudes (m) and Mach numbers of an aircraft's grid.

    The altitudes are those of `ALTITUDES_M` within the aircraft's data. The Mach numbers are those of `MACHS` for an
    F-16; otherwise they follow from the airspeeds of the aircraft's data, at the lowest altitude.
    """
    if isinstance(airframe, AbstractF16):
        return ALTITUDES_M[5::5] if coarse else ALTITUDES_M, MACHS[_COARSE_MACHS] if coarse else MACHS
    low, high = getattr(getattr(airframe, "validity", None), "altitude", (-np.inf, np.inf))
    altitudes = ALTITUDES_M[(float(low) <= ALTITUDES_M) & (float(high) >= ALTITUDES_M)]
    if not altitudes.size:
        raise ValueError(f"altitudes_m: arrived None; expected altitudes within the data, {low:g} to {high:g} m")
    slowest, fastest = valid_airspeed_range(airframe)
    speed_of_sound = float(environment.atmosphere.at(float(altitudes[0])).speed_of_sound)
    # within the data in spite of rounding
    machs = np.linspace(slowest * (1 + 1e-9), fastest * (1 - 1e-9), len(MACHS)) / speed_of_sound
    return altitudes[::5] if coarse else altitudes, machs[_COARSE_MACHS] if coarse else machs


def speed_scale(airframe: AbstractAirframe, airspeeds: np.ndarray) -> np.ndarray:
    """Return the factors on speed steps and on accepted speed errors at the given airspeeds (m/s); 1 for an F-16."""
    return np.ones_like(airspeeds) if isinstance(airframe, AbstractF16) else airspeeds / _F16_SPEED_M_S


def command_meanings(airframe: AbstractAirframe) -> list[str]:
    """Return the descriptions of `COMMANDS` for an aircraft, with its speed steps (`speed_scale`)."""
    if isinstance(airframe, AbstractF16):
        return [command.meaning for command in COMMANDS]
    return [command.meaning.replace("10 m/s", "1/15 of the airspeed") for command in COMMANDS]


def accepted_errors(size: np.ndarray, scale: np.ndarray | float = 1.0) -> np.ndarray:
    """Return the accepted errors of airspeed (m/s), path angle and course (rad) for steps of a given size, (..., 3).

    `scale` is the factor of the speed steps, see `speed_scale`.
    """
    tolerance = np.broadcast_to(TOLERANCE, np.shape(size)).copy()
    tolerance[..., 0] *= scale
    return np.maximum(TOLERANCE_SHARE * np.abs(size), tolerance)


def survey_limits(airframe: AbstractAirframe | None = None, airspeeds: ArrayLike = (0.0,)) -> FlightLimits:
    """Return the autopilot limits of a survey, wider than the aircraft's.

    For the F-16: 40 to 340 m/s, 78 deg of bank, alpha -5 to 25 deg, -2 to 7 g. A level turn at 4 g has a bank of
    75.5 deg; beyond 78.5 deg the autopilot commands too little lift for the path. For another airframe: half the least
    to twice the greatest of the surveyed airspeeds (m/s), and the range of alpha of the airframe's data.
    """
    limits = _f16_limits()
    if airframe is None or isinstance(airframe, AbstractF16):
        return limits
    speeds = np.asarray(airspeeds, dtype=float)
    slowest, fastest = jnp.asarray(0.5 * speeds.min()), jnp.asarray(2.0 * speeds.max())
    return eqx.tree_at(
        lambda bounds: (bounds.speed_min, bounds.speed_max, bounds.alpha_min, bounds.alpha_max),
        limits,
        (slowest, fastest, *airframe.alpha_range),
    )


def _f16_limits() -> FlightLimits:
    return FlightLimits(
        speed_min=jnp.asarray(40.0),
        speed_max=jnp.asarray(340.0),
        bank_max=jnp.asarray(78 * DEG_RAD),
        alpha_min=jnp.asarray(-5 * DEG_RAD),
        alpha_max=jnp.asarray(25 * DEG_RAD),
        load_factor_min=jnp.asarray(-2.0),
        load_factor_max=jnp.asarray(7.0),
        rates_max=jnp.asarray([120.0, 60.0, 60.0]) * DEG_RAD,
    )


def steady_targets(altitudes: np.ndarray, airspeeds: np.ndarray, gravity: float) -> TrimTarget:
    """Return the trim targets of `CONDITIONS` at the given altitudes (m) and airspeeds (m/s).

    Flattened over (condition, altitude, mach); gravity in m/s^2.
    """
    shape = (len(CONDITIONS), *airspeeds.shape)
    V, h = np.broadcast_to(airspeeds, shape), np.broadcast_to(altitudes[:, None], shape)
    gamma = np.array([condition.path_angle_deg * DEG_RAD for condition in CONDITIONS])[:, None, None]
    bank_tangent = np.sqrt([condition.turn_load_factor**2 - 1 for condition in CONDITIONS])[:, None, None]
    fields = (V, h, np.broadcast_to(gamma, shape), np.zeros(shape), gravity * bank_tangent / V, np.zeros(shape))
    return TrimTarget(*(jnp.asarray(field.ravel(), dtype=float) for field in fields))


def grid_axis(name: str, requested: Sequence[float] | None, default: np.ndarray) -> np.ndarray:
    """Return the requested values of a grid axis, or the default values.

    Raises ValueError unless the numbers increase.
    """
    axis = default if requested is None else np.asarray(requested, dtype=float)
    minimum = 0.0 if name == "machs" else -np.inf
    if (
        axis.ndim != 1
        or not axis.size
        or not np.isfinite(axis).all()
        or (np.diff(axis) <= 0).any()
        or axis[0] < minimum
    ):
        raise ValueError(f"{name}: arrived {requested}; expected finite numbers in increasing order")
    return axis
