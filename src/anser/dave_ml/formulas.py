"""Formulas of numbers and variables, as plain data."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final, TypeAlias


@dataclass(frozen=True, slots=True)
class Number:
    """A number that stands in the formula."""

    value: float


@dataclass(frozen=True, slots=True)
class Named:
    """The value of a variable, by its varID."""

    id: str


@dataclass(frozen=True, slots=True)
class Applied:
    """An operation of `OPERATIONS` on arguments."""

    operation: str
    arguments: tuple["Formula", ...]


@dataclass(frozen=True, slots=True)
class Chosen:
    """The value of the first piece whose condition holds, else the last.

    Attributes
    ----------
    pieces
        Each a value and its condition.
    otherwise
        Where none holds.
    """

    pieces: tuple[tuple["Formula", "Formula"], ...]
    otherwise: "Formula"


Formula: TypeAlias = Number | Named | Applied | Chosen

MANY: Final = 1000
"""Arguments that an operation of any number of them may have."""
NUMERIC: Final = {
    "plus": (1, MANY),
    "minus": (1, 2),
    "times": (1, MANY),
    "divide": (2, 2),
    "power": (2, 2),
    "root": (1, 2),
    "exp": (1, 1),
    "ln": (1, 1),
    "log": (1, 2),
    "abs": (1, 1),
    "floor": (1, 1),
    "ceiling": (1, 1),
    "min": (1, MANY),
    "max": (1, MANY),
    "atan2": (2, 2),
    **dict.fromkeys(("sin", "cos", "tan", "sec", "csc", "cot"), (1, 1)),
    **dict.fromkeys(("arcsin", "arccos", "arctan", "arcsec", "arccsc", "arccot"), (1, 1)),
    **dict.fromkeys(("sinh", "cosh", "tanh", "sech", "csch", "coth"), (1, 1)),
    **dict.fromkeys(("arcsinh", "arccosh", "arctanh", "arcsech", "arccsch", "arccoth"), (1, 1)),
}
"""Operations with a number as value, and the least and greatest number of their arguments.

The second argument of ``root`` is its degree, of ``log`` its base.
"""
COMPARING: Final = {
    **dict.fromkeys(("lt", "leq", "gt", "geq", "eq"), (2, MANY)),
    "neq": (2, 2),
}
"""Comparisons; of more than two arguments each with the next."""
LOGICAL: Final = {"and": (1, MANY), "or": (1, MANY), "xor": (1, MANY), "not": (1, 1)}
OPERATIONS: Final = {**NUMERIC, **COMPARING, **LOGICAL}


def names_in(formula: Formula) -> Iterator[str]:
    """The variables of a formula."""
    if isinstance(formula, Named):
        yield formula.id
    elif isinstance(formula, Applied):
        for argument in formula.arguments:
            yield from names_in(argument)
    elif isinstance(formula, Chosen):
        for value, condition in formula.pieces:
            yield from names_in(value)
            yield from names_in(condition)
        yield from names_in(formula.otherwise)


def is_logical(formula: Formula) -> bool:
    """Whether the value of a formula is a truth."""
    return isinstance(formula, Applied) and formula.operation not in NUMERIC


class Arithmetic:
    """How operations are computed, in one library of arrays.

    Parameters
    ----------
    operations
        Of each name, a function of the arguments.
    power
        Function of a base and an exponent that stands in the formula.
    where
        Function of a condition and two values.
    """

    def __init__(
        self,
        operations: Mapping[str, Callable[..., Any]],
        power: Callable[[Any, float], Any],
        where: Callable[[Any, Any, Any], Any],
    ) -> None:
        self._operations = operations
        self._power = power
        self._where = where

    def value_of(self, formula: Formula, values: Mapping[str, Any]) -> Any:
        """The number that a formula gives; a truth counts as 1 or 0."""
        if isinstance(formula, Number):
            return formula.value
        if isinstance(formula, Named):
            return values[formula.id]
        if isinstance(formula, Chosen):
            chosen = self.value_of(formula.otherwise, values)
            for value, condition in reversed(formula.pieces):
                chosen = self._where(self._truth_of(condition, values), self.value_of(value, values), chosen)
            return chosen
        if is_logical(formula):
            return self._where(self._truth_of(formula, values), 1.0, 0.0)
        arguments = [self.value_of(argument, values) for argument in formula.arguments]
        exponent = formula.arguments[-1]
        if formula.operation == "power" and isinstance(exponent, Number):
            return self._power(arguments[0], exponent.value)
        return self._operations[formula.operation](*arguments)

    def _truth_of(self, formula: Formula, values: Mapping[str, Any]) -> Any:
        """The truth that a formula gives; a number counts as true unless it is zero."""
        if not (isinstance(formula, Applied) and is_logical(formula)):
            return self._operations["neq"](self.value_of(formula, values), 0.0)
        if formula.operation in LOGICAL:
            truths = [self._truth_of(argument, values) for argument in formula.arguments]
            return self._operations[formula.operation](*truths)
        numbers = [self.value_of(argument, values) for argument in formula.arguments]
        compare = self._operations[formula.operation]
        pairs = [compare(left, right) for left, right in pairwise(numbers)]
        return self._operations["and"](*pairs)
