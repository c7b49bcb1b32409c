"""A goal is drawn as what it is: where it is by the scenario, how it moves by the record."""

import numpy as np
import pytest
import xarray as xr

from anser.report.flight_data import GOAL_FORM_TEXTS, goal_form_legend, goal_forms

TIME = np.arange(0.0, 10.0, 0.5)


def flown(speed_m_s):
    place = np.outer(TIME, [speed_m_s])
    places = {
        f"goal_{axis}_m": (("time", "aircraft"), place * (axis == "north")) for axis in ("north", "east", "altitude")
    }
    return xr.Dataset(places, coords={"time": TIME, "aircraft": ["one"]})


def scenario(kind):
    return {"aircraft": [{"name": "one", "goal": "there"}], "goal": [{"name": "there", "kind": kind}]}


@pytest.mark.parametrize(
    ("kind", "speed_m_s", "form"),
    [
        ("surface", 0.0, "buoy"),
        ("surface", 0.4, "buoy"),
        ("surface", 12.0, "ship"),
        ("airborne", 0.0, "drifting"),
        ("airborne", 12.0, "drifting"),
        ("airborne", 90.0, "flying"),
    ],
)
def test_a_form_goes_by_kind_and_speed(kind, speed_m_s, form):
    assert goal_forms(flown(speed_m_s), scenario(kind)) == [form]


def test_without_a_scenario_a_goal_is_a_goal():
    assert goal_forms(flown(12.0), {}) == ["goal"]


def test_a_goal_that_is_lost_goes_by_what_is_known():
    seen = flown(12.0)
    seen["goal_north_m"][5:] = np.nan
    assert goal_forms(seen, scenario("surface")) == ["ship"]
    assert goal_forms(seen * np.nan, scenario("surface")) == ["buoy"]


def test_the_key_names_what_is_drawn_and_nothing_else():
    key = goal_form_legend({"ship", "buoy"})
    assert GOAL_FORM_TEXTS["ship"] in key
    assert GOAL_FORM_TEXTS["buoy"] in key
    assert GOAL_FORM_TEXTS["flying"] not in key
