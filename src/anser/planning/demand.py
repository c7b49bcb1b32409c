"""Motion of an aircraft in coordinated flight: required airspeed, bank angle, and forces per mass.

Coordinated means that there is no side force in body axes. The functions evaluate single points of a path;
`anser.planning.certified.path_bounds` bounds the same quantities between the knots.
"""

import equinox as eqx
import jax.numpy as jnp

from anser.planning.limits import PathLimits
from anser.shapes import Scalar, ScalarLike, Vector3

_LOAD_FACTOR_UNLIMITED = 1e3  # replaces an infinite limit
_FORCE_MIN = 0.1  # m/s^2: keeps turn radii finite if the limits allow no turn
_SPEED_MIN = 1e-6  # m/s: keeps results finite in vertical flight


class Demand(eqx.Module):
    """Airspeed of a motion, and required specific force: (forces of wings and engine minus drag) / mass, m/s^2."""

    speed: Scalar  #: Airspeed, m/s.
    side: Scalar  #: Horizontal component of the force normal to the velocity, right positive, m/s^2.
    lift: Scalar  #: Component of the force normal to the velocity and to `side`, up positive, m/s^2.
    along: Scalar  #: Component of the force along the velocity, V_dot + g sin(gamma), m/s^2.

    @property
    def bank(self) -> Scalar:
        """Bank angle about the velocity, rad, right positive."""
        return jnp.arctan2(self.side, self.lift)

    @property
    def normal(self) -> Scalar:
        """Specific force normal to the velocity, m/s^2: load factor times gravity."""
        return jnp.sqrt(self.side**2 + self.lift**2)

    @property
    def smooth_normal(self) -> Scalar:
        """Smooth upper bound of `normal`, m/s^2, differentiable where the force is 0."""
        return jnp.sqrt(self.side**2 + self.lift**2 + 1e-6)

    def excess(
        self,
        bank: ScalarLike,
        normal: ScalarLike,
        lift_min: ScalarLike,
        acceleration: ScalarLike,
        deceleration: ScalarLike,
    ) -> tuple[Scalar, Scalar, Scalar]:
        """Return the excess of the required forces over three limits, m/s^2; negative within a limit.

        The argument `bank` is the tangent of the greatest bank angle; the other arguments are limits in m/s^2.

        1. Bank angle: abs(side) - lift * bank.
        2. Force normal to the velocity: the larger of smooth_normal - normal (the argument) and lift_min - lift.
        3. Force along the velocity: the larger of along - acceleration and -along - deceleration.
        """
        return (
            jnp.abs(self.side) - self.lift * bank,
            jnp.maximum(self.smooth_normal - normal, lift_min - self.lift),
            jnp.maximum(self.along - acceleration, -self.along - deceleration),
        )


def coordinated_demand(
    # horizontal airspeed, and vertical airspeed, up positive, m/s
    level: Scalar,
    climb: Scalar,
    # horizontal acceleration across the course, right positive, and along the course, m/s^2
    side: Scalar,
    forward: Scalar,
    up: Scalar,  # vertical acceleration plus gravity, m/s^2
) -> Demand:
    """Compute airspeed and specific force (`Demand`) of a motion from components along and across the course."""
    speed = jnp.sqrt(level**2 + climb**2)
    return Demand(speed, side, (level * up - climb * forward) / speed, (level * forward + climb * up) / speed)


def demand(
    air_velocity_n: Vector3, acceleration_n: Vector3, gravity: ScalarLike, level_min: float = _SPEED_MIN
) -> Demand:
    """Compute airspeed and specific force (`Demand`) from the velocity relative to the air and the acceleration, NED.

    The acceleration is over the ground, m/s^2. The horizontal airspeed is replaced by sqrt(horizontal^2 + level_min^2),
    so that vertical flight has finite derivatives. All speeds in m/s.
    """
    north, east, down = air_velocity_n
    level = jnp.sqrt(north**2 + east**2 + level_min**2)
    side = (north * acceleration_n[1] - east * acceleration_n[0]) / level
    forward = (north * acceleration_n[0] + east * acceleration_n[1]) / level
    return coordinated_demand(level, -down, side, forward, gravity - acceleration_n[2])


def normal_force_max(limits: PathLimits, gravity: ScalarLike) -> Scalar:
    """Return the greatest specific force normal to the velocity, m/s^2: the load factor limit times gravity."""
    return jnp.minimum(limits.load_factor_max, _LOAD_FACTOR_UNLIMITED) * gravity


def side_force_max(lift_min: ScalarLike, lift_max: ScalarLike, limits: PathLimits, gravity: ScalarLike) -> Scalar:
    """Return the greatest horizontal force across the velocity (`Demand.side`), m/s^2, for turns within the limits.

    Bank angle and load factor are within their limits for every `Demand.lift` from `lift_min` to `lift_max`, m/s^2. If
    the limits allow no turn, the result is a small positive number.
    """
    by_bank = jnp.maximum(lift_min, _FORCE_MIN) * jnp.tan(limits.bank_max)
    side_square = normal_force_max(limits, gravity) ** 2 - lift_max**2
    return jnp.minimum(by_bank, jnp.sqrt(jnp.maximum(side_square, _FORCE_MIN**2)))


def turn_radius(speed: ScalarLike, bank: ScalarLike, gravity: ScalarLike) -> Scalar:
    """Return the radius, m, of a level turn at an airspeed (m/s) and a bank angle (rad); gravity in m/s^2."""
    return speed**2 / (gravity * jnp.tan(bank))
