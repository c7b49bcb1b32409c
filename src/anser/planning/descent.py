"""How slowly an aircraft can come down: the limit that gravity sets to a plan's mean speed."""

import jax
import jax.numpy as jnp
import numpy as np

from anser.constants import STANDARD_GRAVITY_M_S2
from anser.planning.time_law import BRAKING_RESERVE_M_S2, CELLS
from anser.planning.trajectory import Trajectory
from anser.planning.vectors import norm
from anser.shapes import Scalar, ScalarLike

_SLOWEST = 0.3  # part of the first speed below which idling on is not a way to be slow


def slowest_mean_speed(path: Trajectory, speed_0: ScalarLike, deceleration: ScalarLike) -> Scalar:
    """Least mean airspeed with which an aircraft can fly a path, engine idle all the way, m/s.

    V dV/dl = g (-dh/dl) - a with the deceleration a (less the reserve that the even law keeps). On a level path this is
    far below any speed of interest; down a path steeper than the glide it exceeds the first speed.

    Of the path the shape counts, not the time law. `speed_0` is the airspeed at its start, m/s; the deceleration is
    that with the engine idle in level flight, m/s^2.
    """
    edges = np.linspace(0.0, 1.0, CELLS + 1)
    middles = jnp.asarray(0.5 * (edges[1:] + edges[:-1]))
    parts = jax.vmap(lambda s: norm(path.path_derivative(s, 1)))(middles) / CELLS
    down = jax.vmap(lambda s: path.path_derivative(s, 0)[2])(jnp.asarray(edges))
    lengths = jnp.concatenate([jnp.zeros(1), jnp.cumsum(parts)])
    braked = (deceleration - BRAKING_RESERVE_M_S2) * lengths
    square = speed_0**2 + 2 * (STANDARD_GRAVITY_M_S2 * (down - down[0]) - braked)
    speeds = jnp.sqrt(jnp.maximum(square, (_SLOWEST * speed_0) ** 2))
    return lengths[-1] / jnp.sum(2 * parts / (speeds[1:] + speeds[:-1]))
