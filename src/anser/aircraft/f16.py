"""The F-16 of Stevens & Lewis: engine, base class of all F-16 models, and the variants of the textbook's tables.

Sources: theory section 4; [SL] appendix A; [S119]; [TH].
"""

import abc
import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.actuators import AbstractActuators, FirstOrderActuators
from anser.aircraft.air_data import AirData, Wrench
from anser.aircraft.airframe import AbstractAirframe, MassProperties, rigid_body
from anser.aircraft.engines import AbstractEngine, EnginePower, thrust_along_body_x
from anser.numerics.arrays import as_array
from anser.numerics.tables import Tables, make_axes, make_tables
from anser.shapes import Flag, Scalar, ScalarLike, Vector, Vector3
from anser.units import DEG_RAD, FOOT_M, LBF_N, RAD_DEG, SLUG_FT2_KG_M2, SLUG_KG


class F16Engine(AbstractEngine):
    """Afterburning turbofan of the F-16: thrust tables and power lag of [SL] appendix A."""

    thrust_tables: Tables  # idle, military and maximum thrust (N) over altitude (m) and Mach number

    def steady_state(self, power: ScalarLike) -> EnginePower:
        """Return the engine state of steady running at a power (percent)."""
        return EnginePower(jnp.asarray(power))

    def rate(self, state: EnginePower, throttle: ScalarLike, air_data: AirData) -> EnginePower:
        """Return the rate of the power (percent/s) at a throttle (0..1)."""
        return EnginePower(self.power_rate(state.power, self.gearing(throttle)))

    def propulsion(self, power: ScalarLike, air_data: AirData) -> Wrench:
        """Return the thrust along body x (N) through the centre of gravity; the moment is zero."""
        return thrust_along_body_x(self.thrust(power, air_data.altitude, air_data.mach))

    def gearing(self, throttle: ScalarLike) -> Scalar:
        """Return the commanded power (percent) at a throttle, after the throttle is limited to 0..1 ([SL] TGEAR)."""
        t = jnp.clip(throttle, 0.0, 1.0)
        return jnp.where(t <= 0.77, 64.94 * t, 217.38 * t - 117.38)

    def throttle_for_power(self, power: ScalarLike) -> Scalar:
        """Return the throttle (0..1) for a commanded power (percent): the inverse of `gearing`.

        At throttle 0.77 the published gearing falls by 0.0012 percent of power. For powers that two throttles command,
        the result is the lower throttle.
        """
        power = jnp.clip(power, 0.0, 100.0)
        return jnp.where(power <= 64.94 * 0.77, power / 64.94, (power + 117.38) / 217.38)

    def thrust(self, power: ScalarLike, altitude: ScalarLike, mach: ScalarLike) -> Scalar:
        """Return the thrust (N) at a power (percent), altitude (m) and Mach number ([SL] THRUST)."""
        idle, military, maximum = self.thrust_tables(altitude, mach)[0]
        low = idle + (military - idle) * power / 50
        high = military + (maximum - military) * (power - 50) / 50
        return jnp.where(power < 50, low, high)

    def power_for_thrust(self, thrust: ScalarLike, air_data: AirData) -> Scalar:
        """Return the power (percent, 0..100) whose thrust is nearest to `thrust` (N)."""
        idle, military, maximum = self.thrust_tables(air_data.altitude, air_data.mach)[0]
        dry = 50 * (thrust - idle) / jnp.maximum(military - idle, 1.0)
        wet = 50 + 50 * (thrust - military) / jnp.maximum(maximum - military, 1.0)
        return jnp.clip(jnp.where(thrust < military, dry, wet), 0.0, 100.0)

    def power_rate(self, power: ScalarLike, power_command: ScalarLike) -> Scalar:
        """Return the rate of the power (percent/s) for a power command (percent), by the lag of [SL] PDOT and RTAU."""
        is_afterburning, afterburner_commanded = power >= 50, power_command >= 50
        target = jnp.where(
            afterburner_commanded,
            jnp.where(is_afterburning, power_command, 60.0),
            jnp.where(is_afterburning, 40.0, power_command),
        )
        gap = target - power
        slow = jnp.clip(1.9 - 0.036 * gap, 0.1, 1.0)
        return jnp.where(is_afterburning, 5.0, slow) * gap

    def dispersed(self, thrust: Scalar, shift_b: Vector3) -> "F16Engine":
        """Return a copy with the thrust tables times `thrust`. `shift_b` is ignored: the thrust has no moment arm."""
        cells = self.thrust_tables.cells[0] * thrust
        return eqx.tree_at(lambda e: e.thrust_tables.cells[0], self, cells)

    def throttle_for_power_rate(self, power: ScalarLike, power_rate: ScalarLike) -> Scalar:
        """Return the throttle (0..1) that changes the current `power` (percent) at `power_rate` (percent/s)."""
        return self.throttle_for_power(self.power_command_for_rate(power, power_rate))

    def power_command_for_rate(self, power: ScalarLike, power_rate: ScalarLike) -> Scalar:
        """Return the power command (0..100 percent) for a required power rate (percent/s), the inverse of `power_rate`.

        Below 50 percent of power, rates above 25 percent/s are reduced to 25 percent/s. Near 50 percent of power
        certain rates are impossible; the power then usually changes faster than required.
        """
        command_with_afterburner = power + power_rate / 5.0
        command_without = power + jnp.minimum(power_rate, 25.0)
        return jnp.clip(jnp.where(power >= 50, command_with_afterburner, command_without), 0.0, 100.0)

    def outside_tables(self, air_data: AirData) -> Flag:
        """Whether altitude or Mach number is outside the thrust tables, 0 to 50,000 ft and Mach 0 to 1."""
        return jnp.any(self.thrust_tables.axes.outside(jnp.stack([air_data.altitude, air_data.mach])))


