"""Candidates beyond the usual ones, for the aircraft that need them and for no other."""

import jax.numpy as jnp
import numpy as np
import pytest

from anser.numerics import compiled_quickly
from anser.planning.certified.choices import MATCHED, PREFERRED, SLOWEST, make_choices
from anser.planning.certified.placement import chosen_of, fewest_first, make_options, place
from trials.cases import random_case
from trials.task import planner_task

pytestmark = pytest.mark.long


TICKS = 64
USUAL = make_choices((PREFERRED,), (0.0,), (0,), (0, 1))
FURTHER = make_choices((MATCHED, SLOWEST), (0.0,), (0,), (0, 1))
BOTH = USUAL._replace(beyond=FURTHER)
SOUGHT = np.array([True, False, True, True, False, False, True, False])


@compiled_quickly
def _all_options(travellers, airspace, durations):
    further = make_options(travellers, airspace, durations, TICKS, TICKS, FURTHER)
    both = make_options(travellers, airspace, durations, TICKS, TICKS, BOTH, jnp.asarray(SOUGHT))
    placed = place(both, airspace.separation, fewest_first(both))
    return further, both, placed, chosen_of(both, placed)


@pytest.fixture(scope="module")
def options():
    travellers, airspace, _ = planner_task(random_case(2))
    return _all_options(travellers, airspace, jnp.full(8, 260.0))


def test_who_is_sought_for_has_both_kinds_and_the_others_the_usual_ones(options):
    further, both, _, _ = options
    assert further.valid.shape == (8, 8)
    assert both.valid.shape == (8, 12)
    assert np.any(further.valid[SOUGHT])
    assert np.any(both.valid[~SOUGHT, :4])
    np.testing.assert_array_equal(both.valid[:, 4:], further.valid & SOUGHT[:, None])
    np.testing.assert_allclose(both.cost[SOUGHT, 4:], further.cost[SOUGHT], rtol=1e-9)
    of_both, alone = both.tracks.positions_n[:, 4:], further.tracks.positions_n
    np.testing.assert_allclose(of_both[SOUGHT], alone[SOUGHT], rtol=0.0, atol=1e-3)


def test_what_was_not_looked_for_is_not_chosen_even_where_nothing_is_valid():
    travellers, airspace, _ = planner_task(random_case(2))

    @compiled_quickly
    def placed(durations):
        both = make_options(travellers, airspace, durations, TICKS, TICKS, BOTH, jnp.asarray(SOUGHT))
        return both, place(both, airspace.separation, fewest_first(both))

    both, found = placed(jnp.full(8, 12.0))
    assert not np.any(both.valid)
    assert np.all(np.asarray(found.chosen)[~SOUGHT] < 4)
    assert np.any(np.asarray(both.cost)[~SOUGHT, 4:] > 1e8)


def test_the_timetable_of_a_candidate_is_found_among_both_kinds(options):
    _, both, placed, (candidate, table) = options
    assert np.any(placed.chosen > 3)
    fleet = np.arange(8)
    lengths = np.asarray(both.tables.length)
    assert lengths.shape == (8, 3)
    which = np.asarray(both.candidates.which)[fleet, placed.chosen]
    np.testing.assert_array_equal(np.asarray(candidate.which), which)
    np.testing.assert_array_equal(table.length, lengths[fleet, which])
    assert set(np.asarray(both.candidates.which[0, 4:]).tolist()) == {1, 2}
    # The airspeed of the profile it names is its own.
    mean = np.asarray(candidate.speed) * 260.0
    good = np.asarray(placed.valid)
    assert good.any()
    np.testing.assert_allclose(table.length[good], mean[good], rtol=0.02)
