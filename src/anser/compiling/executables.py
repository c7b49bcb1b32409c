"""Serialization of compiled programs: machine code, and a JSON header with the structure of the result.

Unlike a pickle, the file contains no Python code to execute.
"""

import dataclasses
import enum
import functools
import importlib
import json
import re
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import SingleDeviceSharding

from anser.compiling.keys import NotCacheableError

_PACKAGE = "anser"


def encode_structure(value: Any) -> Any:
    """Encode a result, with `jax.ShapeDtypeStruct` in place of arrays, as a value for `json.dumps`.

    Raises NotCacheableError if the result contains a class that `decode_structure` rejects.
    """
    if value is None or type(value) in (bool, int, float, str):
        return value
    if isinstance(value, jax.ShapeDtypeStruct):
        return {"array": [_dtype(str(value.dtype)).name, list(value.shape), bool(value.weak_type)]}
    if type(value) in (tuple, list):
        return {type(value).__name__: [encode_structure(item) for item in value]}
    if type(value) is dict and all(type(key) is str for key in value):
        return {"dict": {key: encode_structure(item) for key, item in value.items()}}
    name = f"{type(value).__module__}:{type(value).__qualname__}"
    if _class(name) is not type(value):
        raise NotCacheableError(name)
    if isinstance(value, enum.Enum):
        return {"enum": [name, value.name]}
    return {"class": [name, {field: encode_structure(getattr(value, field)) for field in _fields(type(value))}]}


def decode_structure(value: Any) -> Any:
    """Decode a value from `encode_structure`, without running code of the decoded classes.

    Raises NotCacheableError if the value is not an output of `encode_structure`.
    """
    if value is None or type(value) in (bool, int, float, str):
        return value
    if type(value) is not dict or len(value) != 1:
        raise NotCacheableError(repr(value)[:80])
    ((tag, content),) = value.items()
    match tag, content:
        case "array", [str(dtype), list(shape), bool(weak)] if all(type(size) is int and size >= 0 for size in shape):
            return jax.ShapeDtypeStruct(tuple(shape), _dtype(dtype), weak_type=weak)
        case "tuple", list():
            return tuple(map(decode_structure, content))
        case "list", list():
            return list(map(decode_structure, content))
        case "dict", dict():
            return {key: decode_structure(item) for key, item in content.items()}
        case "enum", [str(name), str(member)] if member in getattr(_class(name), "__members__", ()):
            return getattr(_class(name), member)
        case "class", [str(name), dict(fields)] if list(fields) == list(_fields(_class(name))):
            return _instance(_class(name), {field: decode_structure(item) for field, item in fields.items()})
        case _:
            raise NotCacheableError(repr(value)[:80])


def _dtype(name: str) -> np.dtype[Any]:
    """Return a NumPy number type by name; raise NotCacheableError for extension types such as random keys."""
    try:
        dtype = np.dtype(name)
    except TypeError as error:
        raise NotCacheableError(name) from error
    if dtype.kind not in "biufc" or dtype.name != name:
        raise NotCacheableError(name)
    return dtype


def _class(name: str) -> type[Any]:
    """Return a class of the package by its name MODULE:CLASS; raise NotCacheableError for any other name."""
    module_name, _, class_name = name.partition(":")
    parts = [*module_name.split("."), class_name]
    if parts[0] != _PACKAGE or not all(part.isidentifier() and not part.startswith("__") for part in parts):
        raise NotCacheableError(name)
    try:
        value = getattr(importlib.import_module(module_name), class_name, None)
    except ImportError as error:
        raise NotCacheableError(name) from error
    if not isinstance(value, type) or (value.__module__, value.__qualname__) != (module_name, class_name):
        raise NotCacheableError(name)
    return value


def _fields(class_: type[Any]) -> tuple[str, ...]:
    if dataclasses.is_dataclass(class_):
        return tuple(field.name for field in dataclasses.fields(class_))
    if issubclass(class_, tuple) and hasattr(class_, "_fields"):
        return tuple(getattr(class_, "_fields"))  # noqa: B009 - a named tuple
    raise NotCacheableError(class_.__qualname__)


def _instance(class_: type[Any], fields: dict[str, Any]) -> Any:
    if issubclass(class_, tuple):
        return tuple.__new__(class_, fields.values())
    instance = object.__new__(class_)
    for name, value in fields.items():
        object.__setattr__(instance, name, value)
    return instance


