"""What an aircraft can do along its path, against trims at other airspeeds and against a flight with the engine idle."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft import flight_condition
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
    point = solve_trim(airframe, STILL, TrimTarget(speed, altitude, zero, zero, zero, zero))
    return performance_at(airframe, STILL, flight_condition(airframe, STILL, 0.0, point.state), point.state.surfaces)


compiled_performance = compiled_quickly(performance_of)


def performance(airframe, speed, altitude):
    return compiled_performance(airframe, jnp.asarray(speed), jnp.asarray(altitude))


def against_path(airframe, speed, altitude, load_factor):
    """Drag less idle thrust per mass where the aircraft is trimmed at an airspeed and a load factor, m/s^2."""
    push_rad_s = (load_factor - 1.0) * GRAVITY / speed
    point = solved(airframe, STILL, trim_target(speed, altitude, path_rate=push_rad_s))
    assert point.converged
    now = condition_of(airframe, STILL, 0.0, point.state)
    data = now.air_data
    idle = airframe.engine.propulsion(0.0, data).force_b
    force = np.asarray(now.aerodynamic.force_b + idle)
    ahead = [np.cos(data.alpha) * np.cos(data.beta), np.sin(data.beta), np.sin(data.alpha) * np.cos(data.beta)]
    return -float(np.dot(force, ahead)) / float(airframe.mass_properties.mass)


@pytest.mark.parametrize("speed", [95.0, 115.0, 134.0, 164.0, 200.0])
@pytest.mark.parametrize("load_factor", [1.0, 0.75, 0.5])
def test_idle_it_slows_down_as_trims_at_other_airspeeds_say(speed, load_factor):
    able = performance(F16, 164.0, 1500.0)
    expected = against_path(F16, speed, 1500.0, load_factor)
    found = float(able.deceleration * able.idle.share(speed, load_factor))
    # The surfaces stay where they are at 164 m/s: 2 % of the drag. Between entries 40 m/s apart a chord lies above the
    # curve, and half unloaded the parabola through 1 and 0.75 is another's: 0.06 m/s^2 together.
    assert found == pytest.approx(expected, rel=0.03, abs=0.06)


def test_at_the_start_it_is_the_trims_own():
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
def test_of_any_airframe_and_with_a_gradient():
    able = performance(light_aircraft(), 50.0, 500.0)
    assert np.all(np.isfinite(np.asarray(able.idle.level)))
    assert np.all(np.asarray(able.idle.by_lift) >= 0.0)

    def slower(speed):
        return performance_of(F16, speed, jnp.asarray(1500.0)).idle.share(130.0, 0.8)

    both, step = compiled_quickly(jax.value_and_grad(slower)), 1e-3
    ahead, behind = (float(both(jnp.asarray(164.0 + way * step))[0]) for way in (1.0, -1.0))
    assert float(both(jnp.asarray(164.0))[1]) == pytest.approx((ahead - behind) / (2 * step), rel=1e-4)
