"""Sensors that are late, all by the same time."""

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from anser.aircraft import AircraftState, condition
from anser.planning import LineOfSight
from anser.sensing.ideal import true_sight
from anser.sensing.interface import AbstractSensors, Instant, Reading, Truth
from anser.shapes import Count, Scalar, ScalarLike, Vector3
from anser.spatial import normalize


class Sample(eqx.Module):
    """What is measured at one instant: own state, specific force (m/s^2), line of sight to the goal."""

    state: AircraftState
    specific_force_b: Vector3
    sight: LineOfSight | None


class Samples(eqx.Module):
    """The latest samples, in a ring: sample number n stands in row n modulo the number of rows."""

    rows: Any

    def with_next(self, number: Count, sample: Any) -> "Samples":
        """Samples with that of a number, which replaces the oldest."""

        def put(rows: Array, value: Array) -> Array:
            return rows.at[number % rows.shape[0]].set(value)

        return Samples(jax.tree.map(put, self.rows, sample))

    def late(self, number: Count, periods: ScalarLike) -> Any:
        """Sample `periods` (0 to rows - 2, whole or not) before that of a number; linear between two samples."""
        whole = jnp.floor(periods)
        part = periods - whole
        newer = number - whole.astype(number.dtype)

        def at(rows: Array) -> Array:
            last, before = rows[newer % rows.shape[0]], rows[(newer - 1) % rows.shape[0]]
            return last + part * (before - last)

        return jax.tree.map(at, self.rows)


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

    def init(self, truth: Truth, instant: Instant) -> Samples:
        """Samples of an aircraft that has been in its present flight for long."""
        count = math.ceil(self.delay_max / self.period - 1e-9) + 2
        sample = _sample(truth, instant)
        return Samples(jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (count, *jnp.shape(leaf))), sample))

    def read(self, memory: Samples, truth: Truth, instant: Instant) -> tuple[Reading, Samples]:
        """What was measured `delay` ago."""
        memory = memory.with_next(instant.number, _sample(truth, instant))
        periods = self.delay / instant.step
        delayed = memory.late(instant.number, periods)
        quaternion = delayed.state.quaternion
        # normalized only between samples: a reading that is not late is the sample itself
        quaternion = jnp.where(periods > jnp.floor(periods), normalize(quaternion), quaternion)
        state = eqx.tree_at(lambda s: s.quaternion, delayed.state, quaternion)
        sight = memory.late(instant.number, jnp.round(periods)).sight
        now = condition(truth.airframe, instant.environment, instant.time, state, disturbance=truth.disturbance)
        works = truth.goal_sensor_works
        return Reading(state, now, delayed.specific_force_b, sight, goal_sensor_works=works), memory


def _sample(truth: Truth, instant: Instant) -> Sample:
    force_b, mass = truth.now.wrench.force_b, truth.airframe.mass_properties.mass
    return Sample(truth.state, force_b / mass, true_sight(truth, instant.environment.earth))
