"""Checks of the shapes that functions state for their arguments and results, at each call within the tests."""

import inspect
from collections.abc import Callable
from typing import Any

from beartype import BeartypeConf, beartype
from beartype.roar import BeartypeDecorHintException

_checked = beartype(conf=BeartypeConf(is_pep484_tower=True))  # an integer is a float, as for type checkers


def checked(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function with checked types if an annotation states a shape; otherwise the function itself.

    The fields of a class are not checked: a batch of objects has more axes than one object.
    """
    if function.__name__ == "__init__" or "jaxtyping." not in str(inspect.get_annotations(function)):
        return function
    try:
        return _checked(function)
    except BeartypeDecorHintException:
        return function  # an annotation beside the shapes cannot be checked while a program runs
