"""Six-degree-of-freedom motion of one aircraft over a flat Earth (local axes) and a round Earth (Earth-fixed axes)."""

from typing import Any, TypeVar, cast

import equinox as eqx
import jax.numpy as jnp

from anser.aircraft.air_data import AirData, Disturbance, Wrench, air_data
from anser.aircraft.airframe import AbstractAirframe, AircraftState, Controls, MassProperties
from anser.environment.earth import LocalEarth, RotatingEarth
from anser.environment.environment import Environment
from anser.numerics.linear import cross, times3
from anser.shapes import Matrix33, Quaternion, Scalar, ScalarLike, Vector3
from anser.spatial.frames import rotation_ned_from_ecef
from anser.spatial.rotations import (
    compose,
    quaternion_derivative,
    quaternion_from_euler,
    quaternion_multiply,
    rotate,
    rotate_back,
    rotation_from_quaternion,
)


class AirDataAndForces(eqx.Module):
    """Air data, forces and moments of one aircraft at one time."""

    R_bn: Matrix33  #: Rotation matrix from NED to body axes.
    wind_n: Vector3  #: Mean wind over ground, without gusts, NED, m/s; the air data include gusts.
    air_data: AirData
    earth: LocalEarth  #: Terms of the equations of motion from the Earth model.
    #: Forces (N) and moments about the centre of gravity (N m), body axes.
    aerodynamic: Wrench
    propulsive: Wrench

    @property
    def wrench(self) -> Wrench:
        """Total of the aerodynamic and propulsive force (N) and moment (N m); gravity is not included."""
        return self.aerodynamic + self.propulsive


def air_data_and_forces(
    airframe: AbstractAirframe,
    environment: Environment,
    time: ScalarLike,
    state: AircraftState,
    rates_air_b: Vector3 | None = None,
    disturbance: Disturbance | None = None,
) -> AirDataAndForces:
    """Compute air data, forces and moments of a state at a time (s).

    `rates_air_b` are the body rates (rad/s) relative to the air without gusts, which rotates with the Earth. None: the
    rates are computed from `state.rates_b`, relative to the NED axes, which fails at the poles. `disturbance` None:
    neither gust nor loss of thrust.
    """
    R_bn = rotation_from_quaternion(state.quaternion)
    wind_n = environment.wind.at(state.position_n, time)
    altitude = -state.position_n[2]
    earth = environment.earth.local_earth(state.position_n, rotate_back(R_bn, state.velocity_b))
    if rates_air_b is None:
        rates_air_b = state.rates_b + rotate(R_bn, earth.transport_rate_n)
    velocity_air_b = state.velocity_b - rotate(R_bn, wind_n)
    if disturbance is not None:
        velocity_air_b = velocity_air_b - disturbance.gust.velocity_b
        rates_air_b = rates_air_b - disturbance.gust.rates_b
    data = air_data(velocity_air_b, altitude, environment.atmosphere.at(altitude))
    propulsive = airframe.engine.propulsion(state.power, data)
    if disturbance is not None:
        propulsive = Wrench(disturbance.thrust * propulsive.force_b, disturbance.thrust * propulsive.moment_b)
    return AirDataAndForces(
        R_bn=R_bn,
        wind_n=wind_n,
        air_data=data,
        earth=earth,
        aerodynamic=airframe.aerodynamics(data, rates_air_b, state.surfaces),
        propulsive=propulsive,
    )


def modelled_air_data_and_forces(
    airframe: AbstractAirframe, condition: AirDataAndForces, data: AirData, state: AircraftState
) -> AirDataAndForces:
    """Return a copy of `condition` with other air data (`data`) and with the forces of the model `airframe` in `data`.

    Deflections, power and rates are taken from `state`. The forces include neither a loss of thrust nor the effect of
    rotating air in gusts.
    """
    rates_air_b = state.rates_b + rotate(condition.R_bn, condition.earth.transport_rate_n)
    return AirDataAndForces(
        R_bn=condition.R_bn,
        wind_n=condition.wind_n,
        air_data=data,
        earth=condition.earth,
        aerodynamic=airframe.aerodynamics(data, rates_air_b, state.surfaces),
        propulsive=airframe.engine.propulsion(state.power, data),
    )


