"""Formulas of DAVE-ML: as plain data, and converted from and to content MathML 2.

DAVE-ML 2.0.2 reference, section 6.2.2; MathML 2.0, section 4.4.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final, TypeAlias
from xml.sax.saxutils import escape

from anser.dave_ml.elements import Element, parse_number, quote


@dataclass(frozen=True, slots=True)
class Number:
    """Constant in a formula."""

    value: float


@dataclass(frozen=True, slots=True)
class VariableReference:
    """Reference to a variable by varID."""

    id: str


@dataclass(frozen=True, slots=True)
class Operation:
    """Operation of `OPERATIONS` with its arguments."""

    operation: str
    arguments: tuple["Formula", ...]


@dataclass(frozen=True, slots=True)
class Piecewise:
    """Formula with conditions: the value of the first piece whose condition is true.

    Attributes
    ----------
    pieces
        Pairs of value and condition.
    otherwise
        Value if no condition is true.
    """

    pieces: tuple[tuple["Formula", "Formula"], ...]
    otherwise: "Formula"


Formula: TypeAlias = Number | VariableReference | Operation | Piecewise

ARGUMENTS_MAX: Final = 1000
"""Greatest number of arguments of operations such as the sum."""
NUMERIC: Final = {
    "plus": (1, ARGUMENTS_MAX),
    "minus": (1, 2),
    "times": (1, ARGUMENTS_MAX),
    "divide": (2, 2),
    "power": (2, 2),
    "root": (1, 2),
    "exp": (1, 1),
    "ln": (1, 1),
    "log": (1, 2),
    "abs": (1, 1),
    "floor": (1, 1),
    "ceiling": (1, 1),
    "min": (1, ARGUMENTS_MAX),
    "max": (1, ARGUMENTS_MAX),
    "atan2": (2, 2),
    **dict.fromkeys(("sin", "cos", "tan", "sec", "csc", "cot"), (1, 1)),
    **dict.fromkeys(("arcsin", "arccos", "arctan", "arcsec", "arccsc", "arccot"), (1, 1)),
    **dict.fromkeys(("sinh", "cosh", "tanh", "sech", "csch", "coth"), (1, 1)),
    **dict.fromkeys(("arcsinh", "arccosh", "arctanh", "arcsech", "arccsch", "arccoth"), (1, 1)),
}
"""Operations with a numeric result, and their least and greatest number of arguments.

The second argument of ``root`` is the degree, of ``log`` the base."""
COMPARISONS: Final = {
    **dict.fromkeys(("lt", "leq", "gt", "geq", "eq"), (2, ARGUMENTS_MAX)),
    "neq": (2, 2),
}
"""Comparisons; with more than two arguments, each argument is compared with the next."""
LOGICAL: Final = {"and": (1, ARGUMENTS_MAX), "or": (1, ARGUMENTS_MAX), "xor": (1, ARGUMENTS_MAX), "not": (1, 1)}
OPERATIONS: Final = {**NUMERIC, **COMPARISONS, **LOGICAL}


def variables_in(formula: Formula) -> Iterator[str]:
    """Yield the varIDs of the variables in a formula."""
    if isinstance(formula, VariableReference):
        yield formula.id
    elif isinstance(formula, Operation):
        for argument in formula.arguments:
            yield from variables_in(argument)
    elif isinstance(formula, Piecewise):
        for value, condition in formula.pieces:
            yield from variables_in(value)
            yield from variables_in(condition)
        yield from variables_in(formula.otherwise)


def is_logical(formula: Formula) -> bool:
    """Whether the result of a formula is a truth value."""
    return isinstance(formula, Operation) and formula.operation not in NUMERIC


class Arithmetic:
    """Evaluation of formulas with an array library.

    Parameters
    ----------
    operations
        Function of each operation, by name.
    power
        Power with a constant exponent: function of base and exponent.
    select
        Function of a condition and two values.
    """

    def __init__(
        self,
        operations: Mapping[str, Callable[..., Any]],
        power: Callable[[Any, float], Any],
        select: Callable[[Any, Any, Any], Any],
    ) -> None:
        self._operations = operations
        self._power = power
        self._select = select

    def value_of(self, formula: Formula, values: Mapping[str, Any]) -> Any:
        """Return the numeric value of a formula; a truth value gives 1 or 0."""
        if isinstance(formula, Number):
            return formula.value
        if isinstance(formula, VariableReference):
            return values[formula.id]
        if isinstance(formula, Piecewise):
            chosen = self.value_of(formula.otherwise, values)
            for value, condition in reversed(formula.pieces):
                chosen = self._select(self._truth_of(condition, values), self.value_of(value, values), chosen)
            return chosen
        if is_logical(formula):
            return self._select(self._truth_of(formula, values), 1.0, 0.0)
        arguments = [self.value_of(argument, values) for argument in formula.arguments]
        exponent = formula.arguments[-1]
        if formula.operation == "power" and isinstance(exponent, Number):
            return self._power(arguments[0], exponent.value)
        return self._operations[formula.operation](*arguments)

    def _truth_of(self, formula: Formula, values: Mapping[str, Any]) -> Any:
        """Return the truth value of a formula; a non-zero number is true."""
        if not (isinstance(formula, Operation) and is_logical(formula)):
            return self._operations["neq"](self.value_of(formula, values), 0.0)
        if formula.operation in LOGICAL:
            truths = [self._truth_of(argument, values) for argument in formula.arguments]
            return self._operations[formula.operation](*truths)
        numbers = [self.value_of(argument, values) for argument in formula.arguments]
        compare = self._operations[formula.operation]
        pairs = [compare(a, b) for a, b in pairwise(numbers)]
        return self._operations["and"](*pairs)


_NAMESPACE: Final = "http://www.w3.org/1998/Math/MathML"
_ATAN2: Final = "http://daveml.org/function_spaces.html#atan2"
_CONSTANTS: Final = {"pi": math.pi, "exponentiale": math.e, "true": 1.0, "false": 0.0}
_NUMBER_TYPES: Final = {"real", "integer", "double", "constant"}
_QUALIFIERS: Final = {"root": "degree", "log": "logbase"}
_ALTERNATIVES: Final = {
    "quotient": "<divide/> or <floor/>: MathML's quotient is a whole number, NASA's example of it is not",
    "rem": "<floor/> and <minus/>: the sign of a remainder is not agreed upon",
}


def parse_formula(math_element: Element) -> Formula:
    """Read the formula of a ``<math>`` element.

    Raises
    ------
    DaveMlError
        If the element does not contain exactly one formula, an operation is unknown, or its number of arguments is
        wrong.
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
        return VariableReference(name)
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
        raise element.fault(f"a number of type {quote(kind)}, base {quote(base)}", "a real number of base 10")
    element.permit(("type", "base", "id", "class"))
    return Number(parse_number(element.text, element, "a number"))


