"""Paths of a wanted length: the direct one of two turns, and detours to either side of it.

A direct path turns, flies straight, turns: four words, by the senses of its turns (as in Dubins' paths, whose lengths
it has plus what the ramps take). A detour leaves the straight line by an angle: the lengths of its two groups of
parallel legs then follow from where it must end, linearly, and the angle from the length that it must have.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.numerics.secant import bracketed_secant
from anser.planning.certified.route import PathEnds, TurnsAndLegs, roll_out, tightness, turned_through
from anser.planning.certified.smooth_turn import cis, smooth_turn
from anser.shapes import Count, Flag, Scalar, ScalarLike

TURN = 2 * np.pi
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
HEADINGS, FIRST, SECOND, FIXED = (np.array([kind[k] for kind in _DETOURS]) for k in range(4))
DETOUR_KINDS = len(_DETOURS)
ANGLE_MAX = np.array([2.6, 2.1, 2.1, 2.4, 1.5])
_HEADINGS_TRIED = 48
_AHEAD = 1e-3  # rad
_ANGLES_TRIED = 16
_STEPS = 10
_STEPS_AGAIN, _LONGEST_STEP = 6, 0.3  # from a path that is near, and rad
_SAME_LENGTH = 1e-6
"""Part of itself to which a length is met: the speed takes up the rest."""
_LONGEST = 1e12
_BESIDE = 1e-8  # part of the length by which a direct path may pass its end
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


def _full(outer: Float[Array, "2"], inner: float = 0.0) -> Float[Array, "4"]:
    """Four values of turns from those of the first and the last."""
    return jnp.concatenate([outer[:1], jnp.full(2, inner), outer[1:]])


def _word_angles(ends: PathEnds, begun: ScalarLike, word: Float[Array, "2"], heading: ScalarLike) -> Float[Array, "2"]:
    first = word[0] * (jnp.mod(word[0] * (heading - begun) + 2 * _AHEAD, TURN) - 2 * _AHEAD)
    last = word[1] * jnp.mod(word[1] * (ends.end_heading - heading), TURN)
    return jnp.stack([first, jnp.where(ends.end_free, 0.0, last)])


def _aim(ends: PathEnds, angles: Float[Array, "2"], scales: Float[Array, "2"]) -> tuple[Scalar, Scalar, Scalar]:
    """Length of the straight part, what it passes the end by to the right, and the length of the whole."""
    begun = roll_out(ends)
    turns, turning, after = turned_through(ends, begun.heading, _full(angles), _full(scales, 1.0))
    left = (ends.end - begun.place - turns) * cis(-after[0])
    return jnp.real(left), jnp.imag(left), begun.length + turning + jnp.real(left)


def _aim_error(angle: Scalar, data: tuple[PathEnds, Float[Array, "2"], Float[Array, "2"]]) -> Scalar:
    ends, base, lasting = data
    return _aim(ends, base + angle * lasting, jnp.ones(2))[1]


def direct(ends: PathEnds, word: Float[Array, "2"]) -> Direct:
    """The shortest direct path of one word (senses of the first and of the last turn, +1 right)."""
    begun = roll_out(ends).heading
    width = TURN / _HEADINGS_TRIED
    # A little before the present heading, so that going straight on is inside.
    tried = begun - _AHEAD + width * jnp.arange(_HEADINGS_TRIED)
    angles = jax.vmap(lambda h: _word_angles(ends, begun, word, h))(tried)
    # Where a turn's sense would wrap round within a step, it goes on the other way instead: no path is lost there.
    lasting = _lasting(ends)
    both = jnp.stack([angles, angles + width * lasting[None, :]], axis=1)
    straight, beside, length = jax.vmap(jax.vmap(lambda a: _aim(ends, a, jnp.ones(2))))(both)
    crossing = (beside[:, 0] * beside[:, 1] <= 0.0) & jnp.any(straight >= 0.0, axis=1)
    k = jnp.argmin(jnp.where(crossing, jnp.min(length, axis=1), jnp.inf))
    data = (ends, angles[k], lasting)
    found = bracketed_secant(_aim_error, data, 0.0, width, beside[k, 0], beside[k, 1], _STEPS)
    solved = angles[k] + found.x * lasting
    return _made(ends, solved, jnp.ones(2), jnp.any(crossing) & (~ends.end_free | (word[1] > 0.0)))


def _lasting(ends: PathEnds) -> Float[Array, "2"]:
    """How the turns change with the heading: as it grows, so does the first, and the last shrinks by as much."""
    return jnp.where(ends.end_free, jnp.array([1.0, 0.0]), jnp.array([1.0, -1.0]))


def _made(ends: PathEnds, angles: Float[Array, "2"], scales: Float[Array, "2"], may_exist: Flag) -> Direct:
    """A direct path of given turns, if it meets its end."""
    ahead, past, whole = _aim(ends, angles, scales)
    exists = may_exist & (jnp.abs(past) <= _BESIDE * jnp.abs(whole) + 1e-6) & (ahead >= 0.0)
    heading, straight = roll_out(ends).heading + angles[0], jnp.maximum(ahead, 0.0)
    return Direct(heading, angles, straight, jnp.where(exists, whole, _LONGEST), exists, scales)


def aimed_again(ends: PathEnds, base: Direct, scales: Float[Array, "2"]) -> Direct:
    """A direct path near another one, with other ends or turns of other scales; by the secant method."""
    lasting = _lasting(ends)

    def passed_by(x: Scalar) -> Scalar:
        return _aim(ends, base.angles + x * lasting, scales)[1]

    def closer(_: object, carry: tuple[Scalar, Scalar, Scalar, Scalar]) -> tuple[Scalar, Scalar, Scalar, Scalar]:
        before, x, past_before, past = carry
        gap = past - past_before
        step = jnp.where(gap == 0.0, 0.0, past * (x - before) / jnp.where(gap == 0.0, 1.0, gap))
        found = x - jnp.clip(step, -_LONGEST_STEP, _LONGEST_STEP)
        return x, found, past, passed_by(found)

    zero = jnp.zeros(())
    past = passed_by(zero)
    first = jnp.clip(past / jnp.maximum(base.straight, 1.0 / ends.curvature_max), -_LONGEST_STEP, _LONGEST_STEP)
    _, x, _, _ = jax.lax.fori_loop(0, _STEPS_AGAIN, closer, (zero, first, past, passed_by(first)))
    return _made(ends, base.angles + x * lasting, scales, base.exists)


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
    first: Float[Array, "3"]
    second: Float[Array, "3"]
    fixed: Float[Array, "3"]
    angle_max: Scalar


def detour(kind: Count | int, side: ScalarLike) -> Detour:
    """One kind of detour (0 to DETOUR_KINDS - 1), to a side (+1 right, -1 left)."""
    headings, *others = (jnp.asarray(table)[kind] for table in (HEADINGS, FIRST, SECOND, FIXED, ANGLE_MAX))
    return Detour(side * headings, *others)


def _turn_angles(base: Direct, way: Detour, angle: ScalarLike, free: Flag) -> Float[Array, "4"]:
    legs = way.headings * angle
    last = jnp.where(free, 0.0, base.angles[1] - legs[2])
    return jnp.stack([base.angles[0] + legs[0], legs[1] - legs[0], legs[2] - legs[1], last])


def _legs(
    ends: PathEnds, base: Direct, way: Detour, scales: Float[Array, "4"], angle: ScalarLike
) -> tuple[Float[Array, "3"], Scalar]:
    """Lengths of the three legs and of the whole path, m; a negative leg does not exist."""
    begun = roll_out(ends)
    angles = _turn_angles(base, way, angle, ends.end_free)
    turns, turning, after = turned_through(ends, begun.heading, angles, scales)
    along = cis(after[:3])
    fixed = base.straight * way.fixed
    left = ends.end - begun.place - turns - jnp.sum(fixed * along)
    a, b = jnp.sum(way.first * along), jnp.sum(way.second * along)
    area = jnp.imag(jnp.conj(a) * b)
    safe = jnp.where(jnp.abs(area) > _PARALLEL, area, 1.0)
    x = jnp.where(jnp.abs(area) > _PARALLEL, jnp.imag(jnp.conj(left) * b) / safe, -1.0)
    y = jnp.where(jnp.abs(area) > _PARALLEL, jnp.imag(jnp.conj(a) * left) / safe, -1.0)
    legs = x * way.first + y * way.second + fixed
    return legs, begun.length + turning + jnp.sum(legs)


def _excess(angle: Scalar, data: tuple[PathEnds, Direct, Detour, Array, Scalar]) -> Scalar:
    ends, base, way, scales, wanted = data
    return _legs(ends, base, way, scales, angle)[1] - wanted


def solve_detour(
    ends: PathEnds, base: Direct, way: Detour, wanted: ScalarLike, scales: Float[Array, "4"] | None = None
) -> TurnsAndLegs:
    """The least angle with which a detour from a direct path has a wanted length (m), within a part in a million.

    Its turns have given scales, see `tightness`; None: as tight as may be.
    """
    wanted = jnp.asarray(wanted, dtype=float)
    scales = jnp.ones(4) if scales is None else scales
    grid = way.angle_max * jnp.square(jnp.arange(1, _ANGLES_TRIED + 1) / _ANGLES_TRIED)
    legs, lengths = jax.vmap(lambda a: _legs(ends, base, way, scales, a))(grid)
    flyable = jnp.all(legs >= 0.0, axis=1)
    flyable = jnp.concatenate([base.exists[None], flyable])
    excess = jnp.concatenate([jnp.where(base.exists, base.length - wanted, 0.0)[None], lengths - wanted])
    crossing = flyable[1:] & flyable[:-1] & (excess[1:] * excess[:-1] <= 0.0)
    k = jnp.argmax(crossing)
    angles = jnp.concatenate([jnp.zeros(1), grid])
    data = (ends, base, way, scales, wanted)
    found = bracketed_secant(_excess, data, angles[k], angles[k + 1], excess[k], excess[k + 1], _STEPS).x
    solved, length = _legs(ends, base, way, scales, found)
    met = jnp.any(crossing) & (jnp.abs(length - wanted) <= _SAME_LENGTH * wanted) & jnp.all(solved >= 0.0)
    straight = flyable[0] & (jnp.abs(excess[0]) <= _SAME_LENGTH * wanted)
    zero = jnp.zeros(())
    return TurnsAndLegs(
        angles=jnp.where(straight, _full(base.angles), _turn_angles(base, way, found, ends.end_free)),
        scales=jnp.where(straight, _full(base.scales, 1.0), scales),
        legs=jnp.where(straight, jnp.stack([base.straight, zero, zero]), jnp.maximum(solved, 0.0)),
        exists=met | straight,
    )


_LEG_M = 4000.0  # of a racetrack: above it, more laps


def solve_racetrack(
    ends: PathEnds, base: Direct, side: Scalar, wanted: ScalarLike, scale: ScalarLike = 1.0
) -> TurnsAndLegs:
    """A racetrack flown first, to a side (+1 right), then a direct path: any length from one lap more on.

    Its turns have a given scale, see `tightness`. The laps beyond the first are whole turns, as many as leave its legs
    short.
    """
    wanted = jnp.asarray(wanted, dtype=float)
    curvature, sharpness = tightness(ends, scale)
    half = smooth_turn(jnp.pi, curvature, sharpness).length
    left = 0.5 * (wanted - base.length) - half
    turn = TURN / curvature
    turns = jnp.floor(jnp.maximum(left - _LEG_M, 0.0) / (0.5 * turn))
    leg = left - 0.5 * turns * turn
    laps = side * (jnp.pi + TURN * turns)
    exists = base.exists & (leg >= 0.0)
    leg = jnp.maximum(leg, 0.0)
    angles = jnp.stack([laps, side * jnp.pi, base.angles[0], base.angles[1]])
    scales = jnp.concatenate([jnp.full(2, scale), base.scales])
    return TurnsAndLegs(angles, scales, jnp.stack([leg, leg, base.straight]), exists)
