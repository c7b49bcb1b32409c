"""Direct paths against Dubins' and detours of a wanted length: they end where they should, as long as they should."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.compiling.options import compiled_quickly
from anser.planning.certified.detours import DETOUR_KINDS, WORDS, direct, solve_detour, solve_racetrack
from anser.planning.certified.routes import TurnsAndLegs, route
from support.certified_cases import detours_of, dubins_of, number, picked, random_ends

CASES = 48
SHAPE, SIDE = (x.ravel() for x in np.meshgrid(np.arange(DETOUR_KINDS), [1.0, -1.0], indexing="ij"))
WAYS = detours_of(SHAPE, SIDE)
SAME = 1e-6  # to which a direct path meets its end and a detour its length, as parts of the length


def all_words(ends):
    """The four direct paths and where they lead."""

    def one(word):
        found = direct(ends, word)
        zero = jnp.zeros(())
        angles = jnp.stack([found.angles[0], zero, zero, found.angles[1]])
        return found, route(
            ends, TurnsAndLegs(angles, jnp.ones(4), jnp.stack([found.straight, zero, zero]), found.exists)
        )

    return jax.vmap(one)(jnp.asarray(WORDS))


def detoured(ends, base, factor):
    """All detours and both racetracks of a length that is the base's times a factor."""

    def one(way):
        solved = solve_detour(ends, base, way, factor * base.length)
        return solved, route(ends, solved)

    def lap(side):
        solved = solve_racetrack(ends, base, side, factor * base.length)
        return solved, route(ends, solved)

    return jax.vmap(one)(WAYS), jax.vmap(lap)(jnp.array([1.0, -1.0]))


words = compiled_quickly(jax.vmap(all_words))
bends = compiled_quickly(jax.vmap(detoured))


def shortest(found):
    return jax.vmap(lambda one: jax.tree.map(lambda leaf: leaf[jnp.argmin(one.length)], one))(found)


def lead_to(shapes, ends, exists, headings=True):
    """Whether those that exist end where they should; the leading axis is that of the ends."""
    exists = np.asarray(exists)
    line = np.asarray(shapes.positions)[..., -1] - np.asarray(ends.end)[:, None]
    room = SAME * np.asarray(shapes.length) + 1e-6
    assert np.all(np.abs(line)[exists] <= room[exists])
    if headings:
        off = np.exp(1j * (np.asarray(shapes.headings)[..., -1] - np.asarray(ends.end_heading)[:, None])) - 1.0
        assert np.max(np.abs(off)[exists]) < 1e-9  # rounding of a few turns


@pytest.fixture(scope="module")
def far():
    """Ends far enough apart for every word, up to a curved start."""
    ends = random_ends(1, CASES, 8.0, 25.0)
    return (ends, *words(ends))


def test_direct_paths_lead_to_the_end(far):
    ends, found, shapes = far
    assert np.all(np.asarray(found.exists))
    lead_to(shapes, ends, found.exists)
    np.testing.assert_allclose(shapes.length, found.length, rtol=1e-12)  # rounding
    # Turns by their senses, less than once round; a small one may be the other way, by a step of the search.
    turned = np.asarray(found.angles) * WORDS[None]
    step = 2 * np.pi / 64
    assert np.all((turned >= -step) & (turned <= 2 * np.pi + step))
    assert np.all(np.asarray(found.straight) >= 0.0)


@pytest.mark.parametrize(("seed", "sharp"), [(2, 0.5), (3, 4.0)])
def test_direct_paths_are_never_shorter_than_dubins(seed, sharp):
    # Near ends too, where Dubins' shortest may have three turns.
    ends = random_ends(seed, CASES, 0.1, 8.0, sharp=sharp)
    found, shapes = words(ends)
    exists = np.asarray(found.exists)
    assert np.mean(np.any(exists, axis=1)) > 0.8  # or there is little to see
    lead_to(shapes, ends, exists)
    least = np.min(np.where(exists, np.asarray(found.length), np.inf), axis=1)
    # An end missed by a millionth shortens the way to it by as much.
    assert np.all(least >= dubins_of(ends) * (1 - 3 * SAME) - 1e-5)


