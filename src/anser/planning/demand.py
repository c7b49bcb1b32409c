"""Demand of a motion on the aircraft in coordinated flight, without side force in body axes.

The certificate bounds the same quantities between the knots, as ratios of polynomials: see
`anser.planning.certified.path_bounds`.
"""

import equinox as eqx
import jax.numpy as jnp

from anser.planning.limits import PathLimits
from anser.shapes import Scalar, ScalarLike, Vector3

_LOAD_FACTOR_UNLIMITED = 1e3  # replaces an infinite limit
_FORCE_MIN = 0.1  # m/s^2: keeps turn radii finite if the limits allow no turn
_SPEED_MIN = 1e-6  # m/s: keeps results finite in vertical flight


class Demand(eqx.Module):
    """Airspeed, and the force of wings and engine minus drag, per mass, along three axes of the motion.

    Attributes
    ----------
    speed
        Airspeed, m/s.
    side
        Horizontal component normal to the velocity, right positive, m/s^2.
    lift
        Component normal to the velocity and to `side`, up positive, m/s^2.
    along
        Component along the velocity: V_dot + g sin(gamma), m/s^2.
    """

    speed: Scalar
    side: Scalar
    lift: Scalar
    along: Scalar

    @property
    def bank(self) -> Scalar:
        """Bank angle about the velocity, rad, right positive."""
        return jnp.arctan2(self.side, self.lift)

    @property
    def normal(self) -> Scalar:
        """Force normal to the velocity, m/s^2: load factor times gravity."""
        return jnp.sqrt(self.side**2 + self.lift**2)

    @property
    def smooth_normal(self) -> Scalar:
        """Smooth upper bound of `normal`, differentiable at 0."""
        return jnp.sqrt(self.side**2 + self.lift**2 + 1e-6)

    def excess(
        self, bank: ScalarLike, normal: ScalarLike, acceleration: ScalarLike, deceleration: ScalarLike
    ) -> tuple[Scalar, Scalar, Scalar]:
        """Excess over limits of bank (tangent), normal force, and force along the velocity; negative within limits."""
        return (
            jnp.abs(self.side) - self.lift * bank,
            self.smooth_normal - normal,
            jnp.maximum(self.along - acceleration, -self.along - deceleration),
        )


def coordinated_demand(level: Scalar, climb: Scalar, side: Scalar, forward: Scalar, up: Scalar) -> Demand:
    """Demand of a motion in components along and across the course.

    Parameters
    ----------
    level, climb
        Horizontal and vertical airspeed, up positive, m/s.
    side, forward
        Horizontal acceleration across the course, right positive, and along the course, m/s^2.
    up
        Vertical acceleration plus gravity, m/s^2.
    """
    speed = jnp.sqrt(level**2 + climb**2)
    return Demand(speed, side, (level * up - climb * forward) / speed, (level * forward + climb * up) / speed)


def demand(
    air_velocity_n: Vector3, acceleration_n: Vector3, gravity: ScalarLike, level_min: float = _SPEED_MIN
) -> Demand:
    """Demand of a velocity relative to the air (m/s) with an acceleration over the ground (m/s^2), both NED.

    `level_min`, m/s, is added to the horizontal airspeed as the root of the sum of squares.
    """
    north, east, down = air_velocity_n
    level = jnp.sqrt(north**2 + east**2 + level_min**2)
    side = (north * acceleration_n[1] - east * acceleration_n[0]) / level
    forward = (north * acceleration_n[0] + east * acceleration_n[1]) / level
    return coordinated_demand(level, -down, side, forward, gravity - acceleration_n[2])


def normal_force_max(limits: PathLimits, gravity: ScalarLike) -> Scalar:
    """Greatest force normal to the velocity within the load factor, per mass, m/s^2."""
    return jnp.minimum(limits.load_factor_max, _LOAD_FACTOR_UNLIMITED) * gravity


def side_force_max(lift_min: ScalarLike, lift_max: ScalarLike, limits: PathLimits, gravity: ScalarLike) -> Scalar:
    """Greatest `Demand.side` within bank angle and load factor, for a lift between two values, m/s^2."""
    by_bank = jnp.maximum(lift_min, _FORCE_MIN) * jnp.tan(limits.bank_max)
    side_square = normal_force_max(limits, gravity) ** 2 - lift_max**2
    return jnp.minimum(by_bank, jnp.sqrt(jnp.maximum(side_square, _FORCE_MIN**2)))


def turn_radius(speed: ScalarLike, bank: ScalarLike, gravity: ScalarLike) -> Scalar:
    """Radius of a level turn at a bank angle (rad) and an airspeed (m/s), m."""
    return speed**2 / (gravity * jnp.tan(bank))
