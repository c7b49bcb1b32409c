"""Breakpoints, tables and functions of a DAVE-ML file (reference, sections 6.2.3 to 6.2.6)."""

from typing import Final, cast

import numpy as np

from anser.dave_ml.definition import (
    Argument,
    Breakpoints,
    Extrapolate,
    Function,
    GriddedTable,
    Interpolate,
    UngriddedTable,
    place_of,
)
from anser.dave_ml.elements import Element
from anser.dave_ml.errors import shown
from anser.dave_ml.numbers import TABLE_NUMBERS_MAX, numbers_of, optional_number
from anser.dave_ml.reading_text import NOTES, description_of, notes_of

AXES_MAX: Final = 8
"""Axes of one table."""
_EXTRAPOLATE: Final = ("neither", "min", "max", "both")
_INTERPOLATE: Final = ("linear", "discrete", "floor", "ceiling")
_SPLINES: Final = ("quadraticSpline", "cubicSpline")
_TABLES: Final = (
    "griddedTableRef", "griddedTableDef", "griddedTable", "ungriddedTableRef", "ungriddedTableDef", "ungriddedTable",
)  # fmt: skip


class TableReader:
    """Reads tables, and keeps what it has read by identifier.

    Parameters
    ----------
    taken
        Identifiers that tables and breakpoints may not have.
    """

    def __init__(self, taken: set[str]) -> None:
        self.breakpoints: dict[str, Breakpoints] = {}
        self.gridded: dict[str, GriddedTable] = {}
        self.ungridded: dict[str, UngriddedTable] = {}
        self._taken = set(taken)

    def _identified(self, element: Element, attribute: str) -> str:
        identifier = element.attribute(attribute)
        if identifier in self._taken:
            raise element.fault(f"a second {attribute} {shown(identifier)}", "an identifier of its own")
        self._taken.add(identifier)
        return identifier

    def _fresh(self, wanted: str) -> str:
        identifier, count = wanted, 1
        while identifier in self._taken:
            count += 1
            identifier = f"{wanted}_{count}"
        self._taken.add(identifier)
        return identifier

    def breakpoints_of(self, element: Element) -> None:
        """Read a ``<breakpointDef>``."""
        element.permit(("name", "bpID", "units"), once=("description", "bpVals"))
        values = element.require("bpVals")
        identifier = self._identified(element, "bpID")
        self.breakpoints[identifier] = Breakpoints(
            id=identifier,
            points=_increasing(values, numbers_of(values, f"breakpoints {identifier}")),
            name=element.attributes.get("name", ""),
            units=element.attributes.get("units", "").strip(),
            description=description_of(element),
            place=place_of(element),
        )

    def gridded_of(self, element: Element, fallback: str = "table") -> str:
        """Read a ``<griddedTableDef>``; its identifier, made from a given one where it has none of its own."""
        element.permit(("name", "gtID", "units"), once=("description", "breakpointRefs", "dataTable", *NOTES))
        axes = []
        references = element.require("breakpointRefs")
        references.permit(many=("bpRef",))
        for reference in references.all("bpRef"):
            reference.permit(("bpID",))
            axis = reference.attribute("bpID")
            if axis not in self.breakpoints:
                raise reference.fault(f"bpID {shown(axis)}", "the bpID of a <breakpointDef>")
            axes.append(axis)
        identifier = self._own_or_fresh(element, "gtID", fallback)
        self.gridded[identifier] = GriddedTable(
            id=identifier,
            axes=tuple(axes),
            values=self._shaped(element.require("dataTable"), references, axes, identifier),
            name=element.attributes.get("name", ""),
            units=element.attributes.get("units", "").strip(),
            description=description_of(element),
            notes=notes_of(element),
            place=place_of(element),
        )
        return identifier

    def _own_or_fresh(self, element: Element, attribute: str, fallback: str) -> str:
        return self._identified(element, attribute) if element.tag.endswith("Def") else self._fresh(fallback)

    def _shaped(self, data: Element, axes_element: Element, axes: list[str], what: str) -> np.ndarray:
        """Values of a table in the shape of its axes; the last changes fastest."""
        if not 1 <= len(axes) <= AXES_MAX:
            raise axes_element.fault(f"{len(axes)} axes of table {what}", f"1 to {AXES_MAX}")
        shape = tuple(self.breakpoints[axis].points.size for axis in axes)
        values = numbers_of(data, f"table {what}")
        size = int(np.prod([float(n) for n in shape]))
        if values.size != size:
            by = " x ".join(str(n) for n in shape)
            raise data.fault(f"{values.size} numbers in table {what}", f"{by} = {size}, by its breakpoints")
        return values.reshape(shape)

    def ungridded_of(self, element: Element, fallback: str = "table") -> str:
        """Read an ``<ungriddedTableDef>``; its identifier, made from a given one where it has none of its own."""
        element.permit(("name", "utID", "units"), once=("description", *NOTES), many=("dataPoint",))
        rows: list[np.ndarray] = []
        for point in element.all("dataPoint"):
            point.permit(("modID",))
            row = numbers_of(point, "a point of a table")
            if row.size < 2 or (rows and row.size != rows[0].size):
                right = f"{rows[0].size}, as before" if rows else "coordinates and a value: 2 or more"
                raise point.fault(f"{row.size} numbers of a point", right)
            rows.append(row)
        if not rows:
            raise element.fault("an <ungriddedTableDef> without <dataPoint>", "points")
        if rows[0].size - 1 > AXES_MAX or len(rows) * rows[0].size > TABLE_NUMBERS_MAX:
            right = f"at most {AXES_MAX} coordinates and {TABLE_NUMBERS_MAX:,} numbers in all"
            raise element.fault(f"{len(rows)} points of {rows[0].size} numbers", right)
        identifier = self._own_or_fresh(element, "utID", fallback)
        table = np.stack(rows)
        self.ungridded[identifier] = UngriddedTable(
            id=identifier,
            points=table[:, :-1],
            values=table[:, -1],
            name=element.attributes.get("name", ""),
            units=element.attributes.get("units", "").strip(),
            description=description_of(element),
            notes=notes_of(element),
            place=place_of(element),
        )
        return identifier

    def function_of(self, element: Element) -> Function:
        """Read a ``<function>``; its table is kept under an identifier."""
        element.permit(
            ("name",),
            once=("description", "provenance", "provenanceRef", "dependentVarPts", "dependentVarRef", "functionDefn"),
            many=("independentVarPts", "independentVarRef"),
        )
        arguments = [_argument(child) for child in element.all("independentVarPts", "independentVarRef")]
        dependent = element.require("dependentVarRef", "dependentVarPts")
        result = dependent.attribute("varID")
        simple = dependent.tag == "dependentVarPts"
        wrong = element.first("independentVarRef" if simple else "independentVarPts")
        if wrong is not None or not arguments:
            right = "independentVarPts" if simple else "independentVarRef"
            raise element.fault(f"<{dependent.tag}> without <{right}> for each argument", f"<{right}> and no other")
        table = self._simple(element, dependent, result) if simple else self._table_of(element, result)
        dimensions = len(self.gridded[table].axes) if table in self.gridded else self.ungridded[table].points.shape[1]
        if dimensions != len(arguments):
            arrived = f"{len(arguments)} arguments of a function with a table of {dimensions} axes"
            raise element.fault(arrived, "one argument for each axis")
        return Function(
            name=element.attribute("name"),
            result=result,
            arguments=tuple(arguments),
            table=table,
            description=description_of(element),
            notes=notes_of(element),
            place=place_of(element),
        )

    def _simple(self, element: Element, dependent: Element, result: str) -> str:
        """The table of a function that gives its points itself."""
        dependent.permit(("varID", "name", "units", "sign"))
        axes = []
        for count, points in enumerate(element.all("independentVarPts"), start=1):
            identifier = self._fresh(f"points_{count}_of_{result}")
            values = _increasing(points, numbers_of(points, "independentVarPts"))
            units = points.attributes.get("units", "").strip()
            self.breakpoints[identifier] = Breakpoints(identifier, values, units=units, place=place_of(points))
            axes.append(identifier)
        identifier = self._fresh(f"table_of_{result}")
        values = self._shaped(dependent, element, axes, identifier)
        self.gridded[identifier] = GriddedTable(
            identifier, tuple(axes), values, units=dependent.attributes.get("units", "").strip(),
            place=place_of(dependent),
        )  # fmt: skip
        return identifier

    def _table_of(self, element: Element, result: str) -> str:
        """The table that a ``<functionDefn>`` refers to or holds."""
        definition = element.require("functionDefn")
        definition.permit(("name",), once=_TABLES)
        if len(definition.children) != 1:
            raise definition.fault(f"{len(definition.children)} tables in <functionDefn>", "one")
        table = definition.children[0]
        if table.tag in ("griddedTableDef", "griddedTable"):
            return self.gridded_of(table, f"table_of_{result}")
        if table.tag in ("ungriddedTableDef", "ungriddedTable"):
            return self.ungridded_of(table, f"table_of_{result}")
        attribute, known, kind = (
            ("gtID", self.gridded, "griddedTableDef")
            if table.tag == "griddedTableRef"
            else ("utID", self.ungridded, "ungriddedTableDef")
        )
        table.permit((attribute,))
        identifier = table.attribute(attribute)
        if identifier not in known:
            other = self.ungridded if known is self.gridded else self.gridded
            hint = ": this is the other kind of table" if identifier in other else ""
            raise table.fault(f"{attribute} {shown(identifier)}", f"the {attribute} of a <{kind}>{hint}")
        return identifier