def angular_acceleration(mass_properties: MassProperties, rates_b: Vector3, moment_b: Vector3) -> Vector3:
    """Return the angular acceleration J^-1 [M - w x (J w + h)], body axes, rad/s^2.

    Symbols: inertia J, moment M (N m), inertial body rates w (rad/s), angular momentum h of the engine. Source: theory
    section 2; [SL] eq. 1.7-5 with engine spin.
    """
    momentum_b = times3(mass_properties.inertia_b, rates_b) + mass_properties.spin_momentum_b
    return times3(mass_properties.inertia_inverse_b, moment_b - cross(rates_b, momentum_b))


def moment_for_acceleration(mass_properties: MassProperties, rates_b: Vector3, acceleration_b: Vector3) -> Vector3:
    """Return the moment (N m, body axes) for an angular acceleration (rad/s^2): inverse of `angular_acceleration`."""
    momentum_b = times3(mass_properties.inertia_b, rates_b) + mass_properties.spin_momentum_b
    return times3(mass_properties.inertia_b, acceleration_b) + cross(rates_b, momentum_b)


def flat_earth_derivative(
    airframe: AbstractAirframe,
    environment: Environment,
    time: ScalarLike,
    state: AircraftState,
    controls: Controls,
    disturbance: Disturbance | None = None,
) -> AircraftState:
    """Return the time derivative of the state over a flat Earth, as an `AircraftState` of rates per second.

    `disturbance` None: neither gust nor loss of thrust. For a round Earth see `earth_fixed_derivative`.
    """
    condition = air_data_and_forces(airframe, environment, time, state, disturbance=disturbance)
    wrench = condition.wrench
    return AircraftState(
        position_n=rotate_back(condition.R_bn, state.velocity_b),
        velocity_b=wrench.force_b / airframe.mass_properties.mass
        + rotate(condition.R_bn, condition.earth.apparent_gravity_n)
        - cross(state.rates_b, state.velocity_b),
        quaternion=quaternion_derivative(state.quaternion, state.rates_b),
        rates_b=angular_acceleration(airframe.mass_properties, state.rates_b, wrench.moment_b),
        actuators=airframe.actuators.rate(state.actuators, controls.surfaces, condition.air_data),
        engine=airframe.engine.rate(state.engine, controls.throttle, condition.air_data),
    )


class EarthFixedState(eqx.Module):
    """State of one aircraft in Earth-fixed axes for integration over a round Earth; regular at poles and date line."""

    position_e: Vector3  #: Position in ECEF axes, m.
    velocity_b: Vector3  #: Velocity relative to the rotating Earth, body axes, m/s.
    quaternion: Quaternion  #: Attitude from ECEF to body axes, scalar first.
    rates_b: Vector3  #: Inertial angular velocity, body axes, rad/s.
    actuators: Any  #: State of the actuators.
    engine: Any  #: State of the engine.


def earth_fixed_state(earth: RotatingEarth, state: AircraftState) -> EarthFixedState:
    """Convert a state in local axes to an Earth-fixed state: the inverse of `local_state`."""
    lat, lon, _ = earth.geodetic(state.position_n)
    R_bn = rotation_from_quaternion(state.quaternion)
    local = earth.local_earth(state.position_n, rotate_back(R_bn, state.velocity_b))
    return EarthFixedState(
        position_e=earth.ecef_from_chart(state.position_n),
        velocity_b=state.velocity_b,
        quaternion=quaternion_multiply(_quaternion_ned_from_ecef(lat, lon), state.quaternion),
        rates_b=state.rates_b + rotate(R_bn, local.earth_rate_n + local.transport_rate_n),
        actuators=state.actuators,
        engine=state.engine,
    )


