"""A delivered 4-D trajectory: quintics in time through known positions, velocities and accelerations."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.numerics.integration import gauss_legendre
from anser.parts.paths import AbstractReference, PathPoint, time_rounding
from anser.shapes import Scalar, ScalarLike, Vector3
from anser.spatial.vectors import norm

Knots = Float[Array, "knots 3 3"]
# In each cell, where the airspeed hardly changes.
_LENGTH_RULE = gauss_legendre(4)


def hermite_quintic(
    begin: Float[Array, "3 3"], end: Float[Array, "3 3"], span: ScalarLike, u: ScalarLike
) -> Float[Array, "3 3"]:
    """Value, first and second time derivative of the quintic between two states.

    Parameters
    ----------
    begin, end
        Position, velocity and acceleration (order, axis) at both ends.
    span
        Time between them, s, positive.
    u
        Where, 0 to 1.
    """
    # Seen from the parabola that leaves the beginning: small differences keep their digits.
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
    """Where one aircraft is to be at which time: twice continuously differentiable over the ground, piecewise quintic.

    The path over the ground is the path through the air plus the drift of the air; each is the quintic in each cell
    between two knots that has the given values, slopes and second derivatives at both. Where the wind's rate jumps,
    two knots at one time may differ in the second derivatives of air and drift, not in their sum.

    Attributes
    ----------
    times
        Knots, s, not decreasing; equal neighbours make an empty cell. The first is the start, the last the arrival.
    air_n
        Path relative to the air: (knot, order of derivative, NED axis); m, m/s, m/s^2.
    drift_n
        What the wind adds; 0 at the start.
    """

    times: Float[Array, " knots"]
    air_n: Knots
    drift_n: Knots

    @property
    def start_time(self) -> Scalar:
        """When the path begins, s."""
        return self.times[0]

    @property
    def arrival_time(self) -> Scalar:
        """When it ends, s."""
        return self.times[-1]

    @property
    def duration(self) -> Scalar:
        """How long it lasts, s."""
        return self.times[-1] - self.times[0]

    def _at(self, time: ScalarLike, knots: Knots, *more: Knots) -> Float[Array, "3 3"]:
        """Value, slope and second derivative of a sum; on at the last velocity after the end, at the first before."""
        # Not clip: its derivative at the ends themselves is one half.
        held = jnp.where(time < self.times[0], self.times[0], jnp.where(time > self.times[-1], self.times[-1], time))
        # The last cells may be empty: the end is that of the last cell which is not. Compared with all knots: a search
        # by halves takes ten times as long in a batch.
        begun = (self.times <= held) & (self.times < self.times[-1])
        k = jnp.clip(jnp.sum(begun, dtype=jnp.int32) - 1, 0, self.times.shape[0] - 2)
        # Of two knots only: sums of all of them would be made at every step of a flight.
        begin, end = sum(
            (jax.lax.dynamic_slice_in_dim(one, k, 2) for one in more), jax.lax.dynamic_slice_in_dim(knots, k, 2)
        )
        start, stop = jax.lax.dynamic_slice_in_dim(self.times, k, 2)
        span = stop - start
        safe = jnp.where(span > 0.0, span, 1.0)
        inside = hermite_quintic(begin, end, safe, (held - start) / safe)
        beyond = time - held
        ahead = jnp.stack([inside[0] + beyond * inside[1], inside[1], jnp.zeros_like(inside[1])])
        return jnp.where(jnp.abs(beyond) <= time_rounding(held), inside, ahead)

    def at(self, time: ScalarLike) -> PathPoint:
        """Motion over the ground at a time."""
        return PathPoint(*self._at(time, self.air_n, self.drift_n))

    def air_velocity_n(self, time: ScalarLike) -> Vector3:
        """Velocity relative to the air, NED, m/s."""
        return self._at(time, self.air_n)[1]

    def states_n(self, time: ScalarLike) -> tuple[Float[Array, "3 3"], Float[Array, "3 3"]]:
        """Path through the air and drift, each as (order, axis), at a time."""
        return self._at(time, self.air_n), self._at(time, self.drift_n)

    def air_length(self, since: ScalarLike = -jnp.inf) -> Scalar:
        """Length of the path through the air, in space, from a time (s) on, m."""

        def of_cell(begin: Knots, end: Knots, start: Scalar, stop: Scalar) -> Scalar:
            span = stop - start
            safe = jnp.where(span > 0.0, span, 1.0)
            first = jnp.clip((since - start) / safe, 0.0, 1.0)
            u = first + (1.0 - first) * jnp.asarray(_LENGTH_RULE.nodes)
            speeds = jax.vmap(lambda one: norm(hermite_quintic(begin, end, safe, one)[1]))(u)
            mean = jnp.sum(jnp.asarray(_LENGTH_RULE.weights) * speeds)
            return jnp.where(span > 0.0, (1.0 - first) * span * mean, 0.0)

        return jnp.sum(jax.vmap(of_cell)(self.air_n[:-1], self.air_n[1:], self.times[:-1], self.times[1:]))
