"""Check shots of a DAVE-ML file (reference, section 6.2.7)."""

from collections.abc import Mapping

from anser.dave_ml.definition import Shot, Signal, Variable
from anser.dave_ml.elements import Element
from anser.dave_ml.errors import shown
from anser.dave_ml.numbers import number_of
from anser.dave_ml.reading_text import description_of, notes_of
from anser.dave_ml.unit_names import converts


def shots_of(checks: Element, variables: Mapping[str, Variable]) -> tuple[Shot, ...]:
    """The shots of ``<checkData>``, their signals by varID.

    Raises
    ------
    DaveMlError
        A signal is no variable of the file, or its value no number.
    """
    checks.permit(once=("provenance", "provenanceRef"), many=("staticShot",))
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
            part.permit(many=("signal",))
            parts[tag] = tuple(_signal(signal, variables, by_name) for signal in part.all("signal"))
            _once_each(part, parts[tag])
    element.require("checkOutputs")
    return Shot(
        name=element.attribute("name"),
        inputs=parts.get("checkInputs", ()),
        outputs=parts["checkOutputs"],
        internal=parts.get("internalValues", ()),
        reference=element.attributes.get("refID", ""),
        description=description_of(element),
        notes=notes_of(element),
    )


def _once_each(part: Element, signals: tuple[Signal, ...]) -> None:
    seen: set[str] = set()
    for element, signal in zip(part.all("signal"), signals, strict=True):
        if signal.id in seen:
            raise element.fault(f"a second <signal> of {shown(signal.id)} in <{part.tag}>", "one")
        seen.add(signal.id)


def _signal(element: Element, variables: Mapping[str, Variable], by_name: Mapping[str, list[str]]) -> Signal:
    element.permit(once=("signalName", "signalUnits", "varID", "signalID", "signalValue", "tol"))
    identified = element.first("varID", "signalID")
    if identified is not None:
        identifier = identified.text.strip()
        if identifier not in variables:
            raise identified.fault(f"varID {shown(identifier)}", "the varID of a variable of this file")
    else:
        named = element.require("signalName", "varID")
        name = named.text.strip()
        found = by_name.get(name, [])
        if len(found) != 1:
            raise named.fault(f"signal {shown(name)}, a name of {len(found)} variables", "the name of one variable")
        identifier = found[0]
    units = element.first("signalUnits")
    tolerance = element.first("tol")
    value = element.require("signalValue")
    limit = None if tolerance is None else number_of(tolerance.text, tolerance, "a tolerance")
    if tolerance is not None and limit is not None and limit < 0.0:
        raise tolerance.fault(f"a tolerance of {limit:g}", "0 or more")
    variable = variables[identifier]
    if units is not None and not converts(units.text.strip(), variable.units):
        arrived = f"units {shown(units.text.strip())} of {shown(variable.name)} (varID {shown(identifier)})"
        raise units.fault(arrived, f"units that convert to those of the variable, {shown(variable.units)}")
    return Signal(
        id=identifier,
        value=number_of(value.text, value, "a value"),
        units=variable.units if units is None else units.text.strip(),
        tolerance=limit,
    )
