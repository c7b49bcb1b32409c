"""Reader of DAVE-ML text: variables, tables, functions and check shots (reference, sections 6.2.2 to 6.2.7)."""

from collections.abc import Mapping
from typing import Final, cast

import numpy as np

from anser.dave_ml.definition import (
    ROLES,
    Argument,
    Breakpoints,
    Definition,
    Extrapolate,
    Function,
    GriddedTable,
    Interpolate,
    Note,
    Shot,
    Signal,
    UngriddedTable,
    Variable,
    source_location_of,
)
from anser.dave_ml.elements import (
    TABLE_NUMBERS_MAX,
    DaveMlError,
    Element,
    optional_number,
    parse_elements,
    parse_number,
    parse_numbers,
    quote,
)
from anser.dave_ml.formulas import parse_formula
from anser.dave_ml.standard_units import is_convertible, refuse_nonstandard_units

NOTES: Final = ("provenance", "provenanceRef", "uncertainty", "confidenceBound")
"""Documentation elements, stored as notes of their parent."""


def parse_note(element: Element) -> Note:
    """Convert an element with its children to a note."""
    return Note(
        element.tag,
        tuple(element.attributes.items()),
        element.text.strip(),
        tuple(parse_note(child) for child in element.children),
    )


def parse_notes(element: Element) -> tuple[Note, ...]:
    """Notes of an element."""
    return tuple(parse_note(child) for child in element.all(*NOTES))


def parse_description(element: Element) -> str:
    """Description of an element, with white space collapsed."""
    description = element.first("description")
    return "" if description is None else " ".join(description.text.split())


AXES_MAX: Final = 8
"""Greatest number of axes of a table."""
_EXTRAPOLATE: Final = ("neither", "min", "max", "both")
_INTERPOLATE: Final = ("linear", "discrete", "floor", "ceiling")
_SPLINES: Final = ("quadraticSpline", "cubicSpline")
_TABLES: Final = (
    "griddedTableRef", "griddedTableDef", "griddedTable", "ungriddedTableRef", "ungriddedTableDef", "ungriddedTable",
)  # fmt: skip


