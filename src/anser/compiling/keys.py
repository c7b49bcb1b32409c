"""What a compiled program depends on, as a name under which it is kept."""

import dataclasses
import enum
import functools
import hashlib
import inspect
import os
import platform
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jaxlib
import numpy as np

_FORMAT = 2
_PACKAGE = Path(__file__).parents[1]
_KNOWN = {"anser", "equinox", "jax", "jaxlib", "jaxtyping", "numpy", "scipy"} | sys.stdlib_module_names
_KERNELS = {
    "aircraft",
    "compiling",
    "control",
    "dave_ml",
    "environment",
    "numerics",
    "parts",
    "planning",
    "sensing",
    "simulation",
    "spatial",
    "steady",
}
_SETTINGS = (
    "jax_default_device",
    "jax_default_matmul_precision",
    "jax_default_prng_impl",
    "jax_enable_x64",
    "jax_numpy_dtype_promotion",
    "jax_threefry_partitionable",
)


class NotCacheableError(Exception):
    """A function or argument that nothing but this process knows."""


def describe_value(value: Any) -> str:
    """All of a value that a compiled function depends on: structure, static parts, shapes and types of arrays.

    Raises
    ------
    NotKeptError
        Part of it is code that is not the package's own, which could be other code in the next process.
    """
    if isinstance(value, np.ndarray | np.generic | jax.Array | jax.ShapeDtypeStruct):
        return f"{value.dtype}{list(value.shape)}{'~' if getattr(value, 'weak_type', False) else ''}"
    if value is None or isinstance(value, bool | int | float | complex | str | bytes):
        return repr(value)
    if isinstance(value, enum.Enum):
        return f"{_name(type(value))}.{value.name}"
    if isinstance(value, dict):
        return "{" + ",".join(f"{describe_value(k)}:{describe_value(v)}" for k, v in value.items()) + "}"
    if isinstance(value, frozenset | set):
        return "set{" + ",".join(sorted(map(describe_value, value))) + "}"
    if isinstance(value, tuple | list):
        return f"{_name(type(value))}({','.join(map(describe_value, value))})"
    if isinstance(value, functools.partial):
        return f"partial({describe_value(value.func)},{describe_value(value.args)},{describe_value(value.keywords)})"
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = (f"{f.name}={describe_value(getattr(value, f.name, None))}" for f in dataclasses.fields(value))
        return f"{_name(type(value))}({','.join(fields)})"
    if isinstance(value, np.dtype):
        return str(value)
    if isinstance(value, type) or callable(value):
        return _name(value)
    raise NotCacheableError(type(value).__name__)


def _name(code: Any) -> str:
    """Name of a class or function of a package that is known by its version."""
    module, name = getattr(code, "__module__", None), getattr(code, "__qualname__", "<")
    if module is None or module.split(".")[0] not in _KNOWN or "<" in name:
        raise NotCacheableError(f"{module}.{name}")
    return f"{module}.{name}"


def _hashes_of_sources() -> tuple[str, str]:
    """Of the kernels and what they import, and of everything."""
    kernels, everything = hashlib.sha256(), hashlib.sha256()
    for path in sorted(_PACKAGE.rglob("*")):
        if path.suffix in (".py", ".json"):
            place = path.relative_to(_PACKAGE)
            content = str(place).encode() + b"\0" + path.read_bytes()
            everything.update(content)
            if len(place.parts) == 1 or place.parts[0] in _KERNELS:
                kernels.update(content)
    return kernels.hexdigest(), everything.hexdigest()


_KERNEL_SOURCES, _ALL_SOURCES = _hashes_of_sources()
"""When this was imported: what is edited later is not what runs."""


def _sources_of(description: str) -> str:
    """Hash of the sources on which a program depends: imports point downwards, from no kernel to any other room."""
    rooms = set(re.findall(r"\banser\.(\w+)\.", description))
    return _KERNEL_SOURCES if rooms <= _KERNELS else _ALL_SOURCES


def _as_loaded() -> str:
    """Names and numbers of the kernels' modules, as they stand in this process: somebody may have replaced some.

    Raises
    ------
    NotKeptError
        Code of somebody else stands there.
    """
    found = []

    def add(place: str, value: Any) -> None:
        if inspect.isfunction(value) or inspect.isclass(value):
            if value.__module__.split(".")[0] not in _KNOWN:
                raise NotCacheableError(f"{value.__module__}.{value.__qualname__}")
            found.append(f"{place}:{value.__module__}.{value.__qualname__}")
        elif isinstance(value, bool | int | float | str):
            found.append(f"{place}={value!r}")

    for name, module in sorted(sys.modules.items()):
        if name.startswith("anser.") and name.split(".")[1] in _KERNELS:
            for key, value in vars(module).items():
                if not key.startswith("__"):
                    add(f"{name}.{key}", value)
                if inspect.isclass(value) and value.__module__ == name:
                    for of, method in vars(value).items():
                        if inspect.isfunction(method):
                            add(f"{name}.{key}.{of}", method)
    return hashlib.sha256("\n".join(found).encode()).hexdigest()


def _target() -> str:
    """Fingerprint of the machine that XLA compiles for: a CPU with its features; empty where it gives none."""
    try:
        from jax._src.lib import xla_client  # pyright: ignore[reportPrivateImportUsage] - another version may lack it

        return str(xla_client.get_topology_for_devices(jax.devices()).fingerprint())
    except (ImportError, AttributeError, jax.errors.JaxRuntimeError):
        return ""


@functools.cache
def _surroundings() -> str:
    """Everything but code and arguments on which a compiled program depends: versions, machine."""
    versions = [f"{module.__name__} {module.__version__}" for module in (jax, jaxlib, np, eqx)]
    device = jax.devices()[0]
    machine = [platform.platform(), platform.machine(), device.platform, device.device_kind, str(len(jax.devices()))]
    target = _target()
    if device.platform == "cpu" and not target:
        raise NotCacheableError("code for a processor whose features are not known")
    machine.append(target)
    return "\n".join([str(_FORMAT), sys.version, *versions, *machine])


def jax_settings() -> str:
    """What the user can change from one call to the next."""
    values = [f"{name}={getattr(jax.config, name)}" for name in _SETTINGS]
    return "\n".join([*values, os.environ.get("XLA_FLAGS", "")])


def program_key(value: Any) -> str:
    """Name of a program that depends on a value, and on the package, its surroundings and the settings.

    Raises
    ------
    NotKeptError
        Part of it is code that another process could not be sure of.
    """
    description = describe_value(value)
    parts = [_surroundings(), _sources_of(description), jax_settings(), _as_loaded(), description]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def operations_key(text: str, options: Mapping[str, bool | str]) -> str:
    """Key of a lowered program by its operations: they say all of what code computes that is not the package's own.

    Parameters
    ----------
    text
        StableHLO of the program with all of its constants.
    options
        Of the compiler.
    """
    parts = ["operations", _surroundings(), jax_settings(), repr(sorted(options.items())), text]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()
