"""When one aircraft can be at its rendezvous: where all ways are tried, and how edges are refined."""

import numpy as np
import pytest

from anser.planning.certified import arrival_times
from anser.planning.certified.task import stack_tasks
from anser.planning.certified.timed_profiles import ALONE_SPLINES, ALONE_STANDARD, ALONE_TURN_LEG_PATHS
from support.aircraft_tasks import aircraft_task, airspace
from support.certified_cases import STEADY


@pytest.fixture
def asked(monkeypatch):
    """Times open by plain paths, and by all, in place of the planner's answers; what was asked is kept."""
    calls = []

    def answer(tasks, airspace, durations, count, intervals, candidate_set):
        calls.append((candidate_set, np.asarray(durations)[:count]))
        plain = (durations > 60.0) & (durations < 70.0)
        every = plain | ((durations > 44.0) & (durations < 80.0))
        deep = ((durations >= 80.0) & (durations < 84.0)) | ((durations > 91.0) & (durations < 93.0))
        return {ALONE_STANDARD: plain, ALONE_TURN_LEG_PATHS: every, ALONE_SPLINES: deep}[candidate_set]

    monkeypatch.setattr(arrival_times, "_reachable_at", answer)
    return calls


def test_all_ways_are_tried_near_what_plain_ones_reach_and_on_from_there(asked):
    one = stack_tasks([aircraft_task((5000.0, 0.0, -1700.0))])
    grid = np.arange(20.0, 120.0, 2.0)[None, :]
    inside = arrival_times._open_times(one, airspace(STEADY), np.array([0]), grid, "none")
    np.testing.assert_array_equal(inside, (grid > 44.0) & (grid < 80.0))
    looked = np.concatenate([durations for candidate_set, durations in asked if candidate_set is ALONE_TURN_LEG_PATHS])
    # The first 25 s are ruled out by the distance: what follows on them is looked at too.
    looked = looked[looked > 25.0 + 2.0 * arrival_times._GRID_NEIGHBOURS]
    assert looked.min() >= 46.0 - 2.0 * arrival_times._GRID_NEIGHBOURS
    assert looked.max() <= 78.0 + 2.0 * arrival_times._GRID_NEIGHBOURS


def test_what_lies_beyond_times_that_are_ruled_out_is_looked_at_too(monkeypatch):
    """As where a keep-out covers the rendezvous for a while: an island on its far side."""
    grid = np.arange(30.0, 200.0, 2.0)[None, :]
    covered = (grid > 80.0) & (grid < 140.0)

    def answer(tasks, airspace, durations, count, intervals, candidate_set):
        plain = (durations > 60.0) & (durations < 70.0)
        return {ALONE_STANDARD: plain, ALONE_TURN_LEG_PATHS: plain | (durations > 140.0)}[candidate_set] & ~(
            (durations > 80.0) & (durations < 140.0)
        )

    monkeypatch.setattr(arrival_times, "_reachable_at", answer)
    may_arrive = arrival_times.may_arrive

    def ruled_out(tasks, airspace, who, durations):
        closed = (durations > 80.0) & (durations < 140.0)
        return may_arrive(tasks, airspace, who, durations) & ~closed

    monkeypatch.setattr(arrival_times, "may_arrive", ruled_out)
    one = stack_tasks([aircraft_task((5000.0, 0.0, -1700.0))])
    inside = arrival_times._open_times(one, airspace(STEADY), np.array([0]), grid, "none")
    assert not np.any(inside & covered)
    np.testing.assert_array_equal(inside, ((grid > 60.0) & (grid < 70.0)) | (grid > 140.0))


def test_edges_are_refined_and_windows_looked_into(asked):
    one = stack_tasks([aircraft_task((5000.0, 0.0, -1700.0))])
    ((first, last),) = arrival_times.arrival_sets(one, airspace(STEADY), 300.0)[0]
    assert 44.0 < first < 44.1
    assert 79.9 < last < 80.0
    windows = np.array([[70.0, 100.0]])
    ((first, last),) = arrival_times.arrival_sets(one, airspace(STEADY), 300.0, windows)[0]
    assert first == 70.0
    assert 79.9 < last < 80.0
    assert arrival_times.arrival_sets(one, airspace(STEADY), 300.0, np.array([[93.5, 95.0]])) == [[]]
    # What shapes do not reach is looked at again, with splines.
    ((first, last),) = arrival_times.arrival_sets(one, airspace(STEADY), 300.0, np.array([[90.0, 95.0]]))[0]
    assert 91.0 < first < last < 93.0


def test_free_motions_widen_the_times_where_asked_for(asked):
    one = stack_tasks([aircraft_task((5000.0, 0.0, -1700.0))])
    ((first, last),) = arrival_times.arrival_sets(one, airspace(STEADY), 300.0, with_splines=True)[0]
    assert 44.0 < first < 44.1
    assert 83.9 < last < 84.0
    looked = np.concatenate([durations for candidate_set, durations in asked if candidate_set is ALONE_SPLINES])
    looked = looked[looked > 25.0 * 1.08**4]  # those beside what the distance rules out
    assert 44.0 / 1.08**3 < looked.min() < looked.max() < 84.0 * 1.08**4  # a few steps beside what is open
