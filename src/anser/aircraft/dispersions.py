"""Dispersed aircraft: airframes whose data deviate from the published values.

Dispersed are mass, inertia, centre of gravity, actuators, thrust and aerodynamic coefficients.
"""

from typing import TypeVar, cast

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft.actuators import AbstractActuators, FirstOrderActuators, SecondOrderActuators
from anser.aircraft.airframe import AbstractAirframe, MassProperties
from anser.aircraft.dave_ml_aircraft import DaveMlAircraft, DaveMlEngine
from anser.aircraft.derivative_aircraft import DerivativeAircraft
from anser.aircraft.engines import AbstractEngine, JetEngine, NoEngine
from anser.aircraft.f16 import F16_COEFFICIENTS, AbstractF16
from anser.aircraft.propellers import ElectricPropeller, PistonPropeller
from anser.numerics.linear import inverse3
from anser.shapes import Scalar, Vector, Vector3

AnyAirframe = TypeVar("AnyAirframe", bound=AbstractAirframe)


class BodyDispersion(eqx.Module):
    """Deviations of one aircraft except for aerodynamics; factors of 1 and a shift of 0 mean no change.

    Attributes
    ----------
    thrust, mass
        Factors on thrust and mass.
    second_moments
        Positive factors on the second moments of mass along body x, y, z, shape (3,). See `dispersed_mass`.
    actuator_bandwidth
        Positive factor on the bandwidth of every actuator.
    cg_shift
        Shift of the centre of gravity, fraction of the mean chord, positive aft.
    """

    thrust: Scalar
    mass: Scalar
    second_moments: Vector3
    actuator_bandwidth: Scalar
    cg_shift: Scalar


def dispersed_mass(properties: MassProperties, mass: Scalar, second_moments: Vector3) -> MassProperties:
    """Return mass properties with the mass and the second moments of mass (along body x, y, z) scaled by factors.

    The second moments are the integrals of x^2, y^2 and z^2 over the mass; Jxx is the sum of the second and third, and
    so on. A product of inertia is scaled by the square root of both factors: the body is stretched along its axes, so
    the principal moments remain positive and within the triangle inequality for any factors.
    """
    root = jnp.sqrt(second_moments)
    J_b, eye = properties.inertia_b, jnp.eye(3, dtype=properties.inertia_b.dtype)
    integrals = 0.5 * jnp.trace(J_b) * eye - J_b  # of r r^T
    # as a change of J, exactly zero for factors of 1
    change = integrals * (root[:, None] * root[None, :] - 1.0)
    changed_b = J_b + jnp.trace(change) * eye - change
    inverse_b = jnp.where(jnp.all(second_moments == 1.0), properties.inertia_inverse_b, inverse3(changed_b))
    return eqx.tree_at(
        lambda p: (p.mass, p.inertia_b, p.inertia_inverse_b),
        properties,
        (properties.mass * mass, changed_b, inverse_b),
    )


def dispersed_body(airframe: AnyAirframe, dispersion: BodyDispersion, shift_b: Vector3) -> AnyAirframe:
    """Return an airframe of the same structure with dispersed mass, actuators and thrust.

    The aerodynamics are unchanged; the caller must shift the moment reference.

    Parameters
    ----------
    airframe
        Nominal airframe.
    dispersion
        Deviations.
    shift_b
        Former centre of gravity relative to the new one, m.
    """
    changed = eqx.tree_at(
        lambda a: (a.mass_properties, a.actuators, a.engine),
        airframe,
        (
            dispersed_mass(airframe.mass_properties, dispersion.mass, dispersion.second_moments),
            _scale_bandwidth(airframe.actuators, dispersion.actuator_bandwidth),
            _scale_thrust(airframe.engine, dispersion.thrust, shift_b),
        ),
    )
    return cast(AnyAirframe, changed)


def _scale_bandwidth(actuators: AbstractActuators, factor: Scalar) -> AbstractActuators:
    """Return actuators with the bandwidth multiplied by a factor.

    Raises
    ------
    TypeError
        Unsupported class of actuators.
    """
    if isinstance(actuators, FirstOrderActuators):
        return eqx.tree_at(lambda a: a.time_constant, actuators, actuators.time_constant / factor)
    if isinstance(actuators, SecondOrderActuators):
        return eqx.tree_at(lambda a: a.frequency, actuators, actuators.frequency * factor)
    raise TypeError(f"actuators: arrived {type(actuators).__name__}; expected first- or second-order ones")


