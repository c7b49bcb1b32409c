"""An airframe with linear increments of the aerodynamic coefficients: an onboard model that is corrected in flight."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft.actuators import AbstractActuators
from anser.aircraft.air_data import AirData, Wrench
from anser.aircraft.airframe import AbstractAirframe, MassProperties
from anser.aircraft.engines import AbstractEngine
from anser.shapes import Flag, Scalar, Vector, Vector3

LONGITUDINAL = (True, False, True, False, True, False)
"""Whether each of CX, CY, CZ, Cl, Cm, Cn is a coefficient of the longitudinal motion."""
CONSTANT = 0
"""Index of the constant among the regressors."""
STATE_REGRESSORS = 4
"""Number of regressors before the surfaces; see `regressors`."""


class ReferenceLengths(eqx.Module):
    """Reference lengths (m) and area (m^2) that make the aerodynamic coefficients dimensionless."""

    span: Scalar
    mean_chord: Scalar
    wing_area: Scalar

    def wrench(self, qbar: Scalar, coefficients: Float[Array, "6"]) -> Wrench:
        """Convert CX, CY, CZ, Cl, Cm, Cn at a dynamic pressure (Pa) to a force (N) and a moment (N m), body axes."""
        scale = qbar * self.wing_area
        lengths = jnp.stack([self.span, self.mean_chord, self.span])
        return Wrench(scale * coefficients[:3], scale * lengths * coefficients[3:])

    def coefficients(self, qbar: Scalar, wrench: Wrench) -> Float[Array, "6"]:
        """Convert a force (N) and a moment (N m), body axes, at a dynamic pressure (Pa) to CX, CY, CZ, Cl, Cm, Cn.

        A dynamic pressure below 1 Pa is raised to 1 Pa.
        """
        scale = jnp.maximum(qbar, 1.0) * self.wing_area
        lengths = jnp.stack([self.span, self.mean_chord, self.span])
        return jnp.concatenate([wrench.force_b / scale, wrench.moment_b / (scale * lengths)])


def reference_lengths(airframe: AbstractAirframe) -> ReferenceLengths:
    """Return wing span, mean chord and wing area of an airframe.

    Raises ValueError if the airframe has no attribute `span`, `mean_chord` or `wing_area`.
    """
    names = ("span", "mean_chord", "wing_area")
    missing = [name for name in names if not hasattr(airframe, name)]
    if missing:
        raise ValueError(
            f"{type(airframe).__name__} has no {', '.join(missing)}; expected span, mean_chord (m) and wing_area (m^2) "
            "that make the coefficients dimensionless"
        )
    return ReferenceLengths(*(getattr(airframe, name) for name in names))


def regressors(lengths: ReferenceLengths, data: AirData, rates_b: Vector3, surfaces: Vector) -> Float[Array, "2 p"]:
    """Return the regressors: the quantities on which the increments of the coefficients depend linearly.

    The result has the shape (2, 4 + surfaces). The first row, for CX, CZ and Cm, is (1, alpha, q c/2V, 0, surfaces).
    The second row, for CY, Cl and Cn, is (1, beta, p b/2V, r b/2V, surfaces). Angles are in rad; `rates_b` (p, q, r)
    are relative to the air, rad/s. An airspeed V below 1 m/s is raised to 1 m/s.
    """
    double_V = 2.0 * jnp.maximum(data.V, 1.0)
    p, r = rates_b[0] * lengths.span / double_V, rates_b[2] * lengths.span / double_V
    q = rates_b[1] * lengths.mean_chord / double_V
    unity, zero = jnp.ones_like(data.alpha), jnp.zeros_like(data.alpha)
    return jnp.stack(
        [
            jnp.concatenate([jnp.stack([unity, data.alpha, q, zero]), surfaces]),
            jnp.concatenate([jnp.stack([unity, data.beta, p, r]), surfaces]),
        ]
    )


def reference_regressors(alpha: Scalar, surfaces: Vector) -> Float[Array, "2 p"]:
    """Return the `regressors` of flight at `alpha` (rad) without sideslip and rates, with 0 in place of the constant 1.

    `surfaces` are the deflections, rad. `CorrectedAirframe` subtracts the result from the regressors of the present
    flight condition.
    """
    zero = jnp.zeros_like(alpha)
    states = jnp.stack([jnp.stack([zero, alpha, zero, zero]), jnp.zeros(STATE_REGRESSORS)])
    return jnp.concatenate([states, jnp.stack([surfaces, surfaces])], axis=1)


def by_coefficient(rows: Float[Array, "2 p"]) -> Float[Array, "6 p"]:
    """Return one row of regressors for each of CX, CY, CZ, Cl, Cm, Cn; `rows` are the two rows of `regressors`."""
    return jnp.tile(rows, (3, 1))  # CX, CZ, Cm are longitudinal, CY, Cl, Cn lateral: the rows alternate


class CorrectedAirframe(AbstractAirframe):
    """An airframe with increments of CX to Cn, each a product of a row of `increments` and `regressors` - `reference`.

    Mass, inertia, geometry, actuators and engine are taken from `base`.
    """

    base: AbstractAirframe
    mass_properties: MassProperties
    actuators: AbstractActuators
    engine: AbstractEngine
    alpha_range: tuple[Scalar, Scalar]
    beta_range: tuple[Scalar, Scalar]
    lengths: ReferenceLengths
    reference: Float[Array, "2 p"]  #: Regressors of a reference flight condition, from `reference_regressors`.
    increments: Float[Array, "6 p"]  #: Increments of CX, CY, CZ, Cl, Cm, Cn per unit of each regressor.
    #: True: the increments are added to the coefficients of `base`; False: the coefficients are the increments alone.
    aerodynamics_known: bool = eqx.field(static=True, default=True)

    @property
    def symmetric(self) -> bool:
        """Whether the base airframe is symmetric: `AbstractAirframe.symmetric`.

        The increments do not count. The autopilot therefore does not bank against a side force due to increments.
        """
        return self.base.symmetric

    @property
    def span(self) -> Scalar:
        """Wing span, m."""
        return self.lengths.span

    @property
    def mean_chord(self) -> Scalar:
        """Mean chord, m."""
        return self.lengths.mean_chord

    @property
    def wing_area(self) -> Scalar:
        """Wing area, m^2."""
        return self.lengths.wing_area

    def increment(self, data: AirData, rates_b: Vector3, surfaces: Vector) -> Wrench:
        """Return force (N) and moment about the centre of gravity (N m), body axes, due to the increments alone."""
        rows = by_coefficient(regressors(self.lengths, data, rates_b, surfaces) - self.reference)
        return self.lengths.wrench(data.qbar, jnp.sum(self.increments * rows, axis=1))

    def aerodynamics(self, air_data: AirData, rates_b: Vector3, surfaces: Vector) -> Wrench:
        """Compute force (N) and moment about the centre of gravity (N m), body axes; see `aerodynamics_known`.

        Arguments: `AbstractAirframe.aerodynamics`.
        """
        increment = self.increment(air_data, rates_b, surfaces)
        return self.base.aerodynamics(air_data, rates_b, surfaces) + increment if self.aerodynamics_known else increment

    def outside_tables(self, air_data: AirData) -> Flag:
        """Whether the flight condition is outside the valid range of the base airframe's or its engine's data."""
        return self.base.outside_tables(air_data)


def corrected_airframe(
    base: AbstractAirframe,
    lengths: ReferenceLengths,
    reference: Float[Array, "2 p"],
    increments: Float[Array, "6 p"],
    *,
    aerodynamics_known: bool = True,
) -> CorrectedAirframe:
    """Return a `CorrectedAirframe`, with linear increments of the aerodynamic coefficients of `base`.

    The arguments are the fields of `CorrectedAirframe`.
    """
    return CorrectedAirframe(
        base=base,
        mass_properties=base.mass_properties,
        actuators=base.actuators,
        engine=base.engine,
        alpha_range=base.alpha_range,
        beta_range=base.beta_range,
        lengths=lengths,
        reference=reference,
        increments=increments,
        aerodynamics_known=aerodynamics_known,
    )


def without_aerodynamics(airframe: AbstractAirframe) -> CorrectedAirframe:
    """Return a copy of an airframe with all aerodynamic coefficients set to 0.

    Raises ValueError if the airframe has no span, mean chord or wing area.
    """
    size = STATE_REGRESSORS + len(airframe.actuators.names)
    zeros = jnp.zeros((2, size)), jnp.zeros((6, size))
    return corrected_airframe(airframe, reference_lengths(airframe), *zeros, aerodynamics_known=False)
