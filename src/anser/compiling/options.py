"""Compilation settings: compiler options of single functions, and the cache folder of the user."""

import functools
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import ParamSpec, TypeVar

import jax
import jax.numpy as jnp
import platformdirs

from anser.compiling.program import Program, use_program_store
from anser.compiling.store import FolderStore

_P = ParamSpec("_P")
_R = TypeVar("_R")
_OLDER_GENERATOR: dict[str, bool | str] = {"xla_cpu_use_fusion_emitters": False}
_UNOPTIMIZED: dict[str, bool | str] = {"xla_backend_optimization_level": "0", **_OLDER_GENERATOR}


@functools.cache
def _known(option: str, value: bool | str) -> bool:
    """Whether the compiler that is installed takes an option: asked once, with a program of one addition."""
    probe = jax.jit(lambda x: x + 1).lower(jax.ShapeDtypeStruct((), jnp.int32))
    try:
        probe.compile({option: value})
    except jax.errors.JaxRuntimeError as error:
        if option not in str(error):
            raise
        return False
    return True


def supported_options(requested: dict[str, bool | str]) -> dict[str, bool | str]:
    """Those of some options that the compiler takes: XLA gives them up from one version to the next."""
    return {option: value for option, value in requested.items() if _known(option, value)}


def compiled(function: Callable[_P, _R]) -> Program[_P, _R]:
    """Compile a function, with the compiler's own options."""
    return Program(function, dict)


def compiled_quickly(function: Callable[_P, _R]) -> Program[_P, _R]:
    """Compile a function without XLA's optimizer, in a sixth to a half of the time (measured: trims, linear models).

    The function runs more slowly, and its results differ by rounding.
    """
    return Program(function, lambda: supported_options(_UNOPTIMIZED))


def compiled_by_older_generator(
    static_argnames: Sequence[str],
) -> Callable[[Callable[_P, _R]], Program[_P, _R]]:
    """Compile by XLA's older code generator for the CPU, where the installed one still has it.

    That compiles large programs in half the time, and they run as fast. All arguments but those named are traced.
    """

    def decorate(function: Callable[_P, _R]) -> Program[_P, _R]:
        return Program(function, lambda: supported_options(_OLDER_GENERATOR), static_argnames)

    return decorate


CACHE_VARIABLE = "ANSER_COMPILATION_CACHE"
"""Environment variable: a folder to use instead of the user's cache folder, or "off"."""


def cache_folder() -> Path | None:
    """Folder of the cache: what `ANSER_COMPILATION_CACHE` says, JAX's own `jax_compilation_cache_dir`, or the user's.

    None where that variable is "off", or where the user has no folder.
    """
    wanted = os.environ.get(CACHE_VARIABLE, "")
    if wanted.lower() == "off":
        return None
    already: str | None = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    folder = Path(wanted or already or platformdirs.user_cache_path("anser") / "compiled")
    return folder if wanted or already or folder.is_absolute() else None


def program_store() -> FolderStore | None:
    """Store of compiled programs in the cache's folder; None without one."""
    folder = cache_folder()
    return None if folder is None else FolderStore(folder / "programs")


def enable_compilation_cache() -> Path | None:
    """Keep programs in `cache_folder`, which is returned; None: they are kept nowhere."""
    use_program_store(program_store())
    return cache_folder()
