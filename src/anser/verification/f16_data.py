"""Verification of the F-16's aerodynamic and engine data.

The sources are the check shots (published pairs of inputs and outputs) of the s119 data files, the tables of the
founding thesis, and NASA's DAVE-ML files.
"""

import dataclasses
import functools
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.air_data import AirData, Wrench, air_data
from anser.aircraft.dave_ml_aircraft import AERO_OUTPUTS, ENGINE_OUTPUTS, ENGINE_POWER, DaveMlAircraft, DaveMlEngine
from anser.aircraft.engines import thrust_along_body_x
from anser.aircraft.f16 import F16, F16Engine
from anser.aircraft_files.library import load_airframe, load_f16
from anser.airframe_data import BODY_COEFFICIENTS
from anser.compiling.options import compiled_quickly
from anser.dave_ml.evaluator import Evaluator
from anser.environment.atmosphere import StandardAtmosphere
from anser.numerics.arrays import as_array
from anser.shapes import Scalar, ScalarLike, Vector, Vector3
from anser.units import DEG_RAD, FOOT_M, FT_LBF_N_M, LBF_N, RAD_DEG
from anser.verification.checks import Comparison, load_published, make_check
from anser.verification.nesc_cases import TRIMMED_FLIGHTS, column_unit
from anser.verification.nesc_flight import LOG_PERIOD_S, fly_trimmed, trimmed_logs

_MOMENT_REFERENCE = 0.35
"""Moment reference of data and thesis tables, x/c; with the centre of gravity at this point, moments have no lever."""
_UNITS = {"nd": "", "ft": "ft", "ft2": "ft^2", "lbf": "lbf", "ftlbf": "ft lbf"}
_INPUT_FACTORS = {"ft_s": FOOT_M, "ft": FOOT_M, "deg": DEG_RAD}
"""Factor to SI units by unit of the check shots' inputs; 1 for other units, percent included."""


@jax.jit
def _shot_coefficients(airframe: F16, shots: Float[Array, "shot 9"]) -> dict[str, Float[Array, " shot"]]:
    """Compute the coefficients and reference lengths (ft, ft^2) of each check shot, by the data file's output names.

    Columns of `shots`: airspeed (m/s), alpha, beta, body rates (3), deflections of elevator, aileron and rudder, in
    radians.
    """

    def coefficients_of_shot(
        speed: Array, alpha: Array, beta: Array, rates_b: Vector3, surfaces: Vector3
    ) -> dict[str, Array]:
        direction = [jnp.cos(alpha) * jnp.cos(beta), jnp.sin(beta), jnp.sin(alpha) * jnp.cos(beta)]
        data = air_data(speed * jnp.stack(direction), 0.0, StandardAtmosphere().at(0.0))
        C = airframe.coefficients(data, rates_b, surfaces)
        return {
            **dict(zip(AERO_OUTPUTS, (C.CX, C.CY, C.CZ, C.Cl, C.Cm, C.Cn), strict=True)),
            "referenceWingChord": airframe.mean_chord / FOOT_M,
            "referenceWingSpan": airframe.span / FOOT_M,
            "referenceWingArea": airframe.wing_area / FOOT_M**2,
        }

    return jax.vmap(coefficients_of_shot)(shots[:, 0], shots[:, 1], shots[:, 2], shots[:, 3:6], shots[:, 6:9])


@jax.jit
def _shot_thrust(airframe: F16, shots: Float[Array, "shot 3"]) -> dict[str, Float[Array, " shot"]]:
    """Compute force (lbf) and moment (ft lbf) of the engine in each check shot, by the data file's output names.

    Columns of `shots`: power (percent), altitude (m), Mach number.
    """

    def thrust_of_shot(shot: Vector3) -> dict[str, Array]:
        power, altitude, mach = shot
        unused = jnp.zeros(())
        data = AirData(unused, unused, unused, unused, unused, mach, altitude)
        wrench = airframe.engine.propulsion(power, data)
        return dict(zip(ENGINE_OUTPUTS, (*wrench.force_b / LBF_N, *wrench.moment_b / FT_LBF_N_M), strict=True))

    return jax.vmap(thrust_of_shot)(shots)


