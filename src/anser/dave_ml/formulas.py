"""Formulas of DAVE-ML as plain data, their conversion from and to content MathML 2, and their evaluation.

Sources: DAVE-ML 2.0.2 reference, section 6.2.2; MathML 2.0, section 4.4. Derivatives in JAX are finite everywhere.
"""

import functools
import math
import operator
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final, TypeAlias
from xml.sax.saxutils import escape

import jax
import jax.numpy as jnp
import numpy as np

from anser.dave_ml.elements import Element, parse_number, quote


@dataclass(frozen=True, slots=True)
class Number:
    """Number in a formula."""

    value: float


@dataclass(frozen=True, slots=True)
class VariableReference:
    """Reference to a variable in a formula, by varID."""

    id: str


@dataclass(frozen=True, slots=True)
class Operation:
    """Operation (a key of `OPERATIONS`) with its arguments."""

    operation: str
    arguments: tuple["Formula", ...]


@dataclass(frozen=True, slots=True)
class Piecewise:
    """Formula with cases: the value of the first piece with a true condition; `otherwise` if all are false."""

    pieces: tuple[tuple["Formula", "Formula"], ...]  #: Pairs of value and condition.
    otherwise: "Formula"


Formula: TypeAlias = Number | VariableReference | Operation | Piecewise

ARGUMENTS_MAX: Final = 1000
"""Greatest number of arguments of operations such as the sum."""
NUMERIC: Final = {
    **dict.fromkeys(("plus", "times", "min", "max"), (1, ARGUMENTS_MAX)),
    **dict.fromkeys(("minus", "root", "log"), (1, 2)),
    **dict.fromkeys(("divide", "power", "atan2"), (2, 2)),
    **dict.fromkeys(("exp", "ln", "abs", "floor", "ceiling"), (1, 1)),
    **dict.fromkeys(("sin", "cos", "tan", "sec", "csc", "cot"), (1, 1)),
    **dict.fromkeys(("arcsin", "arccos", "arctan", "arcsec", "arccsc", "arccot"), (1, 1)),
    **dict.fromkeys(("sinh", "cosh", "tanh", "sech", "csch", "coth"), (1, 1)),
    **dict.fromkeys(("arcsinh", "arccosh", "arctanh", "arcsech", "arccsch", "arccoth"), (1, 1)),
}
"""Operations with a numeric result, and their least and greatest number of arguments.

The second argument of ``root`` is the degree (default 2), of ``log`` the base (default 10)."""
COMPARISONS: Final = {
    **dict.fromkeys(("lt", "leq", "gt", "geq", "eq"), (2, ARGUMENTS_MAX)),
    "neq": (2, 2),
}
"""Comparisons, with their least and greatest number of arguments; each argument is compared with the next."""
LOGICAL: Final = {"and": (1, ARGUMENTS_MAX), "or": (1, ARGUMENTS_MAX), "xor": (1, ARGUMENTS_MAX), "not": (1, 1)}
OPERATIONS: Final = {**NUMERIC, **COMPARISONS, **LOGICAL}


def variables_in(formula: Formula) -> Iterator[str]:
    """Yield the varIDs of the variables in a formula, with repetitions."""
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
    """Whether a formula is a comparison or a logical operation."""
    return isinstance(formula, Operation) and formula.operation not in NUMERIC


