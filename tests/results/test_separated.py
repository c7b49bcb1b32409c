"""How near two aircraft came: whether it was judged, and a warning below three spans."""

import numpy as np
import pytest

from anser.report.flight_overview import verdict_html
from anser.results.separation import is_judged_by_separation, proximity_warning, separation_attributes
from anser.results.summary_format import format_summary
from anser.scenario.cautions import find_cautions
from support.made_flight import make_flight
from support.made_scenario import made_scenario

SPAN_M = 9.144  # of the F-16: 30 ft
NEAR = {"near_distance_m": 3.0 * SPAN_M}


def two(**tables):
    return made_scenario(["anna", "bert"], ["buoy", "ship"], **tables)


@pytest.mark.parametrize(
    ("tables", "required"),
    [({}, 0), ({"separation": {"horizontal_m": 150.0}}, 1), ({"requirements": {"separation_min_m": 150.0}}, 1)],
)
def test_a_dataset_says_whether_a_separation_was_required_and_what_is_near(tables, required):
    tables = tables | {"fleet": {"speed_m_s": 150.0, "planner": "certified"}}
    assert separation_attributes(two(**tables)) == {
        "separation_required": required,
        "near_distance_m": pytest.approx(3.0 * SPAN_M),
    }
    found = [caution for caution in find_cautions(two(**tables)) if caution.startswith("separation: ")]
    assert len(found) == 1 - required


def test_one_aircraft_has_none_to_keep_away_from():
    one = made_scenario(["anna"], ["buoy"])
    assert separation_attributes(one) == {}
    assert not any(caution.startswith("separation: ") for caution in find_cautions(one))


def test_near_flights_are_counted_and_the_nearest_is_told():
    assert (
        proximity_warning([11.7], NEAR)
        == "two aircraft came within 11.7 m of each other, less than three spans (27.4 m)"
    )
    several = proximity_warning(np.array([11.7, 400.0, np.nan, 27.0]), NEAR)
    assert several == "two aircraft came within 11.7 m of each other; less than three spans (27.4 m) in 2 of 4 flights"
    assert proximity_warning([27.5], NEAR) == proximity_warning([None], NEAR) == proximity_warning([1.0], {}) == ""


def test_a_verdict_without_a_separation_says_so_and_warns():
    _, summary = make_flight()
    assert is_judged_by_separation(summary)
    assert "separation was required" not in format_summary(summary) + verdict_html(summary, {})
    summary["requirements"] = [e for e in summary["requirements"] if not e["name"].startswith("separation")]
    assert "all requirements met, no separation was required" in format_summary(summary)
    told = verdict_html(summary, {}, warning=proximity_warning([11.7], NEAR))
    assert "No separation was required." in told
    assert "<b>Warning:</b> two aircraft came within 11.7 m" in told
    assert 'class="answer mixed"' in told
