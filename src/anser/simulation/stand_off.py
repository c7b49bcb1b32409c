"""Check whether an aircraft is, or will soon be, nearer to its goal than the least distance allowed."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.numerics.arrays import select_if_any
from anser.planning.separation import closest_fraction
from anser.shapes import Flag, Scalar, ScalarLike, Vector3
from anser.spatial.rotations import safe_hypot, safe_norm

DISTANCE_ERROR_ALLOWED_M = 10.0
"""Allowance for tracking errors, m, by which a straight pass may be nearer to the goal than the least distance."""
_RESERVE_M = 25.0  # margin to the least distance in a turn away from the goal
_ONSET_S = 2.5  # duration of straight flight before the turn begins
_ACCELERATION_SHARE = 0.6  # fraction of the available lateral acceleration in the turn
_ANGLES = np.linspace(0.0, np.pi, 24)  # turn angles in the turn away, rad


def must_break_away(
    to_goal_n: Vector3,  # straight line through space from the aircraft to its goal, NED, m
    velocity_n: Vector3,  # velocity of the aircraft over the ground, NED, m/s
    goal_velocity_n: Vector3,  # velocity of the goal over the ground, NED, m/s
    distance_min: ScalarLike,  # least distance allowed, m
    acceleration: ScalarLike,  # lateral acceleration available for the turn, m/s^2
    turn: ScalarLike,  # turn direction of the hold: +1 right, -1 left
) -> Flag:
    """Whether an aircraft must abandon its plan for the hold at once, because it comes too near its goal.

    True if the aircraft is nearer to the goal than `distance_min`, or if both of these flights would come too near:

    - straight flight: nearer than `distance_min` minus 10 m
    - straight flight for 2.5 s, then a 180 deg turn into the hold: nearer than `distance_min` plus 25 m
    """
    distance = safe_norm(to_goal_n)
    inside = distance < distance_min
    closing_n = velocity_n - goal_velocity_n
    square = jnp.maximum(jnp.sum(closing_n**2), 1e-6)
    time_to_pass = jnp.maximum(jnp.sum(to_goal_n * closing_n) / square, 0.0)
    pass_distance = safe_norm(to_goal_n - time_to_pass * closing_n)
    ground_speed = jnp.maximum(safe_hypot(velocity_n[0], velocity_n[1]), 1.0)
    rate = _ACCELERATION_SHARE * jnp.maximum(acceleration, 0.5) / ground_speed
    is_converging = pass_distance < distance_min - DISTANCE_ERROR_ALLOWED_M

    def turn_is_late() -> Flag:
        turn_distance = jnp.min(_turn_distances(rate, to_goal_n, velocity_n, goal_velocity_n, ground_speed, turn))
        return turn_distance < distance_min + _RESERVE_M

    return inside | select_if_any(is_converging, turn_is_late, jnp.zeros_like(is_converging))


def _turn_distances(
    rate: Scalar,
    to_goal_n: Vector3,
    velocity_n: Vector3,
    goal_velocity_n: Vector3,
    ground_speed: Scalar,
    turn: ScalarLike,
) -> Float[Array, " legs"]:
    """Return the least distance (m) to the goal on each leg of a turn away from the goal.

    The first leg is straight flight for 2.5 s; the other legs are chords of a 180 deg turn at `rate` (rad/s).
    """
    ahead_n = velocity_n.at[2].set(0.0) / ground_speed
    right_n = turn * jnp.stack([-ahead_n[1], ahead_n[0], jnp.zeros_like(ground_speed)])
    radius, start = ground_speed / rate, jnp.zeros(1, rate.dtype)
    times = jnp.concatenate([start, _ONSET_S + jnp.asarray(_ANGLES, rate.dtype) / rate])
    forward = jnp.concatenate([start, ground_speed * _ONSET_S + radius * jnp.asarray(np.sin(_ANGLES), rate.dtype)])
    sideways = jnp.concatenate([start, radius * jnp.asarray(1.0 - np.cos(_ANGLES), rate.dtype)])
    down = velocity_n[2] * jnp.minimum(times, 2.0 * _ONSET_S)
    aircraft_n = forward[:, None] * ahead_n[None, :] + sideways[:, None] * right_n[None, :]
    aircraft_n = aircraft_n.at[:, 2].add(down)
    offset_n = to_goal_n[None, :] + times[:, None] * goal_velocity_n[None, :] - aircraft_n
    start_n, leg_n = offset_n[:-1], offset_n[1:] - offset_n[:-1]
    nearest_n = start_n + closest_fraction(start_n, leg_n, 1e-6)[:, None] * leg_n
    return jnp.sqrt(jnp.sum(nearest_n**2, axis=1) + 1e-12)
