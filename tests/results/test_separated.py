"""Distance between two aircraft: evaluation, and the warning below three spans."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from anser.aircraft_files.sources import read_airframe, write_airframe_starter
from anser.report.flight_page import verdict_html
from anser.results.arrival import least_distance
from anser.results.separation import (
    is_judged_by_separation,
    least_separation,
    proximity_warning,
    separation_attributes,
)
from anser.results.summary_format import format_summary
from anser.scenario.cautions import find_cautions
from support.made_flight import make_flight
from support.made_scenario import made_scenario

SPAN_M = 9.144  # of the F-16: 30 ft
NEAR = {"near_distance_m": 3.0 * SPAN_M}


def two_aircraft(**tables):
    return made_scenario(["anna", "bert"], ["buoy", "ship"], **tables)


@pytest.mark.parametrize(
    ("tables", "required"),
    [({}, 0), ({"separation": {"horizontal_m": 150.0}}, 1), ({"requirements": {"separation_min_m": 150.0}}, 1)],
)
def test_dataset_attributes_have_the_separation_requirement_and_the_near_distance(tables, required):
    tables = tables | {"fleet": {"speed_m_s": 150.0, "planner": "certified"}}
    assert separation_attributes(two_aircraft(**tables)) == {
        "separation_required": required,
        "near_distance_m": pytest.approx(3.0 * SPAN_M),
    }
    cautions = [caution for caution in find_cautions(two_aircraft(**tables)) if caution.startswith("separation: ")]
    assert len(cautions) == 1 - required


def test_a_single_aircraft_has_no_separation_attributes():
    single = made_scenario(["anna"], ["buoy"])
    assert separation_attributes(single) == {}
    assert not any(caution.startswith("separation: ") for caution in find_cautions(single))


SHAPES = st.tuples(st.integers(2, 8), st.integers(3, 6), st.just(3))


@given(SHAPES.flatmap(lambda shape: arrays(float, shape, elements=st.floats(-1e4, 1e4))), st.booleans())
def test_the_least_separation_of_a_fleet_is_that_of_its_nearest_pair(positions, has_gap):
    if has_gap:
        positions[0, 1] = np.nan
    history = dict(zip(("north", "east", "altitude"), np.moveaxis(positions, -1, 0), strict=True))
    first, second = np.triu_indices(positions.shape[1], 1)
    np.testing.assert_array_equal(
        least_separation(history), np.nanmin(least_distance(positions[:, first] - positions[:, second]))
    )


def test_close_flights_are_counted_with_the_least_distance():
    assert (
        proximity_warning([11.7], NEAR)
        == "two aircraft came within 11.7 m of each other, less than three spans (27.4 m)"
    )
    several = proximity_warning(np.array([11.7, 400.0, np.nan, 27.0]), NEAR)
    assert several == "two aircraft came within 11.7 m of each other; less than three spans (27.4 m) in 2 of 4 flights"
    assert proximity_warning([27.5], NEAR) == proximity_warning([None], NEAR) == proximity_warning([1.0], {}) == ""


def test_a_verdict_without_separation_requirement_has_a_warning():
    _, summary = make_flight()
    assert is_judged_by_separation(summary)
    assert "separation was required" not in format_summary(summary) + verdict_html(summary, {})
    summary["requirements"] = [e for e in summary["requirements"] if not e["name"].startswith("separation")]
    assert "all requirements met, no separation was required" in format_summary(summary)
    html = verdict_html(summary, {}, warning=proximity_warning([11.7], NEAR))
    assert "No separation was required." in html
    assert "<b>Warning:</b> two aircraft came within 11.7 m" in html
    assert 'class="answer mixed"' in html


def test_the_widest_of_aircraft_by_file_sets_the_near_distance(tmp_path):
    """A file's checks hold a table of deflections, which once kept the flight of two such aircraft from ending."""
    path = tmp_path / "mine.toml"
    write_airframe_starter(path)
    text = path.read_text(encoding="utf-8")
    assert "# surfaces_deg = { elevator = 0.0 }" in text
    path.write_text(text.replace("# surfaces_deg =", "surfaces_deg ="), encoding="utf-8")
    by_file = SimpleNamespace(type="mine", variant="textbook", x_cg_over_c=None, airframe=read_airframe(str(path)))
    fleet = SimpleNamespace(aircraft=[by_file, by_file], requires_separation=True)
    assert separation_attributes(fleet)["near_distance_m"] == pytest.approx(3.0 * 10.18)
