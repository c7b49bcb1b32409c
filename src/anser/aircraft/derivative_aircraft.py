"""An aircraft from stability and control derivatives, optional tables, and a stall model (flat plate)."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.actuators import AbstractActuators
from anser.aircraft.air_data import AirData, Validity, Wrench
from anser.aircraft.airframe import AbstractAirframe, MassProperties
from anser.aircraft.engines import AbstractEngine
from anser.airframe_data import DERIVATIVE_ARGUMENTS, STATIC_ARGUMENTS
from anser.numerics.linear import cross
from anser.numerics.tables import Tables
from anser.shapes import Flag, Scalar, Vector, Vector3

NO_STALL = 100.0
"""Value of `stall_alpha`, rad, for an aircraft without stall model: an angle that no flight reaches."""
_STATIC_COLUMNS = tuple(DERIVATIVE_ARGUMENTS.index(argument) for argument in STATIC_ARGUMENTS)


class DerivativeAircraft(AbstractAirframe):
    """Airframe whose aerodynamic coefficients are sums of derivatives times angles, rates and deflections.

    Optional tables are added to the derivatives. Induced drag and stall add nonlinear terms.
    """

    mass_properties: MassProperties
    actuators: AbstractActuators
    engine: AbstractEngine
    alpha_range: tuple[Scalar, Scalar]
    beta_range: tuple[Scalar, Scalar]
    #: Reference lengths (m) and area (m^2).
    span: Scalar
    wing_area: Scalar
    mean_chord: Scalar
    cg_offset_b: Vector3  #: Centre of gravity relative to the reference point of the moment coefficients, body axes, m.
    #: Derivatives per rad or per dimensionless rate. Rows: `anser.airframe_data.COEFFICIENTS` (CL, CD, CY, Cl, Cm, Cn);
    #: columns: `DERIVATIVE_ARGUMENTS`, then the surfaces in the actuators' order.
    derivatives: Float[Array, "6 columns"]
    #: Factor 1 / (pi e AR): the induced drag coefficient is this factor times the square of the lift coefficient due to
    #: angle of attack in attached flow.
    induced_drag: Scalar
    stall_sharpness: Scalar  #: Sharpness M of the stall (`flow_separation`), per rad.
    stall_alpha: Scalar  #: Angle of attack alpha0 of the stall, rad; `NO_STALL` for an aircraft without stall model.
    validity: Validity  #: Valid range of airspeed, altitude and Mach number.
    tables: Tables | None = None  #: Tables over alpha, beta (rad) and surfaces (rad); None: no tables.
    #: Factor on each function of the tables; 1 for the published values.
    table_factors: Float[Array, " tables"] | None = None
    #: For each function of the tables, row and column of the entry of `derivatives` to which the function is added.
    table_derivatives: tuple[tuple[int, int], ...] = eqx.field(static=True, default=())
    #: For each table axis, index of its argument: 0 alpha, 1 beta, 2 + k surface k.
    table_arguments: tuple[int, ...] = eqx.field(static=True, default=())
    #: Whether a side force is possible while sideslip, rates and deflections are zero, for example by CY0.
    has_static_side_force: bool = eqx.field(static=True, default=True)

    @property
    def symmetric(self) -> bool:
        """Whether the side force is zero if sideslip, rates and deflections are zero."""
        return not self.has_static_side_force

    def coefficients(self, air_data: AirData, rates_b: Vector3, surfaces: Vector) -> Float[Array, "6"]:
        """Compute CL, CD, CY, Cl, Cm, Cn (`COEFFICIENTS`); moments are about the reference point.

        `rates_b` (rad/s, relative to the air) are made dimensionless with b/2V and c/2V, where V is at least 1 m/s;
        `surfaces` are in rad. The lift due to angle of attack is the mean of attached flow and flat plate, weighted by
        `flow_separation`. Source of stall and drag: [BM] section 4.2.
        """
        alpha, beta = air_data.alpha, air_data.beta
        V = jnp.maximum(air_data.V, 1.0)
        p, r = rates_b[0] * self.span / (2 * V), rates_b[2] * self.span / (2 * V)
        q = rates_b[1] * self.mean_chord / (2 * V)
        ones = jnp.ones_like(alpha)
        argument = jnp.concatenate([jnp.stack([ones, alpha, beta, p, q, r, alpha**2, beta**2]), surfaces])
        parts = self.derivatives * argument[None]
        if self.tables is not None and self.table_factors is not None:
            inputs = (alpha, beta, *surfaces)
            values = jnp.concatenate(self.tables(*(inputs[k] for k in self.table_arguments))) * self.table_factors
            row_indices, column_indices = np.asarray(self.table_derivatives).T
            parts = parts.at[row_indices, column_indices].add(values * argument[column_indices])
        total = jnp.sum(parts, axis=1)
        attached = jnp.sum(parts[0, np.asarray(_STATIC_COLUMNS)])
        sine, cosine = jnp.sin(alpha), jnp.cos(alpha)
        plate = 2.0 * jnp.abs(sine) * sine * cosine
        stalled = self.flow_separation(alpha)
        lift = total[0] + stalled * (plate - attached)
        drag = total[1] + self.induced_drag * attached**2
        return jnp.concatenate([jnp.stack([lift, drag]), total[2:]])

    def flow_separation(self, alpha: Scalar) -> Scalar:
        """Return the weight of the flat plate in the lift, 0 (attached) to 1 (separated flow): [BM] equation 4.10."""
        M, alpha0 = self.stall_sharpness, self.stall_alpha
        positive_stall, negative_stall = jax.nn.sigmoid(M * (alpha - alpha0)), jax.nn.sigmoid(-M * (alpha + alpha0))
        return positive_stall + negative_stall - positive_stall * negative_stall

    def aerodynamics(self, air_data: AirData, rates_b: Vector3, surfaces: Vector) -> Wrench:
        """Compute the force (N) and the moment about the centre of gravity (N m), in body axes.

        Lift and drag are rotated into body axes by alpha alone. Arguments: `AbstractAirframe.aerodynamics`.
        """
        CL, CD, CY, Cl, Cm, Cn = self.coefficients(air_data, rates_b, surfaces)
        sa, ca = jnp.sin(air_data.alpha), jnp.cos(air_data.alpha)
        scale = air_data.qbar * self.wing_area
        force_b = scale * jnp.stack([CL * sa - CD * ca, CY, -CL * ca - CD * sa])
        moment_b = scale * jnp.stack([self.span * Cl, self.mean_chord * Cm, self.span * Cn])
        return Wrench(force_b=force_b, moment_b=moment_b - cross(self.cg_offset_b, force_b))

    def outside_tables(self, air_data: AirData) -> Flag:
        """Whether alpha, beta, airspeed, altitude or Mach number is outside the aerodynamic or the engine data."""
        return super().outside_tables(air_data) | self.validity.excludes(air_data)
