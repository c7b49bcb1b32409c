"""An F-16 in flight, and NASA's control law evaluated by hand."""

import jax.numpy as jnp
import numpy as np

from anser.aircraft import AircraftState, air_data_and_forces
from anser.aircraft_files import load_airframe
from anser.environment import standard_environment, wgs84_earth
from anser.parts import Belief, Instant
from anser.spatial import quaternion_from_euler

AIRFRAME = load_airframe("f16", "s119")
ROUND = standard_environment(earth=wgs84_earth(0.6, 3.14))
FLAT = standard_environment()


def belief_of(euler=(0.05, 0.06, 0.8), velocity_b=(172.0, 1.0, 9.0), rates_b=(0.02, -0.01, 0.03), environment=ROUND):
    state = AircraftState(
        position_n=jnp.array([1000.0, 80_000.0, -3060.0]),
        velocity_b=jnp.asarray(velocity_b),
        quaternion=quaternion_from_euler(*map(jnp.asarray, euler)),
        rates_b=jnp.asarray(rates_b),
        actuators=AIRFRAME.actuators.steady_state(jnp.zeros(3)),
        engine=AIRFRAME.engine.steady_state(jnp.asarray(14.0)),
    )
    condition = air_data_and_forces(AIRFRAME, environment, 0.0, state)
    return Belief(AIRFRAME, state, condition, jnp.zeros(3), None, None)


def instant_of(time_s, environment=ROUND, step_s=0.01):
    return Instant(environment, jnp.asarray(round(time_s / step_s)), jnp.asarray(step_s))


def lqr_by_hand(keas_error, alpha, beta, phi_error, theta_error, p, q, r, stick, throttle):
    """Surfaces (deg) and power (percent) of F16_control.dml with autopilot; kt, deg and rad/s. Source: its gains."""
    alpha_error = alpha - 2.653813535191715
    K_long = [-0.063009074230494, 0.113230403179271, 10.113432224566077, 3.154983341632913]
    K_power = [0.997260602961658, -0.025467711176391, 1.213308488207827, 0.208744369535208]
    K_lat = [3.078043941515770, 0.032365863044163, 4.557858908828332, 0.589443156647647]
    K_dir = [-0.705817452754520, -0.256362860634868, -1.073666149713151, 0.822114635953878]
    long, lat = [keas_error, alpha_error, q, theta_error], [phi_error, beta, p, r]
    stick = np.clip(stick - np.dot(K_long, long), -1, 1)
    throttle = np.clip(throttle - np.dot(K_power, long), 0, 1)
    lateral, pedal = np.clip(-np.dot(K_lat, lat), -1, 1), np.clip(-np.dot(K_dir, lat), -1, 1)
    return np.array([-25 * stick, -21.5 * lateral, -30 * pedal + 0.008 * -21.5 * lateral]), 100 * throttle
