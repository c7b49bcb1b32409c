"""Turns that are wider than need be where there is room for them, so that the aircraft banks little.

The tightest path of a kind is found first. How much wider each of its turns may be follows from the straight legs
beside it: a turn that is wider takes so much of both. With turns of these radii the path is then solved again.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.planning.certified.detours import Detour, Direct, aimed_again, solve_detour, solve_racetrack
from anser.planning.certified.route import PathEnds, TurnsAndLegs, tightness
from anser.planning.certified.smooth_turn import smooth_turn
from anser.planning.demand import demand
from anser.planning.timed_path import TimedPath
from anser.shapes import Scalar, ScalarLike

GENTLE_BANK = 0.0873
"""Turns are made no wider than for this bank angle, rad (5 deg): it is hardly felt, and a wider turn takes long."""
WIDTHS = (1.0, 0.6, 0.3)
"""Powers of the widest scales that are tried, the widest turns first."""
_PART_OF_LEG, _PART_OF_STRAIGHT = 0.4, 0.2  # that a turn takes when it is widened; a detour halves the straight line
_INSTANTS = 8
_CORNER_MOST = 2.4  # rad: a greater turn has its corner far away, or none


def _room(ends: PathEnds, angles: Float[Array, " turns"], lengths: Float[Array, " turns"]) -> Float[Array, " turns"]:
    """Scales with which turns (rad) begin and end farther from their corners by some lengths, m."""
    size = jnp.abs(angles)
    corner = jnp.tan(0.5 * jnp.minimum(size, _CORNER_MOST)) / ends.curvature_max
    scales = 1.0 + lengths / jnp.maximum(corner, 1e-9)
    return jnp.clip(scales, 1.0, ends.scale_most)


def widened(ends: PathEnds, base: Direct, width: ScalarLike) -> Direct:
    """The direct path of the same word with turns as wide as the length of its straight part allows.

    `width` is the power of the widest scales: 0 leaves the turns as tight as may be.
    """
    widest = _room(ends, base.angles, _PART_OF_STRAIGHT * jnp.broadcast_to(base.straight, (2,)))
    return aimed_again(ends, base, widest**width)


def widened_directs(ends: PathEnds, base: Direct) -> Direct:
    """The same for all `WIDTHS`, stacked."""
    return jax.vmap(lambda width: widened(ends, base, width))(jnp.array(WIDTHS))


def _first(found: TurnsAndLegs, other: TurnsAndLegs) -> TurnsAndLegs:
    """The first that exists of stacked ones, or else another."""
    picked = jax.tree.map(lambda leaf: leaf[jnp.argmax(found.exists)], found)
    return jax.tree.map(lambda a, b: jnp.where(jnp.any(found.exists), a, b), picked, other)


def widened_detour(ends: PathEnds, wide: Direct, way: Detour, wanted: ScalarLike, tight: TurnsAndLegs) -> TurnsAndLegs:
    """A detour of a wanted length (m) with turns as wide as its legs allow; itself where wider ones do not fit.

    Parameters
    ----------
    ends, way
        What it joins, and how.
    wide
        The direct path with turns of all widths, see `widened_directs`.
    tight
        The same detour with the tightest turns.
    """
    before, after = jnp.append(tight.legs[:1], tight.legs), jnp.append(tight.legs, tight.legs[-1:])
    widest = _room(ends, tight.angles, _PART_OF_LEG * jnp.minimum(before, after))

    def one(base: Direct, width: Scalar) -> TurnsAndLegs:
        outer = jnp.array([0, 3])
        scales = widest**width
        scales = scales.at[outer].set(jnp.minimum(scales[outer], base.scales))
        return solve_detour(ends, base, way, wanted, scales)

    found = jax.vmap(one)(wide, jnp.array(WIDTHS))
    return _first(found, tight)


def widened_racetrack(
    ends: PathEnds, wide: Direct, side: Scalar, wanted: ScalarLike, tight: TurnsAndLegs
) -> TurnsAndLegs:
    """A racetrack of a wanted length (m) with turns as wide as one lap allows; arguments as of `widened_detour`."""

    def one(base: Direct) -> TurnsAndLegs:
        ramps = 2.0 * smooth_turn(jnp.pi, *tightness(ends, 1.0)).ramp
        half = 0.5 * (wanted - base.length) - ramps
        scale = jnp.clip(half * ends.curvature_max / jnp.pi, 1.0, ends.scale_most)
        return solve_racetrack(ends, base, side, wanted, scale)

    return _first(jax.vmap(one)(wide), tight)


def greatest_curvature(ends: PathEnds, solved: TurnsAndLegs) -> Scalar:
    """Of the turns of a path, 1/m."""
    tight = jax.vmap(tightness, in_axes=(None, 0))(ends, solved.scales)
    turns: Array = jax.vmap(lambda angle, *own: jnp.abs(smooth_turn(angle, *own).peak))(solved.angles, *tight)
    return jnp.max(turns)


def greatest_bank_rate(path: TimedPath, gravity: ScalarLike) -> Scalar:
    """Greatest rate of the bank angle in coordinated flight along a path, at eight instants of each cell, rad/s."""

    def bank(time: Scalar) -> Scalar:
        return demand(path.air_velocity_n(time), path.at(time).acceleration_n, gravity).bank

    def of_cell(begin: Scalar, end: Scalar) -> Scalar:
        times = begin + (end - begin) * jnp.linspace(0.02, 0.98, _INSTANTS)
        rates = jax.vmap(lambda time: jax.jvp(bank, (time,), (jnp.ones_like(time),))[1])(times)
        return jnp.where(end > begin, jnp.max(jnp.abs(rates)), 0.0)

    return jnp.max(jax.vmap(of_cell)(path.times[:-1], path.times[1:]))
