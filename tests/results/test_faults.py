"""Faults that adaptive autopilots found: name, time and size, in the summary and in words."""

import numpy as np
import pytest

from anser.results import read_summary, summarize, write_summary
from anser.results.faults import find_fault, format_fault
from anser.results.summary_format import format_summary
from support.made_flight import make_flight
from support.made_scenario import made_scenario

TIME = np.arange(0.0, 10.0, 0.5)
SURFACES = ("left_elevon", "right_elevon", "rudder")


@pytest.mark.parametrize(
    ("code", "size", "text"),
    [
        (1, 0.052, "centre of gravity, 5.2 % of the mean chord, aft, found at 4.0 s"),
        (1, -0.052, "centre of gravity, 5.2 % of the mean chord, forward, found at 4.0 s"),
        (2, 0.9, "ice, drag up by 18 %, lift down by 9 %, found at 4.0 s"),
        (3, 0.204, "engine, 20.4 % of the thrust lost, found at 4.0 s"),
        (5, 0.487, "right elevon, 48.7 % of the effectiveness lost, found at 4.0 s"),
    ],
)
def test_a_fault_has_name_time_and_size_in_words(code, size, text):
    """The codes are those of the variable `fault`: 4 + k is surface k; the size is the last estimate."""
    codes, sizes = np.where(TIME < 4.0, 0, code), np.where(TIME < 4.0, 0.0, np.where(TIME < 9.0, 0.3, size))
    fault = find_fault(TIME, codes, sizes, SURFACES)
    assert (fault.time_s, fault.size) == (4.0, abs(size))
    assert format_fault(fault.as_dict()) == text


def test_a_healthy_aircraft_has_no_fault():
    assert find_fault(TIME, 0 * TIME, 0.0 * TIME, SURFACES) is None


def test_the_summary_has_the_faults_of_adaptive_flights_only(tmp_path):
    _, plain = make_flight()
    assert all("fault" not in entry for entry in plain["aircraft"])
    assert "fault" not in format_summary(plain)
    plain["aircraft"][1]["fault"] = {
        "name": "elevator",
        "time_s": 22.8,
        "size": 0.49,
        "unit": "of the effectiveness lost",
    }
    plain["aircraft"][0]["fault"] = None
    lines = format_summary(plain).splitlines()
    assert lines[-1] == "  bert: fault: elevator, 49 % of the effectiveness lost, found at 22.8 s"
    write_summary(plain, tmp_path / "summary.json")
    assert read_summary(tmp_path / "summary.json")["aircraft"][1]["fault"]["size"] == 0.49


def test_the_summary_is_made_from_the_record(record_of_two):
    """The second aircraft found at 4 s that its rudder is weak."""
    time_s, history = record_of_two
    found = (time_s >= 4.0)[:, None] * np.array([[0, 1]])
    history |= {"fault": 6 * found, "fault_size": 0.5 * found}
    summary = summarize(
        time_s, history, made_scenario(("anna", "bert"), ("buoy", "tanker"), ("surface",) * 2, "two"), 1.0
    )
    healthy, faulty = (entry["fault"] for entry in summary["aircraft"])
    assert healthy is None
    assert faulty == {"name": "rudder", "time_s": 4.0, "size": 0.5, "unit": "of the effectiveness lost"}


@pytest.fixture
def record_of_two():
    time_s = np.arange(0.0, 60.0, 0.5)
    zero = np.zeros((time_s.size, 2))
    north = (100.0 * (time_s - 50.0))[:, None] + zero
    keys = ("rendezvous_north", "rendezvous_east", "rendezvous_altitude", "altitude", "position_error", "lateral_bend")
    record = dict.fromkeys(keys, zero) | {
        "north": north,
        "east": zero + np.array([0.0, 2000.0]),
        "airspeed": zero + 100.0,
    }
    record |= {"clearance": np.abs(north), "phase": np.where(time_s[:, None] + zero < 50.0, 0, 2)}
    record |= {"outside_tables": zero > 0.0, "arrival_time": zero + 50.0, "status": zero.astype(int)}
    return time_s, record
