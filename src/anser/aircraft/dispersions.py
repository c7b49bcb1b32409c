"""Dispersed aircraft: airframes with data that deviate from the published values."""

from typing import TypeVar, cast

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft.airframe import AbstractAirframe, MassProperties
from anser.aircraft.dave_ml_aircraft import DaveMlAircraft
from anser.aircraft.derivative_aircraft import DerivativeAircraft
from anser.aircraft.f16 import F16_COEFFICIENTS, AbstractF16
from anser.numerics.linear import inverse3
from anser.shapes import Scalar, Vector, Vector3

AnyAirframe = TypeVar("AnyAirframe", bound=AbstractAirframe)


class BodyDispersion(eqx.Module):
    """Deviations of mass, inertia, centre of gravity, actuators and thrust: factors (1: no change) and a shift."""

    thrust: Scalar  # factor on the thrust
    mass: Scalar  # factor on the mass
    second_moments: Vector3  # positive factors on the second moments of mass along body x, y, z (`dispersed_mass`)
    actuator_bandwidth: Scalar  # positive factor on the bandwidth of every actuator
    cg_shift: Scalar  # shift of the centre of gravity, fraction of the mean chord, positive aft; 0: no shift


def dispersed_mass(properties: MassProperties, mass: Scalar, second_moments: Vector3) -> MassProperties:
    """Return mass properties with the mass and the second moments of mass (along body x, y, z) multiplied by factors.

    The second moments are the integrals of x^2, y^2 and z^2 over the mass; Jxx is the sum of the second and the third.
    A product of inertia is multiplied by the square roots of the factors of its two axes. Positive factors thus keep
    the principal moments positive and within the triangle inequality. The factor on the mass does not change the
    inertia.
    """
    root = jnp.sqrt(second_moments)
    J_b, eye = properties.inertia_b, jnp.eye(3, dtype=properties.inertia_b.dtype)
    integrals = 0.5 * jnp.trace(J_b) * eye - J_b  # of r r^T
    # as a change of J, exactly zero for factors of 1
    change = integrals * (root[:, None] * root[None, :] - 1.0)
    changed_b = J_b + jnp.trace(change) * eye - change
    inverse_b = jnp.where(jnp.all(second_moments == 1.0), properties.inertia_inverse_b, inverse3(changed_b))
    return eqx.tree_at(
        lambda p: (p.mass, p.inertia_b, p.inertia_inverse_b), properties, (properties.mass * mass, changed_b, inverse_b)
    )


def dispersed_body(airframe: AnyAirframe, dispersion: BodyDispersion, shift_b: Vector3) -> AnyAirframe:
    """Return a copy of the airframe with dispersed mass, inertia, actuators and thrust; the aerodynamics are unchanged.

    `shift_b` (m, body axes) is the former centre of gravity relative to the new one. The function adds `shift_b` to the
    thrust point; the caller must shift the reference point of the aerodynamic moments.
    """
    changed = eqx.tree_at(
        lambda a: (a.mass_properties, a.actuators, a.engine),
        airframe,
        (
            dispersed_mass(airframe.mass_properties, dispersion.mass, dispersion.second_moments),
            airframe.actuators.with_bandwidth_scaled(dispersion.actuator_bandwidth),
            airframe.engine.dispersed(dispersion.thrust, shift_b),
        ),
    )
    return cast(AnyAirframe, changed)


class DerivativeDispersion(eqx.Module):
    """Dispersion of a `DerivativeAircraft`; factors of 1 mean no change."""

    derivatives: Float[Array, "6 columns"]  # factors on the entries of `DerivativeAircraft.derivatives`
    tables: Vector | None  # factors on the functions of the aircraft's tables; None for an aircraft without tables
    body: BodyDispersion


def dispersed_derivative_aircraft(aircraft: DerivativeAircraft, dispersion: DerivativeDispersion) -> DerivativeAircraft:
    """Return a copy of the aircraft, with the same pytree structure, whose data deviate by `dispersion`."""
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
    """Return a copy of the aircraft, with the same pytree structure, whose data deviate by `coefficients` and `body`.

    `coefficients` are factors on CX, CY, CZ, Cl, Cm, Cn about the moment reference centre of the file.
    """
    forward_b = jnp.stack([body.cg_shift * aircraft.mean_chord, *jnp.zeros(2)])
    return eqx.tree_at(
        lambda a: (a.coefficient_factors, a.centre_b),
        dispersed_body(aircraft, body, forward_b),
        (aircraft.coefficient_factors * coefficients, aircraft.centre_b - forward_b),
    )


AnyF16 = TypeVar("AnyF16", bound=AbstractF16)


class F16Dispersion(BodyDispersion):
    """Dispersion of an F-16: a `BodyDispersion`, and a factor on each of `F16_COEFFICIENTS` (negative allowed)."""

    coefficients: Float[Array, "22"]


def no_dispersion() -> F16Dispersion:
    """Return the F-16's dispersion without any deviation from the published data."""
    unity = jnp.ones(())
    return F16Dispersion(unity, unity, jnp.ones(3), unity, jnp.zeros(()), jnp.ones(len(F16_COEFFICIENTS)))


def dispersed_f16(f16: AnyF16, dispersion: F16Dispersion) -> AnyF16:
    """Return a copy of the F-16, with the same class and pytree structure, whose data deviate by `dispersion`.

    The terms of Cm and Cn that depend on the centre of gravity follow the shift of the centre of gravity.
    """
    scaled = dispersed_body(f16.with_coefficients_scaled(dispersion.coefficients), dispersion, jnp.zeros(3))
    return cast(AnyF16, eqx.tree_at(lambda a: a.x_cg, scaled, f16.x_cg + dispersion.cg_shift))
