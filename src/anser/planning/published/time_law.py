"""Time law of a trajectory: path parameter over time.

There are two laws, with the same arrival time and mean speed. In the published law (theory section 6), the path
parameter s is linear in time; the airspeed then varies along a bent path, with decelerations of 3.5 m/s^2 in the
published three-aircraft case. In the even law, the airspeed on the same path changes at a constant rate. If the path is
steeper than the glide with idle engine, the even law also converts the necessary part of the height to speed.
"""

import math
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.constants import STANDARD_GRAVITY_M_S2
from anser.numerics.integration import gauss_legendre
from anser.numerics.roots import bracketed_newton, implicit_root
from anser.parts.paths import time_rounding
from anser.shapes import Flag, Scalar, ScalarLike
from anser.spatial.vectors import norm

CELLS = 32  # number of sections of a path, equal in the path parameter, at whose ends the even law is tabulated
BRAKING_RESERVE_M_S2 = 0.2  # reserve for the autopilot and for the engine's spool-down
_RULE = gauss_legendre(4)  # per cell: 128 nodes in total, exact to rounding except for tight paths
# 20,000 random plans needed at most 16 braking steps, and 3 clock steps to rounding except for tight paths.
_BRAKING_STEPS = 20
_CLOCK_STEPS = 3
_SPEED_SHARE_MIN = 0.3  # least airspeed, fraction of the mean speed
_TINY = 1e-9
_SAME_INSTANT_S = 1e-6


def _collocation() -> Float[np.ndarray, "rule rule"]:
    """Return the matrix that integrates a function from its values at the nodes of the quadrature rule on [0, 1].

    Row i of the matrix belongs to the integral from 0 to node i.
    """
    powers = np.arange(_RULE.nodes.size)
    ascending = _RULE.nodes[:, None] ** powers
    return (_RULE.nodes[:, None] * ascending / (powers + 1)) @ np.linalg.inv(ascending)


# The start of a cell, the nodes and the end; weights of the integrals from the start to each node and to the end.
_CELL_POINTS = np.concatenate([[0.0], _RULE.nodes, [1.0]])
_LENGTH_WEIGHTS = np.vstack([_collocation(), _RULE.weights])

_POWERS = 5
# Factors of the coefficients in the derivatives of order 0 to 3, for ascending powers of the derivative.
_FACTORS = np.array([[math.perm(power + order, order) for power in range(_POWERS)] for order in range(4)], dtype=float)


PathPolynomials = Float[Array, "orders 3 powers"]
"""Coefficients (m) of a path's derivatives by s, for several orders, NED axes and ascending powers of s."""


def path_polynomials(coefficients_n: Float[Array, "3 5"], orders: Sequence[int]) -> PathPolynomials:
    """Return the coefficients of a path's derivatives by the path parameter s; `orders` are 0 (position) to 3."""
    zero = jnp.zeros((), coefficients_n.dtype)
    # Zeros above the highest power: one Horner scheme serves every order, exactly.
    padded = jax.lax.pad(coefficients_n, zero, ((0, 0, 0), (0, max(orders), 0)))
    shifted = jnp.stack([padded[:, order : order + _POWERS] for order in orders])
    return jnp.asarray(_FACTORS[np.asarray(orders), None, :], coefficients_n.dtype) * shifted


def evaluate(polynomials: PathPolynomials, s: Float[Array, " points"]) -> Float[Array, "orders 3 points"]:
    """Return the derivatives of a path at several values of s, (order, NED axis, point), m, by Horner's scheme."""
    *lower, total = jnp.unstack(polynomials[..., None], axis=2)
    s = jnp.broadcast_to(s, (*total.shape[:2], *s.shape))
    for coefficient in reversed(lower):
        total = total * s + coefficient
    return total