class TableReader:
    """Reader of breakpoints and tables; stores them by identifier.

    Parameters
    ----------
    used_identifiers
        varIDs, which breakpoints and tables must not repeat.
    """

    def __init__(self, used_identifiers: set[str]) -> None:
        self.breakpoints: dict[str, Breakpoints] = {}
        self.gridded: dict[str, GriddedTable] = {}
        self.ungridded: dict[str, UngriddedTable] = {}
        self._used_identifiers = set(used_identifiers)

    def _register_identifier(self, element: Element, attribute: str) -> str:
        identifier = element.attribute(attribute)
        if identifier in self._used_identifiers:
            raise element.fault(f"a second {attribute} {quote(identifier)}", "an identifier of its own")
        self._used_identifiers.add(identifier)
        return identifier

    def _new_identifier(self, base: str) -> str:
        identifier, count = base, 1
        while identifier in self._used_identifiers:
            count += 1
            identifier = f"{base}_{count}"
        self._used_identifiers.add(identifier)
        return identifier

    def read_breakpoints(self, element: Element) -> None:
        """Read a ``<breakpointDef>``."""
        element.permit(("name", "bpID", "units"), once=("description", "bpVals"))
        values = element.require("bpVals")
        identifier = self._register_identifier(element, "bpID")
        self.breakpoints[identifier] = Breakpoints(
            id=identifier,
            points=_increasing(values, parse_numbers(values, f"breakpoints {identifier}")),
            name=element.attributes.get("name", ""),
            units=element.attributes.get("units", "").strip(),
            description=parse_description(element),
            location=source_location_of(element),
        )

    def read_gridded_table(self, element: Element, fallback: str = "table") -> str:
        """Read a ``<griddedTableDef>`` and return its identifier, made from `fallback` in the absence of a gtID."""
        element.permit(("name", "gtID", "units"), once=("description", "breakpointRefs", "dataTable", *NOTES))
        axes = []
        references = element.require("breakpointRefs")
        references.permit(repeatable=("bpRef",))
        for reference in references.all("bpRef"):
            reference.permit(("bpID",))
            axis = reference.attribute("bpID")
            if axis not in self.breakpoints:
                raise reference.fault(f"bpID {quote(axis)}", "the bpID of a <breakpointDef>")
            axes.append(axis)
        identifier = self._identifier_of(element, "gtID", fallback)
        self.gridded[identifier] = GriddedTable(
            id=identifier,
            axes=tuple(axes),
            values=self._read_values(element.require("dataTable"), references, axes, identifier),
            name=element.attributes.get("name", ""),
            units=element.attributes.get("units", "").strip(),
            description=parse_description(element),
            notes=parse_notes(element),
            location=source_location_of(element),
        )
        return identifier

    def _identifier_of(self, element: Element, attribute: str, fallback: str) -> str:
        return (
            self._register_identifier(element, attribute)
            if element.tag.endswith("Def")
            else self._new_identifier(fallback)
        )

    def _read_values(self, data: Element, axes_element: Element, axes: list[str], table_name: str) -> np.ndarray:
        """Values of a table in the shape of the axes, last axis fastest."""
        if not 1 <= len(axes) <= AXES_MAX:
            raise axes_element.fault(f"{len(axes)} axes of table {table_name}", f"1 to {AXES_MAX}")
        shape = tuple(self.breakpoints[axis].points.size for axis in axes)
        values = parse_numbers(data, f"table {table_name}")
        size = int(np.prod([float(n) for n in shape]))
        if values.size != size:
            dimensions = " x ".join(str(n) for n in shape)
            raise data.fault(
                f"{values.size} numbers in table {table_name}", f"{dimensions} = {size}, by its breakpoints"
            )
        return values.reshape(shape)

    def read_ungridded_table(self, element: Element, fallback: str = "table") -> str:
        """Read an ``<ungriddedTableDef>`` and return its identifier, made from `fallback` in the absence of a utID."""
        element.permit(("name", "utID", "units"), once=("description", *NOTES), repeatable=("dataPoint",))
        points: list[np.ndarray] = []
        for point in element.all("dataPoint"):
            point.permit(("modID",))
            coordinates = parse_numbers(point, "a point of a table")
            if coordinates.size < 2 or (points and coordinates.size != points[0].size):
                expected = f"{points[0].size}, as before" if points else "coordinates and a value: 2 or more"
                raise point.fault(f"{coordinates.size} numbers of a point", expected)
            points.append(coordinates)
        if not points:
            raise element.fault("an <ungriddedTableDef> without <dataPoint>", "points")
        if points[0].size - 1 > AXES_MAX or len(points) * points[0].size > TABLE_NUMBERS_MAX:
            expected = f"at most {AXES_MAX} coordinates and {TABLE_NUMBERS_MAX:,} numbers in all"
            raise element.fault(f"{len(points)} points of {points[0].size} numbers", expected)
        identifier = self._identifier_of(element, "utID", fallback)
        table = np.stack(points)
        self.ungridded[identifier] = UngriddedTable(
            id=identifier,
            points=table[:, :-1],
            values=table[:, -1],
            name=element.attributes.get("name", ""),
            units=element.attributes.get("units", "").strip(),
            description=parse_description(element),
            notes=parse_notes(element),
            location=source_location_of(element),
        )
        return identifier

    def read_function(self, element: Element) -> Function:
        """Read a ``<function>`` and its table."""
        element.permit(
            ("name",),
            once=("description", "provenance", "provenanceRef", "dependentVarPts", "dependentVarRef", "functionDefn"),
            repeatable=("independentVarPts", "independentVarRef"),
        )
        arguments = [_argument(child) for child in element.all("independentVarPts", "independentVarRef")]
        dependent = element.require("dependentVarRef", "dependentVarPts")
        result = dependent.attribute("varID")
        simple = dependent.tag == "dependentVarPts"
        wrong = element.first("independentVarRef" if simple else "independentVarPts")
        if wrong is not None or not arguments:
            expected = "independentVarPts" if simple else "independentVarRef"
            raise element.fault(
                f"<{dependent.tag}> without <{expected}> for each argument", f"<{expected}> and no other"
            )
        table = (
            self._read_inline_table(element, dependent, result)
            if simple
            else self._read_function_table(element, result)
        )
        dimensions = len(self.gridded[table].axes) if table in self.gridded else self.ungridded[table].points.shape[1]
        if dimensions != len(arguments):
            arrived = f"{len(arguments)} arguments of a function with a table of {dimensions} axes"
            raise element.fault(arrived, "one argument for each axis")
        return Function(
            name=element.attribute("name"),
            result=result,
            arguments=tuple(arguments),
            table=table,
            description=parse_description(element),
            notes=parse_notes(element),
            location=source_location_of(element),
        )

    def _read_inline_table(self, element: Element, dependent: Element, result: str) -> str:
        """Read the table of a function with points given inline (``<dependentVarPts>``)."""
        dependent.permit(("varID", "name", "units", "sign"))
        axes = []
        for count, points in enumerate(element.all("independentVarPts"), start=1):
            identifier = self._new_identifier(f"points_{count}_of_{result}")
            values = _increasing(points, parse_numbers(points, "independentVarPts"))
            units = points.attributes.get("units", "").strip()
            self.breakpoints[identifier] = Breakpoints(
                identifier, values, units=units, location=source_location_of(points)
            )
            axes.append(identifier)
        identifier = self._new_identifier(f"table_of_{result}")
        values = self._read_values(dependent, element, axes, identifier)
        self.gridded[identifier] = GriddedTable(
            identifier, tuple(axes), values, units=dependent.attributes.get("units", "").strip(),
            location=source_location_of(dependent),
        )  # fmt: skip
        return identifier

    def _read_function_table(self, element: Element, result: str) -> str:
        """Read the table referenced or contained in a ``<functionDefn>``."""
        definition = element.require("functionDefn")
        definition.permit(("name",), once=_TABLES)
        if len(definition.children) != 1:
            raise definition.fault(f"{len(definition.children)} tables in <functionDefn>", "one")
        table = definition.children[0]
        if table.tag in ("griddedTableDef", "griddedTable"):
            return self.read_gridded_table(table, f"table_of_{result}")
        if table.tag in ("ungriddedTableDef", "ungriddedTable"):
            return self.read_ungridded_table(table, f"table_of_{result}")
        attribute, tables_of_kind, kind = (
            ("gtID", self.gridded, "griddedTableDef")
            if table.tag == "griddedTableRef"
            else ("utID", self.ungridded, "ungriddedTableDef")
        )
        table.permit((attribute,))
        identifier = table.attribute(attribute)
        if identifier not in tables_of_kind:
            tables_of_other_kind = self.ungridded if tables_of_kind is self.gridded else self.gridded
            hint = ": this is the other kind of table" if identifier in tables_of_other_kind else ""
            raise table.fault(f"{attribute} {quote(identifier)}", f"the {attribute} of a <{kind}>{hint}")
        return identifier


