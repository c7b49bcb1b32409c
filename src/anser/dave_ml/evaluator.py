"""Evaluator: the computation of a DAVE-ML model in JAX at one time; `jax.vmap` gives several times or aircraft."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from graphlib import CycleError, TopologicalSorter
from typing import Any, Final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from anser.dave_ml.definition import Breakpoints, Definition, Function, GriddedTable, Variable
from anser.dave_ml.elements import quote
from anser.dave_ml.formulas import IN_JAX, IN_NUMPY, Formula, variables_in
from anser.dave_ml.standard_units import Unit, parse_unit
from anser.dave_ml.tables import (
    Lookup,
    ScatteredTable,
    make_lookups,
    make_meshes,
    make_scattered,
    refuse_duplicate_points,
    refuse_too_large,
)
from anser.numerics.arrays import as_array, namespace
from anser.shapes import Scalar, ScalarLike

_CYCLE_SHOWN_MAX: Final = 10
_NAME_SHOWN_MAX: Final = 40
_INPUT_ROLES: Final = frozenset({"isInput", "isControl", "isDisturbance"})


@dataclass(frozen=True)
class Quantity:
    """Variable of a DAVE-ML file in the form that the evaluator needs."""

    id: str
    name: str
    units: str
    formula: Formula | None  #: None for inputs, constants and table results.
    sources: tuple[str, ...]  #: varIDs of the variables in the formula, or of the table's arguments.
    level: int  #: Number of successive table lookups from the inputs to the variable.
    limits: tuple[float | None, float | None]  #: Minimum and maximum in the file's units; None: no limit.


@dataclass(frozen=True)
class Structure:
    """Computation graph of a model without the numbers of tables and constants: the static part of an evaluator."""

    #: Sorted by level; within a level, sources precede the variables computed from them.
    quantities: tuple[Quantity, ...]
    inputs: tuple[str, ...]  #: varIDs of inputs and states, in file order.
    outputs: tuple[str, ...]  #: varIDs in file order.

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _hash(self) -> int:
        return hash((self.quantities, self.inputs, self.outputs))

    @cached_property
    def by_id(self) -> dict[str, Quantity]:
        """Quantities by varID."""
        return {quantity.id: quantity for quantity in self.quantities}

    def find(self, key: str) -> str:
        """Return the varID of the variable with varID or name `key`. Raises ValueError for no or several matches."""
        if key in self.by_id:
            return key
        matches = [quantity.id for quantity in self.quantities if quantity.name == key]
        if len(matches) != 1:
            count = "no variable" if not matches else f"{len(matches)} variables ({', '.join(matches)})"
            raise ValueError(f"{quote(key)} is varID or name of {count}; inputs are {', '.join(self.inputs)}")
        return matches[0]

    def required_variables(self, targets: Collection[str], available: Collection[str]) -> set[str]:
        """Return the varIDs of all variables needed to compute the `targets`, the targets included.

        All arguments are varIDs. Variables in `available` have known values and need no further variables.
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
    """Return the computation graph of a file.

    Raises DaveMlError if a formula or function uses a variable that does not exist, or if a variable is defined twice
    (input, formula, function) or depends on itself.
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
    """True if a variable has no formula and no table, and is marked as input or state or lacks an initial value."""
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
    location = variable.location if function is None else function.location
    if function is not None:
        source_ids = [argument.id for argument in function.arguments]
    else:
        source_ids = list(variables_in(variable.formula)) if variable.formula is not None else []
    for name in source_ids:
        if name not in definition.variables:
            arrived = f"variable {quote(name)} as a source of {quote(variable.id)}"
            raise location.fault(arrived, "the varID of a variable")
    return tuple(dict.fromkeys(source_ids))


def compute_constants(definition: Definition, structure: Structure) -> dict[str, float]:
    """Return constants, defaults of inputs, and values of formulas that contain only constants; by varID.

    The values are in the file's units and within the limits of the variables. Raises DaveMlError if a formula of
    constants gives NaN or infinity.
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
            constants[quantity.id] = float(_clip(value, quantity.limits, np))
    return constants


