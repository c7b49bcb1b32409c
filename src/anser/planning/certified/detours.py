"""Direct paths of two turns, and detours from direct paths with a target length, with tight or with wide turns.

A direct path turns, flies straight and turns. Its word gives the senses of the two turns, as for Dubins' paths;
curvature ramps at the turns make the path longer than Dubins' path. A detour leaves the straight part by an angle and
returns: two unknown leg lengths follow linearly from the endpoint, and the angle follows from the target length.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.numerics.roots import bracketed_secant
from anser.planning.certified.routes import (
    PathEndpoints,
    RollOut,
    TurnsAndLegs,
    chain_turns,
    cis,
    roll_out,
    smooth_turn,
    turn_limits,
)
from anser.planning.demand import demand
from anser.planning.timed_path import TimedPath
from anser.shapes import Flag, Integer, Scalar, ScalarLike

FULL_TURN = 2 * np.pi
# Senses of the first and the last turn.
WORDS = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])
# For each kind of detour to the right, values of the three legs: heading in units of the detour's angle; coefficients
# of the two unknown lengths in the leg's length; fraction of the direct path's straight part added to the length.
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
_HEADING_COUNT = 48
_HEADING_MARGIN = 1e-3  # rad
_ANGLE_COUNT = 16
_STEPS = 10
_REAIM_STEPS, _LONGEST_STEP = 8, 0.3  # evaluations, starting from a nearby path; rad
_LENGTH_TOLERANCE = 1e-6
"""Tolerance of a path's length, relative to the length; the airspeed absorbs the difference."""
_LENGTH_MAX = 1e12
_END_TOLERANCE = 1e-8  # greatest miss distance of a direct path, relative to its length
_PARALLEL = 1e-9


class DirectPath(eqx.Module):
    """Direct path of one word (senses of its two turns): a turn, a straight line, a turn."""

    heading: Scalar  # heading of the straight line, rad
    angles: Float[Array, "2"]  # turn angles, rad, right positive
    straight: Scalar  # length of the straight line, m
    length: Scalar  # length of the whole path, m
    exists: Flag  # whether the path reaches its end
    scales: Float[Array, "2"]  # radii of the turns over the tightest radius


def _four_values(outer: Float[Array, "2"], inner: float = 0.0) -> Float[Array, "4"]:
    """Return values for the four turns of a detour: `outer` for first and last turn, `inner` for the two between."""
    return jnp.concatenate([outer[:1], jnp.full(2, inner), outer[1:]])


def _word_angles(
    endpoints: PathEndpoints, start_heading: ScalarLike, word: Float[Array, "2"], heading: ScalarLike
) -> Float[Array, "2"]:
    first_turn = word[0] * (
        jnp.mod(word[0] * (heading - start_heading) + 2 * _HEADING_MARGIN, FULL_TURN) - 2 * _HEADING_MARGIN
    )
    last_turn = word[1] * jnp.mod(word[1] * (endpoints.end_heading - heading), FULL_TURN)
    return jnp.stack([first_turn, jnp.where(endpoints.end_free, 0.0, last_turn)])


class _Aim(NamedTuple):
    """Lengths and miss distance, m, of a direct path with prescribed turn angles."""

    straight: Scalar  # straight part
    miss: Scalar  # miss distance at the end; positive if the end lies to the right of the path
    length: Scalar  # whole path


def _aim(endpoints: PathEndpoints, initial: RollOut, angles: Float[Array, "2"], scales: Float[Array, "2"]) -> _Aim:
    """Compute straight part, miss distance and length (m) of a direct path whose turns have the given `angles`.

    The path begins with the roll-out `initial` from the initial turn. `angles` in rad, right positive; `scales` is the
    radius of each turn over the tightest radius.
    """
    # A direct path has two turns; the four turns of a detour would add two of zero length.
    turns, turn_length, headings = chain_turns(endpoints, initial.heading, angles, scales)
    remaining = (endpoints.end - initial.position - turns) * cis(-headings[0])
    return _Aim(jnp.real(remaining), jnp.imag(remaining), initial.length + turn_length + jnp.real(remaining))


def _aim_error(angle: Scalar, data: tuple[PathEndpoints, RollOut, Float[Array, "2"], Float[Array, "2"]]) -> Scalar:
    endpoints, initial, base, angle_rates = data
    return _aim(endpoints, initial, base + angle * angle_rates, jnp.ones(2)).miss


