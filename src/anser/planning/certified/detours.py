"""Detours: direct paths of two turns and detours from them with a target length, with tight or with wide turns.

A direct path turns, flies straight and turns: four words by the senses of its turns (as in Dubins' paths, whose
lengths it has plus what the ramps take). A detour leaves the straight line by an angle: the lengths of its two
groups of parallel legs follow linearly from the endpoint, and the angle follows from the target length. Where there
is room, turns are widened so that the aircraft banks little.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.numerics.roots import bracketed_secant
from anser.planning.certified.routes import (
    PathEndpoints,
    TurnsAndLegs,
    chain_turns,
    cis,
    roll_out,
    smooth_turn,
    tightness,
)
from anser.planning.demand import demand
from anser.planning.timed_path import TimedPath
from anser.shapes import Count, Flag, Scalar, ScalarLike

FULL_TURN = 2 * np.pi
# Senses of the first and the last turn.
WORDS = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])
# Headings of the three legs in units of the angle, right first; parts of the two unknown lengths that each leg has;
# part of the direct path's straight length that it has besides.
_DETOURS = (
    # right, then left of the line: a corner in the middle, near the start, near the end
    ((1.0, -1.0, -1.0), (1.0, 0.0, 0.0), (0.0, 0.5, 0.5), (0.0, 0.0, 0.0)),
    ((1.0, -0.4, -0.4), (1.0, 0.0, 0.0), (0.0, 0.5, 0.5), (0.0, 0.0, 0.0)),
    ((0.4, -1.0, -1.0), (1.0, 0.0, 0.0), (0.0, 0.5, 0.5), (0.0, 0.0, 0.0)),
    # along a parallel line
    ((1.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.4, 0.0)),
    # first to one side, then to the other
    ((1.0, -1.0, 1.0), (0.5, 0.0, 0.5), (0.0, 1.0, 0.0), (0.0, 0.0, 0.0)),
)
HEADINGS, FIRST_PARTS, SECOND_PARTS, FIXED_PARTS = (np.array([kind[k] for kind in _DETOURS]) for k in range(4))
DETOUR_KINDS = len(_DETOURS)
ANGLE_MAX = np.array([2.6, 2.1, 2.1, 2.4, 1.5])
_HEADINGS_TRIED = 48
_HEADING_MARGIN = 1e-3  # rad
_ANGLES_TRIED = 16
_STEPS = 10
_REAIM_STEPS, _LONGEST_STEP = 6, 0.3  # from a path that is near, and rad
_SAME_LENGTH = 1e-6
"""Part of itself to which a length is met: the speed takes up the rest."""
_LENGTH_MAX = 1e12
_END_TOLERANCE = 1e-8  # part of the length by which a direct path may pass its end
_PARALLEL = 1e-9


class Direct(eqx.Module):
    """The direct path of one word.

    Attributes
    ----------
    heading
        Of its straight part, rad.
    angles
        Its first and its last turn, rad.
    straight, length
        Of its straight part and of the whole, m.
    exists
        Whether there is one.
    scales
        Of its turns, see `tightness`.
    """

    heading: Scalar
    angles: Float[Array, "2"]
    straight: Scalar
    length: Scalar
    exists: Flag
    scales: Float[Array, "2"]


def _four_values(outer: Float[Array, "2"], inner: float = 0.0) -> Float[Array, "4"]:
    """Four values of turns from those of the first and the last."""
    return jnp.concatenate([outer[:1], jnp.full(2, inner), outer[1:]])


def _word_angles(
    endpoints: PathEndpoints, begun: ScalarLike, word: Float[Array, "2"], heading: ScalarLike
) -> Float[Array, "2"]:
    first = word[0] * (jnp.mod(word[0] * (heading - begun) + 2 * _HEADING_MARGIN, FULL_TURN) - 2 * _HEADING_MARGIN)
    last = word[1] * jnp.mod(word[1] * (endpoints.end_heading - heading), FULL_TURN)
    return jnp.stack([first, jnp.where(endpoints.end_free, 0.0, last)])


def _aim(
    endpoints: PathEndpoints, angles: Float[Array, "2"], scales: Float[Array, "2"]
) -> tuple[Scalar, Scalar, Scalar]:
    """Length of the straight part, what it passes the end by to the right, and the length of the whole."""
    begun = roll_out(endpoints)
    turns, turning, after = chain_turns(endpoints, begun.heading, _four_values(angles), _four_values(scales, 1.0))
    left = (endpoints.end - begun.position - turns) * cis(-after[0])
    return jnp.real(left), jnp.imag(left), begun.length + turning + jnp.real(left)


def _aim_error(angle: Scalar, data: tuple[PathEndpoints, Float[Array, "2"], Float[Array, "2"]]) -> Scalar:
    ends, base, lasting = data
    return _aim(ends, base + angle * lasting, jnp.ones(2))[1]


def direct(endpoints: PathEndpoints, word: Float[Array, "2"]) -> Direct:
    """The shortest direct path of one word (senses of the first and of the last turn, +1 right)."""
    begun = roll_out(endpoints).heading
    width = FULL_TURN / _HEADINGS_TRIED
    # A little before the present heading, so that going straight on is inside.
    tried = begun - _HEADING_MARGIN + width * jnp.arange(_HEADINGS_TRIED)
    angles = jax.vmap(lambda h: _word_angles(endpoints, begun, word, h))(tried)
    # Where a turn's sense would wrap round within a step, it goes on the other way instead: no path is lost there.
    lasting = _angle_rates(endpoints)
    both = jnp.stack([angles, angles + width * lasting[None, :]], axis=1)
    straight, beside, length = jax.vmap(jax.vmap(lambda a: _aim(endpoints, a, jnp.ones(2))))(both)
    crossing = (beside[:, 0] * beside[:, 1] <= 0.0) & jnp.any(straight >= 0.0, axis=1)
    k = jnp.argmin(jnp.where(crossing, jnp.min(length, axis=1), jnp.inf))
    data = (endpoints, angles[k], lasting)
    found = bracketed_secant(_aim_error, data, 0.0, width, beside[k, 0], beside[k, 1], _STEPS)
    solved = angles[k] + found.x * lasting
    return _make_direct(endpoints, solved, jnp.ones(2), jnp.any(crossing) & (~endpoints.end_free | (word[1] > 0.0)))


def _angle_rates(endpoints: PathEndpoints) -> Float[Array, "2"]:
    """How the turns change with the heading: as it grows, so does the first, and the last shrinks by as much."""
    return jnp.where(endpoints.end_free, jnp.array([1.0, 0.0]), jnp.array([1.0, -1.0]))


def _make_direct(
    endpoints: PathEndpoints, angles: Float[Array, "2"], scales: Float[Array, "2"], may_exist: Flag
) -> Direct:
    """A direct path of given turns, if it meets its end."""
    ahead, past, whole = _aim(endpoints, angles, scales)
    exists = may_exist & (jnp.abs(past) <= _END_TOLERANCE * jnp.abs(whole) + 1e-6) & (ahead >= 0.0)
    heading, straight = roll_out(endpoints).heading + angles[0], jnp.maximum(ahead, 0.0)
    return Direct(heading, angles, straight, jnp.where(exists, whole, _LENGTH_MAX), exists, scales)


def reaim(endpoints: PathEndpoints, base: Direct, scales: Float[Array, "2"]) -> Direct:
    """A direct path near another one, with other ends or turns of other scales; by the secant method."""
    lasting = _angle_rates(endpoints)

    def passed_by(x: Scalar) -> Scalar:
        return _aim(endpoints, base.angles + x * lasting, scales)[1]

    def closer(_: object, carry: tuple[Scalar, Scalar, Scalar, Scalar]) -> tuple[Scalar, Scalar, Scalar, Scalar]:
        before, x, past_before, past = carry
        gap = past - past_before
        step = jnp.where(gap == 0.0, 0.0, past * (x - before) / jnp.where(gap == 0.0, 1.0, gap))
        found = x - jnp.clip(step, -_LONGEST_STEP, _LONGEST_STEP)
        return x, found, past, passed_by(found)

    zero = jnp.zeros(())
    past = passed_by(zero)
    first = jnp.clip(past / jnp.maximum(base.straight, 1.0 / endpoints.curvature_max), -_LONGEST_STEP, _LONGEST_STEP)
    _, x, _, _ = jax.lax.fori_loop(0, _REAIM_STEPS, closer, (zero, first, past, passed_by(first)))
    return _make_direct(endpoints, base.angles + x * lasting, scales, base.exists)


class Detour(eqx.Module):
    """A way to be longer than a direct path; arrays, so that a batch of them is one computation.

    Attributes
    ----------
    headings, first, second, fixed
        Of its legs, see `HEADINGS`, `FIRST`, `SECOND`, `FIXED`; the sign of the headings is its side, right positive.
    angle_max
        Greatest angle tried, rad.
    """

    headings: Float[Array, "3"]
    first_parts: Float[Array, "3"]
    second_parts: Float[Array, "3"]
    fixed_parts: Float[Array, "3"]
    angle_max: Scalar


def detour(kind: Count | int, side: ScalarLike) -> Detour:
    """One kind of detour (0 to DETOUR_KINDS - 1), to a side (+1 right, -1 left)."""
    headings, *others = (
        jnp.asarray(table)[kind] for table in (HEADINGS, FIRST_PARTS, SECOND_PARTS, FIXED_PARTS, ANGLE_MAX)
    )
    return Detour(side * headings, *others)


def _turn_angles(base: Direct, detour: Detour, angle: ScalarLike, free: Flag) -> Float[Array, "4"]:
    legs = detour.headings * angle
    last = jnp.where(free, 0.0, base.angles[1] - legs[2])
    return jnp.stack([base.angles[0] + legs[0], legs[1] - legs[0], legs[2] - legs[1], last])


def _legs(
    endpoints: PathEndpoints, base: Direct, detour: Detour, scales: Float[Array, "4"], angle: ScalarLike
) -> tuple[Float[Array, "3"], Scalar]:
    """Lengths of the three legs and of the whole path, m; a negative leg does not exist."""
    begun = roll_out(endpoints)
    angles = _turn_angles(base, detour, angle, endpoints.end_free)
    turns, turning, after = chain_turns(endpoints, begun.heading, angles, scales)
    along = cis(after[:3])
    fixed = base.straight * detour.fixed_parts
    left = endpoints.end - begun.position - turns - jnp.sum(fixed * along)
    a, b = jnp.sum(detour.first_parts * along), jnp.sum(detour.second_parts * along)
    area = jnp.imag(jnp.conj(a) * b)
    safe = jnp.where(jnp.abs(area) > _PARALLEL, area, 1.0)
    x = jnp.where(jnp.abs(area) > _PARALLEL, jnp.imag(jnp.conj(left) * b) / safe, -1.0)
    y = jnp.where(jnp.abs(area) > _PARALLEL, jnp.imag(jnp.conj(a) * left) / safe, -1.0)
    legs = x * detour.first_parts + y * detour.second_parts + fixed
    return legs, begun.length + turning + jnp.sum(legs)


def _excess(angle: Scalar, data: tuple[PathEndpoints, Direct, Detour, Array, Scalar]) -> Scalar:
    ends, base, way, scales, wanted = data
    return _legs(ends, base, way, scales, angle)[1] - wanted


def solve_detour(
    endpoints: PathEndpoints,
    base: Direct,
    detour: Detour,
    target_length: ScalarLike,
    scales: Float[Array, "4"] | None = None,
) -> TurnsAndLegs:
    """The least angle with which a detour from a direct path has a wanted length (m), within a part in a million.

    Its turns have given scales, see `tightness`; None: as tight as may be.
    """
    target_length = jnp.asarray(target_length, dtype=float)
    scales = jnp.ones(4) if scales is None else scales
    grid = detour.angle_max * jnp.square(jnp.arange(1, _ANGLES_TRIED + 1) / _ANGLES_TRIED)
    legs, lengths = jax.vmap(lambda a: _legs(endpoints, base, detour, scales, a))(grid)
    flyable = jnp.all(legs >= 0.0, axis=1)
    flyable = jnp.concatenate([base.exists[None], flyable])
    excess = jnp.concatenate([jnp.where(base.exists, base.length - target_length, 0.0)[None], lengths - target_length])
    crossing = flyable[1:] & flyable[:-1] & (excess[1:] * excess[:-1] <= 0.0)
    k = jnp.argmax(crossing)
    angles = jnp.concatenate([jnp.zeros(1), grid])
    data = (endpoints, base, detour, scales, target_length)
    found = bracketed_secant(_excess, data, angles[k], angles[k + 1], excess[k], excess[k + 1], _STEPS).x
    solved, length = _legs(endpoints, base, detour, scales, found)
    met = jnp.any(crossing) & (jnp.abs(length - target_length) <= _SAME_LENGTH * target_length) & jnp.all(solved >= 0.0)
    straight = flyable[0] & (jnp.abs(excess[0]) <= _SAME_LENGTH * target_length)
    zero = jnp.zeros(())
    return TurnsAndLegs(
        angles=jnp.where(straight, _four_values(base.angles), _turn_angles(base, detour, found, endpoints.end_free)),
        scales=jnp.where(straight, _four_values(base.scales, 1.0), scales),
        legs=jnp.where(straight, jnp.stack([base.straight, zero, zero]), jnp.maximum(solved, 0.0)),
        exists=met | straight,
    )


_LEG_M = 4000.0  # of a racetrack: above it, more laps


def solve_racetrack(
    endpoints: PathEndpoints, base: Direct, side: Scalar, target_length: ScalarLike, scale: ScalarLike = 1.0
) -> TurnsAndLegs:
    """A racetrack flown first, to a side (+1 right), then a direct path: any length from one lap more on.

    Its turns have a given scale, see `tightness`. The laps beyond the first are whole turns, as many as leave its legs
    short.
    """
    target_length = jnp.asarray(target_length, dtype=float)
    curvature, sharpness = tightness(endpoints, scale)
    half = smooth_turn(jnp.pi, curvature, sharpness).length
    left = 0.5 * (target_length - base.length) - half
    turn = FULL_TURN / curvature
    turns = jnp.floor(jnp.maximum(left - _LEG_M, 0.0) / (0.5 * turn))
    leg = left - 0.5 * turns * turn
    laps = side * (jnp.pi + FULL_TURN * turns)
    exists = base.exists & (leg >= 0.0)
    leg = jnp.maximum(leg, 0.0)
    angles = jnp.stack([laps, side * jnp.pi, base.angles[0], base.angles[1]])
    scales = jnp.concatenate([jnp.full(2, scale), base.scales])
    return TurnsAndLegs(angles, scales, jnp.stack([leg, leg, base.straight]), exists)


GENTLE_BANK = 0.0873
"""Turns are made no wider than for this bank angle, rad (5 deg): it is hardly felt, and a wider turn takes long."""
WIDTHS = (1.0, 0.6, 0.3)
"""Powers of the widest scales that are tried, the widest turns first."""
_PART_OF_LEG, _PART_OF_STRAIGHT = 0.4, 0.2  # that a turn takes when it is widened; a detour halves the straight line
_SAMPLES_PER_CELL = 8
_CORNER_MOST = 2.4  # rad: a greater turn has its corner far away, or none


def _widest_scales(
    endpoints: PathEndpoints, angles: Float[Array, " turns"], lengths: Float[Array, " turns"]
) -> Float[Array, " turns"]:
    """Scales with which turns (rad) begin and end farther from their corners by some lengths, m."""
    size = jnp.abs(angles)
    corner = jnp.tan(0.5 * jnp.minimum(size, _CORNER_MOST)) / endpoints.curvature_max
    scales = 1.0 + lengths / jnp.maximum(corner, 1e-9)
    return jnp.clip(scales, 1.0, endpoints.scale_max)


def widen_direct(endpoints: PathEndpoints, base: Direct, width: ScalarLike) -> Direct:
    """The direct path of the same word with turns as wide as the length of its straight part allows.

    `width` is the power of the widest scales: 0 leaves the turns as tight as may be.
    """
    widest = _widest_scales(endpoints, base.angles, _PART_OF_STRAIGHT * jnp.broadcast_to(base.straight, (2,)))
    return reaim(endpoints, base, widest**width)


def widen_directs(endpoints: PathEndpoints, base: Direct) -> Direct:
    """The same for all `WIDTHS`, stacked."""
    return jax.vmap(lambda width: widen_direct(endpoints, base, width))(jnp.array(WIDTHS))


def _first_existing(found: TurnsAndLegs, other: TurnsAndLegs) -> TurnsAndLegs:
    """The first that exists of stacked ones, or else another."""
    picked = jax.tree.map(lambda leaf: leaf[jnp.argmax(found.exists)], found)
    return jax.tree.map(lambda a, b: jnp.where(jnp.any(found.exists), a, b), picked, other)


def widen_detour(
    endpoints: PathEndpoints, wide: Direct, detour: Detour, target_length: ScalarLike, tight: TurnsAndLegs
) -> TurnsAndLegs:
    """A detour of a wanted length (m) with turns as wide as its legs allow; itself where wider ones do not fit.

    Parameters
    ----------
    ends, way
        What it joins, and how.
    wide
        The direct path with turns of all widths, see `widen_directs`.
    tight
        The same detour with the tightest turns.
    """
    before, after = jnp.append(tight.legs[:1], tight.legs), jnp.append(tight.legs, tight.legs[-1:])
    widest = _widest_scales(endpoints, tight.angles, _PART_OF_LEG * jnp.minimum(before, after))

    def one(base: Direct, width: Scalar) -> TurnsAndLegs:
        outer = jnp.array([0, 3])
        scales = widest**width
        scales = scales.at[outer].set(jnp.minimum(scales[outer], base.scales))
        return solve_detour(endpoints, base, detour, target_length, scales)

    found = jax.vmap(one)(wide, jnp.array(WIDTHS))
    return _first_existing(found, tight)


def widen_racetrack(
    endpoints: PathEndpoints, wide: Direct, side: Scalar, target_length: ScalarLike, tight: TurnsAndLegs
) -> TurnsAndLegs:
    """A racetrack of a wanted length (m) with turns as wide as one lap allows; arguments as of `widen_detour`."""

    def one(base: Direct) -> TurnsAndLegs:
        ramps = 2.0 * smooth_turn(jnp.pi, *tightness(endpoints, 1.0)).ramp
        half = 0.5 * (target_length - base.length) - ramps
        scale = jnp.clip(half * endpoints.curvature_max / jnp.pi, 1.0, endpoints.scale_max)
        return solve_racetrack(endpoints, base, side, target_length, scale)

    return _first_existing(jax.vmap(one)(wide), tight)


def greatest_curvature(endpoints: PathEndpoints, solved: TurnsAndLegs) -> Scalar:
    """Of the turns of a path, 1/m."""
    tight = jax.vmap(tightness, in_axes=(None, 0))(endpoints, solved.scales)
    turns: Array = jax.vmap(lambda angle, *own: jnp.abs(smooth_turn(angle, *own).peak))(solved.angles, *tight)
    return jnp.max(turns)


def greatest_bank_rate(path: TimedPath, gravity: ScalarLike) -> Scalar:
    """Greatest rate of the bank angle in coordinated flight along a path, at eight instants of each cell, rad/s."""

    def bank(time: Scalar) -> Scalar:
        return demand(path.air_velocity_n(time), path.at(time).acceleration_n, gravity).bank

    def of_cell(begin: Scalar, end: Scalar) -> Scalar:
        times = begin + (end - begin) * jnp.linspace(0.02, 0.98, _SAMPLES_PER_CELL)
        rates = jax.vmap(lambda time: jax.jvp(bank, (time,), (jnp.ones_like(time),))[1])(times)
        return jnp.where(end > begin, jnp.max(jnp.abs(rates)), 0.0)

    return jnp.max(jax.vmap(of_cell)(path.times[:-1], path.times[1:]))
