"""In which order the variables of a DAVE-ML file are computed, and from what."""

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
    """A variable, as far as it is computed.

    Attributes
    ----------
    formula
        None where it is given, constant, or the result of a table.
    sources
        The variables that it is computed from.
    level
        How many tables one after the other lie between it and what is given.
    limits
        What its value is limited to; None where it is not.
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
    """What evaluation does, without the numbers of tables and constants.

    Attributes
    ----------
    quantities
        By level; within one, in an order in which each comes after its sources.
    inputs, outputs
        What is given from outside and what the file marks as output.
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
        """The quantities by varID."""
        return {quantity.id: quantity for quantity in self.quantities}

    @cached_property
    def _by_name(self) -> dict[str, list[str]]:
        found: dict[str, list[str]] = {}
        for quantity in self.quantities:
            found.setdefault(quantity.name, []).append(quantity.id)
        return found

    def find(self, key: str) -> str:
        """The varID of a variable that is called by its varID or, where that is none, by its name.

        Raises
        ------
        ValueError
            There is none, or more than one.
        """
        if key in self.by_id:
            return key
        found = self._by_name.get(key, [])
        if len(found) != 1:
            count = "no variable" if not found else f"{len(found)} variables ({', '.join(found)})"
            raise ValueError(f"{quote(key)} is varID or name of {count}; inputs are {', '.join(self.inputs)}")
        return found[0]

    def required_variables(self, wanted: Collection[str], known: Collection[str]) -> set[str]:
        """The variables that have to be computed, the wanted and the known among them where they are needed."""
        needed: set[str] = set()
        left = list(wanted)
        while left:
            identifier = left.pop()
            if identifier not in needed:
                needed.add(identifier)
                if identifier not in known:
                    left += self.by_id[identifier].sources
        return needed


def make_structure(definition: Definition) -> Structure:
    """The order in which a file's variables are computed.

    Raises
    ------
    DaveMlError
        A variable is not there, has two sources, or depends on itself.
    """
    functions = _by_result(definition)
    sources: dict[str, tuple[str, ...]] = {}
    for variable in definition.variables.values():
        sources[variable.id] = _sources(variable, functions.get(variable.id), definition)
    try:
        order = list(TopologicalSorter(sources).static_order())
    except CycleError as error:
        # each of the cycle is a source of the one before, once it is turned round
        cycle: list[str] = error.args[1][::-1]
        shortened = [*cycle[:_CYCLE_SHOWN_MAX], "..."] if len(cycle) > _CYCLE_SHOWN_MAX else cycle
        ring = " needs ".join(name[:_NAME_SHOWN_MAX] for name in shortened)
        place = definition.variables[cycle[0]].location
        raise place.fault(f"a cycle of calculations: {ring}", "no variable that depends on itself") from None
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
    """Whether a variable comes from outside: it is marked so, is a state, or has no source and no value."""
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
        found = [argument.id for argument in function.arguments]
        place = function.location
    else:
        found = list(variables_in(variable.formula)) if variable.formula is not None else []
        place = variable.location
    for name in found:
        if name not in definition.variables:
            raise place.fault(f"variable {quote(name)} as a source of {quote(variable.id)}", "the varID of a variable")
    return tuple(dict.fromkeys(found))


def clip_to_limits(value: float, limits: tuple[float | None, float | None]) -> float:
    """A number within its limits."""
    least, greatest = limits
    value = value if least is None else max(value, least)
    return value if greatest is None else min(value, greatest)


def compute_constants(definition: Definition, structure: Structure) -> dict[str, float]:
    """Values that depend on no input: constants, what is calculated from them, and the usual values of inputs.

    Raises
    ------
    DaveMlError
        A calculation of constants gives no finite number.
    """
    known: dict[str, float] = {}
    given = set(structure.inputs)
    with np.errstate(all="ignore"):
        for quantity in structure.quantities:
            variable = definition.variables[quantity.id]
            if quantity.formula is not None:
                if not set(quantity.sources) <= known.keys() - given:
                    continue
                value = float(IN_NUMPY.value_of(quantity.formula, known))
                if not math.isfinite(value):
                    arrived = f"{value:g} as the value of {quote(variable.id)}, calculated from constants"
                    raise variable.location.fault(arrived, "a finite number")
            elif variable.initial is not None and not quantity.sources:
                value = variable.initial
            else:
                continue
            known[quantity.id] = clip_to_limits(value, quantity.limits)
    return known
