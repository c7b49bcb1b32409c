"""Direct paths compared with Dubins' paths, and detours of a target length: correct end point and length."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.compiling.options import compiled_quickly
from anser.planning.certified.detours import DETOUR_KINDS, WORDS, direct_path, solve_detour, solve_racetrack
from anser.planning.certified.routes import TurnsAndLegs, route
from support.certified_cases import detours_of, dubins_of, number, picked, random_ends

CASES = 48
SHAPE, SIDE = (x.ravel() for x in np.meshgrid(np.arange(DETOUR_KINDS), [1.0, -1.0], indexing="ij"))
DETOURS = detours_of(SHAPE, SIDE)
TOLERANCE = 1e-6  # to which a direct path meets its end and a detour its length, as parts of the length


def all_words(endpoints):
    """The four direct paths and their routes."""

    def solve_word(word):
        solution = direct_path(endpoints, word)
        zero = jnp.zeros(())
        angles = jnp.stack([solution.angles[0], zero, zero, solution.angles[1]])
        return solution, route(
            endpoints, TurnsAndLegs(angles, jnp.ones(4), jnp.stack([solution.straight, zero, zero]), solution.exists)
        )

    return jax.vmap(solve_word)(jnp.asarray(WORDS))


def detoured(endpoints, base, factor):
    """Every detour and both racetracks with the base's length times a factor."""

    def solve_shape(shape):
        solved = solve_detour(endpoints, base, shape, factor * base.length)
        return solved, route(endpoints, solved)

    def lap(side):
        solved = solve_racetrack(endpoints, base, side, factor * base.length)
        return solved, route(endpoints, solved)

    return jax.vmap(solve_shape)(DETOURS), jax.vmap(lap)(jnp.array([1.0, -1.0]))


solve_directs = compiled_quickly(jax.vmap(all_words))
solve_detours = compiled_quickly(jax.vmap(detoured))


def shortest(directs):
    return jax.vmap(lambda options: jax.tree.map(lambda leaf: leaf[jnp.argmin(options.length)], options))(directs)


def lead_to(shapes, endpoints, exists, headings=True):
    """Check that the valid routes end at the prescribed end; the leading axis is that of the endpoints."""
    exists = np.asarray(exists)
    end_error = np.asarray(shapes.positions)[..., -1] - np.asarray(endpoints.end)[:, None]
    tolerance = TOLERANCE * np.asarray(shapes.length) + 1e-6
    assert np.all(np.abs(end_error)[exists] <= tolerance[exists])
    if headings:
        heading_error = (
            np.exp(1j * (np.asarray(shapes.headings)[..., -1] - np.asarray(endpoints.end_heading)[:, None])) - 1.0
        )
        assert np.max(np.abs(heading_error)[exists]) < 1e-9  # rounding of a few turns


@pytest.fixture(scope="module")
def distant():
    """Endpoints distant enough apart for every word, with curved starts."""
    endpoints = random_ends(1, CASES, 8.0, 25.0)
    return (endpoints, *solve_directs(endpoints))


def test_direct_paths_lead_to_the_end(distant):
    endpoints, directs, shapes = distant
    assert np.all(np.asarray(directs.exists))
    lead_to(shapes, endpoints, directs.exists)
    np.testing.assert_allclose(shapes.length, directs.length, rtol=1e-12)  # rounding
    # Turns by their senses, less than once round; a small one may be the other way, by a step of the search.
    signed_turns = np.asarray(directs.angles) * WORDS[None]
    step = 2 * np.pi / 64
    assert np.all((signed_turns >= -step) & (signed_turns <= 2 * np.pi + step))
    assert np.all(np.asarray(directs.straight) >= 0.0)


@pytest.mark.parametrize(("seed", "sharp"), [(2, 0.5), (3, 4.0)])
def test_direct_paths_are_never_shorter_than_dubins(seed, sharp):
    # Near ends too, where Dubins' shortest may have three turns.
    endpoints = random_ends(seed, CASES, 0.1, 8.0, sharp=sharp)
    directs, shapes = solve_directs(endpoints)
    exists = np.asarray(directs.exists)
    assert np.mean(np.any(exists, axis=1)) > 0.8  # or there is little to see
    lead_to(shapes, endpoints, exists)
    shortest_lengths = np.min(np.where(exists, np.asarray(directs.length), np.inf), axis=1)
    # An end missed by a millionth shortens the way to it by as much.
    assert np.all(shortest_lengths >= dubins_of(endpoints) * (1 - 3 * TOLERANCE) - 1e-5)