def _measure_shots(
    file: str, compute: Callable[[F16, Array], dict[str, Float[Array, " shot"]]]
) -> Iterator[Comparison]:
    """Compare outputs of the s119 F-16, from `compute` (inputs in SI units, rad), with the check shots of a file."""
    shots = load_published(file)["shots"]
    inputs = jnp.array(
        [[number * _INPUT_FACTORS.get(unit, 1.0) for number, unit in shot["inputs"].values()] for shot in shots]
    )
    airframe = load_f16("s119", x_cg_over_c=_MOMENT_REFERENCE)
    values = {name: np.asarray(column) for name, column in compute(airframe, inputs).items()}
    for k, shot in enumerate(shots):
        for name, (expected, unit, tolerance) in shot["outputs"].items():
            yield Comparison(name, shot["name"], _UNITS[unit], expected, float(values[name][k]), tolerance)


F16_AERO_SHOTS = make_check(
    "f16-aero-shots", functools.partial(_measure_shots, "daveml_aero_checks", _shot_coefficients)
)

F16_ENGINE_SHOTS = make_check(
    "f16-engine-shots", functools.partial(_measure_shots, "daveml_engine_checks", _shot_thrust)
)


_SPEED_M_S = 100.0
_TOLERANCE, _TOLERANCE_LBF = 1e-12, 1e-9
_INCREMENTS = {"da": (3, 21.5), "dr": (4, 30.0), "p": (5, 1.0), "q": (6, 1.0), "r": (7, 1.0)}
"""By increment in a table's name: the column of `_coefficients` that is changed, and its deflection (deg) or rate."""
_POWERS = {"T_idle": 0.0, "T_mil": 50.0, "T_max": 100.0}


@jax.jit
def _coefficients(airframe: F16, points: Float[Array, "point 8"]) -> Float[Array, "point 6"]:
    """Compute CX, CY, CZ, Cl, Cm, Cn at points (rows).

    Columns: alpha, beta, elevator, aileron, rudder (deg), dimensionless rates P, Q, R.
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
    """Compute the thrust, lbf, at points (rows); columns: power (percent), altitude (ft), Mach number."""

    def thrust(point: Vector) -> Scalar:
        return airframe.engine.thrust(point[0], point[1] * FOOT_M, point[2]) / LBF_N

    return jax.vmap(thrust)(points)


def _grid_points(axes: Mapping[str, Sequence[float]]) -> list[dict[str, float]]:
    """Return the grid points of a table, each as coordinates by axis name; the last axis varies fastest."""
    return [dict(zip(axes, point, strict=True)) for point in itertools.product(*axes.values())]


def _entries(name: str, axes: Mapping[str, Sequence[float]], airframe: F16) -> np.ndarray:
    """Compute the entries of the thesis table `name` with the aircraft model, flattened as in `_grid_points`."""
    grid_points = _grid_points(axes)
    if name in _POWERS:
        points = [[_POWERS[name], grid_point["altitude_ft"], grid_point["mach"]] for grid_point in grid_points]
        return np.asarray(_thrusts(airframe, jnp.array(points)))
    neutral = np.zeros((len(grid_points), 8))
    neutral[:, 0] = [grid_point["alpha_deg"] for grid_point in grid_points]
    neutral[:, 1] = [grid_point.get("beta_deg", grid_point.get("abs_beta_deg", 0.0)) for grid_point in grid_points]
    neutral[:, 2] = [grid_point.get("elevator_deg", 0.0) for grid_point in grid_points]
    column, increment = BODY_COEFFICIENTS.index(name[:2]), name[2:]
    without = np.asarray(_coefficients(airframe, jnp.asarray(neutral)))[:, column]
    if increment not in _INCREMENTS:
        return without
    moved_column, amount = _INCREMENTS[increment]
    moved = neutral.copy()
    moved[:, moved_column] = amount
    return np.asarray(_coefficients(airframe, jnp.asarray(moved)))[:, column] - without


def _measure_tables() -> Iterator[Comparison]:
    airframe = load_f16("founding", x_cg_over_c=_MOMENT_REFERENCE)
    tables: Mapping[str, Any] = load_published("thesis_tables")["tables"]
    for name, table in tables.items():
        unit, tolerance = ("lbf", _TOLERANCE_LBF) if name in _POWERS else ("", _TOLERANCE)
        entries = zip(
            _grid_points(table["axes"]), np.ravel(table["values"]), _entries(name, table["axes"], airframe), strict=True
        )
        for grid_point, expected, computed in entries:
            point = ", ".join(f"{axis} {coordinate:g}" for axis, coordinate in grid_point.items())
            yield Comparison(
                f"{name}, table {table['number']}", point, unit, float(expected), float(computed), tolerance
            )


THESIS_TABLES = make_check("thesis-tables", _measure_tables)


STATES = 10_000
_FLIGHT_SHARE = 1e-6
"""Accepted difference between the two flights of NESC case 11, as a fraction of the case's tolerances."""


