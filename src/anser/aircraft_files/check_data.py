"""Comparison of computed values with the check data in aircraft and DAVE-ML files.

Check data are published forces, moments and trims, and check shots: pairs of inputs and outputs in a DAVE-ML file.
"""

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from anser.aircraft.air_data import AirData, Wrench
from anser.aircraft.dave_ml_aircraft import (
    AERO_LENGTHS,
    AERO_OUTPUTS,
    INERTIA_OUTPUTS,
    DaveMlAircraft,
    dave_ml_body_faults,
)
from anser.aircraft.derivative_aircraft import DerivativeAircraft
from anser.aircraft_files.build import build_airframe, file_models, with_derivatives
from anser.aircraft_files.findings import Finding, level_air_data, suspect_table_points
from anser.aircraft_files.schema import AirframeFile, DaveMlFile
from anser.aircraft_files.schema_tables import ForceCheck, TrimCheck
from anser.config.errors import os_error_reason, problem_error
from anser.dave_ml.definition import Variable
from anser.dave_ml.elements import DaveMlError
from anser.dave_ml.model import Model, read_dave_ml
from anser.dave_ml.standard_units import parse_unit
from anser.environment.environment import standard_environment
from anser.files import read_file
from anser.numerics.arrays import as_array
from anser.steady.trim import solve_trim, trim_target
from anser.units import DEG_RAD, RAD_DEG

_File = AirframeFile | DaveMlFile
_Airframe = DerivativeAircraft | DaveMlAircraft


@dataclass(frozen=True)
class CheckedValue:
    """Comparison of one number of a file's check data (`expected`) with the computed number (`obtained`)."""

    location: str  #: Key, such as ``check.forces[0].force_N[2]``; for check shots see `compare_shots`.
    name: str  #: Name of the check.
    unit: str  #: Unit of all numbers, `tolerance` included.
    expected: float
    obtained: float
    tolerance: float

    @property
    def passed(self) -> bool:
        """Whether the absolute difference is within the tolerance; False for NaN."""
        return abs(self.obtained - self.expected) <= self.tolerance


def compare_check_data(file: _File) -> tuple[CheckedValue, ...]:
    """Compare all check data of a file with computed values, in the order check shots, forces, trims."""
    airframe = build_airframe(file)
    checked_values = []
    if isinstance(file, DaveMlFile):
        for part, model in file_models(file).items():
            checked_values += compare_shots(model, model.definition.file, f"dave_ml.{part}.")
    for k, check in enumerate(file.check.forces):
        checked_values += _force_values(file, airframe, k, check)
    for k, check in enumerate(file.check.trim):
        checked_values += _trim_values(airframe, k, check)
    return tuple(checked_values)


def compare_shots(model: Model, source: str, prefix: str = "") -> list[CheckedValue]:
    """Compare the check shots of a DAVE-ML model with computed values.

    The `location` of a result is `prefix` + varID. Raises ScenarioError if a shot sets a variable that is not an input,
    or omits an input without default. `source` is the name of the file in the message.
    """
    try:
        results = model.check()
    except ValueError as error:
        expected = "check shots that give each input of the file a value"
        raise problem_error(source, str(error), expected, "checkData") from None
    return [CheckedValue(f"{prefix}{r.id}", r.shot, r.units, r.expected, r.computed, r.tolerance) for r in results]


def _force_values(file: _File, airframe: _Airframe, k: int, check: ForceCheck) -> list[CheckedValue]:
    checked_airframe = airframe
    if isinstance(airframe, DerivativeAircraft) and isinstance(file, AirframeFile):
        checked_airframe = with_derivatives(airframe, file, check.instead)
    deflections = as_array([check.surfaces_rad.get(name, 0.0) for name in file.surfaces])
    data = level_air_data(check.airspeed_m_s, check.alpha_rad, check.beta_rad, check.altitude_m, check.density_kg_m3)
    aerodynamic, propulsive = _wrenches(
        checked_airframe, data, as_array(check.rates_rad_s), deflections, as_array(100.0 * check.throttle)
    )
    gravity = np.zeros(3) if check.gravity_m_s2 is None else np.asarray(check.gravity_m_s2)
    weight = float(airframe.mass_properties.mass) * gravity
    total = aerodynamic + propulsive
    comparisons: list[tuple[str, str, float | None, float]] = []
    for key, unit, expected_vector, vector in (
        ("force_N", "N", check.force_N, np.asarray(total.force_b) + weight),
        ("moment_Nm", "N m", check.moment_Nm, np.asarray(total.moment_b)),
    ):
        pairs = zip(expected_vector or (), vector, strict=False)
        comparisons += [
            (f"{key}[{j}]", unit, expected, float(computed)) for j, (expected, computed) in enumerate(pairs)
        ]
    comparisons.append(("thrust_N", "N", check.thrust_N, float(propulsive.force_b[0])))
    comparisons.append(("torque_Nm", "N m", check.torque_Nm, float(propulsive.moment_b[0])))
    return [
        CheckedValue(f"check.forces[{k}].{key}", check.name, unit, expected, obtained, check.tolerance)
        for key, unit, expected, obtained in comparisons
        if expected is not None
    ]


