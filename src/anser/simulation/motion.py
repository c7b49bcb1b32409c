"""One step of one aircraft with its controls held."""

import equinox as eqx
import jax
import jax.numpy as jnp

from anser.aircraft import AbstractAirframe, Controls, Disturbance, Moving, motion_derivative
from anser.environment import Environment
from anser.numerics import rk4_step
from anser.shapes import ScalarLike
from anser.spatial import normalize


def advance(
    airframe: AbstractAirframe,
    environment: Environment,
    time: ScalarLike,
    state: Moving,
    controls: Controls,
    step: ScalarLike,
    disturbance: Disturbance | None = None,
) -> Moving:
    """State one step (s) later, by the classical Runge-Kutta method; the quaternion is normalized after the step.

    Controls and disturbance (None: none) are held over the step.
    """

    def derivative(t: ScalarLike, y: Moving) -> Moving:
        return motion_derivative(airframe, environment, t, y, controls, disturbance)

    # jit: traced once for the four stages.
    after = rk4_step(jax.jit(derivative), jnp.asarray(time, state.velocity_b.dtype), state, step)
    return eqx.tree_at(lambda s: s.quaternion, after, normalize(after.quaternion))
