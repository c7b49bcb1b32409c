"""Sensor of a goal with errors, latency, field of view and dropouts."""

import math
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from anser.numerics.arrays import select_if_any
from anser.numerics.randomness import GOAL_SENSOR
from anser.parts.perception import GoalReading, Instant, LineOfSight, Truth
from anser.sensing.ideal_sensors import line_of_sight_values, true_line_of_sight
from anser.sensing.vehicle_sensors import Dropouts, is_due
from anser.shapes import Flag, Scalar, Vector3
from anser.spatial.rotations import rotate, safe_norm

_NORMALS, _UNIFORMS = 6, 3  # errors; outage, loss, latency
_RANGE, _AZIMUTHS = np.eye(6, dtype=bool)[0], np.array([False, True, False, False, True, False])
_COS_MIN = 0.02  # smallest cosine of the elevation: the azimuth error is bounded near the vertical


class FieldOfView(eqx.Module):
    """Field of view of a goal sensor: a cone about a body-fixed axis, up to a greatest range."""

    axis_b: Vector3  #: Central axis, a unit vector in body axes.
    half_angle: Scalar  #: Angle from the axis to the edge, rad; pi: all directions.
    range_max: Scalar  #: Greatest range, m.

    def sees(self, R_bn: Array, line_n: Vector3) -> Flag:
        """Whether a point is in the field of view; `line_n` is the vector from aircraft to point, NED, m."""
        distance = safe_norm(line_n)
        along = jnp.sum(self.axis_b * rotate(R_bn, line_n)) / jnp.maximum(distance, 1e-9)
        return (distance <= self.range_max) & (along >= jnp.cos(jnp.minimum(self.half_angle, jnp.pi)) - 1e-12)


class MeasurementQueue(eqx.Module):
    """Delayed measurements that have not arrived yet, in slots along the leading axis."""

    readings: GoalReading  # the measurements
    arrives: Int[Array, " slots"]  # number of the sample at which each measurement arrives
    waiting: Bool[Array, " slots"]  # whether each slot holds a measurement


class GoalSensorState(eqx.Module):
    """State of a goal sensor between two samples."""

    biases: Float[Array, "6"]  # biases of this flight, in order and units of `NoisyGoalSensor.bias_sigmas`
    outage: Flag  # whether the sensor is in an outage
    queue: MeasurementQueue | None  # delayed measurements; None: the sensor has no latency


def _of_azimuths(errors: Array, sight: LineOfSight) -> Array:
    """Return `errors` (6,) with the errors of azimuth and azimuth rate divided by max(cos(elevation), 0.02)."""
    return jnp.where(_AZIMUTHS, errors / jnp.maximum(jnp.cos(sight.elevation), _COS_MIN), errors)


