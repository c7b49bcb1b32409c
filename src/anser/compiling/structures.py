"""Structures of results as JSON: of classes only those of this package, of values only numbers, texts and shapes."""

import dataclasses
import enum
import importlib
from typing import Any

import jax
import numpy as np

from anser.compiling.keys import NotKeptError

_PACKAGE = "anser"


def encode(value: Any) -> Any:
    """Value for `json.dumps`: a result with `jax.ShapeDtypeStruct` in the place of arrays.

    Raises
    ------
    NotKeptError
        A part is of a class that `decode` would not make.
    """
    if value is None or type(value) in (bool, int, float, str):
        return value
    if isinstance(value, jax.ShapeDtypeStruct):
        return {"array": [_dtype(str(value.dtype)).name, list(value.shape), bool(value.weak_type)]}
    if type(value) in (tuple, list):
        return {type(value).__name__: [encode(item) for item in value]}
    if type(value) is dict and all(type(key) is str for key in value):
        return {"dict": {key: encode(item) for key, item in value.items()}}
    name = f"{type(value).__module__}:{type(value).__qualname__}"
    if _class(name) is not type(value):
        raise NotKeptError(name)
    if isinstance(value, enum.Enum):
        return {"enum": [name, value.name]}
    return {"class": [name, {field: encode(getattr(value, field)) for field in _fields(type(value))}]}


def decode(value: Any) -> Any:
    """Value that was encoded; no code of the classes runs.

    Raises
    ------
    NotKeptError
        It is no value that `encode` makes.
    """
    if value is None or type(value) in (bool, int, float, str):
        return value
    if type(value) is not dict or len(value) != 1:
        raise NotKeptError(repr(value)[:80])
    ((kind, content),) = value.items()
    match kind, content:
        case "array", [str(dtype), list(shape), bool(weak)] if all(type(size) is int and size >= 0 for size in shape):
            return jax.ShapeDtypeStruct(tuple(shape), _dtype(dtype), weak_type=weak)
        case "tuple", list():
            return tuple(map(decode, content))
        case "list", list():
            return list(map(decode, content))
        case "dict", dict():
            return {key: decode(item) for key, item in content.items()}
        case "enum", [str(name), str(member)] if member in getattr(_class(name), "__members__", ()):
            return getattr(_class(name), member)
        case "class", [str(name), dict(fields)] if list(fields) == list(_fields(_class(name))):
            return _instance(_class(name), {field: decode(item) for field, item in fields.items()})
        case _:
            raise NotKeptError(repr(value)[:80])


def _dtype(name: str) -> np.dtype[Any]:
    """Type of numbers; NotKeptError: types that are not NumPy's own, such as keys of random numbers, are not kept."""
    try:
        dtype = np.dtype(name)
    except TypeError as error:
        raise NotKeptError(name) from error
    if dtype.kind not in "biufc" or dtype.name != name:
        raise NotKeptError(name)
    return dtype


def _class(name: str) -> type[Any]:
    """Class at the top of a module of the package, by its name MODULE:CLASS; NotKeptError: anything else."""
    module_name, _, class_name = name.partition(":")
    parts = [*module_name.split("."), class_name]
    if parts[0] != _PACKAGE or not all(part.isidentifier() and not part.startswith("__") for part in parts):
        raise NotKeptError(name)
    try:
        value = getattr(importlib.import_module(module_name), class_name, None)
    except ImportError as error:
        raise NotKeptError(name) from error
    if not isinstance(value, type) or (value.__module__, value.__qualname__) != (module_name, class_name):
        raise NotKeptError(name)
    return value


def _fields(of: type[Any]) -> tuple[str, ...]:
    if dataclasses.is_dataclass(of):
        return tuple(field.name for field in dataclasses.fields(of))
    if issubclass(of, tuple) and hasattr(of, "_fields"):
        return tuple(getattr(of, "_fields"))  # noqa: B009 - a named tuple
    raise NotKeptError(of.__qualname__)


def _instance(of: type[Any], fields: dict[str, Any]) -> Any:
    if issubclass(of, tuple):
        return tuple.__new__(of, fields.values())
    instance = object.__new__(of)
    for name, value in fields.items():
        object.__setattr__(instance, name, value)
    return instance
