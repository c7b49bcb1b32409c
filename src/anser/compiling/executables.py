"""Compiled programs as bytes, machine code and JSON, no part of which Python runs (as it runs a pickle); their call."""

import functools
import json
import re
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.sharding import SingleDeviceSharding

from anser.compiling.keys import NotKeptError
from anser.compiling.structures import decode, encode

_FEATURES = re.compile(rb"\+[a-z0-9._\-]+(?:,[+\-][a-z0-9._\-]+){8,}")
"""Processor features that code for a CPU declares as required: `+64bit,+avx,-sgx, ...`."""


class Executable(NamedTuple):
    """Machine code, and the indices of the arguments that it takes; unused arguments are left out."""

    code: bytes
    argument_indices: list[int]


def pack_program(compiled: jax.stages.Compiled, result: Any) -> bytes:
    """Length of the JSON header, the header (structure of the result, indices of arguments), the code.

    Raises
    ------
    NotKeptError
        The program calls back into Python, has effects or is for other devices, or its result has a foreign class.
    """
    executable = _serialize(compiled)
    header = json.dumps({"result": encode(result), "argument_indices": executable.argument_indices}).encode()
    return len(header).to_bytes(8, "big") + header + executable.code


def unpack_program(content: bytes, argument_count: int) -> tuple[Executable, Any]:
    """Code, and the structure of its result with `jax.ShapeDtypeStruct` in the place of arrays.

    Raises
    ------
    NotKeptError, ValueError, KeyError, TypeError
        The header is none that `pack_program` writes, or the program is for fewer arguments.
    """
    end = 8 + int.from_bytes(content[:8], "big")
    header = json.loads(content[8:end])
    executable = Executable(content[end:], header["argument_indices"])
    if not set(executable.argument_indices) <= set(range(argument_count)):
        raise NotKeptError(f"arguments {executable.argument_indices} of {argument_count}")
    if b"lapack_" in executable.code:
        _register_lapack()
    return executable, decode(header["result"])


def load_executable(
    executable: Executable, results: Iterable[jax.ShapeDtypeStruct]
) -> Callable[[list[Any]], list[Any]]:
    """Load code on the first device; what is returned takes all arguments and gives arrays of the results' shapes.

    Raises
    ------
    ImportError, AttributeError
        This version of JAX has other internals: then programs are compiled anew.
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
        # NumPy's arrays are taken, too, as by a program that was compiled here
        taken = (arrays[index] for index in indices)
        arguments = [array if isinstance(array, jax.Array) else jax.device_put(array, device) for array in taken]
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
        raise NotKeptError("an executable that is more than its code")
    return Executable(compiled.runtime_executable().serialize(), sorted(whole.kept_var_idx))


def _without_features(code: bytes) -> bytes:
    """Code that declares no processor feature as required.

    XLA compares the declared features with the processor's when code is loaded, and reports `prefer-no-gather` and
    `prefer-no-scatter` as missing: preferences of its own compiler, which no processor has. The comparison is not
    needed here. The key of a program has the features of the processor, so that code for another one is never loaded.
    """
    return _FEATURES.sub(lambda features: features[0].replace(b"+", b"-"), code)


@functools.cache
def _register_lapack() -> None:
    """Have JAX look up LAPACK's functions, which it does when it lowers a call of one, not when it loads one."""
    jax.jit(jnp.linalg.cholesky).lower(jax.ShapeDtypeStruct((1, 1), jnp.float32))
