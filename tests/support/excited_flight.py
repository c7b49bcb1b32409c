"""The nonlinear sampled loop, flown with one command scaled about trim or delayed."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft import Controls
from anser.control.autopilot import velocity_control
from anser.control.onboard_model import onboard_model
from anser.parts import PathCommand
from anser.simulation.response import exact_belief, trimmed_autopilot_state
from anser.simulation.vehicle import advance

LATEST = 8


@eqx.filter_jit
def excited_flight(
    airframe, environment, gains, limits, trim, step, factors, delays, count
) -> Float[Array, "flights steps 3"]:
    """Deflections commanded, less those of trim, after a small kick to all body rates.

    `factors` (flights, 3) multiply what the autopilot commands beyond trim; `delays` (flights, 3) are whole samples.
    """
    held = trim.controls.surfaces

    def one(factor, delay):
        def sample(carry, k):
            state, memory, sent = carry
            model = onboard_model(exact_belief(airframe, environment, state), limits, gains, memory, step)
            controls, _, memory = velocity_control(model, gains, memory, wanted)
            sent = jnp.concatenate([controls.surfaces[None], sent[:-1]])
            surfaces = held + factor * (sent[delay, jnp.arange(3)] - held)
            state = advance(airframe, environment, 0.0, state, Controls(surfaces, controls.throttle), step)
            return (state, memory, sent), controls.surfaces - held

        start, memory = trim.state, trimmed_autopilot_state(trim)
        path = onboard_model(exact_belief(airframe, environment, start), limits, gains, memory, step).motion
        wanted = PathCommand(path.V, path.gamma, path.chi, *jnp.zeros(3))
        kicked = eqx.tree_at(lambda s: s.rates_b, start, start.rates_b + 1e-9)
        sent = jnp.broadcast_to(held, (LATEST, 3))
        return jax.lax.scan(sample, (kicked, memory, sent), jnp.arange(count))[1]

    return jax.vmap(one)(factors, delays)
