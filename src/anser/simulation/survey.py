"""One flight of an envelope survey: from a trim point, a step of the path command, summed up while it is flown."""

import jax
import jax.numpy as jnp

from anser.aircraft import AbstractAirframe, condition
from anser.control import AutopilotGains, FlightLimits, make_plant, velocity_control
from anser.environment import Environment
from anser.shapes import Count, ScalarLike, Vector3
from anser.simulation.flight_summary import FlightSummary, including, nothing_yet
from anser.simulation.motion import advance
from anser.simulation.response import trimmed_memory
from anser.simulation.survey_sample import finished, late_from, sample_of, stepped_command
from anser.simulation.trim import TrimPoint, TrimTarget


def survey_flight(
    airframe: AbstractAirframe,
    environment: Environment,
    gains: AutopilotGains,
    limits: FlightLimits,
    trim: TrimPoint,
    target: TrimTarget,
    size: Vector3,
    tolerance: Vector3,
    step: ScalarLike,
    count: int,
) -> FlightSummary:
    """Fly a step of the path command away from steady flight under the velocity loop, and sum it up.

    The command is the steady flight itself, its turn included, plus the step: (V, gamma, chi) jump at time 0 and the
    course goes on turning as before. The memory needed does not grow with the length of the flight.

    Parameters
    ----------
    airframe, environment, gains, limits
        What flies, where and how.
    trim, target
        Steady flight that the step leaves, and what it is a solution of.
    size
        Step of (V, gamma, chi), m/s and rad.
    tolerance
        Error that counts as settled, m/s and rad.
    step
        Sampling period, s.
    count
        Number of periods.
    """
    start = condition(airframe, environment, 0.0, trim.state)

    def one(carry: tuple, k: Count) -> tuple[tuple, None]:
        state, memory, summary = carry
        time = k * step
        command = stepped_command(target, size, time)
        now = condition(airframe, environment, time, state)
        plant = make_plant(airframe, limits, gains, state, now, memory, environment.gravity, step)
        controls, signals, memory = velocity_control(plant, memory, command)
        sample = sample_of(airframe, environment, time, state, now, command, plant, controls, signals, start)
        after = advance(airframe, environment, time, state, controls, step)
        return (after, memory, including(summary, sample, size, tolerance, step, k >= late_from(count))), None

    carry = (trim.state, trimmed_memory(trim), nothing_yet())
    (state, _, summary), _ = jax.lax.scan(one, carry, jnp.arange(count))
    return finished(summary, state, step, count)
