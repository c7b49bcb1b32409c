"""Expressions over a flight's variables, such as `hypot(alpha_deg, beta_deg)` or `abs(bank_deg) > 30`.

A text is parsed by Python's grammar and rebuilt from a list of allowed operations; it is never executed.
"""

import ast
import difflib
import functools
import math
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from anser.config.errors import describe_value, quoted_list
from anser.variables import CATALOGUE

LENGTH_MAX = 300
_DEPTH_MAX = 40
_CONDITIONS = frozenset(variable.name for variable in CATALOGUE if variable.dtype == "bool")

# Functions of the array module (NumPy or jax.numpy) and the operands; angles in degrees.
_BINARY = {ast.Add: "add", ast.Sub: "subtract", ast.Mult: "multiply", ast.Div: "divide", ast.Pow: "power"}
_ORDER = {ast.Lt: "less", ast.LtE: "less_equal", ast.Gt: "greater", ast.GtE: "greater_equal"}
_COMPARISONS = {**_ORDER, ast.Eq: "equal", ast.NotEq: "not_equal"}
_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "abs": lambda xp, x: xp.abs(x),
    "sqrt": lambda xp, x: xp.sqrt(x),
    "sin": lambda xp, x: xp.sin(xp.radians(x)),
    "cos": lambda xp, x: xp.cos(xp.radians(x)),
    "hypot": lambda xp, x, y: xp.hypot(x, y),
    "min": lambda xp, *values: functools.reduce(xp.minimum, values),
    "max": lambda xp, *values: functools.reduce(xp.maximum, values),
}
_OPERANDS = dict.fromkeys(("abs", "sqrt", "sin", "cos"), 1) | {"hypot": 2}
"""Number of operands of a function; `min` and `max` have two or more."""
_ALLOWED = (
    "numbers, variables of the flight, + - * / **, comparisons, and, or, not, if else, parentheses, and the functions "
    f"{', '.join(_FUNCTIONS)}"
)
_Evaluate = Callable[[Mapping[str, Any], Any], Any]


class ExpressionError(ValueError):
    """Error for a text that is no valid expression: description of the text, and of what is expected instead."""

    def __init__(self, arrived: str, expected: str) -> None:
        super().__init__(f"arrived {arrived}; expected {expected}")
        self.arrived, self.expected = arrived, expected


@dataclass(frozen=True)
class Expression:
    """Parsed expression."""

    names: tuple[str, ...]  # variables by dataset name
    is_condition: bool  # whether the value is true or false, otherwise a number
    # computes the value from arrays by name, with the array module `numpy` or `jax.numpy`
    evaluate: _Evaluate


@functools.lru_cache
def parse_expression(text: str) -> Expression:
    """Parse an expression; raises ExpressionError for everything that is not allowed in expressions."""
    if len(text) > LENGTH_MAX:
        raise ExpressionError(f"{len(text)} characters", f"{LENGTH_MAX} at most")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            tree = ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        reason = error.msg if isinstance(error, SyntaxError) else "not readable"
        raise ExpressionError(f"{describe_value(text)} ({reason})", f"an expression of {_ALLOWED}") from None
    builder = _Builder(text.strip())
    is_condition, evaluate = builder.build(tree.body, 1)
    if not builder.names:
        raise ExpressionError(describe_value(text), "at least one variable of the flight")
    return Expression(tuple(dict.fromkeys(builder.names)), is_condition, evaluate)