def path_derivatives(
    coefficients_n: Float[Array, "3 5"], s: Float[Array, " points"], orders: Sequence[int]
) -> Float[Array, "orders 3 points"]:
    """Return the derivatives (m) of a path by s at several values of s; `orders` are 0 (position) to 3."""
    return evaluate(path_polynomials(coefficients_n, orders), s)


class Clock(eqx.Module):
    """Path parameter at one time, and its rates."""

    s: Scalar  # 0 at the start, 1 at the end of the path
    s_dot: Scalar  # 1/s
    s_ddot: Scalar  # 1/s^2


class Cell(eqx.Module):
    """Section of a path between two values of the path parameter s (0 to 1 along the whole path, no unit).

    The rows of the arrays are the nodes of the quadrature rule in the section, then the end of the section.
    """

    slopes: Float[Array, " rows"]  # |dr/ds|, m
    lengths: Float[Array, " rows"]  # length from the start of the section, m
    # potential energy per mass released since the start of the section, m^2/s^2
    energy_gain: Float[Array, " rows"]

    def time(self, speeds: Float[Array, " rows"], width: ScalarLike) -> Scalar:
        """Return the flight time (seconds) for airspeeds (m/s) at the rows; the path parameter rises by `width`."""
        weighted = jnp.asarray(_RULE.weights, speeds.dtype) * self.slopes[:-1]
        return width * jnp.sum(weighted / speeds[:-1])


def _clip(value: ScalarLike, low: ScalarLike, high: ScalarLike) -> Scalar:
    """Clip a value to bounds, with the derivative 1 at the bounds themselves, where `jnp.clip` has 1/2."""
    return jnp.where(value < low, low, jnp.where(value > high, high, value))


def _cell(path: PathPolynomials, s: ScalarLike, width: ScalarLike) -> Cell:
    """Return the section from s to s + width of a path, from the path's polynomials of order 0 and 1."""
    positions_n, slopes_n = evaluate(path, s + width * jnp.asarray(_CELL_POINTS, path.dtype))
    slopes, down = norm(slopes_n[:, 1:], axis=0), positions_n[2]
    return Cell(
        slopes=slopes,
        lengths=width * jnp.sum(jnp.asarray(_LENGTH_WEIGHTS, slopes.dtype) * slopes[None, :-1], axis=1),
        energy_gain=STANDARD_GRAVITY_M_S2 * (down[1:] - down[0]),
    )


class _CellMotion(eqx.Module):
    """Motion at one value of the path parameter s in a cell."""

    slope: Scalar  # |dr/ds|, m
    speed: Scalar  # airspeed, m/s
    is_slowest: Flag  # whether the airspeed is the least airspeed, because the law demands less
    time: Scalar  # time since the start of the cell, s


