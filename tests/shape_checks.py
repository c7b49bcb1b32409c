"""Checks of the shapes that functions state for their arguments and results, at each call within the tests."""

import functools
import inspect
import operator
import types
from collections.abc import Callable
from typing import Any, Union, get_args, get_origin

import jax
import numpy as np
from beartype import BeartypeConf, beartype
from beartype.roar import BeartypeDecorHintException

_checked = beartype(conf=BeartypeConf(is_pep484_tower=True))  # an integer is a float, as for type checkers


def checked(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function with checked types if an annotation states a shape; otherwise the function itself.

    The fields of a class are not checked: a batch of objects has more axes than one object.
    """
    hints = inspect.get_annotations(function)
    if function.__name__ == "__init__" or "jaxtyping." not in str(hints):
        return function
    function.__annotations__ = {name: _or_numpy(hint) for name, hint in hints.items()}
    try:
        return _checked(function)
    except BeartypeDecorHintException:
        return function  # an annotation beside the shapes cannot be checked while a program runs


def _or_numpy(hint: Any) -> Any:
    """Return a type that also admits NumPy's arrays, with which tests call functions of JAX's."""
    if getattr(hint, "array_type", None) is jax.Array:
        return hint | hint.dtype[np.ndarray, hint.dim_str]
    if get_origin(hint) in (Union, types.UnionType):
        return functools.reduce(operator.or_, map(_or_numpy, get_args(hint)))
    return tuple[tuple(map(_or_numpy, get_args(hint)))] if get_origin(hint) is tuple else hint
