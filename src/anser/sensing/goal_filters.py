"""Following a goal through its measurements: the interface of the filters, and the extended Kalman filter."""

import abc
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from anser.numerics import any_in_batch
from anser.sensing.ideal import line_of_sight
from anser.sensing.interface import (
    GOAL_DIVERGED,
    GOAL_KNOWN,
    GOAL_NEVER_SEEN,
    GoalReading,
    GoalState,
    Instant,
)
from anser.shapes import Count, Flag, Scalar, ScalarLike, Vector3

_MEMORY = 20.0  # measurements over which the size of innovations is averaged
_INITIAL_NIS = 1.0
_ANGLES = np.array([False, True, True, False, False, False])


class OwnMotion(eqx.Module):
    """Where an aircraft takes itself to be, NED, m in the Earth's chart, and its velocity over the ground, m/s."""

    position_n: Vector3
    velocity_n: Vector3


class GoalEstimate(eqx.Module):
    """What a filter says of a goal now.

    Attributes
    ----------
    mean, covariance
        Of position and velocity, NED, m and m/s.
    seen
        Whether a measurement came in.
    nis
        Normalised innovation squared of the last measurement over its dimension.
    status
        `GOAL_KNOWN`, `GOAL_NEVER_SEEN` or `GOAL_DIVERGED`.
    """

    mean: Float[Array, "6"]
    covariance: Float[Array, "6 6"]
    seen: Flag
    nis: Scalar
    status: Count


class AbstractGoalFilter(eqx.Module):
    """A filter of one goal; concrete ones are final."""

    @abc.abstractmethod
    def init(self, mean: Float[Array, "6"], sigmas: Float[Array, "6"]) -> Any:
        """State before any measurement, from what is known beforehand of position and velocity (NED, m and m/s)."""

    @abc.abstractmethod
    def step(self, memory: Any, reading: GoalReading, own: OwnMotion, instant: Instant) -> tuple[Any, GoalEstimate]:
        """State after what arrived at a sample, and what it says of the goal then."""


class SteadyMotion(eqx.Module):
    """Nearly constant velocity: white noise of acceleration, of spectral densities in the plane and in height, m^2/s^3.

    Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 6.2.2.
    """

    density: Scalar
    density_up: Scalar

    def moved(self, mean: Float[Array, "6"], span: ScalarLike) -> Float[Array, "6"]:
        """Mean after a time (s)."""
        return jnp.concatenate([mean[:3] + span * mean[3:], mean[3:]])

    def spread(self, covariance: Float[Array, "6 6"], span: ScalarLike) -> Float[Array, "6 6"]:
        """Covariance after a time (s), by blocks: F P F^T + Q."""
        place, cross, speed = covariance[:3, :3], covariance[:3, 3:], covariance[3:, 3:]
        noise = jnp.diag(jnp.stack([self.density, self.density, self.density_up]))
        place = place + span * (cross + cross.T) + span**2 * speed + noise * span**3 / 3
        cross = cross + span * speed + noise * span**2 / 2
        return jnp.block([[place, cross], [cross.T, speed + noise * span]])


class Track(eqx.Module):
    """A goal between two samples.

    Attributes
    ----------
    mean, covariance
        At the time of the latest measurement, or of the start.
    number
        Sample of that time.
    count
        Measurements taken in.
    nis, nis_mean
        Of the last measurement and of the latest ones, over their dimension.
    own
        Own motion at the latest samples, where measurements may be late: leading axis slots, by sample modulo slots.
    """

    mean: Float[Array, "6"]
    covariance: Float[Array, "6 6"]
    number: Count
    count: Count
    nis: Scalar
    nis_mean: Scalar
    own: OwnMotion | None