def test_direct_paths_tend_to_dubins_as_ramps_shrink():
    # Ramps of a 10th and a 100th of a radius, from a straight start.
    excess = []
    for sharp in (10.0, 100.0):
        endpoints = random_ends(4, CASES, 5.0, 25.0, curvature_use=0.0, sharp=sharp)
        directs, _ = solve_directs(endpoints)
        shorter = dubins_of(endpoints, three_turns=False)
        over = np.min(np.asarray(directs.length), axis=1) - shorter
        assert np.all(over >= -3 * TOLERANCE * shorter)
        # A turn of ramps L begins and ends L/2 from where its circle would touch the straight lines; the first and the
        # last of these are not flown by Dubins. Each displaces an end by L/2, and costs no more than twice that.
        ramp = np.asarray(1 / endpoints.curvature_max) / sharp
        assert np.all(over <= 2.1 * ramp + 3 * TOLERANCE * shorter)
        excess.append(np.median(over * np.asarray(endpoints.curvature_max)))
    assert 9.0 < excess[0] / excess[1] < 11.0  # first order: 10, but for the next


@pytest.mark.parametrize("free_end", [True, False])
@pytest.mark.parametrize("heading_offset", [0.0, 1e-12, -1e-9, 1e-6])
def test_a_straight_line_is_a_direct_path(free_end, heading_offset):
    # No turn at all, and next to none: where the senses of the turns wrap round.
    endpoints = random_ends(8, CASES, 5.0, 25.0, curvature_use=0.0)
    line = jnp.angle(endpoints.end - endpoints.start)
    endpoints = eqx.tree_at(
        lambda e: (e.heading, e.end_heading, e.end_free),
        endpoints,
        (line + heading_offset, line - heading_offset, jnp.full(CASES, free_end)),
    )
    base = shortest(solve_directs(endpoints)[0])
    assert np.all(base.exists)
    # A correction of 1e-6 rad has ramps of sqrt(1e-6 / sharpness): straight to a part in 1e-6.
    np.testing.assert_allclose(base.length, np.abs(endpoints.end - endpoints.start), rtol=3 * TOLERANCE)


def test_free_ends_have_one_turn_and_are_met():
    endpoints = random_ends(7, CASES, 4.0, 20.0, free=True)
    directs, shapes = solve_directs(endpoints)
    exists = np.asarray(directs.exists)
    lead_to(shapes, endpoints, exists, headings=False)
    assert np.all(np.any(exists, axis=1))
    np.testing.assert_array_equal(np.asarray(directs.angles)[..., 1], 0.0)
    fixed = eqx.tree_at(
        lambda e: (e.end_free, e.end_heading), endpoints, (~endpoints.end_free, shortest(directs).heading)
    )
    # With the course it arrived on prescribed, it is the same path.
    np.testing.assert_allclose(
        shortest(solve_directs(fixed)[0]).length, shortest(directs).length, rtol=3 * TOLERANCE, atol=1e-5
    )


@pytest.mark.parametrize(("seed", "distance_min", "factor_max"), [(11, 8.0, 1.5), (12, 3.0, 3.0)])
def test_detours_have_the_target_length_and_end(seed, distance_min, factor_max):
    endpoints = random_ends(seed, CASES, distance_min, 3 * distance_min)
    base = shortest(solve_directs(endpoints)[0])
    factor = np.random.default_rng(seed).uniform(1.005, factor_max, CASES)
    (solved, shapes), _ = solve_detours(endpoints, base, jnp.asarray(factor))
    exists = np.asarray(solved.exists)
    shares = np.mean(exists, axis=0)
    # Every shape to either side can be had often enough to be tested.
    assert np.all(shares > 0.15), shares
    lead_to(shapes, endpoints, exists)
    target_lengths = np.broadcast_to((factor * np.asarray(base.length))[:, None], exists.shape)
    np.testing.assert_allclose(np.asarray(shapes.length)[exists], target_lengths[exists], rtol=1.001 * TOLERANCE)
    assert np.all(np.asarray(solved.legs) >= 0.0)
    # Dubins' bound holds for whatever joins the ends.
    assert np.all(
        np.asarray(shapes.length)[exists] >= np.tile(dubins_of(endpoints), (10, 1)).T[exists] * (1 - 3 * TOLERANCE)
    )
    # To its side: seen from the direct path's heading, the first leg goes right or left.
    first_turns = np.asarray(solved.angles)[..., 0] - np.asarray(base.angles)[:, None, 0]
    assert np.all((np.sign(first_turns) == SIDE)[exists & (np.abs(first_turns) > 1e-12)])


def test_a_detour_as_long_as_the_direct_path_is_the_direct_path(distant):
    endpoints, directs, _ = distant
    base = shortest(directs)
    (solved, shapes), _ = solve_detours(endpoints, base, jnp.ones(CASES))
    assert np.all(np.asarray(solved.exists))
    lead_to(shapes, endpoints, solved.exists)
    np.testing.assert_array_equal(
        solved.legs, np.tile(np.stack([base.straight, 0 * base.straight, 0 * base.straight], -1)[:, None], (1, 10, 1))
    )


