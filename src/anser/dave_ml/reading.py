"""DAVE-ML text to plain data."""

from anser.dave_ml.definition import ROLES, Definition, Note, Variable, place_of
from anser.dave_ml.elements import Element, parse_elements
from anser.dave_ml.errors import DaveMlError, shown
from anser.dave_ml.mathml import formula_of
from anser.dave_ml.numbers import optional_number
from anser.dave_ml.reading_shots import shots_of
from anser.dave_ml.reading_tables import TableReader
from anser.dave_ml.reading_text import description_of, notes_of, whole_note
from anser.dave_ml.standard_names import refuse_nonstandard_units

_VARIABLE_ATTRIBUTES = (
    "name", "varID", "units", "axisSystem", "sign", "alias", "symbol", "initialValue", "minValue", "maxValue",
)  # fmt: skip


def definition_of(content: str | bytes, name: str) -> Definition:
    """What a DAVE-ML file says.

    Parameters
    ----------
    content
        The file's text, or its bytes in the encoding that it declares.
    name
        What errors call it.

    Raises
    ------
    DaveMlError
        It is no DAVE-ML file, or says something that is not known or contradicts itself.
    """
    root = parse_elements(content, name)
    if root.tag != "DAVEfunc":
        raise root.fault(f"<{root.tag}>", "<DAVEfunc>")
    root.permit(
        (),
        once=("fileHeader", "checkData"),
        many=("variableDef", "breakpointDef", "griddedTableDef", "ungriddedTableDef", "function"),
    )
    variables: dict[str, Variable] = {}
    for element in root.all("variableDef"):
        variable = _variable(element)
        if variable.id in variables:
            raise _twice(element, variable.id, variables[variable.id].place.line)
        refuse_nonstandard_units(variable)
        variables[variable.id] = variable
    if not variables:
        raise root.fault("no <variableDef>", "at least one")
    tables = TableReader(taken=set(variables))
    for element in root.all("breakpointDef"):
        tables.breakpoints_of(element)
    for element in root.all("griddedTableDef"):
        tables.gridded_of(element)
    for element in root.all("ungriddedTableDef"):
        tables.ungridded_of(element)
    functions = tuple(tables.function_of(element) for element in root.all("function"))
    checks = root.first("checkData")
    header = root.first("fileHeader")
    return Definition(
        file=name,
        header=Note("fileHeader") if header is None else whole_note(header),
        variables=variables,
        breakpoints=tables.breakpoints,
        gridded=tables.gridded,
        ungridded=tables.ungridded,
        functions=functions,
        shots=() if checks is None else shots_of(checks, variables),
    )


def _twice(element: Element, identifier: str, line: int | None) -> DaveMlError:
    return element.fault(f"a second varID {shown(identifier)}, the first in line {line}", "an identifier of its own")


def _variable(element: Element) -> Variable:
    element.permit(
        _VARIABLE_ATTRIBUTES,
        once=("description", "provenance", "provenanceRef", "calculation", "uncertainty", *ROLES),
    )
    calculation = element.first("calculation")
    formula = None
    if calculation is not None:
        calculation.permit(once=("math",))
        formula = formula_of(calculation.require("math"))
    given = element.attributes
    least, greatest = optional_number(element, "minValue"), optional_number(element, "maxValue")
    if least is not None and greatest is not None and least > greatest:
        raise element.fault(f"minValue {least:g} above maxValue {greatest:g}", "minValue of at most maxValue")
    return Variable(
        id=element.attribute("varID"),
        name=element.attribute("name"),
        units=element.attribute("units"),
        description=description_of(element),
        axis_system=given.get("axisSystem", ""),
        sign=given.get("sign", ""),
        alias=given.get("alias", ""),
        symbol=given.get("symbol", ""),
        initial=optional_number(element, "initialValue"),
        least=least,
        greatest=greatest,
        formula=formula,
        roles=frozenset(role for role in ROLES if element.first(role) is not None),
        notes=notes_of(element),
        place=place_of(element),
    )
