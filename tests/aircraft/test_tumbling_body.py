"""A tumbling body over the rotating, oblate Earth, 60 s, against an integration in inertial axes and the exact rotation.

The reference shares no code with the package: orbit and attitude by SciPy's DOP853 in inertial (ECI) axes, Euler's
equations without torque by Jacobi's elliptic functions, geodesy by pymap3d. JSBSim states 1e-5 m and 1e-5 deg for such
a flight; both are bounds here.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pymap3d
import pytest
from scipy import integrate, special
from scipy.spatial.transform import Rotation

from anser.aircraft import AircraftState, Controls
from anser.aircraft.motion import earth_fixed_state, local_state
from anser.aircraft_files import load_body
from anser.environment import standard_environment, wgs84_earth
from anser.simulation.vehicle import advance
from anser.spatial import quaternion_from_euler, rotation_from_quaternion

DURATION, STEP, SECONDS = 60.0, 0.01, np.arange(1, 61)
EARTH_RATE, GM, J2 = 7.292115e-5, 3.986004418e14, 1.08262982e-3
A, E2 = 6378137.0, 2.0 / 298.257223563 - 1.0 / 298.257223563**2
FOOT = 0.3048
INERTIA = np.array([0.00189422, 0.006211019, 0.007194665])  # of the brick, slug ft^2: ratios count alone

LATITUDE, LONGITUDE, ALTITUDE = np.radians(-38.0), np.radians(144.0), 30_000.0 * FOOT
EULER = np.array([0.4, -0.3, 2.1])  # roll, pitch, yaw
VELOCITY_N = np.array([180.0, -250.0, -90.0])
STARTS = {
    # rates relative to NED, rad/s: the energy of the tumbling lies on either side of that about the middle axis
    "about the shortest axis": np.radians([10.0, 20.0, 30.0]),
    "about the longest axis": np.radians([-35.0, 8.0, 4.0]),
}


def ned_axes(latitude, longitude):
    """North, east and down in Earth-fixed axes, as rows."""
    (s, c), (sl, cl) = ((np.sin(x), np.cos(x)) for x in (latitude, longitude))
    return np.array([[-s * cl, -s * sl, c], [-sl, cl, 0.0], [-c * cl, -c * sl, -s]])


def body_axes(euler):
    """Rotation NED to body."""
    roll, pitch, yaw = euler
    return Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix().T


def inertial_start(rates):
    """Position, velocity, rotation to body and angular velocity (body axes) in axes that the Earth's have at time 0."""
    R_ne, R_bn = ned_axes(LATITUDE, LONGITUDE), body_axes(EULER)
    position = np.array(pymap3d.geodetic2ecef(LATITUDE, LONGITUDE, ALTITUDE, deg=False))
    spin = np.array([0.0, 0.0, EARTH_RATE])
    prime = A / np.sqrt(1 - E2 * np.sin(LATITUDE) ** 2)
    meridian = prime * (1 - E2) / (1 - E2 * np.sin(LATITUDE) ** 2)
    north, east, _ = VELOCITY_N
    transport_n = np.array(
        [
            east / (prime + ALTITUDE),
            -north / (meridian + ALTITUDE),
            -east * np.tan(LATITUDE) / (prime + ALTITUDE),
        ]
    )
    velocity = R_ne.T @ VELOCITY_N + np.cross(spin, position)
    return position, velocity, R_bn @ R_ne, rates + R_bn @ (R_ne @ spin + transport_n)


def torque_free(rates):
    """Angular velocity at times, by Jacobi's elliptic functions: L. D. Landau, E. M. Lifshitz, *Mechanics*, section 37."""
    energy, momentum = np.sum(INERTIA * rates**2), np.sum((INERTIA * rates) ** 2)
    # the axis about which the rate keeps its sign comes last
    order = [0, 1, 2] if momentum > energy * INERTIA[1] else [2, 1, 0]
    I1, I2, I3 = INERTIA[order]
    amplitude = np.sqrt(
        [
            (energy * I3 - momentum) / (I1 * (I3 - I1)),
            (energy * I3 - momentum) / (I2 * (I3 - I2)),
            (momentum - energy * I1) / (I3 * (I3 - I1)),
        ]
    )
    m = (I2 - I1) * (energy * I3 - momentum) / ((I3 - I2) * (momentum - energy * I1))
    speed = np.sqrt((I3 - I2) * (momentum - energy * I1) / (I1 * I2 * I3))
    rate_1, rate_2, third = rates[order]
    # w1 = a1 cn, w2 = a2 sn, w3 = a3 dn; time runs backwards where w3 is negative
    sign = np.sign(third)
    phase = np.arctan2(rate_2 / amplitude[1], rate_1 / amplitude[0])
    start = special.ellipkinc(phase, m)

    def at(time):
        sn, cn, dn, _ = special.ellipj(start + sign * speed * time, m)
        rates = np.empty((3, *np.shape(time)))
        rates[order] = np.array([amplitude[0] * cn, amplitude[1] * sn, sign * amplitude[2] * dn])
        return rates

    return at


