"""The table of a fleet without a centre: refusals with key paths and reasons, and the planner built from it."""

import dataclasses

import numpy as np
import pytest

from anser.config import ScenarioError
from anser.planning.decentralised.planner import DecentralisedPlanner
from anser.scenario import build_flight, loads
from anser.scenario.build_aircraft import build_guidance, resolve_fleet
from anser.scenario.build_planner import build_planner
from anser.scenario.schema_checks import DECENTRALISED_AIRCRAFT_MAX as AIRCRAFT_MAX
from anser.scenario.schema_settings import greatest_rate_range, rate_range_problems
from scenario.test_schema_uncertain import TEXT

ALONE = TEXT.replace("[fleet]", '[fleet]\nplanner = "decentralised"')


@pytest.mark.parametrize(
    ("lines", "path", "expected"),
    [
        ("[network]\nloss = 1.5", "network.loss", "from 0 to 1"),
        ("[network]\nrange_m = -1.0", "network.range_m", "above 0"),
        ("[network]\ndelay_s = 0.25", "network.delay_s", "whole multiple of period_s"),
        ("[network]\nperiod_s = 0.013", "network.period_s", "whole multiple of timing.step_s"),
        ("[network]\noutage_share = 1.0", "network.outage_share", "from 0 to 0.99"),
        ("[network]\ncoupling_per_s = 0.3", "network.coupling_per_s", "at most 0.25"),
        ("[network]\nrate_range = 0.09", "network.rate_range", "what fleet.reserve = 0.1 leaves"),
        ("[network]\nreach_m = 5.0", "network.reach_m", "range_m"),
        ('[arrival]\nrule = "earliest"', "arrival.rule", '"together" or "at" or "times" or "sequence"'),
        ('[[event]]\ntime_s = 30.0\nkind = "aircraft-leaves"\naircraft = "alpha"', "event[0].kind", "goal-sensor-lost"),
    ],
)
def test_invalid_networks_are_refused(lines, path, expected):
    with pytest.raises(ScenarioError) as caught:
        loads(f"{ALONE}\n{lines}\n")
    problems = [problem for problem in caught.value.problems if problem.path == path]
    assert len(problems) == 1, caught.value
    assert expected in str(problems[0])


@pytest.mark.parametrize("planner", ["certified", "published"])
def test_a_network_without_a_decentralised_planner_is_refused(planner):
    text = TEXT.replace("[fleet]", f'[fleet]\nplanner = "{planner}"')
    with pytest.raises(ScenarioError, match="nobody else talks over it"):
        loads(text + "[network]\nloss = 0.1\n")


def test_a_decentralised_fleet_needs_replanning():
    with pytest.raises(ScenarioError, match=r"timing\.replan_period_s"):
        loads(ALONE.replace("duration_s = 200.0", "duration_s = 200.0\nreplan_period_s = 0.0"))


def test_too_many_aircraft_are_refused():
    head, tail = ALONE.split("[[aircraft]]", 1)
    aircraft_text = tail[: tail.index("[[aircraft]]")]
    further_aircraft = "".join(
        "[[aircraft]]"
        + aircraft_text.replace("alpha", f"a{k}")
        .replace("north_m = 9000.0", f"north_m = {9000 + 500 * k}.0")
        .replace("400", f"{400 + 10 * k}")
        for k in range(AIRCRAFT_MAX)
    )
    with pytest.raises(ScenarioError, match=f"at most {AIRCRAFT_MAX}"):
        loads(f"{head}{further_aircraft}[[aircraft]]{tail}")


def test_a_clock_as_fast_as_allowed_keeps_the_limits():
    """The reserve suffices for a path flown at either end of the clock range, by hand for its four causes."""
    scenario = loads(ALONE)
    fleet, limits = scenario.fleet, scenario.limits
    rate_range = greatest_rate_range(fleet.reserve, fleet.speed_m_s, limits, 12.0)
    assert (1.0 + rate_range) ** 2 * (1.0 - fleet.reserve) <= 1.0 + 1e-12
    slow = limits.speed_min_m_s + fleet.reserve * (fleet.speed_m_s - limits.speed_min_m_s)
    fast = limits.speed_max_m_s - fleet.reserve * (limits.speed_max_m_s - fleet.speed_m_s)
    # over the ground, in a wind against or along the flight
    for wind in (-12.0, 12.0):
        assert (1.0 - rate_range) * (slow + wind) - wind >= limits.speed_min_m_s - 1e-9
        assert (1.0 + rate_range) * (fast + wind) - wind <= limits.speed_max_m_s + 1e-9


def test_the_aircraft_with_the_least_reserve_bounds_the_clocks():
    scenario = loads(ALONE)
    limits = scenario.limits
    speed_m_s = limits.speed_min_m_s + 2.0  # a tenth of 2 m/s is left to fly more slowly
    slow = scenario.replace("network.rate_range", 1e-3, "aircraft[0].speed_m_s", speed_m_s)
    greatest = greatest_rate_range(scenario.fleet.reserve, speed_m_s, limits, scenario.wind.speed_max_m_s)
    assert 1e-3 < greatest < 3e-3
    with pytest.raises(ScenarioError, match=r"network.rate_range: arrived 0.01; expected at most 0.00"):
        slow.replace("network.rate_range", 0.01)


def test_limits_that_follow_from_the_performance_bound_the_clocks():
    scenario = loads(ALONE)
    fleet = resolve_fleet(scenario)
    guidance, (first, *others) = build_guidance(scenario, fleet), fleet
    weak = first.limits.with_defaults(speed_max_m_s=scenario.speed_for(first.table) + 2.0)
    with pytest.raises(ScenarioError, match=r"network.rate_range: arrived 0.03; expected at most 0.00"):
        build_planner(scenario, (dataclasses.replace(first, limits=weak), *others), guidance)


def test_the_network_table_builds_a_decentralised_planner():
    scenario = loads(
        f"{ALONE}\n[network]\ndelay_s = 0.5\nloss = 0.3\ntube_m = 40.0\n[separation]\nhorizontal_m = 300.0\n"
    )
    planner = build_flight(scenario).planner
    assert isinstance(planner, DecentralisedPlanner)
    assert int(planner.network.delay) == 5
    assert planner.network.slots > 5
    assert int(planner.network.period_samples) == 10
    assert float(planner.tube) == 40.0
    # twice the tube, and how far one flies while two clocks differ by the greatest skew
    fastest = float(np.max(planner.aircraft_planner.limits.speed_max))
    assert float(planner.aircraft_planner.airspace.separation.horizontal) == pytest.approx(
        300.0 + 10.0 + 80.0 + 0.5 * fastest
    )
    assert float(planner.aircraft_planner.airspace.separation.vertical) == 0.0


def test_an_airspeed_beyond_its_limits_is_no_problem_of_the_clock_rate():
    assert rate_range_problems(0.03, 0.1, -0.01) == []
    assert [problem.path for problem in rate_range_problems(0.03, 0.1, 0.0)] == ["network.rate_range"]
