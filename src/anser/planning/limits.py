"""Flight limits of a path, a catalogue of these limits for checks, refusals and tables, and labels of paths."""

from collections.abc import Callable
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from anser.numerics.arrays import as_array
from anser.parts.planners import IdleDeceleration
from anser.shapes import Scalar, ScalarLike
from anser.variables import UNITS

_BANK_LIMIT_RAD = 1.57  # just below pi/2: keeps the tangent finite
_ALTITUDE_RELAXATION_M = 1000.0  # change of an altitude limit where other limits double


class PathLimits(eqx.Module):
    """Flight limits of a planned path of one aircraft (stacked: of a fleet), SI units and rad.

    Infinite or None means that there is no limit.
    """

    speed_min: Scalar  #: Least airspeed, m/s.
    speed_max: Scalar  #: Greatest airspeed, m/s.
    bank_max: Scalar  #: Greatest bank angle of a sustained turn, rad, below pi/2.
    climb_rate_max: Scalar  #: Greatest vertical speed relative to the air, up or down, m/s.
    altitude_min: Scalar  #: Least altitude, m.
    altitude_max: Scalar = eqx.field(default_factory=lambda: as_array(np.inf))  #: Greatest altitude, m.
    #: Greatest load factor, 1 in level flight.
    load_factor_max: Scalar = eqx.field(default_factory=lambda: as_array(np.inf))
    #: Greatest V_dot + g sin(gamma) = (engine force - drag) / mass, m/s^2; with `idle`: value up to load factor 1.
    acceleration_max: Scalar = eqx.field(default_factory=lambda: as_array(np.inf))
    #: Greatest -(V_dot + g sin(gamma)), engine idle, m/s^2; with `idle`: value in level flight at the start airspeed.
    deceleration_max: Scalar = eqx.field(default_factory=lambda: as_array(np.inf))
    #: Change of the deceleration with idle engine over airspeed and load factor; None: the deceleration is constant.
    idle: IdleDeceleration | None = None
    #: Greatest bank rate, rad/s: the planner keeps this limit, but the certificate does not prove it. None: no limit.
    bank_rate_max: Scalar | None = None
    #: Least load factor in a push-over: `Demand.lift` / gravity.
    load_factor_min: Scalar = eqx.field(default_factory=lambda: as_array(-np.inf))

    def along(self, speed: ScalarLike, load_factor: ScalarLike) -> tuple[Scalar, Scalar]:
        """Return the greatest acceleration and deceleration, m/s^2, at an airspeed (m/s) and a load factor.

        Both are limits of V_dot + g sin(gamma); the deceleration is positive.
        """
        if self.idle is None:
            return self.acceleration_max, self.deceleration_max
        rise, share = self.idle.rise(speed, load_factor), self.idle.share(speed, load_factor)
        return self.acceleration_max - self.deceleration_max * rise, self.deceleration_max * share


def acceleration_limits(limits: PathLimits) -> tuple[Scalar, Scalar]:
    """Return `acceleration_max` and `deceleration_max`, m/s^2: the selection of leaves for `eqx.tree_at`."""
    return limits.acceleration_max, limits.deceleration_max


def reduced_limit(limit: ScalarLike, share: ScalarLike) -> Scalar:
    """Return an upper limit lowered by (1 - `share`) of its magnitude; `share` is in 0..1."""
    return limit * jnp.where(jnp.asarray(limit) < 0.0, 2.0 - share, share)


def with_gentle_acceleration(limits: PathLimits, greatest: float) -> PathLimits:
    """Return the limits with `acceleration_max` lowered to at most `greatest`, m/s^2; not traceable by JAX."""
    limited = np.minimum(np.asarray(limits.acceleration_max), greatest)
    return eqx.tree_at(lambda fields: fields.acceleration_max, limits, as_array(limited))


def _largest_magnitude(values: np.ndarray, axis: int) -> np.ndarray:
    return np.max(np.abs(values), axis)


def _largest_decrease(values: np.ndarray, axis: int) -> np.ndarray:
    return np.max(-values, axis)


