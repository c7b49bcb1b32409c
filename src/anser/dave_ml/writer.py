"""Writer of DAVE-ML 2 text (DAVEfunc document type 2.0)."""

from collections.abc import Iterable, Mapping
from typing import Final
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from anser.dave_ml.definition import (
    ROLES,
    Argument,
    Breakpoints,
    Definition,
    Function,
    GriddedTable,
    Note,
    Shot,
    Signal,
    UngriddedTable,
    Variable,
)
from anser.dave_ml.formulas import format_mathml
from anser.dave_ml.model import Model

_HEAD: Final = """<?xml version="1.0" encoding="UTF-8" standalone="no"?>
<!DOCTYPE DAVEfunc PUBLIC "-//AIAA//DTD for Flight Dynamic Models - Functions 2.0//EN"
  "http://www.daveml.org/DTDs/2p0/DAVEfunc.dtd">
"""
_NUMBERS_IN_LINE: Final = 12


def write_dave_ml(model: Model) -> str:
    """Return a model as the text of a DAVE-ML 2 file, from which `read_dave_ml` builds a model with the same values.

    Numbers keep full precision. Tables inside a function become separate breakpoints and tables. Notes with the tag
    `confidenceBound` are not written.
    """
    definition = model.definition
    parts = [
        *_note(definition.header),
        *(line for v in definition.variables.values() for line in _variable(v)),
        *_tables(definition),
        *(line for function in definition.functions for line in _function(function, definition)),
    ]
    shots = [line for s in definition.shots for line in _shot(s, definition)]
    if shots or definition.check_notes:
        parts += _element("checkData", {}, [*_notes(definition.check_notes, "provenance", "provenanceRef"), *shots])
    lines = _element("DAVEfunc", {"xmlns": "http://daveml.org/2010/DAVEML"}, parts)
    return _HEAD + "\n".join(lines) + "\n"


def _tag(name: str, attributes: Mapping[str, str]) -> str:
    return " ".join([name, *(f"{key}={quoteattr(value)}" for key, value in attributes.items())])


def _element(name: str, attributes: Mapping[str, str], inside: Iterable[str] = ()) -> list[str]:
    lines = list(inside)
    if not lines:
        return [f"<{_tag(name, attributes)}/>"]
    return [f"<{_tag(name, attributes)}>", *(f"  {line}" for line in lines), f"</{name}>"]


def _text(name: str, text: str, attributes: Mapping[str, str] | None = None) -> list[str]:
    return [f"<{_tag(name, attributes or {})}>{escape(text)}</{name}>"]


def _nonempty_attributes(**attributes: str | float | None) -> dict[str, str]:
    return {
        key: value if isinstance(value, str) else repr(float(value))
        for key, value in attributes.items()
        if value is not None and value != ""
    }


def _description(text: str) -> list[str]:
    return _text("description", text) if text else []


def _note(note: Note) -> list[str]:
    inside = [*([escape(note.text)] if note.text else []), *(line for child in note.children for line in _note(child))]
    if note.text and not note.children:
        return _text(note.tag, note.text, dict(note.attributes))
    return _element(note.tag, dict(note.attributes), inside)


def _notes(notes: Iterable[Note], *tags: str) -> list[str]:
    return [line for note in notes if note.tag in tags for line in _note(note)]


def _numbers(values: np.ndarray) -> list[str]:
    """Return the values as lines of comma-separated numbers; the last axis varies fastest."""
    tokens = [repr(float(value)) for value in values.ravel()]
    lines = [", ".join(tokens[k : k + _NUMBERS_IN_LINE]) for k in range(0, len(tokens), _NUMBERS_IN_LINE)]
    return [*(f"{line}," for line in lines[:-1]), *lines[-1:]]


def _variable(variable: Variable) -> list[str]:
    attributes = {"name": variable.name, "varID": variable.id, "units": variable.units} | _nonempty_attributes(
        axisSystem=variable.axis_system,
        sign=variable.sign,
        alias=variable.alias,
        symbol=variable.symbol,
        initialValue=variable.initial,
        minValue=variable.minimum,
        maxValue=variable.maximum,
    )
    calculation = [] if variable.formula is None else _element("calculation", {}, [format_mathml(variable.formula)])
    inside = [
        *_description(variable.description),
        *_notes(variable.notes, "provenance", "provenanceRef"),
        *calculation,
        *(f"<{role}/>" for role in ROLES if role in variable.roles),
        *_notes(variable.notes, "uncertainty"),
    ]
    return _element("variableDef", attributes, inside)


