"""What every airframe publishes: all that the autopilot, the trim solver and the simulation know of an aircraft."""

import abc
from typing import Any

import equinox as eqx

from anser.aircraft.actuators import AbstractActuators
from anser.aircraft.air_data import AirData
from anser.aircraft.engine import AbstractEngine
from anser.aircraft.wrench import Wrench
from anser.shapes import Flag, Matrix33, Quaternion, Scalar, Vector, Vector3


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
    actuators
        State of the airframe's actuators, a structure of their own with the attribute `position`.
    engine
        State of the airframe's engine, a structure of its own with the attribute `power`.
    """

    position_n: Vector3
    velocity_b: Vector3
    quaternion: Quaternion
    rates_b: Vector3
    actuators: Any
    engine: Any

    @property
    def surfaces(self) -> Vector:
        """Deflections in the order of the airframe's surfaces, rad."""
        return self.actuators.position

    @property
    def power(self) -> Scalar:
        """Engine power, percent of maximum."""
        return self.engine.power


class Controls(eqx.Module):
    """What a pilot or autopilot sets: commanded surfaces (in the airframe's order, rad) and throttle (0..1)."""

    surfaces: Vector
    throttle: Scalar


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
    """Interface of an airframe; concrete airframes are final.

    Attributes
    ----------
    mass_properties
        See `MassProperties`.
    actuators
        Dynamics, limits and names of its control surfaces.
    engine
        Thrust, lag and their inverses.
    alpha_range, beta_range
        Least and greatest angle of attack and sideslip for which the data are valid, rad.
    """

    mass_properties: eqx.AbstractVar[MassProperties]
    actuators: eqx.AbstractVar[AbstractActuators]
    engine: eqx.AbstractVar[AbstractEngine]
    alpha_range: eqx.AbstractVar[tuple[Scalar, Scalar]]
    beta_range: eqx.AbstractVar[tuple[Scalar, Scalar]]

    @property
    def symmetric(self) -> bool:
        """Whether there is no side force without sideslip, rates and deflections; False where nobody knows.

        Static: the autopilot then does not look for one.
        """
        return False

    @abc.abstractmethod
    def aerodynamics(self, air_data: AirData, rates_b: Vector3, surfaces: Vector) -> Wrench:
        """Aerodynamic force and moment for the given air data, body rates (rad/s) and deflections (rad)."""

    @abc.abstractmethod
    def outside_tables(self, air_data: AirData) -> Flag:
        """Whether the flight condition lies outside the range of the airframe's data, its engine's among them."""
