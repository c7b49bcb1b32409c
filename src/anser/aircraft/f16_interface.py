"""What the F-16s of this library have in common, whichever of the published sets of tables they fly with."""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft.air_data import AirData
from anser.aircraft.f16_engine import F16Engine
from anser.aircraft.interface import AbstractAirframe
from anser.aircraft.wrench import Wrench
from anser.shapes import Flag, Scalar, Vector, Vector3


class F16Coefficients(eqx.Module):
    """Dimensionless force and moment coefficients in body axes, moments about the centre of gravity."""

    CX: Scalar
    CY: Scalar
    CZ: Scalar
    Cl: Scalar
    Cm: Scalar
    Cn: Scalar


class AbstractF16(AbstractAirframe):
    """An F-16 with its engine; its coefficients are its own.

    Attributes
    ----------
    span, wing_area, mean_chord
        Reference lengths (m) and area (m^2).
    x_cg, x_cg_reference
        Centre of gravity and moment reference, fractions of the mean chord.
    """

    engine: eqx.AbstractVar[F16Engine]  # pyright: ignore[reportIncompatibleVariableOverride] - deviations scale it
    span: eqx.AbstractVar[Scalar]
    wing_area: eqx.AbstractVar[Scalar]
    mean_chord: eqx.AbstractVar[Scalar]
    x_cg: eqx.AbstractVar[Scalar]
    x_cg_reference: eqx.AbstractVar[Scalar]

    @abc.abstractmethod
    def coefficients(self, air_data: AirData, rates_b: Vector3, surfaces: Vector) -> F16Coefficients:
        """Force and moment coefficients for the given air data, body rates (rad/s) and deflections (rad)."""

    @abc.abstractmethod
    def with_coefficients_scaled(self, factors: Float[Array, " coefficients"]) -> "AbstractF16":
        """The same aircraft with each of `anser.aircraft.F16_COEFFICIENTS` multiplied by its factor."""

    def aerodynamics(self, air_data: AirData, rates_b: Vector3, surfaces: Vector) -> Wrench:
        """Force qbar S (CX, CY, CZ) and moment qbar S (b Cl, c Cm, b Cn)."""
        c = self.coefficients(air_data, rates_b, surfaces)
        scale = air_data.qbar * self.wing_area
        return Wrench(
            force_b=scale * jnp.stack([c.CX, c.CY, c.CZ]),
            moment_b=scale * jnp.stack([self.span * c.Cl, self.mean_chord * c.Cm, self.span * c.Cn]),
        )

    def outside_tables(self, air_data: AirData) -> Flag:
        """Outside the ranges of alpha and beta, altitude 0..50,000 ft or Mach 0..1.

        The textbook's elevator table ends at 24 deg while the surface moves to 25 deg: that last degree is part of the
        published model and not flagged.
        """
        return (
            (air_data.alpha < self.alpha_range[0])
            | (air_data.alpha > self.alpha_range[1])
            | (air_data.beta < self.beta_range[0])
            | (air_data.beta > self.beta_range[1])
            | self.engine.outside_tables(air_data)
        )
