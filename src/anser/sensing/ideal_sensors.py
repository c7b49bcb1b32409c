"""Ideal sensors: the true state without error, at once or after a constant delay."""

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft.airframe import AircraftState
from anser.aircraft.motion import flight_condition
from anser.environment.earth import AbstractEarth
from anser.parts.perception import (
    AbstractSensors,
    GoalState,
    Instant,
    LineOfSight,
    Reading,
    Truth,
    measure_line_of_sight,
    velocity_over_ground_n,
)
from anser.shapes import Count, Scalar, ScalarLike, Vector3
from anser.spatial.rotations import normalize


class IdealSensors(AbstractSensors):
    """Neither noise nor delay; the goal is seen along a straight line through space (theory section 7)."""

    def init(self, truth: Truth, instant: Instant) -> None:
        """Nothing is kept."""

    def read(self, sensor_state: None, truth: Truth, instant: Instant) -> tuple[Reading, None]:
        """The truth."""
        specific_force_b = truth.condition.wrench.force_b / truth.airframe.mass_properties.mass
        sight = true_line_of_sight(truth, instant.environment.earth)
        return Reading(
            truth.state, truth.condition, specific_force_b, sight, goal_sensor_works=truth.goal_sensor_works
        ), None


def true_line_of_sight(truth: Truth, earth: AbstractEarth) -> LineOfSight | None:
    """Line of sight to the goal; None for an aircraft without one."""
    if truth.goal is None:
        return None
    velocity_n = velocity_over_ground_n(truth.condition, truth.state)
    return line_of_sight(earth, truth.state.position_n, velocity_n, truth.goal)


def line_of_sight(earth: AbstractEarth, position_n: Vector3, velocity_n: Vector3, goal: GoalState) -> LineOfSight:
    """Straight line through space to a goal in the chart: its direction and rates in the NED axes of the own place.

    `position_n` is the own place in the chart (3,), m, `velocity_n` the own velocity over ground (3,), NED, m/s.
    """
    line_n, goal_over_ground_n = earth.sight(position_n, goal.position_n, goal.velocity_n)
    return measure_line_of_sight(jnp.zeros_like(velocity_n), velocity_n, line_n, goal_over_ground_n)


def line_of_sight_values(sight: LineOfSight) -> Float[Array, "6"]:
    """Range (m), azimuth and elevation (rad), and their rates, in the order of `GoalReading`."""
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


class SensorSample(eqx.Module):
    """What is measured at one instant: own state, specific force (m/s^2), line of sight to the goal."""

    state: AircraftState
    specific_force_b: Vector3
    sight: LineOfSight | None


class SampleRing(eqx.Module):
    """The latest samples, in a ring: sample number n stands in row n modulo the number of rows."""

    buffer: Any

    def with_sample(self, number: Count, sample: Any) -> "SampleRing":
        """SampleRing with that of a number, which replaces the oldest."""

        def put(buffer: Array, value: Array) -> Array:
            return buffer.at[number % buffer.shape[0]].set(value)

        return SampleRing(jax.tree.map(put, self.buffer, sample))

    def delayed_sample(self, number: Count, periods: ScalarLike) -> Any:
        """Sample `periods` (0 to rows - 2, whole or not) before that of a number; linear between two samples."""
        whole = jnp.floor(periods)
        part = periods - whole
        newer = number - whole.astype(number.dtype)

        def at(buffer: Array) -> Array:
            last, before = buffer[newer % buffer.shape[0]], buffer[(newer - 1) % buffer.shape[0]]
            return last + part * (before - last)

        return jax.tree.map(at, self.buffer)


class DelayedSensors(AbstractSensors):
    """Ideal sensors whose readings are late altogether.

    Before time 0 they give the state at time 0. Angles that wrap (course, azimuth) are not among what is interpolated:
    attitude is a quaternion, the line of sight to the goal is that of the latest whole period.

    Attributes
    ----------
    delay
        s; 0 to `delay_max`.
    delay_max
        Longest delay of a study, s: it sets the length of the memory.
    period
        Sampling period that the memory is made for, s.
    """

    delay: Scalar
    delay_max: float = eqx.field(static=True)
    period: float = eqx.field(static=True)

    def init(self, truth: Truth, instant: Instant) -> SampleRing:
        """SampleRing of an aircraft that has been in its present flight for long."""
        count = math.ceil(self.delay_max / self.period - 1e-9) + 2
        sample = _sample(truth, instant)
        return SampleRing(jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (count, *jnp.shape(leaf))), sample))

    def read(self, sensor_state: SampleRing, truth: Truth, instant: Instant) -> tuple[Reading, SampleRing]:
        """What was measured `delay` ago."""
        sensor_state = sensor_state.with_sample(instant.number, _sample(truth, instant))
        periods = self.delay / instant.step
        delayed = sensor_state.delayed_sample(instant.number, periods)
        quaternion = delayed.state.quaternion
        # normalized only between samples: a reading that is not late is the sample itself
        quaternion = jnp.where(periods > jnp.floor(periods), normalize(quaternion), quaternion)
        state = eqx.tree_at(lambda s: s.quaternion, delayed.state, quaternion)
        sight = sensor_state.delayed_sample(instant.number, jnp.round(periods)).sight
        now = flight_condition(truth.airframe, instant.environment, instant.time, state, disturbance=truth.disturbance)
        works = truth.goal_sensor_works
        return Reading(state, now, delayed.specific_force_b, sight, goal_sensor_works=works), sensor_state


def _sample(truth: Truth, instant: Instant) -> SensorSample:
    force_b, mass = truth.condition.wrench.force_b, truth.airframe.mass_properties.mass
    return SensorSample(truth.state, force_b / mass, true_line_of_sight(truth, instant.environment.earth))