class TimeLaw(eqx.Module):
    """Path parameter s (0 to 1, no unit) over time; the fields from `exchange` on are for the even law only.

    The arrays have the values at s = k / CELLS.
    """

    even: Flag  # whether the speed changes evenly; False: s is linear in time
    exchange: Scalar  # fraction (0..1) of the lost potential energy that becomes kinetic
    braking: Scalar  # additional deceleration, m/s^2, see `even_law`
    slowest: Scalar  # least airspeed, m/s
    slopes: Float[Array, " nodes"]  # |dr/ds|, m
    squares: Float[Array, " nodes"]  # square of the airspeed before the limitation to `slowest`, m^2/s^2
    times: Float[Array, " nodes"]  # time after the start, s

    def clock(self, coefficients_n: Float[Array, "3 5"], elapsed: ScalarLike, duration: ScalarLike) -> Clock:
        """Return the path parameter and its rates `elapsed` seconds after the start of a path of `duration` seconds.

        Before the start and after the end of the path, the path parameter continues linearly.
        """
        path = path_polynomials(coefficients_n, (0, 1, 2))
        clipped = _clip(elapsed, 0.0, self.times[-1])
        k = jnp.sum(clipped >= self.times[1:-1], dtype=jnp.int32)
        ends = jax.lax.dynamic_slice_in_dim(jnp.stack([self.times, self.squares, self.slopes]), k, 2, axis=1)
        start, square = k.astype(ends.dtype) / CELLS, ends[1, 0]
        offset = self._offset_in_cell(path[:2], start, ends, clipped - ends[0, 0])
        s = start + offset
        slope_n, bend_n = evaluate(path[1:], s[None])[..., 0]
        motion = self._motion(path[:2], start, square, offset)
        s_dot = motion.speed / motion.slope
        exchange_acceleration = self.exchange * STANDARD_GRAVITY_M_S2 * slope_n[2] / motion.slope
        acceleration = jnp.where(motion.is_slowest, 0.0, exchange_acceleration - self.braking)
        # Beyond the ends (by more than rounding), s continues linearly: a holding fleet has left its path.
        is_on_path = jnp.abs(elapsed - clipped) <= max(_SAME_INSTANT_S, time_rounding(clipped))
        bend = jnp.sum(slope_n * bend_n) / motion.slope
        s_ddot = jnp.where(is_on_path, (acceleration - bend * s_dot**2) / motion.slope, 0.0)
        return Clock(
            s=jnp.where(self.even, s + s_dot * (elapsed - clipped), elapsed / duration),
            s_dot=jnp.where(self.even, s_dot, 1.0 / duration),
            s_ddot=jnp.where(self.even, s_ddot, 0.0),
        )

    def _motion(self, path: PathPolynomials, start: Scalar, square: Scalar, offset: Scalar) -> _CellMotion:
        """Return the motion at the path parameter `start` + `offset` of a cell that begins at `start`.

        `square` is the square of the airspeed demanded at `start`, m^2/s^2.
        """
        cell = _cell(path, start, offset)
        demanded = square + 2 * (self.exchange * cell.energy_gain - self.braking * cell.lengths)
        least = self.slowest**2
        speeds = jnp.sqrt(jnp.maximum(demanded, least))
        return _CellMotion(
            slope=jnp.maximum(cell.slopes[-1], _TINY),
            speed=speeds[-1],
            is_slowest=demanded[-1] < least,
            time=cell.time(speeds, offset),
        )

    def _offset_in_cell(
        self, path: PathPolynomials, start: Scalar, ends: Float[Array, "3 2"], time_in_cell: ScalarLike
    ) -> Scalar:
        """Return the increase of the path parameter s `time_in_cell` seconds after the start of a cell; no unit.

        `start` is s at the start of the cell. Rows of `ends`: time (s), square of the airspeed (m^2/s^2) and slope
        |dr/ds| (m), at both ends of the cell.
        """
        parameters = self, path, start, ends[1, 0], jnp.asarray(time_in_cell)
        fixed, (times, squares, slopes) = jax.lax.stop_gradient((parameters, ends))
        law, fixed_path, _, square, elapsed = fixed
        h = 1.0 / CELLS
        span = jnp.maximum(times[1] - times[0], _TINY)
        m0, m1 = span * jnp.sqrt(jnp.maximum(squares, law.slowest**2)) / slopes
        # first guess: Hermite cubic of s over time
        u = elapsed / span
        offset = u * (m0 + u * (3 * h - 2 * m0 - m1 + u * (m0 + m1 - 2 * h)))

        def newton_step(_: object, offset: Scalar) -> Scalar:
            offset = jnp.clip(offset, 0.0, h)
            motion = law._motion(fixed_path, start, square, offset)
            return offset - (motion.time - elapsed) * (motion.speed / motion.slope)

        return implicit_root(_lateness_in_cell, parameters, jax.lax.fori_loop(0, _CLOCK_STEPS, newton_step, offset))

    @property
    def speeds(self) -> Float[Array, "*fleet nodes"]:
        """Airspeed at s = k / CELLS by the even law, m/s; at least `slowest`."""
        return jnp.sqrt(jnp.maximum(self.squares, self.slowest[..., None] ** 2))