class FileEngine(F16Engine):
    """Engine with the thrust of NASA's F16_prop.dml, and the lag and inverse functions of the built-in engine."""

    evaluator: Evaluator

    def propulsion(self, power: ScalarLike, air_data: AirData) -> Wrench:
        """Return the file's thrust along body x, without lateral components; power in percent."""
        inputs = {ENGINE_POWER: 0.01 * power, "altitudeMSL": air_data.altitude, "mach": air_data.mach}
        return thrust_along_body_x(self.evaluator.evaluate_si(inputs, ENGINE_OUTPUTS)[ENGINE_OUTPUTS[0]])


def f16_of_files() -> DaveMlAircraft:
    """Return the F-16 of NASA's DAVE-ML files, with the engine lag and the actuators of the built-in s119 model."""
    built_in, of_files = load_f16("s119"), load_airframe("nasa-f16")
    if not (isinstance(of_files, DaveMlAircraft) and isinstance(of_files.engine, DaveMlEngine)):
        raise TypeError("nasa-f16: expected an aircraft and an engine of DAVE-ML files")
    engine = FileEngine(built_in.engine.thrust_tables, of_files.engine.evaluator)
    return dataclasses.replace(of_files, engine=engine, actuators=built_in.actuators)


def random_states() -> Float[np.ndarray, "state 13"]:
    """Return random states of flight within and beyond the tables, shape (STATES, 13), SI units and radians.

    Columns: V, alpha, beta, body rates P, Q, R, elevator, aileron, rudder, power (percent), altitude, Mach number.
    """
    deflections = np.array([25.0, 21.5, 30.0]) * DEG_RAD
    lower = [5.0, -15 * DEG_RAD, -35 * DEG_RAD, *[-2.0] * 3, *-deflections, 0.0, -500.0, 0.0]
    upper = [400.0, 50 * DEG_RAD, 35 * DEG_RAD, *[2.0] * 3, *deflections, 100.0, 16e3, 1.2]
    return np.random.default_rng(24).uniform(lower, upper, (STATES, len(lower)))


@compiled_quickly
def compare_models(built_in: F16, of_files: DaveMlAircraft, states: Array) -> tuple[dict, dict]:
    """Compute the coefficients and the thrust (lbf) of each state by the DAVE-ML files, and by the built-in model.

    `states` has the columns of `random_states`. The centre of gravity of `built_in` must be at the moment reference
    point of the files.
    """

    def compare_state(state: Array) -> tuple[dict[str, Scalar], dict[str, Scalar]]:
        V, alpha, beta, rates_b, surfaces = state[0], state[1], state[2], state[3:6], state[6:9]
        direction = jnp.stack([jnp.cos(alpha) * jnp.cos(beta), jnp.sin(beta), jnp.sin(alpha) * jnp.cos(beta)])
        data = air_data(V * direction, state[10], StandardAtmosphere().at(0.0))
        data = eqx.tree_at(lambda d: (d.V, d.alpha, d.beta, d.mach), data, (V, alpha, beta, state[11]))
        file_coefficients = of_files.coefficients(data, rates_b, surfaces)
        built_in_coefficients = built_in.coefficients(data, rates_b, surfaces)
        file_values: dict[str, Scalar] = dict(zip(BODY_COEFFICIENTS, file_coefficients, strict=True))
        file_values["thrust"] = of_files.engine.propulsion(state[9], data).force_b[0] / LBF_N
        built_in_values: dict[str, Scalar] = {name: getattr(built_in_coefficients, name) for name in BODY_COEFFICIENTS}
        built_in_values["thrust"] = built_in.engine.propulsion(state[9], data).force_b[0] / LBF_N
        return file_values, built_in_values

    return jax.vmap(compare_state)(states)


