"""Summary of a network from the links between aircraft."""

import numpy as np
import pytest

from anser.planning.certified.replanning import CORRECTED, UNCHANGED
from anser.planning.decentralised.time_coordination import guaranteed_rate
from anser.results.network_summary import decode_links, summarize_network
from anser.scenario import loads
from anser.simulation.closed_loop import BREAKAWAY, LEFT_FLEET
from scenario.test_schema_network import ALONE

STEP_S, END_S = 0.1, 60.0
AXES = "north", "east", "altitude"


def summary_of(heard_from, lag=None, renewal=CORRECTED, path_end_m=0.0, status=0):
    scenario = loads(ALONE + "[network]\nwindow_s = 4.0\n")
    time_s = np.arange(0.0, END_S, scenario.timing.step_s)
    heard = np.repeat(heard_from, time_s.size // heard_from.shape[0], axis=0)
    history = {
        "heard_from": heard,
        "clock_lag": np.zeros((time_s.size, 2)) if lag is None else np.broadcast_to(lag, (time_s.size, 2)),
        "arrival_time": np.full((time_s.size, 2), 50.0),
        "status": np.broadcast_to(status, (time_s.size, 2)),
        "renewal": np.broadcast_to(renewal, (time_s.size, 2)),
        **{f"{point}_{axis}": np.zeros((time_s.size, 2)) for point in ("reference", "rendezvous") for axis in AXES},
        "reference_east": np.broadcast_to([0.0, path_end_m], (time_s.size, 2)),
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


def test_an_aircraft_that_left_counts_no_longer():
    heard = np.tile([2, 1], (600, 1))
    heard[200:] = 0
    status = np.zeros((6000, 2), int)
    status[2000:, 1] = LEFT_FLEET
    status[3000:, 1] = 0  # an aircraft does not come back
    lag = np.zeros((6000, 2))
    lag[2000:, 1] = 7.0
    network_summary = summary_of(heard, lag=lag, status=status)
    # a single aircraft has no one to hear, and windows count those who are there at their end
    assert network_summary["links_up"] == 1.0
    assert network_summary["condition_met"]
    assert network_summary["clock_lag_max_s"] == network_summary["coordination_error_max_s"] == 0.0
    assert not summary_of(heard, lag=lag)["condition_met"]


def test_samples_after_the_arrival_do_not_count():
    heard = np.tile([2, 1], (600, 1))
    heard[500:] = 0
    assert summary_of(heard)["condition_met"]


def test_clock_differences_are_summarized():
    network_summary = summary_of(np.tile([2, 1], (600, 1)), lag=np.array([0.3, -0.1]))
    assert network_summary["clock_lag_max_s"] == pytest.approx(0.3)
    assert network_summary["coordination_error_max_s"] == pytest.approx(np.hypot(0.2, 0.2))


def test_a_path_that_no_longer_leads_to_the_rendezvous_is_named():
    network = loads(ALONE + "[network]\n").network
    time_s = np.arange(0.0, END_S, loads(ALONE).timing.step_s)
    kept = np.where(time_s[:, None] > 9.0, UNCHANGED, CORRECTED)
    complete = np.tile([2, 1], (600, 1))
    summary = summary_of(complete, renewal=kept, path_end_m=269.4)
    (outdated,) = summary["outdated_paths"]
    assert outdated["from_s"] == pytest.approx(9.0, abs=0.011)
    assert outdated["distance_m"] == pytest.approx(269.4)
    second = loads(ALONE).aircraft[1].name
    assert f'"{second}" flew from 9.0 s on a path that ends 269 m from its rendezvous' in summary["message"]
    # a path that was corrected, or ends within the tube, is not outdated
    assert summary_of(complete, renewal=CORRECTED, path_end_m=269.4)["outdated_paths"] == []
    assert summary_of(complete, renewal=kept, path_end_m=network.tube_m - 0.1)["outdated_paths"] == []
    # nor is that of an aircraft that left its plan
    broke_off = np.where(time_s[:, None] > 20.0, BREAKAWAY, 0) * np.array([0, 1])
    assert summary_of(complete, renewal=kept, path_end_m=269.4, status=broke_off)["outdated_paths"] == []
