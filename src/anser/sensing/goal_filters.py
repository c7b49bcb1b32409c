"""Kalman filters of a goal.

With one motion model or several interacting ones, and the handover of a goal's track from one aircraft to another.
"""

import abc
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.numerics.arrays import select_if_any
from anser.parts.perception import GOAL_DIVERGED, GOAL_KNOWN, GOAL_NEVER_SEEN, GoalReading, GoalState, Instant
from anser.sensing.goal_sensors import MeasurementQueue
from anser.sensing.ideal_sensors import line_of_sight, line_of_sight_values
from anser.sensing.kalman import Measurement, SigmaPoints, extended_update, unscented_prediction, unscented_update
from anser.sensing.motion_models import AbstractMotionModel
from anser.shapes import Count, Flag, Scalar, ScalarLike, Vector3

_MEMORY = 20.0  # measurements over which the size of innovations is averaged
_OUTLIER = 5.0  # times `nis_max`: more than that no innovation counts for, lest a single one make a filter diverge
_ANGLES = np.array([False, True, True, False, False, False])
_TURN_SIGMA = 0.05  # rad/s, of a turn rate of which nothing is known


class VehicleMotion(eqx.Module):
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
    is_measured: Flag
    nis: Scalar
    status: Count


class AbstractGoalFilter(eqx.Module):
    """A filter of one goal; concrete ones are final."""

    @abc.abstractmethod
    def init(self, mean: Float[Array, "6"], sigmas: Float[Array, "6"]) -> Any:
        """State before any measurement, from what is known beforehand of position and velocity (NED, m and m/s)."""

    @abc.abstractmethod
    def step(
        self, filter_state: Any, reading: GoalReading, vehicle_motion: VehicleMotion, instant: Instant
    ) -> tuple[Any, GoalEstimate]:
        """State after what arrived at a sample, and what it says of the goal then."""


class GoalTrack(eqx.Module):
    """A goal between two samples; leading axis models.

    Attributes
    ----------
    means, covariances
        By each model of motion, at the time of the latest measurement, or of the start.
    shares
        Probabilities of the models.
    number
        Sample of that time.
    count
        Measurements taken in.
    nis, nis_mean
        Of the last measurement and of the latest ones, over their dimension.
    own
        Own motion at the latest samples, where measurements may be late: leading axis slots, by sample modulo slots.
    """

    means: Float[Array, "models n"]
    covariances: Float[Array, "models n n"]
    shares: Float[Array, " models"]
    number: Count
    count: Count
    nis: Scalar
    nis_mean: Scalar
    vehicle_motion: VehicleMotion | None


