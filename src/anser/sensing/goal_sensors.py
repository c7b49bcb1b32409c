"""Sensors of a goal with errors.

Latency, field of view and dropouts, and the complete set of an aircraft's sensors with errors. Error models of civil
sensors: nothing is decoded or received.
"""

import math
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from anser.environment.earth import AbstractEarth
from anser.numerics.arrays import select_if_any
from anser.numerics.randomness import GOAL_SENSOR
from anser.parts.perception import AbstractSensors, GoalReading, Instant, LineOfSight, Reading, Truth
from anser.sensing.ideal_sensors import line_of_sight_values, true_line_of_sight
from anser.sensing.vehicle_sensors import Dropouts, VehicleSensors, is_due
from anser.shapes import Flag, Scalar, Vector3
from anser.spatial.rotations import rotate, safe_norm

_NORMALS, _UNIFORMS = 6, 3  # errors; outage, loss, latency
_RANGE, _AZIMUTHS = np.eye(6, dtype=bool)[0], np.array([False, True, False, False, True, False])
_COS_MIN = 0.02  # of the elevation: nearer to the vertical the azimuth's error no longer grows


class FieldOfView(eqx.Module):
    """What a sensor can see.

    Attributes
    ----------
    axis_b
        Its middle, a unit vector in body axes.
    half_angle
        From there to its edge, rad; pi: all round.
    range_max
        m.
    """

    axis_b: Vector3
    half_angle: Scalar
    range_max: Scalar

    def sees(self, R_bn: Array, line_n: Vector3) -> Flag:
        """Whether what lies along a line from the aircraft (NED, m) is in it."""
        distance = safe_norm(line_n)
        along = jnp.sum(self.axis_b * rotate(R_bn, line_n)) / jnp.maximum(distance, 1e-9)
        return (distance <= self.range_max) & (along >= jnp.cos(jnp.minimum(self.half_angle, jnp.pi)) - 1e-12)


class MeasurementQueue(eqx.Module):
    """Measurements that are on their way; leading axis slots.

    Attributes
    ----------
    readings
        What was measured.
    arrives
        Sample at which each arrives.
    waiting
        Whether there is one.
    """

    readings: GoalReading
    arrives: Int[Array, " slots"]
    waiting: Bool[Array, " slots"]


class GoalSensorState(eqx.Module):
    """A goal sensor between two samples: its biases, whether an outage is on, and what is on its way (if late)."""

    biases: Float[Array, "6"]
    outage: Flag
    queue: MeasurementQueue | None


