"""Response of one aircraft to commands given to one loop of its autopilot: the step tests of theory section 5."""

from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft import AbstractAirframe, AircraftState, Controls, condition
from anser.control import (
    AutopilotGains,
    AutopilotState,
    FlightLimits,
    Plant,
    attitude_control,
    initial_autopilot_state,
    make_plant,
    rate_control,
    velocity_control,
)
from anser.environment import Environment
from anser.planning import PathCommand
from anser.shapes import ScalarLike, Vector3
from anser.simulation.motion import advance
from anser.simulation.trim import TrimPoint

Loop = Literal["rates", "attitude", "velocity"]


class LoopCommand(eqx.Module):
    """What one loop is asked for.

    Attributes
    ----------
    value
        (P, Q, R) rad/s, (mu, alpha, beta) rad or (V, gamma, chi) m/s and rad.
    rate
        Its rate of change, for the feed-forward.
    throttle
        Throttle that is held unless the velocity loop is commanded, 0..1.
    """

    value: Vector3
    rate: Vector3
    throttle: ScalarLike


class Response(eqx.Module):
    """Record of one response, one row per step.

    Attributes
    ----------
    time
        s.
    measured
        The loop's own outputs: (P, Q, R), (mu, alpha, beta) or (V, gamma, chi).
    surfaces, throttle, power
        What they took: rad, 0..1, percent.
    """

    time: Float[Array, " steps"]
    measured: Float[Array, "steps 3"]
    surfaces: Float[Array, "steps 3"]
    throttle: Float[Array, " steps"]
    power: Float[Array, " steps"]


def step_response(
    airframe: AbstractAirframe,
    environment: Environment,
    gains: AutopilotGains,
    limits: FlightLimits,
    trim: TrimPoint,
    size: Vector3,
    step: ScalarLike,
    count: int,
    loop: Loop,
) -> Response:
    """Fly a step away from trim, commanded to one loop, for `count` sampling periods.

    Parameters
    ----------
    airframe, environment, gains, limits
        What flies, where and how.
    trim
        Steady flight that the step leaves.
    size
        Step of the loop's three channels: (P, Q, R) rad/s, (mu, alpha, beta) rad or (V, gamma, chi) m/s and rad. The
        command jumps at time 0 and carries no rate (no feed-forward). The throttle stays at trim unless the velocity
        loop is commanded.
    step
        Sampling period, s.
    count
        Number of periods.
    loop
        Which loop is commanded.
    """
    memory_0 = trimmed_memory(trim)
    now_0 = condition(airframe, environment, 0.0, trim.state)
    plant_0 = make_plant(airframe, limits, gains, trim.state, now_0, memory_0, environment.gravity, step)
    command = LoopCommand(measured_by(plant_0, loop) + size, jnp.zeros(3), trim.controls.throttle)

    def one(carry: tuple, k: Array) -> tuple[tuple, Response]:
        state, memory = carry
        time = k * step
        controls, measured, memory = control_loop(
            airframe, environment, gains, limits, time, state, memory, command, step, loop
        )
        after = advance(airframe, environment, time, state, controls, step)
        return (after, memory), Response(time, measured, state.surfaces, controls.throttle, state.power)

    _, record = jax.lax.scan(one, (trim.state, memory_0), jnp.arange(count))
    return record


def trimmed_memory(trim: TrimPoint) -> AutopilotState:
    """Memory of an autopilot that has been holding a trim point."""
    attitude = jnp.stack([trim.mu, trim.alpha, trim.beta])
    return initial_autopilot_state(attitude, trim.state.rates_b, trim.state.surfaces)


def measured_by(plant: Plant, loop: Loop) -> Vector3:
    """Outputs of a loop: (P, Q, R), (mu, alpha, beta) or (V, gamma, chi)."""
    motion = plant.motion
    if loop == "velocity":
        return jnp.stack([motion.V, motion.gamma, motion.chi])
    if loop == "attitude":
        return jnp.stack([motion.mu, motion.alpha, motion.beta])
    return plant.state.rates_b


def control_loop(
    airframe: AbstractAirframe,
    environment: Environment,
    gains: AutopilotGains,
    limits: FlightLimits,
    time: ScalarLike,
    state: AircraftState,
    memory: AutopilotState,
    command: LoopCommand,
    step: ScalarLike,
    loop: Loop,
) -> tuple[Controls, Vector3, AutopilotState]:
    """Sample one aircraft and control it: controls to hold over the step, what the loop measured, memory after it."""
    now = condition(airframe, environment, time, state)
    plant = make_plant(airframe, limits, gains, state, now, memory, environment.gravity, step)
    measured = measured_by(plant, loop)
    if loop == "velocity":
        controls, _, memory = velocity_control(plant, memory, PathCommand(*command.value, *command.rate))
        return controls, measured, memory
    if loop == "attitude":
        _, demand, memory = attitude_control(plant, memory, command.value, command.rate)
    else:
        demand, memory = rate_control(plant, memory, command.value, command.rate)
    return Controls(demand.surfaces, jnp.asarray(command.throttle)), measured, memory