class Evaluator(eqx.Module):
    """The computation of a DAVE-ML file as a JAX pytree.

    A change of constants or table values, the leaves of the pytree, does not recompile. Numbers in formulas and the
    limits of variables are static.
    """

    constants: dict[str, Scalar]  #: By varID: constants, values calculated from constants, and defaults of inputs.
    #: One tuple of tables per stage of the computation; a stage needs inputs, formulas and earlier stages only.
    tables: tuple[tuple[Lookup | ScatteredTable, ...], ...]
    structure: Structure = eqx.field(static=True)

    def evaluate(self, inputs: Mapping[str, ScalarLike], outputs: Sequence[str] | None = None) -> dict[str, Scalar]:
        """Compute variables at one time, in the file's units, and return the values by the names in `outputs`.

        Parameters
        ----------
        inputs
            Scalars by varID or name. An input may be omitted if the file gives a default or no requested variable
            depends on the input.
        outputs
            Variables to compute, by varID or name; None: the variables marked as output.

        Raises
        ------
        ValueError
            A variable does not exist, a variable in `inputs` is not an input, a required input is missing, or an input
            is not a scalar.
        """
        output_names = self.structure.outputs if outputs is None else tuple(outputs)
        output_ids = {name: self.structure.find(name) for name in output_names}
        values: dict[str, Array] = dict(self.constants)
        for name, value in inputs.items():
            identifier = self._input(name, value)
            values[identifier] = _clip(_number(value), self.structure.by_id[identifier].limits)
        required = self.structure.required_variables(set(output_ids.values()), values.keys())
        self._refuse_missing(required - values.keys())
        stage = 0
        for quantity in self.structure.quantities:
            if quantity.id not in required or quantity.id in values:
                continue
            while stage < quantity.level:
                values |= self._looked_up(stage, values, required)
                stage += 1
            if quantity.formula is not None:
                formula_value = IN_JAX.value_of(quantity.formula, values)
                values[quantity.id] = _clip(_number(formula_value), quantity.limits)
        return {name: values[identifier] for name, identifier in output_ids.items()}

    def evaluate_si(self, inputs: Mapping[str, ScalarLike], outputs: Sequence[str] | None = None) -> dict[str, Scalar]:
        """Compute variables as in `evaluate`, with inputs and results in SI units and radians; percent as fractions.

        Raises ValueError also if a unit is unknown.
        """
        output_names = self.structure.outputs if outputs is None else tuple(outputs)
        units = {name: self.unit(name) for name in (*inputs, *output_names)}
        file_inputs = {name: (value - units[name].offset) / units[name].factor for name, value in inputs.items()}
        file_outputs = self.evaluate(file_inputs, output_names)
        return {name: value * units[name].factor + units[name].offset for name, value in file_outputs.items()}

    def unit(self, name: str) -> Unit:
        """Return the unit of a variable by varID or name. Raises ValueError if variable or unit is unknown."""
        quantity = self.structure.by_id[self.structure.find(name)]
        try:
            return parse_unit(quantity.units)
        except ValueError as error:
            raise ValueError(f"variable {quantity.id} ({quantity.name}): {error}") from None

    def with_constants(self, changes: Mapping[str, ScalarLike]) -> "Evaluator":
        """Return a copy with changed constants or defaults, in the file's units, by varID or name.

        Values that the file calculates from the changed constants are updated. A calculated value may be changed too,
        and keeps the change until the constants in its formula change. Raises ValueError if a variable is no constant.
        """
        changed = {self.structure.find(name): value for name, value in changes.items()}
        for identifier in changed:
            if identifier not in self.constants:
                raise ValueError(f"{quote(identifier)} is no constant of the file")
        values: dict[str, Any] = {**self.constants, **changed}
        arithmetic, xp = IN_JAX, jnp
        if namespace(values) is np:  # nothing to compile
            values = {name: float(value) for name, value in values.items()}
            arithmetic, xp = IN_NUMPY, np
        affected = set(changed)
        for quantity in self.structure.quantities:
            if quantity.id in changed:
                values[quantity.id] = _clip(values[quantity.id], quantity.limits, xp)
            elif quantity.formula is not None and quantity.id in values and affected.intersection(quantity.sources):
                values[quantity.id] = _clip(arithmetic.value_of(quantity.formula, values), quantity.limits, xp)
                affected.add(quantity.id)
        return eqx.tree_at(lambda e: e.constants, self, {name: as_array(value) for name, value in values.items()})

    def _input(self, name: str, value: ScalarLike) -> str:
        identifier = self.structure.find(name)
        if identifier not in self.structure.inputs:
            raise ValueError(f"{quote(name)} is no input; inputs are {', '.join(self.structure.inputs)}")
        if np.ndim(value) != 0:
            raise ValueError(f"{quote(name)} of shape {np.shape(value)}: give one instant's, and vmap over many")
        return identifier

    def _refuse_missing(self, unknown: set[str]) -> None:
        missing = [name for name in self.structure.inputs if name in unknown]
        if missing:
            descriptions = (
                f"{name} ({self.structure.by_id[name].name}, {self.structure.by_id[name].units})" for name in missing
            )
            raise ValueError(f"inputs are missing: {', '.join(descriptions)}")

    def _looked_up(self, stage: int, values: Mapping[str, Array], required: set[str]) -> dict[str, Array]:
        results: dict[str, Array] = {}
        for table in self.tables[stage]:
            table_results = required.intersection(table.result_names) - values.keys()
            if table_results:
                results |= table(values, table_results)
        return {name: _clip(value, self.structure.by_id[name].limits) for name, value in results.items()}


