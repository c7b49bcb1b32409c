"""A DAVE-ML model: its definition with its evaluator.

Comparison with the check shots of the file, and renamed or preset inputs.
"""

from collections.abc import Iterable, Mapping, Sequence
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
"""Tolerance of an internal value that comes with none, as files leave it: of its size, at least 1."""


@dataclass(frozen=True, slots=True)
class CheckResult:
    """A signal of a check shot, as the file gives it and as it is computed.

    Attributes
    ----------
    shot
        Name of the shot.
    id, name, units
        The variable, and the units of the numbers.
    kind
        Whether the file gives it as an output or as an internal value.
    expected, computed, tolerance
        In these units.
    """

    shot: str
    id: str
    name: str
    units: str
    kind: Kind
    expected: float
    computed: float
    tolerance: float

    @property
    def difference(self) -> float:
        """Computed less expected."""
        return self.computed - self.expected

    @property
    def passed(self) -> bool:
        """Whether it is within the tolerance; not, where it is no number."""
        return abs(self.difference) <= self.tolerance


def check_shots(definition: Definition, evaluator: Evaluator) -> list[CheckResult]:
    """Every internal value and output of every check shot, in the file's order.

    Raises
    ------
    ValueError
        A shot gives a value for what is no input, leaves out an input that has no usual value, or states a value in
        units that do not convert to the variable's.
    """
    alike: dict[tuple[str, ...], list[int]] = {}
    for k, shot in enumerate(definition.shots):
        alike.setdefault(tuple(signal.id for signal in shot.inputs), []).append(k)
    computed: dict[int, dict[str, float]] = {}
    for given, places in alike.items():
        shots = [definition.shots[k] for k in places]
        wanted = tuple(dict.fromkeys(s.id for shot in shots for s in (*shot.internal, *shot.outputs)))
        rows = np.array([[_to_variable_units(definition, s)[0] for s in shot.inputs] for shot in shots], dtype=float)
        found = _evaluate_rows(evaluator, as_array(rows.reshape(len(shots), len(given))), given, wanted)
        columns = {name: np.asarray(column) for name, column in found.items()}
        computed |= {k: {name: float(column[row]) for name, column in columns.items()} for row, k in enumerate(places)}
    return [r for k, shot in enumerate(definition.shots) for r in _compare_shot(definition, shot, computed[k])]


@eqx.filter_jit
def _evaluate_rows(
    evaluator: Evaluator, rows: Float[Array, "shot input"], given: tuple[str, ...], wanted: tuple[str, ...]
) -> dict[str, Float[Array, " shot"]]:
    def one(row: Float[Array, " input"]) -> dict[str, Array]:
        return evaluator.evaluate({name: row[k] for k, name in enumerate(given)}, wanted)

    return jax.vmap(one)(rows)


def _compare_shot(definition: Definition, shot: Shot, computed: Mapping[str, float]) -> list[CheckResult]:
    results = []
    kinds: tuple[tuple[Kind, tuple[Signal, ...]], ...] = (("internal", shot.internal), ("output", shot.outputs))
    for kind, signals in kinds:
        for signal in signals:
            variable = definition.variables[signal.id]
            expected, factor = _to_variable_units(definition, signal)
            usual = INTERNAL_TOLERANCE * max(1.0, abs(expected))
            tolerance = usual if signal.tolerance is None else signal.tolerance * factor
            results.append(
                CheckResult(
                    shot=shot.name,
                    id=signal.id,
                    name=variable.name,
                    units=variable.units,
                    kind=kind,
                    expected=expected,
                    computed=computed[signal.id],
                    tolerance=tolerance,
                )
            )
    return results


def _to_variable_units(definition: Definition, signal: Signal) -> tuple[float, float]:
    """A signal's value in the units of its variable, and the factor from its own units to these."""
    variable = definition.variables[signal.id]
    if signal.units == variable.units:
        return signal.value, 1.0
    try:
        own, other = parse_unit(variable.units), parse_unit(signal.units)
    except ValueError as error:
        raise ValueError(f"check shot, variable {signal.id}: {error}") from None
    if own.dimension != other.dimension:
        raise ValueError(f"check shot, variable {signal.id}: {signal.units} does not convert to {variable.units}")
    factor = other.factor / own.factor
    return signal.value * factor + (other.offset - own.offset) / own.factor, factor


