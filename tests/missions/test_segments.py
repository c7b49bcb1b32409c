"""Segments of a flight and of a batch, around the planning times that need a new plan."""

import dataclasses
import inspect
from pathlib import Path
from types import SimpleNamespace

import jax
import numpy as np
import pytest

from anser.missions import segments
from anser.missions.segments import BatchState, fly_segments, fly_with_replanning
from anser.numerics.arrays import as_array
from anser.scenario import build_flight, load
from anser.simulation import fly, start_flight
from anser.simulation.recorders import PackedRows
from support.straight_lines import StraightLines

SCENARIOS = Path(__file__).parents[2] / "scenarios"
STRIDE = 10  # steps between two recorded rows


@pytest.mark.parametrize("needs", [(), (500,), (507, 519), (500, 510, 524)])
def test_a_flight_is_replanned_where_a_new_plan_is_needed(monkeypatch, needs):
    """The program flies on after a need, with meaningless rows; the parts together are whole."""
    replanned = []

    def fly_part(*arguments, **named):
        call = inspect.signature(fly).bind(*arguments, **named).arguments
        assert call["flight"] == "flight"
        first, state = int(call["first_step"]), call["state"]
        end = first + int(call["active_steps"])
        missing = [sample for sample in needs if first <= sample < end and sample not in replanned]
        rows = np.where(np.arange(first, first + 500) < min([end, *missing]), np.arange(first, first + 500), -1)
        sample = missing[0] if missing else state.replan_sample
        packed = PackedRows(rows[:, None].astype(float), (("sample", (), "int64"),))
        return SimpleNamespace(replan_sample=sample, reached=end), None, packed

    def replan(flight, state, sample):
        assert (flight, state.reached) == ("flight", sample)
        replanned.append(sample)
        return SimpleNamespace(replan_sample=sample, reached=sample)

    monkeypatch.setattr(segments, "segment_program", lambda flight: fly_part)
    monkeypatch.setattr(segments, "replan_stopped_flight", replan)
    state, rows = fly_with_replanning("flight", SimpleNamespace(replan_sample=-1), 500, 25)
    assert (tuple(replanned), state.reached) == (needs, 525)
    np.testing.assert_array_equal(rows["sample"], np.arange(500, 525))


@pytest.mark.long
def test_the_program_of_the_first_segment_serves_the_next_ones():
    """A loop fixes the types of its state: with weak types at the start, the program was compiled twice."""
    flight = build_flight(load(SCENARIOS / "turning-ships.toml"), pad_fleet=True)
    flight = dataclasses.replace(flight, planner=StraightLines(as_array(60.0), as_array([0.0, 0.0, 0.0])))
    state, _ = jax.eval_shape(start_flight, flight)
    leaves, _ = jax.tree_util.tree_flatten_with_path(state)
    assert not [jax.tree_util.keystr(path) for path, leaf in leaves if leaf.weak_type]


@pytest.mark.parametrize(
    ("needs", "short_segments"),
    [
        ({}, 0),
        ({1: [300]}, 10),
        ({0: [0], 2: [1100]}, 12),
        ({0: [500, 600, 700], 1: [600]}, 7),
        ({3: [200]}, 0),  # padding
    ],
)
def test_flights_of_a_batch_are_replanned_at_the_planning_times_that_need_it(needs, short_segments):
    """Each flight is replanned once at each sample in `needs`, before it; padding never; every sample is flown once."""
    replan_steps, last_sample, replanned = 100, 1234, []

    def fly_on(state, first, count):
        samples = state.flights.replan_sample.copy()
        for k, times in needs.items():
            due = [t for t in times if first <= t < first + count and t > samples[k]]
            samples[k] = due[0] if due else samples[k]
        rows = np.where(np.arange(500) < count, first + np.arange(500), -1)
        return BatchState(SimpleNamespace(replan_sample=samples), state.summaries + count), rows

    def replan(states, indices, sample):
        replanned.extend((int(k), sample) for k in indices)
        samples = states.replan_sample.copy()
        samples[indices] = sample
        return SimpleNamespace(replan_sample=samples)

    start = BatchState(SimpleNamespace(replan_sample=np.full(4, -1)), 0)
    flown = list(fly_segments(fly_on, replan, start, range(3), last_sample, replan_steps, STRIDE))
    assert sorted(replanned) == sorted((k, t) for k, times in needs.items() if k < 3 for t in times)
    assert flown[-1].state.summaries == last_sample + 1
    numbers = np.concatenate([part.rows[: part.end - part.first_sample] for part in flown])
    np.testing.assert_array_equal(numbers, np.arange(last_sample + 1))
    assert sum(part.end - part.first_sample <= replan_steps for part in flown[:-1]) == short_segments


@pytest.mark.parametrize(("row_stride", "again"), [(1, 1), (STRIDE, 10)])
def test_the_step_flown_in_advance_counts_unless_a_plan_or_the_rows_forbid_it(row_stride, again):
    """A need at sample 300 discards the first 500 steps; ten short segments follow, one with a replanned flight."""
    steps_flown = 0

    def fly_on(state, first, count):
        nonlocal steps_flown
        steps_flown += count
        is_due = first <= 300 < first + count and state.flights.replan_sample[0] < 300
        samples = np.array([300]) if is_due else state.flights.replan_sample
        return BatchState(SimpleNamespace(replan_sample=samples), None), None

    def replan(states, indices, sample):
        return SimpleNamespace(replan_sample=np.array([sample]))

    start = BatchState(SimpleNamespace(replan_sample=np.array([-1])), None)
    flown = list(fly_segments(fly_on, replan, start, [0], 1234, 100, row_stride))
    assert steps_flown == 500 + 1235 + again
    assert [part.first_sample for part in flown[1:]] == [part.end for part in flown[:-1]]
    assert flown[-1].end == 1235


def test_a_planner_that_asks_for_a_plan_without_making_it_is_named():
    planner = StraightLines(as_array(60.0), as_array([0.0, 0.0, 0.0]))
    with pytest.raises(NotImplementedError, match=r"StraightLines.*define replan_between_steps"):
        planner.replan_between_steps(None, 1.0, SimpleNamespace())