class F16Coefficients(eqx.Module):
    """Dimensionless force and moment coefficients in body axes; moments are about the centre of gravity."""

    CX: Scalar
    CY: Scalar
    CZ: Scalar
    Cl: Scalar
    Cm: Scalar
    Cn: Scalar


class AbstractF16(AbstractAirframe):
    """Base class of the F-16 models: engine, geometry and forces; subclasses define the aerodynamic coefficients."""

    mass_properties: MassProperties
    actuators: AbstractActuators
    alpha_range: tuple[Scalar, Scalar]
    beta_range: tuple[Scalar, Scalar]
    engine: F16Engine  # pyright: ignore[reportIncompatibleVariableOverride]
    # reference lengths (m) and area (m^2)
    span: Scalar
    wing_area: Scalar
    mean_chord: Scalar
    # centre of gravity and moment reference, fractions of the mean chord
    x_cg: Scalar
    x_cg_reference: Scalar

    @abc.abstractmethod
    def coefficients(self, air_data: AirData, rates_b: Vector3, surfaces: Vector) -> F16Coefficients:
        """Compute the coefficients; `rates_b` are relative to the air, rad/s; `surfaces` are deflections, rad."""

    @abc.abstractmethod
    def with_coefficients_scaled(self, factors: Float[Array, " coefficients"]) -> "AbstractF16":
        """Return a copy of the aircraft with each coefficient of `F16_COEFFICIENTS` multiplied by its factor."""

    def aerodynamics(self, air_data: AirData, rates_b: Vector3, surfaces: Vector) -> Wrench:
        """Compute the force qbar S (CX, CY, CZ), N, and the moment qbar S (b Cl, c Cm, b Cn), N m, in body axes.

        The moment is about the centre of gravity. Arguments: `AbstractAirframe.aerodynamics`.
        """
        c = self.coefficients(air_data, rates_b, surfaces)
        scale = air_data.qbar * self.wing_area
        return Wrench(
            force_b=scale * jnp.stack([c.CX, c.CY, c.CZ]),
            moment_b=scale * jnp.stack([self.span * c.Cl, self.mean_chord * c.Cm, self.span * c.Cn]),
        )


TABLE_COEFFICIENTS = (
    ("CZ0", "CXq", "CYr", "CYp", "CZq", "Clr", "Clp", "Cmq", "Cnr", "Cnp"),
    ("CX0", "Cm0"),
    ("Clda", "Cldr", "Cnda", "Cndr", "Cl0", "Cn0"),
)
"""Names of the functions in each group of `F16.tables`: over alpha; alpha and elevator; alpha and sideslip."""
_GROUPS = (*TABLE_COEFFICIENTS, ("CYb", "CYda", "CYdr"), ("CZde",))
F16_COEFFICIENTS = tuple(itertools.chain(*_GROUPS))
"""Names of all coefficients of the build-up (theory section 4): tables of `F16.tables`, then linear terms."""
_ODD_IN_SIDESLIP = ("Cl0", "Cn0")


