"""Origins unsuitable for planning in the Earth's chart are refused with a suitable latitude."""

import math
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.config import ScenarioError
from anser.environment import wgs84_earth
from anser.scenario import loads
from anser.scenario.schema_chart import scale_error
from anser.scenario.schema_tables import ScenarioTables
from anser.units import DEG_RAD

TEXT = (Path(__file__).parents[2] / "scenarios" / "three-aircraft.toml").read_text()


def _at(latitude_deg, model="wgs84", text=TEXT, longitude_deg=180.0):
    earth = f'[earth]\nmodel = "{model}"\nlatitude_deg = {latitude_deg}\nlongitude_deg = {longitude_deg}\n\n[timing]'
    return loads(text.replace("[timing]", earth, 1))


def _refusal(*args, **options):
    with pytest.raises(ScenarioError) as refused:
        _at(*args, **options)
    (problem,) = refused.value.problems
    assert problem.path == "earth.latitude_deg"
    return problem


@pytest.mark.parametrize("model", ["flat", "wgs84"])
@pytest.mark.parametrize("latitude_deg", [0.0, 45.0, -70.0, 80.0])
def test_most_origins_are_accepted(latitude_deg, model):
    for longitude_deg in (-180.0, 0.0, 180.0):
        assert _at(latitude_deg, model, longitude_deg=longitude_deg).earth.latitude_deg == latitude_deg


@pytest.mark.parametrize("latitude_deg", [89.0, 89.99, -89.99])
def test_an_origin_too_near_to_a_pole_is_refused_and_the_one_advised_is_not(latitude_deg):
    problem = _refusal(latitude_deg)
    assert problem.arrived.startswith(f"{latitude_deg:g}, whose chart has ")
    advised = re.match(r"(-?[\d.]+) or nearer to the equator for this fleet, or places nearer", problem.expected)
    assert advised, problem.expected
    best = float(advised.group(1))
    assert _at(best).earth.latitude_deg == best
    _refusal(best + math.copysign(0.1, best))


def test_positions_beyond_the_pole_are_reported():
    assert "at or beyond the pole" in _refusal(89.99).arrived
    assert "where its lengths are wrong by 17 %" in _refusal(89.5).arrived


def test_a_place_too_far_from_the_origin_is_refused():
    distant = TEXT.replace("north_m = 1000.0", "north_m = 300000.0").replace("duration_s = 150", "duration_s = 3600")
    assert distant != TEXT
    assert "aircraft[" in _refusal(60.0, text=distant).arrived
    assert _at(30.0, text=distant).earth.latitude_deg == 30.0


def test_an_origin_where_north_turns_too_fast_is_refused():
    """150 m/s * tan(87 deg) / 6335 km is 0.0259 deg/s; a fleet slower by a quarter is accepted."""
    problem = _refusal(87.0)
    assert "where north turns by 0.026 deg/s under a flight east at 150 m/s" in problem.arrived
    assert problem.expected.startswith("86.1 or nearer to the equator")
    assert "a slower fleet (fleet.speed_m_s)" in problem.expected
    by_mach = re.sub(r"(\[fleet\][^\[]*)speed_m_s = 150.0", r"\1mach = 0.45", TEXT)
    assert "a slower fleet (fleet.mach)" in _refusal(87.0, text=by_mach).expected
    assert _at(87.0, text=TEXT.replace("speed_m_s = 150.0", "speed_m_s = 112.0"))
    assert _at(87.0, "flat")


def test_the_fastest_aircraft_counts_for_the_turn_of_north():
    fleet = TEXT.replace("speed_m_s = 150.0", "speed_m_s = 112.0").replace('planner = "published"', "")
    fast = re.sub(r'(\[\[aircraft\]\]\nname = "aircraft-2")', r"\1\nspeed_m_s = 150.0", fleet)
    problem = _refusal(87.0, text=fast)
    assert "north turns by 0.026 deg/s under a flight east at 150 m/s" in problem.arrived
    assert problem.expected.endswith('or a slower aircraft "aircraft-2": plans bear 0.02 deg/s')


@pytest.mark.parametrize("model", ["flat", "wgs84"])
def test_a_flight_that_can_reach_the_pole_is_refused(model):
    """Two hours at 240 m/s with return are 864 km; both Earth models need a latitude."""
    long = TEXT.replace("duration_s = 150", "duration_s = 7200")
    for moving in ("speed_m_s = 25.0", "speed_m_s = 15.0"):
        assert moving in long
        long = long.replace(moving, "speed_m_s = 0.0")
    problem = _refusal(83.0, model, text=long)
    assert "turns back after 864 km" in problem.arrived
    assert _at(float(problem.expected.split()[0]), model, text=long)


def test_the_greatest_airspeed_limit_of_the_fleet_counts_for_the_reach(monkeypatch):
    long = TEXT.replace("duration_s = 150", "duration_s = 7200").replace("speed_m_s = 25.0", "speed_m_s = 0.0")

    def limits_for(scenario, aircraft):
        is_fast = aircraft.name == "aircraft-2"
        return scenario.limits.with_defaults(speed_max_m_s=300.0) if is_fast else scenario.limits

    monkeypatch.setattr(ScenarioTables, "limits_for", limits_for)
    assert (
        "turns back after 1080 km" in _refusal(82.0, text=long.replace("speed_m_s = 15.0", "speed_m_s = 0.0")).arrived
    )


def test_a_flat_earth_needs_a_latitude_too():
    assert "can cross the pole or the meridian" in _refusal(89.99, "flat").arrived
    assert _at(89.5, "flat").earth.latitude_deg == 89.5


def test_a_latitude_outside_the_range_is_refused_with_the_range():
    with pytest.raises(ScenarioError, match=r"earth\.latitude_deg: arrived 90; expected .*-89\.99 to 89\.99"):
        _at(90)


@pytest.mark.parametrize("latitude_deg", [0.0, 45.0, -70.0, 88.0])
def test_the_scale_error_bounds_the_error_of_the_chart(latitude_deg):
    """The sphere of smallest curvature radius adds 1 % to the error; heights up to 5 km, which are neglected, 0.1 %."""
    earth = wgs84_earth(latitude_deg * DEG_RAD, 0.3)
    local = jax.jit(lambda position_n: earth.local_earth(position_n, jnp.zeros(3)).chart_scale)
    for reach_m in (5e3, 5e4, 2e5):
        for angle in np.linspace(0.0, 2.0 * np.pi, 9):
            north_m, east_m = reach_m * np.cos(angle), reach_m * np.sin(angle)
            scale = np.asarray(local(jnp.array([north_m, east_m, -5e3])))[:2]
            promised, true = scale_error(latitude_deg, north_m, east_m), np.max(np.maximum(scale, 1.0 / scale)) - 1.0
            assert promised > 0.2 or abs(promised - true) < 1e-3 + 0.025 * true