class GoalSensor(eqx.Module):
    """One sensor of a goal.

    Attributes
    ----------
    sigmas
        Standard deviations of the errors of each measurement, as in `GoalReading`; an angle's is that across the line
        of sight: the azimuth's own is greater by 1 / cos(elevation).
    range_share
        A further error of the range, as a part of it.
    bias_sigmas
        Of what is drawn once in a flight.
    measures
        Which of the six there are.
    period
        Between two measurements, s; a multiple of the sampling period.
    latency
        Least and greatest time until a measurement arrives, s: drawn evenly in between, so that it may come after a
        later one.
    view
        Where it sees.
    dropouts
        When it fails.
    kind
        "sight": line of sight from the aircraft; "report": the goal's own position and velocity.
    slots
        How many measurements can be on their way; 0 without latency.
    """

    sigmas: Float[Array, "6"]
    range_share: Scalar
    bias_sigmas: Float[Array, "6"]
    measures: Bool[Array, "6"]
    period: Scalar
    latency: Float[Array, "2"]
    view: FieldOfView
    dropouts: Dropouts
    kind: Literal["sight", "report"] = eqx.field(static=True)
    slots: int = eqx.field(static=True, default=0)

    def init(self, truth: Truth, instant: Instant) -> GoalSensorState:
        """Its state before the first sample."""
        biases = self.bias_sigmas * instant.normals(GOAL_SENSOR, _NORMALS, once=True)
        drawn = instant.uniforms(GOAL_SENSOR, _NORMALS + _UNIFORMS, once=True)
        outage = self.dropouts.initial_outage(drawn[_NORMALS])
        queue = None
        if self.slots:
            empty = self._nothing(instant)
            rows = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (self.slots, *leaf.shape)), empty)
            queue = MeasurementQueue(rows, jnp.zeros(self.slots, dtype=jnp.int32), jnp.zeros(self.slots, dtype=bool))
        return GoalSensorState(biases, outage, queue)

    def read(
        self, sensor_state: GoalSensorState, truth: Truth, instant: Instant
    ) -> tuple[GoalReading, GoalSensorState]:
        """What arrives at a sample, and its state after it."""
        due = is_due(instant, self.period)
        outage, made, delay = select_if_any(
            due,
            lambda: self._tried(sensor_state, truth, instant),
            (sensor_state.outage, self._nothing(instant), self.latency[0]),
        )
        if sensor_state.queue is None:
            return made, GoalSensorState(sensor_state.biases, outage, None)
        reading, queue = self._passed(sensor_state.queue, made, instant, delay)
        return reading, GoalSensorState(sensor_state.biases, outage, queue)

    def _tried(self, sensor_state: GoalSensorState, truth: Truth, instant: Instant) -> tuple[Flag, GoalReading, Scalar]:
        """Whether it fails when a measurement is due, what it measures, and how long that takes to arrive, s."""
        uniforms = instant.uniforms(GOAL_SENSOR, _NORMALS + _UNIFORMS)[_NORMALS:]  # lanes beyond those of the normals
        after = self.dropouts.next_outage(sensor_state.outage, self.period, uniforms[0])
        outage = jnp.where(instant.number > 0, after, sensor_state.outage)
        made = self._measured(sensor_state, truth, instant, ~self.dropouts.is_lost(outage, uniforms[1]))
        return outage, made, self.latency[0] + uniforms[2] * (self.latency[1] - self.latency[0])

    def _measured(self, sensor_state: GoalSensorState, truth: Truth, instant: Instant, works: Flag) -> GoalReading:
        goal = truth.goal
        if goal is None:
            raise ValueError("a sensor of a goal on an aircraft without one")
        sight = true_line_of_sight(truth, instant.environment.earth)
        assert sight is not None
        line_n = _line(truth, instant.environment.earth)
        seen = works & truth.goal_sensor_works & self.view.sees(truth.condition.R_bn, line_n)
        if self.kind == "sight":
            values, sigmas = line_of_sight_values(sight), self._sight_sigmas(sight)
        else:
            values, sigmas = jnp.concatenate([goal.position_n, goal.velocity_n]), self.sigmas
        errors = sensor_state.biases + sigmas * instant.normals(GOAL_SENSOR, _NORMALS)
        return GoalReading(
            values=jnp.where(self.measures, values + errors, 0.0),
            sigmas=sigmas,
            measured=self.measures & seen,
            number=instant.number,
            kind=self.kind,
        )

    def _sight_sigmas(self, sight: LineOfSight) -> Array:
        level = jnp.maximum(jnp.cos(sight.elevation), _COS_MIN)
        sigmas = jnp.where(_AZIMUTHS, self.sigmas / level, self.sigmas)
        of_range = jnp.sqrt(self.sigmas[0] ** 2 + (self.range_share * sight.range) ** 2)
        return jnp.where(_RANGE, of_range, sigmas)

    def _nothing(self, instant: Instant) -> GoalReading:
        none = jnp.zeros_like(self.sigmas)
        return GoalReading(none, jnp.ones_like(self.sigmas), jnp.zeros(6, dtype=bool), instant.number, self.kind)

    def _passed(
        self, queue: MeasurementQueue, made: GoalReading, instant: Instant, delay: Scalar
    ) -> tuple[GoalReading, MeasurementQueue]:
        """Put a measurement on its way, and take the one that is to arrive first, if it is there."""
        here, never = jnp.any(made.measured), jnp.iinfo(jnp.int32).max
        free = jnp.argmin(queue.waiting)
        at = jnp.arange(self.slots) == free
        put = at & here
        late = instant.number + jnp.round(delay / instant.step).astype(instant.number.dtype)

        def placed(rows: Array, value: Array) -> Array:
            return jnp.where(put.reshape(-1, *[1] * (rows.ndim - 1)), value[None], rows)

        readings = jax.tree.map(placed, queue.readings, made)
        arrives = jnp.where(put, late, queue.arrives)
        waiting = queue.waiting | put
        first = jnp.argmin(jnp.where(waiting, arrives, never))
        there = waiting[first] & (arrives[first] <= instant.number)
        taken = jax.tree.map(lambda rows: rows[first], readings)
        taken = eqx.tree_at(lambda r: r.measured, taken, taken.measured & there)
        return taken, MeasurementQueue(readings, arrives, waiting & ~((jnp.arange(self.slots) == first) & there))


def queue_slots(latency_max_s: float, period_s: float) -> int:
    """How many measurements can be on their way at once: 0, or a power of two from 2 on."""
    if latency_max_s <= 0.0:
        return 0
    return 2 ** max(1, math.ceil(math.log2(latency_max_s / period_s + 2.0)))


def _line(truth: Truth, earth: AbstractEarth) -> Vector3:
    assert truth.goal is not None
    return earth.sight(truth.state.position_n, truth.goal.position_n, truth.goal.velocity_n)[0]


class NoisySensors(AbstractSensors):
    """Satellite navigation, inertial sensors and air data, and the sensor of the goal.

    Attributes
    ----------
    own
        Of the aircraft itself; None: its state is known exactly, and so is the air about it.
    goal
        Of its goal; None: its line of sight is known exactly.
    """

    vehicle: VehicleSensors | None = None
    goal: GoalSensor | None = None

    def init(self, truth: Truth, instant: Instant) -> tuple[Any, Any]:
        """State of both."""
        vehicle = None if self.vehicle is None else self.vehicle.init(truth, instant)
        return vehicle, None if self.goal is None else self.goal.init(truth, instant)

    def read(self, sensor_state: tuple[Any, Any], truth: Truth, instant: Instant) -> tuple[Reading, tuple[Any, Any]]:
        """What both give."""
        vehicle, goal = sensor_state
        force_b = truth.condition.wrench.force_b / truth.airframe.mass_properties.mass
        sight = true_line_of_sight(truth, instant.environment.earth) if self.goal is None else None
        reading = Reading(truth.state, truth.condition, force_b, sight, goal_sensor_works=truth.goal_sensor_works)
        if self.goal is not None:
            seen, goal = self.goal.read(goal, truth, instant)
            reading = eqx.tree_at(lambda r: r.goal, reading, seen, is_leaf=lambda leaf: leaf is None)
        if self.vehicle is not None:
            found, vehicle = self.vehicle.read(vehicle, truth, instant)
            state = eqx.tree_at(
                lambda s: (s.position_n, s.quaternion, s.rates_b),
                truth.state,
                (found.fix.position_n, found.quaternion, found.rates_b),
            )
            reading = eqx.tree_at(
                lambda r: (r.state, r.specific_force_b, r.fix, r.velocity_air_b),
                reading,
                (state, found.specific_force_b, found.fix, found.velocity_air_b),
                is_leaf=lambda leaf: leaf is None,
            )
        return reading, (vehicle, goal)