@jax.jit
def _wrenches(
    airframe: _Airframe, data: AirData, rates_b: jax.Array, surfaces: jax.Array, power: jax.Array
) -> tuple[Wrench, Wrench]:
    return airframe.aerodynamics(data, rates_b, surfaces), airframe.engine.propulsion(power, data)


def _trim_values(airframe: _Airframe, k: int, check: TrimCheck) -> list[CheckedValue]:
    target = trim_target(check.airspeed_m_s, check.altitude_m, check.path_angle_deg * DEG_RAD)
    point = jax.jit(solve_trim)(airframe, standard_environment(), target)
    comparisons = [("alpha_deg", "deg", check.alpha_deg, float(point.alpha) * RAD_DEG, check.tolerance_deg)]
    deflections = dict(zip(airframe.actuators.names, np.asarray(jnp.rad2deg(point.state.surfaces)), strict=True))
    comparisons += [
        (f"surfaces_deg.{name}", "deg", expected_deflection, float(deflections[name]), check.tolerance_deg)
        for name, expected_deflection in check.surfaces_deg.items()
    ]
    comparisons.append(("throttle", "", check.throttle, float(point.controls.throttle), check.tolerance_throttle))
    return [
        CheckedValue(f"check.trim[{k}].{key}", check.name, unit, expected, obtained, tolerance)
        for key, unit, expected, obtained, tolerance in comparisons
        if expected is not None
    ]


_NEAR_LEVEL = {
    "trueAirspeed": 100.0, "mach": 0.3, "altitudeMSL": 0.0, "airDensity": 1.225, "dynamicPressure": 6125.0,
    "angleOfAttack": 0.035, "angleOfSideslip": 0.0,
    "bodyAngularRate_Roll": 0.0, "bodyAngularRate_Pitch": 0.0, "bodyAngularRate_Yaw": 0.0,
}  # fmt: skip
"""Flight condition for the check of slopes, SI units and rad; other inputs are at their default value or 0."""
_SLOPES = (
    ("aeroBodyForceCoefficient_Z", "angleOfAttack", "the lift falls with the angle of attack"),
    ("aeroBodyForceCoefficient_Y", "angleOfSideslip", "the side force points to where the air comes from"),
    ("aeroBodyMomentCoefficient_Roll", "bodyAngularRate_Roll", "the roll rate drives itself on; damping is negative"),
    ("aeroBodyMomentCoefficient_Pitch", "bodyAngularRate_Pitch", "the pitch rate drives itself on"),
    ("aeroBodyMomentCoefficient_Yaw", "bodyAngularRate_Yaw", "the yaw rate drives itself on; damping is negative"),
)
"""Slopes (coefficient, input) that are negative for every ordinary aircraft, and the meaning of a positive slope."""


@dataclass(frozen=True)
class ModelCheck:
    """Result of `check_model`: compared values of the check shots, probable errors, input and output variables."""

    checked_values: tuple[CheckedValue, ...]
    findings: tuple[Finding, ...]
    inputs: tuple[Variable, ...]
    outputs: tuple[Variable, ...]


def check_model(path: str | os.PathLike[str]) -> ModelCheck:
    """Read a DAVE-ML file, compute its check shots and search for probable errors.

    Raises ScenarioError if the file cannot be read, is not DAVE-ML, or has check shots with wrong inputs; the message
    gives position and expected content.
    """
    source = os.fspath(path)
    try:
        model = read_dave_ml(read_file(Path(path)), Path(path).name)
    except DaveMlError as error:
        position = "" if error.line is None else f"line {error.line}, column {error.column}"
        raise problem_error(source, error.arrived, error.expected, position) from None
    except (OSError, ValueError) as error:
        arrived = f"a path that cannot be read ({os_error_reason(error)})"
        raise problem_error(source, arrived, "a DAVE-ML file that can be read") from None
    variables = model.definition.variables
    return ModelCheck(
        checked_values=tuple(compare_shots(model, source)),
        findings=(
            *_unit_findings(model),
            *_unused_findings(model),
            *_body_findings(model),
            *_slope_findings(model),
            *(Finding(f"table {name}", text) for name, text in suspect_table_points(model, {})),
        ),
        inputs=tuple(variables[name] for name in model.inputs),
        outputs=tuple(variables[name] for name in model.outputs),
    )


