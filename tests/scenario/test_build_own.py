"""Gains, limits and airspeeds derived from the aircraft; values in the scenario take precedence."""

import jax
import numpy as np
import pytest

from anser.config import ScenarioError
from anser.control import published_gains
from anser.scenario import build_flight, loads
from anser.scenario.build_aircraft import _exceeds_capability, resolve_fleet
from anser.scenario.cautions import find_cautions

AIRCRAFT = """
[[aircraft]]
name = "{name}"
type = "{type}"
goal = "ship"
start = {{ north_m = {north}, east_m = 0.0, altitude_m = 300.0, speed_m_s = {speed}, course_deg = 0.0 }}
rendezvous = {{ stand_off_up_m = {up} }}
{more}
"""
TEXT = """
format = 2
name = "own"
timing.duration_s = 300.0
fleet.speed_m_s = {speed}
hold.radius_m = 3000.0
{limits}
[[goal]]
name = "ship"
kind = "surface"
north_m = 3500.0
east_m = 0.0
altitude_m = 0.0
speed_m_s = 3.0
course_deg = 90.0
"""


def uav(**changes):
    return AIRCRAFT.format(
        **{"name": "uav", "type": "aerosonde", "north": 0.0, "speed": 25.0, "up": 200.0, "more": "", **changes}
    )


def jet(**changes):
    return AIRCRAFT.format(
        **{"name": "jet", "type": "f16", "north": -9000.0, "speed": 150.0, "up": 900.0, "more": "", **changes}
    )


def scenario(*aircraft, speed=25.0, limits=""):
    return loads(TEXT.format(speed=speed, limits=limits) + "".join(aircraft))


@pytest.fixture(scope="module")
def uav_scenario():
    return scenario(uav())


@pytest.fixture(scope="module")
def capability(uav_scenario):
    return resolve_fleet(uav_scenario)[0].capability


def test_limits_left_out_follow_from_the_trim_map(uav_scenario, capability):
    limits = resolve_fleet(uav_scenario)[0].limits
    # its data hold from 13 to 40 m/s; with a tenth of power and elevator left it flies level from 17 to 29
    assert 15.0 < capability.speed_min < 18.0
    assert 28.0 < capability.speed_max < 32.0
    assert capability.speed_min < limits.speed_min_m_s < 25.0 < limits.speed_max_m_s == capability.speed_max
    assert limits.bank_max_deg == 45.0
    assert limits.climb_rate_max_m_s == pytest.approx(min(capability.climb_rate_max, capability.sink_rate_max))
    # at the least airspeed the lift of that bank is the lift of level flight at the least trimmable one
    assert limits.speed_min_m_s == pytest.approx(capability.speed_min / np.sqrt(np.cos(np.radians(45.0))))
    planner = build_flight(uav_scenario).planner
    np.testing.assert_allclose(planner.limits.bank_max, 0.9 * np.radians(45.0))


def test_limits_of_the_scenario_take_precedence_with_a_caution(capability):
    limited = scenario(uav(), limits="limits = { bank_max_deg = 80.0, climb_rate_max_m_s = 2.0 }")
    limits = resolve_fleet(limited)[0].limits
    assert (limits.bank_max_deg, limits.climb_rate_max_m_s) == (80.0, 2.0)
    cautions = [text for text in find_cautions(limited) if text.startswith("limits.")]
    assert len(cautions) == 1
    assert f"banks in level turns at most {np.degrees(capability.bank_max):.1f} deg" in cautions[0]


def test_a_caution_on_the_climb_rate_counts_descents_too(capability):
    limited = scenario(uav(), limits="limits = { climb_rate_max_m_s = 2.0 }")
    limits = resolve_fleet(limited)[0].limits
    (said,) = _exceeds_capability(limited, limits, 0, capability._replace(sink_rate_max=1.5))
    assert said == 'limits.climb_rate_max_m_s = 2: aircraft[0] "uav" descends steadily at most at 1.5 m/s (at 25 m/s)'
    assert _exceeds_capability(limited, limits, 0, capability) == ()


def test_gains_derive_from_the_aircraft_unless_the_scenario_has_them(uav_scenario):
    derived = resolve_fleet(uav_scenario)[0].gains
    # actuators of 0.05 s bear the published bandwidths, its sampling does not bear more; its stiffness asks for pitch
    published = published_gains().rates.proportional
    np.testing.assert_allclose(derived.rates.proportional[np.array([0, 2])], published[np.array([0, 2])])
    assert published[1] < derived.rates.proportional[1] < 1.5 * published[1]
    scenario_with_gains = scenario(uav(more="[aircraft.gains.velocity]\nproportional = [0.5, 0.4, 0.3]"))
    gains = resolve_fleet(scenario_with_gains)[0].gains
    np.testing.assert_array_equal(gains.velocity.proportional, [0.5, 0.4, 0.3])
    np.testing.assert_array_equal(gains.rates.proportional, derived.rates.proportional)


def test_the_library_f16_keeps_its_gains_and_limits():
    jet_scenario = scenario(jet(), speed=150.0)
    for gain, published in zip(
        jax.tree.leaves(resolve_fleet(jet_scenario)[0].gains),
        jax.tree.leaves(published_gains()),
        strict=True,
    ):
        np.testing.assert_array_equal(gain, published)
    assert resolve_fleet(jet_scenario)[0].limits == jet_scenario.limits


def test_a_mixed_fleet_has_limits_and_airspeeds_by_aircraft():
    mixed = scenario(jet(), uav(more="speed_m_s = 25.0"), speed=150.0)
    planner = build_flight(mixed).planner
    np.testing.assert_array_equal(planner.speed, [150.0, 25.0])
    assert planner.limits.speed_min[0] > 80.0
    assert planner.limits.speed_max[1] < 30.0


@pytest.mark.parametrize(
    ("make", "path", "expected"),
    [
        (lambda: scenario(jet(), uav(), speed=150.0), "fleet.speed_m_s", "those of aerosonde; aircraft\\[\\].speed_m_s"),
        (lambda: scenario(uav(more="speed_m_s = 60.0")), "aircraft\\[0\\].speed_m_s", "a speed between limits.speed_min"),
        (
            lambda: loads(TEXT.format(speed=25.0, limits="").replace("= 25.0\n", '= 25.0\nfleet.planner = "published"\n', 1) + uav(more="speed_m_s = 24.0")),
            "aircraft\\[0\\].speed_m_s",
            "certified",
        ),
        (lambda: scenario(uav(speed=60.0)), "aircraft\\[0\\].start.speed_m_s", "13 to 40 m/s"),
    ],
)  # fmt: skip
def test_airspeeds_that_do_not_suit_an_aircraft_are_refused(make, path, expected):
    with pytest.raises(ScenarioError, match=f"(?s){path}.*{expected}"):
        make()


@pytest.mark.long
def test_limits_left_out_are_those_of_the_scenario_s_air(uav_scenario, capability):
    thin = resolve_fleet(uav_scenario.replace("atmosphere.temperature_offset_k", 40.0))[0].capability
    density_ratio = 288.15 / (288.15 + 40.0)  # about, below 200 m
    assert thin.speed_min == pytest.approx(capability.speed_min / np.sqrt(density_ratio), rel=0.03)
    assert thin.climb_rate_max < 0.9 * capability.climb_rate_max
