"""Keys under which compiled programs are stored: hashes of everything on which the machine code depends."""

import dataclasses
import enum
import functools
import hashlib
import inspect
import itertools
import os
import platform
import re
import sys
from collections.abc import Mapping
from operator import is_
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jaxlib
import numpy as np

_FORMAT = 2
_ROOT = "anser"
_PACKAGE = Path(__file__).parents[1]
_TRUSTED = {"anser", "equinox", "jax", "jaxlib", "jaxtyping", "numpy", "scipy"} | sys.stdlib_module_names
_INTERFACE_LIBRARIES = {
    "gymnasium",
    "pettingzoo",
    "pydantic",
    "pydantic_core",
    "rich",
    "starlette",
    "typer",
}
"""Libraries that modules behind a program may import, but that no program contains."""
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
_KERNEL_MODULES = {"analysis.linearization", "analysis.loop_margins"}
"""Modules of other subpackages that import only kernels."""
_SETTINGS = (
    "jax_default_device",
    "jax_default_matmul_precision",
    "jax_default_prng_impl",
    "jax_enable_x64",
    "jax_numpy_dtype_promotion",
    "jax_threefry_partitionable",
)


class NotCacheableError(Exception):
    """The program cannot be stored, because another process could not identify a function or argument reliably."""


def describe_value(value: Any) -> str:
    """Describe, as text, the properties of a value on which compiled code depends.

    The properties are the structure, static values, and the shapes and types of arrays, but not their numbers. Raises
    NotCacheableError if the value contains code from outside the trusted packages, or an object of a class that this
    function cannot describe.
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
    """Return the qualified name of a class or function; raises NotCacheableError if its package is not trusted."""
    module, name = getattr(code, "__module__", None), getattr(code, "__qualname__", "<")
    if module is None or module.split(".")[0] not in _TRUSTED or "<" in name:
        raise NotCacheableError(f"{module}.{name}")
    return f"{module}.{name}"


def _is_kernel(room: str, module: str) -> bool:
    return room in _KERNELS or f"{room}.{module}" in _KERNEL_MODULES


def _hash_sources() -> tuple[str, str]:
    """Return the hash of the source files of kernels (`_is_kernel`) and top-level modules, and of all files."""
    kernels, everything = hashlib.sha256(), hashlib.sha256()
    for path in sorted(_PACKAGE.rglob("*")):
        if path.suffix in (".py", ".json"):
            relative_path = path.relative_to(_PACKAGE)
            content = str(relative_path).encode() + b"\0" + path.read_bytes()
            everything.update(content)
            room, *modules = relative_path.with_suffix("").parts
            if not modules or _is_kernel(room, modules[0]):
                kernels.update(content)
    return kernels.hexdigest(), everything.hexdigest()


_KERNEL_SOURCES, _ALL_SOURCES = _hash_sources()
"""Hashes of the source files, made at import: later edits of the files do not change the running code."""


def _source_hash(description: str) -> str:
    """Return the hash of the source files on which the program with this description depends."""
    # kernels import only kernels
    modules = re.findall(r"\banser\.(\w+)\.(\w+)", description)
    return _KERNEL_SOURCES if all(itertools.starmap(_is_kernel, modules)) else _ALL_SOURCES


class _ModuleDescription(NamedTuple):
    """Description of a module, which changes if a function or constant is replaced at run time."""

    bindings: list[Any]  # names and values in the module, then in each of its classes
    modules: frozenset[str]  # names of the anser modules from which the values come
    text: str  # a line for each function, class and constant, with its name


_descriptions: dict[str, _ModuleDescription] = {}


def _describe_module(module: ModuleType) -> _ModuleDescription:
    """Return the description of a module; the stored description if no name has a new value since the last call."""
    name = module.__name__
    namespaces = [vars(module)]
    namespaces += [
        vars(value) for value in vars(module).values() if inspect.isclass(value) and value.__module__ == name
    ]
    bindings = [entry for namespace in namespaces for entry in (*namespace, *namespace.values())]
    former = _descriptions.get(name)
    if former is not None and len(former.bindings) == len(bindings) and all(map(is_, former.bindings, bindings)):
        return former
    entries, modules = [], set()

    def add(qualified_name: str, value: Any) -> None:
        if inspect.isfunction(value) or inspect.isclass(value):
            if value.__module__.split(".")[0] not in _TRUSTED | _INTERFACE_LIBRARIES:
                raise NotCacheableError(f"{value.__module__}.{value.__qualname__}")
            entries.append(f"{qualified_name}:{value.__module__}.{value.__qualname__}")
        elif isinstance(value, np.ndarray | jax.Array):
            array = np.asarray(value)
            content = hashlib.sha256(array.tobytes()).hexdigest()
            entries.append(f"{qualified_name}={array.dtype}{array.shape}{content}")
        elif isinstance(value, tuple):
            for k, part in enumerate(value):
                add(f"{qualified_name}[{k}]", part)
        elif isinstance(value, bool | int | float | str):
            entries.append(f"{qualified_name}={value!r}")

    for key, value in vars(module).items():
        owner = value.__name__ if inspect.ismodule(value) else getattr(value, "__module__", None)
        if isinstance(owner, str) and owner.startswith(f"{_ROOT}."):
            modules.add(owner)
        if not key.startswith("__"):
            add(f"{name}.{key}", value)
        if inspect.isclass(value) and value.__module__ == name:
            for method_name, method in vars(value).items():
                if inspect.isfunction(method):
                    add(f"{name}.{key}.{method_name}", method)
    _descriptions[name] = _ModuleDescription(bindings, frozenset(modules), "\n".join(entries))
    return _descriptions[name]


def _modules_behind(description: str) -> dict[str, _ModuleDescription]:
    """Return descriptions, by name, of the loaded anser modules in `description`, and of modules used by these."""
    # Other loaded modules are left out: a program's key must not depend on further imports of the process.
    modules: dict[str, _ModuleDescription] = {}
    names = set(re.findall(r"\banser(?:\.\w+)+", description))
    while names:
        name = names.pop()
        module = sys.modules.get(name)
        if module is None:  # a class or function: the module before the last dot
            names.update({name.rpartition(".")[0]} - {_ROOT})
        elif name not in modules and not hasattr(module, "__path__"):
            modules[name] = _describe_module(module)
            names.update(modules[name].modules)
    return modules


def _hash_loaded_code(description: str) -> str:
    """Return a hash that changes if a function or constant on which a program depends is replaced at run time."""
    texts = [module.text for _, module in sorted(_modules_behind(description).items())]
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()


def _target_fingerprint() -> str:
    """Return XLA's fingerprint of the target machine, such as a CPU with its features; empty if XLA reports none."""
    try:
        from jax._src.lib import xla_client  # pyright: ignore[reportPrivateImportUsage] - another version may lack it

        return str(xla_client.get_topology_for_devices(jax.devices()).fingerprint())
    except (ImportError, AttributeError, jax.errors.JaxRuntimeError):
        return ""