def _piecewise(element: Element) -> Piecewise:
    element.permit(once=("otherwise",), repeatable=("piece",))
    pieces = []
    for piece in element.all("piece"):
        if len(piece.children) != 2:
            raise piece.fault(f"{len(piece.children)} elements in <piece>", "a value and its condition")
        pieces.append((_formula(piece.children[0]), _formula(piece.children[1])))
    otherwise = element.first("otherwise")
    if otherwise is None:
        raise element.fault("<piecewise> without <otherwise>", "a value where no condition holds")
    return Piecewise(tuple(pieces), _formula(_single(otherwise)))


def _apply(element: Element) -> Formula:
    if not element.children:
        raise element.fault("an empty <apply>", "an operation and its arguments")
    head, *arguments = element.children
    if head.tag == "piecewise" and not arguments:
        return _piecewise(head)  # form used in NASA files
    operation = _operation(head)
    operands = [_formula(argument) for argument in arguments if argument.tag != _QUALIFIERS.get(operation)]
    qualifiers = [argument for argument in arguments if argument.tag == _QUALIFIERS.get(operation)]
    if qualifiers and len(operands) != 1:
        raise element.fault(f"<{operation}/> of {len(operands)} arguments", "one")
    operands += [_formula(_single(qualifier)) for qualifier in qualifiers]
    count_min, count_max = OPERATIONS[operation]
    if not count_min <= len(operands) <= count_max or (
        operation in _QUALIFIERS and len(operands) == 2 and not qualifiers
    ):
        if operation in _QUALIFIERS:
            expected = f"1, and <{_QUALIFIERS[operation]}> where it is another than usual"
        elif count_max == ARGUMENTS_MAX:
            expected = f"{count_min} or more"
        else:
            expected = " or ".join(dict.fromkeys((str(count_min), str(count_max))))
        raise element.fault(f"<{operation}/> of {len(operands)} arguments", expected)
    return Operation(operation, tuple(operands))


def _operation(head: Element) -> str:
    if head.tag == "csymbol":
        if head.text.strip() == "atan2":
            return "atan2"
        raise head.fault(f"function {quote(head.text.strip())}", "atan2, the one that DAVE-ML adds to those of MathML")
    if head.tag in OPERATIONS and head.tag != "atan2":
        head.permit()
        return head.tag
    operations = ", ".join(sorted(set(OPERATIONS) - {"atan2"}))
    raise head.fault(
        f"<{head.tag}> as an operation", _ALTERNATIVES.get(head.tag, f"one of {operations}, or atan2 as a <csymbol>")
    )


def format_mathml(formula: Formula) -> str:
    """Format a formula as a ``<math>`` element."""
    return f'<math xmlns="{_NAMESPACE}">{_format_formula(formula)}</math>'


def _format_formula(formula: Formula) -> str:
    if isinstance(formula, Number):
        return f"<cn>{formula.value!r}</cn>"
    if isinstance(formula, VariableReference):
        return f"<ci>{escape(formula.id)}</ci>"
    if isinstance(formula, Piecewise):
        pieces = "".join(f"<piece>{_format_formula(v)}{_format_formula(c)}</piece>" for v, c in formula.pieces)
        return f"<piecewise>{pieces}<otherwise>{_format_formula(formula.otherwise)}</otherwise></piecewise>"
    head = f"<{formula.operation}/>"
    arguments = [_format_formula(argument) for argument in formula.arguments]
    if formula.operation == "atan2":
        head = f'<csymbol definitionURL="{_ATAN2}" encoding="text">atan2</csymbol>'
    if formula.operation in _QUALIFIERS and len(arguments) == 2:
        qualifier = _QUALIFIERS[formula.operation]
        arguments = [f"<{qualifier}>{arguments[1]}</{qualifier}>", arguments[0]]
    return f"<apply>{head}{''.join(arguments)}</apply>"
