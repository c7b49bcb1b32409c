"""Length of a trajectory's path through the air."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.numerics.quadrature import GAUSS_LEGENDRE_16, NEWTON_COTES_6, QuadratureRule, integrate
from anser.planning.trajectory import Trajectory
from anser.planning.vectors import norm
from anser.shapes import Scalar, ScalarLike


def arc_length(
    trajectory: Trajectory, start_phase: ScalarLike = 0.0, rule: QuadratureRule = GAUSS_LEGENDRE_16
) -> Scalar:
    """Length of the air path from a path parameter s in [0, 1] to the rendezvous, m.

    From `trajectory.phase(t)` on it is what is still to fly at time t. The rule's positive weights keep the length
    convex in the bends.
    """

    def path_speed(phases: Float[Array, " nodes"]) -> Float[Array, " nodes"]:
        return jax.vmap(lambda phase: norm(trajectory.path_derivative(phase, 1)))(phases)

    return integrate(path_speed, jnp.asarray(start_phase, dtype=float), 1.0, rule)


def arc_length_estimate(trajectory: Trajectory, start_phase: ScalarLike = 0.0) -> Scalar:
    """Length by the six-point closed Newton-Cotes rule, m, as published (theory section 6; section 9, item 1)."""
    return arc_length(trajectory, start_phase, NEWTON_COTES_6)
