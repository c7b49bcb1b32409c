"""Performance along the path, compared with trims at other airspeeds and with a flight at idle."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft import air_data_and_forces
from anser.aircraft_files import load_airframe
from anser.compiling.options import compiled_quickly
from anser.environment import standard_environment
from anser.steady import TrimTarget, solve_trim, trim_target
from anser.steady.performance import performance_at
from support.light_aircraft import light_aircraft
from support.states import condition_of

STILL = standard_environment()
F16 = load_airframe("f16", "textbook")
GRAVITY = 9.80665


solved = compiled_quickly(solve_trim)


def performance_of(airframe, speed, altitude):
    zero = jnp.zeros(())
    point = solve_trim(airframe, STILL, TrimTarget(speed, altitude, zero, zero, zero, zero, zero))
    return performance_at(airframe, STILL, air_data_and_forces(airframe, STILL, 0.0, point.state), point.state.surfaces)


compiled_performance = compiled_quickly(performance_of)


def performance(airframe, speed, altitude):
    return compiled_performance(airframe, jnp.asarray(speed), jnp.asarray(altitude))


def against_path(airframe, speed, altitude, load_factor):
    """Drag less idle thrust per mass of the aircraft trimmed at an airspeed and load factor, m/s^2."""
    push_rad_s = (load_factor - 1.0) * GRAVITY / speed
    point = solved(airframe, STILL, trim_target(speed, altitude, path_rate=push_rad_s))
    assert point.converged
    condition = condition_of(airframe, STILL, 0.0, point.state)
    data = condition.air_data
    idle = airframe.engine.propulsion(0.0, data).force_b
    force = np.asarray(condition.aerodynamic.force_b + idle)
    direction_b = [np.cos(data.alpha) * np.cos(data.beta), np.sin(data.beta), np.sin(data.alpha) * np.cos(data.beta)]
    return -float(np.dot(force, direction_b)) / float(airframe.mass_properties.mass)


@pytest.mark.long
@pytest.mark.parametrize("speed", [95.0, 115.0, 134.0, 164.0, 200.0])
@pytest.mark.parametrize("load_factor", [1.0, 0.75, 0.5])
def test_idle_deceleration_equals_trims_at_other_airspeeds(speed, load_factor):
    performance_164 = performance(F16, 164.0, 1500.0)
    expected = against_path(F16, speed, 1500.0, load_factor)
    deceleration = float(performance_164.deceleration * performance_164.idle.share(speed, load_factor))
    # The surfaces stay where they are at 164 m/s: 2 % of the drag. Between entries 40 m/s apart a chord lies above the
    # curve, and half unloaded the parabola through 1 and 0.75 is another's: 0.06 m/s^2 together.
    assert deceleration == pytest.approx(expected, rel=0.03, abs=0.06)


@pytest.mark.long
def test_the_deceleration_at_the_start_equals_the_trim():
    able = performance(F16, 150.0, 1000.0)
    assert float(able.deceleration) == pytest.approx(against_path(F16, 150.0, 1000.0, 1.0), rel=1e-12)
    # But for sideslip and the drag of the engine's angular momentum that it holds against.
    assert float(able.idle.share(150.0, 1.0)) == pytest.approx(1.0, abs=0.01)
    assert 5.0 < float(able.acceleration) < 15.0


def test_the_least_drag_is_not_at_the_least_airspeed():
    able = performance(F16, 164.0, 1500.0)
    shares = np.array([float(able.idle.share(speed, 1.0)) for speed in (90.0, 120.0, 164.0, 205.0)])
    assert shares.argmin() == 1
    assert shares[1] < 0.85
    assert shares[3] > 1.4


@pytest.mark.long
def test_performance_of_any_airframe_has_a_gradient():
    able = performance(light_aircraft(), 50.0, 500.0)
    assert np.all(np.isfinite(np.asarray(able.idle.level)))
    assert np.all(np.asarray(able.idle.by_lift) >= 0.0)

    def slower(speed):
        return performance_of(F16, speed, jnp.asarray(1500.0)).idle.share(130.0, 0.8)

    value_and_slope, step = compiled_quickly(jax.value_and_grad(slower)), 1e-3
    upper, lower = (float(value_and_slope(jnp.asarray(164.0 + direction * step))[0]) for direction in (1.0, -1.0))
    assert float(value_and_slope(jnp.asarray(164.0))[1]) == pytest.approx((upper - lower) / (2 * step), rel=1e-4)
