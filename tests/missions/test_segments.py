"""Segments of a flight: arguments of the compiled program, and batches of one size."""

import inspect
from types import SimpleNamespace

import numpy as np
import pytest

from anser.missions import segments
from anser.missions.segments import fly_with_replanning, padded_batches
from anser.simulation import fly


@pytest.mark.parametrize("needed", [False, True])
@pytest.mark.parametrize("step_count", [None, 7])
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
        assert ("active_steps" in call) == (step_count is not None)
        assert step_count is None or int(call["active_steps"]) == step_count


def test_batches_are_padded_to_one_size():
    batches = list(padded_batches(np.arange(7), 3))
    np.testing.assert_array_equal(batches, [[0, 1, 2], [3, 4, 5], [6, 6, 6]])