@dataclass(frozen=True)
class Limit:
    """Catalogue entry of a path limit, which bounds the least or greatest value (extreme) of a quantity on a path."""

    key: str  # name of the extreme, such as "airspeed_min"
    field: str  # field of `PathLimits` with the value of the limit
    suffix: str  # unit in names of the extreme and of the limit, such as "m_s"
    variable: str  # key of the quantity in `anser.variables`
    extreme: Callable[[np.ndarray, int], np.ndarray]  # function from (values, axis) to the extreme along the axis
    description: str  # description of the extreme in tables and labels
    heading: str = ""  # short column heading; empty: the description
    violation: str = ""  # predicate of "the trajectory ..."; empty: the published planner does not check the limit
    is_certified: bool = True  # whether the certified planner proves the limit

    @property
    def name(self) -> str:
        """Name of the extreme with its unit, as in datasets."""
        return f"{self.key}_{self.suffix}" if self.suffix else self.key

    @property
    def scenario_key(self) -> str:
        """Key of the limit in a scenario's table `limits`."""
        return f"{self.field}_{self.suffix}" if self.suffix else self.field

    @property
    def unit(self) -> str:
        """Unit in a dataset, in CF notation."""
        return UNITS[self.suffix][0]

    @property
    def factor(self) -> float:
        """Factor that converts the value from SI units or radians to the unit in a dataset."""
        return UNITS[self.suffix][1]

    @property
    def is_lower_bound(self) -> bool:
        """Whether the limit is a lower bound."""
        return self.extreme is np.min

    def excess(
        self,
        value: Scalar,  # the extreme
        limit: Scalar,  # the limit; infinite: no limit
    ) -> Scalar:
        """Return the relative excess over the limit: (value - limit) / max(|limit|, 1); at most 0 within the limit.

        For a lower limit, the numerator is limit - value. For a bank angle (rad), tangents replace the angles. The
        excess over an infinite limit is -1. If the limit is NaN, or the value is NaN and the limit finite, the excess
        is NaN.
        """
        if self.suffix == "deg":
            value, limit = jnp.tan(jnp.minimum(value, _BANK_LIMIT_RAD)), jnp.tan(limit)
        if self.is_lower_bound:
            value, limit = -value, -limit
        is_unlimited = limit == jnp.inf  # NaN is not unlimited, and never satisfied
        finite = jnp.where(is_unlimited, 0.0, limit)
        return jnp.where(is_unlimited, -1.0, (value - finite) / jnp.maximum(jnp.abs(finite), 1.0))

    def relaxed(self, limit: Scalar, factor: ScalarLike) -> Scalar:
        """Return the limit (SI units, rad) relaxed by a factor; the factor 1 leaves the limit unchanged.

        An altitude limit moves by 1000 m x (factor - 1). For a bank angle, the tangent is multiplied by the factor.
        Other upper limits are multiplied by the factor; other lower limits are divided by the factor.
        """
        if self.suffix == "m":
            change = _ALTITUDE_RELAXATION_M * (factor - 1.0)
            return limit - change if self.is_lower_bound else limit + change
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
        *("bank_max", "bank_max", "deg", "bank", _largest_magnitude, "bank angle"),
        violation="turns faster than the greatest bank angle allows at its airspeed",
    ),
    Limit("load_factor_max", "load_factor_max", "", "load_factor", np.max, "load factor"),
    Limit(
        *("load_factor_min", "load_factor_min", "", "vertical_load_factor", np.min, "load factor of a push-over"),
        heading="least load factor",
    ),
    Limit(
        *("climb_rate_max", "climb_rate_max", "m_s", "climb_rate", _largest_magnitude, "rate of climb or descent"),
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
        *("thrust_deficit_max", "deceleration_max", "m_s2", "thrust_surplus", _largest_decrease, "deceleration"),
        heading="deceler- ation",
    ),
)
"""Catalogue of limits, in display order."""

CERTIFIED_LIMITS = tuple(limit for limit in LIMITS if limit.is_certified)
"""Limits proven by the certified planner, in the order of `anser.planning.certified.path_bounds.excess`."""

LIMIT_MESSAGES = (
    "within all limits",
    *(f"the trajectory {limit.violation} (limits.{limit.scenario_key})" for limit in LIMITS if limit.violation),
)
"""Messages of `anser.planning.published.planner.check_limits`: no violation, then one message per checked limit."""

RELAXED_TOGETHER = {
    cause: tuple(limit for limit in CERTIFIED_LIMITS if limit.field in fields)
    for cause, fields in (
        ("speed window", ("speed_min", "speed_max")),
        ("rate of climb or descent", ("climb_rate_max",)),
        ("acceleration along the path", ("acceleration_max", "deceleration_max")),
        ("bank angle", ("bank_max", "load_factor_max", "load_factor_min")),
        ("floor and ceiling", ("altitude_min", "altitude_max")),
    )
}
"""Limits that are relaxed together to test a possible cause of a missing plan, by the name of the cause."""


NOMINAL_BEND_M = 1.0
"""Greatest lateral bend, m, of a path of the published planner that is called nominal.

The tolerance of the length, 1e-6 m in 10 km, leaves a bend of this size even for a path that needs no bend."""


def describe_bend(bend_m: float) -> str:
    """Return "nominal", "bent right" or "bent left" for the lateral bend of a published path, m, right positive."""
    if abs(bend_m) <= NOMINAL_BEND_M:
        return "nominal"
    return "bent right" if bend_m > 0.0 else "bent left"


def describe_turns(turn_sum_deg: float) -> str:
    """Return the label of a path of the certified planner from its sum of turn angles, deg, such as "turns 83 deg"."""
    return f"turns {turn_sum_deg:.0f} deg"