def test_direct_paths_tend_to_dubins_as_ramps_shrink():
    # Ramps of a 10th and a 100th of a radius, from a straight start.
    excess = []
    for sharp in (10.0, 100.0):
        ends = random_ends(4, CASES, 5.0, 25.0, curvature_use=0.0, sharp=sharp)
        found, _ = words(ends)
        shorter = dubins_of(ends, three_turns=False)
        over = np.min(np.asarray(found.length), axis=1) - shorter
        assert np.all(over >= -3 * SAME * shorter)
        # A turn of ramps L begins and ends L/2 from where its circle would touch the straight lines; the first and the
        # last of these are not flown by Dubins. Each displaces an end by L/2, and costs no more than twice that.
        ramp = np.asarray(1 / ends.curvature_max) / sharp
        assert np.all(over <= 2.1 * ramp + 3 * SAME * shorter)
        excess.append(np.median(over * np.asarray(ends.curvature_max)))
    assert 9.0 < excess[0] / excess[1] < 11.0  # first order: 10, but for the next


@pytest.mark.parametrize("free", [True, False])
@pytest.mark.parametrize("off", [0.0, 1e-12, -1e-9, 1e-6])
def test_straight_on_is_a_direct_path(free, off):
    # No turn at all, and next to none: where the senses of the turns wrap round.
    ends = random_ends(8, CASES, 5.0, 25.0, curvature_use=0.0)
    line = jnp.angle(ends.end - ends.start)
    ends = eqx.tree_at(
        lambda e: (e.heading, e.end_heading, e.end_free), ends, (line + off, line - off, jnp.full(CASES, free))
    )
    base = shortest(words(ends)[0])
    assert np.all(base.exists)
    # A correction of 1e-6 rad has ramps of sqrt(1e-6 / sharpness): straight to a part in 1e-6.
    np.testing.assert_allclose(base.length, np.abs(ends.end - ends.start), rtol=3 * SAME)


def test_free_ends_have_one_turn_and_are_met():
    ends = random_ends(7, CASES, 4.0, 20.0, free=True)
    found, shapes = words(ends)
    exists = np.asarray(found.exists)
    lead_to(shapes, ends, exists, headings=False)
    assert np.all(np.any(exists, axis=1))
    np.testing.assert_array_equal(np.asarray(found.angles)[..., 1], 0.0)
    fixed = eqx.tree_at(lambda e: (e.end_free, e.end_heading), ends, (~ends.end_free, shortest(found).heading))
    # With the course it arrived on prescribed, it is the same path.
    np.testing.assert_allclose(shortest(words(fixed)[0]).length, shortest(found).length, rtol=3 * SAME, atol=1e-5)


@pytest.mark.parametrize(("seed", "near", "most"), [(11, 8.0, 1.5), (12, 3.0, 3.0)])
def test_detours_have_the_wanted_length_and_end(seed, near, most):
    ends = random_ends(seed, CASES, near, 3 * near)
    base = shortest(words(ends)[0])
    factor = np.random.default_rng(seed).uniform(1.005, most, CASES)
    (solved, shapes), _ = bends(ends, base, jnp.asarray(factor))
    exists = np.asarray(solved.exists)
    shares = np.mean(exists, axis=0)
    # Every shape to either side can be had often enough to be tested.
    assert np.all(shares > 0.15), shares
    lead_to(shapes, ends, exists)
    wanted = np.broadcast_to((factor * np.asarray(base.length))[:, None], exists.shape)
    np.testing.assert_allclose(np.asarray(shapes.length)[exists], wanted[exists], rtol=1.001 * SAME)
    assert np.all(np.asarray(solved.legs) >= 0.0)
    # Dubins' bound holds for whatever joins the ends.
    assert np.all(np.asarray(shapes.length)[exists] >= np.tile(dubins_of(ends), (10, 1)).T[exists] * (1 - 3 * SAME))
    # To its side: seen from the direct path's heading, the first leg goes right or left.
    away = np.asarray(solved.angles)[..., 0] - np.asarray(base.angles)[:, None, 0]
    assert np.all((np.sign(away) == SIDE)[exists & (np.abs(away) > 1e-12)])


def test_a_detour_as_long_as_the_direct_path_is_the_direct_path(far):
    ends, found, _ = far
    base = shortest(found)
    (solved, shapes), _ = bends(ends, base, jnp.ones(CASES))
    assert np.all(np.asarray(solved.exists))
    lead_to(shapes, ends, solved.exists)
    np.testing.assert_array_equal(
        solved.legs, np.tile(np.stack([base.straight, 0 * base.straight, 0 * base.straight], -1)[:, None], (1, 10, 1))
    )


