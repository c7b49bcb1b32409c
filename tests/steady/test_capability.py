"""What an aircraft can do by its trim map: the ends are flyable, and beyond them something stands in the way."""

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


@eqx.filter_jit
def points_of(airframe, speed):
    return capability_points(airframe, ENVIRONMENT, ALTITUDE, speed, SPEEDS)


@eqx.filter_jit
def point_of(speed, path_angle, turn_rate):
    return trim_map_point(AIRFRAME, ENVIRONMENT, trim_target(speed, ALTITUDE, path_angle, 0.0, turn_rate))


@pytest.fixture(scope="module")
def able():
    return capability_from_points(AIRFRAME, points_of(AIRFRAME, SPEED), SPEED, SPEEDS)


def left(speed, path_angle=0.0, turn_rate=0.0):
    """Least part of power, surfaces and (in units of 20 deg) angle of attack that is left; below 0 without trim."""
    point = point_of(speed, path_angle, turn_rate)
    if not bool(point.trimmable):
        return -1.0
    alpha = (float(AIRFRAME.alpha_range[1]) - float(point.trim.alpha)) / np.radians(20.0)
    return min(float(point.power_margin), float(jnp.min(point.surface_margin)), alpha)


def test_airspeeds_of_level_flight(able):
    step = (SPEEDS[1] / SPEEDS[0]) ** (1 / 63)
    assert SPEEDS[0] < able.speed_min < SPEED < able.speed_max < SPEEDS[1]
    for end, beyond in ((able.speed_min, able.speed_min / step), (able.speed_max, able.speed_max * step)):
        assert left(end) >= 0.1 - 1e-9
        assert left(beyond) < 0.1
    # the stall: lift of 10 deg, 2 deg below the end of the data, carries the weight at the least airspeed
    assert able.speed_min == pytest.approx(33.0, rel=0.05)


def test_turns_and_climbs(able):
    rate = 9.80665 * np.tan(able.bank_max) / SPEED
    assert left(SPEED, turn_rate=rate) >= 0.1 - 1e-9
    assert left(SPEED, turn_rate=9.80665 * np.tan(able.bank_max + np.radians(5.0)) / SPEED) < 0.1
    # a coordinated level turn, but for thrust along the lift
    assert able.load_factor_max == pytest.approx(1 / np.cos(able.bank_max), rel=0.02)
    assert left(SPEED, np.arcsin(able.climb_rate_max / SPEED)) >= 0.1 - 1e-9
    assert left(SPEED, np.arcsin(able.climb_rate_max / SPEED) + np.radians(1.5)) < 0.1
    assert able.sink_rate_max > 0.0


def test_less_power_climbs_and_reaches_less(able):
    weak = eqx.tree_at(lambda a: a.mass_properties.mass, AIRFRAME, 1.3 * AIRFRAME.mass_properties.mass)
    heavy = capability_from_points(weak, points_of(weak, SPEED), SPEED, SPEEDS)
    assert heavy.speed_min > able.speed_min
    assert heavy.climb_rate_max < able.climb_rate_max
    assert heavy.bank_max <= able.bank_max


def test_an_aircraft_that_cannot_fly_level_has_no_airspeeds():
    airframe = eqx.tree_at(lambda a: a.mass_properties.mass, AIRFRAME, 100.0 * AIRFRAME.mass_properties.mass)
    found = capability_from_points(airframe, jax.tree.map(np.asarray, points_of(airframe, SPEED)), SPEED, SPEEDS)
    assert np.isnan(found.speed_min)
    assert found.bank_max == 0.0
    assert found.climb_rate_max == 0.0
