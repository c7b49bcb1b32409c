"""The goal sensor: range, line-of-sight angles and their rates, and the goal's motion from them."""

import equinox as eqx
import jax.numpy as jnp

from anser.planning.vectors import norm
from anser.shapes import Scalar, Vector3

# A sight line is treated as vertical below this ratio of horizontal distance to range.
_VERTICAL = 1e-12


class LineOfSight(eqx.Module):
    """What the sensor gives, in axes North, East, up."""

    range: Scalar
    """m."""
    azimuth: Scalar
    """Clockwise from North, rad."""
    elevation: Scalar
    """Up positive, rad; -pi/2 with the goal straight below."""
    range_rate: Scalar
    """m/s."""
    azimuth_rate: Scalar
    """rad/s; grows without bound toward the vertical, its product with range and cos(elevation) does not."""
    elevation_rate: Scalar
    """rad/s."""


def _axes(azimuth: Scalar, elevation: Scalar) -> tuple[Vector3, Vector3, Vector3]:
    """Rows of theory's M, in NED: along the sight line, toward rising azimuth, toward rising elevation."""
    ca, sa, ce, se = jnp.cos(azimuth), jnp.sin(azimuth), jnp.cos(elevation), jnp.sin(elevation)
    return (
        jnp.stack([ca * ce, sa * ce, -se]),
        jnp.stack([-sa, ca, jnp.zeros_like(ca)]),
        jnp.stack([-ca * se, -sa * se, -ce]),
    )


def measure(
    own_position_n: Vector3, own_velocity_n: Vector3, goal_position_n: Vector3, goal_velocity_n: Vector3
) -> LineOfSight:
    """Give what a perfect sensor on the aircraft sees of a goal.

    Parameters
    ----------
    own_position_n, goal_position_n
        NED, m. They must differ: at zero range there is no sight line, and all angles and rates are reported as 0.
    own_velocity_n, goal_velocity_n
        NED, m/s, both over the ground.

    Notes
    -----
    Theory section 7. On the exact vertical the azimuth is free: it is laid along the horizontal relative velocity, so
    that the azimuth rate is zero and the elevation rate holds the whole motion. Elsewhere the azimuth rate is formed
    with the rounded elevation, so that `recover` gives the velocity back to rounding however close the vertical is.
    """
    relative, rate = goal_position_n - own_position_n, goal_velocity_n - own_velocity_n
    distance, level = norm(relative), norm(relative[:2])
    seen, vertical = distance > 0.0, level <= _VERTICAL * distance
    safe_distance = jnp.where(seen, distance, 1.0)

    sweeping = norm(rate[:2]) > 0.0
    aside_n = jnp.where(vertical, jnp.where(sweeping, rate[0], 1.0), relative[0])
    aside_e = jnp.where(vertical, jnp.where(sweeping, rate[1], 0.0), relative[1])
    azimuth = jnp.where(seen, jnp.arctan2(aside_e, aside_n), 0.0)
    elevation = jnp.arctan2(-relative[2], jnp.where(seen, level, 1.0))

    along, across, above = _axes(azimuth, elevation)
    turn = jnp.where(vertical, 0.0, jnp.sum(across * rate))
    lever = jnp.where(vertical, 1.0, safe_distance * jnp.cos(elevation))
    return LineOfSight(
        range=distance,
        azimuth=azimuth,
        elevation=elevation,
        range_rate=jnp.where(seen, jnp.sum(along * rate), 0.0),
        azimuth_rate=turn / lever,
        elevation_rate=jnp.where(seen, jnp.sum(above * rate) / safe_distance, 0.0),
    )


def recover(sight: LineOfSight, own_position_n: Vector3, own_velocity_n: Vector3) -> tuple[Vector3, Vector3]:
    """Goal position (NED, m) and velocity over the ground (NED, m/s) from the sensor and one's own motion.

    Exact without noise (theory section 7): M is orthonormal, its inverse is its transpose.
    """
    along, across, above = _axes(sight.azimuth, sight.elevation)
    relative_rate = (
        sight.range_rate * along
        + sight.range * jnp.cos(sight.elevation) * sight.azimuth_rate * across
        + sight.range * sight.elevation_rate * above
    )
    return own_position_n + sight.range * along, own_velocity_n + relative_rate