def _lateness_in_cell(
    offset: Scalar, parameters: tuple[TimeLaw, PathPolynomials, Scalar, Scalar, Scalar]
) -> tuple[Scalar, Scalar]:
    """Return the time to an offset of s in a cell minus the required time, s, and the derivative by the offset, s.

    `parameters`: law, path, s at the start of the cell, square of the airspeed there (m^2/s^2), required time (s).
    """
    law, path, start, square, elapsed = parameters
    motion = law._motion(path, start, square, offset)
    return motion.time - elapsed, motion.slope / motion.speed


def published_law() -> TimeLaw:
    """Return the published time law: path parameter linear in time."""
    nodes, ones = jnp.linspace(0.0, 1.0, CELLS + 1), jnp.ones(CELLS + 1)
    zero = jnp.zeros(())
    return TimeLaw(jnp.asarray(False), zero, zero, jnp.ones(()), ones, ones, nodes)


class _Profile(eqx.Module):
    """Data for the even law of one path, before the braking (m/s^2) is solved; the nodes are the ends of the cells."""

    cells: Cell  # sections of the path
    lengths: Float[Array, " nodes"]  # length from the start, m
    energy_gain: Float[Array, " nodes"]  # potential energy per mass released since the start, m^2/s^2
    exchange: Scalar  # as in `TimeLaw`
    speed_0: Scalar  # airspeed at the start, m/s
    duration: Scalar  # s
    slowest: Scalar  # as in `TimeLaw`

    def squares(self, braking: Scalar) -> Float[Array, " nodes"]:
        """Return the square of the airspeed (m^2/s^2) that a braking (m/s^2) demands at the nodes."""
        return self.speed_0**2 + 2 * (self.exchange * self.energy_gain - braking * self.lengths)

    def times(self, braking: Scalar) -> Float[Array, " nodes"]:
        """Return the times at the nodes, in seconds after the start, with a braking (m/s^2)."""

        def time(cell: Cell, square: Scalar) -> Scalar:
            squares = square + 2 * (self.exchange * cell.energy_gain - braking * cell.lengths)
            return cell.time(jnp.sqrt(jnp.maximum(squares, self.slowest**2)), 1.0 / CELLS)

        spans = jax.vmap(time)(self.cells, self.squares(braking)[:-1])
        return jnp.concatenate([jnp.zeros(1), jnp.cumsum(spans)])


def _lateness(braking: Scalar, profile: _Profile) -> tuple[Scalar, Scalar]:
    """Return the flight time with a braking (m/s^2) minus the path's duration, s, and the derivative by the braking."""
    return jax.jvp(lambda e: profile.times(e)[-1] - profile.duration, (braking,), (jnp.ones_like(braking),))


def _solve_braking(profile: _Profile) -> Scalar:
    """Find the braking, m/s^2, with which the flight time is the path's duration."""
    # The flight time increases with the braking.
    total, v0 = jnp.maximum(profile.lengths[-1], _TINY), profile.speed_0
    mean = total / profile.duration
    exchanged_energy = profile.exchange * profile.energy_gain
    first_length = jnp.maximum(profile.lengths[1], _TINY)
    # Bracket: twice the mean speed from the first node on is too early, the least speed too late.
    low = -(2 * mean**2 - jnp.min(exchanged_energy)) / first_length
    high = (0.5 * v0**2 + jnp.max(exchanged_energy)) / first_length
    final_speed = jnp.maximum(2 * mean - v0, 0.5 * mean)
    guess = (exchanged_energy[-1] - (final_speed**2 - v0**2) / 2) / total
    return bracketed_newton(_lateness, profile, low, high, guess, _BRAKING_STEPS).x