def direct_path(endpoints: PathEndpoints, word: Float[Array, "2"]) -> DirectPath:
    """Find the shortest direct path of one word, with the tightest turns; `exists` is false if there is no path.

    The word gives the senses of the first and of the last turn, +1 right, -1 left. If the end heading is free, there is
    no last turn, and only the words with +1 for the last turn have a path.
    """
    initial = roll_out(endpoints)
    start_heading = initial.heading
    width = FULL_TURN / _HEADING_COUNT
    # The grid starts slightly before the current heading, so that straight flight lies inside.
    headings = start_heading - _HEADING_MARGIN + width * jnp.arange(_HEADING_COUNT)
    angles = jax.vmap(lambda h: _word_angles(endpoints, start_heading, word, h))(headings)
    # If a turn angle would wrap around within a step, it continues linearly instead, so that no path is lost.
    angle_rates = _angle_rates(endpoints)
    step_angles = jnp.stack([angles, angles + width * angle_rates[None, :]], axis=1)
    straight, miss, length = jax.vmap(jax.vmap(lambda a: _aim(endpoints, initial, a, jnp.ones(2))))(step_angles)
    crossing = (miss[:, 0] * miss[:, 1] <= 0.0) & jnp.any(straight >= 0.0, axis=1)
    k = jnp.argmin(jnp.where(crossing, jnp.min(length, axis=1), jnp.inf))
    data = (endpoints, initial, angles[k], angle_rates)
    root = bracketed_secant(_aim_error, data, 0.0, width, miss[k, 0], miss[k, 1], _STEPS)
    solved = angles[k] + root.x * angle_rates
    tightest = jnp.ones(2)
    may_exist = jnp.any(crossing) & (~endpoints.end_free | (word[1] > 0.0))
    return _make_direct(initial, _aim(endpoints, initial, solved, tightest), solved, tightest, may_exist)


def _angle_rates(endpoints: PathEndpoints) -> Float[Array, "2"]:
    """Return the derivatives of both turn angles by the heading of the straight part."""
    return jnp.where(endpoints.end_free, jnp.array([1.0, 0.0]), jnp.array([1.0, -1.0]))


def _make_direct(
    initial: RollOut, aim: _Aim, angles: Float[Array, "2"], scales: Float[Array, "2"], may_exist: Flag
) -> DirectPath:
    """Build the direct path with turn angles (rad) and `scales` (turn radii over the tightest radius).

    `aim` is the result of `_aim` for this path; `initial` is the roll-out before the first turn. The path exists if
    `may_exist` is set, the straight part is not negative and the end is met; if not, the length is `_LENGTH_MAX`.
    """
    is_hit = jnp.abs(aim.miss) <= _END_TOLERANCE * jnp.abs(aim.length) + 1e-6
    exists = may_exist & is_hit & (aim.straight >= 0.0)
    heading, straight = initial.heading + angles[0], jnp.maximum(aim.straight, 0.0)
    return DirectPath(heading, angles, straight, jnp.where(exists, aim.length, _LENGTH_MAX), exists, scales)


def reaim(endpoints: PathEndpoints, base: DirectPath, scales: Float[Array, "2"]) -> DirectPath:
    """Adapt the direct path `base` to other endpoints or turn scales; `exists` is false if the end is missed."""
    angle_rates, initial = _angle_rates(endpoints), roll_out(endpoints)
    straight = jnp.maximum(base.straight, 1.0 / endpoints.curvature_max)

    def evaluate_and_step(k: Integer, carry: tuple[Scalar, Scalar, _Aim]) -> tuple[Scalar, Scalar, _Aim]:
        """Do one secant step for the angle (rad) from the straight part of `base` to the new straight part."""
        previous, x, former_aim = carry
        aim = _aim(endpoints, initial, base.angles + x * angle_rates, scales)
        gap = aim.miss - former_aim.miss
        secant = -jnp.where(gap == 0.0, 0.0, aim.miss * (x - previous) / jnp.where(gap == 0.0, 1.0, gap))
        step = jnp.where(k == 0, aim.miss / straight, secant)
        return x, x + jnp.clip(step, -_LONGEST_STEP, _LONGEST_STEP), aim

    zero = jnp.zeros(())
    x, _, aim = jax.lax.fori_loop(0, _REAIM_STEPS, evaluate_and_step, (zero, zero, _Aim(zero, zero, zero)))
    return _make_direct(initial, aim, base.angles + x * angle_rates, scales, base.exists)


