"""A model against the check shots of its file."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final, Literal

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from anser.dave_ml.definition import Definition, Shot, Signal
from anser.dave_ml.evaluator import Evaluator
from anser.dave_ml.unit_names import unit_of
from anser.numerics import as_array

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
        rows = np.array([[_to_own_units(definition, s)[0] for s in shot.inputs] for shot in shots], dtype=float)
        found = _evaluated(evaluator, as_array(rows.reshape(len(shots), len(given))), given, wanted)
        columns = {name: np.asarray(column) for name, column in found.items()}
        computed |= {k: {name: float(column[row]) for name, column in columns.items()} for row, k in enumerate(places)}
    return [r for k, shot in enumerate(definition.shots) for r in _compared(definition, shot, computed[k])]


@eqx.filter_jit
def _evaluated(
    evaluator: Evaluator, rows: Float[Array, "shot input"], given: tuple[str, ...], wanted: tuple[str, ...]
) -> dict[str, Float[Array, " shot"]]:
    def one(row: Float[Array, " input"]) -> dict[str, Array]:
        return evaluator.evaluate({name: row[k] for k, name in enumerate(given)}, wanted)

    return jax.vmap(one)(rows)


def _compared(definition: Definition, shot: Shot, computed: Mapping[str, float]) -> list[CheckResult]:
    results = []
    kinds: tuple[tuple[Kind, tuple[Signal, ...]], ...] = (("internal", shot.internal), ("output", shot.outputs))
    for kind, signals in kinds:
        for signal in signals:
            variable = definition.variables[signal.id]
            expected, factor = _to_own_units(definition, signal)
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


def _to_own_units(definition: Definition, signal: Signal) -> tuple[float, float]:
    """A signal's value in the units of its variable, and the factor from its own units to these."""
    variable = definition.variables[signal.id]
    if signal.units == variable.units:
        return signal.value, 1.0
    try:
        own, other = unit_of(variable.units), unit_of(signal.units)
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
    found = {name: np.asarray(column) for name, column in _evaluated(evaluator, as_array(rows), given, wanted).items()}
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
