"""Evaluator: a DAVE-ML model compiled to JAX, for one time and one aircraft; use `vmap` for more."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from anser.dave_ml.arithmetic import IN_JAX, IN_NUMPY
from anser.dave_ml.definition import Breakpoints, Definition, Function, GriddedTable
from anser.dave_ml.elements import quote
from anser.dave_ml.standard_units import Unit, parse_unit
from anser.dave_ml.structure import Structure, clip_to_limits, compute_constants, make_structure
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


class Evaluator(eqx.Module):
    """The computation of a DAVE-ML file as a JAX pytree.

    Constants and table values are leaves of the pytree, so changing them does not recompile. Numbers in formulas and
    the limits of variables belong to the static structure.

    Attributes
    ----------
    constants
        By varID: constants, values calculated from constants (updated by `with_constants`) and defaults of inputs.
    tables
        Tables by stage; the arguments of a stage's tables come from earlier stages.
    structure
        Order of computation.
    """

    constants: dict[str, Scalar]
    tables: tuple[tuple[Lookup | ScatteredTable, ...], ...]
    structure: Structure = eqx.field(static=True)

    def evaluate(self, inputs: Mapping[str, ScalarLike], outputs: Sequence[str] | None = None) -> dict[str, Scalar]:
        """Compute variables at one time, in the file's units.

        Parameters
        ----------
        inputs
            Scalars by varID or name. An input may be omitted if the file gives a default or no requested variable
            depends on the input.
        outputs
            Variables to compute, by varID or name; default: the variables marked as output. Unrelated variables are not
            computed.

        Returns
        -------
        Values by the names in `outputs`.

        Raises
        ------
        ValueError
            If a variable does not exist, a variable in `inputs` is not an input, an input is missing or is not a
            scalar.
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
        """Compute variables at one time, in SI units and radians; percent as fractions.

        Parameters and result as for `evaluate`, except for the units.

        Raises
        ------
        ValueError
            As `evaluate`, and if a unit is unknown.
        """
        output_names = self.structure.outputs if outputs is None else tuple(outputs)
        units = {name: self.unit(name) for name in (*inputs, *output_names)}
        file_inputs = {name: (value - units[name].offset) / units[name].factor for name, value in inputs.items()}
        file_outputs = self.evaluate(file_inputs, output_names)
        return {name: value * units[name].factor + units[name].offset for name, value in file_outputs.items()}

    def unit(self, name: str) -> Unit:
        """Return the unit of a variable, by varID or name.

        Raises
        ------
        ValueError
            If the variable does not exist or the unit is unknown.
        """
        quantity = self.structure.by_id[self.structure.find(name)]
        try:
            return parse_unit(quantity.units)
        except ValueError as error:
            raise ValueError(f"variable {quantity.id} ({quantity.name}): {error}") from None

    def with_constants(self, changes: Mapping[str, ScalarLike]) -> "Evaluator":
        """Return a copy with other constants, in the file's units; values calculated from the constants are updated.

        A value that the file calculates from constants may be set too, and then replaces the calculation.

        Raises
        ------
        ValueError
            If a variable is not a constant.
        """
        changed = {self.structure.find(name): value for name, value in changes.items()}
        for identifier in changed:
            if identifier not in self.constants:
                raise ValueError(f"{quote(identifier)} is no constant of the file")
        values: dict[str, Any] = {**self.constants, **changed}
        arithmetic, limit = IN_JAX, _clip
        if namespace(values) is np:  # nothing to compile
            values = {name: float(value) for name, value in values.items()}
            arithmetic, limit = IN_NUMPY, clip_to_limits
        for quantity in self.structure.quantities:
            if quantity.id in changed:
                values[quantity.id] = limit(values[quantity.id], quantity.limits)
            elif quantity.formula is not None and quantity.id in values:
                values[quantity.id] = limit(arithmetic.value_of(quantity.formula, values), quantity.limits)
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
    """Convert a number to a floating-point array; an existing floating-point precision is preserved."""
    array = jnp.asarray(value)
    return array if jnp.issubdtype(array.dtype, jnp.floating) else array.astype(float)


def _clip(value: Array, limits: tuple[float | None, float | None]) -> Array:
    minimum, maximum = limits
    value = value if minimum is None else jnp.maximum(value, minimum)
    return value if maximum is None else jnp.minimum(value, maximum)


def make_evaluator(definition: Definition) -> Evaluator:
    """Compile the definition of a DAVE-ML file to an evaluator.

    Raises
    ------
    DaveMlError
        If a source of a variable does not exist, a variable has two sources or depends on itself, a formula of
        constants gives NaN or infinity, or a table cannot be interpolated.
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
    """Return a copy of a definition in which ungridded tables of one coordinate are gridded tables, sorted."""
    breakpoints, gridded = dict(definition.breakpoints), dict(definition.gridded)
    for table in definition.ungridded.values():
        if table.points.shape[1] == 1:
            refuse_duplicate_points(table)
            order = np.argsort(table.points[:, 0])
            axis = f"{table.id} along its points"  # unique: XML identifiers contain no blanks
            breakpoints[axis] = Breakpoints(axis, table.points[order, 0])
            gridded[table.id] = GriddedTable(table.id, (axis,), table.values[order])
    return replace(definition, breakpoints=breakpoints, gridded=gridded)