def _argument(element: Element) -> Argument:
    simple = element.tag == "independentVarPts"
    element.permit(("varID", "extrapolate", "interpolate", *(("name", "units", "sign") if simple else ("min", "max"))))
    extrapolate = element.attributes.get("extrapolate", "neither").strip()
    interpolate = element.attributes.get("interpolate", "linear").strip()
    if extrapolate not in _EXTRAPOLATE:
        raise element.fault(f"extrapolate={shown(extrapolate)}", " or ".join(_EXTRAPOLATE))
    if interpolate in _SPLINES:
        right = f"{' or '.join(_INTERPOLATE)}: DAVE-ML leaves open which spline it is"
        raise element.fault(f"interpolate={shown(interpolate)}", right)
    if interpolate not in _INTERPOLATE:
        raise element.fault(f"interpolate={shown(interpolate)}", " or ".join(_INTERPOLATE))
    least, greatest = optional_number(element, "min"), optional_number(element, "max")
    if least is not None and greatest is not None and least > greatest:
        raise element.fault(f"min {least:g} above max {greatest:g}", "min of at most max")
    identifier = element.attribute("varID")
    return Argument(identifier, least, greatest, cast(Extrapolate, extrapolate), cast(Interpolate, interpolate))


def _increasing(element: Element, points: np.ndarray) -> np.ndarray:
    """Breakpoints that strictly increase."""
    steps = np.diff(points)
    if not np.all(steps > 0.0):
        k = int(np.flatnonzero(~(steps > 0.0))[0])
        raise element.fault(f"breakpoint {points[k + 1]:g} after {points[k]:g}", "strictly increasing breakpoints")
    return points