def reference_flight(rates):
    """Earth-fixed position, velocity in body axes, rotation Earth-fixed to body, inertial rates; at each second."""
    position, velocity, R_bi, rates = inertial_start(rates)
    rates_at = torque_free(rates)
    np.testing.assert_allclose(rates_at(0.0), rates, rtol=1e-13)

    def orbit(_, y):
        r = np.linalg.norm(y[:3])
        # gradient of GM/r (1 - J2 (A/r)^2 (3 (z/r)^2 - 1)/2)
        oblate = 1.5 * J2 * (A / r) ** 2
        pull = np.array([1.0, 1.0, 3.0]) - 5.0 * (y[2] / r) ** 2
        return np.concatenate([y[3:], -GM / r**3 * y[:3] * (1.0 + oblate * pull)])

    def turning(t, y):
        P, Q, R = rates_at(t)
        return (np.array([[0.0, R, -Q], [-R, 0.0, P], [Q, -P, 0.0]]) @ y.reshape(3, 3)).ravel()

    exact = {"method": "DOP853", "t_eval": SECONDS, "rtol": 3e-14}
    flown = integrate.solve_ivp(orbit, (0.0, DURATION), np.concatenate([position, velocity]), atol=1e-9, **exact).y
    rotated = integrate.solve_ivp(turning, (0.0, DURATION), R_bi.ravel(), atol=1e-14, **exact).y
    states = []
    for k, t in enumerate(SECONDS):
        c, s = np.cos(EARTH_RATE * t), np.sin(EARTH_RATE * t)
        R_ei = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        R_bi = rotated[:, k].reshape(3, 3)
        relative = flown[3:, k] - EARTH_RATE * np.array([-flown[1, k], flown[0, k], 0.0])
        states.append((R_ei @ flown[:3, k], R_bi @ relative, R_bi @ R_ei.T, rates_at(t)))
    return [np.array(column) for column in zip(*states, strict=True)]


@jax.jit
def anser_flight(body, environment, start):
    """As `reference_flight`, and the rotation NED to body, at each second."""
    controls = Controls(jnp.zeros(3), jnp.asarray(0.0))

    def second(state, _):
        new_state = jax.lax.fori_loop(0, 100, lambda _, y: advance(body, environment, 0.0, y, controls, STEP), state)
        R_be, local = rotation_from_quaternion(new_state.quaternion), local_state(environment.earth, new_state)
        R_bn = rotation_from_quaternion(local.quaternion)
        return new_state, (new_state.position_e, new_state.velocity_b, R_be, new_state.rates_b, R_bn)

    return jax.lax.scan(second, earth_fixed_state(environment.earth, start), length=SECONDS.size)[1]


def angle_between(rotations_1, rotations_2):
    """Angles between attitudes, deg."""
    return np.degrees(Rotation.from_matrix(rotations_1 @ np.swapaxes(rotations_2, 1, 2)).magnitude())


@pytest.mark.parametrize("name", STARTS)
def test_a_minute_of_tumbling_equals_the_analytic_solution(name):
    rates = STARTS[name]
    body = load_body("undamped-brick")
    environment = standard_environment(earth=wgs84_earth(LATITUDE, LONGITUDE))
    start = AircraftState(
        position_n=jnp.array([0.0, 0.0, -ALTITUDE]),
        velocity_b=jnp.asarray(body_axes(EULER) @ VELOCITY_N),
        quaternion=quaternion_from_euler(*EULER),
        rates_b=jnp.asarray(rates),
        actuators=body.actuators.steady_state(jnp.zeros(3)),
        engine=body.engine.steady_state(0.0),
    )
    position, velocity, R_be, rates, R_bn = (np.asarray(x) for x in anser_flight(body, environment, start))
    e_position, e_velocity, e_R_be, e_rates = reference_flight(STARTS[name])
    lat, lon, _ = pymap3d.ecef2geodetic(*e_position.T, deg=False)
    expected = np.array([matrix @ ned_axes(*at).T for matrix, *at in zip(e_R_be, lat, lon, strict=True)])
    # Runge-Kutta's error in a velocity that turns with the body: 3e-6 m and 1.6e-7 m/s at 37 deg/s
    np.testing.assert_allclose(position, e_position, rtol=0, atol=1e-5)
    np.testing.assert_allclose(velocity, e_velocity, rtol=0, atol=1e-6)
    np.testing.assert_allclose(np.degrees(rates), np.degrees(e_rates), rtol=0, atol=1e-7)
    assert angle_between(R_be, e_R_be).max() < 1e-7
    assert angle_between(R_bn, expected).max() < 1e-7
