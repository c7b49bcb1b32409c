"""Decision on arrivals in closed-form flights; the running summary agrees with the record."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.results import summarize
from anser.results.arrival import arrival_outcome
from anser.results.flight_rows import build_flight_row
from anser.simulation import STATUS_MESSAGES, SummaryRecorder
from anser.simulation.closed_loop import AT_GROUND, BREAKAWAY, LEFT_FLEET
from results.test_summary import SPEED, TIME, flight, scenario

STEP = 0.25
NAN = float("nan")


def with_failure(at_s, code, arrivals=(50.1, 50.15), detour_s=None):
    """The known flight, with a status of the second aircraft from a time on; turned back `detour_s` before."""
    history = flight(arrivals)
    history["status"][at_s <= TIME, 1] = code
    if detour_s is not None:
        turn_back_s = at_s - detour_s
        north = history["north"][:, 1]
        history["north"][:, 1] = np.where(turn_back_s >= TIME, north, 2.0 * SPEED * (turn_back_s - arrivals[1]) - north)
    return history


def running_summary(history):
    """Row of the flight from the running summary, and the summary from the record."""
    north, east, up = (history[key] for key in ("north", "east", "altitude"))
    rendezvous = [history[f"rendezvous_{axis}"] for axis in ("north", "east", "altitude")]
    position = np.stack([north, east, -up], axis=-1)
    offset = np.stack([rendezvous[0] - north, rendezvous[1] - east, up - rendezvous[2]], axis=-1)
    error = np.where(history["phase"] == 2, -np.inf, history["position_error"])
    inputs = {"position_n": position, "offset_n": offset, "position_error": error}
    inputs |= {key: history[key] for key in ("airspeed", "clearance", "arrival_time", "outside_tables")}
    inputs["status"] = history["status"].astype(np.int32)
    recorder = SummaryRecorder()

    def step(memory, sample):
        number, inputs_now = sample
        return recorder.include(memory, inputs_now, number, jnp.asarray(STEP)), None

    samples = jnp.arange(TIME.size), {key: jnp.asarray(values) for key, values in inputs.items()}
    (summary, _), _ = jax.lax.scan(step, recorder.init(2), samples)
    two = scenario(timing={"duration_s": float(TIME[-1])})
    return build_flight_row(summary, history["arrival_time"][-1], two), summarize(TIME, history, two, 0.0)


def with_passing_failures():
    """The known flight; the second aircraft is outside the tables from 30 s to the end, with statuses that end before."""
    history = flight((50.1, 50.15))
    history["outside_tables"][TIME >= 30.0, 1] = True
    for start_s, code in ((10.0, 3), (20.0, 4), (30.0, 0)):
        history["status"][start_s <= TIME, 1] = code
    return history


def test_row_and_summary_agree_on_the_last_sample_and_on_statuses_that_end():
    flight_row, summary = running_summary(with_passing_failures())
    for entry in (flight_row.aircraft[1], summary["aircraft"][1]):
        # outside from 30 s to the end at 80 s, and before for 1.5 s
        assert entry["tables_left_s"] == pytest.approx(50.0 + STEP + 1.5)
        assert entry["status"] == flight_row.aircraft[1]["status"]
    assert "; then " in flight_row.aircraft[1]["status"]


CASES = {
    "arrived": (with_failure(90.0, 0), True, "arrived"),
    "closing at the crash": (with_failure(30.0, AT_GROUND), False, STATUS_MESSAGES[AT_GROUND]),
    "flying away at the crash": (with_failure(30.0, AT_GROUND, detour_s=5.0), False, STATUS_MESSAGES[AT_GROUND]),
    "broke off, and passed in its hold": (with_failure(30.0, BREAKAWAY), False, STATUS_MESSAGES[BREAKAWAY]),
    "crash between plan and pass": (
        with_failure(50.0, AT_GROUND, arrivals=(50.1, 50.18)),
        False,
        STATUS_MESSAGES[AT_GROUND],
    ),
    "crash in the hold": (with_failure(60.0, AT_GROUND), True, STATUS_MESSAGES[AT_GROUND]),
    "never trimmed": (with_failure(0.0, AT_GROUND), False, STATUS_MESSAGES[AT_GROUND]),
    "left": (with_failure(20.0, LEFT_FLEET), False, STATUS_MESSAGES[LEFT_FLEET]),
    "still closing": (with_failure(90.0, 0, arrivals=(50.1, 65.0)), False, "not arrived: still closing"),
}


@pytest.mark.parametrize("case", CASES)
def test_a_missing_arrival_has_no_time_and_no_miss_in_summary_and_row(case):
    history, is_arrival, status = CASES[case]
    flight_row, summary = running_summary(history)
    for aircraft, fleet, requirements in (
        (summary["aircraft"], summary["fleet"], summary["requirements"]),
        (flight_row.aircraft, flight_row.fleet, flight_row.requirements),
    ):
        first_entry, second_entry = aircraft
        assert first_entry["arrival_s"] == pytest.approx(50.1)
        assert second_entry["status"].startswith(status)
        assert (second_entry["arrival_s"] is None, second_entry["miss_m"] is None) == (not is_arrival, not is_arrival)
        if case == "left":  # nothing is required of it
            assert flight_row.met is all(entry["met"] for entry in requirements)
        else:
            assert (fleet["arrival_spread_s"] is None) is not is_arrival
            limits = {entry["name"]: entry["met"] for entry in requirements}
            assert limits["miss_max_m"] is False  # of 3 m; the second one misses by 4 m
            assert limits["arrival_spread_max_s"] is is_arrival
    for row_entry, summary_entry in zip(flight_row.aircraft, summary["aircraft"], strict=True):
        for key, value in row_entry.items():
            assert summary_entry[key] == (pytest.approx(value, rel=1e-9) if isinstance(value, float) else value), key


def test_a_flight_that_ends_before_the_planned_arrival_has_no_arrival():
    # nearest at the start and flying away since, as on a path that waits
    outcome = arrival_outcome((0.0, 5000.0), 60.0, np.inf, 59.0, [0, 0])
    assert not outcome.is_arrival
    assert outcome.status == "not arrived: the flight ended before the planned arrival"
    assert outcome.approach_end_s == 59.0


def test_an_empty_record_has_no_arrival():
    assert (
        arrival_outcome((NAN, NAN), 60.0, np.inf, 80.0, [0]).status == "not arrived: no finite position in the record"
    )


def test_an_aircraft_that_leaves_after_its_arrival_has_arrived():
    """Its exit path, which ends with the flight, is its plan from the sample before on."""
    history = with_failure(60.0, LEFT_FLEET)
    left = np.flatnonzero(history["status"][:, 1] == LEFT_FLEET)[0]
    expected = summarize(TIME, with_failure(90.0, 0), scenario(timing={"duration_s": float(TIME[-1])}), 0.0)
    history["arrival_time"][left - 1 :, 1] = TIME[-1]
    second_entry = summarize(TIME, history, scenario(timing={"duration_s": float(TIME[-1])}), 0.0)["aircraft"][1]
    for key in ("planned_arrival_s", "arrival_s", "miss_m", "status"):
        assert second_entry[key] == expected["aircraft"][1][key]
    assert "left_s" not in second_entry
