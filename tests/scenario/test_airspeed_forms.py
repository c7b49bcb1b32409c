"""Airspeeds of a scenario as calibrated or equivalent airspeed or Mach number: true airspeed, refusals and round trip."""

import json

import pytest

from anser.config import ScenarioError
from anser.environment.air import (
    AIR_GAS_CONSTANT_J_KG_K,
    STANDARD_LAYERS,
    air_at_geopotential,
    air_in_layers,
    altimeter_setting_in_layers,
    density_altitude,
    pressure_altitude,
    standard_layers,
    true_airspeed,
)
from anser.scenario import loads
from anser.scenario.files import starter_scenario
from anser.scenario.schema import validate

STARTER = loads(starter_scenario())


@pytest.mark.parametrize(("form", "value"), [("speed_cas_m_s", 140.0), ("speed_eas_m_s", 139.0), ("mach", 0.46)])
def test_a_start_has_the_true_airspeed_of_its_altitude(form, value):
    scenario = STARTER.replace("aircraft[0].start.speed_m_s", None, f"aircraft[0].start.{form}", value)
    start = scenario.aircraft[0].start
    air = air_in_layers(STANDARD_LAYERS, start.altitude_m)
    assert start.airspeed_m_s == float(true_airspeed(form, value, air))
    assert start.speed_m_s is None
    again = validate(json.loads(scenario.model_dump_json(exclude_unset=True)))
    assert again == scenario
    assert again.hash == scenario.hash != STARTER.hash


def test_the_airspeed_of_the_fleet_is_that_at_the_mean_start_altitude():
    scenario = STARTER.replace("fleet.speed_m_s", None, "fleet.speed_cas_m_s", 140.0)
    mean_m = sum(aircraft.start.altitude_m for aircraft in STARTER.aircraft) / len(STARTER.aircraft)
    air = air_in_layers(STANDARD_LAYERS, mean_m)
    assert scenario.fleet.airspeed_m_s == float(true_airspeed("speed_cas_m_s", 140.0, air))
    assert scenario.speed_for(scenario.aircraft[0]) == scenario.fleet.airspeed_m_s


def test_two_airspeeds_or_none_are_refused():
    with pytest.raises(ScenarioError, match=r"start.mach .*arrived speed_m_s = 150 and mach = 0.45; expected one of"):
        STARTER.replace("aircraft[0].start.mach", 0.45)
    with pytest.raises(ScenarioError, match=r"fleet.speed_m_s: arrived nothing; expected an airspeed: one of"):
        STARTER.replace("fleet.speed_m_s", None)


def test_density_altitude_of_hot_and_cold_days_equals_the_gas_law():
    """At 1500 m of pressure altitude, 30 K above and 40 K below the standard: density p/(R T), inverted by hand.

    In the lowest layer the standard's density is rho0 (1 - 6.5e-3 h/T0)^4.25588, so h follows from a power.
    """
    exponent = 9.80665 / (AIR_GAS_CONSTANT_J_KG_K * 6.5e-3) - 1.0
    sea_level_density = 101325.0 / (AIR_GAS_CONSTANT_J_KG_K * 288.15)
    for offset in (30.0, -40.0):
        pressure = float(air_at_geopotential(STANDARD_LAYERS, 1500.0).pressure)
        density = pressure / (AIR_GAS_CONSTANT_J_KG_K * (288.15 - 6.5e-3 * 1500.0 + offset))
        by_hand = 288.15 / 6.5e-3 * (1.0 - (density / sea_level_density) ** (1.0 / exponent))
        assert density_altitude(density) == pytest.approx(by_hand, abs=1e-8)
        assert pressure_altitude(pressure) == pytest.approx(1500.0, abs=1e-8)


def test_the_altimeter_setting_is_the_pressure_at_sea_level():
    assert altimeter_setting_in_layers(STANDARD_LAYERS) == pytest.approx(101325.0, rel=1e-12)
    assert altimeter_setting_in_layers(standard_layers(20.0, 99000.0)) == pytest.approx(99000.0, rel=1e-12)