class GoalFilter(AbstractGoalFilter):
    """Kalman filter of a goal in NED axes; with several models, interacting ones (IMM).

    Extended or unscented. A measurement that comes late is taken in at its own time where it is the latest so far; one
    out of order is predicted from the estimate taken back to its time without process noise (Y. Bar-Shalom, IEEE Trans.
    Aerospace and Electronic Systems 38, 2002, algorithm C), exact where there is none. The models interact as in H. A.
    P. Blom, Y. Bar-Shalom, IEEE Trans. Automatic Control 33, 1988; the time between two measurements may differ.

    Attributes
    ----------
    models
        Of the motion, all with as many states.
    sojourn
        Mean time for which the goal keeps a model, s; with one model it counts for nothing.
    nis_max
        Mean innovation, normalised, above which the filter has diverged. The mean fades over 20 measurements and begins
        with 1; a single one never makes it so great.
    sigma_max
        Standard deviation of the position above which it has, m.
    kind
        "ekf" or "ukf".
    points
        Of the unscented filter.
    slots
        How many samples back a measurement may have been made, at least; 0: none is late.
    """

    models: tuple[AbstractMotionModel, ...]
    sojourn: Scalar
    nis_max: Scalar
    sigma_max: Scalar
    kind: Literal["ekf", "ukf"] = eqx.field(static=True, default="ekf")
    points: SigmaPoints = eqx.field(static=True, default=SigmaPoints())
    slots: int = eqx.field(static=True, default=0)

    def init(self, mean: Float[Array, "6"], sigmas: Float[Array, "6"]) -> GoalTrack:
        """See `AbstractGoalFilter`; a turn rate begins with 0, of which 3 deg/s is one standard deviation."""
        zero, vehicle_motion, models = jnp.asarray(0, dtype=jnp.int32), None, len(self.models)
        if self.slots:
            vehicle_motion = VehicleMotion(jnp.zeros((self.slots, 3)), jnp.zeros((self.slots, 3)))
        if self.models[0].size == 7:
            mean = jnp.concatenate([mean, jnp.zeros_like(mean[:1])])
            sigmas = jnp.concatenate([sigmas, jnp.full_like(sigmas[:1], _TURN_SIGMA)])
        one = jnp.ones_like(mean[0])
        return GoalTrack(
            means=jnp.broadcast_to(mean, (models, mean.shape[0])),
            covariances=jnp.broadcast_to(jnp.diag(sigmas**2), (models, mean.shape[0], mean.shape[0])),
            shares=jnp.full(models, 1.0 / models),
            number=zero,
            count=zero,
            nis=one,
            nis_mean=one,
            vehicle_motion=vehicle_motion,
        )

    def step(
        self, filter_state: GoalTrack, reading: GoalReading, vehicle_motion: VehicleMotion, instant: Instant
    ) -> tuple[GoalTrack, GoalEstimate]:
        """See `AbstractGoalFilter`."""
        then = vehicle_motion
        if filter_state.vehicle_motion is not None:
            now = jnp.arange(self.slots)[:, None] == instant.number % self.slots
            rows = jax.tree.map(
                lambda all_, one: jnp.where(now, one[None], all_), filter_state.vehicle_motion, vehicle_motion
            )
            filter_state = eqx.tree_at(lambda m: m.vehicle_motion, filter_state, rows)
            then = jax.tree.map(lambda all_: all_[reading.number % self.slots], rows)
        seen = jnp.any(reading.measured)

        after = select_if_any(seen, lambda: self.update(filter_state, reading, then, instant), filter_state)
        mean, covariance = self.predict(after, (instant.number - after.number) * instant.step)
        return after, GoalEstimate(mean, covariance, seen, after.nis, self._status(after, covariance))

    def predict(self, track: GoalTrack, ahead: ScalarLike) -> tuple[Float[Array, "6"], Float[Array, "6 6"]]:
        """Mean and covariance of position and velocity a time (s) after the latest measurement."""
        pairs = [self._moved(model, track.means[k], track.covariances[k], ahead) for k, model in enumerate(self.models)]
        means, covariances = jnp.stack([mean for mean, _ in pairs]), jnp.stack([spread for _, spread in pairs])
        mean, covariance = _combined(track.shares, means, covariances)
        return mean[:6], covariance[:6, :6]

    def update(
        self, track: GoalTrack, reading: GoalReading, vehicle_motion: VehicleMotion, instant: Instant
    ) -> GoalTrack:
        """After a measurement: mixed, predicted, updated and weighed."""
        elapsed = (reading.number - track.number) * instant.step
        forward, back = jnp.maximum(elapsed, 0.0), jnp.minimum(elapsed, 0.0)
        means, covariances, shares = self._mixed(track, forward)
        found = []
        for k, model in enumerate(self.models):
            mean, covariance = self._moved(model, means[k], covariances[k], forward)

            def off(state: Float[Array, " n"], model: AbstractMotionModel = model) -> Float[Array, "6"]:
                return innovation(
                    reading,
                    predicted_measurement(reading, model.predict_state(state, back)[:6], vehicle_motion, instant),
                )

            measurement = Measurement(off, reading.sigmas**2, reading.measured)
            if self.kind == "ekf":
                found.append(extended_update(mean, covariance, measurement))
            else:
                found.append(unscented_update(mean, covariance, measurement, self.points))
        logs = jnp.stack([one.log_likelihood for one in found])
        weights = shares * jnp.exp(logs - jnp.max(logs))
        weights = weights / jnp.sum(weights)
        dimension = jnp.maximum(jnp.sum(reading.measured), 1)
        nis = jnp.sum(weights * jnp.stack([one.nis for one in found])) / dimension
        counted = jnp.minimum(nis, _OUTLIER * self.nis_max)
        return GoalTrack(
            means=jnp.stack([one.mean for one in found]),
            covariances=jnp.stack([one.covariance for one in found]),
            shares=weights,
            number=jnp.maximum(track.number, reading.number),
            count=track.count + 1,
            nis=nis,
            nis_mean=track.nis_mean + (counted - track.nis_mean) / _MEMORY,
            vehicle_motion=track.vehicle_motion,
        )

    def _moved(
        self, model: AbstractMotionModel, mean: Array, covariance: Array, span: ScalarLike
    ) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
        if self.kind == "ekf":
            return model.predict_state(mean, span), model.predict_covariance(mean, covariance, span)
        return unscented_prediction(
            lambda s: model.predict_state(s, span), mean, covariance, model.process_noise(span), self.points
        )

    def _mixed(self, track: GoalTrack, span: ScalarLike) -> tuple[Array, Array, Array]:
        """Each model's state, mixed with those from which the goal may have changed to it, and the models' shares."""
        count = len(self.models)
        if count == 1:
            return track.means, track.covariances, track.shares
        # a chain that leaves each model at the same rate, for any other alike
        kept = jnp.exp(-jnp.asarray(span) / self.sojourn * count / (count - 1))
        chain = kept * jnp.eye(count, dtype=kept.dtype) + (1.0 - kept) / count
        joint = chain * track.shares[:, None]
        shares = jnp.sum(joint, axis=0)
        weights = joint / shares[None, :]
        means = jnp.sum(weights[:, :, None] * track.means[:, None, :], axis=0)
        apart = track.means[:, None, :] - means[None, :, :]
        spreads = track.covariances[:, None] + apart[..., :, None] * apart[..., None, :]
        return means, jnp.sum(weights[:, :, None, None] * spreads, axis=0), shares

    def _status(self, track: GoalTrack, covariance: Float[Array, "6 6"]) -> Count:
        square = jnp.max(jnp.stack([covariance[k, k] for k in range(3)]))
        diverged = (track.nis_mean > self.nis_max) | ~(square <= self.sigma_max**2)
        known = jnp.where(track.count > 0, GOAL_KNOWN, GOAL_NEVER_SEEN)
        return jnp.where((track.count > 0) & diverged, GOAL_DIVERGED, known).astype(jnp.int32)