def _argument(element: Element) -> Argument:
    simple = element.tag == "independentVarPts"
    element.permit(("varID", "extrapolate", "interpolate", *(("name", "units", "sign") if simple else ("min", "max"))))
    extrapolate = element.attributes.get("extrapolate", "neither").strip()
    interpolate = element.attributes.get("interpolate", "linear").strip()
    if extrapolate not in _EXTRAPOLATE:
        raise element.fault(f"extrapolate={quote(extrapolate)}", " or ".join(_EXTRAPOLATE))
    if interpolate in _SPLINES:
        expected = f"{' or '.join(_INTERPOLATE)}: DAVE-ML leaves open which spline it is"
        raise element.fault(f"interpolate={quote(interpolate)}", expected)
    if interpolate not in _INTERPOLATE:
        raise element.fault(f"interpolate={quote(interpolate)}", " or ".join(_INTERPOLATE))
    minimum, maximum = optional_number(element, "min"), optional_number(element, "max")
    if minimum is not None and maximum is not None and minimum > maximum:
        raise element.fault(f"min {minimum:g} above max {maximum:g}", "min of at most max")
    identifier = element.attribute("varID")
    return Argument(identifier, minimum, maximum, cast(Extrapolate, extrapolate), cast(Interpolate, interpolate))


