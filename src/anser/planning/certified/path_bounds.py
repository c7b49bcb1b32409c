"""Bounds on what a delivered path asks of its aircraft, valid between the knots too.

Each cell of the path is a polynomial in time. Its Bernstein coefficients bound positions, velocities, accelerations and
the products from which the rest follows by interval arithmetic. The bounds are rigorous but for rounding; with cells of
a second they exceed the true extremes by about a hundredth.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.environment.environment import AbstractWind, LayeredWind, SteadyWind
from anser.numerics import bernstein
from anser.numerics.arrays import namespace
from anser.planning.limits import CERTIFIED_LIMITS, Limit, PathLimits
from anser.planning.timed_path import TimedPath
from anser.shapes import Scalar, ScalarLike
from anser.spatial.vectors import safe_sqrt

Cells = Float[Array, "cells n"]
_TINY = 1e-9
_EDGE_M = 1e-6


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
    cell_along, cell_speeds, cell_load_factors
        Of each cell: `acceleration_max` and `deceleration_max`, least and greatest airspeed, least and greatest load
        factor.
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
    cell_along: Float[Array, "cells 2"]
    cell_speeds: Float[Array, "cells 2"]
    cell_load_factors: Float[Array, "cells 2"]

    def along_at_start(self, limits: PathLimits) -> tuple[Any, Any]:
        """The acceleration and the deceleration that ask as much of an aircraft at its start, level, m/s^2.

        They keep the limits of there if and only if the path keeps those of each airspeed and load factor.
        """
        idle, xp = limits.idle, namespace(self, limits)
        if idle is None:
            return self.acceleration_max, self.deceleration_max
        slow, fast = self.cell_speeds[:, 0], self.cell_speeds[:, 1]
        least, most = self.cell_load_factors[:, 0], self.cell_load_factors[:, 1]
        gained = self.cell_along[:, 0] + limits.deceleration_max * idle.greatest_rise(slow, fast, most)
        return xp.max(gained), xp.max(self.cell_along[:, 1] / idle.least_share(slow, fast, least))


def _bernstein_coefficients(
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


def _square(a: Float[Array, "cells axes n"]) -> Cells:
    return jnp.sum(bernstein.product(a, a), axis=1)


def _wind_error(
    wind: AbstractWind, down: Cells, slope: Float[Array, "cells 3 5"], drifting: Float[Array, " cells"]
) -> Float[Array, " cells"]:
    """Bound of |slope of the drift - wind| per cell."""
    if isinstance(wind, SteadyWind):
        off = jnp.max(jnp.abs(slope - wind.velocity_n[None, :, None]), axis=2)
        return jnp.where(drifting, safe_sqrt(jnp.sum(off**2, axis=1)), 0.0)
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
        # A cell that ends at the layer's edge, to rounding, is in the next one: what that leaves out is added.
        under = (high < bottom + _EDGE_M) & (low < bottom - _EDGE_M)
        over = (low > top - _EDGE_M) & (high > top + _EDGE_M)
        left_out = _EDGE_M * safe_sqrt(jnp.sum(rate**2))
        return jnp.where(under | over, left_out * ((low <= top) & (high >= bottom)), safe_sqrt(jnp.sum(off**2, axis=1)))

    return jnp.where(drifting, jnp.max(jax.vmap(layer)(bottoms, tops, first, last), axis=0), 0.0)


def _bank_and_load(
    velocity: Float[Array, "cells 3 5"],
    acceleration: Float[Array, "cells 3 4"],
    squares: tuple[Cells, Cells],
    error: Float[Array, " cells"],
    gravity: ScalarLike,
) -> tuple[Float[Array, " cells"], Float[Array, " cells"], Float[Array, " cells"]]:
    """Bounds of the bank angle, rad, and of the load factor in coordinated flight from above and below, per cell.

    With L the horizontal and V the whole airspeed, both are ratios of polynomials: of the acceleration across,
    A / L, and of the lift, D / (V L), A = v x a and D = L^2 up - climb (v . a). A ratio of two polynomials in Bernstein
    form is, where the lower one's coefficients are positive, a weighted mean of the coefficients' ratios.

    Parameters
    ----------
    velocity, acceleration
        Coefficients, through the air and over the ground.
    squares
        V^2 and L^2.
    error
        By how much the velocity may be off, m/s.
    gravity
        m/s^2.
    """
    square, level_square = squares
    north, east, down = (velocity[:, k] for k in range(3))
    to_north, to_east, to_down = (acceleration[:, k] for k in range(3))
    across = bernstein.product(north, to_east) - bernstein.product(east, to_north)
    along = bernstein.product(north, to_north) + bernstein.product(east, to_east)
    lifting = bernstein.product(level_square, gravity - to_down) + bernstein.product(down, along)
    side_square = bernstein.product(bernstein.product(across, across), square)
    lift_square = bernstein.product(lifting, lifting)
    both = bernstein.product(square, level_square)
    both = bernstein.elevate(both, lift_square.shape[-1] - 1)

    level_low, level_high = _root_bounds(level_square, error)
    speed_low, speed_high = _root_bounds(square, error)
    a_max = safe_sqrt(bernstein.bounds(_square(acceleration))[1])
    lift_low = bernstein.bounds(lifting)[0]
    # What an error of the velocity adds: to A, and to D.
    more_across = error * a_max
    more_lifting = error * (2.0 * level_high + error) * jnp.max(jnp.abs(gravity - to_down), axis=1)
    more_lifting = more_lifting + error * (jnp.max(jnp.abs(along), axis=1) + a_max * jnp.max(jnp.abs(down), axis=1))
    more_lifting = more_lifting + error**2 * a_max
    least = lift_low - more_lifting
    banked = (least > 0.0) & (speed_low > 0.0) & (level_low > 0.0)
    safe, slow, narrow = (jnp.where(banked, x, 1.0) for x in (least, speed_low, level_low))
    tangent = safe_sqrt(_ratio_max(side_square, lift_square, banked)) + more_across * speed_high / safe
    tangent = tangent * (1.0 + error / slow) * (safe + more_lifting) / safe
    load = safe_sqrt(_ratio_max(side_square + lift_square, both, banked)) + more_across / narrow
    load = (load + more_lifting / (slow * narrow)) * (1.0 + error / slow) * (1.0 + error / narrow)
    # Upside down or too slow to tell: the acceleration and gravity together bound the load even so.
    return (
        jnp.where(banked, jnp.arctan(tangent), jnp.pi / 2),
        jnp.where(banked, load / gravity, a_max / gravity + 1.0),
        jnp.where(banked, least / (jnp.maximum(speed_high * level_high, _TINY) * gravity), 0.0),
    )


def _ratio_max(upper: Cells, lower: Cells, sound: Bool[Array, " cells"]) -> Float[Array, " cells"]:
    """Bound of a ratio of polynomials; where not sound, 1."""
    safe = jnp.where(sound[:, None] & (lower > 0.0), lower, 1.0)
    return jnp.where(sound, jnp.max(upper / safe, axis=1), 1.0)


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
    ground, velocity_g, acceleration = _bernstein_coefficients(air + path.drift_n, safe)
    _, drift_slope, _ = _bernstein_coefficients(path.drift_n, safe)
    velocity = velocity_g - drift_slope
    error = _wind_error(wind, ground[:, 2], drift_slope, real)

    def least(low: Array) -> Scalar:
        return jnp.min(jnp.where(real, low, jnp.inf))

    def most(high: Array) -> Scalar:
        return jnp.max(jnp.where(real, high, -jnp.inf))

    square, level_square = _square(velocity), _square(velocity[:, :2])
    speed_low, speed_high = _root_bounds(square, error)
    a_max = safe_sqrt(bernstein.bounds(_square(acceleration))[1])
    slow, fast = jnp.maximum(speed_low, _TINY), jnp.maximum(speed_high, _TINY)

    up_rate_low, up_rate_high = bernstein.bounds(-velocity[:, 2])
    up_rate_low, up_rate_high = up_rate_low - error, up_rate_high + error
    climb = jnp.maximum(jnp.abs(up_rate_low), jnp.abs(up_rate_high))
    bank, load, load_low = _bank_and_load(velocity, acceleration, (square, level_square), error, gravity)

    # V V_dot = v . a for the air's own velocity; the drift's share is a few hundredths.
    work = jnp.sum(bernstein.product(velocity, acceleration), axis=1) + gravity * bernstein.elevate(-velocity[:, 2], 7)
    margin = error * (a_max + gravity)
    # The speed with which it is compared may be off by the error.
    off = 1.0 + error / slow
    forward = off * _ratio_to_root_max(work, square, slow, fast) + margin / slow
    backward = off * _ratio_to_root_max(-work, square, slow, fast) + margin / slow
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
        cell_acceleration=jnp.where(real, a_max, 0.0),
        cell_along=jnp.where(real[:, None], jnp.stack([forward, backward], axis=-1), 0.0),
        cell_speeds=jnp.stack([speed_low, speed_high], axis=-1),
        cell_load_factors=jnp.stack([load_low, jnp.where(real, load, 0.0)], axis=-1),
    )


def _ratio_to_root_max(
    upper: Cells, square: Cells, slow: Float[Array, " cells"], fast: Float[Array, " cells"]
) -> Float[Array, " cells"]:
    """Bound of a polynomial over the root of another, a root from `slow` to `fast`; 0 where it is negative all over.

    For any m the root of s is at least 2 m s / (m^2 + s), and nearly that where m is close to it.
    """
    middle = 0.5 * (slow + fast)
    scaled = square / (middle**2)[:, None]
    raised = bernstein.product(upper, 1.0 + scaled)
    sound = jnp.min(scaled, axis=1) > 0.0
    ratio = _ratio_max(raised, bernstein.elevate(2.0 * scaled, raised.shape[-1] - 1), sound) / middle
    return jnp.maximum(jnp.where(sound, ratio, jnp.max(upper, axis=1) / slow), 0.0)


def _root_bounds(square: Cells, error: Float[Array, " cells"]) -> tuple[Array, Array]:
    """Bounds of a length from its square's coefficients, widened by an error."""
    low, high = bernstein.bounds(square)
    return jnp.maximum(safe_sqrt(low) - error, 0.0), safe_sqrt(high) + error


def excess(
    bounds: PathBounds, limits: PathLimits, limits_checked: tuple[Limit, ...] = CERTIFIED_LIMITS
) -> Float[Array, " limits"]:
    """By how much a path's bounds pass each limit, as a part of it; not positive where it is kept."""
    along: dict[str, Any] = dict(
        zip(("acceleration_max", "deceleration_max"), bounds.along_at_start(limits), strict=True)
    )
    values = [along.get(limit.field, getattr(bounds, limit.field)) for limit in limits_checked]
    return jnp.stack(
        [limit.excess(value, getattr(limits, limit.field)) for limit, value in zip(limits_checked, values, strict=True)]
    )
