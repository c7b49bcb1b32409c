"""The stand-off guard: whether an aircraft is nearer to its goal than a rendezvous may be, or is about to be."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.numerics.arrays import select_if_any
from anser.shapes import Flag, Scalar, ScalarLike, Vector3
from anser.spatial.rotations import safe_hypot, safe_norm

DISTANCE_ERROR_ALLOWED_M = 10.0
"""By how much less than the least distance a straight flight on may pass the goal, for errors of tracking."""
_RESERVE_M = 25.0  # by which the last turn away passes outside the least distance
_ONSET_S = 2.5  # straight on until the turn away is flown
_SHARE = 0.6  # of the turn that the aircraft can fly
_ANGLES = np.linspace(0.0, np.pi, 24)  # of the turn away, rad


def must_break_away(
    to_goal_n: Vector3,
    velocity_n: Vector3,
    goal_velocity_n: Vector3,
    distance_min: ScalarLike,
    acceleration: ScalarLike,
    turn: ScalarLike,
) -> Flag:
    """Whether an aircraft must break off at once.

    It must where it is nearer than the least distance; and where straight flight on would lead it well inside, as soon
    as the turn into its hold would otherwise pass the goal with no more than a reserve beyond the least distance.

    Parameters
    ----------
    to_goal_n
        Straight line through space from the aircraft to its goal, NED, m.
    velocity_n, goal_velocity_n
        Over the ground, NED, m/s.
    distance_min
        m.
    acceleration
        With which it can turn, m/s^2.
    turn
        Sense of its hold: +1 to the right, -1 to the left.
    """
    distance = safe_norm(to_goal_n)
    inside = distance < distance_min
    closing_n = velocity_n - goal_velocity_n
    square = jnp.maximum(jnp.sum(closing_n**2), 1e-6)
    ahead = jnp.maximum(jnp.sum(to_goal_n * closing_n) / square, 0.0)
    passes = safe_norm(to_goal_n - ahead * closing_n)
    level = jnp.maximum(safe_hypot(velocity_n[0], velocity_n[1]), 1.0)
    rate = _SHARE * jnp.maximum(acceleration, 0.5) / level
    leads_inside = passes < distance_min - DISTANCE_ERROR_ALLOWED_M

    def late() -> Flag:
        least = jnp.min(_from_goal(rate, to_goal_n, velocity_n, goal_velocity_n, level, turn))
        return least < distance_min + _RESERVE_M

    return inside | select_if_any(leads_inside, late, jnp.zeros_like(leads_inside))


def _from_goal(
    rate: Scalar,
    to_goal_n: Vector3,
    velocity_n: Vector3,
    goal_velocity_n: Vector3,
    level: Scalar,
    turn: ScalarLike,
) -> Float[Array, " legs"]:
    """Least distance from the goal on each leg of a half turn away after a straight leg, chords of equal angles, m."""
    ahead_n = velocity_n.at[2].set(0.0) / level
    right_n = turn * jnp.stack([-ahead_n[1], ahead_n[0], jnp.zeros_like(level)])
    radius, start = level / rate, jnp.zeros(1, rate.dtype)
    times = jnp.concatenate([start, _ONSET_S + jnp.asarray(_ANGLES, rate.dtype) / rate])
    forward = jnp.concatenate([start, level * _ONSET_S + radius * jnp.asarray(np.sin(_ANGLES), rate.dtype)])
    aside = jnp.concatenate([start, radius * jnp.asarray(1.0 - np.cos(_ANGLES), rate.dtype)])
    down = velocity_n[2] * jnp.minimum(times, 2.0 * _ONSET_S)
    own_n = forward[:, None] * ahead_n[None, :] + aside[:, None] * right_n[None, :]
    own_n = own_n.at[:, 2].add(down)
    off_n = to_goal_n[None, :] + times[:, None] * goal_velocity_n[None, :] - own_n
    start_n, leg_n = off_n[:-1], off_n[1:] - off_n[:-1]
    part = -jnp.sum(start_n * leg_n, axis=1) / jnp.maximum(jnp.sum(leg_n**2, axis=1), 1e-6)
    nearest_n = start_n + jnp.clip(part, 0.0, 1.0)[:, None] * leg_n
    return jnp.sqrt(jnp.sum(nearest_n**2, axis=1) + 1e-12)
