"""Ideal sensors: the true state without error, immediately or after a constant delay."""

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft.airframe import AircraftState
from anser.aircraft.motion import air_data_and_forces
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
from anser.shapes import Integer, Scalar, ScalarLike, Vector3
from anser.spatial.rotations import normalize


class IdealSensors(AbstractSensors):
    """Sensors without error or delay. The line of sight to the goal is straight in space (theory section 7)."""

    def read(self, sensor_state: None, truth: Truth, instant: Instant) -> tuple[Reading, None]:
        """Return the reading that equals the truth."""
        specific_force_b = truth.condition.wrench.force_b / truth.airframe.mass_properties.mass
        sight = true_line_of_sight(truth, instant.environment.earth)
        return Reading(
            truth.state, truth.condition, specific_force_b, sight, goal_sensor_works=truth.goal_sensor_works
        ), None


def true_line_of_sight(truth: Truth, earth: AbstractEarth) -> LineOfSight | None:
    """Return the exact line of sight to the goal; None for an aircraft without a goal."""
    if truth.goal is None:
        return None
    velocity_n = velocity_over_ground_n(truth.condition, truth.state)
    return line_of_sight(earth, truth.state.position_n, velocity_n, truth.goal)


def line_of_sight(earth: AbstractEarth, position_n: Vector3, velocity_n: Vector3, goal: GoalState) -> LineOfSight:
    """Return the straight line of sight to a goal, with rates, in the NED axes at the aircraft's position.

    `position_n` is the aircraft's chart position, m; `velocity_n` the aircraft's velocity over the ground, NED, m/s.
    """
    line_n, goal_over_ground_n = earth.sight(position_n, goal.position_n, goal.velocity_n)
    return measure_line_of_sight(jnp.zeros_like(velocity_n), velocity_n, line_n, goal_over_ground_n)


def line_of_sight_values(sight: LineOfSight) -> Float[Array, "6"]:
    """Return range (m), azimuth and elevation (rad), and the three rates (m/s, rad/s), as in `GoalReading.values`."""
    rates = sight.range_rate, sight.azimuth_rate, sight.elevation_rate
    return jnp.stack([sight.range, sight.azimuth, sight.elevation, *rates])


class SensorSample(eqx.Module):
    """Values of one sample that `DelayedSensors` stores."""

    state: AircraftState
    specific_force_b: Vector3  #: Specific force, body axes, m/s^2.
    #: True motion of the goal; `hand_over_goal` replaces the motion in all stored samples.
    goal: GoalState | None


class SampleRing(eqx.Module):
    """Ring buffer of the latest samples."""

    buffer: Any  #: Pytree of arrays with a leading axis of samples: sample number n is at index n modulo the length.

    def with_sample(self, number: Integer, sample: Any) -> "SampleRing":
        """Return the ring with `sample` as sample number `number`, in place of the oldest sample."""

        def put(buffer: Array, value: Array) -> Array:
            return buffer.at[number % buffer.shape[0]].set(value)

        return SampleRing(jax.tree.map(put, self.buffer, sample))

    def delayed_sample(self, number: Integer, periods: ScalarLike) -> Any:
        """Return the values `periods` sampling periods before sample `number`, by linear interpolation.

        `periods` must be between 0 and the ring's length minus 2; fractions are allowed.
        """
        whole = jnp.floor(periods)
        fraction = periods - whole
        newer = number - whole.astype(number.dtype)

        def at(buffer: Array) -> Array:
            newer_sample, older_sample = buffer[newer % buffer.shape[0]], buffer[(newer - 1) % buffer.shape[0]]
            return newer_sample + fraction * (older_sample - newer_sample)

        return jax.tree.map(at, self.buffer)


class DelayedSensors(AbstractSensors):
    """Ideal sensors with a constant delay of the readings of motion, specific force and goal.

    Wind, gusts and changes of the airframe act without delay. If the delay reaches back before time 0, the reading is
    the state at time 0. Between two samples, readings are interpolated linearly.
    """

    delay: Scalar  #: Delay, s; 0 to `delay_max`.
    delay_max: float = eqx.field(static=True)  #: Longest delay, s, which sets the length of the ring buffer.
    period: float = eqx.field(static=True)  #: Sampling period of the flight, s.

    def init(self, truth: Truth, instant: Instant) -> SampleRing:
        """Return a ring filled with the present sample."""
        count = math.ceil(self.delay_max / self.period - 1e-9) + 2
        sample = _sample(truth)
        return SampleRing(jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (count, *jnp.shape(leaf))), sample))

    def read(self, sensor_state: SampleRing, truth: Truth, instant: Instant) -> tuple[Reading, SampleRing]:
        """Return the reading of the motion `delay` seconds ago, and the ring with the present sample added."""
        sensor_state = sensor_state.with_sample(instant.number, _sample(truth))
        periods = self.delay / instant.step
        delayed = sensor_state.delayed_sample(instant.number, periods)
        quaternion = delayed.state.quaternion
        # At whole periods the reading is exactly the sample, so only interpolated quaternions are normalized.
        quaternion = jnp.where(periods > jnp.floor(periods), normalize(quaternion), quaternion)
        state = eqx.tree_at(lambda s: s.quaternion, delayed.state, quaternion)
        condition = air_data_and_forces(
            truth.airframe, instant.environment, instant.time, state, disturbance=truth.disturbance
        )
        sight = None
        if delayed.goal is not None:
            velocity_n = velocity_over_ground_n(condition, state)
            sight = line_of_sight(instant.environment.earth, state.position_n, velocity_n, delayed.goal)
        works = truth.goal_sensor_works
        return Reading(state, condition, delayed.specific_force_b, sight, goal_sensor_works=works), sensor_state


def _sample(truth: Truth) -> SensorSample:
    force_b, mass = truth.condition.wrench.force_b, truth.airframe.mass_properties.mass
    return SensorSample(truth.state, force_b / mass, truth.goal)