def make_shots(
    definition: Definition,
    evaluator: Evaluator,
    inputs: Mapping[str, Mapping[str, float]],
    tolerance: float,
    *,
    internal: bool = True,
) -> tuple[Shot, ...]:
    """Check shots of a model of one's own, computed from it.

    Parameters
    ----------
    inputs
        By the name of each shot: values of inputs by varID or name, in the units of the file; the same inputs in all.
    tolerance
        Of every output, relative to its size, at least 1.
    internal
        Whether to give the values of all other variables too.
    """
    structure = evaluator.structure
    given = tuple(dict.fromkeys(structure.find(name) for values in inputs.values() for name in values))
    rows = np.array(
        [[{structure.find(k): v for k, v in one.items()}[name] for name in given] for one in inputs.values()]
    )
    others = [v for v in definition.variables if v not in structure.outputs and v not in structure.inputs]
    wanted = (*structure.outputs, *(others if internal else ()))
    found = {
        name: np.asarray(column) for name, column in _evaluate_rows(evaluator, as_array(rows), given, wanted).items()
    }
    units = {name: variable.units for name, variable in definition.variables.items()}

    def signals(names: Iterable[str], k: int, limit: float | None) -> tuple[Signal, ...]:
        values = {name: float(found[name][k]) for name in names}
        limits = {name: None if limit is None else limit * max(1.0, abs(value)) for name, value in values.items()}
        return tuple(Signal(name, value, units[name], limits[name]) for name, value in values.items())

    return tuple(
        Shot(
            name=name,
            inputs=tuple(Signal(one, float(rows[k, j]), units[one]) for j, one in enumerate(given)),
            outputs=signals(structure.outputs, k, tolerance),
            internal=signals(others, k, None) if internal else (),
        )
        for k, name in enumerate(inputs)
    )


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """A DAVE-ML model.

    Attributes
    ----------
    definition
        What the file says, as plain data.
    evaluator
        The part that is compiled: a pytree to put into modules, jit, vmap and differentiate.
    """

    definition: Definition
    evaluator: Evaluator

    @property
    def inputs(self) -> tuple[str, ...]:
        """The varIDs of what is given from outside, states among them."""
        return self.evaluator.structure.inputs

    @property
    def outputs(self) -> tuple[str, ...]:
        """The varIDs of what the file marks as output."""
        return self.evaluator.structure.outputs

    def variables_with_role(self, role: Role) -> tuple[str, ...]:
        """The varIDs of the variables that the file marks with a role, such as ``isState`` or ``isStateDeriv``."""
        return tuple(v.id for v in self.definition.variables.values() if role in v.roles)

    def evaluate(self, inputs: Mapping[str, ScalarLike], outputs: Sequence[str] | None = None) -> dict[str, Scalar]:
        """See `Evaluator.evaluate`."""
        return self.evaluator.evaluate(inputs, outputs)

    def evaluate_si(self, inputs: Mapping[str, ScalarLike], outputs: Sequence[str] | None = None) -> dict[str, Scalar]:
        """See `Evaluator.evaluate_si`."""
        return self.evaluator.evaluate_si(inputs, outputs)

    def check(self) -> list[CheckResult]:
        """Every internal value and output of every check shot of the file.

        Raises
        ------
        ValueError
            See `check_shots`.
        """
        return check_shots(self.definition, self.evaluator)

    def with_shots(self, inputs: Mapping[str, Mapping[str, float]], tolerance: float = 1e-9) -> "Model":
        """The same model with check shots at the given inputs, computed from it; see `make_shots`."""
        shots = make_shots(self.definition, self.evaluator, inputs, tolerance)
        return replace(self, definition=replace(self.definition, shots=shots))


def make_model(definition: Definition) -> Model:
    """The model of a definition.

    Raises
    ------
    DaveMlError
        See `make_evaluator` and `refuse_wrong_units`.
    """
    refuse_wrong_units(definition)
    return Model(definition, make_evaluator(definition))


def read_dave_ml(content: str | bytes, name: str) -> Model:
    """Read a DAVE-ML 2 file.

    Nothing in it is executed, fetched or expanded; size, depth and numbers are bounded.

    Parameters
    ----------
    content
        The file's text, or its bytes in the encoding that it declares.
    name
        What errors call it.

    Raises
    ------
    DaveMlError
        The one error that a file can cause: where, what arrived, and what would be right.
    """
    return make_model(parse_definition(content, name))


def adapt_model(model: Model, names: Mapping[str, str], given: Mapping[str, float]) -> Model:
    """The same model with other names of some variables and usual values of some inputs.

    Parameters
    ----------
    names
        New name -> varID or name in the file.
    given
        Usual values by varID or name in the file, in its units.

    Raises
    ------
    ValueError
        There is no such variable, or another one has the new name; or (DaveMlError) its units are none of that name.
    """
    if not names and not given:
        return model
    structure, variables = model.evaluator.structure, dict(model.definition.variables)
    for own, value in given.items():
        identifier = structure.find(own)
        known = identifier in structure.inputs or identifier in model.evaluator.constants
        if not known or variables[identifier].formula is not None:
            raise ValueError(f"{quote(own)} is computed by the file; inputs are {', '.join(structure.inputs)}")
        variables[identifier] = replace(variables[identifier], initial=float(value))
    for name, own in names.items():
        identifier = structure.find(own)
        other = next((one.id for one in variables.values() if one.name == name and one.id != identifier), None)
        if other is not None:
            raise ValueError(f"{quote(name)} is the name of another variable of the file, {quote(other)}")
        variables[identifier] = replace(variables[identifier], name=name)
    return make_model(replace(model.definition, variables=variables))
