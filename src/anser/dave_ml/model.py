"""DAVE-ML models: reading, evaluation, check shots, and changes of variable names and input defaults."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from anser.dave_ml.definition import Definition, Role, Shot, Signal
from anser.dave_ml.elements import quote
from anser.dave_ml.evaluator import Evaluator, make_evaluator
from anser.dave_ml.reader import parse_definition
from anser.dave_ml.standard_units import parse_unit, refuse_wrong_units
from anser.numerics.arrays import as_array
from anser.shapes import Scalar, ScalarLike

Kind = Literal["output", "internal"]
INTERNAL_TOLERANCE: Final = 1e-9
"""Tolerance of internal values without `<tol>`, relative to max(1, |value|)."""


@dataclass(frozen=True, slots=True)
class CheckResult:
    """Comparison of one value of a check shot with the computed value, in the variable's units."""

    shot: str  #: Name of the check shot.
    id: str  #: varID.
    name: str
    units: str
    kind: Kind  #: Whether the file lists the value as output or as internal value.
    expected: float
    computed: float
    tolerance: float

    @property
    def difference(self) -> float:
        """Computed minus expected value."""
        return self.computed - self.expected

    @property
    def passed(self) -> bool:
        """Whether the absolute difference is within the tolerance; False for NaN."""
        return abs(self.difference) <= self.tolerance


def check_shots(definition: Definition, evaluator: Evaluator) -> list[CheckResult]:
    """Compare every internal value and output of every check shot with the evaluator's value, in the file's order.

    Raises ValueError if a shot sets a variable that is not an input, omits an input without a default, or states a
    value in units that do not convert to the variable's units.
    """
    shots_by_inputs: dict[tuple[str, ...], list[int]] = {}
    for k, shot in enumerate(definition.shots):
        shots_by_inputs.setdefault(tuple(signal.id for signal in shot.inputs), []).append(k)
    computed: dict[int, dict[str, float]] = {}
    for input_ids, shot_indices in shots_by_inputs.items():
        shots = [definition.shots[k] for k in shot_indices]
        output_ids = tuple(dict.fromkeys(s.id for shot in shots for s in (*shot.internal, *shot.outputs)))
        numbers = [[_to_variable_units(definition, s)[0] for s in shot.inputs] for shot in shots]
        input_values = as_array(np.array(numbers, dtype=float).reshape(len(shots), len(input_ids)))
        output_values = _evaluate_rows(evaluator, input_values, input_ids, output_ids)
        columns = {name: np.asarray(column) for name, column in output_values.items()}
        for index, k in enumerate(shot_indices):
            computed[k] = {name: float(column[index]) for name, column in columns.items()}
    return [
        result for k, shot in enumerate(definition.shots) for result in _compare_shot(definition, shot, computed[k])
    ]


@eqx.filter_jit
def _evaluate_rows(
    evaluator: Evaluator,
    input_values: Float[Array, "shot input"],
    input_ids: tuple[str, ...],
    output_ids: tuple[str, ...],
) -> dict[str, Float[Array, " shot"]]:
    def evaluate_shot(shot_inputs: Float[Array, " input"]) -> dict[str, Array]:
        return evaluator.evaluate({name: shot_inputs[k] for k, name in enumerate(input_ids)}, output_ids)

    return jax.vmap(evaluate_shot)(input_values)


def _compare_shot(definition: Definition, shot: Shot, computed: Mapping[str, float]) -> list[CheckResult]:
    results = []
    kinds: tuple[tuple[Kind, tuple[Signal, ...]], ...] = (("internal", shot.internal), ("output", shot.outputs))
    for kind, signals in kinds:
        for signal in signals:
            variable = definition.variables[signal.id]
            expected, factor = _to_variable_units(definition, signal)
            default = INTERNAL_TOLERANCE * max(1.0, abs(expected))
            tolerance = default if signal.tolerance is None else signal.tolerance * factor
            identity = (shot.name, signal.id, variable.name, variable.units, kind)
            results.append(CheckResult(*identity, expected, computed[signal.id], tolerance))
    return results


def _to_variable_units(definition: Definition, signal: Signal) -> tuple[float, float]:
    """Return a signal's value in the units of its variable, and the factor that converts the tolerance."""
    variable = definition.variables[signal.id]
    if signal.units == variable.units:
        return signal.value, 1.0
    try:
        variable_unit, signal_unit = parse_unit(variable.units), parse_unit(signal.units)
    except ValueError as error:
        raise ValueError(f"check shot, variable {signal.id}: {error}") from None
    if variable_unit.dimension != signal_unit.dimension:
        raise ValueError(f"check shot, variable {signal.id}: {signal.units} does not convert to {variable.units}")
    factor = signal_unit.factor / variable_unit.factor
    return signal.value * factor + (signal_unit.offset - variable_unit.offset) / variable_unit.factor, factor