class NoisyGoalSensor(eqx.Module):
    """Sensor of one goal with noise, biases, latency, dropouts and a field of view; a part of `NoisySensors`."""

    #: Standard deviations of the noise, in the order and units of `GoalReading.values`. For a line of sight, the
    #: deviations of the azimuth and the azimuth rate are these values divided by cos(elevation).
    sigmas: Float[Array, "6"]
    range_share: Scalar  #: Standard deviation of an additional range error, as a fraction of the range.
    #: Standard deviations of the biases, which are drawn once per flight, in the order and units of `sigmas`.
    bias_sigmas: Float[Array, "6"]
    measures: Bool[Array, "6"]  #: Flags of the measured components.
    period: Scalar  #: Time between two measurements, s; a multiple of the sampling period.
    #: Least and greatest latency of a measurement, s. The latency is uniformly distributed, so measurements may arrive
    #: out of sequence (see `read`).
    latency: Float[Array, "2"]
    view: FieldOfView  #: Field of view.
    dropouts: Dropouts  #: Random losses and outages.
    #: "sight": line of sight from the aircraft; "report": the goal's reported position and velocity.
    kind: Literal["sight", "report"] = eqx.field(static=True)
    slots: int = eqx.field(static=True, default=0)  #: Capacity of the queue (see `queue_slots`); 0: no latency.

    def init(self, truth: Truth, instant: Instant) -> GoalSensorState:
        """Return the state before the first sample: random biases, random outage flag, and an empty queue."""
        biases = self.bias_sigmas * instant.normals(GOAL_SENSOR, _NORMALS, once=True)
        uniforms = instant.uniforms(GOAL_SENSOR, _NORMALS + _UNIFORMS, once=True)
        outage = self.dropouts.initial_outage(uniforms[_NORMALS])
        queue = None
        if self.slots:
            empty = self._empty_reading(instant)
            empty_readings = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (self.slots, *leaf.shape)), empty)
            queue = MeasurementQueue(
                empty_readings, jnp.zeros(self.slots, dtype=jnp.int32), jnp.zeros(self.slots, dtype=bool)
            )
        return GoalSensorState(biases, outage, queue)

    def read(
        self, sensor_state: GoalSensorState, truth: Truth, instant: Instant
    ) -> tuple[GoalReading, GoalSensorState]:
        """Return the measurement that arrives at this sample, or an empty reading, and the new sensor state.

        At most one delayed measurement arrives per sample. Further measurements that are due arrive at later samples,
        and are lost once their age exceeds the greatest latency by more than one sample.
        """
        is_sampled = is_due(instant, self.period)
        outage, measurement, delay = select_if_any(
            is_sampled,
            lambda: self._sample(sensor_state, truth, instant),
            (sensor_state.outage, self._empty_reading(instant), self.latency[0]),
        )
        if sensor_state.queue is None:
            return measurement, GoalSensorState(sensor_state.biases, outage, None)
        reading, queue = self._exchange(sensor_state.queue, measurement, instant, delay)
        return reading, GoalSensorState(sensor_state.biases, outage, queue)

    def _sample(
        self, sensor_state: GoalSensorState, truth: Truth, instant: Instant
    ) -> tuple[Flag, GoalReading, Scalar]:
        """Return outage flag, measurement and latency (s); the measurement is empty if lost or out of view."""
        uniforms = instant.uniforms(GOAL_SENSOR, _NORMALS + _UNIFORMS)[
            _NORMALS:
        ]  # the generator's lanes after those of the normals
        next_outage = self.dropouts.next_outage(sensor_state.outage, self.period, uniforms[0])
        outage = jnp.where(instant.number > 0, next_outage, sensor_state.outage)
        measurement = self._measure(sensor_state, truth, instant, ~self.dropouts.is_lost(outage, uniforms[1]))
        return outage, measurement, self.latency[0] + uniforms[2] * (self.latency[1] - self.latency[0])

    def _measure(self, sensor_state: GoalSensorState, truth: Truth, instant: Instant, works: Flag) -> GoalReading:
        goal = truth.goal
        if goal is None:
            raise ValueError("a sensor of a goal on an aircraft without one")
        earth = instant.environment.earth
        sight = true_line_of_sight(truth, earth)
        assert sight is not None
        line_n = earth.sight(truth.state.position_n, goal.position_n, goal.velocity_n)[0]
        is_seen = works & truth.goal_sensor_works & self.view.sees(truth.condition.R_bn, line_n)
        if self.kind == "sight":
            values, sigmas = line_of_sight_values(sight), self._sight_sigmas(sight)
            biases = _of_azimuths(sensor_state.biases, sight)
        else:
            values, sigmas = jnp.concatenate([goal.position_n, goal.velocity_n]), self.sigmas
            biases = sensor_state.biases
        errors = biases + sigmas * instant.normals(GOAL_SENSOR, _NORMALS)
        return GoalReading(
            values=jnp.where(self.measures, values + errors, 0.0),
            sigmas=sigmas,
            measured=self.measures & is_seen,
            number=instant.number,
            kind=self.kind,
        )

    def _sight_sigmas(self, sight: LineOfSight) -> Array:
        sigmas = _of_azimuths(self.sigmas, sight)
        of_range = jnp.sqrt(self.sigmas[0] ** 2 + (self.range_share * sight.range) ** 2)
        return jnp.where(_RANGE, of_range, sigmas)

    def _empty_reading(self, instant: Instant) -> GoalReading:
        none = jnp.zeros_like(self.sigmas)
        return GoalReading(none, jnp.ones_like(self.sigmas), jnp.zeros(6, dtype=bool), instant.number, self.kind)

    def _exchange(
        self, queue: MeasurementQueue, measurement: GoalReading, instant: Instant, delay: Scalar
    ) -> tuple[GoalReading, MeasurementQueue]:
        """Put a measurement with latency `delay` (s) into the queue; return the earliest measurement due and the queue.

        The returned measurement is empty if no measurement is due.
        """
        is_new, never = jnp.any(measurement.measured), jnp.iinfo(jnp.int32).max
        # the filter stores the aircraft's motion up to the greatest age
        age_max = jnp.round(self.latency[1] / instant.step).astype(instant.number.dtype) + 1
        waiting = queue.waiting & (instant.number - queue.readings.number <= age_max)
        free_slot = jnp.argmin(waiting)
        is_free_slot = jnp.arange(self.slots) == free_slot
        is_filled = is_free_slot & is_new
        arrival_sample = instant.number + jnp.round(delay / instant.step).astype(instant.number.dtype)

        def placed(slot_values: Array, value: Array) -> Array:
            return jnp.where(is_filled.reshape(-1, *[1] * (slot_values.ndim - 1)), value[None], slot_values)

        readings = jax.tree.map(placed, queue.readings, measurement)
        arrives = jnp.where(is_filled, arrival_sample, queue.arrives)
        waiting = waiting | is_filled
        next_slot = jnp.argmin(jnp.where(waiting, arrives, never))
        has_arrived = waiting[next_slot] & (arrives[next_slot] <= instant.number)
        arrived_reading = jax.tree.map(lambda slot_values: slot_values[next_slot], readings)
        arrived_reading = eqx.tree_at(lambda r: r.measured, arrived_reading, arrived_reading.measured & has_arrived)
        return arrived_reading, MeasurementQueue(
            readings, arrives, waiting & ~((jnp.arange(self.slots) == next_slot) & has_arrived)
        )


def queue_slots(latency_max_s: float, period_s: float) -> int:
    """Return the number of slots in the queue of delayed measurements: a power of 2, at least 2; 0 for latency 0."""
    if latency_max_s <= 0.0:
        return 0
    return 2 ** max(1, math.ceil(math.log2(latency_max_s / period_s + 2.0)))