class ExtendedKalmanFilter(AbstractGoalFilter):
    """Extended Kalman filter of position and velocity in NED axes.

    A measurement that comes late is taken in at its own time where it is the latest so far; one that comes out of order
    is predicted from the estimate taken back to its time without process noise (Y. Bar-Shalom, IEEE Trans. Aerospace
    and Electronic Systems 38, 2002, "algorithm C"), which is exact for steady goals.

    Attributes
    ----------
    motion
        Of the goal.
    nis_max
        Mean innovation, normalised, above which the filter has diverged.
    sigma_max
        Standard deviation of the position above which it has, m.
    slots
        How many samples back a measurement may have been made, at least; 0: none is late.
    """

    motion: SteadyMotion
    nis_max: Scalar
    sigma_max: Scalar
    slots: int = eqx.field(static=True, default=0)

    def init(self, mean: Float[Array, "6"], sigmas: Float[Array, "6"]) -> Track:
        """See `AbstractGoalFilter`."""
        zero, own = jnp.asarray(0, dtype=jnp.int32), None
        if self.slots:
            own = OwnMotion(jnp.zeros((self.slots, 3)), jnp.zeros((self.slots, 3)))
        one = jnp.ones_like(mean[0])
        return Track(mean, jnp.diag(sigmas**2), zero, zero, one, _INITIAL_NIS * one, own)

    def step(self, memory: Track, reading: GoalReading, own: OwnMotion, instant: Instant) -> tuple[Track, GoalEstimate]:
        """See `AbstractGoalFilter`."""
        then = own
        if memory.own is not None:
            rows = jax.tree.map(lambda all_, one: all_.at[instant.number % self.slots].set(one), memory.own, own)
            memory = eqx.tree_at(lambda m: m.own, memory, rows)
            then = jax.tree.map(lambda all_: all_[reading.number % self.slots], rows)
        seen = jnp.any(reading.measured)

        def updated() -> Track:
            made = self._updated(memory, reading, then, instant)
            return jax.tree.map(lambda new, old: jnp.where(seen, new, old), made, memory)

        after = jax.lax.cond(any_in_batch(seen), updated, lambda: memory)
        ahead = (instant.number - after.number) * instant.step
        covariance = self.motion.spread(after.covariance, ahead)
        return after, GoalEstimate(
            mean=self.motion.moved(after.mean, ahead),
            covariance=covariance,
            seen=seen,
            nis=after.nis,
            status=self._status(after, covariance),
        )

    def _status(self, track: Track, covariance: Float[Array, "6 6"]) -> Count:
        sigma = jnp.sqrt(jnp.maximum(jnp.max(jnp.diag(covariance)[:3]), 0.0))
        diverged = (track.nis_mean > self.nis_max) | ~(sigma <= self.sigma_max)
        known = jnp.where(track.count > 0, GOAL_KNOWN, GOAL_NEVER_SEEN)
        return jnp.where((track.count > 0) & diverged, GOAL_DIVERGED, known).astype(jnp.int32)

    def _updated(self, track: Track, reading: GoalReading, own: OwnMotion, instant: Instant) -> Track:
        elapsed = (reading.number - track.number) * instant.step
        forward, back = jnp.maximum(elapsed, 0.0), jnp.minimum(elapsed, 0.0)
        mean, covariance = self.motion.moved(track.mean, forward), self.motion.spread(track.covariance, forward)

        def measured(state: Float[Array, "6"]) -> Float[Array, "6"]:
            return expected(reading, self.motion.moved(state, back), own, instant)

        predicted, slopes = measured(mean), jax.jacfwd(measured)(mean)
        off = innovation(reading, predicted)
        mean, covariance, nis = taken_in(mean, covariance, slopes, off, reading.sigmas**2, reading.measured)
        share = 1.0 / jnp.minimum(track.count + 1.0, _MEMORY)
        return Track(
            mean=mean,
            covariance=covariance,
            number=jnp.maximum(track.number, reading.number),
            count=track.count + 1,
            nis=nis,
            nis_mean=track.nis_mean + share * (nis - track.nis_mean),
            own=track.own,
        )


def expected(reading: GoalReading, state: Float[Array, "6"], own: OwnMotion, instant: Instant) -> Float[Array, "6"]:
    """What a sensor without errors would give of a goal with a position and velocity (NED, m and m/s)."""
    if reading.kind == "report":
        return state
    goal = GoalState(state[:3], state[3:])
    sight = line_of_sight(instant.environment.earth, own.position_n, own.velocity_n, goal)
    return jnp.stack(
        [
            sight.range,
            sight.azimuth,
            sight.elevation,
            sight.range_rate,
            sight.azimuth_rate,
            sight.elevation_rate,
        ]
    )


def innovation(reading: GoalReading, predicted: Float[Array, "6"]) -> Float[Array, "6"]:
    """Measured less predicted; angles the short way round."""
    off = reading.values - predicted
    if reading.kind == "sight":
        off = jnp.where(_ANGLES, off - 2 * jnp.pi * jnp.round(off / (2 * jnp.pi)), off)
    return off


def taken_in(
    mean: Float[Array, " n"],
    covariance: Float[Array, "n n"],
    slopes: Float[Array, "m n"],
    off: Float[Array, " m"],
    variances: Float[Array, " m"],
    measured: Bool[Array, " m"],
) -> tuple[Float[Array, " n"], Float[Array, "n n"], Scalar]:
    """Kalman update by independent measurements, one scalar after the other: the same as all at once.

    Parameters
    ----------
    mean, covariance
        Predicted.
    slopes
        Derivative of the measurements with respect to the state, at the predicted mean.
    off
        Innovation there.
    variances
        Of the errors.
    measured
        Which count.

    Returns
    -------
    Mean and covariance, and the normalised innovation squared over the number of measurements.
    """
    begin = mean
    total = jnp.zeros_like(off[0])
    for k in range(off.shape[0]):
        row, on = slopes[k], measured[k]
        across = jnp.sum(covariance * row[None, :], axis=1)
        spread = jnp.sum(row * across) + variances[k]
        safe = jnp.where(on & (spread > 0.0), spread, 1.0)
        left = off[k] - jnp.sum(row * (mean - begin))
        gain = jnp.where(on, across / safe, 0.0)
        mean = mean + gain * left
        # Joseph's form, multiplied out for a scalar measurement
        covariance = (
            covariance
            - gain[:, None] * across[None, :]
            - across[:, None] * gain[None, :]
            + safe * gain[:, None] * gain[None, :]
        )
        total = total + jnp.where(on, left**2 / safe, 0.0)
    return mean, covariance, total / jnp.maximum(jnp.sum(measured), 1)
