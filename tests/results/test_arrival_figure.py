"""The arrival accuracy matches the arrival rule of the scenario."""

from types import SimpleNamespace

import pytest

from anser.results.arrival import arrival_accuracy, format_duration, format_planned_arrivals, summarize_arrivals
from anser.results.summary_format import format_fleet
from support.made_scenario import made_scenario


def arrival_summary(rule, arrivals, spacing_s=None, late=0.0):
    """Summary of aircraft with these arrivals, planned `late` seconds earlier."""
    count = len(arrivals)
    requirement = {"rule": rule} | ({} if spacing_s is None else {"spacing_s": spacing_s})
    names = [f"one-{k}" for k in range(count)]
    tables = {"arrival": requirement, "fleet": {"speed_m_s": 150.0, "planner": "certified"}}
    scenario = made_scenario(names, ["mark"] * count, **tables)
    entries = [
        {"name": name, "arrival_s": at, "planned_arrival_s": at - late}
        for name, at in zip(names, arrivals, strict=True)
    ]
    spread = None if None in arrivals else max(arrivals) - min(arrivals)
    fleet = {"arrival_spread_s": spread, "separation_min_m": None if count == 1 else 250.0}
    return {"aircraft": entries, "arrival": summarize_arrivals(scenario, entries), "fleet": fleet}


def test_simultaneous_arrivals_have_a_spread():
    summary = arrival_summary("together", [60.0, 60.25])
    assert arrival_accuracy(summary).kind == "spread"
    assert format_fleet(summary) == ["arrival spread 0.25 s", "least separation 250 m"]


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.0, "0 ms"), (2.31e-5, "0.023 ms"), (0.0122, "12 ms"), (0.0994, "99 ms"), (0.25, "0.25 s")]
)
def test_short_durations_are_formatted_in_milliseconds(seconds, text):
    assert format_duration(seconds) == text


def test_a_sequence_has_a_spacing_error():
    summary = arrival_summary("sequence", [100.0, 40.0, 69.5], spacing_s=30.0)
    assert summary["arrival"]["spacing_error_max_s"] == pytest.approx(0.5)
    assert format_fleet(summary)[0] == "arrivals 30 s apart, spacing error 0.50 s"


def test_the_spacing_error_is_that_of_the_planned_order_and_of_the_gaps_that_stay():
    def spacing_error(*times):
        entries = [{"arrival_s": arrival, "planned_arrival_s": planned} for arrival, planned in times]
        scenario = SimpleNamespace(arrival=SimpleNamespace(rule="sequence", spacing_s=10.0, is_common=False))
        return summarize_arrivals(scenario, entries)["spacing_error_max_s"]

    # The second of three has left, and its gap stays.
    assert spacing_error((60.0, 60.0), (80.25, 80.0)) == 0.25
    # The followers have moved up.
    assert spacing_error((60.0, 60.0), (70.5, 70.0)) == 0.5
    # Two aircraft have changed places.
    assert spacing_error((69.5, 60.0), (60.0, 70.0)) == 19.5


def test_a_sequence_without_spacing_has_a_spread():
    assert arrival_accuracy(arrival_summary("sequence", [60.0, 60.25], spacing_s=0.0)).kind == "spread"


def test_a_single_aircraft_has_an_arrival_error():
    summary = arrival_summary("together", [34.0], late=0.125)
    assert format_fleet(summary) == ["arrival 0.12 s off its planned time"]


def test_a_missing_arrival_has_no_accuracy():
    summary = arrival_summary("together", [34.0])
    summary["aircraft"][0]["arrival_s"] = None
    assert arrival_accuracy(summary | {"arrival": {"common": True, "error_max_s": None}}).describe(1) == ""


def test_a_summary_without_requirement_has_simultaneous_arrivals():
    summary = arrival_summary("together", [60.0, 60.25])
    del summary["arrival"]
    assert arrival_accuracy(summary).kind == "spread"


@pytest.mark.parametrize(
    ("count", "last_s", "text"),
    [(1, 60.0, "arrives at 60.00 s"), (3, 60.0, "all arrive at 60.00 s"), (3, 61.0, "arrivals from 60.00 to 61.00 s")],
)
def test_planned_arrivals_are_formatted_by_number(count, last_s, text):
    assert format_planned_arrivals(count, 60.0, last_s) == text