class F16(AbstractF16):
    """F-16 with the tables of Stevens & Lewis; `f16_from_data` builds the published variants.

    The textbook's elevator table ends at 24 deg, but the surface moves to 25 deg. `outside_tables` does not report the
    last degree.
    """

    surface_reference: Vector3  #: Deflections (elevator, aileron, rudder; deg) at which the surface effects are given.
    side_force: Vector3  #: CY per deg of sideslip; CY due to the aileron's and the rudder's reference deflection.
    normal_force_elevator: Scalar  #: CZ due to the elevator's reference deflection.
    tables: Tables  #: Tables over alpha, beta and elevator, deg; the groups of functions are `TABLE_COEFFICIENTS`.

    @property
    def symmetric(self) -> bool:
        """True: the side force depends only on sideslip, aileron, rudder and rates."""
        return True

    def coefficients(self, air_data: AirData, rates_b: Vector3, surfaces: Vector) -> F16Coefficients:
        """Compute the force and moment coefficients (theory section 4).

        Rates are made dimensionless with b/2V and c/2V, where V is at least 1 m/s.
        """
        V = jnp.maximum(air_data.V, 1.0)
        alpha_deg = air_data.alpha * RAD_DEG
        beta_deg = air_data.beta * RAD_DEG
        deflection_deg = surfaces * RAD_DEG
        e, a, r = jnp.unstack(deflection_deg / self.surface_reference)
        p, q, y = jnp.unstack(rates_b * jnp.stack([self.span, self.mean_chord, self.span]) / (2 * V))
        alpha_values, elevator_values, sideslip_values = self.tables(alpha_deg, beta_deg, deflection_deg[0])
        # Strides of `TABLE_COEFFICIENTS`: derivatives of (CX, CZ, Cm) by q, of (CY, Cl, Cn) by r and p, and of (Cl, Cn)
        # by aileron and rudder.
        CXq, CZq, Cmq = jnp.unstack(alpha_values[1::3] * q)
        yawing, rolling = alpha_values[2::3] * y, alpha_values[3::3] * p
        side, aileron, rudder = jnp.unstack(self.side_force)
        CX0, Cm0 = jnp.unstack(elevator_values)
        lever = self.x_cg_reference - self.x_cg
        CX = CX0 + CXq
        CY = side * beta_deg + aileron * a + rudder * r + yawing[0] + rolling[0]
        CZ = alpha_values[0] * (1 - air_data.beta**2) + self.normal_force_elevator * e + CZq
        by_surfaces = sideslip_values[4:] + sideslip_values[0:4:2] * a + sideslip_values[1:4:2] * r
        Cl, Cn = jnp.unstack(by_surfaces + yawing[1:] + rolling[1:])
        return F16Coefficients(
            CX=CX,
            CY=CY,
            CZ=CZ,
            Cl=Cl,
            Cm=Cm0 + CZ * lever + Cmq,
            Cn=Cn - CY * lever * self.mean_chord / self.span,
        )

    def with_coefficients_scaled(self, factors: Float[Array, "22"]) -> "F16":
        """Return a copy of the aircraft with each coefficient of `F16_COEFFICIENTS` multiplied by its factor."""
        splits = np.cumsum([len(names) for names in _GROUPS])[:-1]
        *tables, side_force, normal_force = jnp.split(factors, splits)
        return eqx.tree_at(
            lambda a: (a.tables.cells, a.side_force, a.normal_force_elevator),
            self,
            (
                tuple(cells * group[None, None, :] for cells, group in zip(self.tables.cells, tables, strict=True)),
                self.side_force * side_force,
                self.normal_force_elevator * normal_force[0],
            ),
        )


def f16_from_data(data: Mapping[str, Any], variant: str = "textbook", x_cg_over_c: float | None = None) -> F16:
    """Build the F-16 from `data`, the content of `aircraft/data/f16.json`.

    Parameters
    ----------
    variant
        Key of `data["variants"]`: "textbook", "s119" or "founding".
    x_cg_over_c
        Centre of gravity as a fraction of the mean chord; None: value of the variant.

    Raises
    ------
    ValueError
        The variant is unknown, or the changes of the variant do not fit the tables (see `variant_tables`).
    """
    if variant not in data["variants"]:
        raise ValueError(f"F-16 variant {variant!r}: known are {', '.join(data['variants'])}")
    variant_data = data["variants"][variant]
    tables = variant_tables(data, variant)
    clamp = variant_data["table_ends"].startswith("clamped")
    axes = data["axes"]
    airframe = data["airframe"]
    mass = variant_data["mass_kg"] if "mass_kg" in variant_data else variant_data["mass_slug"] * SLUG_KG
    x_cg = variant_data.get("x_cg_over_c", airframe["x_cg_over_c"]) if x_cg_over_c is None else x_cg_over_c
    actuators = data["actuators"]
    limit = np.asarray(actuators["position_limit_deg"]) * DEG_RAD
    span = airframe["span_ft"] * FOOT_M
    side_force = data["side_force"]
    alpha_values, elevator_values, sideslip_values = TABLE_COEFFICIENTS
    validity = data["validity"]
    built = F16(
        mass_properties=f16_mass_properties(airframe, mass, spinning=variant_data["engine_angular_momentum"]),
        actuators=FirstOrderActuators(
            time_constant=as_array(actuators["time_constant_s"]),
            lower=as_array(-limit),
            upper=as_array(limit),
            rate_limit=as_array(np.asarray(actuators["rate_limit_deg_s"]) * DEG_RAD),
        ),
        alpha_range=range_from_deg(validity["alpha_deg"]),
        beta_range=range_from_deg(validity["beta_deg"]),
        engine=_engine(axes, tables, clamp=clamp),
        span=as_array(span),
        wing_area=as_array(airframe["wing_area_ft2"] * FOOT_M**2),
        mean_chord=as_array(airframe["mean_chord_ft"] * FOOT_M),
        x_cg=as_array(float(x_cg)),
        x_cg_reference=as_array(airframe["x_cg_reference_over_c"]),
        surface_reference=as_array([float(variant_data[f"{n}_reference_deg"]) for n in actuators["order"]]),
        side_force=as_array([side_force["beta_per_deg"], side_force["aileron"], side_force["rudder"]]),
        normal_force_elevator=as_array(side_force["normal_force_elevator"]),
        tables=make_tables(
            make_axes([axes["alpha_deg"], np.arange(-30.0, 31.0, 5.0), variant_data["elevator_axis_deg"]], clamp=clamp),
            [
                ((0,), [tables[name] for name in alpha_values]),
                ((0, 2), [tables[name] for name in elevator_values]),
                ((0, 1), [_on_all_sideslips(name, tables[name]) for name in sideslip_values]),
            ],
        ),
    )
    # Strongly typed leaves: replacing one by another array does not recompile.
    return jax.tree.map(lambda leaf: as_array(leaf), built)


