"""Additional candidates for the aircraft in need, and only for them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.compiling.options import compiled_quickly
from anser.planning import TimedPath
from anser.planning.certified.candidates import (
    absent_candidates,
    concatenate_candidates,
    fleet_candidates,
    knot_count,
)
from anser.planning.certified.certified_plan import (
    _candidates,
    _choose_and_certify,
    choice_order,
    place_candidates,
    plan_at,
)
from anser.planning.certified.timed_profiles import (
    EXTRA_SETS,
    MATCHED,
    MINIMAL,
    PREFERRED,
    SLOWEST,
    STANDARD,
    make_candidate_set,
)
from trials.cases import random_case
from trials.task import planner_task

pytestmark = pytest.mark.long


INTERVALS = 64
STANDARD_SET = make_candidate_set((PREFERRED,), (0.0,), (0,), (0, 1))
EXTRA_SET = make_candidate_set((MATCHED, SLOWEST), (0.0,), (0,), (0, 1))
NEEDY = np.array([True, False, True, True, False, False, True, False])


def _combined(tasks, airspace, durations):
    base = fleet_candidates(tasks, airspace, durations, INTERVALS, STANDARD_SET)
    needy = jnp.asarray(NEEDY)
    extra = fleet_candidates(tasks, airspace, durations, INTERVALS, EXTRA_SET, selected=needy)
    return concatenate_candidates(base, extra)


@compiled_quickly
def _all_options(tasks, airspace, durations):
    extra = fleet_candidates(tasks, airspace, durations, INTERVALS, EXTRA_SET)
    combined = _combined(tasks, airspace, durations)
    placement = place_candidates(combined, airspace.separation, choice_order(combined))
    fleet = jnp.arange(8)
    chosen = combined.routes.profile[fleet, placement.chosen], combined.speed[fleet, placement.chosen]
    return extra, combined, placement, chosen, combined.paths(0.0, placement.chosen)


@pytest.fixture(scope="module")
def options():
    tasks, airspace, _ = planner_task(random_case(2))
    return _all_options(tasks, airspace, jnp.full(8, 260.0))


def test_only_needy_aircraft_have_the_additional_candidates(options):
    extra, combined, _, _, _ = options
    assert extra.valid.shape == (8, 8)
    assert combined.valid.shape == (8, 12)
    assert np.any(extra.valid[NEEDY])
    assert np.any(combined.valid[~NEEDY, :4])
    np.testing.assert_array_equal(combined.valid[:, 4:], extra.valid & NEEDY[:, None])
    np.testing.assert_allclose(combined.cost[NEEDY, 4:], extra.cost[NEEDY], rtol=1e-9)
    combined_positions, extra_positions = combined.tracks.positions_n[:, 4:], extra.tracks.positions_n
    np.testing.assert_allclose(combined_positions[NEEDY], extra_positions[NEEDY], rtol=0.0, atol=1e-3)


def test_placeholders_are_not_chosen_even_without_a_valid_candidate():
    tasks, airspace, _ = planner_task(random_case(2))

    @compiled_quickly
    def placed(durations):
        combined = _combined(tasks, airspace, durations)
        return combined, place_candidates(combined, airspace.separation, choice_order(combined))

    combined, placement = placed(jnp.full(8, 12.0))
    assert not np.any(combined.valid)
    assert np.all(np.asarray(placement.chosen)[~NEEDY] < 4)
    assert np.any(np.asarray(combined.cost)[~NEEDY, 4:] > 1e8)


def test_profile_indices_refer_to_both_sets_of_candidates(options):
    _, combined, placement, (profile, speed), paths = options
    assert np.any(placement.chosen > 3)
    lengths = np.asarray(combined.profiles.length)
    assert lengths.shape == (8, 3)
    assert set(np.asarray(combined.routes.profile[0, 4:]).tolist()) == {1, 2}
    # The airspeed of the profile it names is its own, and so is that of the path that is delivered.
    mean = np.asarray(speed) * 260.0
    valid = np.asarray(placement.valid)
    assert valid.any()
    np.testing.assert_allclose(lengths[np.arange(8), profile][valid], mean[valid], rtol=0.02)
    flown = np.asarray(jax.vmap(TimedPath.air_length)(paths))
    np.testing.assert_allclose(flown[valid], mean[valid], rtol=0.02)


def test_absent_candidates_have_the_shapes_of_generated_ones():
    tasks, airspace, _ = planner_task(random_case(2))
    durations = jnp.full(8, 260.0)
    needy = jnp.asarray(NEEDY)
    base = jax.eval_shape(lambda: fleet_candidates(tasks, airspace, durations, INTERVALS, STANDARD))
    for kind in EXTRA_SETS:
        generated = jax.eval_shape(
            lambda kind=kind: fleet_candidates(tasks, airspace, durations, INTERVALS, kind, selected=needy)
        )
        absent = absent_candidates(base, kind)
        assert jax.tree.structure(absent) == jax.tree.structure(generated)
        for stand_in, leaf in zip(jax.tree.leaves(absent), jax.tree.leaves(generated), strict=True):
            assert (stand_in.shape, stand_in.dtype) == (leaf.shape, leaf.dtype)
        assert np.all(absent.cost > 1e8)
        assert not np.any(absent.valid)
    paths = jax.eval_shape(lambda candidates: candidates.paths(0.0, jnp.zeros(8, dtype=int)), base)
    assert paths.times.shape == (8, knot_count(base))


def test_absent_candidates_and_absent_fixed_paths_change_no_plan():
    tasks, airspace, _ = planner_task(random_case(2))
    durations, start_time = jnp.full(8, 260.0), 40.0
    plan = plan_at(start_time, tasks, airspace, durations, INTERVALS, STANDARD)

    @compiled_quickly
    def plan_in_one(*arguments):
        candidates = _candidates(*arguments, INTERVALS, STANDARD)
        return _choose_and_certify(*arguments, candidates, INTERVALS, jnp.asarray(STANDARD.rounds), None)

    plain = plan_in_one(start_time, tasks, airspace, durations)
    np.testing.assert_array_equal(plan.valid, plain.valid)
    np.testing.assert_array_equal(plan.feasible, plain.feasible)
    for leaf, expected in zip(jax.tree.leaves(plan.paths), jax.tree.leaves(plain.paths), strict=True):
        np.testing.assert_allclose(leaf, expected, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(plan.certificate.clearance_ratio, plain.certificate.clearance_ratio, rtol=1e-9)


def test_the_smaller_set_and_the_first_profiles_are_parts_of_the_standard_set():
    tasks, airspace, _ = planner_task(random_case(2))
    durations = jnp.full(8, 260.0)

    @compiled_quickly
    def generated(candidate_set, profile_count):
        return fleet_candidates(tasks, airspace, durations, INTERVALS, candidate_set, profile_count=profile_count)

    small, large = (generated(candidate_set, None) for candidate_set in (MINIMAL, STANDARD))
    members = STANDARD.members_of(MINIMAL)
    assert members.shape == large.cost.shape[1:]
    np.testing.assert_array_equal(large.valid[:, members], small.valid)
    np.testing.assert_allclose(large.cost[:, members], small.cost, rtol=1e-9)  # rounding of the airspeeds
    assert STANDARD.leading_profiles(MINIMAL) == 1
    assert STANDARD.leading_profiles(STANDARD) == len(STANDARD.speeds)
    first, every = (generated(STANDARD, jnp.asarray(count)) for count in (1, len(STANDARD.speeds)))
    np.testing.assert_allclose(first.cost[:, members], small.cost, rtol=1e-9)
    np.testing.assert_array_equal(first.valid[:, members], small.valid)
    assert not np.any(first.valid[:, STANDARD.size // len(STANDARD.speeds) :])
    assert np.all(np.asarray(first.cost)[:, STANDARD.size // len(STANDARD.speeds) :] > 1e8)
    for leaf, expected in zip(jax.tree.leaves(every), jax.tree.leaves(large), strict=True):
        assert (leaf.shape, leaf.dtype) == (expected.shape, expected.dtype)
        np.testing.assert_allclose(leaf, expected, rtol=1e-9, atol=1e-6)
