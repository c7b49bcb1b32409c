"""Order in which the variables of a DAVE-ML file are computed, and the sources of each variable."""

import math
from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from graphlib import CycleError, TopologicalSorter
from typing import Final

import numpy as np

from anser.dave_ml.arithmetic import IN_NUMPY
from anser.dave_ml.definition import Definition, Function, Variable
from anser.dave_ml.elements import quote
from anser.dave_ml.formulas import Formula, variables_in

_CYCLE_SHOWN_MAX: Final = 10
_NAME_SHOWN_MAX: Final = 40
_INPUT_ROLES: Final = frozenset({"isInput", "isControl", "isDisturbance"})


@dataclass(frozen=True)
class Quantity:
    """Variable of a DAVE-ML file in the form that the evaluator needs.

    Attributes
    ----------
    formula
        Calculation; None for inputs, constants and table results.
    sources
        varIDs of the variables in the formula or the table's arguments.
    level
        Number of successive table lookups between the inputs and this variable.
    limits
        Minimum and maximum of the value; None without a limit.
    """

    id: str
    name: str
    units: str
    formula: Formula | None
    sources: tuple[str, ...]
    level: int
    limits: tuple[float | None, float | None]


@dataclass(frozen=True)
class Structure:
    """Computation graph without the numbers of tables and constants: the static part of an evaluator.

    Attributes
    ----------
    quantities
        Sorted by level; within a level, sources precede the variables computed from them.
    inputs, outputs
        varIDs of the inputs (states included) and of the variables marked as output.
    """

    quantities: tuple[Quantity, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _hash(self) -> int:
        return hash((self.quantities, self.inputs, self.outputs))

    @cached_property
    def by_id(self) -> dict[str, Quantity]:
        """Quantities by varID."""
        return {quantity.id: quantity for quantity in self.quantities}

    @cached_property
    def _by_name(self) -> dict[str, list[str]]:
        ids_by_name: dict[str, list[str]] = {}
        for quantity in self.quantities:
            ids_by_name.setdefault(quantity.name, []).append(quantity.id)
        return ids_by_name

    def find(self, key: str) -> str:
        """Return the varID for a varID or a unique name.

        Raises
        ------
        ValueError
            If no variable matches, or several variables have the name.
        """
        if key in self.by_id:
            return key
        matches = self._by_name.get(key, [])
        if len(matches) != 1:
            count = "no variable" if not matches else f"{len(matches)} variables ({', '.join(matches)})"
            raise ValueError(f"{quote(key)} is varID or name of {count}; inputs are {', '.join(self.inputs)}")
        return matches[0]

    def required_variables(self, targets: Collection[str], available: Collection[str]) -> set[str]:
        """Return the varIDs of all variables needed to compute the targets from the available variables.

        The targets are included.
        """
        required: set[str] = set()
        pending = list(targets)
        while pending:
            identifier = pending.pop()
            if identifier not in required:
                required.add(identifier)
                if identifier not in available:
                    pending += self.by_id[identifier].sources
        return required


def make_structure(definition: Definition) -> Structure:
    """Sort the variables of a file so that each follows the variables from which it is computed.

    Raises
    ------
    DaveMlError
        If a source of a variable does not exist, a variable has two sources, or a variable depends on itself.
    """
    functions = _by_result(definition)
    sources: dict[str, tuple[str, ...]] = {}
    for variable in definition.variables.values():
        sources[variable.id] = _sources(variable, functions.get(variable.id), definition)
    try:
        order = list(TopologicalSorter(sources).static_order())
    except CycleError as error:
        # reversed, so that each element is a source of the preceding element
        cycle: list[str] = error.args[1][::-1]
        shortened = [*cycle[:_CYCLE_SHOWN_MAX], "..."] if len(cycle) > _CYCLE_SHOWN_MAX else cycle
        ring = " needs ".join(name[:_NAME_SHOWN_MAX] for name in shortened)
        location = definition.variables[cycle[0]].location
        raise location.fault(f"a cycle of calculations: {ring}", "no variable that depends on itself") from None
    quantities: dict[str, Quantity] = {}
    for identifier in order:
        variable = definition.variables[identifier]
        level = max((quantities[source].level for source in sources[identifier]), default=0)
        quantities[identifier] = Quantity(
            id=identifier,
            name=variable.name,
            units=variable.units,
            formula=variable.formula,
            sources=sources[identifier],
            level=level + (identifier in functions),
            limits=(variable.minimum, variable.maximum),
        )
    variables = definition.variables.values()
    return Structure(
        quantities=tuple(sorted(quantities.values(), key=lambda quantity: quantity.level)),
        inputs=tuple(v.id for v in variables if _is_input(v, v.id in functions)),
        outputs=tuple(v.id for v in variables if "isOutput" in v.roles),
    )


def _by_result(definition: Definition) -> dict[str, Function]:
    functions: dict[str, Function] = {}
    for function in definition.functions:
        if function.result not in definition.variables:
            raise function.location.fault(f"a function of variable {quote(function.result)}", "the varID of a variable")
        if function.result in functions:
            raise function.location.fault(f"a second function of variable {quote(function.result)}", "one")
        functions[function.result] = function
    return functions


def _is_input(variable: Variable, has_function: bool) -> bool:
    """Whether a variable is an input: marked as input or state, or without formula, table and initial value."""
    if has_function or variable.formula is not None:
        return False
    return bool(_INPUT_ROLES & variable.roles) or "isState" in variable.roles or variable.initial is None


def _sources(variable: Variable, function: Function | None, definition: Definition) -> tuple[str, ...]:
    if function is None and variable.formula is None:
        return ()
    if _INPUT_ROLES & variable.roles:
        source = "a calculation" if function is None else f"function {quote(function.name)}"
        raise variable.location.fault(f"input {quote(variable.id)} with {source}", "one source: input, or calculation")
    if function is not None and variable.formula is not None:
        arrived = f"variable {quote(variable.id)} with a calculation and function {quote(function.name)}"
        raise variable.location.fault(arrived, "one source")
    if function is not None:
        source_ids = [argument.id for argument in function.arguments]
        location = function.location
    else:
        source_ids = list(variables_in(variable.formula)) if variable.formula is not None else []
        location = variable.location
    for name in source_ids:
        if name not in definition.variables:
            raise location.fault(
                f"variable {quote(name)} as a source of {quote(variable.id)}", "the varID of a variable"
            )
    return tuple(dict.fromkeys(source_ids))


def clip_to_limits(value: float, limits: tuple[float | None, float | None]) -> float:
    """Clip a number to its limits."""
    minimum, maximum = limits
    value = value if minimum is None else max(value, minimum)
    return value if maximum is None else min(value, maximum)


def compute_constants(definition: Definition, structure: Structure) -> dict[str, float]:
    """Compute the values that do not depend on inputs, by varID.

    Constants, formulas of constants, and defaults of inputs.

    Raises
    ------
    DaveMlError
        If a formula of constants gives NaN or infinity.
    """
    constants: dict[str, float] = {}
    inputs = set(structure.inputs)
    with np.errstate(all="ignore"):
        for quantity in structure.quantities:
            variable = definition.variables[quantity.id]
            if quantity.formula is not None:
                if not set(quantity.sources) <= constants.keys() - inputs:
                    continue
                value = float(IN_NUMPY.value_of(quantity.formula, constants))
                if not math.isfinite(value):
                    arrived = f"{value:g} as the value of {quote(variable.id)}, calculated from constants"
                    raise variable.location.fault(arrived, "a finite number")
            elif variable.initial is not None and not quantity.sources:
                value = variable.initial
            else:
                continue
            constants[quantity.id] = clip_to_limits(value, quantity.limits)
    return constants
