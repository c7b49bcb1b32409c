"""What counts as an arrival, in flights known in closed form; the running summary says the same as the record."""

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


def failing(at_s, code, arrivals=(50.1, 50.15), detour_s=None):
    """The known flight, in which the second aircraft gets a status at a time; turned back `detour_s` before that."""
    history = flight(arrivals)
    history["status"][at_s <= TIME, 1] = code
    if detour_s is not None:
        turned = at_s - detour_s
        north = history["north"][:, 1]
        history["north"][:, 1] = np.where(turned >= TIME, north, 2.0 * SPEED * (turned - arrivals[1]) - north)
    return history


def running(history):
    """Row of the flight from the running summary."""
    north, east, up = (history[key] for key in ("north", "east", "altitude"))
    met = [history[f"rendezvous_{axis}"] for axis in ("north", "east", "altitude")]
    position = np.stack([north, east, -up], axis=-1)
    offset = np.stack([met[0] - north, met[1] - east, up - met[2]], axis=-1)
    error = np.where(history["phase"] == 2, -np.inf, history["position_error"])
    rows = {"position_n": position, "offset_n": offset, "position_error": error}
    rows |= {key: history[key] for key in ("airspeed", "clearance", "arrival_time", "outside_tables")}
    rows["status"] = history["status"].astype(np.int32)
    recorder = SummaryRecorder()

    def step(memory, sample):
        number, now = sample
        return recorder.include(memory, now, number, jnp.asarray(STEP)), None

    samples = jnp.arange(TIME.size), {key: jnp.asarray(values) for key, values in rows.items()}
    (summary, _), _ = jax.lax.scan(step, recorder.init(2), samples)
    two = scenario(timing={"duration_s": float(TIME[-1])})
    return build_flight_row(summary, history["arrival_time"][-1], two), summarize(TIME, history, two, 0.0)


CASES = {
    "arrived": (failing(90.0, 0), True, "arrived"),
    "closing at the crash": (failing(30.0, AT_GROUND), False, STATUS_MESSAGES[AT_GROUND]),
    "flying away at the crash": (failing(30.0, AT_GROUND, detour_s=5.0), False, STATUS_MESSAGES[AT_GROUND]),
    "broke off, and passed in its hold": (failing(30.0, BREAKAWAY), False, STATUS_MESSAGES[BREAKAWAY]),
    "crash between plan and pass": (
        failing(50.0, AT_GROUND, arrivals=(50.1, 50.18)),
        False,
        STATUS_MESSAGES[AT_GROUND],
    ),
    "crash in the hold": (failing(60.0, AT_GROUND), True, STATUS_MESSAGES[AT_GROUND]),
    "never trimmed": (failing(0.0, AT_GROUND), False, STATUS_MESSAGES[AT_GROUND]),
    "left": (failing(20.0, LEFT_FLEET), False, STATUS_MESSAGES[LEFT_FLEET]),
    "still closing": (failing(90.0, 0, arrivals=(50.1, 65.0)), False, "not arrived: still closing"),
}


@pytest.mark.parametrize("case", CASES)
def test_no_arrival_is_no_time_and_no_miss_in_summary_and_row(case):
    history, is_arrival, status = CASES[case]
    row, summary = running(history)
    for aircraft, fleet, requirements in (
        (summary["aircraft"], summary["fleet"], summary["requirements"]),
        (row.aircraft, row.fleet, row.requirements),
    ):
        first, second = aircraft
        assert first["arrival_s"] == pytest.approx(50.1)
        assert second["status"].startswith(status)
        assert (second["arrival_s"] is None, second["miss_m"] is None) == (not is_arrival, not is_arrival)
        if case != "left":  # nothing is required of it
            assert (fleet["arrival_spread_s"] is None) is not is_arrival
            limits = {entry["name"]: entry["met"] for entry in requirements}
            assert limits["miss_max_m"] is False  # of 3 m; the second one misses by 4 m
            assert limits["arrival_spread_max_s"] is is_arrival
    for mine, other in zip(row.aircraft, summary["aircraft"], strict=True):
        for key, value in mine.items():
            assert other[key] == (pytest.approx(value, rel=1e-9) if isinstance(value, float) else value), key


def test_a_flight_that_ends_before_the_planned_arrival_has_none():
    # nearest at the start and flying away since, as on a path that waits
    outcome = arrival_outcome((0.0, 5000.0), 60.0, np.inf, 59.0, [0, 0])
    assert not outcome.is_arrival
    assert outcome.status == "not arrived: the flight ended before the planned arrival"
    assert outcome.approach_end_s == 59.0


def test_no_record_is_no_arrival():
    assert (
        arrival_outcome((NAN, NAN), 60.0, np.inf, 80.0, [0]).status == "not arrived: no finite position in the record"
    )