class Detour(eqx.Module):
    """Shape of a detour of three legs, in place of the straight part of a direct path.

    leg length = first_parts * x + second_parts * y + fixed_parts * (length of the straight part). The lengths x and y
    are chosen such that the detour leads to the end of the path.
    """

    # headings of the legs relative to the straight part, as multiples of the angle of the detour; right positive
    headings: Float[Array, "3"]
    first_parts: Float[Array, "3"]
    second_parts: Float[Array, "3"]
    fixed_parts: Float[Array, "3"]
    angle_max: Scalar  # greatest angle of the detour, rad


def detour(kind: Integer | int, side: ScalarLike) -> Detour:
    """Return the shape of a detour to one side (+1 right, -1 left); `kind` may be a batch.

    - 0, 1, 2: one corner, in the middle, near the start, near the end
    - 3: along a parallel line
    - 4: first to this side, then to the other
    """
    headings, *parts_and_limit = (
        jnp.asarray(table)[kind] for table in (HEADINGS, FIRST_PARTS, SECOND_PARTS, FIXED_PARTS, ANGLE_MAX)
    )
    return Detour(side * headings, *parts_and_limit)


def _turn_angles(base: DirectPath, detour: Detour, angle: ScalarLike, end_free: Flag) -> Float[Array, "4"]:
    legs = detour.headings * angle
    last_turn = jnp.where(end_free, 0.0, base.angles[1] - legs[2])
    return jnp.stack([base.angles[0] + legs[0], legs[1] - legs[0], legs[2] - legs[1], last_turn])


def _legs(
    endpoints: PathEndpoints,
    initial: RollOut,
    base: DirectPath,
    detour: Detour,
    scales: Float[Array, "4"],
    angle: ScalarLike,
) -> tuple[Float[Array, "3"], Scalar]:
    """Compute the lengths of a detour's three legs and of the whole path, m, for a detour angle (rad).

    A negative leg length means that the detour does not exist.
    """
    angles = _turn_angles(base, detour, angle, endpoints.end_free)
    turns, turn_length, headings = chain_turns(endpoints, initial.heading, angles, scales)
    along = cis(headings[:3])
    fixed = base.straight * detour.fixed_parts
    remaining = endpoints.end - initial.position - turns - jnp.sum(fixed * along)
    a, b = jnp.sum(detour.first_parts * along), jnp.sum(detour.second_parts * along)
    area = jnp.imag(jnp.conj(a) * b)
    safe = jnp.where(jnp.abs(area) > _PARALLEL, area, 1.0)
    x = jnp.where(jnp.abs(area) > _PARALLEL, jnp.imag(jnp.conj(remaining) * b) / safe, -1.0)
    y = jnp.where(jnp.abs(area) > _PARALLEL, jnp.imag(jnp.conj(a) * remaining) / safe, -1.0)
    legs = x * detour.first_parts + y * detour.second_parts + fixed
    return legs, initial.length + turn_length + jnp.sum(legs)


def _excess(angle: Scalar, data: tuple[PathEndpoints, RollOut, DirectPath, Detour, Array, Scalar]) -> Scalar:
    endpoints, initial, base, detour, scales, target_length = data
    return _legs(endpoints, initial, base, detour, scales, angle)[1] - target_length


