"""All the ways in which one aircraft can be at its rendezvous at a given time."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp

from anser.planning.certified.choices import RACETRACK, Choices
from anser.planning.certified.detours import (
    ANGLE_MAX,
    FIRST,
    FIXED,
    HEADINGS,
    SECOND,
    SHAPES,
    Detour,
    Solved,
    solve_detour,
    solve_racetrack,
)
from anser.planning.certified.free_shapes import Task, make_closed, make_pace, make_starts, solve_freely
from anser.planning.certified.profile import Profile, Timetable
from anser.planning.certified.request import Airspace, Traveller
from anser.planning.certified.route import Ends
from anser.planning.certified.timed_profile import TimedProfile, timed_profiles
from anser.shapes import Count, Flag, Scalar, ScalarLike


class Candidate(eqx.Module):
    """One way to be there in time; stacked, all of them.

    Attributes
    ----------
    profile
        Altitude and airspeed by time.
    ends, solved
        Its horizontal shape.
    valid
        Whether it exists within the limits of its aircraft.
    cost
        How little it is liked.
    speed
        Mean airspeed, m/s.
    which
        Index of its profile.
    """

    profile: Profile
    ends: Ends
    solved: Solved
    valid: Flag
    cost: Scalar
    speed: Scalar
    which: Count


def candidates(
    traveller: Traveller, airspace: Airspace, duration: ScalarLike, ticks: int, choices: Choices
) -> tuple[Candidate, Timetable]:
    """The candidates of one aircraft for a duration (s), and the timetables of the profiles, stacked by profile."""
    duration = jnp.asarray(duration, dtype=float)
    timed = timed_profiles(traveller, airspace, duration, ticks, choices)
    numbers = jnp.arange(len(choices.speeds))
    each_way = jax.vmap(functools.partial(_detoured, traveller, choices), in_axes=(None, None, 0, 0, 0))
    words, shapes, sides = (jnp.asarray(x) for x in (choices.words, choices.shapes, choices.sides))
    heights = jnp.asarray(choices.heights)
    costs = jnp.abs(timed.speed / traveller.speed - 1.0) * 20.0 + jnp.abs(heights) / 400.0
    found = jax.vmap(each_way, in_axes=(0, 0, None, None, None))(timed, (costs, numbers), words, shapes, sides)
    if choices.starts:
        free = jax.vmap(functools.partial(_freed, traveller, airspace, choices.starts))(timed, (costs, numbers))
        found = jax.tree.map(lambda a, b: jnp.concatenate([a, b], axis=1), found, free)
    flat = jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), found)
    if choices.most is not None and choices.most < choices.size:
        best = jnp.argsort(jnp.where(flat.valid, flat.cost, jnp.inf))[: choices.most]
        flat = jax.tree.map(lambda leaf: leaf[best], flat)
    return flat, timed.table


def _candidate(timed: TimedProfile, solved: Solved, fits: Flag, cost: Scalar, which: Count) -> Candidate:
    valid = timed.good & solved.exists & fits & jnp.isfinite(timed.table.length)
    turned = jnp.sum(jnp.abs(solved.angles))
    return Candidate(timed.table.profile, timed.ends, solved, valid, turned + cost, timed.speed, which)


def _detoured(
    traveller: Traveller,
    choices: Choices,
    timed: TimedProfile,
    about: tuple[Scalar, Count],
    word: Count,
    shape: Count,
    side: Count,
) -> Candidate:
    """The direct path of a rank by length, or the detour from it that takes the time."""
    base = jax.tree.map(lambda leaf: leaf[word], timed.direct)
    wanted = timed.table.length
    bend = jnp.minimum(shape, SHAPES - 1)
    way = Detour(
        side * jnp.asarray(HEADINGS)[bend],
        jnp.asarray(FIRST)[bend],
        jnp.asarray(SECOND)[bend],
        jnp.asarray(FIXED)[bend],
        jnp.asarray(ANGLE_MAX)[bend],
    )
    solved = solve_detour(timed.ends, base, way, wanted)
    if RACETRACK in choices.shapes:
        held = solve_racetrack(timed.ends, base, side.astype(float), wanted)
        solved = jax.tree.map(lambda a, b: jnp.where(shape == RACETRACK, a, b), held, solved)
    fits = (traveller.side == 0) | (traveller.side * side > 0)
    cost, which = about
    return _candidate(timed, solved, fits, cost + jnp.where(shape == RACETRACK, 2.0, 0.0) + 0.01 * shape, which)


def _freed(
    traveller: Traveller, airspace: Airspace, starts: int, timed: TimedProfile, about: tuple[Scalar, Count]
) -> Candidate:
    """Free shapes that take the time; they bend to any side, so only where either will do."""
    pace = make_pace(timed.table, timed.ends, traveller.limits, airspace.gravity)
    closed = make_closed(timed.table, airspace.keep_outs)

    task = Task(timed.ends, pace, closed, timed.table.length)
    solved = solve_freely(task, make_starts(starts), int(_GOING_ON * starts))
    cost, which = about
    return jax.vmap(lambda one: _candidate(timed, one, traveller.side == 0, cost + _FREE, which))(solved)


_GOING_ON = 0.4  # part of the starts
_FREE = 3.0  # cost of a path without a shape that one would expect
