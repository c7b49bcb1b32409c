"""Forms of goals in the scene, from the kind in the scenario and the recorded speed."""

import numpy as np
import pytest
import xarray as xr

from anser.report.flight_data import GOAL_FORM_TEXTS, goal_form_legend, goal_forms

TIME = np.arange(0.0, 10.0, 0.5)


def flown(speed_m_s):
    position = np.outer(TIME, [speed_m_s])
    variables = {
        f"goal_{axis}_m": (("time", "aircraft"), position * (axis == "north")) for axis in ("north", "east", "altitude")
    }
    return xr.Dataset(variables, coords={"time": TIME, "aircraft": ["one"]})


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
def test_the_form_depends_on_kind_and_speed(kind, speed_m_s, form):
    assert goal_forms(flown(speed_m_s), scenario(kind)) == [form]


def test_a_goal_without_a_scenario_has_the_default_form():
    assert goal_forms(flown(12.0), {}) == ["goal"]


def test_a_lost_goal_has_the_form_of_its_recorded_speed():
    partly_lost = flown(12.0)
    partly_lost["goal_north_m"][5:] = np.nan
    assert goal_forms(partly_lost, scenario("surface")) == ["ship"]
    assert goal_forms(partly_lost * np.nan, scenario("surface")) == ["buoy"]


def test_the_legend_lists_only_forms_in_the_scene():
    key = goal_form_legend({"ship", "buoy"})
    assert GOAL_FORM_TEXTS["ship"] in key
    assert GOAL_FORM_TEXTS["buoy"] in key
    assert GOAL_FORM_TEXTS["flying"] not in key