def local_state(earth: RotatingEarth, state: EarthFixedState) -> AircraftState:
    """Convert an Earth-fixed state to a state in the chart (local map), with attitude and rates relative to local NED.

    At a pole the attitude is relative to longitude 0, because north is undefined, and the rates of the NED axes are
    unbounded.
    """
    position_n = earth.chart_from_ecef(state.position_e)
    lat, lon, _ = earth.geodetic(position_n)
    R_ne = rotation_ned_from_ecef(lat, lon)
    R_bn = compose(rotation_from_quaternion(state.quaternion), R_ne.T)
    local = earth.local_earth(position_n, rotate_back(R_bn, state.velocity_b))
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
    """Return the quaternion of the rotation from ECEF to NED axes at a geodetic latitude and longitude (rad)."""
    return quaternion_from_euler(jnp.zeros_like(lat), -lat - 0.5 * jnp.pi, lon)


def require_round_earth(environment: Environment) -> RotatingEarth:
    """Return the environment's Earth model. Raises TypeError if the model is not a `RotatingEarth`."""
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
    """Return the time derivative of the state over the environment's round Earth, as a state of rates per second.

    Raises TypeError if the environment's Earth is not a `RotatingEarth`. Source: [SL] eq. 1.7-18:

    - p_e' = R_eb v_b
    - v_b' = F/m + R_be g(p_e) - (w_bi + R_be w_E) x v_b, with g = gravitation - w_E x (w_E x p_e)
    - q' from the rates w_bi - R_be w_E
    - w_bi' = J^-1 [M - w_bi x (J w_bi + h)]

    Symbols: position p_e (ECEF), velocity v_b over ground, inertial body rates w_bi, rate of the Earth w_E, force F,
    moment M, angular momentum h of the engine.
    """
    earth = require_round_earth(environment)
    R_be = rotation_from_quaternion(state.quaternion)
    earth_rate_b = earth.rotation_rate * R_be[:, 2]
    rates_air_b = state.rates_b - earth_rate_b
    condition = air_data_and_forces(airframe, environment, time, local_state(earth, state), rates_air_b, disturbance)
    wrench = condition.wrench
    return EarthFixedState(
        position_e=rotate_back(R_be, state.velocity_b),
        velocity_b=wrench.force_b / airframe.mass_properties.mass
        + rotate(R_be, earth.effective_gravity_e(state.position_e))
        - cross(state.rates_b + earth_rate_b, state.velocity_b),
        quaternion=quaternion_derivative(state.quaternion, rates_air_b),
        rates_b=angular_acceleration(airframe.mass_properties, state.rates_b, wrench.moment_b),
        actuators=airframe.actuators.rate(state.actuators, controls.surfaces, condition.air_data),
        engine=airframe.engine.rate(state.engine, controls.throttle, condition.air_data),
    )


MotionState = AircraftState | EarthFixedState
"""State for integration: `AircraftState` over a flat Earth, `EarthFixedState` over a round Earth."""

AnyMotionState = TypeVar("AnyMotionState", bound=MotionState)


def to_motion_state(environment: Environment, state: AircraftState) -> MotionState:
    """Convert a state in local NED axes to the state that is integrated: an `EarthFixedState` over a `RotatingEarth`.

    Over a flat Earth the state is returned unchanged.
    """
    earth = environment.earth
    return earth_fixed_state(earth, state) if isinstance(earth, RotatingEarth) else state


def to_local_state(environment: Environment, state: MotionState) -> AircraftState:
    """Convert a state from the integration (local or Earth-fixed axes) to the state in local NED axes."""
    if isinstance(state, AircraftState):
        return state
    return local_state(require_round_earth(environment), state)


def motion_derivative(
    airframe: AbstractAirframe,
    environment: Environment,
    time: ScalarLike,
    state: AnyMotionState,
    controls: Controls,
    disturbance: Disturbance | None = None,
) -> AnyMotionState:
    """Return the time derivative of a state, as an object of the state's class with rates per second.

    An `AircraftState` moves over a flat Earth, an `EarthFixedState` over a round Earth. `disturbance` None: neither
    gust nor loss of thrust.
    """
    if isinstance(state, AircraftState):
        return cast(AnyMotionState, flat_earth_derivative(airframe, environment, time, state, controls, disturbance))
    return cast(AnyMotionState, earth_fixed_derivative(airframe, environment, time, state, controls, disturbance))
