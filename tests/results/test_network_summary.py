"""What a summary tells of a network follows from who heard whom, and from nothing else."""

import numpy as np
import pytest

from anser.planning.decentralised.time_coordination import guaranteed_rate
from anser.results.network_summary import decode_links, summarize_network
from anser.scenario import loads
from scenario.test_schema_network import ALONE

STEP_S, END_S = 0.1, 60.0


def told(heard_from, lag=None):
    scenario = loads(ALONE + "[network]\nwindow_s = 4.0\n")
    time_s = np.arange(0.0, END_S, scenario.timing.step_s)
    heard = np.repeat(heard_from, time_s.size // heard_from.shape[0], axis=0)
    history = {
        "heard_from": heard,
        "clock_lag": np.zeros((time_s.size, 2)) if lag is None else np.broadcast_to(lag, (time_s.size, 2)),
        "arrival_time": np.full((time_s.size, 2), 50.0),
        "path_offered": np.arange(time_s.size)[:, None] // 1000 % 2 == np.array([1, 2]),
    }
    return summarize_network(time_s, history, scenario, 1.2)


def test_links_are_bits():
    heard = np.array([[0b110, 0b001, 0b000]])
    expected = [[[False, True, True], [True, False, False], [False, False, False]]]
    assert decode_links(heard, 3).tolist() == expected


def test_a_whole_network():
    found = told(np.tile([2, 1], (600, 1)))
    assert found["links_up"] == 1.0
    assert found["quality_of_service_min"] == pytest.approx(1.0)
    assert found["promised_rate_per_s"] == pytest.approx(guaranteed_rate(1.0, 0.2, 4.0))
    assert found["condition_met"]
    assert "promised to fall at" in found["message"]
    assert found["agreed_after_s"] == 1.2
    # 10 s on, 10 s off, three times
    assert found["offers"] == 3


def test_half_of_the_time_is_half_of_the_service():
    found = told(np.tile([[2, 1], [0, 0]], (300, 1)))
    assert found["links_up"] == pytest.approx(0.5, abs=0.01)
    assert found["quality_of_service_mean"] == pytest.approx(0.5, abs=0.02)
    assert found["condition_met"]


def test_an_outage_longer_than_the_window_is_told_with_its_beginning():
    heard = np.tile([2, 1], (600, 1))
    heard[200:260] = 0
    found = told(heard)
    assert not found["condition_met"]
    assert found["quality_of_service_min"] == pytest.approx(0.0, abs=1e-12)
    assert found["promised_rate_per_s"] == 0.0
    assert "falls apart for 4 s or longer, first from 20.0 s on" in found["message"]


def test_what_is_after_the_arrival_does_not_count():
    heard = np.tile([2, 1], (600, 1))
    heard[500:] = 0
    assert told(heard)["condition_met"]


def test_clocks_apart():
    found = told(np.tile([2, 1], (600, 1)), lag=np.array([0.3, -0.1]))
    assert found["clock_lag_max_s"] == pytest.approx(0.3)
    assert found["coordination_error_max_s"] == pytest.approx(np.hypot(0.2, 0.2))
