"""The F-16 of Stevens & Lewis in its three published variants (theory section 4; [SL] appendix A; [S119]; [TH])."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.actuators import AbstractActuators, FirstOrderActuators
from anser.aircraft.air_data import AirData
from anser.aircraft.f16_engine import F16Engine
from anser.aircraft.f16_interface import AbstractF16, F16Coefficients
from anser.aircraft.interface import MassProperties
from anser.numerics import Tables, as_array, make_axes, make_tables
from anser.shapes import Scalar, Vector, Vector3
from anser.units import DEG_RAD, FOOT_M, LBF_N, RAD_DEG, SLUG_FT2_KG_M2, SLUG_KG

TABLE_COEFFICIENTS = (
    ("CZ0", "CXq", "CYr", "CYp", "CZq", "Clr", "Clp", "Cmq", "Cnr", "Cnp"),
    ("CX0", "Cm0"),
    ("Clda", "Cldr", "Cnda", "Cndr", "Cl0", "Cn0"),
)
"""Coefficients in each group of `F16.tables`, in their order."""
_GROUPS = (*TABLE_COEFFICIENTS, ("CYb", "CYda", "CYdr"), ("CZde",))
F16_COEFFICIENTS = tuple(itertools.chain(*_GROUPS))
"""Coefficients of the build-up (theory section 4): those of `F16.tables`, `side_force`, `normal_force_elevator`."""
_ODD_IN_SIDESLIP = ("Cl0", "Cn0")


class F16(AbstractF16):
    """F-16 airframe with its engine.

    Attributes
    ----------
    span, wing_area, mean_chord
        Reference lengths (m) and area (m^2).
    x_cg, x_cg_reference
        Centre of gravity and moment reference, fractions of the mean chord.
    surface_reference
        Deflections (elevator, aileron, rudder; deg) that the linear coefficients refer to.
    side_force
        CY per degree of sideslip, per unit aileron and per unit rudder deflection.
    normal_force_elevator
        CZ per unit elevator deflection.
    tables
        Of angle of attack, sideslip and elevator, degrees: functions of the first alone, of it and the elevator, and of
        it and the sideslip.
    """

    mass_properties: MassProperties
    actuators: AbstractActuators
    alpha_range: tuple[Scalar, Scalar]
    beta_range: tuple[Scalar, Scalar]
    engine: F16Engine
    span: Scalar
    wing_area: Scalar
    mean_chord: Scalar
    x_cg: Scalar
    x_cg_reference: Scalar
    surface_reference: Vector3
    side_force: Vector3
    normal_force_elevator: Scalar
    tables: Tables

    @property
    def symmetric(self) -> bool:
        """Side force by sideslip, aileron, rudder and rates alone."""
        return True

    def coefficients(self, air_data: AirData, rates_b: Vector3, surfaces: Vector) -> F16Coefficients:
        """Force and moment coefficients (theory section 4).

        Rates are made dimensionless with b/2V and c/2V; below 1 m/s the speed is held at 1 m/s there, so that the
        coefficients stay finite for an aircraft at rest.
        """
        V = jnp.maximum(air_data.V, 1.0)
        alpha_deg = air_data.alpha * RAD_DEG
        beta_deg = air_data.beta * RAD_DEG
        deflection_deg = surfaces * RAD_DEG
        e, a, r = (deflection_deg[k] / self.surface_reference[k] for k in range(3))
        p = rates_b[0] * self.span / (2 * V)
        q = rates_b[1] * self.mean_chord / (2 * V)
        y = rates_b[2] * self.span / (2 * V)
        of_alpha, of_elevator, of_sideslip = self.tables(alpha_deg, beta_deg, deflection_deg[0])
        CZ0, CXq, CYr, CYp, CZq, Clr, Clp, Cmq, Cnr, Cnp = of_alpha
        CX0, Cm0 = of_elevator
        Clda, Cldr, Cnda, Cndr, Cl0, Cn0 = of_sideslip
        lever = self.x_cg_reference - self.x_cg
        CX = CX0 + CXq * q
        CY = self.side_force[0] * beta_deg + self.side_force[1] * a + self.side_force[2] * r + CYr * y + CYp * p
        CZ = CZ0 * (1 - air_data.beta**2) + self.normal_force_elevator * e + CZq * q
        return F16Coefficients(
            CX=CX,
            CY=CY,
            CZ=CZ,
            Cl=Cl0 + Clda * a + Cldr * r + Clr * y + Clp * p,
            Cm=Cm0 + CZ * lever + Cmq * q,
            Cn=Cn0 + Cnda * a + Cndr * r + Cnr * y + Cnp * p - CY * lever * self.mean_chord / self.span,
        )

    def with_coefficients_scaled(self, factors: Float[Array, "22"]) -> "F16":
        """Each of `F16_COEFFICIENTS` multiplied by its factor, as a whole table: its contribution scales exactly."""
        ends = np.cumsum([len(names) for names in _GROUPS])[:-1]
        *tables, side_force, normal_force = jnp.split(factors, ends)
        return eqx.tree_at(
            lambda a: (a.tables.cells, a.side_force, a.normal_force_elevator),
            self,
            (
                tuple(cells * part[None, None, :] for cells, part in zip(self.tables.cells, tables, strict=True)),
                self.side_force * side_force,
                self.normal_force_elevator * normal_force[0],
            ),
        )


def f16_from_data(data: Mapping[str, Any], variant: str = "textbook", x_cg_over_c: float | None = None) -> F16:
    """Build the F-16 from its data file.

    Parameters
    ----------
    data
        Content of `aircraft/data/f16.json`.
    variant
        "textbook", "s119" or "founding".
    x_cg_over_c
        Centre of gravity as a fraction of the mean chord; the variant's own where None.

    Raises
    ------
    ValueError
        If the variant is unknown, or an entry that a variant changes is not what the file says it should be.
    """
    if variant not in data["variants"]:
        raise ValueError(f"F-16 variant {variant!r}: known are {', '.join(data['variants'])}")
    chosen = data["variants"][variant]
    tables = tables_of_variant(data, variant)
    clamp = chosen["table_ends"].startswith("clamped")
    axes = data["axes"]
    airframe = data["airframe"]
    mass = chosen["mass_kg"] if "mass_kg" in chosen else chosen["mass_slug"] * SLUG_KG
    x_cg = chosen.get("x_cg_over_c", airframe["x_cg_over_c"]) if x_cg_over_c is None else x_cg_over_c
    actuators = data["actuators"]
    limit = np.asarray(actuators["position_limit_deg"]) * DEG_RAD
    span = airframe["span_ft"] * FOOT_M
    side = data["side_force"]
    of_alpha, of_elevator, of_sideslip = TABLE_COEFFICIENTS
    validity = data["validity"]
    built = F16(
        mass_properties=f16_mass_properties(airframe, mass, spinning=chosen["engine_angular_momentum"]),
        actuators=FirstOrderActuators(
            time_constant=as_array(actuators["time_constant_s"]),
            lower=as_array(-limit),
            upper=as_array(limit),
            rate_limit=as_array(np.asarray(actuators["rate_limit_deg_s"]) * DEG_RAD),
        ),
        alpha_range=range_rad(validity["alpha_deg"]),
        beta_range=range_rad(validity["beta_deg"]),
        engine=_engine(axes, tables, clamp=clamp),
        span=as_array(span),
        wing_area=as_array(airframe["wing_area_ft2"] * FOOT_M**2),
        mean_chord=as_array(airframe["mean_chord_ft"] * FOOT_M),
        x_cg=as_array(float(x_cg)),
        x_cg_reference=as_array(airframe["x_cg_reference_over_c"]),
        surface_reference=as_array([float(chosen[f"{n}_reference_deg"]) for n in actuators["order"]]),
        side_force=as_array([side["beta_per_deg"], side["aileron"], side["rudder"]]),
        normal_force_elevator=as_array(side["normal_force_elevator"]),
        tables=make_tables(
            make_axes([axes["alpha_deg"], np.arange(-30.0, 31.0, 5.0), chosen["elevator_axis_deg"]], clamp=clamp),
            [
                ((0,), [tables[name] for name in of_alpha]),
                ((0, 2), [tables[name] for name in of_elevator]),
                (
                    (0, 1),
                    [(_odd_extension if n in _ODD_IN_SIDESLIP else _on_five_degrees)(tables[n]) for n in of_sideslip],
                ),
            ],
        ),
    )
    # Strongly typed leaves: replacing one by another array does not recompile.
    return jax.tree.map(lambda leaf: as_array(leaf), built)


def tables_of_variant(data: Mapping[str, Any], variant: str) -> dict[str, np.ndarray]:
    """Textbook tables with the variant's changed entries; each old value is checked against what the file states."""
    tables = {name: np.asarray(table["values"], dtype=float) for name, table in data["tables"].items()}
    for name, index, old, new in data["variants"][variant]["changes"]:
        at = tuple(index)
        if tables[name][at] != old:
            raise ValueError(f"F-16 variant {variant}: {name}{index} is {tables[name][at]}, expected {old}")
        tables[name][at] = new
    return tables