@dataclass(frozen=True)
class Arithmetic:
    """Evaluation of formulas with an array library, NumPy or JAX."""

    operations: Mapping[str, Callable[..., Any]]  #: Function of each operation, by name.
    power: Callable[[Any, float], Any]  #: Power with a constant exponent: function of base and exponent.
    select: Callable[[Any, Any, Any], Any]  #: Function of a condition and the values for true and for false.

    def value_of(self, formula: Formula, values: Mapping[str, Any]) -> Any:
        """Return the value of a formula from the `values` of variables by varID; 1 or 0 for a truth value."""
        if isinstance(formula, Number):
            return formula.value
        if isinstance(formula, VariableReference):
            return values[formula.id]
        if isinstance(formula, Piecewise):
            chosen = self.value_of(formula.otherwise, values)
            for value, condition in reversed(formula.pieces):
                chosen = self.select(self._truth_of(condition, values), self.value_of(value, values), chosen)
            return chosen
        if is_logical(formula):
            return self.select(self._truth_of(formula, values), 1.0, 0.0)
        arguments = [self.value_of(argument, values) for argument in formula.arguments]
        exponent = formula.arguments[-1]
        if formula.operation == "power" and isinstance(exponent, Number):
            return self.power(arguments[0], exponent.value)
        return self.operations[formula.operation](*arguments)

    def _truth_of(self, formula: Formula, values: Mapping[str, Any]) -> Any:
        """Return the truth value of a formula; a number is true unless 0."""
        if not (isinstance(formula, Operation) and is_logical(formula)):
            return self.operations["neq"](self.value_of(formula, values), 0.0)
        if formula.operation in LOGICAL:
            truths = [self._truth_of(argument, values) for argument in formula.arguments]
            return self.operations[formula.operation](*truths)
        numbers = [self.value_of(argument, values) for argument in formula.arguments]
        compare = self.operations[formula.operation]
        pairs = [compare(a, b) for a, b in pairwise(numbers)]
        return self.operations["and"](*pairs)


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
    """Return the formula in a ``<math>`` element.

    Raises DaveMlError if the element does not have exactly one child, an element or operation is unknown, or an
    operation has a wrong number of arguments.
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
    expected = _ALTERNATIVES.get(head.tag, f"one of {operations}, or atan2 as a <csymbol>")
    raise head.fault(f"<{head.tag}> as an operation", expected)


def format_mathml(formula: Formula) -> str:
    """Return the text of the ``<math>`` element of a formula."""
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


def _guarded(function: Callable[..., Any], *slopes: Callable[..., Any]) -> Callable[..., Any]:
    """Return `function` with the partial derivatives `slopes`, or 0 in place of a derivative that is not finite.

    There is one slope for each argument, a function of all arguments and of the value of `function`. A derivative that
    is not finite, in an unselected branch or at a singular point, would turn the whole gradient into NaN.
    """

    @jax.custom_jvp
    def guarded(*arguments: Any) -> Any:
        return function(*arguments)

    @guarded.defjvp
    def _(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Any, Any]:
        value = function(*primals)
        parts = [slope(*primals, value) for slope in slopes]
        parts = [jnp.where(jnp.isfinite(part), part, jnp.zeros_like(part)) for part in parts]
        return value, functools.reduce(operator.add, (p * t for p, t in zip(parts, tangents, strict=True)))

    return guarded


def _principal_arccot(xp: Any, a: Any) -> Any:
    """Return the arc cotangent, rad, between -pi/2 and pi/2; pi/2 at 0.

    MathML 2.0, appendix C: Abramowitz and Stegun, eq. 4.4.8.
    """
    return xp.arctan2(xp.where(a < 0.0, -1.0, 1.0), xp.abs(a))


_GUARDED: Final = {
    "divide": _guarded(lambda a, b: a / b, lambda a, b, y: 1.0 / b, lambda a, b, y: -y / b),
    "power": _guarded(jnp.power, lambda a, b, y: b * jnp.power(a, b - 1.0), lambda a, b, y: y * jnp.log(a)),
    "sqrt": _guarded(jnp.sqrt, lambda a, y: 0.5 / y),
    "exp": _guarded(jnp.exp, lambda a, y: y),
    "ln": _guarded(jnp.log, lambda a, y: 1.0 / a),
    "atan2": _guarded(jnp.arctan2, lambda a, b, y: b / (a * a + b * b), lambda a, b, y: -a / (a * a + b * b)),
    "tan": _guarded(jnp.tan, lambda a, y: 1.0 + y * y),
    "arcsin": _guarded(jnp.arcsin, lambda a, y: 1.0 / jnp.sqrt(1.0 - a * a)),
    "arccos": _guarded(jnp.arccos, lambda a, y: -1.0 / jnp.sqrt(1.0 - a * a)),
    "arccosh": _guarded(jnp.arccosh, lambda a, y: 1.0 / jnp.sqrt(a * a - 1.0)),
    "arctanh": _guarded(jnp.arctanh, lambda a, y: 1.0 / (1.0 - a * a)),
    "arccot": _guarded(functools.partial(_principal_arccot, jnp), lambda a, y: -1.0 / (1.0 + a * a)),
}
_POWER_MAX: Final = 16
"""Greatest integer exponent computed by repeated multiplication."""


def _power_of_number(base: Any, exponent: float) -> Any:
    """Return `base` to the power of a constant exponent, with finite derivatives."""
    if exponent == 0.5:
        return _GUARDED["sqrt"](base)
    if exponent.is_integer() and abs(exponent) <= _POWER_MAX:
        whole = base ** int(abs(exponent))
        return whole if exponent >= 0.0 else _GUARDED["divide"](1.0, whole)
    return _GUARDED["power"](base, exponent)


def _by_reciprocals(
    divide: Callable[[Any, Any], Any], basic_functions: Mapping[str, Callable[..., Any]]
) -> dict[str, Any]:
    def inverse(name: str) -> Callable[[Any], Any]:
        return lambda a: basic_functions[name](divide(1.0, a))

    return {
        "sec": lambda a: divide(1.0, basic_functions["cos"](a)),
        "csc": lambda a: divide(1.0, basic_functions["sin"](a)),
        "cot": lambda a: divide(basic_functions["cos"](a), basic_functions["sin"](a)),
        "arcsec": inverse("arccos"),
        "arccsc": inverse("arcsin"),
        "sech": lambda a: divide(1.0, basic_functions["cosh"](a)),
        "csch": lambda a: divide(1.0, basic_functions["sinh"](a)),
        "coth": lambda a: divide(1.0, basic_functions["tanh"](a)),
        "arcsech": inverse("arccosh"),
        "arccsch": inverse("arcsinh"),
        "arccoth": inverse("arctanh"),
    }


def _minus(minuend: Any, *subtrahend: Any) -> Any:
    return minuend - subtrahend[0] if subtrahend else -minuend


def _folded(binary_operation: Callable[[Any, Any], Any]) -> Callable[..., Any]:
    return lambda *arguments: functools.reduce(binary_operation, arguments)


_SHARED: Final[dict[str, Callable[..., Any]]] = {
    "plus": _folded(operator.add),
    "minus": _minus,
    "times": _folded(operator.mul),
    "lt": operator.lt,
    "leq": operator.le,
    "gt": operator.gt,
    "geq": operator.ge,
    "eq": operator.eq,
    "neq": operator.ne,
}
_NAMES_IN_LIBRARIES: Final = {
    **{name: name for name in ("divide", "power", "sqrt", "exp", "abs", "floor", "sin", "cos", "tan", "sinh", "cosh")},
    **{name: name for name in ("tanh", "arcsin", "arccos", "arctan", "arcsinh", "arccosh", "arctanh")},
    "ln": "log",
    "ceiling": "ceil",
    "atan2": "arctan2",
    "not": "logical_not",
}
_FOLDED: Final = {"min": "minimum", "max": "maximum", "and": "logical_and", "or": "logical_or", "xor": "logical_xor"}


def _arithmetic(
    xp: Any, replacements: Mapping[str, Callable[..., Any]], constant_power: Callable[[Any, float], Any]
) -> Arithmetic:
    """Build the evaluation from the functions of `xp` (NumPy or `jax.numpy`); `replacements`, by name, come first."""
    functions = {name: getattr(xp, library_name) for name, library_name in _NAMES_IN_LIBRARIES.items()}
    functions |= {"arccot": functools.partial(_principal_arccot, xp), **replacements}
    divide, power, sqrt, ln = (functions[name] for name in ("divide", "power", "sqrt", "ln"))
    operations = {
        **_SHARED,
        **functions,
        **{name: _folded(getattr(xp, library_name)) for name, library_name in _FOLDED.items()},
        **_by_reciprocals(divide, functions),
        "root": lambda a, degree=2.0: sqrt(a) if degree == 2.0 else power(a, divide(1.0, degree)),
        "log": lambda a, base=10.0: divide(ln(a), ln(base)),
    }
    return Arithmetic(operations, constant_power, xp.where)


IN_JAX: Final = _arithmetic(jnp, _GUARDED, _power_of_number)
"""Evaluation of formulas in JAX: values are scalars or arrays of equal shape."""
IN_NUMPY: Final = _arithmetic(np, {}, np.power)
"""Evaluation of formulas of constants in NumPy."""
