"""A DAVE-ML model compiled to JAX: one instant of one aircraft, to be mapped over many."""

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
    """What a DAVE-ML file computes.

    Numbers that one may vary without compiling anew are leaves: constants and the values of tables. What formulas hold
    as numbers, and the limits of variables, are part of the structure.

    Attributes
    ----------
    constants
        By varID: constants, what is calculated from them (`with_constants` keeps these in step), and usual values of
        inputs.
    tables
        Of each stage; a stage's tables need no result of a later one.
    structure
        What is computed from what.
    """

    constants: dict[str, Scalar]
    tables: tuple[tuple[Lookup | ScatteredTable, ...], ...]
    structure: Structure = eqx.field(static=True)

    def evaluate(self, inputs: Mapping[str, ScalarLike], outputs: Sequence[str] | None = None) -> dict[str, Scalar]:
        """Values of variables in one instant, in the units of the file.

        Parameters
        ----------
        inputs
            Scalars by varID or name; those that have a usual value may be left out, as may those that no wanted
            variable depends on.
        outputs
            Wanted variables, any of the file, by varID or name; what the file marks as output where None. Nothing
            else is computed.

        Returns
        -------
        By the names under which they were asked for.

        Raises
        ------
        ValueError
            A variable is not known or is no input, an input is missing, or one is no scalar.
        """
        asked = self.structure.outputs if outputs is None else tuple(outputs)
        wanted = {name: self.structure.find(name) for name in asked}
        values: dict[str, Array] = dict(self.constants)
        for name, value in inputs.items():
            identifier = self._input(name, value)
            values[identifier] = _clip(_number(value), self.structure.by_id[identifier].limits)
        needed = self.structure.required_variables(set(wanted.values()), values.keys())
        self._refuse_missing(needed - values.keys())
        stage = 0
        for quantity in self.structure.quantities:
            if quantity.id not in needed or quantity.id in values:
                continue
            while stage < quantity.level:
                values |= self._looked_up(stage, values, needed)
                stage += 1
            if quantity.formula is not None:
                found = IN_JAX.value_of(quantity.formula, values)
                values[quantity.id] = _clip(_number(found), quantity.limits)
        return {name: values[identifier] for name, identifier in wanted.items()}

    def evaluate_si(self, inputs: Mapping[str, ScalarLike], outputs: Sequence[str] | None = None) -> dict[str, Scalar]:
        """As `evaluate`, inputs and values in SI units and radians; percent as fractions.

        Raises
        ------
        ValueError
            Also where a unit is not known; the message names the variable and the unit.
        """
        asked = self.structure.outputs if outputs is None else tuple(outputs)
        units = {name: self.unit(name) for name in (*inputs, *asked)}
        given = {name: (value - units[name].offset) / units[name].factor for name, value in inputs.items()}
        found = self.evaluate(given, asked)
        return {name: value * units[name].factor + units[name].offset for name, value in found.items()}

    def unit(self, name: str) -> Unit:
        """The unit of a variable, by its varID or name.

        Raises
        ------
        ValueError
            The variable or its unit is not known.
        """
        quantity = self.structure.by_id[self.structure.find(name)]
        try:
            return parse_unit(quantity.units)
        except ValueError as error:
            raise ValueError(f"variable {quantity.id} ({quantity.name}): {error}") from None

    def with_constants(self, changes: Mapping[str, ScalarLike]) -> "Evaluator":
        """The same model with other constants, in the units of the file; what is calculated from them follows.

        What the file calculates from constants may be changed too, and is then held.

        Raises
        ------
        ValueError
            A variable is no constant.
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
            named = (
                f"{name} ({self.structure.by_id[name].name}, {self.structure.by_id[name].units})" for name in missing
            )
            raise ValueError(f"inputs are missing: {', '.join(named)}")

    def _looked_up(self, stage: int, values: Mapping[str, Array], needed: set[str]) -> dict[str, Array]:
        found: dict[str, Array] = {}
        for table in self.tables[stage]:
            wanted = needed.intersection(table.result_names) - values.keys()
            if wanted:
                found |= table(values, wanted)
        return {name: _clip(value, self.structure.by_id[name].limits) for name, value in found.items()}


def _number(value: ScalarLike) -> Array:
    """A number as an array, in its own precision."""
    array = jnp.asarray(value)
    return array if jnp.issubdtype(array.dtype, jnp.floating) else array.astype(float)


def _clip(value: Array, limits: tuple[float | None, float | None]) -> Array:
    least, greatest = limits
    value = value if least is None else jnp.maximum(value, least)
    return value if greatest is None else jnp.minimum(value, greatest)


def make_evaluator(definition: Definition) -> Evaluator:
    """Compile what a file says.

    Raises
    ------
    DaveMlError
        A variable is not there, has two sources, depends on itself or calculates from constants what is no number; or
        a table cannot be interpolated.
    """
    with jax.ensure_compile_time_eval():  # known numbers, even where a traced function reads a file
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
    """The same definition with scattered points along a line as gridded tables."""
    breakpoints, gridded = dict(definition.breakpoints), dict(definition.gridded)
    for table in definition.ungridded.values():
        if table.points.shape[1] == 1:
            refuse_duplicate_points(table)
            order = np.argsort(table.points[:, 0])
            axis = f"{table.id} along its points"  # no identifier of XML has blanks
            breakpoints[axis] = Breakpoints(axis, table.points[order, 0])
            gridded[table.id] = GriddedTable(table.id, (axis,), table.values[order])
    return replace(definition, breakpoints=breakpoints, gridded=gridded)