@functools.cache
def _describe_platform() -> str:
    """Describe, as text, the software versions and the machine on which compiled code depends."""
    versions = [f"{module.__name__} {module.__version__}" for module in (jax, jaxlib, np, eqx)]
    device = jax.devices()[0]
    machine = [platform.platform(), platform.machine(), device.platform, device.device_kind, str(len(jax.devices()))]
    target = _target_fingerprint()
    if device.platform == "cpu" and not target:
        raise NotCacheableError("code for a processor whose features are not known")
    machine.append(target)
    return "\n".join([str(_FORMAT), sys.version, *versions, *machine])


def jax_settings() -> str:
    """Describe, as text, the JAX settings that the user can change between calls."""
    values = [f"{name}={getattr(jax.config, name)}" for name in _SETTINGS]
    return "\n".join([*values, os.environ.get("XLA_FLAGS", "")])


def program_key(value: Any) -> str:
    """Return the key of a program; `value` is its function, arguments and compiler options.

    The key is a hash of the description of `value` (`describe_value`), the package sources, the platform and the JAX
    settings. Raises NotCacheableError if `describe_value` raises this error, if a module of the program contains code
    from outside the trusted packages, or if XLA does not report the features of the CPU.
    """
    description = describe_value(value)
    parts = [
        _describe_platform(),
        _source_hash(description),
        jax_settings(),
        _hash_loaded_code(description),
        description,
    ]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def operations_key(
    text: str,  # StableHLO of the program with its constants
    options: Mapping[str, bool | str],  # compiler options
) -> str:
    """Return the key of a lowered program: a hash of its operations, in which code of any package is allowed."""
    parts = ["operations", _describe_platform(), jax_settings(), repr(sorted(options.items())), text]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()
