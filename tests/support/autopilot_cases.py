"""Complete flights of the F-16 under its autopilot, as functions for compilation and batching."""

import equinox as eqx
import jax
import jax.numpy as jnp

from anser.aircraft import AircraftState
from anser.control.autopilot import velocity_control
from anser.control.autopilot_state import AutopilotState, initial_autopilot_state
from anser.control.onboard_model import OnboardModel, onboard_model
from anser.environment import standard_environment
from anser.parts import PathCommand
from anser.shapes import ScalarLike
from anser.simulation.response import exact_belief
from anser.simulation.vehicle import advance
from anser.steady import TrimPoint
from support.control_cases import AIRFRAME

ENVIRONMENT = standard_environment()
ALTITUDE = 5000.0


class Case(eqx.Module):
    """One flight: start, state of the autopilot, constant command (m/s, rad), sampling period (s)."""

    state: AircraftState
    memory: AutopilotState
    V: ScalarLike
    gamma: ScalarLike
    chi: ScalarLike
    step: ScalarLike


def arrays(case: Case) -> Case:
    """The case with every number as an array, so that different numbers run the same code."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=float), case)


def memory_of(trim: TrimPoint) -> AutopilotState:
    attitude = jnp.stack([trim.mu, trim.alpha, trim.beta])
    return initial_autopilot_state(attitude, trim.state.rates_b, trim.state.surfaces)


def model_of(state, memory, gains, limits, step) -> OnboardModel:
    return onboard_model(exact_belief(AIRFRAME, ENVIRONMENT, state), limits, gains, memory, step)


def control(case, state, memory, gains, limits):
    """One step of the autopilot with the case's command: controls, signals, autopilot state, load factor."""
    zero = jnp.zeros(())
    command = PathCommand(*(jnp.asarray(v, dtype=float) for v in (case.V, case.gamma, case.chi)), zero, zero, zero)
    model = model_of(state, memory, gains, limits, case.step)
    load = -model.condition.wrench.force_b[2] / (AIRFRAME.mass_properties.mass * ENVIRONMENT.gravity)
    return velocity_control(model, gains, memory, command), load


def fly(case, gains, limits, count):
    """Final state and autopilot state; state, controls, signals, autopilot state and load factor, one row per step."""

    def one(carry, _):
        state, memory = carry
        (controls, signals, next_memory), load = control(case, state, memory, gains, limits)
        record = (state, controls, signals, memory, load)
        return (advance(AIRFRAME, ENVIRONMENT, 0.0, state, controls, case.step), next_memory), record

    return jax.lax.scan(one, (case.state, case.memory), length=count)


def turned_after_100_steps(case, gains, limits):
    """East position, and speed, path angle and course of the previous step."""
    (state, _), records = fly(case, gains, limits, 100)
    motion = records[2].motion
    return jnp.stack([state.position_n[1], motion.V[-1], motion.gamma[-1], motion.chi[-1]])
