"""Whether an aircraft can fly a trajectory: dynamic limits over its whole length, and a hold after its end."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from anser.constants import STANDARD_GRAVITY_M_S2
from anser.planning.commands import polar
from anser.planning.demand import demand
from anser.planning.level_off import level_off_height
from anser.planning.limits import PathLimits
from anser.planning.trajectory import Trajectory
from anser.shapes import Count, Scalar, ScalarLike

# The pull, beyond carrying the weight, that a plan leaves to the hold: 1 g, as any speed allows at which the lift at
# alpha_max is 2.2 times the weight (the F-16 from 95 m/s on), and of a smaller load factor limit three quarters.
_PULL = STANDARD_GRAVITY_M_S2
_PULL_SHARE = 0.75


class LimitReport(eqx.Module):
    """Extremes along a trajectory, and which limits they keep."""

    speed_min: Scalar
    """m/s, relative to the air."""
    speed_max: Scalar
    """m/s, relative to the air."""
    turn_rate_max: Scalar
    """Greatest course rate, either way, rad/s."""
    turn_use_max: Scalar
    """Greatest ratio of the course rate to what the bank limit allows at the speed of that point; 1 is the limit."""
    climb_rate_max: Scalar
    """Greatest vertical speed relative to the air, up or down, m/s."""
    altitude_min: Scalar
    """m, over the ground frame's origin."""
    level_off_altitude: Scalar
    """Where the descent at arrival ends when the hold levels it off with 1 g beyond the weight, m."""
    kept: Bool[Array, " limits"]
    """In the order of LIMIT_MESSAGES, from the second on."""
    status: Count
    """First limit broken, an index into LIMIT_MESSAGES; 0 is none."""


def check_limits(trajectory: Trajectory, limits: PathLimits, gravity: ScalarLike, count: int = 129) -> LimitReport:
    """Compare a trajectory with an aircraft's limits at `count` even instants from start to rendezvous.

    Theory section 6, "Dynamic limits on the whole path": |chi_dot| < g tan(bank_max)/V. Speed, turn and climb are
    those relative to the air, which is what the aircraft feels; altitude is over the ground. The end state is what a
    hold can catch: see `level_off_height`, with the bank and the vertical acceleration of the path's end.
    """
    times = trajectory.start_time + trajectory.duration * jnp.linspace(0.0, 1.0, count)
    points = jax.vmap(trajectory.at)(times)
    command = jax.vmap(polar)(points.velocity_n - trajectory.wind_n[None], points.acceleration_n)
    altitudes = -points.position_n[:, 2]
    altitude_min = jnp.min(altitudes)
    level_off_altitude = altitudes[-1] - _level_off_of_end(trajectory, limits, gravity)
    turn_rate = jnp.abs(command.chi_dot)
    turn_use_max = jnp.max(turn_rate * command.V) / (gravity * jnp.tan(limits.bank_max))
    climb_rate_max = jnp.max(jnp.abs(command.V * jnp.sin(command.gamma)))
    speed_min, speed_max = jnp.min(command.V), jnp.max(command.V)
    kept = jnp.stack(
        [
            speed_min >= limits.speed_min,
            speed_max <= limits.speed_max,
            turn_use_max <= 1.0,
            climb_rate_max <= limits.climb_rate_max,
            altitude_min >= limits.altitude_min,
            level_off_altitude >= limits.altitude_min,
        ]
    )
    return LimitReport(
        speed_min,
        speed_max,
        jnp.max(turn_rate),
        turn_use_max,
        climb_rate_max,
        altitude_min,
        level_off_altitude,
        kept,
        status=jnp.where(jnp.all(kept), 0, 1 + jnp.argmin(kept)),
    )


def _level_off_of_end(trajectory: Trajectory, limits: PathLimits, gravity: ScalarLike) -> Scalar:
    """Height that the hold needs to end the descent with which a trajectory arrives, m."""
    end = trajectory.start_time + trajectory.duration
    last = trajectory.at(end)
    asked = demand(last.velocity_n - trajectory.wind_n, last.acceleration_n, gravity)
    bank = jnp.arctan2(asked.side, jnp.maximum(asked.lift, 0.1 * gravity))
    pull = jnp.minimum(_PULL, _PULL_SHARE * (limits.load_factor_max - 1.0) * gravity)
    return level_off_height(asked.speed, last.velocity_n[2], last.acceleration_n[2], bank, pull)
