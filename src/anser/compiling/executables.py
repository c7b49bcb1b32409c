"""Machine code of XLA as bytes, and its call: no part of it is run by Python, as a pickle would be."""

import re
from collections.abc import Callable, Sequence
from typing import Any

import jax
from jax._src import core
from jax._src.interpreters import pxla
from jax._src.lib import xla_client  # pyright: ignore[reportPrivateImportUsage]
from jax.sharding import SingleDeviceSharding

from anser.compiling.keys import NotKeptError

_FEATURES = re.compile(rb"\+[a-z0-9._\-]+(?:,[+\-][a-z0-9._\-]+){8,}")
"""The processor's features that code for a CPU says it needs: `+64bit,+avx,-sgx, ...`."""


def serialized(compiled: jax.stages.Compiled) -> tuple[bytes, list[int]]:
    """Code of a program for the first device, and the indices of the arguments that it takes.

    Raises
    ------
    NotKeptError
        It calls back into Python, has effects, or is for other devices.
    """
    held: Any = compiled
    whole = held._executable._unloaded_executable
    if (
        tuple(whole.device_list) != (jax.devices()[0],)
        or whole.unordered_effects
        or whole.ordered_effects
        or whole.host_callbacks
        or whole.keepalive
        or whole.mut is not None
        or held._params.const_args
    ):
        raise NotKeptError("an executable that is more than its code")
    return held.runtime_executable().serialize(), sorted(whole.kept_var_idx)


def loaded(
    code: bytes, taken: Sequence[int], results: Sequence[jax.ShapeDtypeStruct]
) -> Callable[[list[Any]], list[Any]]:
    """Call of serialized code: all arguments in, arrays of the shapes of the results out."""
    device = jax.devices()[0]
    devices = xla_client.DeviceList((device,))
    executable = device.client.deserialize_executable(_without_features(code), executable_devices=devices)
    shapes = [core.ShapedArray(shape.shape, shape.dtype, weak_type=shape.weak_type) for shape in results]
    wrap = pxla.global_avals_to_results_handler(shapes, [SingleDeviceSharding(device)] * len(shapes), False).handlers

    def call(arrays: list[Any]) -> list[Any]:
        return executable.execute_sharded([arrays[index] for index in taken]).consume_with_handlers(wrap)

    return call


def _without_features(code: bytes) -> bytes:
    """Code that says that it needs no features of the processor.

    XLA compares them with the processor's when it loads code, and warns of `prefer-no-gather` and `prefer-no-scatter`,
    preferences of its own compiler, which no processor has. Here the key of a program has the features of the
    processor: code for another one is not loaded at all.
    """
    return _FEATURES.sub(lambda text: text[0].replace(b"+", b"-"), code)
