"""Airspeeds against root finding on the isentropic law, the normal-shock relations, and published values."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ambiance import Atmosphere as AmbianceAtmosphere
from scipy.optimize import brentq

from anser.constants import AIR_HEAT_RATIO, SEA_LEVEL_PRESSURE_PA
from anser.environment import (
    Air,
    StandardAtmosphere,
    calibrated_from_true,
    true_from_calibrated,
)
from anser.environment.air import (
    AIRSPEED_FORMS,
    STANDARD_LAYERS,
    air_at_geopotential,
    air_in_layers,
    equivalent_from_true,
    impact_pressure_ratio,
    mach_from_impact_pressure,
    true_airspeed,
    true_from_equivalent,
)

GAMMA = AIR_HEAT_RATIO
ALTITUDES_M = np.linspace(0.0, 20_000.0, 9)
MACHS = np.linspace(0.1, 0.95, 12)


def ambiance_air(altitude_m):
    """Air of an independent implementation of the standard atmosphere (ICAO Doc 7488)."""
    air = AmbianceAtmosphere(altitude_m)
    return Air(*(float(values[0]) for values in (air.density, air.pressure, air.temperature, air.speed_of_sound)))


def isentropic_ratio(mach):
    """Total over static pressure, less 1: (1 + (g - 1)/2 M^2)^(g/(g - 1)) - 1."""
    return (1.0 + 0.5 * (GAMMA - 1.0) * mach**2) ** (GAMMA / (GAMMA - 1.0)) - 1.0


def test_the_calibrated_airspeed_of_the_requirement():
    """150 m/s calibrated at 10 km: 244.01 m/s true at geopotential, 243.82 at geometric altitude."""
    assert true_from_calibrated(150.0, air_at_geopotential(STANDARD_LAYERS, 10_000.0)) == pytest.approx(
        244.01, abs=5e-3
    )
    assert true_from_calibrated(150.0, air_in_layers(STANDARD_LAYERS, 10_000.0)) == pytest.approx(243.82, abs=5e-3)


@pytest.mark.parametrize("altitude_m", ALTITUDES_M)
def test_conversions_equal_root_finding_on_the_isentropic_law(altitude_m):
    """To 1e-9, in air from another package; the speed of sound at sea level is that package's too.

    ambiance has the gas constant 287.05287, this package R*/M = 287.05287 rounded differently: the sea-level constants
    agree to 2e-9, so the reference uses this package's sea level for calibration and ambiance's air aloft.
    """
    air = ambiance_air(altitude_m)
    sea_level = air_in_layers(STANDARD_LAYERS, 0.0)
    for mach in MACHS:
        impact = air.pressure * isentropic_ratio(mach)
        sea_level_mach = brentq(
            lambda m, q=impact: SEA_LEVEL_PRESSURE_PA * isentropic_ratio(m) - q, 1e-6, 1.0, xtol=1e-15, rtol=1e-14
        )
        true, calibrated = mach * air.speed_of_sound, sea_level_mach * float(sea_level.speed_of_sound)
        assert calibrated_from_true(true, air) == pytest.approx(calibrated, rel=1e-9)
        assert true_from_calibrated(calibrated, air) == pytest.approx(true, rel=1e-9)
        equivalent = np.sqrt(air.density * true**2 / float(sea_level.density))
        assert equivalent_from_true(true, air) == pytest.approx(equivalent, rel=1e-9)
        assert true_from_equivalent(equivalent, air) == pytest.approx(true, rel=1e-9)


def test_supersonic_impact_pressure_equals_normal_shock_relations():
    """Static pressure and Mach number behind a normal shock, then isentropic deceleration ([ANDERSON] section 8.6)."""
    for mach in (1.05, 1.4, 2.0, 3.5):
        behind = np.sqrt((1.0 + 0.2 * mach**2) / (GAMMA * mach**2 - 0.2))
        shock = 1.0 + 2.0 * GAMMA / (GAMMA + 1.0) * (mach**2 - 1.0)
        ratio = shock * (1.0 + isentropic_ratio(behind)) - 1.0
        assert impact_pressure_ratio(mach) == pytest.approx(ratio, rel=1e-12)
        assert mach_from_impact_pressure(ratio) == pytest.approx(mach, rel=1e-12)


def test_conversions_are_inverse_through_mach_1():
    air = air_in_layers(STANDARD_LAYERS, 3000.0)
    true = np.concatenate([[0.0, 1e-6, 2e-3], np.linspace(0.1, 900.0, 400)])
    assert true_from_calibrated(calibrated_from_true(true, air), air) == pytest.approx(true, rel=1e-11, abs=1e-15)


@pytest.mark.long
def test_gradients_are_finite_and_equal_differences():
    """From standstill to beyond Mach 1, by airspeed and by altitude."""

    def calibrated(airspeed, altitude):
        return calibrated_from_true(airspeed, StandardAtmosphere().at(altitude))

    gradient = jax.jit(jax.vmap(jax.grad(calibrated, argnums=(0, 1))))
    speeds, heights = jnp.array([0.0, 1e-3, 40.0, 150.0, 320.0, 500.0]), jnp.full(6, 7000.0)
    by_speed, by_height = gradient(speeds, heights)
    assert np.isfinite(by_speed).all()
    assert np.isfinite(by_height).all()
    for k in range(2, 6):
        low, high = (float(calibrated(speeds[k] + d, heights[k])) for d in (-1e-2, 1e-2))
        assert by_speed[k] == pytest.approx((high - low) / 2e-2, rel=1e-6)
        low, high = (float(calibrated(speeds[k], heights[k] + d)) for d in (-1.0, 1.0))
        assert by_height[k] == pytest.approx((high - low) / 2.0, rel=1e-6)
    # at standstill the air is incompressible: the slope is the root of the density ratio
    density_ratio = StandardAtmosphere().at(7000.0).density / 1.2250
    assert by_speed[0] == pytest.approx(np.sqrt(density_ratio), rel=1e-4)  # rounded sea-level density


def test_numbers_of_every_form_give_the_same_true_airspeed():
    air = air_in_layers(STANDARD_LAYERS, 5000.0)
    values = (200.0, calibrated_from_true(200.0, air), equivalent_from_true(200.0, air), 200.0 / air.speed_of_sound)
    for form, value in zip(AIRSPEED_FORMS, values, strict=True):
        assert true_airspeed(form, value, air) == pytest.approx(200.0, rel=1e-12), form
