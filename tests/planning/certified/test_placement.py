"""Candidates beyond the usual ones, for the aircraft that need them and for no other."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.compiling.options import compiled_quickly
from anser.planning import TimedPath
from anser.planning.certified.candidates import fleet_candidates
from anser.planning.certified.certified_plan import choice_order, place_candidates
from anser.planning.certified.timed_profiles import MATCHED, PREFERRED, SLOWEST, make_candidate_set
from trials.cases import random_case
from trials.task import planner_task

pytestmark = pytest.mark.long


INTERVALS = 64
USUAL = make_candidate_set((PREFERRED,), (0.0,), (0,), (0, 1))
FURTHER = make_candidate_set((MATCHED, SLOWEST), (0.0,), (0,), (0, 1))
BOTH = USUAL._replace(extra=FURTHER)
NEEDY = np.array([True, False, True, True, False, False, True, False])


@compiled_quickly
def _all_options(tasks, airspace, durations):
    further = fleet_candidates(tasks, airspace, durations, INTERVALS, INTERVALS, FURTHER)
    both = fleet_candidates(tasks, airspace, durations, INTERVALS, INTERVALS, BOTH, jnp.asarray(NEEDY))
    placed = place_candidates(both, airspace.separation, choice_order(both))
    fleet = jnp.arange(8)
    chosen = both.routes.profile[fleet, placed.chosen], both.speed[fleet, placed.chosen]
    return further, both, placed, chosen, both.paths(0.0, placed.chosen)


@pytest.fixture(scope="module")
def options():
    tasks, airspace, _ = planner_task(random_case(2))
    return _all_options(tasks, airspace, jnp.full(8, 260.0))


def test_who_needs_them_has_both_kinds_and_the_others_the_usual_ones(options):
    further, both, _, _, _ = options
    assert further.valid.shape == (8, 8)
    assert both.valid.shape == (8, 12)
    assert np.any(further.valid[NEEDY])
    assert np.any(both.valid[~NEEDY, :4])
    np.testing.assert_array_equal(both.valid[:, 4:], further.valid & NEEDY[:, None])
    np.testing.assert_allclose(both.cost[NEEDY, 4:], further.cost[NEEDY], rtol=1e-9)
    of_both, alone = both.tracks.positions_n[:, 4:], further.tracks.positions_n
    np.testing.assert_allclose(of_both[NEEDY], alone[NEEDY], rtol=0.0, atol=1e-3)


def test_what_was_not_looked_for_is_not_chosen_even_where_nothing_is_valid():
    tasks, airspace, _ = planner_task(random_case(2))

    @compiled_quickly
    def placed(durations):
        both = fleet_candidates(tasks, airspace, durations, INTERVALS, INTERVALS, BOTH, jnp.asarray(NEEDY))
        return both, place_candidates(both, airspace.separation, choice_order(both))

    both, found = placed(jnp.full(8, 12.0))
    assert not np.any(both.valid)
    assert np.all(np.asarray(found.chosen)[~NEEDY] < 4)
    assert np.any(np.asarray(both.cost)[~NEEDY, 4:] > 1e8)


def test_the_profile_of_a_candidate_is_found_among_both_kinds(options):
    _, both, placed, (profile, speed), paths = options
    assert np.any(placed.chosen > 3)
    lengths = np.asarray(both.profiles.length)
    assert lengths.shape == (8, 3)
    assert set(np.asarray(both.routes.profile[0, 4:]).tolist()) == {1, 2}
    # The airspeed of the profile it names is its own, and so is that of the path that is delivered.
    mean = np.asarray(speed) * 260.0
    good = np.asarray(placed.valid)
    assert good.any()
    np.testing.assert_allclose(lengths[np.arange(8), profile][good], mean[good], rtol=0.02)
    flown = np.asarray(jax.vmap(TimedPath.air_length)(paths))
    np.testing.assert_allclose(flown[good], mean[good], rtol=0.02)
