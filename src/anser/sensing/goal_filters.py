"""Kalman filters that estimate a goal's motion, with one motion model or several interacting models."""

import abc
import dataclasses
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
from anser.shapes import Flag, Integer, Scalar, ScalarLike, Vector3

_NIS_MEMORY = 20.0  # number of measurements in the running mean of the normalised innovation squared
_OUTLIER = 5.0  # limit of one innovation as a multiple of `nis_max`: a single outlier is not a divergence
_ANGLES = np.array([False, True, True, False, False, False])
_TURN_SIGMA = 0.05  # rad/s, prior standard deviation of the turn rate


class VehicleMotion(eqx.Module):
    """Estimated motion of the aircraft: position (m, in the Earth's chart) and velocity over the ground (m/s), NED."""

    position_n: Vector3
    velocity_n: Vector3


class GoalEstimate(eqx.Module):
    """Estimated motion of a goal at one sample."""

    mean: Float[Array, "6"]  # position and velocity, NED, m and m/s
    covariance: Float[Array, "6 6"]  # covariance of `mean`
    is_measured: Flag  # whether a measurement arrived at this sample
    nis: Scalar  # normalised innovation squared of the last measurement, divided by its dimension
    status: Integer  # `GOAL_KNOWN`, `GOAL_NEVER_SEEN` or `GOAL_DIVERGED`


class AbstractGoalFilter(eqx.Module):
    """Interface of a filter that estimates one goal's motion. Subclass this class directly, not a concrete filter."""

    @abc.abstractmethod
    def init(self, mean: Float[Array, "6"], sigmas: Float[Array, "6"]) -> Any:
        """Return the filter state before the first measurement.

        `mean` is the prior position and velocity of the goal (NED, m and m/s); `sigmas` are the standard deviations.
        """

    @abc.abstractmethod
    def step(
        self, filter_state: Any, reading: GoalReading, vehicle_motion: VehicleMotion, instant: Instant
    ) -> tuple[Any, GoalEstimate]:
        """Return filter state and estimate after the goal reading of a sample, which may be empty or delayed."""


class GoalTrack(eqx.Module):
    """State of a `GoalFilter` between two samples."""

    means: Float[Array, "models n"]  # mean of each motion model at the latest measurement, or at the start
    covariances: Float[Array, "models n n"]  # covariance of each motion model, at the same time
    shares: Float[Array, " models"]  # probability of each model; the sum is 1
    number: Integer  # sample number of the latest measurement
    count: Integer  # number of processed measurements
    nis: Scalar  # normalised innovation squared of the last measurement, divided by the dimension
    nis_mean: Scalar  # running mean of `nis`
    # motion of the aircraft at the latest samples, sample number k at index k % slots; None: no measurement is delayed
    vehicle_motion: VehicleMotion | None


