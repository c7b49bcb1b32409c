"""When a path is where: the clock of a trajectory.

Two laws. The published one (theory section 6) lets the path's parameter s run evenly with time; the airspeed then
varies along a bent path, by a quarter in the published three-aircraft case, with decelerations of 3.5 m/s^2 that a
clean F-16 cannot make. The even one flies the same path at an airspeed that changes evenly from the first to the last,
unless the path falls more steeply than the aircraft glides with the engine idle: there it lets height become speed, as
it must.
Both arrive at the same instant with the same mean speed.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.constants import STANDARD_GRAVITY_M_S2
from anser.numerics.newton import bracketed_newton
from anser.numerics.quadrature import gauss_legendre
from anser.planning.vectors import norm
from anser.shapes import Flag, Scalar, ScalarLike, Vector3

CELLS = 32
_RULE = gauss_legendre(4)  # per cell: together 128 nodes, exact to rounding for paths of this family
_TINY = 1e-9
BRAKING_RESERVE_M_S2 = 0.2  # left to the autopilot, and to the engine's spooling down
# 22,500 random plans took 16 at most.
_PUSH_STEPS = 20
_LENGTH_STEPS = 2
_SLOWEST = 0.3  # part of the mean speed below which no law goes


def path_derivative(coefficients_n: Float[Array, "3 5"], s: ScalarLike, order: int) -> Vector3:
    """Derivative of order 0 to 3 of the path with respect to s, m."""
    factors = [1.0] * 5
    for power in range(5):
        for lowered in range(order):
            factors[power] *= power - lowered
    total = jnp.zeros(3) + 0.0 * s
    for power in range(4, order - 1, -1):
        total = total * s + factors[power] * coefficients_n[:, power]
    return total


class Clock(eqx.Module):
    """Path parameter with its first two rates."""

    s: Scalar
    s_dot: Scalar
    s_ddot: Scalar


class TimeLaw(eqx.Module):
    """How the path's parameter runs with time; the fields from `trade` on describe the even law.

    Attributes
    ----------
    even
        Whether the speed changes evenly; otherwise s does.
    trade
        Part of the height lost that becomes speed, 0 to 1.
    lengths
        Length of the path up to s = k / CELLS, m.
    slopes
        |dr/ds| there, m.
    speeds, times
        Airspeed there, m/s, and when, s after the start; between them the acceleration along the path is constant.
    """

    even: Flag
    trade: Scalar
    lengths: Float[Array, " nodes"]
    slopes: Float[Array, " nodes"]
    speeds: Float[Array, " nodes"]
    times: Float[Array, " nodes"]

    def clock(self, coefficients_n: Float[Array, "3 5"], elapsed: ScalarLike, duration: ScalarLike) -> Clock:
        """Path parameter `elapsed` seconds after the start of a path of `duration` seconds."""
        k = jnp.sum(elapsed >= self.times[1:-1], dtype=jnp.int32)
        within = elapsed - self.times[k]
        span = jnp.maximum(self.times[k + 1] - self.times[k], _TINY)
        push = (self.speeds[k + 1] - self.speeds[k]) / span
        # Beyond the ends the speed stays: a fleet that holds has left its path.
        inside = (elapsed >= 0.0) & (elapsed <= self.times[-1])
        push = jnp.where(inside, push, 0.0)
        late = elapsed > self.times[-1]
        first = jnp.where(late, self.speeds[-1], self.speeds[k])
        start = jnp.where(late, self.lengths[-1], self.lengths[k])
        within = jnp.where(late, elapsed - self.times[-1], within)
        s = self._parameter(coefficients_n, start + within * (first + 0.5 * push * within))
        speed = first + push * within
        slope_n, bend_n = path_derivative(coefficients_n, s, 1), path_derivative(coefficients_n, s, 2)
        slope = jnp.maximum(norm(slope_n), _TINY)
        s_dot = speed / slope
        s_ddot = (push - jnp.sum(slope_n * bend_n) / slope * s_dot**2) / slope
        return Clock(
            s=jnp.where(self.even, s, elapsed / duration),
            s_dot=jnp.where(self.even, s_dot, 1.0 / duration),
            s_ddot=jnp.where(self.even, s_ddot, 0.0),
        )

    def _parameter(self, coefficients_n: Float[Array, "3 5"], flown: ScalarLike) -> Scalar:
        """Parameter at a length flown: Newton from the cubic between the nodes; straight on beyond the ends."""
        held = jnp.clip(flown, 0.0, self.lengths[-1])
        k = jnp.sum(held >= self.lengths[1:-1], dtype=jnp.int32)
        span = jnp.maximum(self.lengths[k + 1] - self.lengths[k], _TINY)
        u = (held - self.lengths[k]) / span
        m0, m1 = span / self.slopes[k], span / self.slopes[k + 1]
        h = 1.0 / CELLS
        ahead = u * (m0 + u * (3 * h - 2 * m0 - m1 + u * (m0 + m1 - 2 * h)))
        nodes = jnp.concatenate([jnp.asarray(_RULE.nodes), jnp.ones(1)])
        # The cubic misses by metres where the path is tight; position would then not be the integral of velocity.
        for _ in range(_LENGTH_STEPS):
            rates = jax.vmap(lambda x, y=ahead: norm(path_derivative(coefficients_n, k * h + x * y, 1)))(nodes)
            excess = self.lengths[k] + ahead * jnp.sum(jnp.asarray(_RULE.weights) * rates[:-1]) - held
            ahead = jnp.clip(ahead - excess / jnp.maximum(rates[-1], _TINY), 0.0, h)
        return k * h + ahead + (flown - held) / self.slopes[jnp.where(flown < 0.0, 0, CELLS)]


def published_law() -> TimeLaw:
    """The parameter runs evenly with time."""
    nodes, ones = jnp.linspace(0.0, 1.0, CELLS + 1), jnp.ones(CELLS + 1)
    return TimeLaw(jnp.asarray(False), jnp.zeros(()), nodes, ones, ones, nodes)


class _Profile(eqx.Module):
    """The even law of one path, but for its push."""

    parts: Float[Array, " cells"]
    """Lengths of the cells, m."""
    lengths: Float[Array, " nodes"]
    traded: Float[Array, " nodes"]
    """Energy per mass that height has given the speed, m^2/s^2."""
    speed_0: Scalar
    mean_speed: Scalar

    def speeds(self, push: Scalar) -> Float[Array, " nodes"]:
        """Airspeed at the nodes, m/s."""
        square = self.speed_0**2 + 2 * (self.traded - push * self.lengths)
        return jnp.sqrt(jnp.maximum(square, (_SLOWEST * self.mean_speed) ** 2))

    def times(self, push: Scalar) -> Float[Array, " nodes"]:
        """When the nodes are passed, s after the start."""
        speeds = self.speeds(push)
        return jnp.concatenate([jnp.zeros(1), jnp.cumsum(2 * self.parts / (speeds[:-1] + speeds[1:]))])


def _lateness(push: Scalar, profile: _Profile) -> tuple[Scalar, Scalar]:
    """How much later than due the path ends under a push, s, and its slope."""

    def value(push: Scalar) -> Scalar:
        return profile.times(push)[-1] - jnp.sum(profile.parts) / profile.mean_speed

    return jax.jvp(value, (push,), (jnp.ones_like(push),))


def _solve_push(profile: _Profile) -> Scalar:
    """The push with which the path takes its duration: the time rises with it."""
    total, v0, mean = profile.lengths[-1], profile.speed_0, profile.mean_speed
    first = jnp.maximum(profile.lengths[1], _TINY)
    # From the first node on at twice the mean speed: too early. There at the least speed: too late.
    low = -(2 * mean**2 - jnp.min(profile.traded)) / first
    high = (0.5 * v0**2 + jnp.max(profile.traded)) / first
    last = jnp.maximum(2 * mean - v0, 0.5 * mean)
    guess = (profile.traded[-1] - (last**2 - v0**2) / 2) / jnp.maximum(total, _TINY)
    return bracketed_newton(_lateness, profile, low, high, guess, _PUSH_STEPS).x


def even_law(
    coefficients_n: Float[Array, "3 5"],
    duration: ScalarLike,
    speed_0: ScalarLike,
    deceleration: ScalarLike | None = None,
    trade: ScalarLike | None = None,
    even: Flag | bool = True,
) -> TimeLaw:
    """The path flown in `duration` seconds, from `speed_0` (m/s), with a steady push along it.

    V dV/dl = trade g (-dh/dl) - e: e is solved for the duration, by safeguarded Newton on the time of the path, which
    rises with it. With trade 0 the acceleration is constant (on a path of fitting length the speed); with trade 1 the
    throttle is. The speed never falls below 0.3 of the mean.

    Parameters
    ----------
    coefficients_n
        The path.
    duration
        s.
    speed_0
        Airspeed at its start.
    deceleration
        That the aircraft can hold with the engine idle in level flight, m/s^2: the trade is about the least with which
        the path asks for no more, in closed form. Where |dr/ds| is at least half its mean everywhere the bound is kept;
        on tighter paths the fall changes within a cell, and the path asks for up to that change times g more. Without a
        bound nothing is traded.
    trade
        Given instead of found.
    even
        False gives the published law.
    """
    edges = np.linspace(0.0, 1.0, CELLS + 1)
    nodes = edges[:-1, None] + _RULE.nodes[None, :] / CELLS
    points = jnp.asarray(edges)

    def slope(s: ScalarLike) -> Scalar:
        return norm(path_derivative(coefficients_n, s, 1))

    parts = jnp.sum(jax.vmap(jax.vmap(slope))(jnp.asarray(nodes)) * (_RULE.weights / CELLS)[None, :], axis=1)
    lengths = jnp.concatenate([jnp.zeros(1), jnp.cumsum(parts)])
    slopes = jnp.maximum(jax.vmap(slope)(points), _TINY)
    gained = STANDARD_GRAVITY_M_S2 * jax.vmap(lambda s: path_derivative(coefficients_n, s, 0)[2])(points)
    gained = gained - gained[0]
    total = jnp.maximum(lengths[-1], _TINY)
    if trade is None:
        trade = jnp.zeros(())
        if deceleration is not None:
            fall = jax.vmap(lambda s: path_derivative(coefficients_n, s, 1)[2])(points) / slopes
            steepest, mean_speed = STANDARD_GRAVITY_M_S2 * jnp.max(fall), total / duration
            # The push is base plus trade times mean, to first order in the changes of speed: without trade the speed
            # ends as far from the mean as it began; traded early, height must be braked off over the whole path.
            base = 2 * mean_speed * (speed_0 - mean_speed) / total
            mean = jnp.maximum(gained[-1], jnp.sum(parts * (gained[1:] + gained[:-1])) / total) / total
            excess = steepest + base - (deceleration - BRAKING_RESERVE_M_S2)
            trade = jnp.clip(excess / jnp.maximum(steepest - mean, 1e-3), 0.0, 1.0)
    profile = _Profile(parts, lengths, trade * gained, jnp.asarray(speed_0, dtype=float), total / duration)
    push = _solve_push(profile)
    return TimeLaw(
        even=jnp.asarray(even),
        trade=jnp.asarray(trade, dtype=float),
        lengths=lengths,
        slopes=slopes,
        speeds=profile.speeds(push),
        times=profile.times(push),
    )
