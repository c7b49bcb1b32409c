"""Suspect points of the tables of DAVE-ML files."""

from collections.abc import Iterator, Mapping

import numpy as np

from anser.aircraft import GriddedTable, suspect_points
from anser.dave_ml import Definition, Model
from anser.scenario.airframe_file.build_dave_ml import file_models
from anser.scenario.airframe_file.linting_tables import suspicion
from anser.scenario.airframe_file.schema_dave_ml import DaveMlFile

_FIRST = ("angleOfAttack", "angleOfSideslip")
"""What tables are looked at along first: their points are compared along these and, of these, with mirror images."""


def model_table_findings(file: DaveMlFile) -> Iterator[tuple[str, str]]:
    """Place and text of what is suspect in the gridded tables of an aircraft's DAVE-ML files."""
    for part, model in file_models(file).items():
        for table, text in suspect_table_points(model, file.dave_ml.names):
            yield f"dave_ml.{part} ({table})" if table in model.definition.gridded else f"dave_ml.{part}", text


def suspect_table_points(model: Model, aliases: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Table, and text, of what is suspect in the gridded tables of a file.

    Parameters
    ----------
    model
        The file.
    aliases
        Its own names of variables, by their standard ones.
    """
    definition = model.definition
    axes = {name: _axes(aliases, model, name) for name in definition.gridded}
    tables = {name: _in_order(definition, name, [k for _, k in of]) for name, of in axes.items()}
    for point in suspect_points(tables):
        if point.table in axes:
            over = [definition.breakpoints[definition.gridded[point.table].axes[k]] for _, k in axes[point.table]]
            names = [one.name or one.id for one in over]
        else:
            names = ["first axis", "second axis"]
        where = ", ".join(f"{name} {value:g}" for name, value in zip(names, point.place, strict=True))
        yield point.table, f"{where}: {suspicion(point)}"


def _axes(aliases: Mapping[str, str], model: Model, table: str) -> list[tuple[int, int]]:
    """Rank and number of each axis of a table: along the angle of attack first, then the sideslip, then the others."""
    function = next((one for one in model.definition.functions if one.table == table), None)
    count = len(model.definition.gridded[table].axes)
    ranks = [len(_FIRST)] * count
    if function is not None:
        own = [{name, aliases.get(name, name)} for name in _FIRST]
        for k, argument in enumerate(function.arguments):
            inputs = _inputs_of(model, argument.id)
            ranks[k] = next((rank for rank, names in enumerate(own) if inputs and inputs <= names), len(_FIRST))
    return sorted(zip(ranks, range(count), strict=True))


def _inputs_of(model: Model, identifier: str) -> set[str]:
    """Names of the inputs that a variable depends on."""
    structure = model.evaluator.structure
    needed = structure.needed_for({identifier}, set())
    return {structure.by_id[one].name for one in needed if one in structure.inputs}


def _in_order(definition: Definition, name: str, places: list[int]) -> GriddedTable:
    table = definition.gridded[name]
    points = tuple(definition.breakpoints[table.axes[k]].points for k in places)
    return GriddedTable(points, np.transpose(np.asarray(table.values, dtype=float), places))
