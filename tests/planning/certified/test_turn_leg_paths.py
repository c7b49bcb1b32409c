"""Paths without a prescribed shape: that they are what was asked, and that they find what detours cannot be."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.compiling.options import compiled_quickly
from anser.planning import PathLimits
from anser.planning.certified import turn_leg_paths
from anser.planning.certified.detours import DETOUR_KINDS, WORDS, direct, solve_detour
from anser.planning.certified.profile import make_profile, tabulate
from anser.planning.certified.routes import route
from anser.planning.certified.task import KeepOuts
from anser.planning.certified.turn_leg_paths import (
    KeepOutsAlongPath,
    RadiusSchedule,
    TurnLegProblem,
    keep_outs_along_path,
    make_radius_schedule,
    make_starts,
    solve_turn_leg_paths,
)
from support.certified_cases import GRAVITY, STEADY, detours_of, dubins, integrated, number, picked, random_ends

CASES = 16
_SCHEDULE_ERROR = 0.02  # what the reserve of the curvature takes up
STARTS = 64
# Ramps of a two-hundredth of the radius: paths are Dubins' but for that.
ENDS = random_ends(8, CASES, 0.3, 5.0, curvature_use=0.0, sharp=200.0)
BENT = random_ends(9, CASES, 3.0, 15.0, curvature_use=1.0)
FREE = eqx.tree_at(lambda e: e.end_free, BENT, jnp.full(CASES, True))
BEGUN = make_starts(STARTS)
EVEN = RadiusSchedule(number(1e7), jnp.ones(2))
# As an aircraft that becomes slower within 4 km, so that it then turns within two thirds of the radius.
SLOWING = RadiusSchedule(number(1000.0), jnp.array([1.0, 1.0, 0.89, 0.78, 0.67, 0.67]))
# As one that becomes faster all the time: a turn's radius is that of its end.
QUICKENING = RadiusSchedule(number(4000.0), jnp.array([1.0, 1.15, 1.3, 1.5, 1.7, 1.9]))
NOTHING = KeepOutsAlongPath(number(1e7), *(jnp.zeros((0, 2)),) * 2, jnp.zeros(0), jnp.zeros((0, 2)))


def around(middle, wide):
    """One keep-out that stands and is at the altitude of the path all the time."""
    north, east = (part(middle) * jnp.ones((1, 2)) for part in (jnp.real, jnp.imag))
    return KeepOutsAlongPath(number(1e7), north, east, wide[None], jnp.ones((1, 2)))


def all_of(ends, schedule, wanted, keep_outs=NOTHING):
    solved = solve_turn_leg_paths(TurnLegProblem(ends, schedule, keep_outs, wanted), BEGUN)
    return solved, jax.vmap(lambda one: route(ends, one))(solved)


solve = compiled_quickly(jax.vmap(all_of, in_axes=(0, None, 0)))


def shortest(ends):
    gap = np.asarray(ends.end - ends.start)
    return np.array(
        [
            dubins(
                float(ends.heading[k]), complex(gap[k]), float(ends.end_heading[k]), 1 / float(ends.curvature_max[k])
            )
            for k in range(CASES)
        ]
    )


def pieces_of(shape):
    bends = np.asarray(shape.curvatures)
    return list(zip(np.diff(np.asarray(shape.marks)), bends[:-1], bends[1:], strict=True))


@pytest.mark.long
@pytest.mark.parametrize(
    ("ends", "schedule", "factor"),
    [(ENDS, EVEN, 1.6), (BENT, EVEN, 1.3), (BENT, SLOWING, 1.3), (FREE, SLOWING, 1.2), (BENT, QUICKENING, 1.5)],
    ids=["near", "bent", "slowing", "free end", "quickening"],
)
def test_what_is_found_is_what_was_asked(ends, schedule, factor):
    wanted = factor * shortest(ends)
    solved, shapes = solve(ends, schedule, jnp.asarray(wanted))
    exists = np.asarray(solved.exists)
    assert np.mean(np.any(exists, axis=1)) > 0.85
    for k, n in np.argwhere(exists)[::7]:
        shape = picked(picked(shapes, k), n)
        # Along its curvature, by quadrature, from the start: to the end, with the heading and the length asked for.
        pieces = pieces_of(shape)
        places, headings = integrated(ends.start[k], ends.heading[k], pieces)
        length = sum(piece[0] for piece in pieces)
        room = 2e-10 * wanted[k]  # twice what counts as solved
        np.testing.assert_allclose(length, wanted[k], atol=room)
        np.testing.assert_allclose(places[-1], complex(ends.end[k]), atol=room + 1e-6)
        if not bool(ends.end_free[k]):
            turned = (headings[-1] - float(ends.end_heading[k])) / (2 * np.pi)
            np.testing.assert_allclose(turned, np.round(turned), atol=1e-9)
        assert np.all(np.asarray(solved.legs)[k, n] >= 0.0)
        # No turn tighter than the schedule allows at its beginning and at its end.
        scales = np.asarray(solved.scales)[k, n]
        marks = np.asarray(shape.marks)[1 + 4 * np.arange(4)]
        known = float(schedule.step) * np.arange(schedule.scales.size)
        least = np.interp(marks, known, schedule.scales)
        ended = np.interp(np.asarray(shape.marks)[4 + 4 * np.arange(4)], known, schedule.scales)
        assert np.all(scales >= np.maximum(least, (1.0 - _SCHEDULE_ERROR) * ended) - 1e-12)
        peaks = np.abs(np.asarray(shape.curvatures)[2 + 4 * np.arange(4)])
        assert np.all(peaks <= float(ends.curvature_max[k]) / scales * (1 + 1e-12))


@pytest.mark.long
def test_nothing_is_found_below_the_shortest_path():
    solved, _ = solve(ENDS, EVEN, jnp.asarray(0.995 * shortest(ENDS)))
    assert not np.any(solved.exists)


@pytest.mark.long
def test_three_turns_in_a_row_are_found_where_no_detour_will_do():
    # Back to where it came from: Dubins' shortest path is three turns, 7 pi / 3 radii long; turning once and coming
    # back needs more than that, and a detour is longer still.
    here = picked(ENDS, 0)
    radius = 1.0 / float(here.curvature_max)
    back = eqx.tree_at(lambda e: (e.end, e.end_heading), here, (here.start, here.heading + jnp.pi))
    wanted = 7.05 / 3 * np.pi * radius
    solved, _ = compiled_quickly(all_of)(back, EVEN, number(wanted))
    assert np.any(solved.exists)
    tight, _ = compiled_quickly(all_of)(back, EVEN, number(6.95 / 3 * np.pi * radius))
    assert not np.any(tight.exists)

    def bent(word, way):
        return solve_detour(back, direct(back, word), way, wanted).exists

    ways = detours_of(range(DETOUR_KINDS), np.ones(DETOUR_KINDS))
    both = jax.tree.map(
        lambda a, b: jnp.concatenate([a, b]), ways, detours_of(range(DETOUR_KINDS), -np.ones(DETOUR_KINDS))
    )
    each = jax.vmap(jax.vmap(bent, in_axes=(None, 0)), in_axes=(0, None))
    assert not np.any(compiled_quickly(each)(jnp.asarray(WORDS), both))


@pytest.mark.long
def test_closed_volumes_are_gone_around():
    # One volume amid the straight line from start to end, and twelve radii of it: half the turn-and-leg paths would enter it.
    few = picked(FREE, slice(6))
    middle = 0.5 * (few.start + few.end)
    wide = 0.3 * np.abs(np.asarray(few.end - few.start))
    wanted = jnp.asarray(1.3 * shortest(FREE)[:6])

    def both(ends, middle, wide, wanted):
        return all_of(ends, EVEN, wanted, around(middle, wide)), all_of(ends, EVEN, wanted)

    (kept, kept_shapes), (free, free_shapes) = compiled_quickly(jax.vmap(both))(few, middle, jnp.asarray(wide), wanted)

    @compiled_quickly
    def places(shape):
        return jax.vmap(lambda s: shape.at(s)[0])(shape.length * jnp.linspace(0.0, 1.0, 200))

    def deepest(shapes, some):
        flown = [(k, np.asarray(places(picked(picked(shapes, k), n)))) for k, n in some]
        return [np.max(1.0 - np.abs(way - complex(middle[k])) / wide[k]) for k, way in flown]

    def entering(solved, shapes):
        some = np.argwhere(np.asarray(solved.exists))[::9]
        return np.mean([depth > 0.02 for depth in deepest(shapes, some)])

    # Looked at in some places only, some are still entered, by a little; without a look at them most are.
    assert entering(free, free_shapes) > 0.4
    assert entering(kept, kept_shapes) < 0.5 * entering(free, free_shapes)
    assert np.mean(np.any(np.asarray(kept.exists), axis=1)) > 0.8


def entered_by(keep_outs, length, place):
    spot = jnp.array([place.real, place.imag, float(length)])
    return np.asarray(keep_outs.penetration(spot)[0])


@pytest.mark.long
@pytest.mark.parametrize("ends", [BENT, FREE], ids=["bent", "free end"])
def test_derivatives_are_those_of_what_is_missed(ends):
    # Composed by hand: against automatic ones, with a volume that the path may be in and one that moves.
    where = 0.4 * np.abs(np.asarray(ends.end - ends.start))
    for k, n in ((0, 3), (5, 11), (9, 30)):
        one = picked(ends, k)
        standing = around(0.5 * (one.start + one.end), jnp.asarray(where[k]))
        moving = KeepOutsAlongPath(
            number(2000.0), *(jnp.stack([x[0, :1] + 200.0 * jnp.arange(60.0)]) for x in (standing.norths, standing.easts)),
            standing.radii, jnp.ones((1, 60)),
        )  # fmt: skip
        for keep_outs in (NOTHING, standing, moving):
            problem = TurnLegProblem(one, SLOWING, keep_outs, number(1.4 * where[k] / 0.4))
            senses, first, _ = (jnp.asarray(leaf[n]) for leaf in BEGUN)
            for circles in (jnp.zeros(4), jnp.array([0.0, 4.0 * jnp.pi, 0.0, 0.0])):
                missed = functools.partial(
                    turn_leg_paths._path_and_residuals, problem=problem, senses=senses, circles=circles
                )
                by_hand, automatic = missed(first)[2], jax.jacfwd(lambda x, of=missed: of(x)[1])(first)
                np.testing.assert_allclose(by_hand, automatic, rtol=1e-9, atol=1e-12)


@pytest.mark.long
def test_only_the_nearest_go_on():
    one = picked(BENT, 2)
    problem = TurnLegProblem(one, EVEN, NOTHING, number(1.4 * shortest(BENT)[2]))
    fewer = compiled_quickly(lambda: solve_turn_leg_paths(problem, BEGUN, 20))()
    every = compiled_quickly(lambda: solve_turn_leg_paths(problem, BEGUN))()
    assert fewer.exists.shape == (20,)
    assert np.mean(fewer.exists) > 1.3 * np.mean(every.exists)
    kept = np.asarray(every.angles)
    # What they find is what they find among all.
    assert all(np.any(np.all(np.abs(kept - own) < 1e-6, axis=1)) for own in np.asarray(fewer.angles)[fewer.exists])


@pytest.mark.long
def test_closed_volumes_are_where_and_when_the_path_meets_them():
    profile = make_profile(100.0, (900.0, 1500.0), (0.0, 0.0), 0.0, 0.0, (150.0, 150.0, 150.0), 0.0)
    table = tabulate(profile, STEADY, 64)
    volumes = KeepOuts(
        jnp.array([[2000.0, -500.0], [0.0, 0.0]]),
        jnp.array([[8.0, -3.0], [0.0, 0.0]]),
        jnp.array([700.0, 300.0]),
        jnp.array([0.0, 1200.0]),
        jnp.array([5000.0, 3000.0]),
    )
    keep_outs = keep_outs_along_path(table, volumes)
    half = table.flown_at(50.0)[0]
    wind = np.asarray(STEADY.velocity_n)
    # Its centre after 50 s, from the air's point of view; 100 m inside its edge, the reserve of 30 m not counted.
    centre = complex(2000.0 + 50.0 * (8.0 - wind[0]), -500.0 + 50.0 * (-3.0 - wind[1]))
    entered = entered_by(keep_outs, half, centre + 600.0)
    np.testing.assert_allclose(entered[0], 130.0 / 730.0, rtol=1e-4)
    # The other begins at 1,200 m, which is reached after 50 s: not before.
    at = -50.0 * complex(wind[0], wind[1])
    early = entered_by(keep_outs, table.flown_at(20.0)[0], 0.4 * at)
    late = entered_by(keep_outs, table.flown_at(80.0)[0], 1.6 * at)
    assert float(early[1]) == 0.0
    np.testing.assert_allclose(float(late[1]), 1.0, atol=0.01)


def test_starts_are_the_same_every_time_and_all_senses_are_among_them():
    for again, before in zip(make_starts(STARTS), BEGUN, strict=True):
        np.testing.assert_array_equal(again, before)
    assert len({tuple(row) for row in BEGUN.senses}) == 16


@pytest.mark.long
def test_long_waits_are_circles_wherever_there_is_room():
    """Ten times as long as need be: four turns of at most 7.5 rad alone would be legs of many kilometres."""
    one = picked(BENT, 2)
    wanted = number(10.0 * shortest(BENT)[2])
    solved, routes = all_of(one, EVEN, wanted)
    turned = np.abs(np.asarray(solved.angles))
    found = np.asarray(solved.exists)
    circling = found & (turned.max(axis=1) > 9.0)
    assert np.sum(circling) >= 5
    assert len({int(k) for k in np.argmax(turned[circling], axis=1)}) == 4
    np.testing.assert_allclose(np.asarray(routes.length)[found], float(wanted), rtol=1e-9)
    np.testing.assert_allclose(np.asarray(routes.positions)[found, -1], np.asarray(one.end), atol=1e-5 * float(wanted))


def test_pace_is_that_of_a_level_turn_and_of_what_climb_and_push_leave():
    limits = PathLimits(*(number(x) for x in (90.0, 240.0, np.radians(60.0), 80.0, 0.0, 9000.0, 5.0, 2.0, 2.0)))
    level = tabulate(make_profile(200.0, (900.0, 900.0), (0.0, 0.0), 0.0, 0.0, (150.0, 130.0, 140.0), 0.0), STEADY, 128)
    here = eqx.tree_at(lambda e: e.curvature_max, picked(ENDS, 0), number(1.0 / 2000.0))
    schedule = make_radius_schedule(level, here, limits, GRAVITY)
    # In steady level flight the radius is V^2 / (g tan(bank)), and 2 % more for the certificate.
    for place, speed in ((0, 150.0), (64, 130.0), (128, 140.0)):
        radius = speed**2 / (GRAVITY * np.tan(np.radians(60.0))) / 0.98
        np.testing.assert_allclose(float(schedule.scales[place]) * 2000.0, radius, rtol=1e-3)  # V_dot is not quite zero
    # The greatest within the turn counts.
    np.testing.assert_allclose(schedule.least_radius(0.0, 1e4), schedule.scales[0], rtol=1e-12)
    last = float(level.length)
    np.testing.assert_allclose(schedule.least_radius(last - 100.0, 100.0), schedule.scales[-1], rtol=1e-12)
    # Climbing at a tenth of the speed leaves less lift, pulling up more of it.
    climbing = tabulate(
        make_profile(200.0, (900.0, 3500.0), (0.0, 0.0), 0.0, 0.0, (150.0, 150.0, 150.0), 0.0), STEADY, 128
    )
    steep = make_radius_schedule(climbing, here, limits, GRAVITY)
    now = climbing.profile.at(100.0)
    expected = 150.0**2 / (0.98 * GRAVITY * np.sqrt(1 - (float(now.climb) / 150.0) ** 2) * np.tan(np.radians(60.0)))
    np.testing.assert_allclose(float(steep.scales[64]) * 2000.0, expected, rtol=1e-6)
