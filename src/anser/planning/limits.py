"""The catalogue of limits of a path, the one source of checks, refusals, tables and labels.

Their values; and the short description of a planned path.
"""

from collections.abc import Callable
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from anser.numerics.arrays import as_array
from anser.parts.planners import IdleDeceleration
from anser.shapes import Scalar, ScalarLike
from anser.variables import UNITS

_TILTED = 1.57  # rad: more bank than this has no tangent
_LOOSENED_M = 1000.0  # by which an altitude moves where other limits double


class PathLimits(eqx.Module):
    """What a trajectory may ask of an aircraft."""

    speed_min: Scalar
    """Airspeed, m/s."""
    speed_max: Scalar
    """Airspeed, m/s."""
    bank_max: Scalar
    """Bank angle of a sustained turn, rad, below pi/2."""
    climb_rate_max: Scalar
    """Vertical speed relative to the air, up or down, m/s."""
    altitude_min: Scalar
    """m."""
    altitude_max: Scalar = eqx.field(default_factory=lambda: as_array(np.inf))
    """m."""
    load_factor_max: Scalar = eqx.field(default_factory=lambda: as_array(np.inf))
    """1."""
    acceleration_max: Scalar = eqx.field(default_factory=lambda: as_array(np.inf))
    """Of V_dot + g sin(gamma), what the engine gives beyond drag, m/s^2; where `idle` is given, up to load factor 1."""
    deceleration_max: Scalar = eqx.field(default_factory=lambda: as_array(np.inf))
    """The same with the engine idle, positive, m/s^2; where `idle` is given, level at the airspeed of the start."""
    idle: IdleDeceleration | None = None
    """How the drag changes with airspeed and load factor, as a share of `deceleration_max`; None: not at all."""
    bank_rate_max: Scalar | None = None
    """Of the bank angle, either way, rad/s; what a planner makes keeps to it, no certificate bounds it. None: any."""

    def along(self, speed: ScalarLike, load_factor: ScalarLike) -> tuple[Scalar, Scalar]:
        """The acceleration and the deceleration that there are at an airspeed (m/s) and a load factor, m/s^2."""
        if self.idle is None:
            return self.acceleration_max, self.deceleration_max
        rise, share = self.idle.rise(speed, load_factor), self.idle.share(speed, load_factor)
        return self.acceleration_max - self.deceleration_max * rise, self.deceleration_max * share


def acceleration_limits(limits: PathLimits) -> tuple[Scalar, Scalar]:
    """Both accelerations along the path, of which `eqx.tree_at` makes others."""
    return limits.acceleration_max, limits.deceleration_max


def _size(values: np.ndarray, axis: int) -> np.ndarray:
    return np.max(np.abs(values), axis)


def _loss(values: np.ndarray, axis: int) -> np.ndarray:
    return np.max(-values, axis)


@dataclass(frozen=True)
class Limit:
    """One limit of a path.

    Attributes
    ----------
    key
        Name of the extreme that it bounds: "airspeed_min".
    field
        Name of its value in `PathLimits`: "speed_min".
    suffix
        Unit of a name in a dataset and in a scenario: "m_s"; empty for a pure number.
    variable
        What it bounds, by key in `anser.variables`.
    extreme
        Which extreme of that along an axis.
    words
        What it is.
    heading
        The same above a column, two short words; empty where `words` are.
    broken
        What a trajectory of the published planner does that breaks it; empty where none is held to it.
    proven
        Whether the certified planner proves it.
    """

    key: str
    field: str
    suffix: str
    variable: str
    extreme: Callable[[np.ndarray, int], np.ndarray]
    description: str
    heading: str = ""
    violation: str = ""
    is_certified: bool = True

    @property
    def name(self) -> str:
        """Name of the extreme with its unit."""
        return f"{self.key}_{self.suffix}" if self.suffix else self.key

    @property
    def scenario_key(self) -> str:
        """Key of its value in the table `limits` of a scenario."""
        return f"{self.field}_{self.suffix}" if self.suffix else self.field

    @property
    def unit(self) -> str:
        """Unit in a dataset, as CF writes it."""
        return UNITS[self.suffix][0]

    @property
    def factor(self) -> float:
        """Dataset value divided by the value in SI units or radians."""
        return UNITS[self.suffix][1]

    @property
    def is_lower_bound(self) -> bool:
        """Whether it bounds from below."""
        return self.extreme is np.min

    def excess(self, value: Scalar, limit: Scalar) -> Scalar:
        """By how much an extreme passes it, as a part of it (of its tangent); not positive where it is kept.

        Parameters
        ----------
        value
            The extreme.
        limit
            Infinite where none is asked.
        """
        if self.suffix == "deg":
            value, limit = jnp.tan(jnp.minimum(value, _TILTED)), jnp.tan(limit)
        if self.is_lower_bound:
            value, limit = -value, -limit
        none = limit == jnp.inf  # one that is not a number is no such limit, and is not kept
        finite = jnp.where(none, 0.0, limit)
        return jnp.where(none, -1.0, (value - finite) / jnp.maximum(jnp.abs(finite), 1.0))

    def relaxed(self, limit: Scalar, factor: ScalarLike) -> Scalar:
        """Its value loosened by a factor; 1 is as it is."""
        if self.suffix == "m":
            more = _LOOSENED_M * (factor - 1.0)
            return limit - more if self.is_lower_bound else limit + more
        if self.suffix == "deg":
            return jnp.arctan(jnp.tan(limit) * factor)
        return limit / factor if self.is_lower_bound else limit * factor


