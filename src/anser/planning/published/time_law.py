"""When a path is where: the clock of a trajectory.

Two laws. The published one (theory section 6) lets the path's parameter s run evenly with time; the airspeed then
varies along a bent path, by a quarter in the published three-aircraft case, with decelerations of 3.5 m/s^2 that a
clean F-16 cannot make. The even one flies the same path at an airspeed that changes evenly from the first to the last,
unless the path falls more steeply than the aircraft glides with the engine idle: there it lets height become speed, as
it must. Both arrive at the same instant with the same mean speed.
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
BRAKING_RESERVE_M_S2 = 0.2  # left to the autopilot, and to the engine's spooling down
_RULE = gauss_legendre(4)  # per cell: together 128 nodes, exact to rounding for paths that are not tight
# 20,000 random plans took 16 braking steps at most, and 3 clock steps to rounding where the path is not tight.
_BRAKING_STEPS = 20
_CLOCK_STEPS = 3
_SLOWEST = 0.3  # part of the mean speed below which no law goes
_TINY = 1e-9
_SAME_INSTANT_S = 1e-6


def _collocation() -> Float[np.ndarray, "rule rule"]:
    """Weights that integrate, from 0 to each node of the rule, what is known at its nodes."""
    powers = np.arange(_RULE.nodes.size)
    ascending = _RULE.nodes[:, None] ** powers
    return (_RULE.nodes[:, None] * ascending / (powers + 1)) @ np.linalg.inv(ascending)


_TO_NODES = _collocation()


def path_derivative(coefficients_n: Float[Array, "3 5"], s: ScalarLike, order: int) -> Vector3:
    """Derivative of order 0 to 3 of the path with respect to s, m."""
    factors = np.ones(5 - order)
    for lowered in range(order):
        factors *= np.arange(order, 5) - lowered
    *lower, total = jnp.unstack(jnp.asarray(factors, coefficients_n.dtype)[None, :] * coefficients_n[:, order:], axis=1)
    for coefficient in reversed(lower):
        total = total * s + coefficient
    return total


class Clock(eqx.Module):
    """Path parameter with its first two rates."""

    s: Scalar
    s_dot: Scalar
    s_ddot: Scalar


class Cell(eqx.Module):
    """A stretch of a path from s to s + h, seen at the nodes of the rule."""

    slopes: Float[Array, " rule"]
    """|dr/ds|, m."""
    length_to_node: Float[Array, " rule"]
    """Length from its start, m."""
    energy_gain: Float[Array, " rule"]
    """Energy per mass that the height lost from its start sets free, m^2/s^2."""
    length: Scalar
    """Of the whole stretch, m."""

    def time(self, squares: Float[Array, " rule"], width: ScalarLike) -> Scalar:
        """Time to fly it, s, at given squared airspeeds at the nodes."""
        return width * jnp.sum(jnp.asarray(_RULE.weights, squares.dtype) * self.slopes / jnp.sqrt(squares))


def _between(value: ScalarLike, low: ScalarLike, high: ScalarLike) -> Scalar:
    """Clip with the full slope at the ends themselves."""
    return jnp.where(value < low, low, jnp.where(value > high, high, value))


def _cell(coefficients_n: Float[Array, "3 5"], s: ScalarLike, width: ScalarLike) -> Cell:
    points = s + width * jnp.asarray(_RULE.nodes, coefficients_n.dtype)
    slopes = jax.vmap(lambda x: norm(path_derivative(coefficients_n, x, 1)))(points)
    down = jax.vmap(lambda x: path_derivative(coefficients_n, x, 0)[2])(points)
    return Cell(
        slopes=slopes,
        length_to_node=width * jnp.sum(jnp.asarray(_TO_NODES, slopes.dtype) * slopes[None, :], axis=1),
        energy_gain=STANDARD_GRAVITY_M_S2 * (down - path_derivative(coefficients_n, s, 0)[2]),
        length=width * jnp.sum(jnp.asarray(_RULE.weights, slopes.dtype) * slopes),
    )


class TimeLaw(eqx.Module):
    """How the path's parameter runs with time; the fields from `exchange` on describe the even law.

    Attributes
    ----------
    even
        Whether the speed changes evenly; otherwise s does.
    exchange
        Energy exchange: part of the potential energy lost that becomes kinetic, 0 to 1.
    braking
        Deceleration along the path but for that exchange, m/s^2.
    slowest
        Least airspeed, m/s: a law that asks for less is held there.
    slopes
        |dr/ds| at s = k / CELLS, m.
    squares
        Square of the airspeed that the law asks for there, m^2/s^2.
    times
        When the path is there, s after the start.
    """

    even: Flag
    exchange: Scalar
    braking: Scalar
    slowest: Scalar
    slopes: Float[Array, " nodes"]
    squares: Float[Array, " nodes"]
    times: Float[Array, " nodes"]

    def clock(self, coefficients_n: Float[Array, "3 5"], elapsed: ScalarLike, duration: ScalarLike) -> Clock:
        """Path parameter `elapsed` seconds after the start of a path of `duration` seconds."""
        held = _between(elapsed, 0.0, self.times[-1])
        k = jnp.sum(held >= self.times[1:-1], dtype=jnp.int32)
        ahead = self._ahead(coefficients_n, k, held - self.times[k])
        s = k.astype(ahead.dtype) / CELLS + ahead
        slope_n, bend_n = path_derivative(coefficients_n, s, 1), path_derivative(coefficients_n, s, 2)
        slope, speed, held_up, _ = self._motion(coefficients_n, k, ahead)
        s_dot = speed / slope
        gained = self.exchange * STANDARD_GRAVITY_M_S2 * slope_n[2] / slope
        acceleration = jnp.where(held_up, 0.0, gained - self.braking)
        # Beyond the ends s runs on evenly: a fleet that holds has left its path. Rounding is not beyond.
        inside = jnp.abs(elapsed - held) <= max(_SAME_INSTANT_S, time_rounding(held))
        s_ddot = jnp.where(inside, (acceleration - jnp.sum(slope_n * bend_n) / slope * s_dot**2) / slope, 0.0)
        return Clock(
            s=jnp.where(self.even, s + s_dot * (elapsed - held), elapsed / duration),
            s_dot=jnp.where(self.even, s_dot, 1.0 / duration),
            s_ddot=jnp.where(self.even, s_ddot, 0.0),
        )

    def _asked(self, k: Count, energy_gain: Array, length_to_node: Array) -> Array:
        """Square of the airspeed asked for in cell k after some height and length from its start."""
        return self.squares[k] + 2 * (self.exchange * energy_gain - self.braking * length_to_node)

    def _motion(
        self, coefficients_n: Float[Array, "3 5"], k: Count, ahead: Scalar
    ) -> tuple[Scalar, Scalar, Flag, Scalar]:
        """|dr/ds|, airspeed, whether it is held at the least, and time (s), at a parameter from the start of cell k."""
        start = k.astype(ahead.dtype) / CELLS
        cell = _cell(coefficients_n, start, ahead)
        slope = jnp.maximum(norm(path_derivative(coefficients_n, start + ahead, 1)), _TINY)
        down = path_derivative(coefficients_n, start + ahead, 0) - path_derivative(coefficients_n, start, 0)
        asked = self._asked(k, STANDARD_GRAVITY_M_S2 * down[2], cell.length)
        time = cell.time(jnp.maximum(self._asked(k, cell.energy_gain, cell.length_to_node), self.slowest**2), ahead)
        return slope, jnp.sqrt(jnp.maximum(asked, self.slowest**2)), asked < self.slowest**2, time

    def _ahead(self, coefficients_n: Float[Array, "3 5"], k: Count, within: ScalarLike) -> Scalar:
        """Parameter from the start of cell k, `within` seconds on: Newton from a cubic through the ends.

        Only the last step is differentiated: from the solution it carries the whole derivative.
        """
        law, path, elapsed = jax.lax.stop_gradient((self, coefficients_n, jnp.asarray(within)))
        h = 1.0 / CELLS
        span = jnp.maximum(law.times[k + 1] - law.times[k], _TINY)
        speeds = jnp.sqrt(jnp.maximum(jnp.stack([law.squares[k], law.squares[k + 1]]), law.slowest**2))
        m0, m1 = span * speeds[0] / law.slopes[k], span * speeds[1] / law.slopes[k + 1]
        u = elapsed / span
        ahead = u * (m0 + u * (3 * h - 2 * m0 - m1 + u * (m0 + m1 - 2 * h)))

        def closer(law: TimeLaw, path: Float[Array, "3 5"], elapsed: ScalarLike, ahead: Scalar) -> Scalar:
            ahead = jnp.clip(ahead, 0.0, h)
            slope, speed, _, time = law._motion(path, k, ahead)
            return ahead - (time - elapsed) * jax.lax.stop_gradient(speed / slope)

        ahead = jax.lax.fori_loop(0, _CLOCK_STEPS - 1, lambda _, x: closer(law, path, elapsed, x), ahead)
        return closer(self, coefficients_n, within, ahead)

    @property
    def speeds(self) -> Float[Array, "*fleet nodes"]:
        """Airspeed at s = k / CELLS, m/s."""
        return jnp.sqrt(jnp.maximum(self.squares, self.slowest[..., None] ** 2))


def published_law() -> TimeLaw:
    """The parameter runs evenly with time."""
    nodes, ones = jnp.linspace(0.0, 1.0, CELLS + 1), jnp.ones(CELLS + 1)
    zero = jnp.zeros(())
    return TimeLaw(jnp.asarray(False), zero, zero, jnp.ones(()), ones, ones, nodes)


class _Profile(eqx.Module):
    """The even law of one path, but for its braking."""

    cells: Cell
    """Stacked."""
    lengths: Float[Array, " nodes"]
    """From the start, m."""
    energy_gain: Float[Array, " nodes"]
    """From the start, m^2/s^2."""
    exchange: Scalar
    speed_0: Scalar
    duration: Scalar
    slowest: Scalar

    def squares(self, braking: Scalar) -> Float[Array, " nodes"]:
        """Square of the airspeed asked for at the ends of the cells, m^2/s^2."""
        return self.speed_0**2 + 2 * (self.exchange * self.energy_gain - braking * self.lengths)

    def times(self, braking: Scalar) -> Float[Array, " nodes"]:
        """When they are passed, s after the start."""

        def time(cell: Cell, square: Scalar) -> Scalar:
            squares = square + 2 * (self.exchange * cell.energy_gain - braking * cell.length_to_node)
            return cell.time(jnp.maximum(squares, self.slowest**2), 1.0 / CELLS)

        spans = jax.vmap(time)(self.cells, self.squares(braking)[:-1])
        return jnp.concatenate([jnp.zeros(1), jnp.cumsum(spans)])


def _lateness(braking: Scalar, profile: _Profile) -> tuple[Scalar, Scalar]:
    """How much later than wanted the path ends with some braking, s, and its slope."""
    return jax.jvp(lambda e: profile.times(e)[-1] - profile.duration, (braking,), (jnp.ones_like(braking),))


def _solve_braking(profile: _Profile) -> Scalar:
    """The braking with which the path takes its duration: the time rises with it."""
    total, v0 = jnp.maximum(profile.lengths[-1], _TINY), profile.speed_0
    mean = total / profile.duration
    traded = profile.exchange * profile.energy_gain
    first = jnp.maximum(profile.lengths[1], _TINY)
    # From the first node on at twice the mean speed: too early. There at the least speed: too late.
    low = -(2 * mean**2 - jnp.min(traded)) / first
    high = (0.5 * v0**2 + jnp.max(traded)) / first
    last = jnp.maximum(2 * mean - v0, 0.5 * mean)
    guess = (traded[-1] - (last**2 - v0**2) / 2) / total
    return bracketed_newton(_lateness, profile, low, high, guess, _BRAKING_STEPS).x


def _least_exchange(
    coefficients_n: Float[Array, "3 5"],
    lengths: Float[Array, " nodes"],
    energy_gain: Float[Array, " nodes"],
    slopes: Float[Array, " nodes"],
    speed_0: Scalar,
    mean_speed: Scalar,
    deceleration: ScalarLike,
) -> Scalar:
    """Least energy exchange, to first order, with which the path needs no more braking than there is at its steepest.

    There it needs (1 - exchange) g (-dh/dl) + e, and to first order in the changes of speed e = base + exchange * mean:
    without exchange the speed ends as far from the mean as it began; speed gained early is braked off on the whole
    path.
    """
    edges, total = jnp.asarray(np.linspace(0.0, 1.0, CELLS + 1)), jnp.maximum(lengths[-1], _TINY)
    fall = jax.vmap(lambda s: path_derivative(coefficients_n, s, 1)[2])(edges) / slopes
    steepest = STANDARD_GRAVITY_M_S2 * jnp.max(fall)
    base = 2 * mean_speed * (speed_0 - mean_speed) / total
    early = jnp.sum((lengths[1:] - lengths[:-1]) * (energy_gain[1:] + energy_gain[:-1])) / total
    mean = jnp.maximum(energy_gain[-1], early) / total
    excess = steepest + base - (deceleration - BRAKING_RESERVE_M_S2)
    return jnp.clip(excess / jnp.maximum(steepest - mean, 1e-3), 0.0, 1.0)


def even_law(
    coefficients_n: Float[Array, "3 5"],
    duration: ScalarLike,
    speed_0: ScalarLike,
    deceleration: ScalarLike | None = None,
    exchange: ScalarLike | None = None,
    even: Flag | bool = True,
) -> TimeLaw:
    """The path flown in `duration` seconds, from `speed_0` (m/s), with constant braking along it.

    V dV/dl = exchange g (-dh/dl) - e: the braking e is solved for the duration, by safeguarded Newton on the time of
    the path, which rises with it. With exchange 0 the acceleration is constant (on a path of fitting length the speed);
    with 1 the throttle is. The speed never falls below 0.3 of the mean.

    Parameters
    ----------
    coefficients_n
        The path.
    duration
        s.
    speed_0
        Airspeed at its start.
    deceleration
        That the aircraft can hold with the engine idle in level flight, m/s^2: the exchange is about the least with
        which the path asks for no more, in closed form. Without it, nothing is traded.
    exchange
        Given instead of found.
    even
        False gives the published law.
    """
    coefficients_n = jnp.asarray(coefficients_n)
    edges = jnp.asarray(np.linspace(0.0, 1.0, CELLS + 1))
    cells = jax.vmap(lambda s: _cell(coefficients_n, s, 1.0 / CELLS))(edges[:-1])
    lengths = jnp.concatenate([jnp.zeros(1), jnp.cumsum(cells.length)])
    gained = STANDARD_GRAVITY_M_S2 * jax.vmap(lambda s: path_derivative(coefficients_n, s, 0)[2])(edges)
    gained = gained - gained[0]
    slopes = jnp.maximum(jax.vmap(lambda s: norm(path_derivative(coefficients_n, s, 1)))(edges), _TINY)
    total = jnp.maximum(lengths[-1], _TINY)
    mean_speed = total / duration
    speed_0 = jnp.asarray(speed_0, dtype=float)
    if exchange is None:
        exchange = jnp.zeros(())
        if deceleration is not None:
            exchange = _least_exchange(coefficients_n, lengths, gained, slopes, speed_0, mean_speed, deceleration)
    profile = _Profile(
        cells, lengths, gained, jnp.asarray(exchange, dtype=float), speed_0, total / mean_speed, _SLOWEST * mean_speed
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
