"""What every airframe publishes: all that the autopilot, the trim solver and the simulation know of an aircraft."""

import abc

import equinox as eqx

from anser.aircraft.actuators import Actuators
from anser.aircraft.air_data import AirData
from anser.shapes import Flag, Matrix33, Quaternion, Scalar, ScalarLike, Vector3


class AircraftState(eqx.Module):
    """State of one aircraft as seen in the local NED axes, over any Earth.

    Over a flat Earth it is what is integrated; over a round one it is derived (`anser.aircraft.round_earth`).

    Attributes
    ----------
    position_n
        North, East, Down in the Earth's chart, m; altitude is minus the third component.
    velocity_b
        (U, V, W) over ground in body axes, m/s.
    quaternion
        (q0, q1, q2, q3), scalar first, NED to body.
    rates_b
        (P, Q, R) relative to the local NED axes, rad/s; over a flat Earth these are the inertial rates.
    surfaces
        Elevator, aileron, rudder deflection, rad.
    power
        Engine power, percent of maximum.
    """

    position_n: Vector3
    velocity_b: Vector3
    quaternion: Quaternion
    rates_b: Vector3
    surfaces: Vector3
    power: Scalar


class Controls(eqx.Module):
    """What a pilot or autopilot sets: commanded surfaces (elevator, aileron, rudder; rad) and throttle (0..1)."""

    surfaces: Vector3
    throttle: Scalar


class Wrench(eqx.Module):
    """A force (N) and a moment about the centre of gravity (N m), both in body axes."""

    force_b: Vector3
    moment_b: Vector3

    def __add__(self, other: "Wrench") -> "Wrench":
        return Wrench(self.force_b + other.force_b, self.moment_b + other.moment_b)


class MassProperties(eqx.Module):
    """Mass and inertia.

    Attributes
    ----------
    mass
        kg.
    inertia_b, inertia_inverse_b
        Inertia matrix about the centre of gravity in body axes, kg m^2, and its inverse.
    spin_momentum_b
        Angular momentum of spinning parts (engine), kg m^2/s.
    """

    mass: Scalar
    inertia_b: Matrix33
    inertia_inverse_b: Matrix33
    spin_momentum_b: Vector3


class AbstractAirframe(eqx.Module):
    """Interface of an airframe with its engine; concrete airframes are final.

    Attributes
    ----------
    mass_properties
        See `MassProperties`.
    actuators
        Dynamics and limits of elevator, aileron and rudder.
    alpha_range, beta_range
        Least and greatest angle of attack and sideslip for which the data are valid, rad.
    """

    mass_properties: eqx.AbstractVar[MassProperties]
    actuators: eqx.AbstractVar[Actuators]
    alpha_range: eqx.AbstractVar[tuple[Scalar, Scalar]]
    beta_range: eqx.AbstractVar[tuple[Scalar, Scalar]]

    @abc.abstractmethod
    def aerodynamics(self, air_data: AirData, rates_b: Vector3, surfaces: Vector3) -> Wrench:
        """Aerodynamic force and moment for the given air data, body rates (rad/s) and deflections (rad)."""

    @abc.abstractmethod
    def propulsion(self, power: ScalarLike, altitude: ScalarLike, mach: ScalarLike) -> Wrench:
        """Thrust force and moment at a power (percent), geometric altitude (m) and Mach number."""

    @abc.abstractmethod
    def power_rate(self, power: ScalarLike, throttle: ScalarLike) -> Scalar:
        """Rate of change of engine power, percent per second, at the given power and throttle (0..1)."""

    @abc.abstractmethod
    def power_for_thrust(self, thrust: ScalarLike, altitude: ScalarLike, mach: ScalarLike) -> Scalar:
        """Power (percent, within what the engine can give) whose thrust along body x is nearest to `thrust` (N)."""

    @abc.abstractmethod
    def throttle_for_power(self, power: ScalarLike) -> Scalar:
        """Throttle (0..1) that holds a power (percent) steadily: the inverse of the gearing."""

    @abc.abstractmethod
    def throttle_for_power_rate(self, power: ScalarLike, power_rate: ScalarLike) -> Scalar:
        """Throttle (0..1) whose engine lag gives nearest to the wanted rate (percent/s) at the present power."""

    @abc.abstractmethod
    def outside_tables(self, air_data: AirData) -> Flag:
        """Whether the flight condition lies outside the range of the airframe's data."""
