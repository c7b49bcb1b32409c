"""Bounds of airspeed, bank angle, load factor and other quantities along a timed path, valid between the knots too.

Each cell of the path is a polynomial in time. Its Bernstein coefficients bound position, velocity, acceleration and
products of these; interval arithmetic gives the other bounds. The bounds are rigorous except for rounding. With cells
of one second, they exceed the true extremes by about one per cent.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.environment.environment import AbstractWind, LayeredWind, SteadyWind
from anser.numerics import bernstein
from anser.numerics.arrays import namespace
from anser.planning.certified.fitted_wind import FittedWind
from anser.planning.limits import CERTIFIED_LIMITS, Limit, PathLimits
from anser.planning.timed_path import TimedPath
from anser.shapes import Scalar, ScalarLike
from anser.spatial.vectors import safe_sqrt

Cells = Float[Array, "cells n"]
_TINY = 1e-9
_EDGE_M = 1e-6


class PathBounds(eqx.Module):
    """Proven bounds of the flight quantities along one path in coordinated flight; SI units, rad."""

    # airspeed, m/s
    speed_min: Scalar
    speed_max: Scalar
    # bank angle and load factor required in coordinated flight, rad, 1
    bank_max: Scalar
    load_factor_max: Scalar
    load_factor_min: Scalar  # least lift (`Demand.lift`) over weight
    climb_rate_max: Scalar  # relative to the air, up or down
    # altitude, m
    altitude_min: Scalar
    altitude_max: Scalar
    # upper bounds of V_dot + g sin(gamma), which may be negative, and of -(V_dot + g sin(gamma)), at least 0
    acceleration_max: Scalar
    deceleration_max: Scalar
    wind_error_max: Scalar  # greatest |rate of the path's drift - wind at the aircraft|
    # acceleration over the ground in each cell, m/s^2; for distances between paths
    cell_acceleration: Float[Array, " cells"]
    # per cell: (`acceleration_max`, `deceleration_max`), with (-inf, 0) in an empty cell; (least, greatest) airspeed;
    # (least, greatest) load factor
    cell_along: Float[Array, "cells 2"]
    cell_speeds: Float[Array, "cells 2"]
    cell_load_factors: Float[Array, "cells 2"]

    def along_at_start(self, limits: PathLimits) -> tuple[Any, Any]:
        """Return the limits of acceleration and deceleration, m/s^2, that the path needs.

        `limits.acceleration_max` and `limits.deceleration_max` apply to level flight at the start; `limits.idle`
        converts these limits to other airspeeds and load factors. The path keeps the converted limits everywhere if and
        only if the results are at most `limits.acceleration_max` and `limits.deceleration_max`.
        """
        idle, xp = limits.idle, namespace(self, limits)
        if idle is None:
            return self.acceleration_max, self.deceleration_max
        slow, fast = self.cell_speeds[:, 0], self.cell_speeds[:, 1]
        load_min, load_max = self.cell_load_factors[:, 0], self.cell_load_factors[:, 1]
        equivalents = self.cell_along[:, 0] + limits.deceleration_max * idle.greatest_rise(slow, fast, load_max)
        return xp.max(equivalents), xp.max(self.cell_along[:, 1] / idle.least_share(slow, fast, load_min))


def bernstein_coefficients(
    knots: Float[Array, "knots 3 3"], spans: Float[Array, " cells"]
) -> tuple[Float[Array, "cells 3 6"], Float[Array, "cells 3 5"], Float[Array, "cells 3 4"]]:
    """Return Bernstein coefficients of position, velocity and acceleration in each cell: (cell, axis, coefficient).

    `knots` has (knot, order of derivative, axis); `spans` the durations of the cells, s.
    """
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
    wind: AbstractWind, ground: Float[Array, "cells 3 6"], slope: Float[Array, "cells 3 5"], drifting: Array
) -> Float[Array, " cells"]:
    """Return an upper bound, in each cell, of |rate of the drift - wind|, m/s; 0 in cells outside the mask `drifting`.

    `ground` has the Bernstein coefficients of the position over the ground, `slope` the coefficients of the rate of the
    drift. Raises TypeError for a wind that is not steady, layered or fitted.
    """
    if isinstance(wind, FittedWind):
        residual = wind.residual_max(jnp.min(ground, axis=2), jnp.max(ground, axis=2))
        return _wind_error(wind.layers, ground, slope, drifting) + jnp.where(drifting, residual, 0.0)
    down = ground[:, 2]
    if isinstance(wind, SteadyWind):
        difference = jnp.max(jnp.abs(slope - wind.velocity_n[None, :, None]), axis=2)
        return jnp.where(drifting, safe_sqrt(jnp.sum(difference**2, axis=1)), 0.0)
    if not isinstance(wind, LayeredWind):
        raise TypeError(
            f"no certificate for wind of type {type(wind).__name__}; expected a steady, a layered or a fitted wind"
        )
    low, high = bernstein.bounds(-down)
    slopes = bernstein.elevate(slope, down.shape[-1] - 1)
    # Below the lowest and above the highest altitude the wind is constant.
    edges = wind.altitudes
    floor, ceiling = edges[0] - 1e6, edges[-1] + 1e6
    bottoms = jnp.concatenate([floor[None], edges])
    tops = jnp.concatenate([edges, ceiling[None]])
    lower_winds = jnp.concatenate([wind.velocities_n[:1], wind.velocities_n])
    upper_winds = jnp.concatenate([wind.velocities_n, wind.velocities_n[-1:]])

    def layer(bottom: Scalar, top: Scalar, begin: Array, end: Array) -> Float[Array, " cells"]:
        shear = (end - begin) / jnp.maximum(top - bottom, _TINY)
        wind_n = begin[None, :, None] + shear[None, :, None] * (-down - bottom)[:, None, :]
        difference = jnp.max(jnp.abs(slopes - wind_n), axis=2)
        # A cell that ends at the layer's edge, to rounding, counts for the next layer; the omitted change is added.
        under = (high < bottom + _EDGE_M) & (low < bottom - _EDGE_M)
        over = (low > top - _EDGE_M) & (high > top + _EDGE_M)
        left_out = _EDGE_M * safe_sqrt(jnp.sum(shear**2))
        return jnp.where(
            under | over, left_out * ((low <= top) & (high >= bottom)), safe_sqrt(jnp.sum(difference**2, axis=1))
        )

    return jnp.where(drifting, jnp.max(jax.vmap(layer)(bottoms, tops, lower_winds, upper_winds), axis=0), 0.0)


def _bank_and_load(
    velocity: Float[Array, "cells 3 5"],
    acceleration: Float[Array, "cells 3 4"],
    squares: tuple[Cells, Cells],
    error: Float[Array, " cells"],
    gravity: ScalarLike,
) -> tuple[Float[Array, " cells"], Float[Array, " cells"], Float[Array, " cells"]]:
    """Return bounds per cell in coordinated flight: greatest bank angle (rad), greatest and least load factor.

    Per mass, the side force is A / L and the lift D / (V L), with the airspeed V, the horizontal airspeed L, A = v x a
    and D = L^2 (g + h_ddot) - h_dot (v . a). Here, v and a are the horizontal velocity and acceleration, and h_dot is
    the climb rate. If the lift may be negative, the bound of the bank angle is pi/2.

    The arguments are Bernstein coefficients of the velocity through the air, of the acceleration over the ground, and
    of V^2 and L^2; `error` is the error bound of the velocity, m/s.
    """
    square, level_square = squares
    north, east, down = (velocity[:, k] for k in range(3))
    to_north, to_east, to_down = (acceleration[:, k] for k in range(3))
    across = bernstein.product(north, to_east) - bernstein.product(east, to_north)
    along = bernstein.product(north, to_north) + bernstein.product(east, to_east)
    lifting = bernstein.product(level_square, gravity - to_down) + bernstein.product(down, along)
    side_square = bernstein.product(bernstein.product(across, across), square)
    lift_square = bernstein.product(lifting, lifting)
    speed_product = bernstein.product(square, level_square)
    speed_product = bernstein.elevate(speed_product, lift_square.shape[-1] - 1)

    level_low, level_high = _root_bounds(level_square, error)
    speed_low, speed_high = _root_bounds(square, error)
    a_max = safe_sqrt(bernstein.bounds(_square(acceleration))[1])
    lift_low = bernstein.bounds(lifting)[0]
    # Effect of a velocity error on A and on D.
    across_error = error * a_max
    lift_error = error * (2.0 * level_high + error) * jnp.max(jnp.abs(gravity - to_down), axis=1)
    lift_error = lift_error + error * (jnp.max(jnp.abs(along), axis=1) + a_max * jnp.max(jnp.abs(down), axis=1))
    lift_error = lift_error + error**2 * a_max
    lift_min = lift_low - lift_error
    banked = (lift_min > 0.0) & (speed_low > 0.0) & (level_low > 0.0)
    safe, slow, narrow = (jnp.where(banked, x, 1.0) for x in (lift_min, speed_low, level_low))
    tangent = safe_sqrt(_ratio_max(side_square, lift_square, banked)) + across_error * speed_high / safe
    tangent = tangent * (1.0 + error / slow) * (safe + lift_error) / safe
    load = safe_sqrt(_ratio_max(side_square + lift_square, speed_product, banked)) + across_error / narrow
    load = (load + lift_error / (slow * narrow)) * (1.0 + error / slow) * (1.0 + error / narrow)
    # Inverted or too slow for the ratio: acceleration plus gravity still bounds the load factor.
    return (
        jnp.where(banked, jnp.arctan(tangent), jnp.pi / 2),
        jnp.where(banked, load / gravity, a_max / gravity + 1.0),
        jnp.where(banked, lift_min / (jnp.maximum(speed_high * level_high, _TINY) * gravity), -a_max / gravity - 1.0),
    )


def _ratio_max(upper: Cells, lower: Cells, sound: Bool[Array, " cells"]) -> Float[Array, " cells"]:
    """Return an upper bound of the ratio of two polynomials in each cell, from their Bernstein coefficients.

    In a `sound` cell the coefficients of the denominator `lower` must be positive; in the other cells the result is 1.
    """
    # The ratio of two polynomials is a weighted mean of the ratios of their coefficients.
    safe = jnp.where(sound[:, None] & (lower > 0.0), lower, 1.0)
    return jnp.where(sound, jnp.max(upper / safe, axis=1), 1.0)


def path_bounds(path: TimedPath, wind: AbstractWind, gravity: ScalarLike) -> PathBounds:
    """Compute proven bounds of the flight quantities along a path in a steady, layered or fitted wind.

    Airspeeds are relative to the wind at the aircraft. `gravity` in m/s^2. Raises TypeError for another type of wind.
    """
    spans = path.times[1:] - path.times[:-1]
    nonempty = spans > 0.0
    safe = jnp.where(nonempty, spans, 1.0)
    # The results of an empty cell are finite, but excluded below.
    air = path.air_n
    ground, velocity_g, acceleration = bernstein_coefficients(air + path.drift_n, safe)
    _, drift_slope, _ = bernstein_coefficients(path.drift_n, safe)
    velocity = velocity_g - drift_slope
    error = _wind_error(wind, ground, drift_slope, nonempty)

    def least(low: Array) -> Scalar:
        return jnp.min(jnp.where(nonempty, low, jnp.inf))

    def most(high: Array) -> Scalar:
        return jnp.max(jnp.where(nonempty, high, -jnp.inf))

    square, level_square = _square(velocity), _square(velocity[:, :2])
    speed_low, speed_high = _root_bounds(square, error)
    a_max = safe_sqrt(bernstein.bounds(_square(acceleration))[1])
    slow, fast = jnp.maximum(speed_low, _TINY), jnp.maximum(speed_high, _TINY)

    up_rate_low, up_rate_high = bernstein.bounds(-velocity[:, 2])
    up_rate_low, up_rate_high = up_rate_low - error, up_rate_high + error
    climb = jnp.maximum(jnp.abs(up_rate_low), jnp.abs(up_rate_high))
    bank, load, load_low = _bank_and_load(velocity, acceleration, (square, level_square), error, gravity)

    # V V_dot = v . a with v relative to the air; the drift contributes a few hundredths.
    work = jnp.sum(bernstein.product(velocity, acceleration), axis=1) + gravity * bernstein.elevate(-velocity[:, 2], 7)
    margin = error * (a_max + gravity)
    # The airspeed in the denominator has the velocity error, which also brings a negative ratio nearer to zero.
    speed_ratio_error = 1.0 + error / slow
    ratio = _ratio_to_root_max(work, square, slow, fast)
    forward = jnp.where(ratio < 0.0, 1.0 / speed_ratio_error, speed_ratio_error) * ratio + margin / slow
    backward = speed_ratio_error * jnp.maximum(_ratio_to_root_max(-work, square, slow, fast), 0.0) + margin / slow
    down_low, down_high = bernstein.bounds(ground[:, 2])
    return PathBounds(
        speed_min=least(speed_low),
        speed_max=most(speed_high),
        bank_max=most(bank),
        load_factor_max=most(load),
        load_factor_min=least(load_low),
        climb_rate_max=most(climb),
        altitude_min=least(-down_high),
        altitude_max=most(-down_low),
        acceleration_max=most(forward),
        deceleration_max=most(backward),
        wind_error_max=most(error),
        cell_acceleration=jnp.where(nonempty, a_max, 0.0),
        cell_along=jnp.where(nonempty[:, None], jnp.stack([forward, backward], axis=-1), jnp.array([[-jnp.inf, 0.0]])),
        cell_speeds=jnp.stack([speed_low, speed_high], axis=-1),
        cell_load_factors=jnp.stack([jnp.maximum(load_low, 0.0), jnp.where(nonempty, load, 0.0)], axis=-1),
    )


def _ratio_to_root_max(
    upper: Cells, square: Cells, slow: Float[Array, " cells"], fast: Float[Array, " cells"]
) -> Float[Array, " cells"]:
    """Return an upper bound, per cell, of `upper` / sqrt(`square`), with the root between `slow` and `fast`.

    `upper` and `square` are Bernstein coefficients. For any m, sqrt(s) >= 2 m s / (m^2 + s), a close bound if m is
    close to sqrt(s).
    """
    middle = 0.5 * (slow + fast)
    scaled = square / (middle**2)[:, None]
    raised = bernstein.product(upper, 1.0 + scaled)
    sound = jnp.min(scaled, axis=1) > 0.0
    ratio = _ratio_max(raised, bernstein.elevate(2.0 * scaled, raised.shape[-1] - 1), sound) / middle
    greatest = jnp.max(upper, axis=1)
    ratio = jnp.where(sound, ratio, greatest / slow)
    return jnp.where(ratio < 0.0, jnp.minimum(greatest / fast, 0.0), ratio)


def _root_bounds(square: Cells, error: Float[Array, " cells"]) -> tuple[Array, Array]:
    """Return bounds of a vector's length per cell, widened by `error`, from the coefficients of its square."""
    low, high = bernstein.bounds(square)
    return jnp.maximum(safe_sqrt(low) - error, 0.0), safe_sqrt(high) + error


def excess(
    bounds: PathBounds, limits: PathLimits, limits_checked: tuple[Limit, ...] = CERTIFIED_LIMITS
) -> Float[Array, " limits"]:
    """Return the relative excess (`Limit.excess`) of a path's bounds over each limit; at most 0 within the limit."""
    along: dict[str, Any] = dict(
        zip(("acceleration_max", "deceleration_max"), bounds.along_at_start(limits), strict=True)
    )
    values = [along.get(limit.field, getattr(bounds, limit.field)) for limit in limits_checked]
    return jnp.stack(
        [limit.excess(value, getattr(limits, limit.field)) for limit, value in zip(limits_checked, values, strict=True)]
    )
