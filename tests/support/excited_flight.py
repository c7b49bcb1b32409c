"""The nonlinear sampled loop, flown with one command scaled about trim or delayed."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft import Controls
from anser.control.autopilot import velocity_control
from anser.control.onboard_model import onboard_model
from anser.parts import PathCommand
from anser.simulation.response import (
    LoopCase,
    exact_belief,
    modelled_belief,
    settled_residual,
    trimmed_autopilot_state,
)
from anser.simulation.vehicle import advance

LATEST = 8


@eqx.filter_jit
def excited_flight(
    airframe, environment, gains, limits, trim, step, factors, delays, count, onboard=None
) -> Float[Array, "flights steps 3"]:
    """Commanded deflections minus trim, after a small disturbance of the body rates.

    `factors` (flights, 3) multiply the autopilot's commands relative to trim; `delays` (flights, 3) are whole samples.
    `onboard` is the model of the autopilot, if it differs from the airframe.
    """
    trim_surfaces = trim.controls.surfaces
    case = LoopCase(airframe, environment, gains, limits, trim, step, onboard)

    def one(factor, delay):
        def sample(carry, k):
            state, memory, sent = carry
            model = onboard_model(modelled_belief(case, state), limits, gains, memory, step)
            controls, _, memory = velocity_control(model, gains, memory, command)
            sent = jnp.concatenate([controls.surfaces[None], sent[:-1]])
            surfaces = trim_surfaces + factor * (sent[delay, jnp.arange(3)] - trim_surfaces)
            state = advance(airframe, environment, 0.0, state, Controls(surfaces, controls.throttle), step)
            return (state, memory, sent), controls.surfaces - trim_surfaces

        start, memory = trim.state, trimmed_autopilot_state(trim)
        if onboard is not None:
            settled = settled_residual(modelled_belief(case, start))
            memory = eqx.tree_at(lambda m: m.residual, memory, settled)
        path = onboard_model(exact_belief(airframe, environment, start), limits, gains, memory, step).motion
        command = PathCommand(path.V, path.gamma, path.chi, *jnp.zeros(3))
        kicked = eqx.tree_at(lambda s: s.rates_b, start, start.rates_b + 1e-9)
        sent = jnp.broadcast_to(trim_surfaces, (LATEST, 3))
        return jax.lax.scan(sample, (kicked, memory, sent), jnp.arange(count))[1]

    return jax.vmap(one)(factors, delays)
