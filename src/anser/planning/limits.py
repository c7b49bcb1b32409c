"""Whether an aircraft can fly a trajectory: dynamic limits over its whole length, and a hold after its end."""

import equinox as eqx
import jax
import jax.numpy as jnp

from anser.constants import STANDARD_GRAVITY_M_S2
from anser.planning.commands import polar
from anser.planning.level_off import level_off_height
from anser.planning.trajectory import Trajectory
from anser.shapes import Count, Flag, Scalar, ScalarLike

WITHIN_LIMITS, TOO_SLOW, TOO_FAST, TURN_TOO_TIGHT, CLIMB_TOO_STEEP, TOO_LOW, NO_LEVEL_OFF = range(7)
LIMIT_MESSAGES = (
    "within all limits",
    "the trajectory asks for less than the least airspeed",
    "the trajectory asks for more than the greatest airspeed",
    "the trajectory turns faster than the greatest bank angle allows at its airspeed",
    "the trajectory climbs or descends faster than the limit",
    "the trajectory goes below the least altitude",
    "the trajectory arrives in a descent that the hold cannot level off above the least altitude",
)

# The pull, beyond carrying the weight, that a plan leaves to the hold: 1 g, as any speed allows at which the lift at
# alpha_max is 2.2 times the weight (the F-16 from 95 m/s on), and of a smaller load factor limit three quarters.
_PULL = STANDARD_GRAVITY_M_S2
_PULL_SHARE = 0.75


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
    altitude_max: Scalar = eqx.field(default_factory=lambda: jnp.asarray(jnp.inf))
    """m."""
    load_factor_max: Scalar = eqx.field(default_factory=lambda: jnp.asarray(jnp.inf))
    """1."""
    acceleration_max: Scalar = eqx.field(default_factory=lambda: jnp.asarray(jnp.inf))
    """Of V_dot + g sin(gamma), what the engine gives beyond drag, m/s^2."""
    deceleration_max: Scalar = eqx.field(default_factory=lambda: jnp.asarray(jnp.inf))
    """The same with the engine idle, positive, m/s^2."""


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
    speed_min_ok: Flag
    speed_max_ok: Flag
    turn_ok: Flag
    climb_ok: Flag
    altitude_ok: Flag
    level_off_ok: Flag
    status: Count
    """First limit broken, in the order of LIMIT_MESSAGES; 0 is none."""


def check_limits(trajectory: Trajectory, limits: PathLimits, gravity: ScalarLike, count: int = 129) -> LimitReport:
    """Compare a trajectory with an aircraft's limits at equal intervals from start to rendezvous, both included.

    Parameters
    ----------
    trajectory
        The trajectory.
    limits
        The limits.
    gravity
        m/s^2.
    count
        Number of instants looked at.

    Notes
    -----
    Theory section 6, "Dynamic limits on the whole path": |chi_dot| < g tan(bank_max)/V. Speed, turn and climb are
    those relative to the air, which is what the aircraft feels; altitude is over the ground. The end state is what a
    hold can catch: see `level_off_height`, with the bank and the vertical acceleration of the path's end.
    """
    times = trajectory.start_time + trajectory.duration * jnp.linspace(0.0, 1.0, count)
    command = jax.vmap(lambda t: polar(trajectory.air_velocity_n(t), trajectory.acceleration_n(t)))(times)
    altitudes = -jax.vmap(trajectory.position_n)(times)[:, 2]
    altitude_min = jnp.min(altitudes)
    level_off_altitude = altitudes[-1] - _level_off_of_end(trajectory, limits, gravity)
    turn_rate = jnp.abs(command.chi_dot)
    turn_use_max = jnp.max(turn_rate * command.V) / (gravity * jnp.tan(limits.bank_max))
    climb_rate_max = jnp.max(jnp.abs(command.V * jnp.sin(command.gamma)))
    speed_min, speed_max = jnp.min(command.V), jnp.max(command.V)
    kept = (
        speed_min >= limits.speed_min,
        speed_max <= limits.speed_max,
        turn_use_max <= 1.0,
        climb_rate_max <= limits.climb_rate_max,
        altitude_min >= limits.altitude_min,
        level_off_altitude >= limits.altitude_min,
    )
    status = jnp.asarray(WITHIN_LIMITS, dtype=int)
    for code, ok in reversed(list(enumerate(kept, start=TOO_SLOW))):
        status = jnp.where(ok, status, code)
    return LimitReport(
        speed_min,
        speed_max,
        jnp.max(turn_rate),
        turn_use_max,
        climb_rate_max,
        altitude_min,
        level_off_altitude,
        *kept,
        status=status,
    )


def _level_off_of_end(trajectory: Trajectory, limits: PathLimits, gravity: ScalarLike) -> Scalar:
    """Height that the hold needs to end the descent with which a trajectory arrives, m."""
    end = trajectory.start_time + trajectory.duration
    acceleration_n = trajectory.acceleration_n(end)
    command = polar(trajectory.air_velocity_n(end), acceleration_n)
    up = command.V * command.gamma_dot + gravity * jnp.cos(command.gamma)
    bank = jnp.arctan2(command.V * jnp.cos(command.gamma) * command.chi_dot, jnp.maximum(up, 0.1 * gravity))
    pull = jnp.minimum(_PULL, _PULL_SHARE * (limits.load_factor_max - 1.0) * gravity)
    return level_off_height(command.V, trajectory.velocity_n(end)[2], acceleration_n[2], bank, pull)
