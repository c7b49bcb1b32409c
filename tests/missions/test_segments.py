"""Segments of a flight: arguments of the compiled program, and batches of one size."""

import dataclasses
import inspect
from pathlib import Path
from types import SimpleNamespace

import jax
import numpy as np
import pytest

from anser.missions import segments
from anser.missions.segments import fly_with_replanning, padded_batches
from anser.numerics.arrays import as_array
from anser.scenario import build_flight, load
from anser.simulation import fly, start_flight
from support.straight_lines import StraightLines

SCENARIOS = Path(__file__).parents[2] / "scenarios"


@pytest.mark.parametrize("needed", [False, True])
@pytest.mark.parametrize("step_count", [500, 7])
def test_the_program_gets_arguments_of_the_closed_loop(monkeypatch, needed, step_count):
    calls = []

    def record(*arguments, **named):
        calls.append(inspect.signature(fly).bind(*arguments, **named).arguments)
        return SimpleNamespace(planner=None), None

    flight = SimpleNamespace(planner=SimpleNamespace(replan_needed=lambda state: needed))
    monkeypatch.setattr(segments, "fly_segment", record)
    monkeypatch.setattr(segments, "without_replanning", lambda flight: "without replanning")
    fly_with_replanning(flight, "state", 500, step_count)
    assert [call["flight"] for call in calls] == ["without replanning", flight][: 1 + needed]
    for call in calls:
        assert call["state"] == "state"
        assert int(call["first_step"]) == 500
        assert int(call["active_steps"]) == step_count


def test_batches_are_padded_to_one_size():
    batches = list(padded_batches(np.arange(7), 3))
    np.testing.assert_array_equal(batches, [[0, 1, 2], [3, 4, 5], [6, 6, 6]])


def test_the_program_of_the_first_segment_serves_the_next_ones():
    """A loop fixes the types of its state: with weak types at the start, the program was compiled twice."""
    flight = build_flight(load(SCENARIOS / "turning-ships.toml"), pad_fleet=True)
    flight = dataclasses.replace(flight, planner=StraightLines(as_array(60.0), as_array([0.0, 0.0, 0.0])))
    state, _ = jax.eval_shape(start_flight, flight)
    leaves, _ = jax.tree_util.tree_flatten_with_path(state)
    assert not [jax.tree_util.keystr(path) for path, leaf in leaves if leaf.weak_type]
