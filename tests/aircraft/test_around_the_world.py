"""Flights described from near and distant chart origins: across the date line, around and across a pole."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pymap3d
import pytest

from anser.aircraft import air_data_and_forces
from anser.aircraft.motion import earth_fixed_derivative, earth_fixed_state, local_state
from anser.aircraft_files import load_airframe
from anser.environment import standard_environment, wgs84_earth
from anser.simulation.vehicle import advance
from anser.spatial import euler_from_quaternion, rotation_from_quaternion
from anser.spatial.rotations import rotate_back
from anser.steady import solve_trim, trim_target
from anser.units import DEG_RAD, RAD_DEG

F16 = load_airframe("f16", "s119")  # stable in pitch: flies with its controls held
ALTITUDE_M, SPEED_M_S, STEP_S, STEPS = 3000.0, 180.0, 0.05, 20  # a second of flight
MILE_M = 1852.0
SAME = 1e-6  # m, m/s, deg


def _environment(latitude_deg, longitude_deg, wind_n):
    return standard_environment(
        earth=wgs84_earth(latitude_deg * DEG_RAD, longitude_deg * DEG_RAD), wind_n=jnp.array(wind_n)
    )


@functools.cache
def _trimmed(latitude_deg, longitude_deg, course_deg, wind_n):
    """Trim at a position, relative to a chart origin there; Earth-fixed state and controls."""
    environment = _environment(latitude_deg, longitude_deg, wind_n)
    target = trim_target(SPEED_M_S, ALTITUDE_M, 0.0, course_deg * DEG_RAD)
    point = eqx.filter_jit(solve_trim)(F16, environment, target)
    assert bool(point.converged)
    return earth_fixed_state(environment.earth, point.state), point.controls


@jax.jit
def _second(environment, state, controls):
    """Logged quantities of a state, and the state one second later."""
    local = local_state(environment.earth, state)
    condition = air_data_and_forces(F16, environment, 0.0, local)
    lat, lon, h = environment.earth.geodetic(local.position_n)
    R_be = rotation_from_quaternion(state.quaternion)
    logged = {
        "position_e": state.position_e,
        "velocity_e": rotate_back(R_be, state.velocity_b),
        "R_be": R_be,
        "velocity_b": state.velocity_b,
        "inertial_rates_deg": state.rates_b * RAD_DEG,
        "height": h,
        "latitude_deg": lat * RAD_DEG,
        "longitude_deg": lon * RAD_DEG,
        "euler_deg": euler_from_quaternion(local.quaternion) * RAD_DEG,
        "rates_deg": local.rates_b * RAD_DEG,
        "velocity_n": rotate_back(condition.R_bn, local.velocity_b),
        "wind_e": rotate_back(R_be, condition.R_bn @ condition.wind_n),
        "wind_axes_deg": jnp.stack([condition.air_data.alpha, condition.air_data.beta]) * RAD_DEG,
        "airspeed": condition.air_data.V,
        "gravity": condition.earth.gravity,
    }
    step = jnp.asarray(STEP_S)
    return logged, jax.lax.fori_loop(0, STEPS, lambda _, y: advance(F16, environment, 0.0, y, controls, step), state)


def _flown(start, controls, wind_n, seconds, origin_deg=None):
    """Log of a flight, every second; without a given origin, the chart's origin follows the aircraft."""
    logs, state = [], start
    environment = None if origin_deg is None else _environment(*origin_deg, wind_n)
    for _ in range(seconds + 1):
        lat, lon, _ = pymap3d.ecef2geodetic(*np.asarray(state.position_e))
        chart_environment = _environment(lat - 0.01, lon, wind_n) if environment is None else environment
        logged, state = _second(chart_environment, state, controls)
        logs.append(logged)
    return {key: np.stack([np.asarray(log[key]) for log in logs]) for key in logs[0]}


FLIGHTS = {
    # start (deg), course (deg), wind (m/s), duration (s)
    "date line": ((20.0, 179.995), 90.0, (6.0, -8.0, 0.0), 10),
    "around the pole": ((90.0 - 3 * MILE_M / 111_690.0, 10.0), 90.0, (0.0, 12.0, 0.0), 190),
    "across the pole": ((89.98, 30.0), 0.0, (5.0, 9.0, 0.0), 25),
}


