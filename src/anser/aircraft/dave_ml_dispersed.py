"""An aircraft by DAVE-ML files with its data dispersed."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft.body_dispersed import BodyDispersion, dispersed_body
from anser.aircraft.dave_ml_aircraft import DaveMlAircraft


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
