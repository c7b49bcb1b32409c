"""Verification of the F-16's aerodynamic and engine data.

Check shots (published pairs of inputs and outputs) of the s119 data files, and the tables of the founding thesis,
entry by entry.
"""

import functools
import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.air_data import AirData, air_data
from anser.aircraft.engines import thrust_along_body_x
from anser.aircraft.f16 import F16
from anser.aircraft_files.library import load_f16
from anser.environment.atmosphere import StandardAtmosphere
from anser.shapes import Scalar, Vector, Vector3
from anser.units import DEG_RAD, FOOT_M, FT_LBF_N_M, LBF_N
from anser.verification.checks import Check, Comparison, load_published

_MOMENT_REFERENCE = 0.35
"""Moment reference of the data, x/c, used as the centre of gravity so that the moments have no lever."""
_UNITS = {"nd": "", "ft": "ft", "ft2": "ft^2", "lbf": "lbf", "ftlbf": "ft lbf"}
_AERO_INPUTS = {
    "trueAirspeed": FOOT_M,
    "angleOfAttack": DEG_RAD,
    "angleOfSideslip": DEG_RAD,
    "bodyAngularRate_Roll": 1.0,
    "bodyAngularRate_Pitch": 1.0,
    "bodyAngularRate_Yaw": 1.0,
    "elevatorDeflection": DEG_RAD,
    "aileronDeflection": DEG_RAD,
    "rudderDeflection": DEG_RAD,
}
"""Inputs of the aerodynamic check shots, in the order of the columns, with their factors to SI units."""
_ROTATION_AXES = ("Roll", "Pitch", "Yaw")
_ENGINE_INPUTS = {"powerLeverAngle": 1.0, "altitudeMSL": FOOT_M, "mach": 1.0}


@jax.jit
def _shot_coefficients(airframe: F16, shots: Float[Array, "shot 9"]) -> dict[str, Float[Array, " shot"]]:
    """Compute the coefficients of each check shot; density has no effect, so sea level is used."""

    def coefficients_of_shot(
        speed: Array, alpha: Array, beta: Array, rates_b: Vector3, surfaces: Vector3
    ) -> dict[str, Array]:
        direction = [jnp.cos(alpha) * jnp.cos(beta), jnp.sin(beta), jnp.sin(alpha) * jnp.cos(beta)]
        data = air_data(speed * jnp.stack(direction), 0.0, StandardAtmosphere().at(0.0))
        coefficients = airframe.coefficients(data, rates_b, surfaces)
        forces, moments = (
            (coefficients.CX, coefficients.CY, coefficients.CZ),
            (coefficients.Cl, coefficients.Cm, coefficients.Cn),
        )
        return {
            **{f"aeroBodyForceCoefficient_{axis}": C for axis, C in zip("XYZ", forces, strict=True)},
            **{f"aeroBodyMomentCoefficient_{axis}": C for axis, C in zip(_ROTATION_AXES, moments, strict=True)},
            "referenceWingChord": airframe.mean_chord / FOOT_M,
            "referenceWingSpan": airframe.span / FOOT_M,
            "referenceWingArea": airframe.wing_area / FOOT_M**2,
        }

    return jax.vmap(coefficients_of_shot)(shots[:, 0], shots[:, 1], shots[:, 2], shots[:, 3:6], shots[:, 6:9])


@jax.jit
def _shot_thrust(airframe: F16, shots: Float[Array, "shot 3"]) -> dict[str, Float[Array, " shot"]]:
    """Compute the thrust (lbf) and its moment (ft lbf) in each check shot."""

    def thrust_of_shot(shot: Vector3) -> dict[str, Array]:
        wrench = thrust_along_body_x(airframe.engine.thrust(shot[0], shot[1], shot[2]))
        force, moment = wrench.force_b / LBF_N, wrench.moment_b / FT_LBF_N_M
        return {
            **{f"thrustBodyForce_{axis}": force[k] for k, axis in enumerate("XYZ")},
            **{f"thrustBodyMoment_{axis}": moment[k] for k, axis in enumerate(_ROTATION_AXES)},
        }

    return jax.vmap(thrust_of_shot)(shots)


def _measure_shots(
    file: str, factors: dict[str, float], compute: Callable[[F16, Array], dict[str, Float[Array, " shot"]]]
) -> tuple[Comparison, ...]:
    """Compare the model with a file's check shots (published pairs of inputs and outputs).

    `factors` lists the inputs in the order of `compute`'s columns, each with the factor to SI units and rad.
    """
    shots = load_published(file)["shots"]
    inputs = jnp.array([[shot["inputs"][name][0] * factor for name, factor in factors.items()] for shot in shots])
    airframe = load_f16("s119", x_cg_over_c=_MOMENT_REFERENCE)
    values = {name: np.asarray(column) for name, column in compute(airframe, inputs).items()}
    return tuple(
        Comparison(name, shot["name"], _UNITS[unit], expected, float(values[name][k]), tolerance)
        for k, shot in enumerate(shots)
        for name, (expected, unit, tolerance) in shot["outputs"].items()
    )


F16_AERO_SHOTS = Check(
    key="f16-aero-shots",
    title="F-16: static check shots of the aerodynamic model",
    source="[S119] F16_aero",
    tolerance_reason="the shots' own",
    explanation=(
        "Coefficients of the s119 variant at 300 ft/s and 5 deg angle of attack, with one input moved at a time. They "
        "refer to the moment reference of the data, 0.35 c, so the centre of gravity is put there."
    ),
    measure=functools.partial(_measure_shots, "daveml_aero_checks", _AERO_INPUTS, _shot_coefficients),
)