@functools.cache
def _near(name):
    place_deg, course_deg, wind_n, seconds = FLIGHTS[name]
    return _flown(*_trimmed(*place_deg, course_deg, wind_n), wind_n, seconds)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "origin_deg"),
    [
        ("date line", (19.0, 179.0)),
        ("date line", (20.0, 60.0)),
        ("date line", (-75.0, -60.0)),
        ("around the pole", (89.99, 10.0)),
        ("around the pole", (45.0, -110.0)),
        ("across the pole", (89.99, 30.0)),
        ("across the pole", (-30.0, 150.0)),
    ],
)
def test_a_flight_is_the_same_from_every_origin(name, origin_deg):
    """Truth, logged angles and wind to 1e-6 m, m/s and deg, the angles farther than 100 m from a pole."""
    place_deg, course_deg, wind_n, seconds = FLIGHTS[name]
    nearby = _near(name)
    distant = _flown(*_trimmed(*place_deg, course_deg, wind_n), wind_n, seconds, origin_deg)
    off_pole = np.hypot(*nearby["position_e"][:, :2].T) > 100.0
    assert off_pole.sum() > 0.9 * seconds
    for key, value in nearby.items():
        difference = distant[key] - value
        if key in ("longitude_deg", "euler_deg"):
            difference = (difference + 180.0) % 360.0 - 180.0
        relevant = (
            difference if key in ("position_e", "velocity_e", "velocity_b", "R_be", "height") else difference[off_pole]
        )
        assert np.max(np.abs(relevant)) < SAME, f"{key}: {np.max(np.abs(relevant))}"


@pytest.mark.long
@pytest.mark.parametrize("name", FLIGHTS)
def test_logged_quantities_follow_from_the_position(name):
    """Position, angles, velocity and wind of the log, recomputed from Earth-fixed quantities with pymap3d."""
    place_deg, course_deg, wind_n, seconds = FLIGHTS[name]
    log = _flown(*_trimmed(*place_deg, course_deg, wind_n), wind_n, seconds, (-20.0, -100.0))
    lat, lon, h = pymap3d.ecef2geodetic(*log["position_e"].T)
    off_pole = np.hypot(*log["position_e"][:, :2].T) > 100.0
    np.testing.assert_allclose(log["latitude_deg"], lat, atol=SAME)
    np.testing.assert_allclose(log["height"], h, atol=SAME)
    np.testing.assert_allclose(((log["longitude_deg"] - lon + 180.0) % 360.0 - 180.0)[off_pole], 0.0, atol=SAME)

    def ned(vectors_e):
        east, north, up = pymap3d.ecef2enuv(*vectors_e.T, lat, lon)
        return np.stack([north, east, -up], axis=-1)[off_pole]

    np.testing.assert_allclose(ned(log["velocity_e"]), log["velocity_n"][off_pole], atol=SAME)
    np.testing.assert_allclose(ned(log["wind_e"]), np.broadcast_to(wind_n, (off_pole.sum(), 3)), atol=SAME)
    forward, right, down = (ned(log["R_be"][:, k]) for k in range(3))
    roll, yaw = np.arctan2(right[:, 2], down[:, 2]), np.arctan2(forward[:, 1], forward[:, 0])
    expected = np.degrees(np.stack([roll, -np.arcsin(forward[:, 2]), yaw], axis=-1))
    difference = (log["euler_deg"][off_pole] - expected + 180.0) % 360.0 - 180.0
    np.testing.assert_allclose(difference, 0.0, atol=SAME)


@pytest.mark.long
def test_flights_cross_pole_and_date_line():
    """The circle remains at three nautical miles for more than a turn; the other flights cross pole and date line."""
    circle = _near("around the pole")
    np.testing.assert_allclose(90.0 - circle["latitude_deg"], 3 * MILE_M / 111_690.0, rtol=1e-9)
    longitude_ranges = {name: np.ptp(np.unwrap(np.radians(_near(name)["longitude_deg"]))) * RAD_DEG for name in FLIGHTS}
    assert longitude_ranges["around the pole"] > 370.0
    assert 170.0 < longitude_ranges["across the pole"] < 190.0
    wrapped = (_near("date line")["longitude_deg"] + 180.0) % 360.0 - 180.0
    assert wrapped[0] > 179.0
    assert wrapped[-1] < -179.0


@pytest.mark.long
def test_the_motion_is_smooth_on_the_polar_axis():
    """The derivative on the axis equals the derivative a hundredth of a metre beside the axis.

    Without wind, whose direction is undefined at a pole. Gravity turns by 1e-2 m / 6.4e6 m: 2e-8 m/s^2; the trim leaves
    no angular acceleration beyond the residual.
    """
    start, controls = _trimmed(*FLIGHTS["across the pole"][0], 0.0, (0.0, 0.0, 0.0))
    environment = _environment(89.9, 0.0, (0.0, 0.0, 0.0))

    @jax.jit
    def derivative(position_e):
        state = eqx.tree_at(lambda y: y.position_e, start, position_e)
        return earth_fixed_derivative(F16, environment, 0.0, state, controls)

    height_m = 6_356_752.3 + ALTITUDE_M
    nearby = derivative(jnp.array([0.006, 0.008, height_m]))
    for across_m in (0.0, 1e-12, 1e-9, 1e-6):
        rates = derivative(jnp.array([across_m, 0.0, height_m]))
        np.testing.assert_allclose(rates.rates_b, nearby.rates_b, atol=1e-9)
        np.testing.assert_allclose(rates.velocity_b, nearby.velocity_b, atol=1e-7)
    slope = jax.jit(jax.jacrev(lambda p: derivative(p).velocity_b))
    for position in ([0.0, 0.0, height_m], [1.0, 0.0, height_m]):
        assert np.all(np.isfinite(slope(jnp.array(position))))