def _increasing(element: Element, points: np.ndarray) -> np.ndarray:
    """Check that breakpoints strictly increase."""
    steps = np.diff(points)
    if not np.all(steps > 0.0):
        k = int(np.flatnonzero(~(steps > 0.0))[0])
        raise element.fault(f"breakpoint {points[k + 1]:g} after {points[k]:g}", "strictly increasing breakpoints")
    return points


def parse_shots(checks: Element, variables: Mapping[str, Variable]) -> tuple[Shot, ...]:
    """Read the check shots of ``<checkData>``.

    Raises
    ------
    DaveMlError
        If a signal does not identify a variable of the file, or a value is not a number.
    """
    checks.permit(once=("provenance", "provenanceRef"), repeatable=("staticShot",))
    by_name: dict[str, list[str]] = {}
    for variable in variables.values():
        by_name.setdefault(variable.name, []).append(variable.id)
    return tuple(_shot(element, variables, by_name) for element in checks.all("staticShot"))


def _shot(element: Element, variables: Mapping[str, Variable], by_name: Mapping[str, list[str]]) -> Shot:
    element.permit(
        ("name", "refID"),
        once=("description", "provenance", "provenanceRef", "checkInputs", "internalValues", "checkOutputs"),
    )
    parts: dict[str, tuple[Signal, ...]] = {}
    for tag in ("checkInputs", "internalValues", "checkOutputs"):
        part = element.first(tag)
        if part is not None:
            part.permit(repeatable=("signal",))
            parts[tag] = tuple(_signal(signal, variables, by_name) for signal in part.all("signal"))
            _refuse_repeated_signals(part, parts[tag])
    element.require("checkOutputs")
    return Shot(
        name=element.attribute("name"),
        inputs=parts.get("checkInputs", ()),
        outputs=parts["checkOutputs"],
        internal=parts.get("internalValues", ()),
        reference=element.attributes.get("refID", ""),
        description=parse_description(element),
        notes=parse_notes(element),
    )


def _refuse_repeated_signals(part: Element, signals: tuple[Signal, ...]) -> None:
    signal_ids: set[str] = set()
    for element, signal in zip(part.all("signal"), signals, strict=True):
        if signal.id in signal_ids:
            raise element.fault(f"a second <signal> of {quote(signal.id)} in <{part.tag}>", "one")
        signal_ids.add(signal.id)


def _signal(element: Element, variables: Mapping[str, Variable], by_name: Mapping[str, list[str]]) -> Signal:
    element.permit(once=("signalName", "signalUnits", "varID", "signalID", "signalValue", "tol"))
    identified = element.first("varID", "signalID")
    if identified is not None:
        identifier = identified.text.strip()
        if identifier not in variables:
            raise identified.fault(f"varID {quote(identifier)}", "the varID of a variable of this file")
    else:
        name_element = element.require("signalName", "varID")
        name = name_element.text.strip()
        matches = by_name.get(name, [])
        if len(matches) != 1:
            raise name_element.fault(
                f"signal {quote(name)}, a name of {len(matches)} variables", "the name of one variable"
            )
        identifier = matches[0]
    units = element.first("signalUnits")
    tolerance = element.first("tol")
    value = element.require("signalValue")
    limit = None if tolerance is None else parse_number(tolerance.text, tolerance, "a tolerance")
    if tolerance is not None and limit is not None and limit < 0.0:
        raise tolerance.fault(f"a tolerance of {limit:g}", "0 or more")
    variable = variables[identifier]
    if units is not None and not is_convertible(units.text.strip(), variable.units):
        arrived = f"units {quote(units.text.strip())} of {quote(variable.name)} (varID {quote(identifier)})"
        raise units.fault(arrived, f"units that convert to those of the variable, {quote(variable.units)}")
    return Signal(
        id=identifier,
        value=parse_number(value.text, value, "a value"),
        units=variable.units if units is None else units.text.strip(),
        tolerance=limit,
    )