def test_no_detour_is_shorter_than_the_direct_path_and_none_is_endless(distant):
    endpoints, directs, _ = distant
    base = shortest(directs)
    for factor in (0.9, 1e4):
        (solved, shapes), _ = solve_detours(endpoints, base, jnp.full(CASES, factor, dtype=float))
        assert not np.any(np.asarray(solved.exists))
        # What does not exist is a number all the same.
        assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves((solved, shapes)))


def test_detours_with_a_free_end_meet_it():
    endpoints = random_ends(13, CASES, 6.0, 20.0, free=True)
    base = shortest(solve_directs(endpoints)[0])
    (solved, shapes), _ = solve_detours(endpoints, base, jnp.full(CASES, 1.2, dtype=float))
    exists = np.asarray(solved.exists)
    assert np.mean(exists) > 0.5
    lead_to(shapes, endpoints, exists, headings=False)
    np.testing.assert_allclose(
        np.asarray(shapes.length)[exists],
        np.tile(1.2 * np.asarray(base.length)[:, None], (1, 10))[exists],
        rtol=1.001 * TOLERANCE,
    )


def test_racetracks_have_any_length_from_a_lap_on(distant):
    endpoints, directs, _ = distant
    base = shortest(directs)
    # A lap of two smooth half turns: pi + 1/4 radii each with ramps of a quarter.
    lap = 2 * (np.pi + 0.25) / np.asarray(endpoints.curvature_max)
    for extra_length, expected in ((0.999 * lap, False), (1.001 * lap, True), (3.3 * lap, True), (40.0 * lap, True)):
        factor = 1.0 + extra_length / np.asarray(base.length)
        _, (solved, shapes) = solve_detours(endpoints, base, jnp.asarray(factor))
        assert np.all(np.asarray(solved.exists) == expected)
        if not expected:
            continue
        lead_to(shapes, endpoints, solved.exists)
        target_lengths = np.tile((factor * np.asarray(base.length))[:, None], (1, 2))
        np.testing.assert_allclose(shapes.length, target_lengths, rtol=1e-12)  # rounding
        # Legs short, as many laps as that takes; first to its side.
        legs = np.asarray(solved.legs)[..., 0]
        assert np.all((legs >= 0.0) & (legs <= 4000.0 + 0.5 * 2 * np.pi / np.asarray(endpoints.curvature_max)[:, None]))
        assert np.all(np.sign(np.asarray(solved.angles)[..., 0]) == [1.0, -1.0])


@pytest.mark.long
def test_batches_equal_single_solutions(distant):
    endpoints, directs, _ = distant
    single = compiled_quickly(all_words)
    for k in range(3):
        alone, shape = single(picked(endpoints, k))
        np.testing.assert_allclose(alone.length, directs.length[k], rtol=1e-12)  # rounding
        np.testing.assert_allclose(shape.length, directs.length[k], rtol=1e-12)


@pytest.mark.long
def test_derivatives_by_the_target_length_are_implicit_and_finite(distant):
    endpoints, directs, _ = distant
    base, shape = picked(shortest(directs), 5), picked(DETOURS, 0)
    endpoints_5 = picked(endpoints, 5)

    @compiled_quickly
    def angles(target_length):
        solved = solve_detour(endpoints_5, base, shape, target_length)
        return jnp.concatenate([solved.angles, solved.legs / 1e4])

    target_length, h = 1.2 * base.length, 1.0
    slopes = jax.jit(jax.jacfwd(angles))(number(target_length))
    differences = (angles(target_length + h) - angles(target_length - h)) / (2 * h)
    # Centred differences over 2 m of 1e4: 1e-8; the root is known to 1e-6 of the length at worst, to rounding as a rule.
    np.testing.assert_allclose(slopes, differences, rtol=1e-5, atol=1e-10)
    assert np.max(np.abs(slopes)) > 1e-6


@pytest.mark.long
def test_direct_length_has_finite_derivatives_that_are_its_rates(distant):
    endpoints = picked(distant[0], 3)

    def length(heading):
        return direct_path(eqx.tree_at(lambda e: e.heading, endpoints, heading), jnp.asarray(WORDS[0])).length

    values = compiled_quickly(length)
    slope = jax.jit(jax.grad(length))(endpoints.heading)
    difference = (values(endpoints.heading + 1e-4) - values(endpoints.heading - 1e-4)) / 2e-4
    # Of some 1000 m/rad: (1e-4)^2 of the third derivative, 1e-6 of a length of 1e4 m only if the root were that bad.
    np.testing.assert_allclose(slope, difference, rtol=1e-5)
