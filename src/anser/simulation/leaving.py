"""The way of an aircraft that leaves its fleet: a level turn onto a course, then straight on."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.environment import AbstractWind
from anser.planning.timed_path import TimedPath
from anser.shapes import Scalar, ScalarLike, Vector3
from anser.spatial import safe_hypot

_EASED_S = 4.0  # in which the acceleration of the plan that is left dies down
_LEVEL_S = 12.0  # in which the climb or descent is ended
_BANK = 0.7  # rad, greatest of the turn
_STEEPEST = 1.875  # slope of the blend at its middle


def leaving_path(
    path: TimedPath, now: ScalarLike, until: ScalarLike, turn: ScalarLike, wind: AbstractWind, gravity: ScalarLike
) -> TimedPath:
    """Path from where a planned path is now to a time (s), with as many knots.

    It goes on without a jump of velocity or acceleration, levels off, turns by an angle (rad, right positive) at a bank
    of at most 40 deg, and keeps its level airspeed.

    Parameters
    ----------
    path
        In force.
    now, until
        s.
    turn
        From the present course through the air, rad.
    wind
        As planned with.
    gravity
        m/s^2.
    """
    air, drift = path.states_n(now)
    place_n, velocity_n, acceleration_n = air[0] + drift[0], air[1], air[2]
    level = jnp.maximum(safe_hypot(velocity_n[0], velocity_n[1]), 1.0)
    turning_s = jnp.maximum(_STEEPEST * jnp.abs(turn) * level / (gravity * jnp.tan(_BANK)), 1.0)
    times = now + (until - now) * jnp.linspace(0.0, 1.0, path.times.shape[0])

    def velocity_at(elapsed: Scalar) -> Vector3:
        angle = turn * _blend(elapsed / turning_s)
        cosine, sine = jnp.cos(angle), jnp.sin(angle)
        turned = jnp.stack(
            [
                cosine * velocity_n[0] - sine * velocity_n[1],
                sine * velocity_n[0] + cosine * velocity_n[1],
                velocity_n[2] * (1.0 - _blend(elapsed / _LEVEL_S)),
            ]
        )
        left = jnp.maximum(1.0 - elapsed / _EASED_S, 0.0)
        return turned + acceleration_n * elapsed * left**2

    def with_rate(function: Callable[[Scalar], Vector3], at: Scalar) -> tuple[Array, Array]:
        return jax.jvp(function, (at,), (jnp.ones_like(at),))

    elapsed = times - now
    velocities, rates = jax.vmap(lambda t: with_rate(velocity_at, t))(elapsed)
    places = _integrated(elapsed, velocities, rates)
    downs = place_n[2] + places[:, 2]

    def blowing(down: Scalar, falling: Scalar) -> tuple[Array, Array]:
        at = jnp.stack([place_n[0], place_n[1], down])
        return jax.jvp(lambda p: wind.at(p, now), (at,), (jnp.stack([0.0 * down, 0.0 * down, falling]),))

    # The wind's own vertical part moves the aircraft to other layers too; it is steady, and small.
    winds, wind_rates = jax.vmap(blowing)(downs, velocities[:, 2])
    drifts = _integrated(elapsed, winds, wind_rates)
    return TimedPath(
        times,
        jnp.stack([place_n[None] + places, velocities, rates], axis=1),
        jnp.stack([drifts, winds, wind_rates], axis=1),
    )


def _blend(u: Scalar) -> Scalar:
    u = jnp.clip(u, 0.0, 1.0)
    return u**3 * (10.0 + u * (-15.0 + 6.0 * u))


def _integrated(
    times: Float[Array, " knots"], slopes: Float[Array, "knots 3"], rates: Float[Array, "knots 3"]
) -> Float[Array, "knots 3"]:
    """Integral from the first knot on of what has such values and slopes, by Hermite's rule."""
    span = (times[1:] - times[:-1])[:, None]
    steps = 0.5 * span * (slopes[1:] + slopes[:-1]) + span**2 / 12.0 * (rates[:-1] - rates[1:])
    return jnp.concatenate([jnp.zeros((1, 3)), jnp.cumsum(steps, axis=0)])