def _scale_thrust(engine: AbstractEngine, thrust: Scalar, shift_b: Vector3) -> AbstractEngine:
    """Return an engine with scaled thrust and with its thrust point relative to the new centre of gravity.

    `thrust` is a factor; `shift_b` (m) points from the new centre of gravity to the former. Only the classes named here
    are supported: a new class of engine must be added.

    Raises
    ------
    TypeError
        Unsupported class of engine.
    """
    if isinstance(engine, NoEngine):
        return engine
    if not isinstance(engine, DaveMlEngine | JetEngine | ElectricPropeller | PistonPropeller):
        raise TypeError(f"engine: arrived {type(engine).__name__}; expected a jet, a propeller, one by DAVE-ML")
    return eqx.tree_at(
        lambda e: (e.thrust_factor, e.point_b), engine, (engine.thrust_factor * thrust, engine.point_b + shift_b)
    )


class DerivativeDispersion(eqx.Module):
    """Dispersion of an aircraft given by derivatives; factors of 1 mean no change.

    Attributes
    ----------
    derivatives
        Factor on each of `DerivativeAircraft.derivatives`.
    tables
        Factor on each function of the aircraft's tables; None without tables.
    body
        Dispersion of mass, actuators and thrust.
    """

    derivatives: Float[Array, "6 columns"]
    tables: Vector | None
    body: BodyDispersion


def dispersed_derivative_aircraft(aircraft: DerivativeAircraft, dispersion: DerivativeDispersion) -> DerivativeAircraft:
    """Return a copy of the aircraft, of the same structure, whose data deviate by `dispersion`."""
    forward_b = jnp.stack([dispersion.body.cg_shift * aircraft.mean_chord, *jnp.zeros(2)])
    changed = eqx.tree_at(
        lambda a: (a.derivatives, a.cg_offset_b),
        dispersed_body(aircraft, dispersion.body, forward_b),
        (aircraft.derivatives * dispersion.derivatives, aircraft.cg_offset_b - forward_b),
    )
    if aircraft.table_factors is None or dispersion.tables is None:
        return changed
    return eqx.tree_at(lambda a: a.table_factors, changed, aircraft.table_factors * dispersion.tables)


def dispersed_dave_ml_aircraft(
    aircraft: DaveMlAircraft, coefficients: Float[Array, "6"], body: BodyDispersion
) -> DaveMlAircraft:
    """Return a copy of the aircraft, of the same structure, whose data deviate by the given factors.

    Parameters
    ----------
    aircraft
        Nominal aircraft.
    coefficients
        Factors on CX, CY, CZ, Cl, Cm, Cn about the moment reference centre of the file.
    body
        Deviations of mass, inertia, actuators and thrust.
    """
    forward_b = jnp.stack([body.cg_shift * aircraft.mean_chord, *jnp.zeros(2)])
    return eqx.tree_at(
        lambda a: (a.coefficient_factors, a.centre_b),
        dispersed_body(aircraft, body, forward_b),
        (aircraft.coefficient_factors * coefficients, aircraft.centre_b - forward_b),
    )


AnyF16 = TypeVar("AnyF16", bound=AbstractF16)


class F16Dispersion(eqx.Module):
    """Dispersion of an F-16; factors of 1 and a shift of 0 mean no change.

    Attributes
    ----------
    coefficients
        Factor on each of `F16_COEFFICIENTS`, shape (22,), of any sign.
    thrust, mass
        Factors.
    second_moments
        Positive factors on the second moments of mass along body x, y, z, shape (3,). See `dispersed_mass`.
    actuator_bandwidth
        Positive factor on the bandwidth (inverse time constant) of every actuator.
    cg_shift
        Shift of the centre of gravity, fraction of the mean chord, positive aft.
    """

    coefficients: Float[Array, "22"]
    thrust: Scalar
    mass: Scalar
    second_moments: Vector3
    actuator_bandwidth: Scalar
    cg_shift: Scalar


def no_dispersion() -> F16Dispersion:
    """Return the F-16's dispersion without any deviation from the published data."""
    unity = jnp.ones(())
    return F16Dispersion(jnp.ones(len(F16_COEFFICIENTS)), unity, unity, jnp.ones(3), unity, jnp.zeros(()))


def dispersed_f16(f16: AnyF16, dispersion: F16Dispersion) -> AnyF16:
    """Return a copy of the F-16, of the same class and structure, whose data deviate by `dispersion`.

    A factor scales a table or coefficient as a whole, hence its contribution to the build-up; the table arguments are
    unchanged. The c.g. terms in Cm and Cn follow the shift.
    """
    scaled = eqx.tree_at(
        lambda a: (
            a.engine.thrust_tables.cells[0],
            a.mass_properties,
            a.actuators.time_constant,
            a.x_cg,
        ),
        f16.with_coefficients_scaled(dispersion.coefficients),
        (
            f16.engine.thrust_tables.cells[0] * dispersion.thrust,
            dispersed_mass(f16.mass_properties, dispersion.mass, dispersion.second_moments),
            f16.actuators.time_constant / dispersion.actuator_bandwidth,
            f16.x_cg + dispersion.cg_shift,
        ),
    )
    return cast(AnyF16, scaled)
