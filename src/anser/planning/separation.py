"""How far apart aircraft are, and how much of the separation that is."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from anser.planning.trajectory import Trajectory
from anser.planning.vectors import root
from anser.shapes import Scalar


class Separation(eqx.Module):
    """How far apart two aircraft stay: horizontally or else vertically, m; 0: not asked."""

    horizontal: Scalar
    vertical: Scalar


def separation_ratio(level: Any, height: Any, horizontal: Any, vertical: Any) -> Any:
    """Distance over separation, the better of the two ratios; 1 is just enough, infinite where nothing is asked.

    Horizontal and vertical distance, m, are arrays of NumPy or of JAX, or both; separations as in `Separation`.
    """
    xp = level.__array_namespace__()
    asked, stacked = horizontal > 0.0, vertical > 0.0
    flat = xp.where(asked, level / xp.where(asked, horizontal, 1.0), xp.inf)
    tall = xp.where(stacked, height / xp.where(stacked, vertical, 1.0), -xp.inf)
    return xp.maximum(flat, tall)


def nearest_fraction(begin: Any, along: Any, least_square: float = 1e-200) -> Any:
    """Part, 0 to 1, of the way from one offset to another at which it is shortest; 0 where the offset stays.

    Parameters
    ----------
    begin, along
        First offset and its change, (..., axis), m; arrays of NumPy or of JAX.
    least_square
        Squares of changes below this count as this, m^2; it keeps derivatives finite.
    """
    xp = begin.__array_namespace__()
    square = xp.sum(along * along, axis=-1)
    return xp.clip(-xp.sum(begin * along, axis=-1) / xp.maximum(square, least_square), 0.0, 1.0)


def positions_along(trajectory: Trajectory, count: int) -> Float[Array, "count 3"]:
    """Positions over the ground at equal intervals from start to rendezvous, NED, m."""
    times = trajectory.start_time + trajectory.duration * jnp.linspace(0.0, 1.0, count)
    return jax.vmap(trajectory.position_n)(times)


def separation_min(
    trajectories: Trajectory, count: int = 65, active: Bool[Array, " aircraft"] | None = None
) -> Float[Array, "aircraft aircraft"]:
    """Least distance between any two aircraft during their common flight, m; infinite on the diagonal.

    Parameters
    ----------
    trajectories
        Stacked, leading axis aircraft; of those that are active, all with one start time and duration.
    count
        Number of instants looked at, ends included. Between them the distance may be less by no more than half
        the relative speed times the interval.
    active
        Which aircraft fly; infinite from and to one that does not. None: all fly.
    """
    positions = jnp.swapaxes(jax.vmap(lambda trajectory: positions_along(trajectory, count))(trajectories), 0, 1)
    fleet = positions.shape[1]

    def closer(least: Float[Array, "aircraft aircraft"], now: Float[Array, "aircraft 3"]) -> tuple[Array, None]:
        apart = now[:, None, :] - now[None, :, :]
        return jnp.minimum(least, jnp.sum(apart * apart, axis=2)), None

    # Instant by instant: memory stays quadratic in the fleet.
    square, _ = lax.scan(closer, jnp.full((fleet, fleet), jnp.inf), positions)
    unlike = ~jnp.eye(fleet, dtype=bool)
    if active is not None:
        unlike = unlike & active[:, None] & active[None, :]
    return jnp.where(unlike, root(square), jnp.inf)