def _tables(definition: Definition) -> list[str]:
    lines: list[str] = []
    for breakpoints in definition.breakpoints.values():
        values = _element("bpVals", {}, _numbers(breakpoints.points))
        lines += _identified("breakpointDef", "bpID", breakpoints, values)
    for table in definition.gridded.values():
        axes = [line for axis in table.axes for line in _element("bpRef", {"bpID": axis})]
        inside = [
            *_notes(table.notes, "provenance", "provenanceRef"),
            *_element("breakpointRefs", {}, axes),
            *_notes(table.notes, "uncertainty"),
            *_element("dataTable", {}, _numbers(table.values)),
        ]
        lines += _identified("griddedTableDef", "gtID", table, inside)
    for table in definition.ungridded.values():
        inside = _notes(table.notes, "provenance", "provenanceRef", "uncertainty")
        for point in np.column_stack([table.points, table.values]):
            inside += _text("dataPoint", ", ".join(repr(float(x)) for x in point))
        lines += _identified("ungriddedTableDef", "utID", table, inside)
    return lines


def _identified(
    tag: str, identifier: str, part: Breakpoints | GriddedTable | UngriddedTable, inside: Iterable[str]
) -> list[str]:
    attributes = _nonempty_attributes(name=part.name, **{identifier: part.id}, units=part.units)
    return _element(tag, attributes, [*_description(part.description), *inside])


def _function(function: Function, definition: Definition) -> list[str]:
    gridded = function.table in definition.gridded
    kind, attribute = ("griddedTableRef", "gtID") if gridded else ("ungriddedTableRef", "utID")
    inside = [
        *_description(function.description),
        *_notes(function.notes, "provenance", "provenanceRef"),
        *(line for argument in function.arguments for line in _argument(argument)),
        *_element("dependentVarRef", {"varID": function.result}),
        *_element("functionDefn", {}, _element(kind, {attribute: function.table})),
    ]
    return _element("function", {"name": function.name}, inside)


def _argument(argument: Argument) -> list[str]:
    attributes = {"varID": argument.id} | _nonempty_attributes(min=argument.minimum, max=argument.maximum)
    attributes["extrapolate"] = argument.extrapolate
    if argument.interpolate != "linear":
        attributes["interpolate"] = argument.interpolate
    return _element("independentVarRef", attributes)


def _shot(shot: Shot, definition: Definition) -> list[str]:
    names = [variable.name for variable in definition.variables.values()]
    single = {name for name in names if names.count(name) == 1}

    def signals(tag: str, shot_signals: tuple[Signal, ...], by_name: bool) -> list[str]:
        lines = [line for signal in shot_signals for line in _signal(signal, definition, by_name, single)]
        return _element(tag, {}, lines) if lines or tag == "checkOutputs" else []

    inside = [
        *_description(shot.description),
        *_notes(shot.notes, "provenance", "provenanceRef"),
        *signals("checkInputs", shot.inputs, True),
        *signals("internalValues", shot.internal, False),
        *signals("checkOutputs", shot.outputs, True),
    ]
    return _element("staticShot", {"name": shot.name} | _nonempty_attributes(refID=shot.reference), inside)


def _signal(signal: Signal, definition: Definition, by_name: bool, single: set[str]) -> list[str]:
    variable = definition.variables[signal.id]
    if variable.name in single and (by_name or signal.units != variable.units):
        head = [*_text("signalName", variable.name), *_text("signalUnits", signal.units)]
    else:
        units = [] if signal.units == variable.units else _text("signalUnits", signal.units)
        head = [*_text("varID", signal.id), *units]
    tolerance = [] if signal.tolerance is None else _text("tol", repr(float(signal.tolerance)))
    return _element("signal", {}, [*head, *_text("signalValue", repr(float(signal.value))), *tolerance])