class GoalFilter(AbstractGoalFilter):
    """Kalman filter of a goal's motion in NED axes, with one motion model or several interacting models (IMM).

    For a measurement older than the latest, the estimate is propagated back to the time of the measurement without
    process noise (Y. Bar-Shalom, IEEE Trans. Aerospace and Electronic Systems 38, 2002, algorithm C). The models
    interact as in H. A. P. Blom, Y. Bar-Shalom, IEEE Trans. Automatic Control 33, 1988.
    """

    models: tuple[AbstractMotionModel, ...]  #: Motion models with equal numbers of states.
    sojourn: Scalar  #: Mean time between changes of the goal's model, s; unused with one model.
    #: Running mean of the normalised innovation squared, divided by the dimension, above which the filter has diverged.
    #: The mean starts at 1 and has a memory of 20 measurements, each of which counts as at most 5 `nis_max`.
    nis_max: Scalar
    sigma_max: Scalar  #: Standard deviation of the position above which the filter has diverged, m.
    #: "ekf": extended Kalman filter; "ukf": unscented Kalman filter.
    kind: Literal["ekf", "ukf"] = eqx.field(static=True, default="ekf")
    points: SigmaPoints = eqx.field(static=True, default=SigmaPoints())  #: Sigma points of the unscented filter.
    #: Number of stored samples of the aircraft's motion; must exceed the greatest delay of a measurement in samples.
    #: 0: no measurement is delayed.
    slots: int = eqx.field(static=True, default=0)

    def init(self, mean: Float[Array, "6"], sigmas: Float[Array, "6"]) -> GoalTrack:
        """Return the state before the first measurement (see `AbstractGoalFilter.init`).

        If the models have a turn rate, the turn rate starts at 0 with a standard deviation of 0.05 rad/s.
        """
        zero, vehicle_motion, models = jnp.asarray(0, dtype=jnp.int32), None, len(self.models)
        if self.slots:
            vehicle_motion = VehicleMotion(jnp.zeros((self.slots, 3)), jnp.zeros((self.slots, 3)))
        if self.models[0].size == 7:
            mean = jnp.concatenate([mean, jnp.zeros_like(mean[:1])])
            sigmas = jnp.concatenate([sigmas, jnp.full_like(sigmas[:1], _TURN_SIGMA)])
        unit_nis = jnp.ones_like(mean[0])
        return GoalTrack(
            means=jnp.broadcast_to(mean, (models, mean.shape[0])),
            covariances=jnp.broadcast_to(jnp.diag(sigmas**2), (models, mean.shape[0], mean.shape[0])),
            shares=jnp.full(models, 1.0 / models),
            number=zero,
            count=zero,
            nis=unit_nis,
            nis_mean=unit_nis,
            vehicle_motion=vehicle_motion,
        )

    def step(
        self, filter_state: GoalTrack, reading: GoalReading, vehicle_motion: VehicleMotion, instant: Instant
    ) -> tuple[GoalTrack, GoalEstimate]:
        """Return filter state and estimate after the goal reading of a sample, which may be empty or delayed."""
        motion_at_measurement = vehicle_motion
        if filter_state.vehicle_motion is not None:
            is_current_slot = jnp.arange(self.slots)[:, None] == instant.number % self.slots
            motion_history = jax.tree.map(
                lambda history, sample: jnp.where(is_current_slot, sample[None], history),
                filter_state.vehicle_motion,
                vehicle_motion,
            )
            filter_state = eqx.tree_at(lambda m: m.vehicle_motion, filter_state, motion_history)
            motion_at_measurement = jax.tree.map(lambda history: history[reading.number % self.slots], motion_history)
        is_measured = jnp.any(reading.measured)

        updated = select_if_any(
            is_measured, lambda: self.update(filter_state, reading, motion_at_measurement, instant), filter_state
        )
        mean, covariance = self.predict(updated, (instant.number - updated.number) * instant.step)
        return updated, GoalEstimate(mean, covariance, is_measured, updated.nis, self._status(updated, covariance))

    def predict(self, track: GoalTrack, elapsed: ScalarLike) -> tuple[Float[Array, "6"], Float[Array, "6 6"]]:
        """Return predicted mean and covariance of the goal's position and velocity (NED, m and m/s).

        `elapsed` is the time since the latest measurement, s.
        """
        pairs = [
            self._predict_model(model, track.means[k], track.covariances[k], elapsed)
            for k, model in enumerate(self.models)
        ]
        means = jnp.stack([mean for mean, _ in pairs])
        covariances = jnp.stack([model_covariance for _, model_covariance in pairs])
        mean, covariance = _mixture_moments(track.shares, means, covariances)
        return mean[:6], covariance[:6, :6]

    def update(
        self, track: GoalTrack, reading: GoalReading, vehicle_motion: VehicleMotion, instant: Instant
    ) -> GoalTrack:
        """Return the state after one measurement; `vehicle_motion` must be the aircraft's motion at the measurement."""
        elapsed = (reading.number - track.number) * instant.step
        forward, back = jnp.maximum(elapsed, 0.0), jnp.minimum(elapsed, 0.0)
        means, covariances, shares = self._mix_models(track, forward)
        updates = []
        for k, model in enumerate(self.models):
            mean, covariance = self._predict_model(model, means[k], covariances[k], forward)

            def off(goal_state: Float[Array, " n"], model: AbstractMotionModel = model) -> Float[Array, "6"]:
                return innovation(
                    reading,
                    predicted_measurement(reading, model.predict_state(goal_state, back)[:6], vehicle_motion, instant),
                )

            measurement = Measurement(off, reading.sigmas**2, reading.measured)
            if self.kind == "ekf":
                updates.append(extended_update(mean, covariance, measurement))
            else:
                updates.append(unscented_update(mean, covariance, measurement, self.points))
        logs = jnp.stack([model_update.log_likelihood for model_update in updates])
        weights = shares * jnp.exp(logs - jnp.max(logs))
        weights = weights / jnp.sum(weights)
        dimension = jnp.maximum(jnp.sum(reading.measured), 1)
        nis = jnp.sum(weights * jnp.stack([model_update.nis for model_update in updates])) / dimension
        limited_nis = jnp.minimum(nis, _OUTLIER * self.nis_max)
        return GoalTrack(
            means=jnp.stack([model_update.mean for model_update in updates]),
            covariances=jnp.stack([model_update.covariance for model_update in updates]),
            shares=weights,
            number=jnp.maximum(track.number, reading.number),
            count=track.count + 1,
            nis=nis,
            nis_mean=track.nis_mean + (limited_nis - track.nis_mean) / _NIS_MEMORY,
            vehicle_motion=track.vehicle_motion,
        )

    def _predict_model(
        self, model: AbstractMotionModel, mean: Array, covariance: Array, span: ScalarLike
    ) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
        if self.kind == "ekf":
            return model.predict_state(mean, span), model.predict_covariance(mean, covariance, span)
        return unscented_prediction(
            lambda s: model.predict_state(s, span), mean, covariance, model.process_noise(span), self.points
        )

    def _mix_models(self, track: GoalTrack, span: ScalarLike) -> tuple[Array, Array, Array]:
        """Return means, covariances and probabilities after the mixing step (IMM) for `span` seconds."""
        count = len(self.models)
        if count == 1:
            return track.means, track.covariances, track.shares
        # a Markov chain with equal transition rates between all models
        staying = jnp.exp(-jnp.asarray(span) / self.sojourn * count / (count - 1))
        chain = staying * jnp.eye(count, dtype=staying.dtype) + (1.0 - staying) / count
        joint = chain * track.shares[:, None]
        shares = jnp.sum(joint, axis=0)
        weights = joint / shares[None, :]
        means = jnp.sum(weights[:, :, None] * track.means[:, None, :], axis=0)
        differences = track.means[:, None, :] - means[None, :, :]
        mixed_covariances = track.covariances[:, None] + differences[..., :, None] * differences[..., None, :]
        return means, jnp.sum(weights[:, :, None, None] * mixed_covariances, axis=0), shares

    def _status(self, track: GoalTrack, covariance: Float[Array, "6 6"]) -> Integer:
        variance_max = jnp.max(jnp.stack([covariance[k, k] for k in range(3)]))
        diverged = (track.nis_mean > self.nis_max) | ~(variance_max <= self.sigma_max**2)
        measured_status = jnp.where(track.count > 0, GOAL_KNOWN, GOAL_NEVER_SEEN)
        return jnp.where((track.count > 0) & diverged, GOAL_DIVERGED, measured_status).astype(jnp.int32)


