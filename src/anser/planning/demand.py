"""What a motion demands of its aircraft in coordinated flight, without a force to the side in the body's axes.

The certificate bounds the same quantities between the knots, as ratios of polynomials: see
`anser.planning.certified.path_bounds`.
"""

import equinox as eqx
import jax.numpy as jnp

from anser.planning.limits import PathLimits
from anser.shapes import Scalar, ScalarLike, Vector3

_ANY_LOAD = 1e3  # stands for a load factor without a limit
_FORCE_LEAST = 0.1  # m/s^2: an aircraft whose limits allow no turn still has finite radii
_LEVEL_LEAST = 1e-6  # m/s: keeps everything finite in vertical flight


class Demand(eqx.Module):
    """Airspeed, and the force that wings and engine give beyond drag, per mass, along three axes of the motion.

    Attributes
    ----------
    speed
        Airspeed, m/s.
    side
        Horizontal, across the velocity, right positive, m/s^2.
    lift
        Across both, up positive, m/s^2.
    along
        Along the velocity: V_dot + g sin(gamma), m/s^2.
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
        """Force across the velocity, m/s^2: the load factor times gravity."""
        return jnp.sqrt(self.side**2 + self.lift**2)

    @property
    def smooth_normal(self) -> Scalar:
        """The same and a little more near 0, where its derivative exists too."""
        return jnp.sqrt(self.side**2 + self.lift**2 + 1e-6)

    def excess(
        self, bank: ScalarLike, normal: ScalarLike, acceleration: ScalarLike, deceleration: ScalarLike
    ) -> tuple[Scalar, Scalar, Scalar]:
        """By how much the tangent of a bank angle, a normal force and one along or against are passed, or negative."""
        return (
            jnp.abs(self.side) - self.lift * bank,
            self.smooth_normal - normal,
            jnp.maximum(self.along - acceleration, -self.along - deceleration),
        )


def coordinated_demand(level: Scalar, climb: Scalar, side: Scalar, forward: Scalar, up: Scalar) -> Demand:
    """Demand of a motion given along its course.

    Parameters
    ----------
    level, climb
        Horizontal airspeed and vertical one, up positive, m/s.
    side, forward
        Horizontal acceleration across the course, right positive, and along it, m/s^2.
    up
        Vertical acceleration plus gravity, m/s^2.
    """
    speed = jnp.sqrt(level**2 + climb**2)
    return Demand(speed, side, (level * up - climb * forward) / speed, (level * forward + climb * up) / speed)


def demand(
    air_velocity_n: Vector3, acceleration_n: Vector3, gravity: ScalarLike, level_least: float = _LEVEL_LEAST
) -> Demand:
    """Demand of a velocity relative to the air (m/s) with an acceleration over the ground (m/s^2), both NED.

    `level_least`, m/s, is added to the horizontal airspeed as the root of the sum of squares.
    """
    north, east, down = air_velocity_n
    level = jnp.sqrt(north**2 + east**2 + level_least**2)
    side = (north * acceleration_n[1] - east * acceleration_n[0]) / level
    forward = (north * acceleration_n[0] + east * acceleration_n[1]) / level
    return coordinated_demand(level, -down, side, forward, gravity - acceleration_n[2])


def normal_force_max(limits: PathLimits, gravity: ScalarLike) -> Scalar:
    """Greatest force across the velocity that the load factor allows, per mass, m/s^2."""
    return jnp.minimum(limits.load_factor_max, _ANY_LOAD) * gravity


def side_force_max(lift_least: ScalarLike, lift_most: ScalarLike, limits: PathLimits, gravity: ScalarLike) -> Scalar:
    """Greatest `Demand.side` that bank angle and load factor allow where the lift is between two values, m/s^2."""
    by_bank = jnp.maximum(lift_least, _FORCE_LEAST) * jnp.tan(limits.bank_max)
    left = normal_force_max(limits, gravity) ** 2 - lift_most**2
    return jnp.minimum(by_bank, jnp.sqrt(jnp.maximum(left, _FORCE_LEAST**2)))


def turn_radius(speed: ScalarLike, bank: ScalarLike, gravity: ScalarLike) -> Scalar:
    """Radius of a level turn at a bank angle (rad) and an airspeed (m/s), m."""
    return speed**2 / (gravity * jnp.tan(bank))
