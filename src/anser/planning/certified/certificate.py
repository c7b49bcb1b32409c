"""Bounds on what a delivered path asks of its aircraft, valid between the knots too.

Each cell of the path is a polynomial in time. Its Bernstein coefficients bound positions, velocities, accelerations and
the products from which the rest follows by interval arithmetic. The bounds are rigorous but for rounding; with cells of
a second they exceed the true extremes by about a hundredth.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.environment import AbstractWind, LayeredWind, SteadyWind
from anser.numerics import bernstein
from anser.planning.limits import PathLimits
from anser.planning.timed_path import TimedPath
from anser.shapes import Scalar, ScalarLike

Cells = Float[Array, "cells n"]
_TINY = 1e-9


class PathBounds(eqx.Module):
    """What a path certainly keeps within.

    Attributes
    ----------
    speed_min, speed_max
        Airspeed, m/s.
    bank_max, load_factor_max
        Asked for in coordinated flight, rad, 1.
    climb_rate_max
        Relative to the air, up or down, m/s.
    altitude_min, altitude_max
        m.
    acceleration_max, deceleration_max
        Of V_dot + g sin(gamma), m/s^2.
    wind_error_max
        By how much the drift's slope and the wind at the aircraft differ at most, m/s.
    cell_acceleration
        Bound of the acceleration over the ground in each cell, m/s^2; for distances between paths.
    """

    speed_min: Scalar
    speed_max: Scalar
    bank_max: Scalar
    load_factor_max: Scalar
    climb_rate_max: Scalar
    altitude_min: Scalar
    altitude_max: Scalar
    acceleration_max: Scalar
    deceleration_max: Scalar
    wind_error_max: Scalar
    cell_acceleration: Float[Array, " cells"]


def _controls(
    knots: Float[Array, "knots 3 3"], spans: Float[Array, " cells"]
) -> tuple[Float[Array, "cells 3 6"], Float[Array, "cells 3 5"], Float[Array, "cells 3 4"]]:
    """Bernstein coefficients of position, velocity and acceleration, (cell, axis, coefficient)."""
    h = spans[:, None]
    begin, end = knots[:-1], knots[1:]
    p0, v0, a0 = begin[:, 0], begin[:, 1], begin[:, 2]
    p1, v1, a1 = end[:, 0], end[:, 1], end[:, 2]
    position = jnp.stack(
        [
            p0,
            p0 + h * v0 / 5,
            p0 + 2 * h * v0 / 5 + h**2 * a0 / 20,
            p1 - 2 * h * v1 / 5 + h**2 * a1 / 20,
            p1 - h * v1 / 5,
            p1,
        ],
        axis=-1,
    )
    middle = 5 * (position[..., 3] - position[..., 2]) / h
    velocity = jnp.stack([v0, v0 + h * a0 / 4, middle, v1 - h * a1 / 4, v1], axis=-1)
    acceleration = jnp.stack(
        [a0, 4 * (middle - velocity[..., 1]) / h, 4 * (velocity[..., 3] - middle) / h, a1], axis=-1
    )
    return position, velocity, acceleration


def _root(square: Array) -> Array:
    """Square root, 0 of what is not positive, with a finite derivative there."""
    positive = square > 0.0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, square, 1.0)), 0.0)


def _square(a: Float[Array, "cells axes n"]) -> Cells:
    return jnp.sum(bernstein.product(a, a), axis=1)


def _wind_error(
    wind: AbstractWind, down: Cells, slope: Float[Array, "cells 3 5"], drifting: Float[Array, " cells"]
) -> Float[Array, " cells"]:
    """Bound of |slope of the drift - wind| per cell."""
    if isinstance(wind, SteadyWind):
        off = jnp.max(jnp.abs(slope - wind.velocity_n[None, :, None]), axis=2)
        return jnp.where(drifting, _root(jnp.sum(off**2, axis=1)), 0.0)
    if not isinstance(wind, LayeredWind):
        raise TypeError(f"no certificate for wind of type {type(wind).__name__}; expected a steady or a layered wind")
    low, high = bernstein.bounds(-down)
    slopes = bernstein.elevate(slope, down.shape[-1] - 1)
    # Below the lowest and above the highest layer the wind is that of the end.
    edges = wind.altitudes
    floor, ceiling = edges[0] - 1e6, edges[-1] + 1e6
    bottoms = jnp.concatenate([floor[None], edges])
    tops = jnp.concatenate([edges, ceiling[None]])
    first = jnp.concatenate([wind.velocities_n[:1], wind.velocities_n])
    last = jnp.concatenate([wind.velocities_n, wind.velocities_n[-1:]])

    def layer(bottom: Scalar, top: Scalar, begin: Array, end: Array) -> Float[Array, " cells"]:
        rate = (end - begin) / jnp.maximum(top - bottom, _TINY)
        blowing = begin[None, :, None] + rate[None, :, None] * (-down - bottom)[:, None, :]
        off = jnp.max(jnp.abs(slopes - blowing), axis=2)
        crossed = (low <= top) & (high >= bottom)
        return jnp.where(crossed, _root(jnp.sum(off**2, axis=1)), 0.0)

    return jnp.where(drifting, jnp.max(jax.vmap(layer)(bottoms, tops, first, last), axis=0), 0.0)


def path_bounds(path: TimedPath, wind: AbstractWind, gravity: ScalarLike) -> PathBounds:
    """Bounds of a path in a wind (steady or layered) under a gravity (m/s^2).

    Notes
    -----
    Airspeed is that of the velocity over the ground less the wind at the aircraft's altitude, not the path's own.
    """
    spans = path.times[1:] - path.times[:-1]
    real = spans > 0.0
    safe = jnp.where(real, spans, 1.0)
    # What comes of an empty cell means nothing: it is finite, and never counted.
    air = path.air_n
    ground, velocity_g, acceleration = _controls(air + path.drift_n, safe)
    _, drift_slope, _ = _controls(path.drift_n, safe)
    velocity = velocity_g - drift_slope
    error = _wind_error(wind, ground[:, 2], drift_slope, real)

    def least(low: Array) -> Scalar:
        return jnp.min(jnp.where(real, low, jnp.inf))

    def most(high: Array) -> Scalar:
        return jnp.max(jnp.where(real, high, -jnp.inf))

    speed_low, speed_high = _root_bounds(_square(velocity), error)
    level_low, _ = _root_bounds(_square(velocity[:, :2]), error)
    push = _root(bernstein.bounds(_square(acceleration))[1])

    across = bernstein.product(velocity[:, 0], acceleration[:, 1]) - bernstein.product(
        velocity[:, 1], acceleration[:, 0]
    )
    side = (jnp.max(jnp.abs(across), axis=-1) + error * push) / jnp.maximum(level_low, _TINY)

    up_rate_low, up_rate_high = bernstein.bounds(-velocity[:, 2])
    up_rate_low, up_rate_high = up_rate_low - error, up_rate_high + error
    climb = jnp.maximum(jnp.abs(up_rate_low), jnp.abs(up_rate_high))
    # Across the air velocity and up: cos(gamma) a_up - sin(gamma) a_forward.
    rise_low, rise_high = bernstein.bounds(-acceleration[:, 2])
    along = bernstein.product(velocity[:, 0], acceleration[:, 0]) + bernstein.product(
        velocity[:, 1], acceleration[:, 1]
    )
    ahead = (jnp.max(jnp.abs(along), axis=-1) + error * push) / jnp.maximum(level_low, _TINY)
    cos_low = jnp.clip(level_low / jnp.maximum(speed_high, _TINY), 0.0, 1.0)
    cos_low = jnp.maximum(cos_low, _root(1.0 - (climb / jnp.maximum(speed_low, _TINY)) ** 2))
    sin_high = jnp.minimum(climb / jnp.maximum(speed_low, _TINY), 1.0)
    lift_low = jnp.minimum(cos_low * (gravity + rise_low), gravity + rise_low) - sin_high * ahead
    lift_high = jnp.maximum(gravity + rise_high, 0.0) + sin_high * ahead
    bank = jnp.where(lift_low > 0.0, jnp.arctan2(side, jnp.maximum(lift_low, _TINY)), jnp.pi / 2)
    load = jnp.sqrt(side**2 + jnp.maximum(lift_high, -lift_low) ** 2) / gravity

    # V V_dot = v . a for the air's own velocity; the drift's share is a few hundredths.
    work = jnp.sum(bernstein.product(velocity, acceleration), axis=1) + gravity * bernstein.elevate(-velocity[:, 2], 7)
    work_low, work_high = bernstein.bounds(work)
    slack = error * (push + gravity)
    slow, fast = jnp.maximum(speed_low, _TINY), jnp.maximum(speed_high, _TINY)
    forward = (work_high + slack) / jnp.where(work_high + slack > 0.0, slow, fast)
    backward = -(work_low - slack) / jnp.where(work_low - slack < 0.0, slow, fast)
    down_low, down_high = bernstein.bounds(ground[:, 2])
    return PathBounds(
        speed_min=least(speed_low),
        speed_max=most(speed_high),
        bank_max=most(bank),
        load_factor_max=most(load),
        climb_rate_max=most(climb),
        altitude_min=least(-down_high),
        altitude_max=most(-down_low),
        acceleration_max=most(forward),
        deceleration_max=most(backward),
        wind_error_max=most(error),
        cell_acceleration=jnp.where(real, push, 0.0),
    )


def _root_bounds(square: Cells, error: Float[Array, " cells"]) -> tuple[Array, Array]:
    """Bounds of a length from its square's coefficients, widened by an error."""
    low, high = bernstein.bounds(square)
    return (
        jnp.maximum(_root(low) - error, 0.0),
        _root(high) + error,
    )


