"""Time law of a trajectory: path parameter over time.

There are two laws. With the published law (theory section 6), the path parameter s is linear in time; the airspeed then
varies along a bent path, by a quarter in the published three-aircraft case, with decelerations of 3.5 m/s^2 that a
clean F-16 cannot fly. With the even law, the airspeed on the same path changes evenly from the first to the last,
unless the path is steeper than the glide with the engine idle: the necessary part of the height is then converted to
speed. Both laws have the same arrival time and mean speed.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.constants import STANDARD_GRAVITY_M_S2
from anser.numerics.integration import gauss_legendre
from anser.numerics.roots import bracketed_newton
from anser.parts.paths import time_rounding
from anser.shapes import Count, Flag, Scalar, ScalarLike, Vector3
from anser.spatial.vectors import norm

CELLS = 32
BRAKING_RESERVE_M_S2 = 0.2  # reserve for the autopilot and for the engine's spool-down
_RULE = gauss_legendre(4)  # per cell: 128 nodes in total, exact to rounding except for tight paths
# 20,000 random plans needed at most 16 braking steps, and 3 clock steps to rounding except for tight paths.
_BRAKING_STEPS = 20
_CLOCK_STEPS = 3
_SPEED_SHARE_MIN = 0.3  # least airspeed, fraction of the mean speed
_TINY = 1e-9
_SAME_INSTANT_S = 1e-6


def _collocation() -> Float[np.ndarray, "rule rule"]:
    """Weights that integrate a function, given at the rule's nodes, from 0 to each node."""
    powers = np.arange(_RULE.nodes.size)
    ascending = _RULE.nodes[:, None] ** powers
    return (_RULE.nodes[:, None] * ascending / (powers + 1)) @ np.linalg.inv(ascending)


_NODE_WEIGHTS = _collocation()


def path_derivative(coefficients_n: Float[Array, "3 5"], s: ScalarLike, order: int) -> Vector3:
    """Derivative of the path with respect to s, m, of order 0 (position) to 3."""
    factors = np.ones(5 - order)
    for reduction in range(order):
        factors *= np.arange(order, 5) - reduction
    *lower, total = jnp.unstack(jnp.asarray(factors, coefficients_n.dtype)[None, :] * coefficients_n[:, order:], axis=1)
    for coefficient in reversed(lower):
        total = total * s + coefficient
    return total


class Clock(eqx.Module):
    """Path parameter `s` at one time, with its first time derivative (1/s) and its second (1/s^2)."""

    s: Scalar
    s_dot: Scalar
    s_ddot: Scalar


class Cell(eqx.Module):
    """Lengths and energy along one section of a path, from s to s + h, at the nodes of the quadrature rule."""

    slopes: Float[Array, " rule"]  # |dr/ds| at the nodes, m
    length_to_node: Float[Array, " rule"]  # length from the start of the cell to each node, m
    # potential energy per mass released from the start of the cell to each node, m^2/s^2
    energy_gain: Float[Array, " rule"]
    length: Scalar  # length of the cell, m

    def time(self, squares: Float[Array, " rule"], width: ScalarLike) -> Scalar:
        """Flight time through the cell, s, for squared airspeeds at the nodes (m^2/s^2)."""
        return width * jnp.sum(jnp.asarray(_RULE.weights, squares.dtype) * self.slopes / jnp.sqrt(squares))


def _clip(value: ScalarLike, low: ScalarLike, high: ScalarLike) -> Scalar:
    """Clip a value to bounds, with the full derivative at the bounds."""
    return jnp.where(value < low, low, jnp.where(value > high, high, value))


def _cell(coefficients_n: Float[Array, "3 5"], s: ScalarLike, width: ScalarLike) -> Cell:
    points = s + width * jnp.asarray(_RULE.nodes, coefficients_n.dtype)
    slopes = jax.vmap(lambda x: norm(path_derivative(coefficients_n, x, 1)))(points)
    down = jax.vmap(lambda x: path_derivative(coefficients_n, x, 0)[2])(points)
    return Cell(
        slopes=slopes,
        length_to_node=width * jnp.sum(jnp.asarray(_NODE_WEIGHTS, slopes.dtype) * slopes[None, :], axis=1),
        energy_gain=STANDARD_GRAVITY_M_S2 * (down - path_derivative(coefficients_n, s, 0)[2]),
        length=width * jnp.sum(jnp.asarray(_RULE.weights, slopes.dtype) * slopes),
    )