_VARIABLE_ATTRIBUTES = (
    "name", "varID", "units", "axisSystem", "sign", "alias", "symbol", "initialValue", "minValue", "maxValue",
)  # fmt: skip


def parse_definition(content: str | bytes, name: str) -> Definition:
    """Read the definition of a DAVE-ML file.

    Parameters
    ----------
    content
        Text of the file, or its bytes in the declared encoding.
    name
        Name of the file in error messages.

    Raises
    ------
    DaveMlError
        If the text is not DAVE-ML, contains an unknown element, or contradicts itself.
    """
    root = parse_elements(content, name)
    if root.tag != "DAVEfunc":
        raise root.fault(f"<{root.tag}>", "<DAVEfunc>")
    root.permit(
        (),
        once=("fileHeader", "checkData"),
        repeatable=("variableDef", "breakpointDef", "griddedTableDef", "ungriddedTableDef", "function"),
    )
    variables: dict[str, Variable] = {}
    for element in root.all("variableDef"):
        variable = _variable(element)
        if variable.id in variables:
            raise _duplicate_identifier(element, variable.id, variables[variable.id].location.line)
        refuse_nonstandard_units(variable)
        variables[variable.id] = variable
    if not variables:
        raise root.fault("no <variableDef>", "at least one")
    tables = TableReader(used_identifiers=set(variables))
    for element in root.all("breakpointDef"):
        tables.read_breakpoints(element)
    for element in root.all("griddedTableDef"):
        tables.read_gridded_table(element)
    for element in root.all("ungriddedTableDef"):
        tables.read_ungridded_table(element)
    functions = tuple(tables.read_function(element) for element in root.all("function"))
    checks = root.first("checkData")
    header = root.first("fileHeader")
    return Definition(
        file=name,
        header=Note("fileHeader") if header is None else parse_note(header),
        variables=variables,
        breakpoints=tables.breakpoints,
        gridded=tables.gridded,
        ungridded=tables.ungridded,
        functions=functions,
        shots=() if checks is None else parse_shots(checks, variables),
    )


def _duplicate_identifier(element: Element, identifier: str, line: int | None) -> DaveMlError:
    return element.fault(f"a second varID {quote(identifier)}, the first in line {line}", "an identifier of its own")


def _variable(element: Element) -> Variable:
    element.permit(
        _VARIABLE_ATTRIBUTES,
        once=("description", "provenance", "provenanceRef", "calculation", "uncertainty", *ROLES),
    )
    calculation = element.first("calculation")
    formula = None
    if calculation is not None:
        calculation.permit(once=("math",))
        formula = parse_formula(calculation.require("math"))
    attributes = element.attributes
    minimum, maximum = optional_number(element, "minValue"), optional_number(element, "maxValue")
    if minimum is not None and maximum is not None and minimum > maximum:
        raise element.fault(f"minValue {minimum:g} above maxValue {maximum:g}", "minValue of at most maxValue")
    return Variable(
        id=element.attribute("varID"),
        name=element.attribute("name"),
        units=element.attribute("units"),
        description=parse_description(element),
        axis_system=attributes.get("axisSystem", ""),
        sign=attributes.get("sign", ""),
        alias=attributes.get("alias", ""),
        symbol=attributes.get("symbol", ""),
        initial=optional_number(element, "initialValue"),
        minimum=minimum,
        maximum=maximum,
        formula=formula,
        roles=frozenset(role for role in ROLES if element.first(role) is not None),
        notes=parse_notes(element),
        location=source_location_of(element),
    )