def variant_tables(data: Mapping[str, Any], variant: str) -> dict[str, np.ndarray]:
    """Return all tables of `data` by name, with the changes of a variant, in the units of the file.

    Raises ValueError if an entry to be changed differs from the textbook value that the variant states.
    """
    tables = {name: np.asarray(table["values"], dtype=float) for name, table in data["tables"].items()}
    for name, index, old, new in data["variants"][variant]["changes"]:
        entry = tuple(index)
        if tables[name][entry] != old:
            raise ValueError(f"F-16 variant {variant}: {name}{index} is {tables[name][entry]}, expected {old}")
        tables[name][entry] = new
    return tables


def _on_all_sideslips(name: str, table: np.ndarray) -> np.ndarray:
    """Return a table over beta = -30, ..., 30 deg: an odd function if in `_ODD_IN_SIDESLIP`, otherwise interpolated."""
    if name in _ODD_IN_SIDESLIP:
        return np.concatenate([-table[:, :0:-1], table], axis=1)
    fine = np.empty((table.shape[0], 2 * table.shape[1] - 1))
    fine[:, ::2] = table
    fine[:, 1::2] = (table[:, 1:] + table[:, :-1]) / 2
    return fine


def f16_engine_from_data(data: Mapping[str, Any]) -> F16Engine:
    """Build the textbook's engine from `data`, the content of `data/f16.json`.

    Beyond the thrust tables, the thrust is extrapolated linearly.
    """
    tables = {name: np.asarray(table["values"], dtype=float) for name, table in data["tables"].items()}
    return _engine(data["axes"], tables, clamp=False)


def _engine(axes: Mapping[str, Any], tables: Mapping[str, np.ndarray], *, clamp: bool) -> F16Engine:
    return F16Engine(
        thrust_tables=make_tables(
            make_axes([np.asarray(axes["altitude_ft"]) * FOOT_M, axes["mach"]], clamp=clamp),
            [((0, 1), [tables[name] * LBF_N for name in ("T_idle", "T_mil", "T_max")])],
        )
    )


def range_from_deg(range_deg: Sequence[float]) -> tuple[Scalar, Scalar]:
    """Return minimum and maximum of an angle range in rad, from a pair in deg."""
    return as_array(range_deg[0] * DEG_RAD), as_array(range_deg[1] * DEG_RAD)


def f16_mass_properties(airframe: Mapping[str, Any], mass: float, *, spinning: bool) -> MassProperties:
    """Return mass properties from a mass (kg) and the section `airframe` (inertia, slug ft^2) of a data file.

    If `spinning` is True, the angular momentum of the engine is included.
    """
    J = {name: value * SLUG_FT2_KG_M2 for name, value in airframe["inertia_slug_ft2"].items()}
    inertia_b = np.array([[J["Jxx"], 0.0, -J["Jxz"]], [0.0, J["Jyy"], 0.0], [-J["Jxz"], 0.0, J["Jzz"]]])
    spin = airframe["engine_angular_momentum_slug_ft2_s"] * SLUG_FT2_KG_M2 if spinning else 0.0
    return rigid_body(mass, inertia_b, spin)