_FEATURES = re.compile(rb"\+[a-z0-9._\-]+(?:,[+\-][a-z0-9._\-]+){8,}")
"""Processor features declared as required by code for a CPU: `+64bit,+avx,-sgx, ...`."""


class Executable(NamedTuple):
    """Machine code of a program, and the indices of the arguments in use (unused arguments are left out)."""

    code: bytes
    argument_indices: list[int]


def pack_program(compiled: jax.stages.Compiled, result: Any) -> bytes:
    """Serialize a program as: length of the JSON header, header (result structure, argument indices), machine code.

    Raises NotCacheableError if the program calls back into Python, has effects, runs on other devices, or returns a
    class from outside the package.
    """
    executable = _serialize(compiled)
    header = json.dumps({"result": encode_structure(result), "argument_indices": executable.argument_indices}).encode()
    return len(header).to_bytes(8, "big") + header + executable.code


def unpack_program(content: bytes, argument_count: int) -> tuple[Executable, Any]:
    """Return the machine code from the content of a program file, and the structure of the program's result.

    The structure has `jax.ShapeDtypeStruct` in place of arrays.

    Raises NotCacheableError, ValueError, KeyError or TypeError if the header is not from `pack_program`, or an argument
    index exceeds `argument_count`.
    """
    end = 8 + int.from_bytes(content[:8], "big")
    header = json.loads(content[8:end])
    executable = Executable(content[end:], header["argument_indices"])
    if not set(executable.argument_indices) <= set(range(argument_count)):
        raise NotCacheableError(f"arguments {executable.argument_indices} of {argument_count}")
    if b"lapack_" in executable.code:
        _register_lapack()
    return executable, decode_structure(header["result"])


def load_executable(
    executable: Executable, results: Iterable[jax.ShapeDtypeStruct]
) -> Callable[[list[Any]], list[Any]]:
    """Load machine code on the first device; return a function from the list of arguments to the list of result arrays.

    Raises ImportError or AttributeError if the internals of the installed JAX differ; the caller then compiles the
    program again.
    """
    from jax._src import core
    from jax._src.interpreters import pxla
    from jax._src.lib import xla_client  # pyright: ignore[reportPrivateImportUsage]

    device = jax.devices()[0]
    program = device.client.deserialize_executable(
        _without_features(executable.code), executable_devices=xla_client.DeviceList((device,))
    )
    shapes = [core.ShapedArray(shape.shape, shape.dtype, weak_type=shape.weak_type) for shape in results]
    wrap = pxla.global_avals_to_results_handler(shapes, [SingleDeviceSharding(device)] * len(shapes), False).handlers
    indices = executable.argument_indices

    def call(arrays: list[Any]) -> list[Any]:
        # NumPy arrays are accepted, as by a program compiled in this process
        selected = (arrays[index] for index in indices)
        arguments = [array if isinstance(array, jax.Array) else jax.device_put(array, device) for array in selected]
        return program.execute_sharded(arguments).consume_with_handlers(wrap)

    return call


def _serialize(compiled: Any) -> Executable:
    whole = compiled._executable._unloaded_executable
    if (
        tuple(whole.device_list) != (jax.devices()[0],)
        or whole.unordered_effects
        or whole.ordered_effects
        or whole.host_callbacks
        or whole.keepalive
        or whole.mut is not None
        or compiled._params.const_args
    ):
        raise NotCacheableError("an executable that is more than its code")
    return Executable(compiled.runtime_executable().serialize(), sorted(whole.kept_var_idx))


def _without_features(code: bytes) -> bytes:
    """Return the code without required processor features.

    When loading code, XLA compares the declared features with the processor, and reports `prefer-no-gather` and
    `prefer-no-scatter` (preferences of XLA's compiler, not features of any processor) as missing. The comparison is
    redundant here: the key of a program includes the processor features, so code for another processor is never loaded.
    """
    return _FEATURES.sub(lambda features: features[0].replace(b"+", b"-"), code)


@functools.cache
def _register_lapack() -> None:
    """Make JAX register the LAPACK functions, by lowering a LAPACK call; loading a program does not."""
    jax.jit(jnp.linalg.cholesky).lower(jax.ShapeDtypeStruct((1, 1), jnp.float32))
