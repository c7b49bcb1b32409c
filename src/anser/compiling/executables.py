"""Serialization of compiled programs: machine code, and a JSON header with the structure of the result.

Unlike a pickle, the file contains no Python code that loading would execute.
"""

import dataclasses
import enum
import functools
import importlib
import json
import re
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import SingleDeviceSharding

from anser.compiling.keys import NotCacheableError

_PACKAGE = "anser"


def encode_structure(value: Any) -> Any:
    """Return the structure of a program's result as a value for `json.dumps`.

    `value` is the result with `jax.ShapeDtypeStruct` in place of arrays. Raises NotCacheableError if the result
    contains a class or data type that `decode_structure` rejects.
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
    return {"class": [name, {field: encode_structure(getattr(value, field)) for field in _field_names(type(value))}]}


def decode_structure(value: Any) -> Any:
    """Return the structure that `encode_structure` has encoded, with `jax.ShapeDtypeStruct` in place of arrays.

    No code of the encoded classes is executed. Raises NotCacheableError if `value` is not a result of
    `encode_structure`.
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
        case "class", [str(name), dict(fields)] if list(fields) == list(_field_names(_class(name))):
            return _instance(_class(name), {field: decode_structure(item) for field, item in fields.items()})
        case _:
            raise NotCacheableError(repr(value)[:80])


def _dtype(name: str) -> np.dtype[Any]:
    """Return NumPy's data type `name`; raises NotCacheableError unless it is a type of numbers or Booleans."""
    try:
        dtype = np.dtype(name)
    except TypeError as error:
        raise NotCacheableError(name) from error
    if dtype.kind not in "biufc" or dtype.name != name:
        raise NotCacheableError(name)
    return dtype


def _class(name: str) -> type[Any]:
    """Return the class that the text MODULE:CLASS names; raises NotCacheableError if anser does not define it."""
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


def _field_names(class_: type[Any]) -> tuple[str, ...]:
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
"""Pattern of the processor features that code for a CPU declares as required: `+64bit,+avx,-sgx, ...`."""


class Executable(NamedTuple):
    """Machine code of a program."""

    code: bytes
    argument_indices: list[int]  # positions, among all arguments, of the arguments that the code uses


def pack_program(compiled: jax.stages.Compiled, result: Any) -> bytes:
    """Serialize a compiled program; `result` is its result with `jax.ShapeDtypeStruct` in place of arrays.

    Raises NotCacheableError if the program calls back into Python, has side effects, runs on another device than JAX's
    first, or returns a class from outside the package.
    """
    executable = _serialize(compiled)
    header = json.dumps({"result": encode_structure(result), "argument_indices": executable.argument_indices}).encode()
    # length of the JSON header, header, machine code
    return len(header).to_bytes(8, "big") + header + executable.code


def unpack_program(content: bytes, argument_count: int) -> tuple[Executable, Any]:
    """Return the executable and the structure of the result from a program file that `pack_program` has made.

    Raises NotCacheableError, ValueError, KeyError or TypeError if the header is not from `pack_program`, or an argument
    index is not below `argument_count`.
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
    """Load machine code on the first device; return a function from a list of arguments to a list of result arrays.

    `results` are shapes and types of the result arrays. Raises ImportError or AttributeError if the internals of the
    installed JAX differ; the caller must then compile the program.
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
    code = compiled.runtime_executable().serialize()
    if jax.devices()[0].platform == "cpu":
        code = without_fused_instructions(code)
    return Executable(code, sorted(whole.kept_var_idx))


def _without_features(code: bytes) -> bytes:
    """Return serialized code in which no processor feature is declared as required."""
    # XLA would report preferences of its compiler, such as `prefer-no-gather`, as missing features of the processor.
    # XLA's check is redundant: the key of a program includes the processor features.
    return _FEATURES.sub(lambda features: features[0].replace(b"+", b"-"), code)


@functools.cache
def _register_lapack() -> None:
    """Make JAX register its LAPACK functions by lowering a LAPACK call; loading a program does not register them."""
    jax.jit(jnp.linalg.cholesky).lower(jax.ShapeDtypeStruct((1, 1), jnp.float32))


_EXECUTABLE, _MODULE_CONFIG, _MODULE, _COMPUTATION = 1, 1, 1, 3
_INSTRUCTION, _COMPUTATION_ID, _ROOT_ID, _IS_FUSED = 2, 5, 6, 7
_NAME, _OPCODE, _SHAPE, _FUSION_KIND, _CALL_TARGET, _ID, _CALLED_IDS = 1, 2, 3, 11, 28, 35, 38
"""Numbers of fields in XLA's messages: xla/service/hlo.proto, xla/service/cpu/executable.proto."""
_COMPILED_FUSIONS = {b"kLoop", b"kInput", b"kOutput"}
"""Kinds of fusions (groups of operations in one kernel) that are stored as machine code; custom fusions are not."""


def without_fused_instructions(code: bytes) -> bytes:
    """Return the serialized code of a CPU program without the instructions that XLA has compiled into fused kernels.

    The smaller code loads in half the time: XLA reads the instructions again on loading, but needs only the parameters
    and the shape of the result. Code in an unexpected form is returned unchanged.
    """
    try:
        length, start = _number(code, 0)  # of a header
        program = code[start + length :]
        return code[: start + length] + _replace(program, (_EXECUTABLE, _MODULE_CONFIG, _MODULE), _shrink_module)
    except (ValueError, IndexError):
        return code