def test_no_detour_is_shorter_than_the_direct_path_and_none_is_endless(far):
    ends, found, _ = far
    base = shortest(found)
    for factor in (0.9, 1e4):
        (solved, shapes), _ = bends(ends, base, jnp.full(CASES, factor))
        assert not np.any(np.asarray(solved.exists))
        # What does not exist is a number all the same.
        assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves((solved, shapes)))


def test_detours_with_a_free_end_meet_it():
    ends = random_ends(13, CASES, 6.0, 20.0, free=True)
    base = shortest(words(ends)[0])
    (solved, shapes), _ = bends(ends, base, jnp.full(CASES, 1.2))
    exists = np.asarray(solved.exists)
    assert np.mean(exists) > 0.5
    lead_to(shapes, ends, exists, headings=False)
    np.testing.assert_allclose(
        np.asarray(shapes.length)[exists],
        np.tile(1.2 * np.asarray(base.length)[:, None], (1, 10))[exists],
        rtol=1.001 * SAME,
    )


def test_racetracks_have_any_length_from_a_lap_on(far):
    ends, found, _ = far
    base = shortest(found)
    # A lap of two smooth half turns: pi + 1/4 radii each with ramps of a quarter.
    lap = 2 * (np.pi + 0.25) / np.asarray(ends.curvature_max)
    for more, there in ((0.999 * lap, False), (1.001 * lap, True), (3.3 * lap, True), (40.0 * lap, True)):
        factor = 1.0 + more / np.asarray(base.length)
        _, (solved, shapes) = bends(ends, base, jnp.asarray(factor))
        assert np.all(np.asarray(solved.exists) == there)
        if not there:
            continue
        lead_to(shapes, ends, solved.exists)
        wanted = np.tile((factor * np.asarray(base.length))[:, None], (1, 2))
        np.testing.assert_allclose(shapes.length, wanted, rtol=1e-12)  # rounding
        # Legs short, as many laps as that takes; first to its side.
        legs = np.asarray(solved.legs)[..., 0]
        assert np.all((legs >= 0.0) & (legs <= 4000.0 + 0.5 * 2 * np.pi / np.asarray(ends.curvature_max)[:, None]))
        assert np.all(np.sign(np.asarray(solved.angles)[..., 0]) == [1.0, -1.0])


def test_one_by_one_as_a_batch(far):
    ends, found, _ = far
    single = compiled_quickly(all_words)
    for k in range(3):
        alone, shape = single(picked(ends, k))
        np.testing.assert_allclose(alone.length, found.length[k], rtol=1e-12)  # rounding
        np.testing.assert_allclose(shape.length, found.length[k], rtol=1e-12)


def test_derivatives_by_the_wanted_length_are_implicit_and_finite(far):
    ends, found, _ = far
    base, way = picked(shortest(found), 5), picked(WAYS, 0)
    here = picked(ends, 5)

    @compiled_quickly
    def angles(wanted):
        solved = solve_detour(here, base, way, wanted)
        return jnp.concatenate([solved.angles, solved.legs / 1e4])

    wanted, h = 1.2 * base.length, 1.0
    slopes = jax.jit(jax.jacfwd(angles))(number(wanted))
    differences = (angles(wanted + h) - angles(wanted - h)) / (2 * h)
    # Centred differences over 2 m of 1e4: 1e-8; the root is known to 1e-6 of the length at worst, to rounding as a rule.
    np.testing.assert_allclose(slopes, differences, rtol=1e-5, atol=1e-10)
    assert np.max(np.abs(slopes)) > 1e-6


def test_direct_length_has_finite_derivatives_that_are_its_rates(far):
    ends = picked(far[0], 3)

    def length(heading):
        return direct(eqx.tree_at(lambda e: e.heading, ends, heading), jnp.asarray(WORDS[0])).length

    values = compiled_quickly(length)
    slope = jax.jit(jax.grad(length))(ends.heading)
    difference = (values(ends.heading + 1e-4) - values(ends.heading - 1e-4)) / 2e-4
    # Of some 1000 m/rad: (1e-4)^2 of the third derivative, 1e-6 of a length of 1e4 m only if the root were that bad.
    np.testing.assert_allclose(slope, difference, rtol=1e-5)