class TimeLaw(eqx.Module):
    """Path parameter over time; the fields from `exchange` on describe the even law."""

    even: Flag  # whether the speed changes evenly; otherwise s is linear in time
    exchange: Scalar  # energy exchange: fraction of the potential energy lost that becomes kinetic, 0 to 1
    braking: Scalar  # deceleration along the path in addition to the exchange, m/s^2
    slowest: Scalar  # least airspeed, m/s: lower demands are limited to this speed
    slopes: Float[Array, " nodes"]  # |dr/ds| at s = k / CELLS, m
    squares: Float[Array, " nodes"]  # square of the airspeed demanded at s = k / CELLS, m^2/s^2
    times: Float[Array, " nodes"]  # time at s = k / CELLS, s after the start

    def clock(self, coefficients_n: Float[Array, "3 5"], elapsed: ScalarLike, duration: ScalarLike) -> Clock:
        """Path parameter `elapsed` seconds after the start of a path of `duration` seconds."""
        clipped = _clip(elapsed, 0.0, self.times[-1])
        k = jnp.sum(clipped >= self.times[1:-1], dtype=jnp.int32)
        offset = self._offset_in_cell(coefficients_n, k, clipped - self.times[k])
        s = k.astype(offset.dtype) / CELLS + offset
        slope_n, bend_n = path_derivative(coefficients_n, s, 1), path_derivative(coefficients_n, s, 2)
        slope, speed, at_speed_min, _ = self._motion(coefficients_n, k, offset)
        s_dot = speed / slope
        exchange_acceleration = self.exchange * STANDARD_GRAVITY_M_S2 * slope_n[2] / slope
        acceleration = jnp.where(at_speed_min, 0.0, exchange_acceleration - self.braking)
        # Beyond the ends (by more than rounding), s continues linearly: a holding fleet has left its path.
        is_on_path = jnp.abs(elapsed - clipped) <= max(_SAME_INSTANT_S, time_rounding(clipped))
        s_ddot = jnp.where(is_on_path, (acceleration - jnp.sum(slope_n * bend_n) / slope * s_dot**2) / slope, 0.0)
        return Clock(
            s=jnp.where(self.even, s + s_dot * (elapsed - clipped), elapsed / duration),
            s_dot=jnp.where(self.even, s_dot, 1.0 / duration),
            s_ddot=jnp.where(self.even, s_ddot, 0.0),
        )

    def _demanded_square(self, k: Count, energy_gain: Array, length_to_node: Array) -> Array:
        """Square of the demanded airspeed, m^2/s^2, after an energy gain (m^2/s^2) and a length (m) in cell `k`."""
        return self.squares[k] + 2 * (self.exchange * energy_gain - self.braking * length_to_node)

    def _motion(
        self, coefficients_n: Float[Array, "3 5"], k: Count, offset: Scalar
    ) -> tuple[Scalar, Scalar, Flag, Scalar]:
        """Return |dr/ds| (m), airspeed (m/s), whether it is the least, and time (s), at an offset of s in cell `k`."""
        start = k.astype(offset.dtype) / CELLS
        cell = _cell(coefficients_n, start, offset)
        slope = jnp.maximum(norm(path_derivative(coefficients_n, start + offset, 1)), _TINY)
        down = path_derivative(coefficients_n, start + offset, 0) - path_derivative(coefficients_n, start, 0)
        demanded = self._demanded_square(k, STANDARD_GRAVITY_M_S2 * down[2], cell.length)
        time = cell.time(
            jnp.maximum(self._demanded_square(k, cell.energy_gain, cell.length_to_node), self.slowest**2), offset
        )
        return slope, jnp.sqrt(jnp.maximum(demanded, self.slowest**2)), demanded < self.slowest**2, time

    def _offset_in_cell(self, coefficients_n: Float[Array, "3 5"], k: Count, time_in_cell: ScalarLike) -> Scalar:
        """Path parameter s minus its value at the start of cell `k`, `time_in_cell` seconds later; no unit.

        The value follows from Newton steps. The initial guess is the Hermite cubic of s over time in the cell.
        """
        law, path, elapsed = jax.lax.stop_gradient((self, coefficients_n, jnp.asarray(time_in_cell)))
        h = 1.0 / CELLS
        span = jnp.maximum(law.times[k + 1] - law.times[k], _TINY)
        speeds = jnp.sqrt(jnp.maximum(jnp.stack([law.squares[k], law.squares[k + 1]]), law.slowest**2))
        m0, m1 = span * speeds[0] / law.slopes[k], span * speeds[1] / law.slopes[k + 1]
        u = elapsed / span
        offset = u * (m0 + u * (3 * h - 2 * m0 - m1 + u * (m0 + m1 - 2 * h)))

        def newton_step(law: TimeLaw, path: Float[Array, "3 5"], elapsed: ScalarLike, offset: Scalar) -> Scalar:
            offset = jnp.clip(offset, 0.0, h)
            slope, speed, _, time = law._motion(path, k, offset)
            return offset - (time - elapsed) * jax.lax.stop_gradient(speed / slope)

        offset = jax.lax.fori_loop(0, _CLOCK_STEPS - 1, lambda _, x: newton_step(law, path, elapsed, x), offset)
        return newton_step(self, coefficients_n, time_in_cell, offset)

    @property
    def speeds(self) -> Float[Array, "*fleet nodes"]:
        """Airspeed at s = k / CELLS, m/s."""
        return jnp.sqrt(jnp.maximum(self.squares, self.slowest[..., None] ** 2))


