"""Content MathML 2 to formulas and back (DAVE-ML 2.0.2 reference, section 6.2.2; MathML 2.0, section 4.4)."""

import math
from typing import Final
from xml.sax.saxutils import escape

from anser.dave_ml.elements import Element
from anser.dave_ml.errors import shown
from anser.dave_ml.formulas import MANY, OPERATIONS, Applied, Chosen, Formula, Named, Number
from anser.dave_ml.numbers import number_of

_NAMESPACE: Final = "http://www.w3.org/1998/Math/MathML"
_ATAN2: Final = "http://daveml.org/function_spaces.html#atan2"
_CONSTANTS: Final = {"pi": math.pi, "exponentiale": math.e, "true": 1.0, "false": 0.0}
_NUMBER_TYPES: Final = {"real", "integer", "double", "constant"}
_QUALIFIERS: Final = {"root": "degree", "log": "logbase"}
_WHY_NOT: Final = {
    "quotient": "<divide/> or <floor/>: MathML's quotient is a whole number, NASA's example of it is not",
    "rem": "<floor/> and <minus/>: the sign of a remainder is not agreed upon",
}


def formula_of(math_element: Element) -> Formula:
    """The formula of a ``<math>`` element.

    Raises
    ------
    DaveMlError
        It holds not one formula, or an operation that is not known or has too few or many arguments.
    """
    return _formula(_single(math_element))


def _single(parent: Element) -> Element:
    if len(parent.children) != 1:
        raise parent.fault(f"{len(parent.children)} elements in <{parent.tag}>", "one")
    return parent.children[0]


def _formula(element: Element) -> Formula:
    if element.tag == "cn":
        return _number(element)
    if element.tag == "ci":
        element.permit(("type", "id", "class"))
        name = element.text.strip()
        if not name:
            raise element.fault("an empty <ci>", "the varID of a variable")
        return Named(name)
    if element.tag in _CONSTANTS:
        element.permit()
        return Number(_CONSTANTS[element.tag])
    if element.tag == "piecewise":
        return _piecewise(element)
    if element.tag == "apply":
        return _apply(element)
    raise element.fault(f"<{element.tag}> as a formula", "<apply>, <piecewise>, <cn>, <ci>, <pi/> or <exponentiale/>")


def _number(element: Element) -> Number:
    kind, base = element.attributes.get("type", "real"), element.attributes.get("base", "10")
    if kind not in _NUMBER_TYPES or base != "10":
        raise element.fault(f"a number of type {shown(kind)}, base {shown(base)}", "a real number of base 10")
    element.permit(("type", "base", "id", "class"))
    return Number(number_of(element.text, element, "a number"))


def _piecewise(element: Element) -> Chosen:
    element.permit(once=("otherwise",), many=("piece",))
    pieces = []
    for piece in element.all("piece"):
        if len(piece.children) != 2:
            raise piece.fault(f"{len(piece.children)} elements in <piece>", "a value and its condition")
        pieces.append((_formula(piece.children[0]), _formula(piece.children[1])))
    otherwise = element.first("otherwise")
    if otherwise is None:
        raise element.fault("<piecewise> without <otherwise>", "a value where no condition holds")
    return Chosen(tuple(pieces), _formula(_single(otherwise)))


def _apply(element: Element) -> Formula:
    if not element.children:
        raise element.fault("an empty <apply>", "an operation and its arguments")
    head, *arguments = element.children
    if head.tag == "piecewise" and not arguments:
        return _piecewise(head)  # as NASA's files write it
    operation = _operation(head)
    given = [_formula(argument) for argument in arguments if argument.tag != _QUALIFIERS.get(operation)]
    qualifiers = [argument for argument in arguments if argument.tag == _QUALIFIERS.get(operation)]
    if qualifiers and len(given) != 1:
        raise element.fault(f"<{operation}/> of {len(given)} arguments", "one")
    given += [_formula(_single(qualifier)) for qualifier in qualifiers]
    least, most = OPERATIONS[operation]
    if not least <= len(given) <= most or (operation in _QUALIFIERS and len(given) == 2 and not qualifiers):
        right = f"{least}" if least == most else f"{least} or more" if most == MANY else f"{least} or {most}"
        if operation in _QUALIFIERS:
            right = f"1, and <{_QUALIFIERS[operation]}> where it is another than usual"
        raise element.fault(f"<{operation}/> of {len(given)} arguments", right)
    return Applied(operation, tuple(given))


def _operation(head: Element) -> str:
    if head.tag == "csymbol":
        if head.text.strip() == "atan2":
            return "atan2"
        raise head.fault(f"function {shown(head.text.strip())}", "atan2, the one that DAVE-ML adds to those of MathML")
    if head.tag in OPERATIONS and head.tag != "atan2":
        head.permit()
        return head.tag
    known = ", ".join(sorted(set(OPERATIONS) - {"atan2"}))
    raise head.fault(
        f"<{head.tag}> as an operation", _WHY_NOT.get(head.tag, f"one of {known}, or atan2 as a <csymbol>")
    )


def mathml_of(formula: Formula) -> str:
    """A ``<math>`` element of a formula."""
    return f'<math xmlns="{_NAMESPACE}">{_written(formula)}</math>'


def _written(formula: Formula) -> str:
    if isinstance(formula, Number):
        return f"<cn>{formula.value!r}</cn>"
    if isinstance(formula, Named):
        return f"<ci>{escape(formula.id)}</ci>"
    if isinstance(formula, Chosen):
        pieces = "".join(f"<piece>{_written(v)}{_written(c)}</piece>" for v, c in formula.pieces)
        return f"<piecewise>{pieces}<otherwise>{_written(formula.otherwise)}</otherwise></piecewise>"
    head = f"<{formula.operation}/>"
    arguments = [_written(argument) for argument in formula.arguments]
    if formula.operation == "atan2":
        head = f'<csymbol definitionURL="{_ATAN2}" encoding="text">atan2</csymbol>'
    if formula.operation in _QUALIFIERS and len(arguments) == 2:
        qualifier = _QUALIFIERS[formula.operation]
        arguments = [f"<{qualifier}>{arguments[1]}</{qualifier}>", arguments[0]]
    return f"<apply>{head}{''.join(arguments)}</apply>"