def _minimum_exchange(
    lengths: Float[Array, " nodes"],
    energy_gain: Float[Array, " nodes"],
    fall: Float[Array, " nodes"],  # sine of the path angle, down positive
    speed_0: Scalar,
    mean_speed: Scalar,
    deceleration: ScalarLike,
) -> Scalar:
    """Return the least energy exchange (0 to 1), to first order, with which an idle engine decelerates enough.

    The deceleration required at the steepest point is (1 - exchange) g (-dh/dl) + e, for the altitude h, the length l
    and the braking e (see `even_law`). The available deceleration is `deceleration` (engine idle in level flight,
    m/s^2) less a reserve. To first order, e = base + exchange * mean: `base` is the braking from `speed_0` to the final
    speed 2 mean_speed - speed_0, and `mean` is the additional braking, along the whole path, for the exchange 1.
    """
    total = jnp.maximum(lengths[-1], _TINY)
    steepest = STANDARD_GRAVITY_M_S2 * jnp.max(fall)
    base = 2 * mean_speed * (speed_0 - mean_speed) / total
    mean_gain = jnp.sum((lengths[1:] - lengths[:-1]) * (energy_gain[1:] + energy_gain[:-1])) / total
    mean = jnp.maximum(energy_gain[-1], mean_gain) / total
    excess = steepest + base - (deceleration - BRAKING_RESERVE_M_S2)
    return jnp.clip(excess / jnp.maximum(steepest - mean, 1e-3), 0.0, 1.0)


def even_law(
    coefficients_n: Float[Array, "3 5"],
    duration: ScalarLike,
    speed_0: ScalarLike,  # airspeed at the start, m/s
    # deceleration with the engine idle in level flight, m/s^2; the exchange is computed such that the path demands at
    # most about this deceleration. None: the exchange is 0
    deceleration: ScalarLike | None = None,
    exchange: ScalarLike | None = None,  # prescribed exchange (0..1); None: computed
    even: Flag | bool = True,  # False selects the published law
) -> TimeLaw:
    """Return the even time law of a path: the flight starts at the airspeed `speed_0` and takes `duration` seconds.

    The airspeed V over the length l follows V dV/dl = exchange g (-dh/dl) - e, with the altitude h. The braking e
    (m/s^2) is such that the flight time is `duration`. The exchange is the fraction of the lost potential energy that
    becomes kinetic: if 0, the acceleration is constant; if 1, the throttle is constant. V is at least 0.3 of its mean.
    """
    coefficients_n = jnp.asarray(coefficients_n)
    edges = jnp.asarray(np.linspace(0.0, 1.0, CELLS + 1))
    path = path_polynomials(coefficients_n, (0, 1))
    cells = jax.vmap(lambda s: _cell(path, s, 1.0 / CELLS))(edges[:-1])
    lengths = jnp.concatenate([jnp.zeros(1), jnp.cumsum(cells.lengths[:, -1])])
    positions_n, slopes_n = evaluate(path, edges)
    released = STANDARD_GRAVITY_M_S2 * positions_n[2]
    released = released - released[0]
    slopes = jnp.maximum(norm(slopes_n, axis=0), _TINY)
    total = jnp.maximum(lengths[-1], _TINY)
    mean_speed = total / duration
    speed_0 = jnp.asarray(speed_0, dtype=float)
    if exchange is None:
        exchange = jnp.zeros(())
        if deceleration is not None:
            exchange = _minimum_exchange(lengths, released, slopes_n[2] / slopes, speed_0, mean_speed, deceleration)
    profile = _Profile(
        cells,
        lengths,
        released,
        jnp.asarray(exchange, dtype=float),
        speed_0,
        total / mean_speed,
        _SPEED_SHARE_MIN * mean_speed,
    )
    braking = _solve_braking(profile)
    return TimeLaw(
        even=jnp.asarray(even),
        exchange=profile.exchange,
        braking=braking,
        slowest=profile.slowest,
        slopes=slopes,
        squares=profile.squares(braking),
        times=profile.times(braking),
    )
