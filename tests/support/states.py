"""Generic states of an aircraft, for property tests, and the functions of the state that several tests compile."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import strategies as st

from anser.aircraft import AircraftState, AirData, Controls, air_data_and_forces
from anser.aircraft.actuators import Deflections
from anser.aircraft.air_data import air_data
from anser.aircraft.engines import EnginePower
from anser.aircraft.motion import flat_earth_derivative
from anser.environment import StandardAtmosphere
from anser.spatial import quaternion_from_euler

derivative = jax.jit(flat_earth_derivative)
condition_of = jax.jit(air_data_and_forces)
_quaternion = jax.jit(quaternion_from_euler)


def make_state(
    V: float = 160.0,
    alpha: float = 0.1,
    beta: float = 0.0,
    euler: tuple[float, float, float] = (0.3, 0.2, -1.0),
    rates: tuple[float, float, float] = (0.1, -0.05, 0.08),
    surfaces: tuple[float, float, float] = (-0.05, 0.02, -0.03),
    power: float = 40.0,
    altitude: float = 2500.0,
) -> AircraftState:
    """Build a state in still air from flow angles and Euler angles (roll, pitch, yaw); SI, rad, percent."""
    direction = [np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)]
    return AircraftState(
        position_n=jnp.array([100.0, -200.0, -altitude]),
        velocity_b=jnp.array(V * np.array(direction)),
        quaternion=_quaternion(*map(float, euler)),
        rates_b=jnp.array(rates),
        actuators=Deflections(jnp.array(surfaces)),
        engine=EnginePower(jnp.asarray(power)),
    )


@jax.jit
def air_at(altitude, mach) -> AirData:
    """Standard air met straight ahead at an altitude (m) and Mach number."""
    air = StandardAtmosphere().at(altitude)
    V = mach * air.speed_of_sound
    return air_data(V * jnp.array([1.0, 0.0, 0.0]), altitude, air)


def make_controls(surfaces: tuple[float, float, float] = (0.1, -0.1, 0.1), throttle: float = 0.5) -> Controls:
    """Build controls: rad and 0..1."""
    return Controls(jnp.array(surfaces), jnp.asarray(throttle))


def _within(size: float) -> st.SearchStrategy[float]:
    return st.floats(-size, size)


states = st.builds(
    make_state,
    V=st.floats(60.0, 300.0),
    alpha=st.floats(-0.15, 0.75),
    beta=_within(0.5),
    # Pitch stays away from 90 deg, where the course of the comparison's formulas is undefined, not the state.
    euler=st.tuples(_within(3.1), _within(0.7), _within(3.1)),
    rates=st.tuples(_within(1.5), _within(0.7), _within(0.5)),
    surfaces=st.tuples(_within(0.4), _within(0.35), _within(0.5)),
    power=st.floats(0.0, 100.0),
    altitude=st.floats(0.0, 12000.0),
)
"""States within the F-16's tables."""