def _unit_findings(model: Model) -> Iterator[Finding]:
    unknown: dict[str, list[Variable]] = {}
    for variable in model.definition.variables.values():
        try:
            parse_unit(variable.units)
        except ValueError:
            unknown.setdefault(variable.units, []).append(variable)
    for units, variables in unknown.items():
        names = ", ".join(variable.id for variable in variables)
        text = f'units "{units}" of {names}: no unit of ANSI/AIAA S-119, nor one that converts to SI'
        yield Finding(_line(variables[0]), text)


def _unused_findings(model: Model) -> Iterator[Finding]:
    """Yield a finding for each unused table and each unused input, or one finding if the file has no outputs."""
    definition, structure = model.definition, model.evaluator.structure
    used = {function.table for function in definition.functions}
    for name, table in {**definition.gridded, **definition.ungridded}.items():
        if name not in used:
            yield Finding(f"line {table.location.line}", f"table {name}: no function uses it")
    if not structure.outputs:
        yield Finding("variableDef", "no variable is marked <isOutput/>: a check without outputs compares nothing")
        return
    required = structure.required_variables(structure.outputs, ())
    for name in structure.inputs:
        if name not in required:
            variable = definition.variables[name]
            yield Finding(_line(variable), f"input {name} ({variable.name}): no output depends on it")


def _body_findings(model: Model) -> Iterator[Finding]:
    """Yield findings for impossible mass, inertia and reference lengths at the inputs of the first check shot."""
    inputs = _first_inputs(model)
    lengths = model if _has_values(model, AERO_LENGTHS, {}) else None
    inertia = model if _has_values(model, INERTIA_OUTPUTS, inputs) else None
    for _, fault in dave_ml_body_faults(lengths, inertia, inputs):
        yield Finding(f"line {fault.line}", f"{fault.arrived}: expected {fault.expected}")


def _first_inputs(model: Model) -> dict[str, float]:
    """Return the inputs of the first check shot by varID, without inputs in units other than the variable's."""
    shots, variables = model.definition.shots, model.definition.variables
    signals = shots[0].inputs if shots else ()
    return {
        signal.id: signal.value
        for signal in signals
        if signal.id in model.inputs and signal.units == variables[signal.id].units
    }


def _has_values(model: Model, names: tuple[str, ...], inputs: Mapping[str, float]) -> bool:
    structure, constants = model.evaluator.structure, model.evaluator.constants
    variable_names = [quantity.name for quantity in structure.quantities]
    if any(variable_names.count(name) != 1 and name not in structure.by_id for name in names):
        return False
    available = constants.keys() | inputs.keys()
    return not structure.required_variables({structure.find(name) for name in names}, available) & (
        set(structure.inputs) - available
    )


def _slope_findings(model: Model) -> Iterator[Finding]:
    """Yield findings for slopes of lift, side force and damping with the wrong sign near level flight."""
    structure = model.evaluator.structure
    input_ids = {structure.by_id[input_id].name: input_id for input_id in structure.inputs}
    if not _has_values(model, AERO_OUTPUTS, dict.fromkeys(structure.inputs, 0.0)):
        return
    condition = {name: value for name, value in _NEAR_LEVEL.items() if name in input_ids}
    zero_inputs = [
        input_id
        for name, input_id in input_ids.items()
        if name not in condition and input_id not in model.evaluator.constants
    ]

    def coefficients(inputs: dict[str, jax.Array]) -> dict[str, jax.Array]:
        units = {name: model.evaluator.unit(name) for name in inputs}
        file_inputs = {name: (value - units[name].offset) / units[name].factor for name, value in inputs.items()}
        return model.evaluate({**file_inputs, **dict.fromkeys(zero_inputs, 0.0)}, AERO_OUTPUTS)

    slopes = jax.jit(jax.jacfwd(coefficients))({name: jnp.asarray(value) for name, value in condition.items()})
    for output, name, meaning in _SLOPES:
        if name in condition and float(slopes[output][name]) > 0.0:
            variable, slope = model.definition.variables[structure.find(output)], float(slopes[output][name])
            text = f"{output} by {name}: {slope:.4g} per rad or rad/s near level flight: {meaning}"
            yield Finding(_line(variable), text)


def _line(variable: Variable) -> str:
    return f"line {variable.location.line}"