def solve_detour(
    endpoints: PathEndpoints,
    base: DirectPath,
    detour: Detour,
    target_length: ScalarLike,
    scales: Float[Array, "4"] | None = None,
) -> TurnsAndLegs:
    """Find the detour of least angle that has a target length (m), to a part in a million.

    The detour departs from the direct path `base`, which is the result if its length is the target. `scales` are the
    turn radii over the tightest radius (None: 1). If there is no solution, `exists` is false.
    """
    target_length = jnp.asarray(target_length, dtype=float)
    scales = jnp.ones(4) if scales is None else scales
    grid = detour.angle_max * jnp.square(jnp.arange(1, _ANGLE_COUNT + 1) / _ANGLE_COUNT)
    shape = endpoints, roll_out(endpoints), base, detour, scales
    legs, lengths = jax.vmap(lambda a: _legs(*shape, a))(grid)
    flyable = jnp.all(legs >= 0.0, axis=1)
    flyable = jnp.concatenate([base.exists[None], flyable])
    excess = jnp.concatenate([jnp.where(base.exists, base.length - target_length, 0.0)[None], lengths - target_length])
    crossing = flyable[1:] & flyable[:-1] & (excess[1:] * excess[:-1] <= 0.0)
    k = jnp.argmax(crossing)
    angles = jnp.concatenate([jnp.zeros(1), grid])
    bracket = angles[k], angles[k + 1], excess[k], excess[k + 1]
    angle = bracketed_secant(_excess, (*shape, target_length), *bracket, _STEPS).x
    leg_lengths, length = _legs(*shape, angle)
    solved_within_tolerance = (
        jnp.any(crossing)
        & (jnp.abs(length - target_length) <= _LENGTH_TOLERANCE * target_length)
        & jnp.all(leg_lengths >= 0.0)
    )
    straight = flyable[0] & (jnp.abs(excess[0]) <= _LENGTH_TOLERANCE * target_length)
    zero = jnp.zeros(())
    return TurnsAndLegs(
        angles=jnp.where(straight, _four_values(base.angles), _turn_angles(base, detour, angle, endpoints.end_free)),
        scales=jnp.where(straight, _four_values(base.scales, 1.0), scales),
        legs=jnp.where(straight, jnp.stack([base.straight, zero, zero]), jnp.maximum(leg_lengths, 0.0)),
        exists=solved_within_tolerance | straight,
    )


_LEG_M = 4000.0  # greatest leg of a racetrack, m: a longer target length adds laps


def solve_racetrack(
    endpoints: PathEndpoints, base: DirectPath, side: Scalar, target_length: ScalarLike, scale: ScalarLike = 1.0
) -> TurnsAndLegs:
    """Return a path of a target length (m): a racetrack to a side (+1 right, -1 left), then the direct path `base`.

    `exists` is false if the target length leaves no room for one lap. `scale` is the turn radius of the racetrack over
    the tightest radius.
    """
    target_length = jnp.asarray(target_length, dtype=float)
    curvature, sharpness = turn_limits(endpoints, scale)
    half = smooth_turn(jnp.pi, curvature, sharpness).length
    leg_length = 0.5 * (target_length - base.length) - half
    turn = FULL_TURN / curvature
    extra_turns = jnp.floor(jnp.maximum(leg_length - _LEG_M, 0.0) / (0.5 * turn))
    leg = leg_length - 0.5 * extra_turns * turn
    laps = side * (jnp.pi + FULL_TURN * extra_turns)
    exists = base.exists & (leg >= 0.0)
    leg = jnp.maximum(leg, 0.0)
    angles = jnp.stack([laps, side * jnp.pi, base.angles[0], base.angles[1]])
    scales = jnp.concatenate([jnp.full(2, scale), base.scales])
    return TurnsAndLegs(angles, scales, jnp.stack([leg, leg, base.straight]), exists)


GENTLE_BANK = 0.0873
"""Bank angle of the widest turn, rad (5 deg): an even wider turn takes longer without a noticeable benefit."""
WIDTHS = (1.0, 0.6, 0.3)
"""Widths of turns to try, the widest first: exponents of the greatest scale (radius) for which the legs have room."""
_PART_OF_LEG, _PART_OF_STRAIGHT = (
    0.4,
    0.2,
)  # of the length that a widened turn may consume; a detour halves the straight line
_SAMPLES_PER_CELL = 8
_CORNER_MAX = 2.4  # rad: the corner of a greater turn is far away or does not exist


def _widest_scales(
    endpoints: PathEndpoints, angles: Float[Array, " turns"], lengths: Float[Array, " turns"]
) -> Float[Array, " turns"]:
    """Return the greatest radii of turns by `angles` (rad) for which the legs have room, over the tightest radius.

    The tangents of a turn lead from its start to its corner and on to its end. Each tangent may be longer than in the
    tightest turn by `lengths` (m). The results are between 1 and `endpoints.scale_max`.
    """
    size = jnp.abs(angles)
    corner = jnp.tan(0.5 * jnp.minimum(size, _CORNER_MAX)) / endpoints.curvature_max
    scales = 1.0 + lengths / jnp.maximum(corner, 1e-9)
    return jnp.clip(scales, 1.0, endpoints.scale_max)


