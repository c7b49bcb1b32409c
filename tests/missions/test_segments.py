"""Segments of a flight: arguments of the compiled program, and batches of one size."""

import dataclasses
import inspect
from pathlib import Path
from types import SimpleNamespace

import jax
import numpy as np
import pytest

from anser.missions import segments
from anser.missions.segments import fly_with_replanning
from anser.numerics.arrays import as_array
from anser.scenario import build_flight, load
from anser.simulation import fly, start_flight
from support.straight_lines import StraightLines

SCENARIOS = Path(__file__).parents[2] / "scenarios"


@pytest.mark.parametrize("needs", [(), (500,), (507, 519), (500, 510, 524)])
def test_a_flight_is_replanned_where_a_new_plan_is_needed(monkeypatch, needs):
    """The program flies on after a need, with meaningless rows; the parts together are whole."""
    replanned = []

    def fly_part(*arguments, **named):
        call = inspect.signature(fly).bind(*arguments, **named).arguments
        assert call["flight"] == "without replanning"
        first, state = int(call["first_step"]), call["state"]
        end = first + int(call["active_steps"])
        missing = [sample for sample in needs if first <= sample < end and sample not in replanned]
        rows = np.where(np.arange(first, first + 500) < min([end, *missing]), np.arange(first, first + 500), -1)
        sample = missing[0] if missing else state.replan_sample
        return SimpleNamespace(replan_sample=sample, reached=end), None, {"sample": rows}

    def replan(flight, state, sample):
        assert (flight, state.reached) == ("flight", sample)
        replanned.append(sample)
        return SimpleNamespace(replan_sample=sample, reached=sample)

    monkeypatch.setattr(segments, "segment_program", lambda flight: fly_part)
    monkeypatch.setattr(segments, "without_replanning", lambda flight: "without replanning")
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