def excess(found: PathBounds, limits: PathLimits) -> Float[Array, "9"]:
    """By how much a path's bounds pass each limit, as a part of it; not positive where it is kept.

    In the order of `CERTIFIED_LIMITS`.
    """

    def above(value: ScalarLike, limit: Scalar) -> Scalar:
        scale = jnp.where(jnp.isfinite(limit), jnp.maximum(jnp.abs(limit), 1.0), 1.0)
        return jnp.where(jnp.isfinite(limit), (value - jnp.where(jnp.isfinite(limit), limit, 0.0)) / scale, -1.0)

    return jnp.stack(
        [
            -above(found.speed_min, limits.speed_min),
            above(found.speed_max, limits.speed_max),
            above(jnp.tan(jnp.minimum(found.bank_max, 1.57)), jnp.tan(limits.bank_max)),
            above(found.load_factor_max, limits.load_factor_max),
            above(found.climb_rate_max, limits.climb_rate_max),
            -above(found.altitude_min, limits.altitude_min),
            above(found.altitude_max, limits.altitude_max),
            above(found.acceleration_max, limits.acceleration_max),
            above(found.deceleration_max, limits.deceleration_max),
        ]
    )


CERTIFIED_LIMITS = (
    "least airspeed",
    "greatest airspeed",
    "bank angle",
    "load factor",
    "rate of climb or descent",
    "least altitude",
    "greatest altitude",
    "acceleration",
    "deceleration",
)