def widen_direct(endpoints: PathEndpoints, base: DirectPath, width: ScalarLike) -> DirectPath:
    """Return a direct path with the word of `base` and wider turns, which shorten the straight part.

    `width` interpolates the turn radii geometrically: 0 for the tightest turns, 1 for the widest that the straight part
    allows.
    """
    widest = _widest_scales(endpoints, base.angles, _PART_OF_STRAIGHT * jnp.broadcast_to(base.straight, (2,)))
    return reaim(endpoints, base, widest**width)


def widen_directs(endpoints: PathEndpoints, base: DirectPath) -> DirectPath:
    """Return the direct paths with turns widened by `widen_direct` to each of `WIDTHS`; stacked, widest first."""
    return jax.vmap(lambda width: widen_direct(endpoints, base, width))(jnp.array(WIDTHS))


def _first_existing(options: TurnsAndLegs, fallback: TurnsAndLegs) -> TurnsAndLegs:
    """Return the first existing path of the stack `options`, or `fallback` if none exists."""
    picked = jax.tree.map(lambda leaf: leaf[jnp.argmax(options.exists)], options)
    return jax.tree.map(lambda a, b: jnp.where(jnp.any(options.exists), a, b), picked, fallback)


def widen_detour(
    endpoints: PathEndpoints, wide: DirectPath, detour: Detour, target_length: ScalarLike, tight: TurnsAndLegs
) -> TurnsAndLegs:
    """Find a path of a target length (m) with the shape `detour`, and with turns as wide as its legs allow.

    `wide` are the direct paths from `widen_directs`, from which wider turns depart. `tight` is the solution with the
    tightest turns, which is returned if no wider turns fit.
    """
    legs_before, legs_after = jnp.append(tight.legs[:1], tight.legs), jnp.append(tight.legs, tight.legs[-1:])
    widest = _widest_scales(endpoints, tight.angles, _PART_OF_LEG * jnp.minimum(legs_before, legs_after))

    def solve_width(base: DirectPath, width: Scalar) -> TurnsAndLegs:
        outer = jnp.array([0, 3])
        scales = widest**width
        scales = scales.at[outer].set(jnp.minimum(scales[outer], base.scales))
        return solve_detour(endpoints, base, detour, target_length, scales)

    options = jax.vmap(solve_width)(wide, jnp.array(WIDTHS))
    return _first_existing(options, tight)


def widen_racetrack(
    endpoints: PathEndpoints, wide: DirectPath, side: Scalar, target_length: ScalarLike, tight: TurnsAndLegs
) -> TurnsAndLegs:
    """Return the racetrack of a target length (m) with turns as wide as one lap allows.

    Arguments as in `widen_detour`; `side` is +1 for a racetrack to the right, -1 to the left.
    """

    def solve_width(base: DirectPath) -> TurnsAndLegs:
        ramps = 2.0 * smooth_turn(jnp.pi, *turn_limits(endpoints, 1.0)).ramp
        half = 0.5 * (target_length - base.length) - ramps
        scale = jnp.clip(half * endpoints.curvature_max / jnp.pi, 1.0, endpoints.scale_max)
        return solve_racetrack(endpoints, base, side, target_length, scale)

    return _first_existing(jax.vmap(solve_width)(wide), tight)


def greatest_curvature(endpoints: PathEndpoints, solved: TurnsAndLegs) -> Scalar:
    """Return the greatest curvature, 1/m, among the turns of a path."""
    tight = jax.vmap(turn_limits, in_axes=(None, 0))(endpoints, solved.scales)
    turns: Array = jax.vmap(lambda angle, *turn_tightness: jnp.abs(smooth_turn(angle, *turn_tightness).peak))(
        solved.angles, *tight
    )
    return jnp.max(turns)


def greatest_bank_rate(path: TimedPath, gravity: ScalarLike) -> Scalar:
    """Return the greatest bank rate, rad/s, along a path in coordinated flight, from eight samples per cell."""

    def bank(time: Scalar) -> Scalar:
        return demand(path.air_velocity_n(time), path.at(time).acceleration_n, gravity).bank

    def cell_maximum(begin: Scalar, end: Scalar) -> Scalar:
        times = begin + (end - begin) * jnp.linspace(0.02, 0.98, _SAMPLES_PER_CELL)
        rates = jax.vmap(lambda time: jax.jvp(bank, (time,), (jnp.ones_like(time),))[1])(times)
        return jnp.where(end > begin, jnp.max(jnp.abs(rates)), 0.0)

    return jnp.max(jax.vmap(cell_maximum)(path.times[:-1], path.times[1:]))
