"""The trials of the live page: samples of random drags and of a server that stands still, and the faults they find."""

import pytest

from support.chromium import skip_without_chromium

skip_without_chromium()
pytest.importorskip("starlette")

from trials.live_drags import difference, drag_often, growth, scenario_text  # noqa: E402
from trials.standing_server import stand_still  # noqa: E402


@pytest.mark.long
def test_answers_after_random_drags_equal_those_of_the_planner(tmp_path):
    faults, line = drag_often(tmp_path, 12, seed=3, reset=6, reach_px=45.0)
    assert faults == []
    assert "planned" in line


@pytest.mark.long
def test_a_foreign_answer_is_a_difference(tmp_path):
    path = tmp_path / "drag.toml"
    path.write_text(scenario_text(), encoding="utf-8")
    answer = {"status": "planned", "problems": [], "arrivals_s": [100.0, 100.0, 100.0]}
    assert "arrival times differ" in difference(path, answer)
    assert "the page says refused" in difference(path, answer | {"status": "refused", "problems": ["no path"]})


def test_growth_compares_the_quarter_of_the_readings_with_the_last():
    readings = [(500.0, 4.0)] * 5 + [(600.0, 4.0)] * 5 + [(750.0, 5.0)] * 3
    assert growth(readings) == pytest.approx((0.5, 0.25))


@pytest.mark.long
def test_a_page_whose_server_stood_still_has_lost_nothing(tmp_path):
    faults, _ = stand_still(tmp_path, 45.0)
    assert faults == []