LIMITS = (
    Limit(
        *("airspeed_min", "speed_min", "m_s", "airspeed", np.min, "least airspeed"),
        violation="asks for less than the least airspeed",
    ),
    Limit(
        *("airspeed_max", "speed_max", "m_s", "airspeed", np.max, "greatest airspeed"),
        violation="asks for more than the greatest airspeed",
    ),
    Limit(
        *("bank_max", "bank_max", "deg", "bank", _size, "bank angle"),
        violation="turns faster than the greatest bank angle allows at its airspeed",
    ),
    Limit("load_factor_max", "load_factor_max", "", "load_factor", np.max, "load factor"),
    Limit(
        *("climb_rate_max", "climb_rate_max", "m_s", "climb_rate", _size, "rate of climb or descent"),
        heading="climb rate",
        violation="climbs or descends faster than the limit",
    ),
    Limit(
        *("altitude_min", "altitude_min", "m", "altitude", np.min, "least altitude"),
        violation="goes below the least altitude",
    ),
    Limit("altitude_max", "altitude_max", "m", "altitude", np.max, "greatest altitude"),
    Limit(
        *("level_off_min", "altitude_min", "m", "altitude", np.min),
        "least altitude of the level-off after the arrival",
        heading="level-off altitude",
        violation="arrives in a descent that the hold cannot level off above the least altitude",
        is_certified=False,
    ),
    Limit(
        *("thrust_surplus_max", "acceleration_max", "m_s2", "thrust_surplus", np.max, "acceleration"),
        heading="acceler- ation",
    ),
    Limit(
        *("thrust_deficit_max", "deceleration_max", "m_s2", "thrust_surplus", _loss, "deceleration"),
        heading="deceler- ation",
    ),
)
"""Every limit, in the order in which it is shown."""

CERTIFIED_LIMITS = tuple(limit for limit in LIMITS if limit.is_certified)
"""Those that the certified planner proves, in the order of `anser.planning.certified.path_bounds.excess`."""

LIMIT_MESSAGES = (
    "within all limits",
    *(f"the trajectory {limit.violation} (limits.{limit.scenario_key})" for limit in LIMITS if limit.violation),
)
"""What `check_limits` finds of a trajectory of the published planner."""

RELAXED_TOGETHER = {
    words: tuple(limit for limit in CERTIFIED_LIMITS if limit.field in fields)
    for words, fields in (
        ("speed window", ("speed_min", "speed_max")),
        ("rate of climb or descent", ("climb_rate_max",)),
        ("acceleration along the path", ("acceleration_max", "deceleration_max")),
        ("bank angle", ("bank_max", "load_factor_max")),
        ("floor and ceiling", ("altitude_min", "altitude_max")),
    )
}
"""What can stand in the way of a plan, in words, and the limits that are loosened to find out."""


NOMINAL_BEND_M = 1.0
"""Up to this lateral bend, m, a path of the published planner is nominal.

A bend of 1 m lengthens a path of 1 km by a few millimetres; solving for a length of 10 km to 1e-6 m leaves a bend of
that size even where none is needed.
"""


def describe_bend(bend_m: float) -> str:
    """A path of the published planner by its lateral bend, m, positive to the right."""
    if abs(bend_m) <= NOMINAL_BEND_M:
        return "nominal"
    return "bent right" if bend_m > 0.0 else "bent left"


def describe_turns(turned_deg: float) -> str:
    """A path of the certified planner, which has no such bend, by the sum of the sizes of its turns, deg."""
    return f"turns {turned_deg:.0f} deg"