def make_shots(
    definition: Definition,
    evaluator: Evaluator,
    inputs: Mapping[str, Mapping[str, float]],
    tolerance: float,
) -> tuple[Shot, ...]:
    """Compute check shots for a model: values of outputs and of internal variables (neither input nor output).

    Raises ValueError if a variable does not exist, is no input or needs a value, or a shot sets other inputs than the
    first shot.

    Parameters
    ----------
    inputs
        For each shot, by its name: input values by varID or name, in the file's units. Every shot must set the same
        inputs.
    tolerance
        Tolerance of the outputs, relative to max(1, |value|); internal values get no tolerance.
    """
    if not inputs:
        return ()
    structure = evaluator.structure
    inputs_by_id = [{structure.find(name): value for name, value in values.items()} for values in inputs.values()]
    input_ids = tuple(inputs_by_id[0])
    for name, values in zip(inputs, inputs_by_id, strict=True):
        if values.keys() != inputs_by_id[0].keys():
            arrived, expected = ", ".join(values) or "no inputs", ", ".join(input_ids) or "none"
            raise ValueError(f"shot {quote(name)}: arrived {arrived}; expected {expected}, as in the first shot")
    input_values = np.array([[values[identifier] for identifier in input_ids] for values in inputs_by_id])
    internal_ids = [v for v in definition.variables if v not in structure.outputs and v not in structure.inputs]
    columns = _evaluate_rows(evaluator, as_array(input_values), input_ids, (*structure.outputs, *internal_ids))
    computed = {name: np.asarray(column) for name, column in columns.items()}

    def signal(identifier: str, value: float, relative_tolerance: float | None = None) -> Signal:
        limit = None if relative_tolerance is None else relative_tolerance * max(1.0, abs(value))
        return Signal(identifier, value, definition.variables[identifier].units, limit)

    return tuple(
        Shot(
            name=name,
            inputs=tuple(signal(identifier, float(input_values[k, j])) for j, identifier in enumerate(input_ids)),
            outputs=tuple(signal(v, float(computed[v][k]), tolerance) for v in structure.outputs),
            internal=tuple(signal(v, float(computed[v][k])) for v in internal_ids),
        )
        for k, name in enumerate(inputs)
    )


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """DAVE-ML model: content of a file as plain data (`definition`) and its computation as JAX pytree (`evaluator`)."""

    definition: Definition
    evaluator: Evaluator

    @property
    def inputs(self) -> tuple[str, ...]:
        """VarIDs of the inputs of the model, states included, in file order."""
        return self.evaluator.structure.inputs

    @property
    def outputs(self) -> tuple[str, ...]:
        """VarIDs of the variables marked as output, in file order."""
        return self.evaluator.structure.outputs

    def variables_with_role(self, role: Role) -> tuple[str, ...]:
        """Return the varIDs of the variables marked with a role (``isState``, ``isStateDeriv``, ...), in file order."""
        return tuple(v.id for v in self.definition.variables.values() if role in v.roles)

    def evaluate(self, inputs: Mapping[str, ScalarLike], outputs: Sequence[str] | None = None) -> dict[str, Scalar]:
        """Return variables at one time, inputs and results in the file's units; see `Evaluator.evaluate`."""
        return self.evaluator.evaluate(inputs, outputs)

    def evaluate_si(self, inputs: Mapping[str, ScalarLike], outputs: Sequence[str] | None = None) -> dict[str, Scalar]:
        """Return variables at one time in SI units and radians, percent as fractions; see `Evaluator.evaluate_si`."""
        return self.evaluator.evaluate_si(inputs, outputs)

    def check(self) -> list[CheckResult]:
        """Compare the model with the check shots of its file; see `check_shots` for errors."""
        return check_shots(self.definition, self.evaluator)

    def with_shots(self, inputs: Mapping[str, Mapping[str, float]], tolerance: float = 1e-9) -> "Model":
        """Return a copy with check shots computed at `inputs` instead of the shots of the file; see `make_shots`."""
        shots = make_shots(self.definition, self.evaluator, inputs, tolerance)
        return replace(self, definition=replace(self.definition, shots=shots, check_notes=()))


def make_model(definition: Definition) -> Model:
    """Build the model of a definition. Raises DaveMlError if units are wrong or the definition cannot be evaluated."""
    refuse_wrong_units(definition)
    return Model(definition, make_evaluator(definition))


def read_dave_ml(content: str | bytes, name: str) -> Model:
    """Read a model from the content of a DAVE-ML 2 file, a text or bytes in the declared encoding.

    `name` is the file name in messages. Entities are refused, and external references are not fetched. Raises
    DaveMlError if the file is no valid model or exceeds the limits of size, nesting and numbers; the message gives line
    and column.
    """
    return make_model(parse_definition(content, name))


def adapt_model(model: Model, names: Mapping[str, str], defaults: Mapping[str, float]) -> Model:
    """Return a copy of a model with other variable names and with default values for inputs, in the file's units.

    `names` maps each new name to a variable, by varID or name in the file; `defaults` maps inputs to values. Raises
    ValueError in any of these cases:

    - a variable does not exist;
    - a default is given for a variable that the file computes;
    - a new name belongs to another variable;
    - the units do not fit a new name of the standard (DaveMlError).
    """
    if not names and not defaults:
        return model
    structure, variables = model.evaluator.structure, dict(model.definition.variables)
    for variable_name, value in defaults.items():
        identifier = structure.find(variable_name)
        is_source = identifier in structure.inputs or identifier in model.evaluator.constants
        if not is_source or variables[identifier].formula is not None:
            raise ValueError(
                f"{quote(variable_name)} is computed by the file; inputs are {', '.join(structure.inputs)}"
            )
        variables[identifier] = replace(variables[identifier], initial=float(value))
    for name, variable_name in names.items():
        identifier = structure.find(variable_name)
        namesakes = [v.id for v in variables.values() if v.name == name and v.id != identifier]
        if namesakes:
            raise ValueError(f"{quote(name)} is the name of another variable of the file, {quote(namesakes[0])}")
        variables[identifier] = replace(variables[identifier], name=name)
    return make_model(replace(model.definition, variables=variables))
