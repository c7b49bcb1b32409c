"""Generic flight conditions for the control tests, each a single vector, so that one compiled program is sufficient."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from hypothesis import strategies as st

from anser.aircraft import AircraftState, AirDataAndForces, air_data_and_forces
from anser.aircraft.actuators import Deflections
from anser.aircraft.engines import EnginePower
from anser.aircraft_files import load_airframe
from anser.control import default_limits, published_gains
from anser.control.autopilot_state import initial_autopilot_state
from anser.control.onboard_model import OnboardModel, PathMotion, onboard_model, path_motion
from anser.environment import standard_environment
from anser.simulation.response import exact_belief
from anser.spatial.rotations import quaternion_from_rotation, rotate
from anser.spatial.wind_axes import attitude_from_path

DEGREE = np.pi / 180
AIRFRAME = load_airframe()
# For code that runs a few times: what the compiler would spend on its speed is not earned back.
QUICK = {"xla_backend_optimization_level": 0}


def _floats(bound_low, bound_high):
    return st.floats(bound_low, bound_high, allow_subnormal=False)


def vectors(*bounds):
    """Strategy of arrays with one bounded entry per (low, high)."""
    return st.tuples(*(_floats(low, high) for low, high in bounds)).map(np.array)


# V, alpha, beta, mu, gamma, chi; P, Q, R; elevator, aileron, rudder; power, altitude; wind north, east, down
FLIGHT_BOUNDS = (
    (90.0, 240.0),
    (-8 * DEGREE, 40 * DEGREE),
    (-25 * DEGREE, 25 * DEGREE),
    (-3.1, 3.1),
    (-1.2, 1.2),
    (-3.1, 3.1),
    *((-1.0, 1.0),) * 3,
    (-24 * DEGREE, 24 * DEGREE),
    (-20 * DEGREE, 20 * DEGREE),
    (-28 * DEGREE, 28 * DEGREE),
    (0.0, 100.0),
    (100.0, 9000.0),
    *((-20.0, 20.0),) * 3,
)
flights = vectors(*FLIGHT_BOUNDS)


class Setting(eqx.Module):
    """An aircraft in a steady wind at one time."""

    state: AircraftState
    condition: AirDataAndForces
    motion: PathMotion


def state_of(x) -> AircraftState:
    """State from a vector in the order of `FLIGHT_BOUNDS`."""
    V, alpha, beta, mu, gamma, chi = (x[k] for k in range(6))
    R_bn = attitude_from_path(mu, gamma, chi, alpha, beta)
    direction_b = jnp.stack([jnp.cos(alpha) * jnp.cos(beta), jnp.sin(beta), jnp.sin(alpha) * jnp.cos(beta)])
    return AircraftState(
        position_n=jnp.stack([0 * V, 0 * V, -x[13]]),
        velocity_b=V * direction_b + rotate(R_bn, x[14:17]),
        quaternion=quaternion_from_rotation(R_bn),
        rates_b=x[6:9],
        actuators=Deflections(x[9:12]),
        engine=EnginePower(x[12]),
    )


def environment_of(x):
    return standard_environment(wind_n=x[14:17])


def believed_motion(state, x) -> tuple[AirDataAndForces, PathMotion]:
    environment = environment_of(x)
    condition = air_data_and_forces(AIRFRAME, environment, 0.0, state)
    mass = AIRFRAME.mass_properties.mass
    return condition, path_motion(condition, condition.wrench.force_b, state.velocity_b, mass, environment.gravity)


def model_of(state, x) -> OnboardModel:
    """The loops' onboard model of a state after steady flight in this state."""
    _, motion = believed_motion(state, x)
    attitude = jnp.stack([motion.mu, motion.alpha, motion.beta])
    memory = initial_autopilot_state(attitude, state.rates_b, state.surfaces)
    belief = exact_belief(AIRFRAME, environment_of(x), state)
    return onboard_model(belief, default_limits(), published_gains(), memory, 0.01)


def setting_of(x) -> Setting:
    state = state_of(x)
    return Setting(state, *believed_motion(state, x))
