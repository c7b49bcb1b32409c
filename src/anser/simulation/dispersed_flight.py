"""One flight of an aircraft that is not what its autopilot believes, and whose sensors are late."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from anser.aircraft import AbstractAirframe, AircraftState, condition
from anser.control import AutopilotGains, FlightLimits, make_plant, velocity_control
from anser.environment import Environment
from anser.shapes import Count, ScalarLike, Vector3
from anser.simulation.flight_summary import FlightSummary, including, nothing_yet
from anser.simulation.motion import advance
from anser.simulation.response import trimmed_memory
from anser.simulation.survey_sample import finished, late_from, sample_of, stepped_command
from anser.simulation.trim import TrimPoint, TrimTarget
from anser.spatial import normalize


class Reading(eqx.Module):
    """What the sensors say at one instant.

    Attributes
    ----------
    state
        The aircraft's.
    specific_force_b
        Of accelerometers at the centre of gravity, m/s^2.
    """

    state: AircraftState
    specific_force_b: Vector3


class Readings(eqx.Module):
    """The latest readings, in a ring: reading number n stands in row n modulo the number of rows."""

    rows: Reading

    def with_next(self, number: Count, reading: Reading) -> "Readings":
        """Readings with that of a number, which replaces the oldest."""

        def put(rows: Array, value: Array) -> Array:
            return rows.at[number % rows.shape[0]].set(value)

        return Readings(jax.tree.map(put, self.rows, reading))

    def late(self, number: Count, periods: ScalarLike) -> Reading:
        """Reading `periods` (0 to rows - 2, whole or not) before that of a number; linear between two samples."""
        whole = jnp.floor(periods)
        part = periods - whole
        newer = number - whole.astype(number.dtype)

        def at(rows: Array) -> Array:
            last, before = rows[newer % rows.shape[0]], rows[(newer - 1) % rows.shape[0]]
            return last + part * (before - last)

        reading = jax.tree.map(at, self.rows)
        quaternion = reading.state.quaternion
        # normalized only between samples: a reading that is not late is the sample itself
        quaternion = jnp.where(part > 0.0, normalize(quaternion), quaternion)
        return eqx.tree_at(lambda r: r.state.quaternion, reading, quaternion)


def steady_readings(reading: Reading, delay_max: float, step: float) -> Readings:
    """Readings of an aircraft in steady flight, enough of them for delays up to `delay_max` (s)."""
    count = math.ceil(delay_max / step - 1e-9) + 2
    return Readings(jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (count, *jnp.shape(leaf))), reading))


def dispersed_flight(
    truth: AbstractAirframe,
    model: AbstractAirframe,
    environment: Environment,
    gains: AutopilotGains,
    limits: FlightLimits,
    trim: TrimPoint,
    target: TrimTarget,
    delay: ScalarLike,
    size: Vector3,
    tolerance: Vector3,
    *,
    delay_max: float,
    step: float,
    count: int,
) -> FlightSummary:
    """Fly a step of the path command with an autopilot that knows another airframe, and sum it up.

    As `survey_flight`, which it equals for `truth` = `model` without delay. The autopilot takes its forces and moments
    from `model`, at the state that its sensors tell; what they tell, the accelerometers of the truth included, is late
    altogether by `delay`. The summary is of what the truth does.

    Parameters
    ----------
    truth, model
        What flies, and what the autopilot believes; of one structure or not.
    environment, gains, limits
        Where and how.
    trim, target
        Steady flight of the truth that the step leaves, and what it is a solution of.
    delay
        Of all that is sensed, s; 0 to `delay_max`. Before time 0 the sensors told the state of the trim.
    size
        Step of (V, gamma, chi), m/s and rad.
    tolerance
        Error that counts as settled, m/s and rad.
    delay_max
        Largest delay of a study, s: it sets the length of the memory of readings.
    step
        Sampling period, s.
    count
        Number of periods.
    """
    start = condition(truth, environment, 0.0, trim.state)
    mass = truth.mass_properties.mass
    readings = steady_readings(Reading(trim.state, start.wrench.force_b / mass), delay_max, step)

    def one(carry: tuple, k: Count) -> tuple[tuple, None]:
        state, memory, readings, summary = carry
        time = k * step
        now = condition(truth, environment, time, state)
        readings = readings.with_next(k, Reading(state, now.wrench.force_b / mass))
        sensed = readings.late(k, delay / step)
        command = stepped_command(target, size, time)
        believed = condition(model, environment, time, sensed.state)
        plant = make_plant(
            model,
            limits,
            gains,
            sensed.state,
            believed,
            memory,
            environment.gravity,
            step,
            sensed.specific_force_b,
        )
        controls, signals, memory = velocity_control(plant, memory, command)
        sample = sample_of(truth, environment, time, state, now, command, plant, controls, signals, start)
        after = advance(truth, environment, time, state, controls, step)
        return (after, memory, readings, including(summary, sample, size, tolerance, step, k >= late_from(count))), None

    carry = (trim.state, trimmed_memory(trim), readings, nothing_yet())
    (state, _, _, summary), _ = jax.lax.scan(one, carry, jnp.arange(count))
    return finished(summary, state, step, count)
