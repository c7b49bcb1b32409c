"""Expressions over a flight's variables, such as `hypot(alpha_deg, beta_deg)` or `abs(bank_deg) > 30`.

A text is parsed by Python's grammar and rebuilt from a list of allowed operations; it is never executed.
"""

import ast
import difflib
import functools
import sys
import warnings
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

from anser.config.errors import describe_value, quoted_list
from anser.variables import CATALOGUE

LENGTH_MAX = 300
_DEPTH_MAX = 40
_CONDITIONS = frozenset(variable.name for variable in CATALOGUE if variable.dtype == "bool")

# Functions of the array module (NumPy or jax.numpy), by operator.
_UNARY = {ast.USub: "negative", ast.UAdd: "positive"}
_BINARY = {ast.Add: "add", ast.Sub: "subtract", ast.Mult: "multiply", ast.Div: "divide", ast.Pow: "power"}
_ORDER = {ast.Lt: "less", ast.LtE: "less_equal", ast.Gt: "greater", ast.GtE: "greater_equal"}
_COMPARISONS = {**_ORDER, ast.Eq: "equal", ast.NotEq: "not_equal"}
_FUNCTIONS: dict[str, tuple[int | None, Callable[..., Any]]] = {
    "abs": (1, lambda xp, x: xp.abs(x)),
    "sqrt": (1, lambda xp, x: xp.sqrt(x)),
    "sin": (1, lambda xp, x: xp.sin(xp.radians(x))),
    "cos": (1, lambda xp, x: xp.cos(xp.radians(x))),
    "hypot": (2, lambda xp, x, y: xp.hypot(x, y)),
    "min": (None, lambda xp, *values: functools.reduce(xp.minimum, values)),
    "max": (None, lambda xp, *values: functools.reduce(xp.maximum, values)),
}
"""Functions in expressions by name: number of operands (None: two or more), implementation; angles in degrees."""
_OPERANDS = {1: "one number", 2: "two numbers", None: "two or more numbers"}
_ALLOWED = (
    "numbers, variables of the flight, + - * / **, comparisons, and, or, not, if else, parentheses, and the functions "
    f"{', '.join(_FUNCTIONS)}"
)
_Evaluate = Callable[[Mapping[str, Any], Any], Any]


class ExpressionError(ValueError):
    """Error for a text that is no valid expression; `arrived` describes the text, `expected` a valid text."""

    def __init__(self, arrived: str, expected: str) -> None:
        super().__init__(f"arrived {arrived}; expected {expected}")
        self.arrived, self.expected = arrived, expected


@dataclass(frozen=True)
class Expression:
    """Parsed expression of a flight's variables."""

    names: tuple[str, ...]  # dataset names of the variables
    is_condition: bool  # True: the value is true or false; False: the value is a number
    evaluate: _Evaluate  # returns the value from (arrays by dataset name, array module such as `numpy`)


@functools.lru_cache
def parse_expression(text: str) -> Expression:
    """Parse an expression; raises ExpressionError for text that is not allowed, or that contains no variable."""
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
        """Return whether a node is a condition, and its evaluating function; variables are added to `self.names`.

        Raises ExpressionError if the node is not allowed, or if `depth`, the level of the node, exceeds `_DEPTH_MAX`.
        """
        if depth > _DEPTH_MAX:
            raise ExpressionError("a nested expression", f"{_DEPTH_MAX} levels at most")
        match node:
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                if not abs(value) <= sys.float_info.max:
                    raise ExpressionError(self._source(node), "a finite number")
                number = float(value)
                return False, lambda values, xp: number
            case ast.Name(id=name):
                self.names.append(name)
                return name in _CONDITIONS, lambda values, xp: values[name]
            case ast.UnaryOp(op=ast.Not()):
                return True, _applied("logical_not", [self._operand(node.operand, depth, is_condition=True)])
            case ast.UnaryOp() if type(node.op) in _UNARY:
                return False, _applied(_UNARY[type(node.op)], [self._operand(node.operand, depth)])
            case ast.BinOp() if type(node.op) in _BINARY:
                terms = [self._operand(operand, depth) for operand in (node.left, node.right)]
                return False, _applied(_BINARY[type(node.op)], terms)
            case ast.BoolOp():
                conditions = [self._operand(operand, depth, is_condition=True) for operand in node.values]
                return True, _all_of(conditions, "logical_and" if isinstance(node.op, ast.And) else "logical_or")
            case ast.Compare() if all(type(operator) in _COMPARISONS for operator in node.ops):
                terms = [self._operand(operand, depth) for operand in (node.left, *node.comparators)]
                functions = [_COMPARISONS[type(operator)] for operator in node.ops]
                comparisons = [_applied(function, terms[k : k + 2]) for k, function in enumerate(functions)]
                return True, _all_of(comparisons, "logical_and")
            case ast.IfExp():
                condition = self._operand(node.test, depth, is_condition=True)
                return False, _applied(
                    "where", [condition, *(self._operand(operand, depth) for operand in (node.body, node.orelse))]
                )
            case ast.Call(func=ast.Name(id=name), keywords=[]) if name in _FUNCTIONS:
                count, function = _FUNCTIONS[name]
                if len(node.args) != count if count else len(node.args) < 2:
                    raise ExpressionError(self._source(node), f"{name} of {_OPERANDS[count]}")
                operands = [self._operand(operand, depth) for operand in node.args]
                return False, lambda values, xp: function(xp, *(operand(values, xp) for operand in operands))
            case _:
                raise ExpressionError(self._source(node), f"nothing but {_ALLOWED}")

    def _operand(self, node: ast.AST, depth: int, *, is_condition: bool = False) -> _Evaluate:
        """Return the function that evaluates an operand.

        Raises ExpressionError if the operand is not a condition (`is_condition` True) or not a number (False).
        """
        found_condition, evaluate = self.build(node, depth + 1)
        if found_condition and not is_condition:
            expected = "a number there, such as (1 if mach > 0.5 else 0)"
            raise ExpressionError(f"{self._source(node)}, which is true or false", expected)
        if is_condition and not found_condition:
            raise ExpressionError(f"{self._source(node)}, which is a number", "a condition there, such as mach > 0.5")
        return evaluate

    def _source(self, node: ast.AST) -> str:
        return describe_value(ast.get_source_segment(self.text, node) or self.text)


def _applied(function: str, operands: list[_Evaluate]) -> _Evaluate:
    return lambda values, xp: getattr(xp, function)(*(operand(values, xp) for operand in operands))


def _all_of(conditions: list[_Evaluate], function: str) -> _Evaluate:
    return lambda values, xp: functools.reduce(getattr(xp, function), [c(values, xp) for c in conditions])


def suggest_variable(name: str, names: Collection[str]) -> str:
    """Return a suggestion from `names` for an unknown variable `name`, as the text after "expected" in a message."""
    keys = {variable.name: variable.key for variable in CATALOGUE}
    same = [entry for entry in names if name == keys.get(entry) or name.startswith(f"{keys.get(entry)}_")]
    matches = sorted(same, key=len)[-1:] or difflib.get_close_matches(name, names, n=3)
    advice = f"perhaps {quoted_list(matches, ' or ')}" if matches else 'such as "bank_deg" or "load_factor"'
    return f"a variable of the flight by its name in datasets, {advice} (all are in docs/reference/variables.md)"
