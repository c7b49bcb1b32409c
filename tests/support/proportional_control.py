"""A controller from outside anser: proportional control."""

import equinox as eqx
import jax.numpy as jnp

from anser.aircraft import Controls
from anser.parts import AbstractController
from anser.shapes import Vector3


class Proportional(AbstractController):
    """Proportional control of roll angle and path angle around trim: no inversion, no integral."""

    surfaces: Vector3 = eqx.field(default_factory=lambda: jnp.array([-0.03, 0.0, 0.0]))

    def init(self, state, attitude):
        return {"surfaces": state.surfaces, "throttle": jnp.asarray(0.2), "alpha": attitude[1]}

    def control(self, memory, belief, command, step):
        condition, rates_b = belief.condition, belief.state.rates_b
        velocity_n = condition.R_bn.T @ belief.state.velocity_b - condition.wind_n
        gamma = jnp.arctan2(-velocity_n[2], jnp.hypot(velocity_n[0], velocity_n[1]))
        chi = jnp.arctan2(velocity_n[1], velocity_n[0])
        turn = jnp.arctan2(jnp.sin(command.chi - chi), jnp.cos(command.chi - chi))
        roll = jnp.arctan2(condition.R_bn[1, 2], condition.R_bn[2, 2])
        bank = jnp.clip(2.0 * turn + belief.condition.air_data.V * command.chi_dot / 9.81, -0.9, 0.9)
        pitch = 0.35 * (command.gamma - gamma) - 0.4 * rates_b[1] + 0.03 * (jnp.cos(roll) ** -1 - 1.0)
        surfaces = memory["surfaces"] + jnp.stack([-pitch, -0.4 * (bank - roll) + 0.2 * rates_b[0], 0.4 * rates_b[2]])
        throttle = jnp.clip(memory["throttle"] + 0.05 * (command.V - condition.air_data.V), 0.0, 1.0)
        return Controls(surfaces, throttle), None, memory