def _mixture_moments(shares: Array, means: Array, covariances: Array) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
    """Return mean and covariance of a mixture of models with the probabilities `shares`."""
    if means.shape[0] == 1:
        return means[0], covariances[0]
    mean = jnp.sum(shares[:, None] * means, axis=0)
    differences = means - mean[None]
    return mean, jnp.sum(
        shares[:, None, None] * (covariances + differences[:, :, None] * differences[:, None, :]), axis=0
    )


def predicted_measurement(
    reading: GoalReading, state: Float[Array, "6"], vehicle_motion: VehicleMotion, instant: Instant
) -> Float[Array, "6"]:
    """Return the error-free values (6,) of a measurement of the same kind and units as `reading`.

    `state` is the goal's position and velocity (NED, m and m/s); `vehicle_motion` is the aircraft's motion.
    """
    if reading.kind == "report":
        return state
    goal = GoalState(state[:3], state[3:])
    return line_of_sight_values(
        line_of_sight(instant.environment.earth, vehicle_motion.position_n, vehicle_motion.velocity_n, goal)
    )


def innovation(reading: GoalReading, predicted: Float[Array, "6"]) -> Float[Array, "6"]:
    """Return measured minus predicted values (6,), in the reading's units; differences of angles are in -pi..pi."""
    difference = reading.values - predicted
    if reading.kind == "sight":
        difference = jnp.where(_ANGLES, difference - 2 * jnp.pi * jnp.round(difference / (2 * jnp.pi)), difference)
    return difference


def hand_over_goal(receiver_state: Any, giver_state: Any) -> Any:
    """Return the sensor and estimator states of an aircraft that takes over another aircraft's goal.

    The result is `receiver_state` with the giver's goal estimates and goal motions (`GoalTrack`, `GoalState`) and with
    an empty `MeasurementQueue`. States of other types, such as the state of a user-defined filter, do not change.
    `receiver_state` and `giver_state` must have equal structures of NumPy or JAX arrays.
    """
    return jax.tree.map(_hand_over_node, receiver_state, giver_state, is_leaf=_is_goal_state)


def _is_goal_state(node: Any) -> bool:
    return isinstance(node, GoalTrack | GoalState | MeasurementQueue)


def _hand_over_node(receiver_node: Any, giver_node: Any) -> Any:
    if isinstance(receiver_node, GoalTrack):
        return dataclasses.replace(giver_node, vehicle_motion=receiver_node.vehicle_motion)
    if isinstance(receiver_node, MeasurementQueue):
        return eqx.tree_at(lambda queue: queue.waiting, receiver_node, receiver_node.waiting & False)
    return giver_node if isinstance(receiver_node, GoalState) else receiver_node
