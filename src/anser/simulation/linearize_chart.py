"""Classical states of one aircraft as coordinates of its state: the chart in which it is linearized."""

import math

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from anser.aircraft import AbstractAirframe, AircraftState, condition
from anser.environment import Environment
from anser.shapes import Flag, Vector3
from anser.spatial import (
    bank_about_velocity,
    euler_from_quaternion,
    flow_angles,
    path_angles,
    quaternion_from_euler,
    rotate,
    rotate_back,
    rotation_from_euler,
    rotation_from_quaternion,
)
from anser.units import DEG_RAD

_FLIGHT_STATES = ("V", "alpha", "beta", "phi", "theta", "psi", "P", "Q", "R", "altitude")
"""Airspeed, flow angles, roll, pitch, yaw, body rates, altitude: m/s, rad, rad/s, m."""
AIR_OUTPUTS = ("n_z", "gamma", "chi", "mu")
"""Normal load factor (force along body -z over weight), path angle, course and bank of the motion through the air."""

Coordinates = Float[Array, " state"]
"""Values of `body_states` and the states of the actuators."""

_MARGIN_COSINE = math.cos(89.0 * DEG_RAD)


def body_states(airframe: AbstractAirframe) -> tuple[str, ...]:
    """Names of the states of flight and engine (power in percent)."""
    return _FLIGHT_STATES + airframe.engine.state_names


def all_states(airframe: AbstractAirframe) -> tuple[str, ...]:
    """Names of all states, those of the actuators last (deflections in rad)."""
    return body_states(airframe) + airframe.actuators.state_names


def coordinates_of(environment: Environment, state: AircraftState) -> Coordinates:
    """Coordinates of a state; north and east are left out, for nothing depends on them."""
    velocity_air_b, _ = _through_air(environment, state)
    flow = jnp.stack(flow_angles(velocity_air_b))
    euler = euler_from_quaternion(state.quaternion)
    altitude = -state.position_n[2:]
    own = [jnp.ravel(leaf) for leaf in jax.tree.leaves((state.engine, state.actuators))]
    return jnp.concatenate([flow, euler, state.rates_b, altitude, *own])


def state_at(environment: Environment, coordinates: Coordinates, like: AircraftState) -> AircraftState:
    """State of coordinates, north, east and the structure as in `like`: the inverse of `coordinates_of`."""
    V, alpha, beta, phi, theta, psi = coordinates[:6]
    position_n = jnp.stack([like.position_n[0], like.position_n[1], -coordinates[9]])
    velocity_air_b = V * jnp.stack([jnp.cos(alpha) * jnp.cos(beta), jnp.sin(beta), jnp.sin(alpha) * jnp.cos(beta)])
    wind_b = rotate(rotation_from_euler(phi, theta, psi), environment.wind.at(position_n, 0.0))
    _, own_of = ravel_pytree((like.engine, like.actuators))
    engine, actuators = own_of(coordinates[len(_FLIGHT_STATES) :])
    return AircraftState(
        position_n=position_n,
        velocity_b=velocity_air_b + wind_b,
        quaternion=quaternion_from_euler(phi, theta, psi),
        rates_b=coordinates[6:9],
        actuators=actuators,
        engine=engine,
    )


def air_outputs(airframe: AbstractAirframe, environment: Environment, state: AircraftState) -> Float[Array, "4"]:
    """Values of `AIR_OUTPUTS` in a state."""
    velocity_air_b, velocity_air_n = _through_air(environment, state)
    _, alpha, beta = flow_angles(velocity_air_b)
    gamma, chi = path_angles(velocity_air_n)
    mu = bank_about_velocity(rotation_from_quaternion(state.quaternion), alpha, beta)
    weight = airframe.mass_properties.mass * environment.gravity
    load_factor = -condition(airframe, environment, 0.0, state).wrench.force_b[2] / weight
    return jnp.stack([load_factor, gamma, chi, mu])


def regular_at(environment: Environment, state: AircraftState) -> Flag:
    """Whether the coordinates are good at a state.

    They fail, not the flight, where roll and yaw are one (nose straight up or down), where there is no course (flight
    straight up or down) or no angle of attack (sideslip of 90 deg): False within 1 deg of any of these, and at rest.
    """
    velocity_air_b, velocity_air_n = _through_air(environment, state)
    V, _, beta = flow_angles(velocity_air_b)
    gamma, _ = path_angles(velocity_air_n)
    theta = euler_from_quaternion(state.quaternion)[1]
    cosines = jnp.cos(jnp.stack([theta, gamma, beta]))
    return (V > 0.0) & jnp.all(cosines > _MARGIN_COSINE)


def _through_air(environment: Environment, state: AircraftState) -> tuple[Vector3, Vector3]:
    """Velocity through the air in body and in NED axes, m/s."""
    R_bn = rotation_from_quaternion(state.quaternion)
    wind_n = environment.wind.at(state.position_n, 0.0)
    return state.velocity_b - rotate(R_bn, wind_n), rotate_back(R_bn, state.velocity_b) - wind_n
