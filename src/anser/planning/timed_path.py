"""Planned path of an aircraft: piecewise quintic in time, given by position, velocity and acceleration at knots."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.compiling.single_kernel import is_tracing_single_kernel
from anser.numerics.arrays import count_not_above
from anser.numerics.integration import gauss_legendre
from anser.parts.paths import AbstractReference, PathPoint, time_rounding
from anser.shapes import Integer, Scalar, ScalarLike, Vector3
from anser.spatial.vectors import norm

Knots = Float[Array, "knots 3 3"]
_LENGTH_RULE = gauss_legendre(4)  # per cell, in which the airspeed hardly changes


def hermite_quintic(
    # position, velocity and acceleration at both ends, shape (derivative, axis); m, m/s, m/s^2
    begin: Float[Array, "3 3"],
    end: Float[Array, "3 3"],
    span: ScalarLike,  # time between the states, s, positive
    u: ScalarLike,  # fraction of the time, 0 to 1
) -> Float[Array, "3 3"]:
    """Return position, velocity and acceleration of the quintic that joins two states, at the fraction `u`.

    Rows of the result: value, first and second derivative by time, as in `begin` and `end`; columns: NED axes.
    """
    # Relative to the parabola from the first state: small differences keep their digits.
    parabola = begin[0] + span * begin[1] + 0.5 * span**2 * begin[2]
    p = end[0] - parabola
    v = span * (end[1] - begin[1] - span * begin[2])
    a = span**2 * (end[2] - begin[2])
    c3, c4, c5 = 10 * p - 4 * v + 0.5 * a, -15 * p + 7 * v - a, 6 * p - 3 * v + 0.5 * a
    t = u * span
    value = begin[0] + t * (begin[1] + 0.5 * t * begin[2]) + u**3 * (c3 + u * (c4 + u * c5))
    slope = begin[1] + t * begin[2] + u**2 * (3 * c3 + u * (4 * c4 + u * 5 * c5)) / span
    bend = begin[2] + u * (6 * c3 + u * (12 * c4 + u * 20 * c5)) / span**2
    return jnp.stack([value, slope, bend])


class TimedPath(AbstractReference):
    """Planned position of one aircraft over time: piecewise quintic, twice continuously differentiable over the ground.

    The position over the ground is the path through the air plus the drift of the air, both quintics between knots.
    Where the rate of change of the wind jumps, two knots have the same time: the second derivatives of `air_n` and of
    `drift_n` may jump there, but their sum is continuous.
    """

    #: Knot times, s, from the start to the arrival, not decreasing; two equal neighbours make an empty cell.
    times: Float[Array, " knots"]
    air_n: Knots  #: Path relative to the air: (knot, order of derivative, NED axis); m, m/s, m/s^2.
    drift_n: Knots  #: Displacement by the wind, same shape; 0 at the start.

    @property
    def start_time(self) -> Scalar:
        """Start of the path, s."""
        return self.times[0]

    @property
    def arrival_time(self) -> Scalar:
        """End of the path, s."""
        return self.times[-1]

    @property
    def duration(self) -> Scalar:
        """Duration of the path, s."""
        return self.times[-1] - self.times[0]

    def _at(self, time: ScalarLike, knots: Knots, *added_knots: Knots) -> Float[Array, "3 3"]:
        """Return position, velocity and acceleration (rows) at a time (s), for the sum of the tables of knots.

        Before the first and after the last knot, the motion continues straight, with the velocity at the knot.
        """
        # Not jnp.clip, whose derivative at the bounds is one half.
        clipped = jnp.where(time < self.times[0], self.times[0], jnp.where(time > self.times[-1], self.times[-1], time))
        k = jnp.clip(self._begun_count(clipped) - 1, 0, self.times.shape[0] - 2)
        # Only two knots are added: sums of all knots would be computed at every step of a flight.
        begin, end = sum(
            (jax.lax.dynamic_slice_in_dim(added, k, 2) for added in added_knots),
            jax.lax.dynamic_slice_in_dim(knots, k, 2),
        )
        start, stop = jax.lax.dynamic_slice_in_dim(self.times, k, 2)
        span = stop - start
        safe = jnp.where(span > 0.0, span, 1.0)
        inside = hermite_quintic(begin, end, safe, (clipped - start) / safe)
        outside = time - clipped
        extrapolated = jnp.stack([inside[0] + outside * inside[1], inside[1], jnp.zeros_like(inside[1])])
        return jnp.where(jnp.abs(outside) <= time_rounding(clipped), inside, extrapolated)

    def _begun_count(self, time: ScalarLike) -> Integer:
        """Return the number of knots not later than a time (s), except knots at the arrival time."""
        # The last cells may be empty, hence knots at the arrival time do not count.
        if not is_tracing_single_kernel():
            return count_not_above(jnp.where(self.times < self.times[-1], self.times, jnp.inf), time)

        # A single kernel has small arrays only.
        def halve(_: object, bounds: tuple[Integer, Integer]) -> tuple[Integer, Integer]:
            low, high = bounds
            middle = (low + high) >> 1
            knot_time = jnp.take(self.times, middle, mode="clip")
            has_begun = (knot_time <= time) & (knot_time < self.times[-1])
            return jnp.where(has_begun, middle + 1, low), jnp.where(has_begun, high, middle)

        count = self.times.shape[0]
        start = jnp.asarray(0, jnp.int32), jnp.asarray(count, jnp.int32)
        return jax.lax.fori_loop(0, count.bit_length(), halve, start)[0]

    def at(self, time: ScalarLike) -> PathPoint:
        """Return position, velocity and acceleration over the ground at a time (s); straight on beyond the ends."""
        return PathPoint(*self._at(time, self.air_n, self.drift_n))

    def air_velocity_n(self, time: ScalarLike) -> Vector3:
        """Return the velocity relative to the air at a time (s), NED, m/s."""
        return self._at(time, self.air_n)[1]

    def states_n(self, time: ScalarLike) -> tuple[Float[Array, "3 3"], Float[Array, "3 3"]]:
        """Return air path and drift at a time (s), each with the rows position, velocity, acceleration; NED, SI."""
        return self._at(time, self.air_n), self._at(time, self.drift_n)

    def air_length(self, from_time: ScalarLike = -jnp.inf) -> Scalar:
        """Return the three-dimensional length of the air path, m, from `from_time` (s; -inf: start) to the arrival."""

        def cell_length(begin: Knots, end: Knots, start: Scalar, stop: Scalar) -> Scalar:
            span = stop - start
            safe = jnp.where(span > 0.0, span, 1.0)
            start_fraction = jnp.clip((from_time - start) / safe, 0.0, 1.0)
            u = start_fraction + (1.0 - start_fraction) * jnp.asarray(_LENGTH_RULE.nodes)
            speeds = jax.vmap(lambda fraction: norm(hermite_quintic(begin, end, safe, fraction)[1]))(u)
            mean = jnp.sum(jnp.asarray(_LENGTH_RULE.weights) * speeds)
            return jnp.where(span > 0.0, (1.0 - start_fraction) * span * mean, 0.0)

        return jnp.sum(jax.vmap(cell_length)(self.air_n[:-1], self.air_n[1:], self.times[:-1], self.times[1:]))