F16_ENGINE_SHOTS = Check(
    key="f16-engine-shots",
    title="F-16: static check shots of the engine model",
    source="[S119] F16_prop",
    tolerance_reason="the shots' own",
    explanation=(
        "Thrust of the s119 variant from power lever, altitude and Mach number; it has no moment and no side force."
    ),
    measure=functools.partial(_measure_shots, "daveml_engine_checks", _ENGINE_INPUTS, _shot_thrust),
)


_TABLES_MOMENT_REFERENCE = 0.35
"""Moment reference of the thesis tables, x/c, used as centre of gravity."""
_SPEED_M_S = 100.0
_TOLERANCE, _TOLERANCE_LBF = 1e-12, 1e-9
_RATES = {"p": 0, "q": 1, "r": 2}
_DEFLECTIONS = {"da": (1, 21.5), "dr": (2, 30.0)}
"""For each printed increment, the index of the surface and its deflection (deg)."""
_POWERS = {"T_idle": 0.0, "T_mil": 50.0, "T_max": 100.0}


@jax.jit
def _coefficients(airframe: F16, points: Float[Array, "point 8"]) -> Float[Array, "point 6"]:
    """Compute CX, CY, CZ, Cl, Cm, Cn at points (rows).

    Columns: alpha, beta, elevator, aileron, rudder (deg), dimensionless P, Q, R.
    """
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
    """Compute the thrust (lbf) at points (rows). Columns: power (percent), altitude (ft), Mach number."""

    def thrust(point: Vector) -> Scalar:
        return airframe.engine.thrust(point[0], point[1] * FOOT_M, point[2]) / LBF_N

    return jax.vmap(thrust)(points)


def _grid_points(axes: Mapping[str, Sequence[float]]) -> list[dict[str, float]]:
    """Return the grid points of a table, each as values by axis name, the last axis fastest."""
    return [dict(zip(axes, point, strict=True)) for point in itertools.product(*axes.values())]


def _entries(name: str, axes: Mapping[str, Sequence[float]], airframe: F16) -> np.ndarray:
    """Compute the entries of a thesis table from the aircraft model.

    An entry is a coefficient, or the increment of a coefficient by a rate or a deflection.
    """
    grid_points = _grid_points(axes)
    if name in _POWERS:
        points = [[_POWERS[name], grid_point["altitude_ft"], grid_point["mach"]] for grid_point in grid_points]
        return np.asarray(_thrusts(airframe, jnp.array(points)))
    neutral = np.zeros((len(grid_points), 8))
    neutral[:, 0] = [grid_point["alpha_deg"] for grid_point in grid_points]
    neutral[:, 1] = [grid_point.get("beta_deg", grid_point.get("abs_beta_deg", 0.0)) for grid_point in grid_points]
    neutral[:, 2] = [grid_point.get("elevator_deg", 0.0) for grid_point in grid_points]
    column = ("CX", "CY", "CZ", "Cl", "Cm", "Cn").index(name[:2])
    deflected, increment = neutral.copy(), name[2:]
    if increment in _DEFLECTIONS:
        surface, deflection = _DEFLECTIONS[increment]
        deflected[:, 2 + surface] = deflection
    elif increment in _RATES:
        deflected[:, 5 + _RATES[increment]] = 1.0
    else:
        return _column(airframe, neutral, column)
    return _column(airframe, deflected, column) - _column(airframe, neutral, column)


def _column(airframe: F16, points: np.ndarray, column: int) -> np.ndarray:
    return np.asarray(_coefficients(airframe, jnp.asarray(points)))[:, column]


def _grid_point_label(grid_point: Mapping[str, float]) -> str:
    return ", ".join(f"{axis} {value:g}" for axis, value in grid_point.items())


def _measure_tables() -> tuple[Comparison, ...]:
    airframe = load_f16("founding", x_cg_over_c=_TABLES_MOMENT_REFERENCE)
    tables: Mapping[str, Any] = load_published("thesis_tables")["tables"]
    comparisons: list[Comparison] = []
    for name, table in tables.items():
        unit, tolerance = ("lbf", _TOLERANCE_LBF) if name in _POWERS else ("", _TOLERANCE)
        printed = np.ravel(table["values"])
        obtained = _entries(name, table["axes"], airframe)
        for grid_point, expected, value in zip(_grid_points(table["axes"]), printed, obtained, strict=True):
            group = f"{name}, table {table['number']}"
            comparisons.append(
                Comparison(group, _grid_point_label(grid_point), unit, float(expected), float(value), tolerance)
            )
    return tuple(comparisons)


THESIS_TABLES = Check(
    key="thesis-tables",
    title="F-16: tables of the founding thesis",
    source="[TH] tables 3-6 to 3-18",
    tolerance_reason="rounding",
    explanation=(
        "All 852 entries of the printed tables against the variant founding, as it flies: coefficients at the "
        "breakpoints with the centre of gravity at the reference of the moments, damping as the change for a "
        "dimensionless rate of 1, aileron and rudder as the change for 21.5 and 30 deg, thrust at idle, military and "
        "full power."
    ),
    measure=_measure_tables,
)