def _number(value: ScalarLike) -> Array:
    """Convert a number to a floating-point array; the precision of a floating-point number does not change."""
    array = jnp.asarray(value)
    return array if jnp.issubdtype(array.dtype, jnp.floating) else array.astype(float)


def _clip(value: Any, limits: tuple[float | None, float | None], xp: Any = jnp) -> Any:
    """Return a value clipped to (minimum, maximum); None: no limit."""
    minimum, maximum = limits
    value = value if minimum is None else xp.maximum(value, minimum)
    return value if maximum is None else xp.minimum(value, maximum)


def make_evaluator(definition: Definition) -> Evaluator:
    """Build the evaluator of the definition of a DAVE-ML file.

    Raises DaveMlError for the faults that `make_structure` and `compute_constants` refuse, or if a table cannot be
    interpolated.
    """
    with jax.ensure_compile_time_eval():  # concrete numbers, even if a traced function reads a file
        return _compile_definition(_sorted_lines(definition))


def _compile_definition(definition: Definition) -> Evaluator:
    structure = make_structure(definition)
    stages: dict[int, list[Function]] = {}
    for function in definition.functions:
        stages.setdefault(structure.by_id[function.result].level - 1, []).append(function)
    refuse_too_large(definition, [f for f in definition.functions if f.table in definition.gridded])
    used = {f.table for f in definition.functions} - definition.gridded.keys()
    meshes = make_meshes(definition.ungridded[name] for name in definition.ungridded if name in used)
    tables = []
    for stage in range(max(stages, default=-1) + 1):
        functions = stages.get(stage, [])
        gridded = [function for function in functions if function.table in definition.gridded]
        scattered = [function for function in functions if function.table not in definition.gridded]
        tables.append(
            (*make_lookups(definition, gridded), *(make_scattered(definition, f, meshes[f.table]) for f in scattered))
        )
    constants = compute_constants(definition, structure)
    return Evaluator({name: as_array(value) for name, value in constants.items()}, tuple(tables), structure)


def _sorted_lines(definition: Definition) -> Definition:
    """Return a copy of a definition to which each ungridded table of one coordinate is added as a gridded table.

    The gridded table has the utID as identifier. Raises DaveMlError if two points have the same coordinate.
    """
    breakpoints, gridded = dict(definition.breakpoints), dict(definition.gridded)
    for table in definition.ungridded.values():
        if table.points.shape[1] == 1:
            refuse_duplicate_points(table)
            order = np.argsort(table.points[:, 0])
            axis = f"{table.id} along its points"  # unique: XML identifiers contain no blanks
            breakpoints[axis] = Breakpoints(axis, table.points[order, 0])
            gridded[table.id] = GriddedTable(table.id, (axis,), table.values[order])
    return replace(definition, breakpoints=breakpoints, gridded=gridded)
