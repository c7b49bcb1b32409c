"""Gains by bandwidth and damping in a scenario, and cautions about valid but unwise settings."""

from pathlib import Path

import numpy as np
import pytest

from anser.config import ScenarioError
from anser.scenario import build_flight, load, loads
from anser.scenario.build_aircraft import resolve_fleet
from anser.scenario.cautions import find_cautions

SCENARIOS = Path(__file__).parents[2] / "scenarios"
TEXT = (SCENARIOS / "single-aircraft.toml").read_text()


def _with(gains):
    return TEXT.replace("[[goal]]", f"{gains}\n\n[[goal]]", 1)


def test_bandwidth_and_damping_become_gains():
    design = _with("[aircraft.gains.attitude]\nbandwidth_rad_s = [2.0, 2.5, 3.0]\ndamping = 2.5\nderivative = 0.5")
    attitude = build_flight(loads(design)).groups[0].vehicles.batched.controller.gains.attitude
    np.testing.assert_allclose(attitude.proportional[0], [3.0, 3.75, 4.5])
    np.testing.assert_allclose(attitude.integral[0], 1.5 * (np.array([2.0, 2.5, 3.0]) / 5.0) ** 2)
    without = (
        build_flight(loads(_with("[aircraft.gains.velocity]\nbandwidth_rad_s = 1")))
        .groups[0]
        .vehicles.batched.controller.gains.velocity
    )
    np.testing.assert_array_equal(without.integral[0], np.zeros(3))


@pytest.mark.parametrize(
    ("gains", "message"),
    [
        (
            "[aircraft.gains.rates]\nbandwidth_rad_s = 5\nproportional = 10",
            'gains.rates.proportional (aircraft "aircraft-1"): arrived 10 beside',
        ),
        (
            "[aircraft.gains.rates]\nbandwidth_rad_s = 5\nintegral = 1",
            "arrived 1 beside bandwidth_rad_s; expected either",
        ),
        (
            "[aircraft.gains.rates]\ndamping = 1",
            'gains.rates.damping (aircraft "aircraft-1"): arrived 1 without bandwidth',
        ),
        (
            "[aircraft.gains.rates]\nbandwidth_rad_s = 5\ndamping = [1, 1, 0.05]",
            "arrived 0.05; expected a number from 0.1",
        ),
        ("[aircraft.gains.rates]\nbandwith_rad_s = 5", 'perhaps "bandwidth_rad_s"'),
        ('[aircraft.gains]\ninversion = "incremantal"', 'expected "model" or "incremental" or "adaptive"'),
    ],
)
def test_a_refusal_names_the_expected_value(gains, message):
    with pytest.raises(ScenarioError) as refused:
        loads(_with(gains))
    assert message in str(refused.value)


def test_loops_too_close_in_time_are_named_and_the_defaults_are_not():
    assert find_cautions(loads(TEXT)) == ()
    (said,) = find_cautions(loads(_with("[aircraft.gains.velocity]\nproportional = [1.0, 1.6, 1.0]")))
    assert said == (
        'aircraft[0].gains (aircraft "aircraft-1"): the loop of gamma has a bandwidth of 1.6 1/s and rests on alpha with '
        "2 1/s, a ratio of 1.25; below 2 the two swing against each other (damping 0.56)"
    )


@pytest.mark.long
def test_loops_that_follow_from_another_aircraft_are_those_that_are_compared():
    uavs = load(SCENARIOS / "three-uavs.toml").replace("aircraft[0].gains.velocity.proportional", [1.0, 1.6, 1.0])
    assert find_cautions(uavs, with_trim_maps=False) == ()
    gains = resolve_fleet(uavs)[0].gains
    ratio = float(gains.attitude.proportional[1]) / 1.6
    (said,) = find_cautions(uavs)
    assert f"the loop of gamma has a bandwidth of 1.6 1/s and rests on alpha with {1.6 * ratio:.3g} 1/s" in said
    slow = uavs.replace("aircraft[0].gains.velocity.proportional", [1.0, 1.2, 1.0])  # too fast for the F-16's 2 1/s
    assert find_cautions(slow) == ()


def test_a_seed_that_changes_nothing_says_so():
    assert find_cautions(loads(TEXT)) == ()
    said = find_cautions(loads(TEXT.replace("format = 2", "format = 2\nseed = 7", 1)))
    assert len(said) == 1
    assert said[0].startswith("seed: 7 is recorded and changes nothing: nothing in this flight is random")
    rough = TEXT.replace("format = 2", "format = 2\nseed = 7", 1) + '\n[turbulence]\nintensity = "light"\n'
    assert find_cautions(loads(rough)) == ()
    own = TEXT.replace("format = 2", "format = 2\nseed = 7", 1) + '\n[parts]\nsensors = "my_package:Sensors"\n'
    assert find_cautions(loads(own)) == ()


SHEARED = """
format = 2
name = "down-through-a-shear"

[timing]
duration_s = 95.0

[fleet]
speed_m_s = 150.0
planner = "published"

[wind]
layers = [
  { altitude_m = 300, speed_m_s = 20.0, from_deg = 180 },
  { altitude_m = 4000, speed_m_s = 20.0, from_deg = 0 },
]

[[aircraft]]
name = "one"
goal = "buoy"
start = { north_m = -14000, east_m = 0, altitude_m = 3000, speed_m_s = 150, course_deg = 0 }

[[goal]]
name = "buoy"
kind = "surface"
north_m = 0.0
east_m = 0.0
"""
"""Planned in 87.0 s at 173.2 m/s, which the idle engine forces; the wind lower down brings it there in 82.1 s."""


def test_a_duration_that_suffices_is_accepted_with_a_caution():
    scenario = loads(SHEARED)
    (said,) = find_cautions(scenario)
    # against 9.19 m/s at the start, 14 km to go and 2700 m down: 101.1 s at 150 m/s
    assert "timing.duration_s: 95 s suffices only if a descent makes the plan faster or another wind carries" in said
    assert "otherwise expected more than 101.1 s" in said
    assert find_cautions(scenario.replace("timing.duration_s", 110.0)) == ()


def test_a_duration_that_nothing_makes_suffice_is_refused():
    # sqrt(150^2 + 2 * 9.80665 * 2700) m/s without any drag, and 29.2 m/s of wind between start and lowest layer
    with pytest.raises(ScenarioError, match=r"expected more than 48\.4 s, .* layers of wind may make 303\.9 m/s"):
        loads(SHEARED.replace("duration_s = 95.0", "duration_s = 40.0"))
    level = SHEARED.replace("altitude_m = 3000", "altitude_m = 300")
    steady = level[: level.index("[wind]")] + level[level.index("[[aircraft]]") :]
    with pytest.raises(ScenarioError, match=r"expected more than 93\.3 s, .* at fleet\.speed_m_s = 150 m/s$"):
        loads(steady.replace("duration_s = 95.0", "duration_s = 93.0"))
