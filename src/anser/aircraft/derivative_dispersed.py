"""An aircraft of derivatives with its data dispersed."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft.body_dispersed import BodyDispersion, dispersed_body
from anser.aircraft.derivative_aircraft import DerivativeAircraft
from anser.shapes import Vector


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
