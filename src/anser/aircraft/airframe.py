"""The interface of an airframe to autopilot, trim and simulation: state, controls, mass properties, aerodynamics."""

import abc
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array

from anser.aircraft.actuators import AbstractActuators
from anser.aircraft.air_data import AirData, Wrench, is_outside
from anser.aircraft.engines import AbstractEngine
from anser.airframe_data import body_faults
from anser.numerics.arrays import as_array
from anser.shapes import Flag, Matrix33, Quaternion, Scalar, Vector, Vector3


class AircraftState(eqx.Module):
    """State of one aircraft relative to the local NED axes: motion, actuators and engine.

    This state is integrated over a flat Earth. Over a round Earth an `EarthFixedState` is integrated, and the
    `AircraftState` is computed from the result (`anser.aircraft.motion`).
    """

    position_n: Vector3  #: Position North, East, Down in the Earth's chart (local map), m; altitude is minus Down.
    velocity_b: Vector3  #: Velocity (U, V, W) over ground in body axes, m/s.
    quaternion: Quaternion  #: Attitude (q0, q1, q2, q3), scalar first, from NED to body axes.
    #: Body rates (P, Q, R) relative to the local NED axes, rad/s; over a flat Earth equal to the inertial rates.
    rates_b: Vector3
    actuators: Any  #: State of the airframe's actuators, with an attribute `position` (rad).
    engine: Any  #: State of the airframe's engine, with an attribute `power` (percent).

    @property
    def surfaces(self) -> Array:
        """Deflections of the control surfaces, in the order of the airframe's actuators, rad."""
        return self.actuators.position

    @property
    def power(self) -> Array:
        """Power setting of the engine in percent of its maximum, not a power in watts."""
        return self.engine.power


class Controls(eqx.Module):
    """Inputs from pilot or autopilot: surface commands (rad, in the order of the actuators) and throttle (0..1)."""

    surfaces: Vector
    throttle: Scalar


class MassProperties(eqx.Module):
    """Mass properties of one aircraft; moments of inertia are about the centre of gravity."""

    mass: Scalar  #: Mass, kg.
    inertia_b: Matrix33  #: Inertia matrix, body axes, kg m^2.
    inertia_inverse_b: Matrix33  #: Inverse of `inertia_b`.
    spin_momentum_b: Vector3  #: Angular momentum of spinning parts (engine), body axes, kg m^2/s.


def rigid_body(mass: float, inertia_b: np.ndarray, spin: float = 0.0) -> MassProperties:
    """Return the mass properties of a rigid body with a mass (kg) and an inertia matrix (kg m^2, body axes).

    `spin` is the angular momentum of the engine about body x, kg m^2/s.
    """
    return MassProperties(
        mass=as_array(mass),
        inertia_b=as_array(inertia_b),
        inertia_inverse_b=as_array(np.linalg.inv(inertia_b)),
        spin_momentum_b=as_array([spin, 0.0, 0.0]),
    )


class AbstractAirframe(eqx.Module):
    """Interface of an airframe.

    A new airframe is a direct subclass with a method `aerodynamics`; concrete airframes are not subclassed.
    """

    mass_properties: eqx.AbstractVar[MassProperties]  #: Mass, inertia and angular momentum of the engine.
    actuators: eqx.AbstractVar[AbstractActuators]  #: Dynamics, limits and names of the control surfaces.
    #: Thrust, lag from throttle to power, and functions with which controllers find the throttle.
    engine: eqx.AbstractVar[AbstractEngine]
    #: Valid range (minimum, maximum) of angle of attack and of sideslip, rad.
    alpha_range: eqx.AbstractVar[tuple[Scalar, Scalar]]
    beta_range: eqx.AbstractVar[tuple[Scalar, Scalar]]

    @property
    def symmetric(self) -> bool:
        """Whether the side force is zero if sideslip, rates and deflections are zero; False if unknown.

        If True, the autopilot compiles without the compensation of a side force.
        """
        return False

    @abc.abstractmethod
    def aerodynamics(self, air_data: AirData, rates_b: Vector3, surfaces: Vector) -> Wrench:
        """Compute the aerodynamic force (N) and the moment about the centre of gravity (N m), in body axes.

        `rates_b` are the body rates relative to the air, rad/s; `surfaces` are the deflections in the actuators' order,
        rad.
        """

    def outside_tables(self, air_data: AirData) -> Flag:
        """Whether the flight condition is outside the valid range of the airframe's or the engine's data.

        By default the ranges of the airframe are `alpha_range` and `beta_range`; subclasses may add limits.
        """
        return (
            is_outside(air_data.alpha, self.alpha_range)
            | is_outside(air_data.beta, self.beta_range)
            | self.engine.outside_tables(air_data)
        )


_LENGTHS = ("span", "wing_area", "mean_chord")
"""Attributes of an airframe that hold reference lengths or the wing area and must be positive."""


def refuse_impossible_body(airframe: AbstractAirframe, name: str) -> None:
    """Raise ValueError if mass properties, wing area, span or chord of an airframe are physically impossible.

    `inertia_b` must be symmetric and `inertia_inverse_b` must be its inverse. The numbers must not be traced by JAX.
    The message calls the airframe `name`.
    """
    properties = airframe.mass_properties
    J_b = np.asarray(properties.inertia_b, dtype=float)
    if J_b.shape != (3, 3) or not np.allclose(J_b, J_b.T, rtol=0.0, atol=1e-9 * np.abs(J_b).max()):
        defect = f"of shape {J_b.shape}" if J_b.shape != (3, 3) else "that is not symmetric"
        raise ValueError(f"{name}: arrived mass_properties.inertia_b {defect}; expected a symmetric matrix, 3 by 3")
    positive = {"mass_properties.mass": float(properties.mass)}
    positive |= {key: float(value) for key in _LENGTHS if (value := getattr(airframe, key, None)) is not None}
    for fault in body_faults(positive, J_b.tolist()):
        quantity_path = (
            fault.quantity if fault.quantity in positive else f"{fault.quantity} in mass_properties.inertia_b"
        )
        raise ValueError(f"{name}: arrived {fault.arrived:.10g} as {quantity_path}; expected {fault.expected}")
    if not np.allclose(J_b @ np.asarray(properties.inertia_inverse_b, dtype=float), np.eye(3), atol=1e-6):
        requirement = "the inverse of mass_properties.inertia_b"
        raise ValueError(f"{name}: arrived another matrix as mass_properties.inertia_inverse_b; expected {requirement}")
