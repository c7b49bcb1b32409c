"""Reader of DAVE-ML text: variables, tables, functions and check shots (reference, sections 6.2.2 to 6.2.7)."""

import itertools
from collections.abc import Iterable, Mapping
from typing import Any, Final, cast, get_args

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
    SourceLocation,
    UngriddedTable,
    Variable,
)
from anser.dave_ml.elements import (
    TABLE_NUMBERS_MAX,
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
"""Tags of elements without effect on the model, which are stored as notes of their parent element."""
AXES_MAX: Final = 8
"""Greatest number of axes of a table."""
_EXTRAPOLATE: Final[tuple[Extrapolate, ...]] = get_args(Extrapolate)
_INTERPOLATE: Final[tuple[Interpolate, ...]] = get_args(Interpolate)
_SPLINES: Final = ("quadraticSpline", "cubicSpline")
_TABLES: Final = (
    "griddedTableRef", "griddedTableDef", "griddedTable", "ungriddedTableRef", "ungriddedTableDef", "ungriddedTable",
)  # fmt: skip


def _note(element: Element) -> Note:
    attributes = tuple(element.attributes.items())
    return Note(element.tag, attributes, element.text.strip(), tuple(map(_note, element.children)))


def _documentation(element: Element) -> dict[str, Any]:
    """Return description, notes and location of an element, as arguments for classes of `definition`."""
    return {
        "description": " ".join(text for child in element.all("description")[:1] for text in child.text.split()),
        "notes": tuple(map(_note, element.all(*NOTES))),
        "location": SourceLocation(element.file, element.line, element.column),
    }


def _named(element: Element) -> dict[str, Any]:
    """Return name, units (empty if absent) and the entries of `_documentation`."""
    units = element.attributes.get("units", "").strip()
    return {"name": element.attributes.get("name", ""), "units": units, **_documentation(element)}


def _limits(element: Element, lower: str, upper: str) -> tuple[float | None, float | None]:
    minimum, maximum = optional_number(element, lower), optional_number(element, upper)
    if minimum is not None and maximum is not None and minimum > maximum:
        raise element.fault(f"{lower} {minimum:g} above {upper} {maximum:g}", f"{lower} of at most {upper}")
    return minimum, maximum


class TableReader:
    """Reader that stores breakpoints and tables by identifier; identifiers must be new, not in `used_identifiers`."""

    def __init__(self, used_identifiers: Iterable[str]) -> None:
        self.breakpoints: dict[str, Breakpoints] = {}
        self.gridded: dict[str, GriddedTable] = {}
        self.ungridded: dict[str, UngriddedTable] = {}
        self._used_identifiers = set(used_identifiers)

    def _identifier(self, element: Element, attribute: str, base: str | None = None) -> str:
        """Return the identifier in `attribute`; for a table inside a function, a new one that starts with `base`."""
        if base is None or element.tag.endswith("Def"):
            identifier = element.attribute(attribute)
            if identifier in self._used_identifiers:
                raise element.fault(f"a second {attribute} {quote(identifier)}", "an identifier of its own")
        else:
            candidates = (base if k == 1 else f"{base}_{k}" for k in itertools.count(1))
            identifier = next(candidate for candidate in candidates if candidate not in self._used_identifiers)
        self._used_identifiers.add(identifier)
        return identifier

    def _add_breakpoints(self, element: Element, data: Element, identifier: str, table_name: str, **fields: Any) -> str:
        points = parse_numbers(data, table_name)
        steps = np.diff(points)
        if not np.all(steps > 0.0):
            k = int(np.flatnonzero(~(steps > 0.0))[0])
            raise data.fault(f"breakpoint {points[k + 1]:g} after {points[k]:g}", "strictly increasing breakpoints")
        self.breakpoints[identifier] = Breakpoints(identifier, points, **{**_named(element), **fields})
        return identifier

    def _add_grid(
        self, element: Element, data: Element, axes_element: Element, axes: list[str], identifier: str, **fields: Any
    ) -> str:
        """Store the gridded table `identifier` with the numbers in the text of `data`, and return the identifier.

        `axes` are the bpIDs of the breakpoints; the last axis varies fastest in the text. `fields` replace name, units
        and documentation of `element`. Raises DaveMlError if the number of axes or of values is wrong.
        """
        if not 1 <= len(axes) <= AXES_MAX:
            raise axes_element.fault(f"{len(axes)} axes of table {identifier}", f"1 to {AXES_MAX}")
        shape = tuple(self.breakpoints[axis].points.size for axis in axes)
        values = parse_numbers(data, f"table {identifier}")
        size = int(np.prod([float(n) for n in shape]))
        if values.size != size:
            expected = f"{' x '.join(map(str, shape))} = {size}, by its breakpoints"
            raise data.fault(f"{values.size} numbers in table {identifier}", expected)
        table = GriddedTable(identifier, tuple(axes), values.reshape(shape), **{**_named(element), **fields})
        self.gridded[identifier] = table
        return identifier

    def read_breakpoints(self, element: Element) -> None:
        """Add the breakpoints of a ``<breakpointDef>`` to `breakpoints`, by bpID."""
        element.permit(("name", "bpID", "units"), once=("description", "bpVals"))
        values = element.require("bpVals")
        identifier = self._identifier(element, "bpID")
        self._add_breakpoints(element, values, identifier, f"breakpoints {identifier}")

    def read_gridded_table(self, element: Element, base: str | None = None) -> str:
        """Add the table of a ``<griddedTableDef>`` or ``<griddedTable>`` to `gridded`; return its identifier.

        The identifier of a ``<griddedTableDef>`` is the gtID. A ``<griddedTable>``, which stands inside a function,
        gets a new identifier that starts with `base`.
        """
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
        identifier = self._identifier(element, "gtID", base)
        return self._add_grid(element, element.require("dataTable"), references, axes, identifier)

    def read_ungridded_table(self, element: Element, base: str | None = None) -> str:
        """Add the table of an ``<ungriddedTableDef>`` or ``<ungriddedTable>`` to `ungridded`; return its identifier.

        The identifier of an ``<ungriddedTableDef>`` is the utID. An ``<ungriddedTable>``, which stands inside a
        function, gets a new identifier that starts with `base`.
        """
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
        identifier, table = self._identifier(element, "utID", base), np.stack(points)
        self.ungridded[identifier] = UngriddedTable(identifier, table[:, :-1], table[:, -1], **_named(element))
        return identifier

    def read_function(self, element: Element) -> Function:
        """Return the function of a ``<function>`` element; a table inside the element is added to the tables."""
        element.permit(
            ("name",),
            once=("description", "provenance", "provenanceRef", "dependentVarPts", "dependentVarRef", "functionDefn"),
            repeatable=("independentVarPts", "independentVarRef"),
        )
        arguments = tuple(map(_argument, element.all("independentVarPts", "independentVarRef")))
        dependent = element.require("dependentVarRef", "dependentVarPts")
        result = dependent.attribute("varID")
        is_inline = dependent.tag == "dependentVarPts"
        expected, wrong = ("independentVarPts", "independentVarRef")[:: 1 if is_inline else -1]
        if element.first(wrong) is not None or not arguments:
            arrived = f"<{dependent.tag}> without <{expected}> for each argument"
            raise element.fault(arrived, f"<{expected}> and no other")
        read_table = self._read_inline_table if is_inline else self._read_function_table
        table = read_table(element, dependent, result)
        dimensions = len(self.gridded[table].axes) if table in self.gridded else self.ungridded[table].points.shape[1]
        if dimensions != len(arguments):
            arrived = f"{len(arguments)} arguments of a function with a table of {dimensions} axes"
            raise element.fault(arrived, "one argument for each axis")
        return Function(element.attribute("name"), result, arguments, table, **_documentation(element))

    def _read_inline_table(self, element: Element, dependent: Element, result: str) -> str:
        """Store breakpoints and table from inside a function (``<dependentVarPts>``); return the table's identifier."""
        dependent.permit(("varID", "name", "units", "sign"))
        axes = []
        for count, points in enumerate(element.all("independentVarPts"), start=1):
            identifier = self._identifier(points, "", f"points_{count}_of_{result}")
            axes.append(self._add_breakpoints(points, points, identifier, "independentVarPts", name=""))
        identifier = self._identifier(dependent, "", f"table_of_{result}")
        return self._add_grid(dependent, dependent, element, axes, identifier, name="")

    def _read_function_table(self, element: Element, _dependent: Element, result: str) -> str:
        """Return the identifier of the table in a ``<functionDefn>``; store the table if the element contains it."""
        definition = element.require("functionDefn")
        definition.permit(("name",), once=_TABLES)
        if len(definition.children) != 1:
            raise definition.fault(f"{len(definition.children)} tables in <functionDefn>", "one")
        table = definition.children[0]
        is_gridded = table.tag.startswith("gridded")
        if not table.tag.endswith("Ref"):
            read_table = self.read_gridded_table if is_gridded else self.read_ungridded_table
            return read_table(table, f"table_of_{result}")
        attribute, kind = ("gtID", "griddedTableDef") if is_gridded else ("utID", "ungriddedTableDef")
        tables, other_tables = (self.gridded, self.ungridded)[:: 1 if is_gridded else -1]
        table.permit((attribute,))
        identifier = table.attribute(attribute)
        if identifier not in tables:
            hint = ": this is the other kind of table" if identifier in other_tables else ""
            raise table.fault(f"{attribute} {quote(identifier)}", f"the {attribute} of a <{kind}>{hint}")
        return identifier


def _argument(element: Element) -> Argument:
    is_inline = element.tag == "independentVarPts"
    limits_or_names = ("name", "units", "sign") if is_inline else ("min", "max")
    element.permit(("varID", "extrapolate", "interpolate", *limits_or_names))
    extrapolate = element.attributes.get("extrapolate", "neither").strip()
    interpolate = element.attributes.get("interpolate", "linear").strip()
    spline_hint = ": DAVE-ML leaves open which spline it is" if interpolate in _SPLINES else ""
    if extrapolate not in _EXTRAPOLATE:
        raise element.fault(f"extrapolate={quote(extrapolate)}", " or ".join(_EXTRAPOLATE))
    if interpolate not in _INTERPOLATE:
        raise element.fault(f"interpolate={quote(interpolate)}", f"{' or '.join(_INTERPOLATE)}{spline_hint}")
    minimum, maximum = _limits(element, "min", "max")
    identifier = element.attribute("varID")
    return Argument(identifier, minimum, maximum, cast(Extrapolate, extrapolate), cast(Interpolate, interpolate))


def parse_shots(checks: Element, variables: Mapping[str, Variable]) -> tuple[Shot, ...]:
    """Return the check shots in a ``<checkData>`` element, in file order.

    Raises DaveMlError if a signal is repeated, or its variable, value, units or tolerance is wrong.
    """
    checks.permit(once=("provenance", "provenanceRef"), repeatable=("staticShot",))
    by_name: dict[str, list[str]] = {}
    for variable in variables.values():
        by_name.setdefault(variable.name, []).append(variable.id)
    return tuple(_shot(element, variables, by_name) for element in checks.all("staticShot"))


def _shot(element: Element, variables: Mapping[str, Variable], by_name: Mapping[str, list[str]]) -> Shot:
    tags = ("checkInputs", "internalValues", "checkOutputs")
    element.permit(("name", "refID"), once=("description", "provenance", "provenanceRef", *tags))
    signals: dict[str, dict[str, Signal]] = {tag: {} for tag in tags}
    for part in (child for tag in tags for child in element.all(tag)):
        part.permit(repeatable=("signal",))
        children = part.all("signal")
        for child, signal in [(child, _signal(child, variables, by_name)) for child in children]:
            if signal.id in signals[part.tag]:
                raise child.fault(f"a second <signal> of {quote(signal.id)} in <{part.tag}>", "one")
            signals[part.tag][signal.id] = signal
    element.require("checkOutputs")
    inputs, internal, outputs = (tuple(signals[tag].values()) for tag in tags)
    documentation = _documentation(element)
    del documentation["location"]
    return Shot(
        element.attribute("name"), inputs, outputs, internal, element.attributes.get("refID", ""), **documentation
    )


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
            arrived = f"signal {quote(name)}, a name of {len(matches)} variables"
            raise name_element.fault(arrived, "the name of one variable")
        identifier = matches[0]
    units = element.first("signalUnits")
    tolerance = element.first("tol")
    value = element.require("signalValue")
    limit = None if tolerance is None else parse_number(tolerance.text, tolerance, "a tolerance")
    if tolerance is not None and limit is not None and limit < 0.0:
        raise tolerance.fault(f"a tolerance of {limit:g}", "0 or more")
    variable = variables[identifier]
    signal_units = variable.units if units is None else units.text.strip()
    if units is not None and not is_convertible(signal_units, variable.units):
        arrived = f"units {quote(signal_units)} of {quote(variable.name)} (varID {quote(identifier)})"
        raise units.fault(arrived, f"units that convert to those of the variable, {quote(variable.units)}")
    return Signal(identifier, parse_number(value.text, value, "a value"), signal_units, limit)


def parse_definition(content: str | bytes, name: str) -> Definition:
    """Return the definition in a DAVE-ML file, a text or bytes in the declared encoding; `name` is the file name.

    Raises DaveMlError if the text is not DAVE-ML, contains an unknown element, or contradicts itself.
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
            line = variables[variable.id].location.line
            arrived = f"a second varID {quote(variable.id)}, the first in line {line}"
            raise element.fault(arrived, "an identifier of its own")
        refuse_nonstandard_units(variable)
        variables[variable.id] = variable
    if not variables:
        raise root.fault("no <variableDef>", "at least one")
    tables = TableReader(used_identifiers=variables)
    for element in root.all("breakpointDef"):
        tables.read_breakpoints(element)
    for element in root.all("griddedTableDef"):
        tables.read_gridded_table(element)
    for element in root.all("ungriddedTableDef"):
        tables.read_ungridded_table(element)
    functions = tuple(map(tables.read_function, root.all("function")))
    checks = root.first("checkData")
    header = root.first("fileHeader")
    return Definition(
        file=name,
        header=Note("fileHeader") if header is None else _note(header),
        variables=variables,
        breakpoints=tables.breakpoints,
        gridded=tables.gridded,
        ungridded=tables.ungridded,
        functions=functions,
        shots=() if checks is None else parse_shots(checks, variables),
        check_notes=() if checks is None else tuple(map(_note, checks.all("provenance", "provenanceRef"))),
    )


_TEXT_ATTRIBUTES: Final = {"axisSystem": "axis_system", "sign": "sign", "alias": "alias", "symbol": "symbol"}
"""Optional attributes of a ``<variableDef>``, with the corresponding fields of `Variable`."""


def _variable(element: Element) -> Variable:
    element.permit(
        ("name", "varID", "units", *_TEXT_ATTRIBUTES, "initialValue", "minValue", "maxValue"),
        once=("description", "provenance", "provenanceRef", "calculation", "uncertainty", *ROLES),
    )
    calculation = element.first("calculation")
    formula = None
    if calculation is not None:
        calculation.permit(once=("math",))
        formula = parse_formula(calculation.require("math"))
    minimum, maximum = _limits(element, "minValue", "maxValue")
    return Variable(
        id=element.attribute("varID"),
        name=element.attribute("name"),
        units=element.attribute("units"),
        initial=optional_number(element, "initialValue"),
        minimum=minimum,
        maximum=maximum,
        formula=formula,
        roles=frozenset(role for role in ROLES if element.first(role) is not None),
        **{field: element.attributes.get(attribute, "") for attribute, field in _TEXT_ATTRIBUTES.items()},
        **_documentation(element),
    )
