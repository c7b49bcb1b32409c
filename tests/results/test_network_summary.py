"""Summary of a network from the links between aircraft."""

import numpy as np
import pytest

from anser.planning.decentralised.time_coordination import guaranteed_rate
from anser.results.network_summary import decode_links, summarize_network
from anser.scenario import loads
from scenario.test_schema_network import ALONE

STEP_S, END_S = 0.1, 60.0


def summary_of(heard_from, lag=None):
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


def test_links_are_decoded_from_bits():
    heard = np.array([[0b110, 0b001, 0b000]])
    expected = [[[False, True, True], [True, False, False], [False, False, False]]]
    assert decode_links(heard, 3).tolist() == expected


def test_a_complete_network_has_full_service():
    network_summary = summary_of(np.tile([2, 1], (600, 1)))
    assert network_summary["links_up"] == 1.0
    assert network_summary["quality_of_service_min"] == pytest.approx(1.0)
    assert network_summary["promised_rate_per_s"] == pytest.approx(guaranteed_rate(1.0, 0.2, 4.0))
    assert network_summary["condition_met"]
    assert "promised to fall at" in network_summary["message"]
    assert network_summary["agreed_after_s"] == 1.2
    # 10 s on, 10 s off, three times
    assert network_summary["offers"] == 3


def test_links_for_half_of_the_time_give_half_of_the_service():
    network_summary = summary_of(np.tile([[2, 1], [0, 0]], (300, 1)))
    assert network_summary["links_up"] == pytest.approx(0.5, abs=0.01)
    assert network_summary["quality_of_service_mean"] == pytest.approx(0.5, abs=0.02)
    assert network_summary["condition_met"]


def test_an_outage_longer_than_the_window_is_reported_with_its_start():
    heard = np.tile([2, 1], (600, 1))
    heard[200:260] = 0
    network_summary = summary_of(heard)
    assert not network_summary["condition_met"]
    assert network_summary["quality_of_service_min"] == pytest.approx(0.0, abs=1e-12)
    assert network_summary["promised_rate_per_s"] == 0.0
    assert "falls apart for 4 s or longer, first from 20.0 s on" in network_summary["message"]


def test_samples_after_the_arrival_do_not_count():
    heard = np.tile([2, 1], (600, 1))
    heard[500:] = 0
    assert summary_of(heard)["condition_met"]


def test_clock_differences_are_summarized():
    network_summary = summary_of(np.tile([2, 1], (600, 1)), lag=np.array([0.3, -0.1]))
    assert network_summary["clock_lag_max_s"] == pytest.approx(0.3)
    assert network_summary["coordination_error_max_s"] == pytest.approx(np.hypot(0.2, 0.2))