def with_degrees_per_radian(of_files: DaveMlAircraft, degrees: float) -> DaveMlAircraft:
    """Return a copy of the files' F-16 that converts angles with `degrees` per radian."""
    return eqx.tree_at(lambda airframe: airframe.evaluator.constants["rtd"], of_files, as_array(degrees))


def _compare_coefficients() -> tuple[Comparison, ...]:
    """Compare coefficients and thrust of the DAVE-ML files' F-16 and the built-in s119 F-16 at random states."""
    airframe, as_filed, states = load_f16("s119", x_cg_over_c=_MOMENT_REFERENCE), f16_of_files(), random_states()
    from_file, built_in = compare_models(airframe, with_degrees_per_radian(as_filed, RAD_DEG), as_array(states))
    comparisons = [_worst(name, from_file[name], built_in[name], _TOLERANCE, "", "") for name in BODY_COEFFICIENTS]
    tolerance = _TOLERANCE * float(np.max(np.abs(from_file["thrust"])))
    thrust = _worst("thrust", from_file["thrust"], built_in["thrust"], tolerance, "lbf", "1e-12 of the greatest")
    rounded_pi, _ = compare_models(airframe, as_filed, as_array(states))
    # CZ0 (1 - beta^2), beta in degrees over the file's degrees per radian; |CZ0| <= 2.248.
    relative_error = 2.0 * abs(float(as_filed.evaluator.constants["rtd"]) / RAD_DEG - 1.0)
    tolerance = 2.248 * relative_error * float(np.max(states[:, 2] ** 2)) + _TOLERANCE
    filed = _worst("CZ, as filed", rounded_pi["CZ"], built_in["CZ"], tolerance, "", "the file's pi of nine digits")
    return (*comparisons, thrust, filed)


def _worst(name: str, expected: Array, computed: Array, tolerance: float, unit: str, reason: str) -> Comparison:
    worst = int(np.argmax(np.abs(np.asarray(computed) - np.asarray(expected))))
    point = f"worst of {STATES:,} random states"
    figures = float(expected[worst]), float(computed[worst])
    return Comparison(name, point, unit, *figures, tolerance, tolerance_reason=reason)


def _compare_flights() -> tuple[Comparison, ...]:
    """Compare NESC case 11 flown by the built-in F-16 with the case flown by the F-16 of the DAVE-ML files."""
    case = TRIMMED_FLIGHTS[0]
    built_in = trimmed_logs()[case.number]
    from_files = fly_trimmed([case], f16_of_files())[case.number]
    log_indices = [round(time_s / LOG_PERIOD_S) for time_s in case.times_s]
    comparisons = []
    for name, column in load_published("nesc_checkpoints")["cases"][f"{case.number}"]["columns"].items():
        if "tolerance" not in column:
            continue
        expected, computed = from_files[name][log_indices], built_in[name][log_indices]
        k = int(np.argmax(np.abs(computed - expected)))
        point, tolerance = f"NESC case 11, t {case.times_s[k]:g} s", _FLIGHT_SHARE * column["tolerance"]
        figures, reason = (float(expected[k]), float(computed[k])), "1e-6 of NESC case 11's"
        comparisons.append(Comparison(name, point, column_unit(name), *figures, tolerance, tolerance_reason=reason))
    return tuple(comparisons)


F16_FILES = make_check("f16-files", lambda: (*_compare_coefficients(), *_compare_flights()))
