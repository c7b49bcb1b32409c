"""Routes: horizontal paths through the air, made of turns with linear curvature ramps and of straight legs.

Horizontal vectors are complex numbers, north + i east; a positive turn is to the right. A turn is a ramp, on which the
curvature grows linearly with length from zero (a clothoid), an arc of constant curvature, and a ramp back to zero. The
rate of the curvature on a ramp, in 1/m^2, is its sharpness. A turn too small for the full curvature has no arc.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from anser.shapes import Flag, Scalar, ScalarLike

Plane = Complex[Array, "..."]

# Coefficients of the series in x = heading change: (-1)^k x^2k / ((2k)! (4k + 1)) and x (-1)^k x^2k / ((2k + 1)!
# (4k + 3)), the highest power first. A ramp turns by 0.2 rad at an F-16's bank of 60 deg and by 1.5 rad at most, where
# the first omitted term is below 1e-10 of the length.
_TERMS = 7
_EVEN = tuple((-1) ** k / (math.factorial(2 * k) * (4 * k + 1)) for k in reversed(range(_TERMS)))
_ODD = tuple((-1) ** k / (math.factorial(2 * k + 1) * (4 * k + 3)) for k in reversed(range(_TERMS)))


def cis(angle: ScalarLike) -> Plane:
    """Return the unit vector in the direction of a heading (rad), as the complex number north + i east."""
    return jax.lax.complex(jnp.cos(angle), jnp.sin(angle))


class Turn(eqx.Module):
    """A turn: a ramp of growing curvature, an arc, and a ramp back to zero curvature."""

    angle: Scalar  # rad, right positive
    ramp: Scalar  # length of each ramp, m
    arc: Scalar  # length of the arc, m
    peak: Scalar  # curvature of the arc, 1/m, right positive

    @property
    def length(self) -> Scalar:
        """Length of the whole turn, m."""
        return 2 * self.ramp + self.arc


def smooth_turn(angle: ScalarLike, curvature_max: ScalarLike, sharpness: ScalarLike) -> Turn:
    """Return the shortest turn by an angle (rad) within limits of curvature (1/m) and its rate on the ramps (1/m^2)."""
    size = jnp.abs(angle)
    full = curvature_max / sharpness
    root = jnp.sqrt(jnp.where(size > 0.0, size, 1.0) / sharpness)
    ramp = jnp.minimum(jnp.where(size > 0.0, root, 0.0), full)
    arc = jnp.maximum(size - curvature_max * full, 0.0) / curvature_max
    sign = jnp.where(jnp.asarray(angle) < 0.0, -1.0, 1.0)
    return Turn(jnp.asarray(angle, dtype=float), ramp, arc, sign * sharpness * ramp)


def along_ramp(length: ScalarLike, sharpness: ScalarLike) -> Plane:
    """Return the displacement, north + i east, m, along a ramp of a length (m) that starts north with zero curvature.

    The result is the integral of exp(i sharpness u^2 / 2) over the length u. A positive sharpness (1/m^2) bends to the
    right; a negative length gives the displacement backward.
    """
    x = 0.5 * sharpness * jnp.square(length)
    square = x * x
    real, imag = jnp.zeros_like(x), jnp.zeros_like(x)
    for even, odd in zip(_EVEN, _ODD, strict=True):
        real, imag = real * square + even, imag * square + odd
    return length * jax.lax.complex(real, x * imag)


def along_arc(length: ScalarLike, curvature: ScalarLike) -> Plane:
    """Return the displacement, north + i east, m, along an arc or a straight line of a length (m) that starts north.

    `curvature` in 1/m, positive to the right.
    """
    half = 0.5 * curvature * length
    straight = jnp.abs(half) < 1e-8
    return length * jnp.where(straight, 1.0, jnp.sin(half) / jnp.where(straight, 1.0, half)) * cis(half)


def displacement(turn: Turn, sharpness: ScalarLike) -> Plane:
    """Return the displacement of a whole turn (ramp, arc, ramp), m, as a complex number.

    The real part is along the initial heading, the imaginary part to the right. `sharpness` (1/m^2) is positive.
    """
    sign = jnp.where(turn.angle < 0.0, -1.0, 1.0)
    ramp = along_ramp(turn.ramp, sign * sharpness)
    bent = 0.5 * turn.ramp * turn.peak
    return ramp + cis(bent) * along_arc(turn.arc, turn.peak) + cis(turn.angle) * jnp.conj(ramp)


TURNS, LEGS = 4, 3
PIECES = 1 + 3 * TURNS + LEGS
_UP, _FLAT, _DOWN = 0, 1, 2
# The ramp out of an initial turn; then turn, leg, turn, leg, turn, leg, turn.
_PIECE_KINDS = np.array([_DOWN, *([_UP, _FLAT, _DOWN, _FLAT] * LEGS), _UP, _FLAT, _DOWN])


class PathEndpoints(eqx.Module):
    """Start and end conditions of a horizontal path in the frame of the drifting air, and the limits of its turns."""

    # start: position (north + i east, m), heading (rad), curvature (1/m)
    start: Plane
    heading: Scalar
    curvature: Scalar
    # end: position (north + i east, m), heading (rad), and whether the heading is free
    end: Plane
    end_heading: Scalar
    end_free: Flag
    # tightest turn: curvature (1/m), and greatest rate of the curvature along the path (1/m^2)
    curvature_max: Scalar
    sharpness: Scalar
    scale_max: Scalar  # radius of the widest turn over the radius of the tightest turn


class TurnsAndLegs(eqx.Module):
    """Four turns with three straight legs between them, which describe a route; with a leading axis, several routes."""

    angles: Float[Array, "4"]  # turn angles, rad, right positive
    scales: Float[Array, "4"]  # radius of each turn over the tightest radius
    legs: Float[Array, "3"]  # m
    exists: Flag  # False: no path to the end conditions was found, and the numbers are arbitrary


class RollOut(eqx.Module):
    """Length, position and heading at which straight flight begins, after the shortest ramp out of the initial turn."""

    length: Scalar  # length of the ramp, m
    # position, north + i east, m, and heading, rad
    position: Plane
    heading: Scalar


def roll_out(endpoints: PathEndpoints) -> RollOut:
    """Compute length, position and heading at which an aircraft that starts in a turn can first fly straight."""
    sign = jnp.where(endpoints.curvature < 0.0, -1.0, 1.0)
    length = jnp.abs(endpoints.curvature) / endpoints.sharpness
    heading = endpoints.heading + 0.5 * endpoints.curvature * length
    step = cis(heading) * jnp.conj(along_ramp(length, sign * endpoints.sharpness))
    return RollOut(length, endpoints.start + step, heading)


class Route(eqx.Module):
    """A horizontal path as a chain of pieces of constant or linearly changing curvature."""

    # at the start and the ends of the pieces: length from the start (m), position (north + i east, m), heading (rad),
    # curvature (1/m)
    marks: Float[Array, " marks"]
    positions: Complex[Array, " marks"]
    headings: Float[Array, " marks"]
    curvatures: Float[Array, " marks"]
    sharpness: Float[Array, " pieces"]  # rate of the curvature in each piece, 1/m^2

    @property
    def length(self) -> Float[Array, "*batch"]:
        """Length of the whole route through the air, m."""
        return self.marks[..., -1]

    def at(self, length: ScalarLike) -> tuple[Plane, Scalar, Scalar]:
        """Return position (north + i east, m), heading (rad) and curvature (1/m) at a length (m) from the start.

        After the end of the route, the path goes on straight.
        """
        clipped_length = jnp.clip(length, 0.0, self.marks[-1])
        k = jnp.sum(clipped_length >= self.marks[1:-1], dtype=jnp.int32)
        kind = jnp.asarray(_PIECE_KINDS)[k]
        # A falling ramp is evaluated backwards from its end, as a rising ramp.
        falling = kind == _DOWN
        reference_mark = jnp.where(falling, k + 1, k)
        u = jnp.where(falling, clipped_length - self.marks[k + 1], clipped_length - self.marks[k])
        curvature_rate = self.sharpness[k]
        heading = self.headings[reference_mark]
        curvature = self.curvatures[reference_mark]
        flat = kind == _FLAT
        step = jnp.where(flat, along_arc(u, curvature), along_ramp(u, curvature_rate))
        position = self.positions[reference_mark] + cis(heading) * step
        turn_angle = jnp.where(flat, curvature * u, 0.5 * curvature_rate * u**2)
        end_curvature = jnp.where(flat, curvature, curvature_rate * u)
        excess_length = length - clipped_length
        return (
            position + excess_length * cis(heading + turn_angle),
            heading + turn_angle,
            jnp.where(excess_length == 0.0, end_curvature, 0.0),
        )


def turn_limits(endpoints: PathEndpoints, scale: ScalarLike) -> tuple[Scalar, Scalar]:
    """Return the limits of curvature (1/m) and sharpness (1/m^2) for a turn `scale` times as wide as the tightest.

    Sharpness is the rate of the curvature along the path. A ramp to full curvature has the same length for any `scale`.
    """
    return endpoints.curvature_max / scale, endpoints.sharpness / scale


def route(endpoints: PathEndpoints, solved: TurnsAndLegs) -> Route:
    """Return the route of turns and legs as a chain of pieces, the ramp out of the initial turn first."""
    initial, angles = roll_out(endpoints), solved.angles
    curvatures, sharpest = jax.vmap(turn_limits, in_axes=(None, 0))(endpoints, solved.scales)
    turns = jax.vmap(smooth_turn)(angles, curvatures, sharpest)
    zero = jnp.zeros(())
    sign = jnp.where(angles < 0.0, -1.0, 1.0)
    lengths = [initial.length]
    curvature_list = [zero]
    curvature_rates = [-jnp.sign(endpoints.curvature) * endpoints.sharpness]
    for k in range(TURNS):
        rate = jnp.where(turns.ramp[k] > 0.0, sign[k] * sharpest[k], 0.0)
        lengths += [turns.ramp[k], turns.arc[k], turns.ramp[k]]
        curvature_list += [turns.peak[k], turns.peak[k], zero]
        curvature_rates += [rate, zero, -rate]
        if k < LEGS:
            lengths.append(solved.legs[k])
            curvature_list.append(zero)
            curvature_rates.append(zero)
    steps = jnp.stack(lengths)
    curvatures = jnp.concatenate([endpoints.curvature[None], jnp.stack(curvature_list)])
    heading_changes = steps * 0.5 * (curvatures[1:] + curvatures[:-1])
    headings = jnp.concatenate([endpoints.heading[None], endpoints.heading + jnp.cumsum(heading_changes)])
    sharpness = jnp.stack(curvature_rates)
    falling = jnp.asarray(_PIECE_KINDS == _DOWN)
    flat = jnp.asarray(_PIECE_KINDS == _FLAT)
    from_start = jnp.where(
        flat, jax.vmap(along_arc)(steps, curvatures[:-1]), jax.vmap(along_ramp)(steps, sharpness)
    ) * cis(headings[:-1])
    from_end = -cis(headings[1:]) * jax.vmap(along_ramp)(-steps, sharpness)
    moves = jnp.where(falling, from_end, from_start)
    positions = jnp.concatenate([endpoints.start[None], endpoints.start + jnp.cumsum(moves)])
    marks = jnp.concatenate([jnp.zeros(1), jnp.cumsum(steps)])
    return Route(marks, positions, headings, curvatures, sharpness)


def chain_turns(
    endpoints: PathEndpoints, heading: ScalarLike, angles: Float[Array, " turns"], scales: Float[Array, " turns"]
) -> tuple[Plane, Scalar, Float[Array, " turns"]]:
    """Return displacement (north + i east, m) and length (m) of a chain of turns, and the heading after each turn, rad.

    `heading` is the initial heading, `angles` are the turn angles (rad), `scales` the radii over the tightest radius.
    """
    curvatures, sharpness = jax.vmap(turn_limits, in_axes=(None, 0))(endpoints, scales)
    turns = jax.vmap(smooth_turn)(angles, curvatures, sharpness)
    headings = heading + jnp.cumsum(angles)
    moves = jax.vmap(displacement)(turns, sharpness)
    return jnp.sum(cis(headings - angles) * moves), jnp.sum(turns.length), headings
