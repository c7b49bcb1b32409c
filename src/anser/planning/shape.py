"""The lateral bend that gives a trajectory a wanted length."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.numerics.newton import bracketed_newton
from anser.numerics.quadrature import GAUSS_LEGENDRE_16, QuadratureRule
from anser.planning.trajectory import Trajectory
from anser.shapes import Flag, Scalar, ScalarLike

# From any guess in the bracket, 20,000 random paths with lengths from 1 + 1e-9 to 2 times the nominal took 16 at most.
BEND_STEPS = 24
# A length met to this part of itself counts as met: a micrometre in ten kilometres, a hundred times rounding.
LENGTH_TOLERANCE = 1e-10
# Integral over [0, 1] of the square of the slope of s^2 (1 - s)^2.
_BEND_SLOPE_SQUARE = 2.0 / 105.0


class Bend(eqx.Module):
    """A lateral bend and whether it gives the wanted length."""

    kappa: Scalar
    """Lateral bend, m; positive to the right."""
    converged: Flag


def bend_slope(phase: np.ndarray) -> np.ndarray:
    """Slope of s^2 (1 - s)^2."""
    return 2.0 * phase * (1.0 - phase) * (1.0 - 2.0 * phase)


def _length(
    size: Scalar, data: tuple[Float[Array, "nodes 3"], Float[Array, "nodes 3"], Float[Array, " nodes"], Scalar]
) -> tuple[Scalar, Scalar]:
    """Length minus the wanted one, and its slope, at a bend of given size."""
    straight, sideways, weights, wanted = data
    tangent = straight + size * sideways
    square = jnp.sum(tangent * tangent, axis=1)
    speed = jnp.sqrt(jnp.where(square > 0.0, square, 1.0))
    slope = jnp.sum(tangent * sideways, axis=1) / speed
    return jnp.sum(weights * jnp.where(square > 0.0, speed, 0.0)) - wanted, jnp.sum(weights * slope)


def solve_lateral_bend(
    nominal: Trajectory,
    length_ref: ScalarLike,
    side: ScalarLike,
    guess: ScalarLike | None = None,
    rule: QuadratureRule = GAUSS_LEGENDRE_16,
) -> Bend:
    """Lateral bend that brings a trajectory to a reference length, by safeguarded Newton.

    Parameters
    ----------
    nominal
        The trajectory without the bend.
    length_ref
        Wanted length of the air path, m. At the nominal length the bend is exactly zero. Below it there is no
        solution: the bend is zero and `converged` is false.
    side
        Positive: bend to the right; negative: to the left.
    guess
        Where to start, m, either sign; without it a close one is taken.
    rule
        Quadrature rule of the length.

    Notes
    -----
    The length L(kappa) is the integral of the norm of something affine in kappa, hence convex: from L(0) <= length_ref
    exactly one root lies on either side. |kappa| times the integral of the bend's slope, minus L(0), bounds L from
    below, which brackets the root (theory section 6; the integral is 1/8, taken here by the same rule as the length).
    The derivative of the bend is the implicit one; it is zero where the bend is held at zero.
    """
    nodes, weights = jnp.asarray(rule.nodes), jnp.asarray(rule.weights)
    powers = jnp.arange(1, 5)
    basis = powers[None, :] * nodes[:, None] ** (powers[None, :] - 1)
    straight = jnp.sum(basis[:, None, :] * nominal.coefficients_n[None, :, 1:], axis=2)
    sign = jnp.where(jnp.asarray(side) < 0, -1.0, 1.0)
    slopes = bend_slope(rule.nodes)
    sideways = jnp.asarray(slopes)[:, None] * (sign * nominal.lateral_n)[None, :]

    length_ref = jnp.asarray(length_ref, dtype=float)
    data = (straight, sideways, weights, length_ref)
    excess = -_length(jnp.zeros(()), data)[0]
    tolerance = LENGTH_TOLERANCE * length_ref
    # Within rounding of the nominal length the bend is zero: there the implicit derivative would be infinite.
    longer = excess > 1e-3 * tolerance
    nominal_length = length_ref - excess
    high = 1.000001 * (length_ref + nominal_length) / float(np.sum(rule.weights * np.abs(slopes)))
    if guess is None:
        # Exact to leading order, for a straight path of steady speed: L - L(0) = kappa^2 (2/105)/(2 L(0)).
        square = jnp.where(longer, excess * (length_ref + nominal_length), 0.0) / _BEND_SLOPE_SQUARE
        guess = jnp.sqrt(jnp.where(square > 0.0, square, 1.0))
    # Where there is nothing to solve, the wanted length is replaced by one that is solvable, for finite gradients.
    solvable = (straight, sideways, weights, jnp.where(longer, length_ref, 1.1 * nominal_length + 1.0))
    high = jnp.where(longer, high, 20.0 * nominal_length + 20.0)
    root = bracketed_newton(_length, solvable, 0.0, high, jnp.abs(guess), BEND_STEPS)
    converged = jnp.where(longer, jnp.abs(root.residual) <= tolerance, excess >= -tolerance)
    return Bend(jnp.where(longer, sign * root.x, 0.0), converged)
