"""Routes: the horizontal part of a path.

Made of turns whose curvature rises and falls at a steady rate and of straight legs. Horizontal vectors are complex
numbers, north + i east; a positive turn is to the right. A turn is a ramp of curvature up from zero (a clothoid), an
arc and the ramp down; a turn too small for the full curvature has no arc.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from anser.shapes import Flag, Scalar, ScalarLike

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


TURNS, LEGS = 4, 3
PIECES = 1 + 3 * TURNS + LEGS
_UP, _FLAT, _DOWN = 0, 1, 2
# What remains of a turn under way; then turn, leg, turn, leg, turn, leg, turn.
_KINDS = np.array([_DOWN, *([_UP, _FLAT, _DOWN, _FLAT] * LEGS), _UP, _FLAT, _DOWN])


class PathEndpoints(eqx.Module):
    """What a horizontal path has to join, and how tightly it may turn.

    Attributes
    ----------
    start, heading, curvature
        Of the beginning, relative to the air: north + i east, m; rad; 1/m.
    end
        In the frame that drifts with the air, m.
    end_heading, end_free
        Heading through the air at the end, rad; or that of the last leg.
    curvature_max
        1/m.
    sharpness
        Greatest rate of the curvature along the path, 1/m^2.
    scale_most
        How many times wider than the tightest a turn is at most made where there is room.
    """

    start: Plane
    heading: Scalar
    curvature: Scalar
    end: Plane
    end_heading: Scalar
    end_free: Flag
    curvature_max: Scalar
    sharpness: Scalar
    scale_max: Scalar


class TurnsAndLegs(eqx.Module):
    """Four turns with three legs between them; stacked, many.

    Attributes
    ----------
    angles
        Of the turns, rad, right positive.
    scales
        Of the turns, see `tightness`.
    legs
        Lengths, m.
    exists
        Whether there is such a path.
    """

    angles: Float[Array, "4"]
    scales: Float[Array, "4"]
    legs: Float[Array, "3"]
    exists: Flag


class RollOut(eqx.Module):
    """Where the path flies straight for the first time, having left the turn it began in as fast as it may."""

    length: Scalar
    position: Plane
    heading: Scalar


def roll_out(endpoints: PathEndpoints) -> RollOut:
    """Leave the turn in which a path begins."""
    sign = jnp.where(endpoints.curvature < 0.0, -1.0, 1.0)
    length = jnp.abs(endpoints.curvature) / endpoints.sharpness
    heading = endpoints.heading + 0.5 * endpoints.curvature * length
    step = cis(heading) * jnp.conj(along_ramp(length, sign * endpoints.sharpness))
    return RollOut(length, endpoints.start + step, heading)


class Route(eqx.Module):
    """A path of turns and legs, resolved into pieces of steady or steadily changing curvature.

    Attributes
    ----------
    marks
        Length along the path at the ends of the pieces, m.
    places
        Position there: north + i east, m.
    headings
        Heading there, rad.
    curvatures
        Curvature there, 1/m.
    sharpness
        Signed rate of the curvature in each piece, 1/m^2.
    """

    marks: Float[Array, " marks"]
    positions: Complex[Array, " marks"]
    headings: Float[Array, " marks"]
    curvatures: Float[Array, " marks"]
    sharpness: Float[Array, " pieces"]

    @property
    def length(self) -> Float[Array, "*batch"]:
        """Of the whole, m."""
        return self.marks[..., -1]

    def at(self, length: ScalarLike) -> tuple[Plane, Scalar, Scalar]:
        """Position (m), heading (rad) and curvature (1/m) at a length along the path, m; straight on after its end."""
        held = jnp.clip(length, 0.0, self.marks[-1])
        k = jnp.sum(held >= self.marks[1:-1], dtype=jnp.int32)
        kind = jnp.asarray(_KINDS)[k]
        # A falling ramp is a rising one seen from its end.
        falling = kind == _DOWN
        near = jnp.where(falling, k + 1, k)
        u = jnp.where(falling, held - self.marks[k + 1], held - self.marks[k])
        sharp, heading, curvature = self.sharpness[k], self.headings[near], self.curvatures[near]
        flat = kind == _FLAT
        step = jnp.where(flat, along_arc(u, curvature), along_ramp(u, sharp))
        place = self.positions[near] + cis(heading) * step
        turned = jnp.where(flat, curvature * u, 0.5 * sharp * u**2)
        bent = jnp.where(flat, curvature, sharp * u)
        beyond = length - held
        return (
            place + beyond * cis(heading + turned),
            heading + turned,
            jnp.where(beyond == 0.0, bent, 0.0),
        )


def tightness(endpoints: PathEndpoints, scale: ScalarLike) -> tuple[Scalar, Scalar]:
    """Greatest curvature (1/m) and sharpness (1/m^2) of a turn whose radius is `scale` times the least at full speed.

    The ramps keep their length: a slower aircraft takes more time for them than it needs, a wider turn as much.
    """
    return endpoints.curvature_max / scale, endpoints.sharpness / scale


def route(endpoints: PathEndpoints, solved: TurnsAndLegs) -> Route:
    """Path of turns with legs between them."""
    begun, angles = roll_out(endpoints), solved.angles
    curvatures, sharpest = jax.vmap(tightness, in_axes=(None, 0))(endpoints, solved.scales)
    turns = jax.vmap(smooth_turn)(angles, curvatures, sharpest)
    zero = jnp.zeros(())
    sign = jnp.where(angles < 0.0, -1.0, 1.0)
    lengths, bends, sharps = [begun.length], [zero], [-jnp.sign(endpoints.curvature) * endpoints.sharpness]
    for k in range(TURNS):
        rate = jnp.where(turns.ramp[k] > 0.0, sign[k] * sharpest[k], 0.0)
        lengths += [turns.ramp[k], turns.arc[k], turns.ramp[k]]
        bends += [turns.peak[k], turns.peak[k], zero]
        sharps += [rate, zero, -rate]
        if k < LEGS:
            lengths.append(solved.legs[k])
            bends.append(zero)
            sharps.append(zero)
    steps = jnp.stack(lengths)
    curvatures = jnp.concatenate([endpoints.curvature[None], jnp.stack(bends)])
    turned = steps * 0.5 * (curvatures[1:] + curvatures[:-1])
    headings = jnp.concatenate([endpoints.heading[None], endpoints.heading + jnp.cumsum(turned)])
    sharpness = jnp.stack(sharps)
    falling = jnp.asarray(_KINDS == _DOWN)
    flat = jnp.asarray(_KINDS == _FLAT)
    from_start = jnp.where(
        flat, jax.vmap(along_arc)(steps, curvatures[:-1]), jax.vmap(along_ramp)(steps, sharpness)
    ) * cis(headings[:-1])
    from_end = -cis(headings[1:]) * jax.vmap(along_ramp)(-steps, sharpness)
    moves = jnp.where(falling, from_end, from_start)
    places = jnp.concatenate([endpoints.start[None], endpoints.start + jnp.cumsum(moves)])
    marks = jnp.concatenate([jnp.zeros(1), jnp.cumsum(steps)])
    return Route(marks, places, headings, curvatures, sharpness)


def chain_turns(
    endpoints: PathEndpoints, heading: ScalarLike, angles: Float[Array, " turns"], scales: Float[Array, " turns"]
) -> tuple[Plane, Scalar, Float[Array, " turns"]]:
    """Displacement of four turns (rad; `tightness`) one after the other, their length, and the headings after each."""
    curvatures, sharpness = jax.vmap(tightness, in_axes=(None, 0))(endpoints, scales)
    turns = jax.vmap(smooth_turn)(angles, curvatures, sharpness)
    after = heading + jnp.cumsum(angles)
    moves = jax.vmap(displacement)(turns, sharpness)
    return jnp.sum(cis(after - angles) * moves), jnp.sum(turns.length), after
