"""Reachable arrival times of one aircraft: the extent of the search, and the refinement of edges."""

import numpy as np
import pytest

from anser.numerics.arrays import stack_rows
from anser.planning.certified import arrival_times
from anser.planning.certified.timed_profiles import ALONE_SPLINES, ALONE_STANDARD, ALONE_TURN_LEG_PATHS
from support.aircraft_tasks import aircraft_task, airspace
from support.certified_cases import STEADY


@pytest.fixture
def queries(monkeypatch):
    """Replaces the planner by reachable times for standard and for further candidates; records the queries."""
    calls = []

    def answer(tasks, airspace, durations, count, intervals, candidate_set):
        calls.append((candidate_set, np.asarray(durations)[:count]))
        standard = (durations > 60.0) & (durations < 70.0)
        extended = standard | ((durations > 44.0) & (durations < 80.0))
        by_splines = ((durations >= 80.0) & (durations < 84.0)) | ((durations > 91.0) & (durations < 93.0))
        return {ALONE_STANDARD: standard, ALONE_TURN_LEG_PATHS: extended, ALONE_SPLINES: by_splines}[candidate_set]

    monkeypatch.setattr(arrival_times, "_reachable_at", answer)
    return calls


def test_costlier_candidates_are_tried_near_reachable_times_and_onwards(queries):
    task = stack_rows([aircraft_task((5000.0, 0.0, -1700.0))])
    grid = np.arange(20.0, 120.0, 2.0)[None, :]
    inside = arrival_times._open_times(task, airspace(STEADY), np.array([0]), grid, "none")
    np.testing.assert_array_equal(inside, (grid > 44.0) & (grid < 80.0))
    searched = np.concatenate(
        [durations for candidate_set, durations in queries if candidate_set is ALONE_TURN_LEG_PATHS]
    )
    # The first 25 s are ruled out by the distance: what follows on them is looked at too.
    searched = searched[searched > 25.0 + 2.0 * arrival_times._GRID_NEIGHBOURS]
    assert searched.min() >= 46.0 - 2.0 * arrival_times._GRID_NEIGHBOURS
    assert searched.max() <= 78.0 + 2.0 * arrival_times._GRID_NEIGHBOURS


def test_times_beyond_inadmissible_ones_are_searched_too(monkeypatch):
    """For example if a keep-out covers the rendezvous for a while: the feasible times after it."""
    grid = np.arange(30.0, 200.0, 2.0)[None, :]
    covered = (grid > 80.0) & (grid < 140.0)

    def answer(tasks, airspace, durations, count, intervals, candidate_set):
        plain = (durations > 60.0) & (durations < 70.0)
        return {ALONE_STANDARD: plain, ALONE_TURN_LEG_PATHS: plain | (durations > 140.0)}[candidate_set] & ~(
            (durations > 80.0) & (durations < 140.0)
        )

    monkeypatch.setattr(arrival_times, "_reachable_at", answer)
    may_arrive = arrival_times.may_arrive

    def ruled_out(tasks, airspace, aircraft, durations):
        closed = (durations > 80.0) & (durations < 140.0)
        return may_arrive(tasks, airspace, aircraft, durations) & ~closed

    monkeypatch.setattr(arrival_times, "may_arrive", ruled_out)
    task = stack_rows([aircraft_task((5000.0, 0.0, -1700.0))])
    inside = arrival_times._open_times(task, airspace(STEADY), np.array([0]), grid, "none")
    assert not np.any(inside & covered)
    np.testing.assert_array_equal(inside, ((grid > 60.0) & (grid < 70.0)) | (grid > 140.0))


def test_edges_are_refined_and_windows_looked_into(queries):
    task = stack_rows([aircraft_task((5000.0, 0.0, -1700.0))])
    ((earliest, latest),) = arrival_times.arrival_sets(task, airspace(STEADY), 300.0)[0]
    assert 44.0 < earliest < 44.1
    assert 79.9 < latest < 80.0
    windows = np.array([[70.0, 100.0]])
    ((earliest, latest),) = arrival_times.arrival_sets(task, airspace(STEADY), 300.0, windows)[0]
    assert earliest == 70.0
    assert 79.9 < latest < 80.0
    assert arrival_times.arrival_sets(task, airspace(STEADY), 300.0, np.array([[93.5, 95.0]])) == [[]]
    # What shapes do not reach is looked at again, with splines.
    ((earliest, latest),) = arrival_times.arrival_sets(task, airspace(STEADY), 300.0, np.array([[90.0, 95.0]]))[0]
    assert 91.0 < earliest < latest < 93.0


def test_splines_extend_the_reachable_times_on_request(queries):
    task = stack_rows([aircraft_task((5000.0, 0.0, -1700.0))])
    ((earliest, latest),) = arrival_times.arrival_sets(task, airspace(STEADY), 300.0, with_splines=True)[0]
    assert 44.0 < earliest < 44.1
    assert 83.9 < latest < 84.0
    searched = np.concatenate([durations for candidate_set, durations in queries if candidate_set is ALONE_SPLINES])
    searched = searched[searched > 25.0 * 1.08**4]  # those beside what the distance rules out
    assert 44.0 / 1.08**3 < searched.min() < searched.max() < 84.0 * 1.08**4  # a few steps beside what is open
