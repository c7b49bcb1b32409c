"""A DAVE-ML file by itself: its check data computed, and what in it is probably not meant so."""

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import jax
import jax.numpy as jnp

from anser.aircraft import AERO_LENGTHS, AERO_OUTPUTS, INERTIA_OUTPUTS, body_faults_of
from anser.dave_ml import DaveMlError, Model, Variable, read_dave_ml, unit_of
from anser.input_files import read_file
from anser.scenario.airframe_file.checking import Compared, compare_shots
from anser.scenario.airframe_file.linting import Finding
from anser.scenario.airframe_file.linting_models import suspect_table_points
from anser.scenario.errors import reason_of, refused

_NEAR_LEVEL = {
    "trueAirspeed": 100.0, "mach": 0.3, "altitudeMSL": 0.0, "airDensity": 1.225, "dynamicPressure": 6125.0,
    "angleOfAttack": 0.035, "angleOfSideslip": 0.0,
    "bodyAngularRate_Roll": 0.0, "bodyAngularRate_Pitch": 0.0, "bodyAngularRate_Yaw": 0.0,
}  # fmt: skip
"""Where slopes are taken, SI units and rad; all other inputs have their usual value, or 0."""
_SLOPES = (
    ("aeroBodyForceCoefficient_Z", "angleOfAttack", "the lift falls with the angle of attack"),
    ("aeroBodyForceCoefficient_Y", "angleOfSideslip", "the side force points to where the air comes from"),
    ("aeroBodyMomentCoefficient_Roll", "bodyAngularRate_Roll", "the roll rate drives itself on; damping is negative"),
    ("aeroBodyMomentCoefficient_Pitch", "bodyAngularRate_Pitch", "the pitch rate drives itself on"),
    ("aeroBodyMomentCoefficient_Yaw", "bodyAngularRate_Yaw", "the yaw rate drives itself on; damping is negative"),
)
"""Coefficient and input of slopes that are negative in every usual aircraft, and what a positive one means."""


@dataclass(frozen=True)
class ModelCheck:
    """What a DAVE-ML file says of itself.

    Attributes
    ----------
    compared
        Values of its check shots.
    findings
        What looks wrong, each with its line.
    inputs, outputs
        Variables that it is computed from, and those that it marks as output.
    """

    compared: tuple[Compared, ...]
    findings: tuple[Finding, ...]
    inputs: tuple[Variable, ...]
    outputs: tuple[Variable, ...]


def check_model(path: str | os.PathLike[str]) -> ModelCheck:
    """Read a DAVE-ML file, compute its check data and look for what is probably wrong in it.

    Raises
    ------
    ScenarioError
        If the file cannot be read or is no DAVE-ML file; the message says where and what would be right.
    """
    source = os.fspath(path)
    try:
        model = read_dave_ml(read_file(Path(path)), Path(path).name)
    except DaveMlError as error:
        where = "" if error.line is None else f"line {error.line}, column {error.column}"
        raise refused(source, error.arrived, error.expected, where) from None
    except (OSError, ValueError) as error:
        arrived = f"a path that cannot be read ({reason_of(error)})"
        raise refused(source, arrived, "a DAVE-ML file that can be read") from None
    variables = model.definition.variables
    return ModelCheck(
        compared=tuple(compare_shots(model, source)),
        findings=(
            *_unit_findings(model),
            *_use_findings(model),
            *_body_findings(model),
            *_slope_findings(model),
            *(Finding(f"table {name}", text) for name, text in suspect_table_points(model, {})),
        ),
        inputs=tuple(variables[name] for name in model.inputs),
        outputs=tuple(variables[name] for name in model.outputs),
    )


def _unit_findings(model: Model) -> Iterator[Finding]:
    """Find unknown units, each once with all its variables."""
    unknown: dict[str, list[Variable]] = {}
    for variable in model.definition.variables.values():
        try:
            unit_of(variable.units)
        except ValueError:
            unknown.setdefault(variable.units, []).append(variable)
    for units, variables in unknown.items():
        names = ", ".join(variable.id for variable in variables)
        text = f'units "{units}" of {names}: no unit of ANSI/AIAA S-119, nor one that converts to SI'
        yield Finding(_line(variables[0]), text)


def _use_findings(model: Model) -> Iterator[Finding]:
    """Find tables that no function uses, inputs that no output depends on, and a file without outputs."""
    definition, structure = model.definition, model.evaluator.structure
    used = {function.table for function in definition.functions}
    for name, table in {**definition.gridded, **definition.ungridded}.items():
        if name not in used:
            yield Finding(f"line {table.place.line}", f"table {name}: no function uses it")
    if not structure.outputs:
        yield Finding("variableDef", "no variable is marked <isOutput/>: a check without outputs compares nothing")
        return
    needed = structure.needed_for(structure.outputs, ())
    for name in structure.inputs:
        if name not in needed:
            variable = definition.variables[name]
            yield Finding(_line(variable), f"input {name} ({variable.name}): no output depends on it")


def _body_findings(model: Model) -> Iterator[Finding]:
    """Find mass, inertia and reference lengths that no body has, as far as they depend on no unknown input."""
    given = _first_inputs(model)
    lengths = model if _has_values(model, AERO_LENGTHS, {}) else None
    inertia = model if _has_values(model, INERTIA_OUTPUTS, given) else None
    for _, fault in body_faults_of(lengths, inertia, given):
        yield Finding(f"line {fault.line}", f"{fault.arrived}: expected {fault.expected}")


def _first_inputs(model: Model) -> dict[str, float]:
    """Inputs of the first check shot, as far as it gives them in the units of the file."""
    shots, variables = model.definition.shots, model.definition.variables
    signals = shots[0].inputs if shots else ()
    return {one.id: one.value for one in signals if one.id in model.inputs and one.units == variables[one.id].units}


def _has_values(model: Model, names: tuple[str, ...], given: Mapping[str, float]) -> bool:
    structure, constants = model.evaluator.structure, model.evaluator.constants
    own = [quantity.name for quantity in structure.quantities]
    if any(own.count(name) != 1 and name not in structure.by_id for name in names):
        return False
    known = constants.keys() | given.keys()
    return not structure.needed_for({structure.find(name) for name in names}, known) & (set(structure.inputs) - known)


def _slope_findings(model: Model) -> Iterator[Finding]:
    """Find a lift that falls with the angle of attack, and damping that excites."""
    structure = model.evaluator.structure
    named = {structure.by_id[one].name: one for one in structure.inputs}
    if not _has_values(model, AERO_OUTPUTS, dict.fromkeys(structure.inputs, 0.0)):
        return
    given = {name: value for name, value in _NEAR_LEVEL.items() if name in named}
    rest = [one for name, one in named.items() if name not in given and one not in model.evaluator.constants]

    def coefficients(inputs: dict[str, jax.Array]) -> dict[str, jax.Array]:
        units = {name: model.evaluator.unit(name) for name in inputs}
        own = {name: (value - units[name].offset) / units[name].factor for name, value in inputs.items()}
        return model.evaluate({**own, **dict.fromkeys(rest, 0.0)}, AERO_OUTPUTS)

    slopes = jax.jit(jax.jacfwd(coefficients))({name: jnp.asarray(value) for name, value in given.items()})
    for output, name, words in _SLOPES:
        if name in given and float(slopes[output][name]) > 0.0:
            variable = model.definition.variables[structure.find(output)]
            text = f"{output} by {name}: {float(slopes[output][name]):.4g} per rad or rad/s near level flight: {words}"
            yield Finding(_line(variable), text)


def _line(variable: Variable) -> str:
    return f"line {variable.place.line}"
