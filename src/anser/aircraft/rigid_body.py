"""Forces on one aircraft, and its six-degree-of-freedom motion over a flat, non-rotating Earth (theory section 2)."""

import equinox as eqx

from anser.aircraft.air_data import AirData, air_data
from anser.aircraft.disturbance import Disturbance
from anser.aircraft.interface import AbstractAirframe, AircraftState, Controls, MassProperties
from anser.aircraft.wrench import Wrench
from anser.environment import Environment, LocalEarth
from anser.numerics import cross, times3
from anser.shapes import Matrix33, ScalarLike, Vector3
from anser.spatial import quaternion_derivative, rotate, rotate_back, rotation_from_quaternion


class Condition(eqx.Module):
    """Everything that follows from one state at one instant, computed once and passed on.

    Attributes
    ----------
    R_bn
        Rotation NED to body.
    wind_n
        Mean velocity of the air over ground, without gusts, m/s.
    air_data
        See `AirData`; gusts are in it.
    earth
        What the Earth means here at this velocity.
    aerodynamic, propulsive
        Forces and moments on the aircraft.
    """

    R_bn: Matrix33
    wind_n: Vector3
    air_data: AirData
    earth: LocalEarth
    aerodynamic: Wrench
    propulsive: Wrench

    @property
    def wrench(self) -> Wrench:
        """Total force and moment without gravity."""
        return self.aerodynamic + self.propulsive


def condition(
    airframe: AbstractAirframe,
    environment: Environment,
    time: ScalarLike,
    state: AircraftState,
    rates_air_b: Vector3 | None = None,
    disturbance: Disturbance | None = None,
) -> Condition:
    """Air data, forces and moments of a state at a time (s).

    The air turns with the Earth: what damps are the body rates relative to it, not those relative to the travelling NED
    axes, nor the inertial ones. Where they are known otherwise, `rates_air_b` gives them, rad/s: at a pole, where the
    travelling axes turn without bound, they do not follow from the state. `disturbance` is what is met besides the mean
    wind, None: nothing.
    """
    R_bn = rotation_from_quaternion(state.quaternion)
    wind_n = environment.wind.at(state.position_n, time)
    altitude = -state.position_n[2]
    earth = environment.earth.local(state.position_n, rotate_back(R_bn, state.velocity_b))
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
    return Condition(
        R_bn=R_bn,
        wind_n=wind_n,
        air_data=data,
        earth=earth,
        aerodynamic=airframe.aerodynamics(data, rates_air_b, state.surfaces),
        propulsive=propulsive,
    )


def angular_acceleration(mass_properties: MassProperties, rates_b: Vector3, moment_b: Vector3) -> Vector3:
    """J^-1 [M - w x (J w + h)], rad/s^2 (theory section 2; [SL] eq. 1.7-5 with the spinning engine)."""
    momentum_b = times3(mass_properties.inertia_b, rates_b) + mass_properties.spin_momentum_b
    return times3(mass_properties.inertia_inverse_b, moment_b - cross(rates_b, momentum_b))


def moment_for_acceleration(mass_properties: MassProperties, rates_b: Vector3, acceleration_b: Vector3) -> Vector3:
    """Moment that gives an angular acceleration (rad/s^2): the inverse of `angular_acceleration`, N m."""
    momentum_b = times3(mass_properties.inertia_b, rates_b) + mass_properties.spin_momentum_b
    return times3(mass_properties.inertia_b, acceleration_b) + cross(rates_b, momentum_b)


def state_derivative(
    airframe: AbstractAirframe,
    environment: Environment,
    time: ScalarLike,
    state: AircraftState,
    controls: Controls,
    disturbance: Disturbance | None = None,
) -> AircraftState:
    """Time derivative of the state over a flat Earth, as a state of derivatives; see `round_earth` for the other.

    Wind enters through the air-relative velocity only, which is exact for a steady wind.
    """
    now = condition(airframe, environment, time, state, disturbance=disturbance)
    wrench = now.wrench
    return AircraftState(
        position_n=rotate_back(now.R_bn, state.velocity_b),
        velocity_b=wrench.force_b / airframe.mass_properties.mass
        + rotate(now.R_bn, now.earth.apparent_gravity_n)
        - cross(state.rates_b, state.velocity_b),
        quaternion=quaternion_derivative(state.quaternion, state.rates_b),
        rates_b=angular_acceleration(airframe.mass_properties, state.rates_b, wrench.moment_b),
        actuators=airframe.actuators.rate(state.actuators, controls.surfaces, now.air_data),
        engine=airframe.engine.rate(state.engine, controls.throttle, now.air_data),
    )