def _shrink_module(module: bytes) -> bytes:
    """Return a serialized program (XLA's HloModule) with `_shrink` applied to the computations of fused kernels."""
    computations = [module[start:end] for number, _, start, end in _fields(module) if number == _COMPUTATION]
    compiled_ids: set[int] = set()
    for computation in computations:
        if not _integer(computation, _IS_FUSED):
            for number, _, start, end in _fields(computation):
                if number == _INSTRUCTION and _has_opcode(computation, start, end, b"fusion"):
                    compiled_ids.update(_called_ids(computation[start:end]))

    def shrink(computation: bytes) -> bytes:
        return _shrink(computation) if _integer(computation, _COMPUTATION_ID) in compiled_ids else computation

    return _replace(module, (_COMPUTATION,), shrink)


def _called_ids(fusion: bytes) -> list[int]:
    """Return the identifiers of the computations that a fusion calls; empty if it is not compiled to machine code."""
    identifiers: list[int] = []
    if _bytes(fusion, _FUSION_KIND) in _COMPILED_FUSIONS:
        called, end = _bytes(fusion, _CALLED_IDS), 0
        while end < len(called):
            identifier, end = _number(called, end)
            identifiers.append(identifier)
    return identifiers


def _shrink(computation: bytes) -> bytes:
    """Reduce a fused kernel's computation to the parameters, and a call without operands that stands for the result."""
    properties, instructions = [], []
    for number, begin, start, end in _fields(computation):
        (instructions if number == _INSTRUCTION else properties).append((begin, start, end))
    *operations, (_, start, end) = instructions
    result = computation[start:end]
    if _integer(result, _ID) != _integer(computation, _ROOT_ID):
        raise ValueError("the last instruction of a fused computation is not its result")
    if _has_opcode(computation, start, end, b"parameter"):  # the result is a parameter
        return computation
    identity = [result[begin:end] for number, begin, _, end in _fields(result) if number in (_NAME, _SHAPE, _ID)]
    call = b"".join([*identity, _with_length(_OPCODE, b"custom-call"), _with_length(_CALL_TARGET, b"compiled")])
    parameters = (field for field in operations if _has_opcode(computation, field[1], field[2], b"parameter"))
    unchanged_fields = (computation[begin:end] for begin, _, end in (*properties, *parameters))
    return b"".join([*unchanged_fields, _with_length(_INSTRUCTION, call)])


def _has_opcode(message: bytes, start: int, end: int, opcode: bytes) -> bool:
    """Whether the instruction in the bytes `start` to `end` of a message has the operation code `opcode`."""
    # The first field of an instruction is its name, the second its operation code.
    name_length = message[start + 1]
    if name_length < 128:
        return message.startswith(bytes([_OPCODE << 3 | 2, len(opcode)]) + opcode, start + 2 + name_length)
    return _bytes(message[start:end], _OPCODE) == opcode


def _replace(message: bytes, path: tuple[int, ...], function: Callable[[bytes], bytes]) -> bytes:
    """Return a message with `function` applied to each embedded message at a path of field numbers, outermost first."""
    if not path:
        return function(message)
    return b"".join(
        _with_length(number, _replace(message[start:end], path[1:], function))
        if number == path[0]
        else message[begin:end]
        for number, begin, start, end in _fields(message)
    )


def _fields(message: bytes) -> Iterator[tuple[int, int, int, int]]:
    """Yield (number, begin, begin of value, end) of each field in a message of Protocol Buffers.

    Raises ValueError if a field has an unknown type, or the message ends within a field.
    """
    end, size = 0, len(message)
    while end < size:
        begin = end
        tag, start = _number(message, begin)
        match tag & 7:
            case 0:
                _, end = _number(message, start)
            case 1:
                end = start + 8
            case 2:
                length, start = _number(message, start)
                end = start + length
            case 5:
                end = start + 4
            case _:
                raise ValueError("no message of Protocol Buffers")
        if end > size:
            raise ValueError("the message ends within a field")
        yield tag >> 3, begin, start, end


def _integer(message: bytes, number: int) -> int:
    """Return the integer value of a message's first field with the given number; 0 if the field is missing."""
    return next((_number(message, start)[0] for field, _, start, _ in _fields(message) if field == number), 0)


def _bytes(message: bytes, number: int) -> bytes:
    """Return the content of a message's first field with the given number; empty if the field is missing."""
    return next((message[start:end] for field, _, start, end in _fields(message) if field == number), b"")


def _number(message: bytes, position: int) -> tuple[int, int]:
    """Return the integer of variable length (seven bits per byte) at a position, and the position after the integer."""
    value = message[position]
    if value < 128:
        return value, position + 1
    value, shift = value & 127, 7
    while True:
        position += 1
        part = message[position]
        value |= (part & 127) << shift
        if part < 128:
            return value, position + 1
        shift += 7


def _with_length(number: int, value: bytes) -> bytes:
    """Encode a field of Protocol Buffers with bytes as its value: tag, length, value."""
    return _encode(number << 3 | 2) + _encode(len(value)) + value


def _encode(number: int) -> bytes:
    """Encode an integer with variable length: seven bits in each byte, the lowest first."""
    encoded = bytearray()
    while number > 127:
        encoded.append(number & 127 | 128)
        number >>= 7
    encoded.append(number)
    return bytes(encoded)
