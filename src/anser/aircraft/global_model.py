"""Global aerodynamic model of Grauer and Morelli (polynomials over the envelope), and an F-16 that uses this model.

Source: [GM15] J. A. Grauer, E. A. Morelli, A Generic Global Aerodynamic Model for Aircraft, Journal of Aircraft 52(1),
2015 (NTRS 20140011902).
"""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.actuators import AbstractActuators
from anser.aircraft.air_data import AirData
from anser.aircraft.f16 import (
    F16_COEFFICIENTS,
    AbstractF16,
    F16Coefficients,
    F16Engine,
    f16_mass_properties,
    range_from_deg,
)
from anser.numerics.arrays import as_array, namespace
from anser.shapes import Vector, Vector3
from anser.units import FOOT_M, POUND_KG

GLOBAL_TERMS: dict[str, tuple[str, ...]] = {
    "CD": (
        *("1", "alpha", "alpha q", "alpha elevator", "alpha^2", "alpha^2 q", "alpha^2 elevator"),
        *("alpha^3", "alpha^3 q", "alpha^4"),
    ),
    "CY": ("beta", "p", "r", "aileron", "rudder"),
    "CL": ("1", "alpha", "q", "elevator", "alpha q", "alpha^2", "alpha^3", "alpha^4"),
    "Cl": ("beta", "p", "r", "aileron", "rudder"),
    "Cm": (
        *("1", "alpha", "q", "elevator", "alpha q", "alpha^2 q", "alpha^2 elevator"),
        *("alpha^3 q", "alpha^3 elevator", "alpha^4"),
    ),
    "Cn": ("beta", "p", "r", "aileron", "rudder", "beta^2", "beta^3"),
}
"""Terms of each coefficient in the order of its parameters (45 in all); p, q, r stand for p b/2V, q c/2V, r b/2V."""
_ARGUMENTS = ("alpha", "beta", "p", "q", "r", "elevator", "aileron", "rudder")


def global_regressors(arguments: Float[Array, "... 8"]) -> dict[str, Float[Array, "... _"]]:
    """Compute the values of the terms of each coefficient, in the order of `GLOBAL_TERMS` along the last axis.

    The last axis of `arguments` (NumPy or JAX) holds alpha and beta (rad), p b/2V, q c/2V, r b/2V, and the deflections
    of elevator, aileron and rudder (rad).
    """
    xp = namespace(arguments)
    values = {name: arguments[..., k] for k, name in enumerate(_ARGUMENTS)}

    def product(term: str) -> Any:
        result = xp.ones_like(values["alpha"])
        for factor in term.split():
            name, _, power = factor.partition("^")
            result = result if name == "1" else result * values[name] ** int(power or 1)
        return result

    products = {term: product(term) for terms in GLOBAL_TERMS.values() for term in terms}
    return {key: xp.stack([products[term] for term in terms], axis=-1) for key, terms in GLOBAL_TERMS.items()}


def _factor_name(coefficient: str, term: str) -> str:
    """Return the entry of `F16_COEFFICIENTS` that scales a `term` of the polynomial of `coefficient`."""
    table = {"CD": "CX", "CL": "CZ"}.get(coefficient, coefficient)
    rates = [rate for rate in "pqr" if rate in term.split()]
    if rates:
        return table + rates[0]
    if term in ("aileron", "rudder"):
        return f"{table}d{term[0]}"
    if (coefficient, term) == ("CL", "elevator"):
        return "CZde"
    return "CYb" if coefficient == "CY" else f"{table}0"


_FACTOR_INDICES = np.array(
    [F16_COEFFICIENTS.index(_factor_name(key, term)) for key, terms in GLOBAL_TERMS.items() for term in terms]
)


class F16Global(AbstractF16):
    """F-16 with Grauer and Morelli's global aerodynamic model, and with engine and actuators of the textbook's F-16."""

    parameters: Float[Array, "45"]  #: Parameters of all terms in the order of `GLOBAL_TERMS`.

    @property
    def symmetric(self) -> bool:
        """True: the side force depends only on sideslip, aileron, rudder and rates."""
        return True

    def coefficients(self, air_data: AirData, rates_b: Vector3, surfaces: Vector) -> F16Coefficients:
        """Compute the force and moment coefficients in body axes, the moments about the centre of gravity.

        Rates in rad/s are made dimensionless with b/2V and c/2V, where V is at least 1 m/s.
        """
        lengths = jnp.stack([self.span, self.mean_chord, self.span])
        reduced = rates_b * lengths / (2.0 * jnp.maximum(air_data.V, 1.0))
        terms = global_regressors(jnp.concatenate([jnp.stack([air_data.alpha, air_data.beta]), reduced, surfaces]))
        ends = np.cumsum([len(names) for names in GLOBAL_TERMS.values()])[:-1]
        parameters = jnp.split(self.parameters, ends)
        CD, CY, CL, Cl, Cm, Cn = (
            jnp.sum(values * regressors) for values, regressors in zip(parameters, terms.values(), strict=True)
        )
        sine, cosine = jnp.sin(air_data.alpha), jnp.cos(air_data.alpha)
        CX, CZ = CL * sine - CD * cosine, -CL * cosine - CD * sine
        lever = self.x_cg_reference - self.x_cg
        return F16Coefficients(
            CX=CX, CY=CY, CZ=CZ, Cl=Cl, Cm=Cm + CZ * lever, Cn=Cn - CY * lever * self.mean_chord / self.span
        )

    def with_coefficients_scaled(self, factors: Float[Array, "22"]) -> "F16Global":
        """Return a copy with each term multiplied by the factor on the matching entry of `F16_COEFFICIENTS`.

        Where the names differ, an entry matches these terms:

        - CX0: drag terms without q; CXq: drag terms with q.
        - CZ0, CZde, CZq: lift terms.
        - Cm0: all terms of Cm without q.
        - Cl0, Cn0: terms that contain only sideslip.
        """
        return eqx.tree_at(lambda a: a.parameters, self, self.parameters * factors[_FACTOR_INDICES])


def global_f16_from_data(
    data: Mapping[str, Any], actuators: AbstractActuators, engine: F16Engine, x_cg_over_c: float | None = None
) -> F16Global:
    """Build the F-16 with the global model from `data`, the content of `aircraft/data/f16-global.json`.

    `x_cg_over_c` is the centre of gravity as a fraction of the mean chord; None: the reference point of the moments.
    """
    airframe, x_cg = data["airframe"], data["airframe"]["x_cg_over_c"]
    built = F16Global(
        mass_properties=f16_mass_properties(airframe, airframe["weight_lb"] * POUND_KG, spinning=True),
        actuators=actuators,
        alpha_range=range_from_deg(data["validity"]["alpha_deg"]),
        beta_range=range_from_deg(data["validity"]["beta_deg"]),
        engine=engine,
        span=as_array(airframe["span_ft"] * FOOT_M),
        wing_area=as_array(airframe["wing_area_ft2"] * FOOT_M**2),
        mean_chord=as_array(airframe["mean_chord_ft"] * FOOT_M),
        x_cg=as_array(float(x_cg if x_cg_over_c is None else x_cg_over_c)),
        x_cg_reference=as_array(x_cg),
        parameters=as_array([value for key in GLOBAL_TERMS for value in data["parameters"][key]]),
    )
    # Strongly typed leaves: replacing one by another array does not recompile.
    return jax.tree.map(lambda leaf: as_array(leaf), built)