def _on_five_degrees(table: np.ndarray) -> np.ndarray:
    """A table on beta = -30, -20, ..., 30 deg given on every fifth degree: the same bilinear function."""
    fine = np.empty((table.shape[0], 2 * table.shape[1] - 1))
    fine[:, ::2] = table
    fine[:, 1::2] = (table[:, 1:] + table[:, :-1]) / 2
    return fine


def _odd_extension(table: np.ndarray) -> np.ndarray:
    """A table on |beta| = 0, 5, ..., 30 deg times sign(beta), given on beta = -30, -25, ..., 30 deg."""
    return np.concatenate([-table[:, :0:-1], table], axis=1)


def engine_from_data(data: Mapping[str, Any]) -> F16Engine:
    """Build the engine alone from `aircraft/data/f16.json`: the textbook's thrust tables, which are TP-1538's."""
    tables = {name: np.asarray(table["values"], dtype=float) for name, table in data["tables"].items()}
    return _engine(data["axes"], tables, clamp=False)


def _engine(axes: Mapping[str, Any], tables: Mapping[str, np.ndarray], *, clamp: bool) -> F16Engine:
    return F16Engine(
        thrust_tables=make_tables(
            make_axes([np.asarray(axes["altitude_ft"]) * FOOT_M, axes["mach"]], clamp=clamp),
            [((0, 1), [tables[name] * LBF_N for name in ("T_idle", "T_mil", "T_max")])],
        )
    )


def range_rad(range_deg: Sequence[float]) -> tuple[Scalar, Scalar]:
    """Least and greatest angle, given in deg, as arrays in rad."""
    return as_array(range_deg[0] * DEG_RAD), as_array(range_deg[1] * DEG_RAD)


def f16_mass_properties(airframe: Mapping[str, Any], mass: float, *, spinning: bool) -> MassProperties:
    """Mass (kg) with the inertia of a data file's `airframe`, and its engine's angular momentum if that spins."""
    J = {name: value * SLUG_FT2_KG_M2 for name, value in airframe["inertia_slug_ft2"].items()}
    inertia_b = np.array([[J["Jxx"], 0.0, -J["Jxz"]], [0.0, J["Jyy"], 0.0], [-J["Jxz"], 0.0, J["Jzz"]]])
    spin = airframe["engine_angular_momentum_slug_ft2_s"] * SLUG_FT2_KG_M2 if spinning else 0.0
    return MassProperties(
        mass=as_array(mass),
        inertia_b=as_array(inertia_b),
        inertia_inverse_b=as_array(np.linalg.inv(inertia_b)),
        spin_momentum_b=as_array([spin, 0.0, 0.0]),
    )
