"""Arrival times of complete scenarios: the first time reachable at the fleet's speed, for every heading."""

import math
from pathlib import Path

import numpy as np
import pytest

import anser
from anser.scenario import load, loads

pytestmark = pytest.mark.long

SCENARIOS = Path(__file__).parents[2] / "scenarios"

_SCENARIO = """\
format = 2
name = "straight"
timing.duration_s = 300.0
fleet.speed_m_s = 150.0
fleet.planner = "certified"
wind = {{ speed_m_s = {wind_m_s!r}, from_deg = {wind_deg!r} }}
[[aircraft]]
name = "a"
goal = "g"
start = {{ north_m = 0.0, east_m = 0.0, altitude_m = 1000.0, speed_m_s = 150.0, course_deg = {course_deg!r} }}
rendezvous = {{ stand_off_up_m = {up_m!r} }}
[[goal]]
name = "g"
kind = "surface"
north_m = {north_m!r}
east_m = {east_m!r}
speed_m_s = {goal_m_s!r}
course_deg = {goal_deg!r}
"""


def _degrees(angle_deg):
    return (angle_deg + 180.0) % 360.0 - 180.0


def _arrival_s(forward_m, side_m, rise_m, heading_deg=0.0, wind_m_s=0.0, goal_m_s=0.0):
    """Arrival time of a task that is rotated to a heading together with wind and goal."""
    turn = math.radians(heading_deg)
    text = _SCENARIO.format(
        north_m=forward_m * math.cos(turn) - side_m * math.sin(turn),
        east_m=forward_m * math.sin(turn) + side_m * math.cos(turn),
        up_m=1000.0 + rise_m,
        course_deg=_degrees(heading_deg),
        wind_m_s=wind_m_s,
        wind_deg=(heading_deg + 200.0) % 360.0,
        goal_m_s=goal_m_s,
        goal_deg=_degrees(heading_deg + 110.0),
    )
    return float(anser.plan(loads(text)).plan.arrival_times[0])


@pytest.mark.parametrize("rise_m", [-10.0, -0.001, 0.0, 0.001, 1.0, 10.0, 200.0])
def test_a_small_climb_costs_no_time(rise_m):
    """The goal is 9 km straight ahead at 150 m/s; a climb adds the extra length of its slope only."""
    straight_s = math.hypot(9000.0, rise_m) / 150.0
    np.testing.assert_allclose(_arrival_s(9000.0, 0.0, rise_m), straight_s, rtol=1e-3)


@pytest.mark.parametrize(
    "task", [(9000.0, 0.0, 0.0, 0.0, 0.0), (7000.0, 2500.0, 0.001, 14.0, 8.0), (8000.0, -900.0, -300.0, 18.0, 12.0)]
)
def test_the_arrival_time_is_independent_of_the_heading(task):
    """A task rotated to 24 headings has a single arrival time."""
    forward_m, side_m, rise_m, wind_m_s, goal_m_s = task
    arrivals_s = [
        _arrival_s(forward_m, side_m, rise_m, heading_deg, wind_m_s, goal_m_s)
        for heading_deg in np.arange(0.0, 360.0, 15.0).tolist()
    ]
    assert np.ptp(arrivals_s) < 1e-6


def test_the_storm_fleet_arrives_at_the_first_reachable_time():
    planned = anser.plan(load(SCENARIOS / "storm-sampling.toml"))
    assert float(np.max(planned.plan.arrival_times)) < 81.0


def test_a_plan_against_strong_wind_arrives_at_the_preferred_airspeed():
    """The goal, 8 km straight ahead, moves away at 10 m/s; the wind blows from ahead at 50 m/s."""
    text = _SCENARIO.format(
        north_m=8000.0,
        east_m=0.0,
        up_m=1000.0,
        course_deg=0.0,
        wind_m_s=50.0,
        wind_deg=0.0,
        goal_m_s=10.0,
        goal_deg=0.0,
    )
    planned = anser.plan(loads(text))
    np.testing.assert_allclose(planned.plan.arrival_times[0], 8000.0 / (150.0 - 50.0 - 10.0), rtol=1e-3)
    np.testing.assert_allclose(planned.plan.speeds[0], 150.0, rtol=1e-3)
