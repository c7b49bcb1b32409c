"""The horizontal part of a path, its route: turns and straight legs, by length along it."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from anser.planning.certified.smooth_turn import (
    Plane,
    along_arc,
    along_ramp,
    cis,
    displacement,
    smooth_turn,
)
from anser.shapes import Flag, Scalar, ScalarLike

TURNS, LEGS = 4, 3
PIECES = 1 + 3 * TURNS + LEGS
_UP, _FLAT, _DOWN = 0, 1, 2
# What remains of a turn under way; then turn, leg, turn, leg, turn, leg, turn.
_KINDS = np.array([_DOWN, *([_UP, _FLAT, _DOWN, _FLAT] * LEGS), _UP, _FLAT, _DOWN])


class PathEnds(eqx.Module):
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
    scale_most: Scalar


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
    place: Plane
    heading: Scalar


def roll_out(ends: PathEnds) -> RollOut:
    """Leave the turn in which a path begins."""
    sign = jnp.where(ends.curvature < 0.0, -1.0, 1.0)
    length = jnp.abs(ends.curvature) / ends.sharpness
    heading = ends.heading + 0.5 * ends.curvature * length
    step = cis(heading) * jnp.conj(along_ramp(length, sign * ends.sharpness))
    return RollOut(length, ends.start + step, heading)


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
    places: Complex[Array, " marks"]
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
        place = self.places[near] + cis(heading) * step
        turned = jnp.where(flat, curvature * u, 0.5 * sharp * u**2)
        bent = jnp.where(flat, curvature, sharp * u)
        beyond = length - held
        return (
            place + beyond * cis(heading + turned),
            heading + turned,
            jnp.where(beyond == 0.0, bent, 0.0),
        )


def tightness(ends: PathEnds, scale: ScalarLike) -> tuple[Scalar, Scalar]:
    """Greatest curvature (1/m) and sharpness (1/m^2) of a turn whose radius is `scale` times the least at full speed.

    The ramps keep their length: a slower aircraft takes more time for them than it needs, a wider turn as much.
    """
    return ends.curvature_max / scale, ends.sharpness / scale


def route(ends: PathEnds, solved: TurnsAndLegs) -> Route:
    """Path of turns with legs between them."""
    begun, angles = roll_out(ends), solved.angles
    curvatures, sharpest = jax.vmap(tightness, in_axes=(None, 0))(ends, solved.scales)
    turns = jax.vmap(smooth_turn)(angles, curvatures, sharpest)
    zero = jnp.zeros(())
    sign = jnp.where(angles < 0.0, -1.0, 1.0)
    lengths, bends, sharps = [begun.length], [zero], [-jnp.sign(ends.curvature) * ends.sharpness]
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
    curvatures = jnp.concatenate([ends.curvature[None], jnp.stack(bends)])
    turned = steps * 0.5 * (curvatures[1:] + curvatures[:-1])
    headings = jnp.concatenate([ends.heading[None], ends.heading + jnp.cumsum(turned)])
    sharpness = jnp.stack(sharps)
    falling = jnp.asarray(_KINDS == _DOWN)
    flat = jnp.asarray(_KINDS == _FLAT)
    from_start = jnp.where(
        flat, jax.vmap(along_arc)(steps, curvatures[:-1]), jax.vmap(along_ramp)(steps, sharpness)
    ) * cis(headings[:-1])
    from_end = -cis(headings[1:]) * jax.vmap(along_ramp)(-steps, sharpness)
    moves = jnp.where(falling, from_end, from_start)
    places = jnp.concatenate([ends.start[None], ends.start + jnp.cumsum(moves)])
    marks = jnp.concatenate([jnp.zeros(1), jnp.cumsum(steps)])
    return Route(marks, places, headings, curvatures, sharpness)


def turned_through(
    ends: PathEnds, heading: ScalarLike, angles: Float[Array, " turns"], scales: Float[Array, " turns"]
) -> tuple[Plane, Scalar, Float[Array, " turns"]]:
    """Displacement of four turns (rad; `tightness`) one after the other, their length, and the headings after each."""
    curvatures, sharpness = jax.vmap(tightness, in_axes=(None, 0))(ends, scales)
    turns = jax.vmap(smooth_turn)(angles, curvatures, sharpness)
    after = heading + jnp.cumsum(angles)
    moves = jax.vmap(displacement)(turns, sharpness)
    return jnp.sum(cis(after - angles) * moves), jnp.sum(turns.length), after
