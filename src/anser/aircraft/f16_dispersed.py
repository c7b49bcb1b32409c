"""An F-16 with its data dispersed: every coefficient, thrust, mass, inertia, centre of gravity, actuators."""

from typing import TypeVar, cast

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft.body_dispersed import dispersed_mass
from anser.aircraft.f16 import F16_COEFFICIENTS
from anser.aircraft.f16_interface import AbstractF16
from anser.shapes import Scalar, Vector3

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
