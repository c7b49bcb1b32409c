"""Turns whose curvature rises and falls at a steady rate: what an aircraft of finite roll rate can fly.

Horizontal vectors are complex numbers here, north + i east; a positive turn is to the right. A turn is a ramp of
curvature up from zero (a clothoid), an arc, and the ramp down; one too small for the full curvature has no arc.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex

from anser.shapes import Scalar, ScalarLike

Plane = Complex[Array, "..."]

# Of the series in x = heading change: (-1)^k x^2k / ((2k)! (4k + 1)) and x (-1)^k x^2k / ((2k + 1)! (4k + 3)), the
# highest power first. A ramp turns by 0.2 rad in an F-16's 60 deg bank and by 1.5 rad at the very most: there the first
# term left out is below 1e-10 of the length.
_TERMS = 7
_EVEN = tuple((-1) ** k / (math.factorial(2 * k) * (4 * k + 1)) for k in reversed(range(_TERMS)))
_ODD = tuple((-1) ** k / (math.factorial(2 * k + 1) * (4 * k + 3)) for k in reversed(range(_TERMS)))


def cis(angle: ScalarLike) -> Plane:
    """Direction of a heading (rad), as a unit vector."""
    return jax.lax.complex(jnp.cos(angle), jnp.sin(angle))


class Turn(eqx.Module):
    """A turn, resolved.

    Attributes
    ----------
    angle
        Change of course, rad, right positive.
    ramp
        Length of each of the two ramps, m.
    arc
        Length of the arc between them, m.
    peak
        Curvature of the arc, 1/m, right positive.
    """

    angle: Scalar
    ramp: Scalar
    arc: Scalar
    peak: Scalar

    @property
    def length(self) -> Scalar:
        """Of the whole turn, m."""
        return 2 * self.ramp + self.arc


def smooth_turn(angle: ScalarLike, curvature_max: ScalarLike, sharpness: ScalarLike) -> Turn:
    """The shortest turn by an angle (rad) within a curvature (1/m) and its rate along the path (1/m^2)."""
    size = jnp.abs(angle)
    full = curvature_max / sharpness
    root = jnp.sqrt(jnp.where(size > 0.0, size, 1.0) / sharpness)
    ramp = jnp.minimum(jnp.where(size > 0.0, root, 0.0), full)
    arc = jnp.maximum(size - curvature_max * full, 0.0) / curvature_max
    sign = jnp.where(jnp.asarray(angle) < 0.0, -1.0, 1.0)
    return Turn(jnp.asarray(angle, dtype=float), ramp, arc, sign * sharpness * ramp)


def along_ramp(length: ScalarLike, sharpness: ScalarLike) -> Plane:
    """Displacement along a clothoid from zero curvature, in the frame of its straight end, m.

    The integral of exp(i sharpness u^2 / 2) over a length (m), by its power series; the rate of the curvature (1/m^2)
    is positive to the right.
    """
    x = 0.5 * sharpness * jnp.square(length)
    square = x * x
    real, imag = jnp.zeros_like(x), jnp.zeros_like(x)
    for even, odd in zip(_EVEN, _ODD, strict=True):
        real, imag = real * square + even, imag * square + odd
    return length * jax.lax.complex(real, x * imag)


def along_arc(length: ScalarLike, curvature: ScalarLike) -> Plane:
    """Displacement along an arc (or a straight line) in the frame of its beginning, m."""
    half = 0.5 * curvature * length
    straight = jnp.abs(half) < 1e-8
    return length * jnp.where(straight, 1.0, jnp.sin(half) / jnp.where(straight, 1.0, half)) * cis(half)


def displacement(turn: Turn, sharpness: ScalarLike) -> Plane:
    """Displacement of a whole turn in the frame of its beginning, m."""
    sign = jnp.where(turn.angle < 0.0, -1.0, 1.0)
    ramp = along_ramp(turn.ramp, sign * sharpness)
    bent = 0.5 * turn.ramp * turn.peak
    return ramp + cis(bent) * along_arc(turn.arc, turn.peak) + cis(turn.angle) * jnp.conj(ramp)
