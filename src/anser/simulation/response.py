"""Response of one aircraft to commands given to one loop of its autopilot: the step tests of theory section 5."""

from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft import AbstractAirframe, Controls, condition
from anser.control import (
    AutopilotGains,
    AutopilotState,
    FlightLimits,
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
    attitude_0 = jnp.stack([trim.mu, trim.alpha, trim.beta])
    memory_0 = initial_autopilot_state(attitude_0, trim.state.rates_b, trim.state.surfaces)
    now_0 = condition(airframe, environment, 0.0, trim.state)
    plant_0 = make_plant(airframe, limits, gains, trim.state, now_0, memory_0, environment.gravity, step)
    motion_0 = plant_0.motion
    path_0 = jnp.stack([motion_0.V, motion_0.gamma, motion_0.chi])
    zero = jnp.zeros(3)

    def one(carry: tuple, k: Array) -> tuple[tuple, Response]:
        state, memory = carry
        time = k * step
        now = condition(airframe, environment, time, state)
        plant = make_plant(airframe, limits, gains, state, now, memory, environment.gravity, step)
        controls, measured, memory = _controls(plant, memory)
        after = advance(airframe, environment, time, state, controls, step)
        return (after, memory), Response(time, measured, state.surfaces, controls.throttle, state.power)

    def _controls(plant, memory: AutopilotState) -> tuple[Controls, Vector3, AutopilotState]:
        motion = plant.motion
        if loop == "velocity":
            wanted = path_0 + size
            command = PathCommand(wanted[0], wanted[1], wanted[2], zero[0], zero[1], zero[2])
            controls, _, memory = velocity_control(plant, memory, command)
            return controls, jnp.stack([motion.V, motion.gamma, motion.chi]), memory
        if loop == "attitude":
            _, demand, memory = attitude_control(plant, memory, attitude_0 + size, zero)
            measured = jnp.stack([motion.mu, motion.alpha, motion.beta])
        else:
            demand, memory = rate_control(plant, memory, trim.state.rates_b + size, zero)
            measured = plant.state.rates_b
        return Controls(demand.surfaces, trim.controls.throttle), measured, memory

    _, record = jax.lax.scan(one, (trim.state, memory_0), jnp.arange(count))
    return record
