"""Six-degree-of-freedom motion of one aircraft over a rotating, round Earth, in Earth-fixed (ECEF) coordinates."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp

from anser.aircraft.disturbance import Disturbance
from anser.aircraft.interface import AbstractAirframe, AircraftState, Controls
from anser.aircraft.rigid_body import angular_acceleration, condition
from anser.environment import Environment, RotatingEarth
from anser.numerics import cross
from anser.shapes import Quaternion, Scalar, ScalarLike, Vector3
from anser.spatial import (
    compose,
    quaternion_derivative,
    quaternion_from_euler,
    quaternion_multiply,
    rotate,
    rotate_back,
    rotation_from_quaternion,
    rotation_ned_from_ecef,
)


class EarthFixedState(eqx.Module):
    """State of one aircraft over a round Earth: regular everywhere, poles and date line included.

    Attributes
    ----------
    position_e
        Of the centre of gravity, ECEF, m.
    velocity_b
        (U, V, W) relative to the rotating Earth in body axes, m/s.
    quaternion
        (q0, q1, q2, q3), scalar first, ECEF to body.
    rates_b
        Inertial angular velocity in body axes, rad/s.
    actuators, engine
        As in `AircraftState`.
    """

    position_e: Vector3
    velocity_b: Vector3
    quaternion: Quaternion
    rates_b: Vector3
    actuators: Any
    engine: Any


def earth_fixed_state(earth: RotatingEarth, state: AircraftState) -> EarthFixedState:
    """State over a round Earth from what is seen in local axes: the inverse of `local_state`."""
    lat, lon, _ = earth.geodetic(state.position_n)
    R_bn = rotation_from_quaternion(state.quaternion)
    local = earth.local(state.position_n, rotate_back(R_bn, state.velocity_b))
    return EarthFixedState(
        position_e=earth.ecef_from_chart(state.position_n),
        velocity_b=state.velocity_b,
        quaternion=quaternion_multiply(_quaternion_ned_from_ecef(lat, lon), state.quaternion),
        rates_b=state.rates_b + rotate(R_bn, local.earth_rate_n + local.transport_rate_n),
        actuators=state.actuators,
        engine=state.engine,
    )


def local_state(earth: RotatingEarth, state: EarthFixedState) -> AircraftState:
    """What is seen of a state in local axes: place in the chart, attitude and rates relative to local NED.

    At a pole, where no north exists, the attitude is that for longitude 0 and the rate of the axes has no bound.
    """
    position_n = earth.chart_from_ecef(state.position_e)
    lat, lon, _ = earth.geodetic(position_n)
    R_ne = rotation_ned_from_ecef(lat, lon)
    R_bn = compose(rotation_from_quaternion(state.quaternion), R_ne.T)
    local = earth.local(position_n, rotate_back(R_bn, state.velocity_b))
    back = _quaternion_ned_from_ecef(lat, lon) * jnp.array([1.0, -1.0, -1.0, -1.0])
    return AircraftState(
        position_n=position_n,
        velocity_b=state.velocity_b,
        quaternion=quaternion_multiply(back, state.quaternion),
        rates_b=state.rates_b - rotate(R_bn, local.earth_rate_n + local.transport_rate_n),
        actuators=state.actuators,
        engine=state.engine,
    )


def _quaternion_ned_from_ecef(lat: Scalar, lon: Scalar) -> Quaternion:
    """Quaternion of `rotation_ned_from_ecef`: a turn by the longitude, then down from the pole by the latitude."""
    return quaternion_from_euler(jnp.zeros_like(lat), -lat - 0.5 * jnp.pi, lon)


def round_earth_of(environment: Environment) -> RotatingEarth:
    """Give the environment's Earth where it is round; TypeError otherwise."""
    if not isinstance(environment.earth, RotatingEarth):
        raise TypeError(f"an Earth-fixed state needs a RotatingEarth, not a {type(environment.earth).__name__}")
    return environment.earth


def earth_fixed_derivative(
    airframe: AbstractAirframe,
    environment: Environment,
    time: ScalarLike,
    state: EarthFixedState,
    controls: Controls,
    disturbance: Disturbance | None = None,
) -> EarthFixedState:
    """Time derivative of the state over the environment's round Earth, as a state of derivatives.

    p_e' = R_eb v_b; v_b' = F/m + R_be g(p_e) - (w_bi + R_be w_E) x v_b with g = gravitation - w_E x (w_E x p_e);
    q' from w_bi - R_be w_E; w_bi' = J^-1 [M - w_bi x (J w_bi + h)]. Source: [SL] eq. 1.7-18.
    """
    earth = round_earth_of(environment)
    R_be = rotation_from_quaternion(state.quaternion)
    earth_rate_b = earth.rotation_rate * R_be[:, 2]
    rates_air_b = state.rates_b - earth_rate_b
    now = condition(airframe, environment, time, local_state(earth, state), rates_air_b, disturbance)
    wrench = now.wrench
    return EarthFixedState(
        position_e=rotate_back(R_be, state.velocity_b),
        velocity_b=wrench.force_b / airframe.mass_properties.mass
        + rotate(R_be, earth.effective_gravity_e(state.position_e))
        - cross(state.rates_b + earth_rate_b, state.velocity_b),
        quaternion=quaternion_derivative(state.quaternion, rates_air_b),
        rates_b=angular_acceleration(airframe.mass_properties, state.rates_b, wrench.moment_b),
        actuators=airframe.actuators.rate(state.actuators, controls.surfaces, now.air_data),
        engine=airframe.engine.rate(state.engine, controls.throttle, now.air_data),
    )