def _combined(shares: Array, means: Array, covariances: Array) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
    """Mean and covariance of a mixture."""
    if means.shape[0] == 1:
        return means[0], covariances[0]
    mean = jnp.sum(shares[:, None] * means, axis=0)
    apart = means - mean[None]
    return mean, jnp.sum(shares[:, None, None] * (covariances + apart[:, :, None] * apart[:, None, :]), axis=0)


def predicted_measurement(
    reading: GoalReading, state: Float[Array, "6"], vehicle_motion: VehicleMotion, instant: Instant
) -> Float[Array, "6"]:
    """What a sensor without errors would give of a goal with a position and velocity (NED, m and m/s)."""
    if reading.kind == "report":
        return state
    goal = GoalState(state[:3], state[3:])
    return line_of_sight_values(
        line_of_sight(instant.environment.earth, vehicle_motion.position_n, vehicle_motion.velocity_n, goal)
    )


def innovation(reading: GoalReading, predicted: Float[Array, "6"]) -> Float[Array, "6"]:
    """Measured less predicted; angles the short way round."""
    off = reading.values - predicted
    if reading.kind == "sight":
        off = jnp.where(_ANGLES, off - 2 * jnp.pi * jnp.round(off / (2 * jnp.pi)), off)
    return off


def hand_over_goal(mine: Any, others: Any) -> Any:
    """Memories of an aircraft's sensors and estimator after it has turned to the goal of another aircraft.

    The filter of the goal goes on from the other's; what its own sensor has on the way of the former goal is dropped;
    what it knows of itself stays.

    Parameters
    ----------
    mine, others
        Memories of parts of the same structure, NumPy or JAX arrays.
    """
    return jax.tree.map(_after, mine, others, is_leaf=_of_goal)


def _of_goal(node: Any) -> bool:
    return isinstance(node, GoalTrack | GoalState | MeasurementQueue)


def _after(mine: Any, other: Any) -> Any:
    if isinstance(mine, GoalTrack):
        return eqx.tree_at(
            lambda track: track.vehicle_motion, other, mine.vehicle_motion, is_leaf=lambda leaf: leaf is None
        )
    if isinstance(mine, MeasurementQueue):
        return eqx.tree_at(lambda queue: queue.waiting, mine, mine.waiting & False)
    return other if isinstance(mine, GoalState) else mine
