"""The same flight seen from an origin near by and from one far off: over the date line, around and across a pole."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pymap3d
import pytest

from anser.aircraft import flight_condition
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
    """Steady flight at a place, seen from there; Earth-fixed state and controls."""
    environment = _environment(latitude_deg, longitude_deg, wind_n)
    target = trim_target(SPEED_M_S, ALTITUDE_M, 0.0, course_deg * DEG_RAD)
    point = eqx.filter_jit(solve_trim)(F16, environment, target)
    assert bool(point.converged)
    return earth_fixed_state(environment.earth, point.state), point.controls


@jax.jit
def _second(environment, state, controls):
    """What is seen of a state, and the state a second later."""
    seen = local_state(environment.earth, state)
    now = flight_condition(F16, environment, 0.0, seen)
    lat, lon, h = environment.earth.geodetic(seen.position_n)
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
        "euler_deg": euler_from_quaternion(seen.quaternion) * RAD_DEG,
        "rates_deg": seen.rates_b * RAD_DEG,
        "velocity_n": rotate_back(now.R_bn, seen.velocity_b),
        "wind_e": rotate_back(R_be, now.R_bn @ now.wind_n),
        "wind_axes_deg": jnp.stack([now.air_data.alpha, now.air_data.beta]) * RAD_DEG,
        "airspeed": now.air_data.V,
        "gravity": now.earth.gravity,
    }
    step = jnp.asarray(STEP_S)
    return logged, jax.lax.fori_loop(0, STEPS, lambda _, y: advance(F16, environment, 0.0, y, controls, step), state)


def _flown(start, controls, wind_n, seconds, origin_deg=None):
    """Log of a flight, every second; without an origin each second is seen from one near by, under the aircraft."""
    rows, state = [], start
    environment = None if origin_deg is None else _environment(*origin_deg, wind_n)
    for _ in range(seconds + 1):
        lat, lon, _ = pymap3d.ecef2geodetic(*np.asarray(state.position_e))
        here = _environment(lat - 0.01, lon, wind_n) if environment is None else environment
        logged, state = _second(here, state, controls)
        rows.append(logged)
    return {key: np.stack([np.asarray(row[key]) for row in rows]) for key in rows[0]}


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
    near = _near(name)
    far = _flown(*_trimmed(*place_deg, course_deg, wind_n), wind_n, seconds, origin_deg)
    away = np.hypot(*near["position_e"][:, :2].T) > 100.0
    assert away.sum() > 0.9 * seconds
    for key, value in near.items():
        difference = far[key] - value
        if key in ("longitude_deg", "euler_deg"):
            difference = (difference + 180.0) % 360.0 - 180.0
        kept = difference if key in ("position_e", "velocity_e", "velocity_b", "R_be", "height") else difference[away]
        assert np.max(np.abs(kept)) < SAME, f"{key}: {np.max(np.abs(kept))}"


@pytest.mark.long
@pytest.mark.parametrize("name", FLIGHTS)
def test_what_is_logged_follows_from_the_place(name):
    """Place, angles, velocity and wind of the log from the Earth-fixed truth alone, through pymap3d."""
    place_deg, course_deg, wind_n, seconds = FLIGHTS[name]
    log = _flown(*_trimmed(*place_deg, course_deg, wind_n), wind_n, seconds, (-20.0, -100.0))
    lat, lon, h = pymap3d.ecef2geodetic(*log["position_e"].T)
    away = np.hypot(*log["position_e"][:, :2].T) > 100.0
    np.testing.assert_allclose(log["latitude_deg"], lat, atol=SAME)
    np.testing.assert_allclose(log["height"], h, atol=SAME)
    np.testing.assert_allclose(((log["longitude_deg"] - lon + 180.0) % 360.0 - 180.0)[away], 0.0, atol=SAME)

    def ned(vectors_e):
        east, north, up = pymap3d.ecef2enuv(*vectors_e.T, lat, lon)
        return np.stack([north, east, -up], axis=-1)[away]

    np.testing.assert_allclose(ned(log["velocity_e"]), log["velocity_n"][away], atol=SAME)
    np.testing.assert_allclose(ned(log["wind_e"]), np.broadcast_to(wind_n, (away.sum(), 3)), atol=SAME)
    forward, right, down = (ned(log["R_be"][:, k]) for k in range(3))
    roll, yaw = np.arctan2(right[:, 2], down[:, 2]), np.arctan2(forward[:, 1], forward[:, 0])
    expected = np.degrees(np.stack([roll, -np.arcsin(forward[:, 2]), yaw], axis=-1))
    difference = (log["euler_deg"][away] - expected + 180.0) % 360.0 - 180.0
    np.testing.assert_allclose(difference, 0.0, atol=SAME)


@pytest.mark.long
def test_the_flights_go_where_they_say():
    """The circle stays at three nautical miles of arc for more than a turn; the others cross what they are to cross."""
    circle = _near("around the pole")
    np.testing.assert_allclose(90.0 - circle["latitude_deg"], 3 * MILE_M / 111_690.0, rtol=1e-9)
    turned = {name: np.ptp(np.unwrap(np.radians(_near(name)["longitude_deg"]))) * RAD_DEG for name in FLIGHTS}
    assert turned["around the pole"] > 370.0
    assert 170.0 < turned["across the pole"] < 190.0
    wrapped = (_near("date line")["longitude_deg"] + 180.0) % 360.0 - 180.0
    assert wrapped[0] > 179.0
    assert wrapped[-1] < -179.0


@pytest.mark.long
def test_the_motion_is_smooth_on_the_polar_axis():
    """The derivative on the axis and a hundredth of a metre beside it: the air damps rates that the axes do not enter.

    Without wind, which has no direction at a pole. Gravity turns by 1e-2 m / 6.4e6 m: 2e-8 m/s^2; the controls of
    the trim leave no angular acceleration beyond its residual.
    """
    start, controls = _trimmed(*FLIGHTS["across the pole"][0], 0.0, (0.0, 0.0, 0.0))
    environment = _environment(89.9, 0.0, (0.0, 0.0, 0.0))

    @jax.jit
    def derivative(position_e):
        state = eqx.tree_at(lambda y: y.position_e, start, position_e)
        return earth_fixed_derivative(F16, environment, 0.0, state, controls)

    height_m = 6_356_752.3 + ALTITUDE_M
    beside = derivative(jnp.array([0.006, 0.008, height_m]))
    for across_m in (0.0, 1e-12, 1e-9, 1e-6):
        found = derivative(jnp.array([across_m, 0.0, height_m]))
        np.testing.assert_allclose(found.rates_b, beside.rates_b, atol=1e-9)
        np.testing.assert_allclose(found.velocity_b, beside.velocity_b, atol=1e-7)
    slope = jax.jit(jax.jacrev(lambda p: derivative(p).velocity_b))
    for place in ([0.0, 0.0, height_m], [1.0, 0.0, height_m]):
        assert np.all(np.isfinite(slope(jnp.array(place))))