def published_law() -> TimeLaw:
    """Time law with the path parameter linear in time."""
    nodes, ones = jnp.linspace(0.0, 1.0, CELLS + 1), jnp.ones(CELLS + 1)
    zero = jnp.zeros(())
    return TimeLaw(jnp.asarray(False), zero, zero, jnp.ones(()), ones, ones, nodes)


class _Profile(eqx.Module):
    """Data for the even law of one path, before the braking is solved."""

    cells: Cell  # stacked cells
    lengths: Float[Array, " nodes"]  # length from the start, m
    energy_gain: Float[Array, " nodes"]  # potential energy per mass released since the start, m^2/s^2
    exchange: Scalar
    speed_0: Scalar
    duration: Scalar
    slowest: Scalar

    def squares(self, braking: Scalar) -> Float[Array, " nodes"]:
        """Square of the airspeed demanded at the ends of the cells, m^2/s^2."""
        return self.speed_0**2 + 2 * (self.exchange * self.energy_gain - braking * self.lengths)

    def times(self, braking: Scalar) -> Float[Array, " nodes"]:
        """Times at the ends of the cells, s after the start."""

        def time(cell: Cell, square: Scalar) -> Scalar:
            squares = square + 2 * (self.exchange * cell.energy_gain - braking * cell.length_to_node)
            return cell.time(jnp.maximum(squares, self.slowest**2), 1.0 / CELLS)

        spans = jax.vmap(time)(self.cells, self.squares(braking)[:-1])
        return jnp.concatenate([jnp.zeros(1), jnp.cumsum(spans)])


def _lateness(braking: Scalar, profile: _Profile) -> tuple[Scalar, Scalar]:
    """How late the path ends for a braking (m/s^2), s, and the derivative by the braking."""
    return jax.jvp(lambda e: profile.times(e)[-1] - profile.duration, (braking,), (jnp.ones_like(braking),))


def _solve_braking(profile: _Profile) -> Scalar:
    """Find the braking, m/s^2, for which the path takes its duration; the flight time increases with the braking."""
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
    coefficients_n: Float[Array, "3 5"],
    lengths: Float[Array, " nodes"],
    energy_gain: Float[Array, " nodes"],
    slopes: Float[Array, " nodes"],
    speed_0: Scalar,
    mean_speed: Scalar,
    deceleration: ScalarLike,
) -> Scalar:
    """Least energy exchange, to first order, for which the braking at the steepest point is available.

    The steepest point requires (1 - exchange) g (-dh/dl) + e. To first order in speed changes e = base + exchange *
    mean: without exchange the final speed differs from the mean as much as the initial speed; speed gained early is
    braked along the whole path.
    """
    edges, total = jnp.asarray(np.linspace(0.0, 1.0, CELLS + 1)), jnp.maximum(lengths[-1], _TINY)
    fall = jax.vmap(lambda s: path_derivative(coefficients_n, s, 1)[2])(edges) / slopes
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
    # deceleration with the engine idle in level flight, m/s^2: the exchange is about the least for which the path
    # demands no more, in closed form. None: no exchange
    deceleration: ScalarLike | None = None,
    exchange: ScalarLike | None = None,  # prescribed exchange; None: computed
    even: Flag | bool = True,  # False selects the published law
) -> TimeLaw:
    """Time law of a path flown in `duration` seconds from the airspeed `speed_0`, with constant braking.

    V dV/dl = exchange g (-dh/dl) - e: the braking e is solved for the duration, by safeguarded Newton steps on the
    flight time, which increases with e. The exchange is the fraction of the lost potential energy that becomes kinetic:
    with 0 the acceleration is constant (for a matching length, the speed); with 1 the throttle is constant. The speed
    is at least 0.3 of the mean.
    """
    coefficients_n = jnp.asarray(coefficients_n)
    edges = jnp.asarray(np.linspace(0.0, 1.0, CELLS + 1))
    cells = jax.vmap(lambda s: _cell(coefficients_n, s, 1.0 / CELLS))(edges[:-1])
    lengths = jnp.concatenate([jnp.zeros(1), jnp.cumsum(cells.length)])
    released = STANDARD_GRAVITY_M_S2 * jax.vmap(lambda s: path_derivative(coefficients_n, s, 0)[2])(edges)
    released = released - released[0]
    slopes = jnp.maximum(jax.vmap(lambda s: norm(path_derivative(coefficients_n, s, 1)))(edges), _TINY)
    total = jnp.maximum(lengths[-1], _TINY)
    mean_speed = total / duration
    speed_0 = jnp.asarray(speed_0, dtype=float)
    if exchange is None:
        exchange = jnp.zeros(())
        if deceleration is not None:
            exchange = _minimum_exchange(coefficients_n, lengths, released, slopes, speed_0, mean_speed, deceleration)
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
