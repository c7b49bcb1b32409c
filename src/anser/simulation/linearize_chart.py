"""Classical states of one aircraft as coordinates of its state: the chart in which it is linearized."""

import math

import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft import AbstractAirframe, AircraftState, Deflections, EnginePower, condition
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

BODY_STATES = ("V", "alpha", "beta", "phi", "theta", "psi", "P", "Q", "R", "altitude", "power")
"""Airspeed, flow angles, roll, pitch, yaw, body rates, altitude, engine power: m/s, rad, rad/s, m, percent."""
SURFACE_STATES = ("elevator", "aileron", "rudder")
"""Deflections, rad."""
AIR_OUTPUTS = ("n_z", "gamma", "chi", "mu")
"""Normal load factor (force along body -z over weight), path angle, course and bank of the motion through the air."""

Coordinates = Float[Array, "14"]
"""Values of `BODY_STATES` and `SURFACE_STATES`."""

_MARGIN_COSINE = math.cos(89.0 * DEG_RAD)


def coordinates_of(environment: Environment, state: AircraftState) -> Coordinates:
    """Coordinates of a state; north and east are left out, for nothing depends on them."""
    velocity_air_b, _ = _through_air(environment, state)
    flow = jnp.stack(flow_angles(velocity_air_b))
    euler = euler_from_quaternion(state.quaternion)
    rest = jnp.stack([-state.position_n[2], state.power])
    return jnp.concatenate([flow, euler, state.rates_b, rest, state.surfaces])


def state_at(environment: Environment, coordinates: Coordinates, place_n: Vector3) -> AircraftState:
    """State of coordinates, north and east as in `place_n`: the inverse of `coordinates_of`."""
    V, alpha, beta, phi, theta, psi = coordinates[:6]
    position_n = jnp.stack([place_n[0], place_n[1], -coordinates[9]])
    velocity_air_b = V * jnp.stack([jnp.cos(alpha) * jnp.cos(beta), jnp.sin(beta), jnp.sin(alpha) * jnp.cos(beta)])
    wind_b = rotate(rotation_from_euler(phi, theta, psi), environment.wind.at(position_n, 0.0))
    return AircraftState(
        position_n=position_n,
        velocity_b=velocity_air_b + wind_b,
        quaternion=quaternion_from_euler(phi, theta, psi),
        rates_b=coordinates[6:9],
        actuators=Deflections(coordinates[11:]),
        engine=EnginePower(coordinates[10]),
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
