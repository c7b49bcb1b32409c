"""Capability of an aircraft by its trim map: the limits are flyable, and obstacles exist beyond them."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.environment import standard_environment
from anser.steady import trim_target
from anser.steady.performance import capability_from_points, capability_points
from anser.steady.trim import trim_map_point
from support.light_aircraft import light_aircraft

ENVIRONMENT, AIRFRAME = standard_environment(), light_aircraft()
ALTITUDE, SPEED, SPEEDS = 500.0, 53.0, (15.0, 120.0)


@jax.jit
def points_of(airframe, speed):
    return capability_points(airframe, ENVIRONMENT, ALTITUDE, speed, SPEEDS)


@jax.jit
def point_of(speed, path_angle, turn_rate):
    return trim_map_point(AIRFRAME, ENVIRONMENT, trim_target(speed, ALTITUDE, path_angle, 0.0, turn_rate))


@pytest.fixture(scope="module")
def capability():
    return capability_from_points(AIRFRAME, points_of(AIRFRAME, SPEED), SPEED, SPEEDS)


def smallest_margin(speed, path_angle=0.0, turn_rate=0.0):
    """Smallest margin of power, surfaces and angle of attack (in units of 20 deg); negative without trim."""
    point = point_of(speed, path_angle, turn_rate)
    if not bool(point.trimmable):
        return -1.0
    alpha = (float(AIRFRAME.alpha_range[1]) - float(point.trim.alpha)) / np.radians(20.0)
    return min(float(point.power_margin), float(jnp.min(point.surface_margin)), alpha)


def test_airspeeds_of_level_flight(capability):
    step = (SPEEDS[1] / SPEEDS[0]) ** (1 / 63)
    assert SPEEDS[0] < capability.speed_min < SPEED < capability.speed_max < SPEEDS[1]
    for end, outside in (
        (capability.speed_min, capability.speed_min / step),
        (capability.speed_max, capability.speed_max * step),
    ):
        assert smallest_margin(end) >= 0.1 - 1e-9
        assert smallest_margin(outside) < 0.1
    # the stall: lift of 10 deg, 2 deg below the end of the data, carries the weight at the least airspeed
    assert capability.speed_min == pytest.approx(33.0, rel=0.05)


@pytest.mark.long
def test_turns_and_climbs(capability):
    rate = 9.80665 * np.tan(capability.bank_max) / SPEED
    assert smallest_margin(SPEED, turn_rate=rate) >= 0.1 - 1e-9
    assert smallest_margin(SPEED, turn_rate=9.80665 * np.tan(capability.bank_max + np.radians(5.0)) / SPEED) < 0.1
    # a coordinated level turn, but for thrust along the lift
    assert capability.load_factor_max == pytest.approx(1 / np.cos(capability.bank_max), rel=0.02)
    assert smallest_margin(SPEED, np.arcsin(capability.climb_rate_max / SPEED)) >= 0.1 - 1e-9
    assert smallest_margin(SPEED, np.arcsin(capability.climb_rate_max / SPEED) + np.radians(1.5)) < 0.1
    assert capability.sink_rate_max > 0.0


def test_less_power_climbs_and_reaches_less(capability):
    weak = eqx.tree_at(lambda a: a.mass_properties.mass, AIRFRAME, 1.3 * AIRFRAME.mass_properties.mass)
    heavy = capability_from_points(weak, points_of(weak, SPEED), SPEED, SPEEDS)
    assert heavy.speed_min > capability.speed_min
    assert heavy.climb_rate_max < capability.climb_rate_max
    assert heavy.bank_max <= capability.bank_max


def test_an_aircraft_that_cannot_fly_level_has_no_airspeeds():
    airframe = eqx.tree_at(lambda a: a.mass_properties.mass, AIRFRAME, 100.0 * AIRFRAME.mass_properties.mass)
    impossible = capability_from_points(airframe, jax.tree.map(np.asarray, points_of(airframe, SPEED)), SPEED, SPEEDS)
    assert np.isnan(impossible.speed_min)
    assert impossible.bank_max == 0.0
    assert impossible.climb_rate_max == 0.0