class _Builder:
    """Checks the syntax tree of an expression, and builds the function that evaluates the expression."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.names: list[str] = []

    def build(self, node: ast.AST, depth: int) -> tuple[bool, _Evaluate]:
        """Check a node, `depth` levels below the root; return whether it is a condition, and its evaluating function.

        Adds the names of variables to `self.names`. Raises ExpressionError for a node that is not allowed or too deep.
        """
        if depth > _DEPTH_MAX:
            raise ExpressionError("a nested expression", f"{_DEPTH_MAX} levels at most")
        match node:
            case ast.Constant(value=bool()):
                raise self._refused(node)
            case ast.Constant(value=int() | float()):
                return False, self._constant(node)
            case ast.Name(id=name):
                self.names.append(name)
                return name in _CONDITIONS, lambda values, xp: values[name]
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                value = self._number(operand, depth)
                return False, lambda values, xp: xp.negative(value(values, xp))
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return False, self._number(operand, depth)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                condition = self._condition(operand, depth)
                return True, lambda values, xp: xp.logical_not(condition(values, xp))
            case ast.BinOp() if type(node.op) in _BINARY:
                terms = [self._number(operand, depth) for operand in (node.left, node.right)]
                return False, _applied(_BINARY[type(node.op)], terms)
            case ast.BoolOp():
                conditions = [self._condition(operand, depth) for operand in node.values]
                return True, _all_of(conditions, "logical_and" if isinstance(node.op, ast.And) else "logical_or")
            case ast.Compare() if all(type(operator) in _COMPARISONS for operator in node.ops):
                terms = [self._number(operand, depth) for operand in (node.left, *node.comparators)]
                comparisons = [
                    _applied(_COMPARISONS[type(operator)], terms[k : k + 2]) for k, operator in enumerate(node.ops)
                ]
                return True, _all_of(comparisons, "logical_and")
            case ast.IfExp():
                condition = self._condition(node.test, depth)
                terms = [self._number(operand, depth) for operand in (node.body, node.orelse)]
                return False, lambda values, xp: xp.where(condition(values, xp), *(term(values, xp) for term in terms))
            case ast.Call():
                return False, self._call(node, depth)
            case _:
                raise self._refused(node)

    def _constant(self, node: ast.Constant) -> _Evaluate:
        try:
            number = float(node.value)  # pyright: ignore[reportArgumentType]
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise ExpressionError(self._source(node), "a finite number")
        return lambda values, xp: number

    def _call(self, node: ast.Call, depth: int) -> _Evaluate:
        if not isinstance(node.func, ast.Name) or node.func.id not in _FUNCTIONS or node.keywords:
            raise self._refused(node)
        name = node.func.id
        function = _FUNCTIONS[name]
        count = _OPERANDS.get(name)
        if len(node.args) != count if count else len(node.args) < 2:
            required = {1: "one number", 2: "two numbers"}.get(count or 0, "two or more numbers")
            raise ExpressionError(self._source(node), f"{name} of {required}")
        operands = [self._number(operand, depth) for operand in node.args]
        return lambda values, xp: function(xp, *(operand(values, xp) for operand in operands))

    def _number(self, node: ast.AST, depth: int) -> _Evaluate:
        is_condition, evaluate = self.build(node, depth + 1)
        if is_condition:
            expected = "a number there, such as (1 if mach > 0.5 else 0)"
            raise ExpressionError(f"{self._source(node)}, which is true or false", expected)
        return evaluate

    def _condition(self, node: ast.AST, depth: int) -> _Evaluate:
        is_condition, evaluate = self.build(node, depth + 1)
        if not is_condition:
            raise ExpressionError(f"{self._source(node)}, which is a number", "a condition there, such as mach > 0.5")
        return evaluate

    def _source(self, node: ast.AST) -> str:
        return describe_value(ast.get_source_segment(self.text, node) or self.text)

    def _refused(self, node: ast.AST) -> ExpressionError:
        return ExpressionError(self._source(node), f"nothing but {_ALLOWED}")


def _applied(function: str, operands: list[_Evaluate]) -> _Evaluate:
    return lambda values, xp: getattr(xp, function)(*(operand(values, xp) for operand in operands))


def _all_of(conditions: list[_Evaluate], function: str) -> _Evaluate:
    return lambda values, xp: functools.reduce(getattr(xp, function), [c(values, xp) for c in conditions])


def suggest_variable(name: str, names: Iterable[str]) -> str:
    """Return what is expected in place of an unknown name: the same variable with its unit, or similar names."""
    names = list(names)
    keys = {variable.name: variable.key for variable in CATALOGUE}
    same = [entry for entry in names if name == keys.get(entry) or name.startswith(f"{keys.get(entry)}_")]
    matches = sorted(same, key=len)[-1:] or difflib.get_close_matches(name, names, n=3)
    advice = f"perhaps {quoted_list(matches, ' or ')}" if matches else 'such as "bank_deg" or "load_factor"'
    return f"a variable of the flight by its name in datasets, {advice} (all are in docs/reference/variables.md)"
