"""The founding variant of the F-16 against the tables of the founding thesis, entry by entry."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft import F16, AirData
from anser.scenario import load_f16
from anser.shapes import Scalar, Vector
from anser.units import DEG_RAD, FOOT_M, LBF_N
from anser.verification.check import Check, Comparison
from anser.verification.published import published

_MOMENT_REFERENCE = 0.35
"""Of the tables, x/c: no lever from there to the centre of gravity."""
_SPEED_M_S = 100.0
_TOLERANCE, _TOLERANCE_LBF = 1e-12, 1e-9
_RATES = {"p": 0, "q": 1, "r": 2}
_DEFLECTIONS = {"da": (1, 21.5), "dr": (2, 30.0)}
"""Surface, and the deflection (deg) for which the thesis prints the increment."""
_POWERS = {"T_idle": 0.0, "T_mil": 50.0, "T_max": 100.0}


@jax.jit
def _coefficients(airframe: F16, points: Float[Array, "point 8"]) -> Float[Array, "point 6"]:
    """CX, CY, CZ, Cl, Cm, Cn at rows of alpha, beta, elevator, aileron, rudder (deg) and dimensionless P, Q, R."""
    lengths = jnp.stack([airframe.span, airframe.mean_chord, airframe.span])

    def coefficients(point: Vector) -> Vector:
        zero = jnp.zeros(())
        air_data = AirData(zero + _SPEED_M_S, point[0] * DEG_RAD, point[1] * DEG_RAD, zero, zero, zero, zero)
        rates_b = point[5:] * 2 * _SPEED_M_S / lengths
        C = airframe.coefficients(air_data, rates_b, point[2:5] * DEG_RAD)
        return jnp.stack([C.CX, C.CY, C.CZ, C.Cl, C.Cm, C.Cn])

    return jax.vmap(coefficients)(points)


@jax.jit
def _thrusts(airframe: F16, points: Float[Array, "point 3"]) -> Float[Array, " point"]:
    """Thrust (lbf) at rows of power (percent), altitude (ft) and Mach number."""

    def thrust(point: Vector) -> Scalar:
        return airframe.engine.thrust(point[0], point[1] * FOOT_M, point[2]) / LBF_N

    return jax.vmap(thrust)(points)


def _rows_of(axes: Mapping[str, Sequence[float]]) -> list[dict[str, float]]:
    """Grid points of a table by the names of its axes, the last axis fastest."""
    return [dict(zip(axes, point, strict=True)) for point in itertools.product(*axes.values())]


def _entries(name: str, axes: Mapping[str, Sequence[float]], airframe: F16) -> np.ndarray:
    """A table's entries as the aircraft flies them: a coefficient, or what a rate or deflection adds to it."""
    rows = _rows_of(axes)
    if name in _POWERS:
        points = [[_POWERS[name], row["altitude_ft"], row["mach"]] for row in rows]
        return np.asarray(_thrusts(airframe, jnp.array(points)))
    still = np.zeros((len(rows), 8))
    still[:, 0] = [row["alpha_deg"] for row in rows]
    still[:, 1] = [row.get("beta_deg", row.get("abs_beta_deg", 0.0)) for row in rows]
    still[:, 2] = [row.get("elevator_deg", 0.0) for row in rows]
    column = ("CX", "CY", "CZ", "Cl", "Cm", "Cn").index(name[:2])
    moved, cause = still.copy(), name[2:]
    if cause in _DEFLECTIONS:
        surface, deflection = _DEFLECTIONS[cause]
        moved[:, 2 + surface] = deflection
    elif cause in _RATES:
        moved[:, 5 + _RATES[cause]] = 1.0
    else:
        return _column(airframe, still, column)
    return _column(airframe, moved, column) - _column(airframe, still, column)


def _column(airframe: F16, points: np.ndarray, column: int) -> np.ndarray:
    return np.asarray(_coefficients(airframe, jnp.asarray(points)))[:, column]


def _place(row: Mapping[str, float]) -> str:
    return ", ".join(f"{axis} {value:g}" for axis, value in row.items())


def _measure() -> tuple[Comparison, ...]:
    airframe = load_f16("founding", x_cg_over_c=_MOMENT_REFERENCE)
    tables: Mapping[str, Any] = published("thesis_tables")["tables"]
    found: list[Comparison] = []
    for name, table in tables.items():
        unit, tolerance = ("lbf", _TOLERANCE_LBF) if name in _POWERS else ("", _TOLERANCE)
        printed = np.ravel(table["values"])
        obtained = _entries(name, table["axes"], airframe)
        for row, expected, value in zip(_rows_of(table["axes"]), printed, obtained, strict=True):
            group = f"{name}, table {table['number']}"
            found.append(Comparison(group, _place(row), unit, float(expected), float(value), tolerance))
    return tuple(found)


THESIS_TABLES = Check(
    key="thesis-tables",
    title="F-16: tables of the founding thesis",
    source="[TH] tables 3-6 to 3-18",
    why="rounding",
    explanation=(
        "All 852 entries of the printed tables against the variant founding, as it flies: coefficients at the "
        "breakpoints with the centre of gravity at the reference of the moments, damping as the change for a "
        "dimensionless rate of 1, aileron and rudder as the change for 21.5 and 30 deg, thrust at idle, military and "
        "full power."
    ),
    measure=_measure,
)
