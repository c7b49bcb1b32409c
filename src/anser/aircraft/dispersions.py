"""Dispersed aircraft: mass.

Inertia, centre of gravity, actuators, thrust and aerodynamic coefficients that differ from the published data.
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
    """How one aircraft differs from its data but for its aerodynamics; factors of 1 and a shift of 0 leave it as it is.

    Attributes
    ----------
    thrust, mass
        Factors.
    second_moments
        Factors on the second moments of mass along body x, y, z, shape (3,); positive. See `dispersed_mass`.
    actuator_bandwidth
        Factor on the bandwidth of all actuators; positive.
    cg_shift
        Of the centre of gravity, part of the mean chord; positive is aft.
    """

    thrust: Scalar
    mass: Scalar
    second_moments: Vector3
    actuator_bandwidth: Scalar
    cg_shift: Scalar


def dispersed_mass(properties: MassProperties, mass: Scalar, second_moments: Vector3) -> MassProperties:
    """Mass properties with a factor on the mass, and on each second moment of mass.

    The second moments are the integrals of x^2, y^2 and z^2 over the mass; Jxx is the sum of the latter two, and so on.
    A product of inertia changes by the root of both of its factors: the body is stretched along its axes, so that its
    principal moments are positive and within the triangle inequality whatever the factors.
    """
    root = jnp.sqrt(second_moments)
    J_b, eye = properties.inertia_b, jnp.eye(3, dtype=properties.inertia_b.dtype)
    integrals = 0.5 * jnp.trace(J_b) * eye - J_b  # of r r^T
    # as a change of J, which is exactly none for factors of 1
    change = integrals * (root[:, None] * root[None, :] - 1.0)
    changed_b = J_b + jnp.trace(change) * eye - change
    inverse_b = jnp.where(jnp.all(second_moments == 1.0), properties.inertia_inverse_b, inverse3(changed_b))
    return eqx.tree_at(
        lambda p: (p.mass, p.inertia_b, p.inertia_inverse_b),
        properties,
        (properties.mass * mass, changed_b, inverse_b),
    )


def dispersed_body(airframe: AnyAirframe, dispersion: BodyDispersion, shift_b: Vector3) -> AnyAirframe:
    """Airframe of the same structure with another mass, other actuators and another thrust.

    Its aerodynamics are as before: whoever calls moves their centre of gravity.

    Parameters
    ----------
    airframe
        As its data have it.
    dispersion
        How it differs.
    shift_b
        What the centre of gravity was before, seen from where it is now, m.
    """
    changed = eqx.tree_at(
        lambda a: (a.mass_properties, a.actuators, a.engine),
        airframe,
        (
            dispersed_mass(airframe.mass_properties, dispersion.mass, dispersion.second_moments),
            _quickened(airframe.actuators, dispersion.actuator_bandwidth),
            _changed_engine(airframe.engine, dispersion.thrust, shift_b),
        ),
    )
    return cast(AnyAirframe, changed)


def _quickened(actuators: AbstractActuators, factor: Scalar) -> AbstractActuators:
    """Actuators of another bandwidth.

    Raises
    ------
    TypeError
        Actuators of a kind that has no bandwidth known here.
    """
    if isinstance(actuators, FirstOrderActuators):
        return eqx.tree_at(lambda a: a.time_constant, actuators, actuators.time_constant / factor)
    if isinstance(actuators, SecondOrderActuators):
        return eqx.tree_at(lambda a: a.frequency, actuators, actuators.frequency * factor)
    raise TypeError(f"actuators: arrived {type(actuators).__name__}; expected first- or second-order ones")


def _changed_engine(engine: AbstractEngine, thrust: Scalar, shift_b: Vector3) -> AbstractEngine:
    """Engine with a factor on its thrust, seen from a centre of gravity that lies so far behind (m).

    Raises
    ------
    TypeError
        An engine of a kind whose thrust is not known here.
    """
    if isinstance(engine, NoEngine):
        return engine
    if not isinstance(engine, DaveMlEngine | JetEngine | ElectricPropeller | PistonPropeller):
        raise TypeError(f"engine: arrived {type(engine).__name__}; expected a jet, a propeller, one by DAVE-ML")
    return eqx.tree_at(
        lambda e: (e.thrust_factor, e.point_b), engine, (engine.thrust_factor * thrust, engine.point_b + shift_b)
    )


class DerivativeDispersion(eqx.Module):
    """How one aircraft differs from its data; factors of 1 leave it as it is.

    Attributes
    ----------
    derivatives
        Factor on each of `DerivativeAircraft.derivatives`.
    tables
        Factor on each function of its tables; None where it has none.
    body
        How the rest of it differs.
    """

    derivatives: Float[Array, "6 columns"]
    tables: Vector | None
    body: BodyDispersion


def dispersed_derivative_aircraft(aircraft: DerivativeAircraft, dispersion: DerivativeDispersion) -> DerivativeAircraft:
    """Aircraft of the same structure with dispersed data."""
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
    """Aircraft of the same structure with dispersed data.

    Parameters
    ----------
    aircraft
        As its files have it.
    coefficients
        Factors on CX, CY, CZ, Cl, Cm, Cn as the file gives them, about its moment reference centre.
    body
        How the rest of it differs.
    """
    forward_b = jnp.stack([body.cg_shift * aircraft.mean_chord, *jnp.zeros(2)])
    return eqx.tree_at(
        lambda a: (a.coefficient_factors, a.centre_b),
        dispersed_body(aircraft, body, forward_b),
        (aircraft.coefficient_factors * coefficients, aircraft.centre_b - forward_b),
    )


AnyF16 = TypeVar("AnyF16", bound=AbstractF16)


class F16Dispersion(eqx.Module):
    """How one F-16 differs from its published data; factors of 1 and a shift of 0 leave it as it is.

    Attributes
    ----------
    coefficients
        Factor on each of `F16_COEFFICIENTS`, shape (22,); positive or negative.
    thrust, mass
        Factors.
    second_moments
        Factors on the second moments of mass along body x, y, z, shape (3,); positive. See `dispersed_mass`.
    actuator_bandwidth
        Factor on the bandwidth (inverse time constant) of all actuators; positive.
    cg_shift
        Of the centre of gravity, part of the mean chord; positive is aft.
    """

    coefficients: Float[Array, "22"]
    thrust: Scalar
    mass: Scalar
    second_moments: Vector3
    actuator_bandwidth: Scalar
    cg_shift: Scalar


def no_dispersion() -> F16Dispersion:
    """Leave the aircraft as published."""
    one = jnp.ones(())
    return F16Dispersion(jnp.ones(len(F16_COEFFICIENTS)), one, one, jnp.ones(3), one, jnp.zeros(()))


def dispersed_f16(f16: AnyF16, dispersion: F16Dispersion) -> AnyF16:
    """F-16 of the same kind and structure with dispersed data.

    A factor multiplies the whole of its table or coefficient, so that its contribution to the build-up scales exactly;
    the arguments of the tables stay. Both c.g. terms, in Cm and Cn, follow the shift.
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
