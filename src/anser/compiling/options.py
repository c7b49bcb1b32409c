"""Compilation settings: compiler options of functions, division of a batch among cores, and the user's cache folder."""

import functools
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import ParamSpec, TypeVar

import jax
import platformdirs

from anser.compiling.measuring import usable_cores
from anser.compiling.program import Program, use_program_store
from anser.compiling.store import FolderStore

_P = ParamSpec("_P")
_R = TypeVar("_R")
OLDER_GENERATOR: dict[str, bool | str] = {"xla_cpu_use_fusion_emitters": False}
"""Option for XLA's older code generator for the CPU; not used if the installed XLA rejects the option."""
_FEWER_COPIES: dict[str, bool | str] = {"xla_cpu_copy_insertion_use_region_analysis": True}
_UNOPTIMIZED: dict[str, bool | str] = {"xla_backend_optimization_level": "0", **OLDER_GENERATOR}


def compiled(function: Callable[_P, _R], title: str | None = None) -> Program[_P, _R]:
    """Return a program of a function, compiled with XLA's optimizer at the first call.

    `title` names the program in messages to the user; None: the function's name.
    """
    return Program(function, {}, title=title)


def compiled_quickly(function: Callable[_P, _R], title: str | None = None) -> Program[_P, _R]:
    """Return a program of a function, compiled without XLA's optimizer in a sixth to a half of the time.

    The program runs more slowly, and its results differ by rounding. `title` names the program in messages to the user;
    None: the function's name.
    """
    return Program(function, _UNOPTIMIZED, title=title)


def compiled_by_older_generator(
    static_argnames: Sequence[str] | None,
    title: str | None = None,  # name of the program in messages to the user; None: the function's name
    fewer_copies: bool = False,  # whether XLA looks in loops and conditions for arrays that need not be copied
) -> Callable[[Callable[_P, _R]], Program[_P, _R]]:
    """Return a decorator that makes a program of a function with XLA's older code generator for the CPU.

    Large programs compile in half the time and run at the same speed. If the installed XLA lacks the older generator,
    its present generator is used. `static_argnames` are the names of static arguments; None: arguments without arrays
    are static.
    """
    options = OLDER_GENERATOR | (_FEWER_COPIES if fewer_copies else {})

    def decorate(function: Callable[_P, _R]) -> Program[_P, _R]:
        return Program(function, options, static_argnames, title)

    return decorate


def blocks_on_cores(
    count: int,
    least: int,  # least number of rows of a block; for fewer rows, another thread costs more time than it saves
) -> list[slice]:
    """Divide a batch of `count` rows into equal blocks for computation in parallel; return their slices.

    The number of blocks is the greatest divisor of `count` that is at most the number of usable cores and leaves each
    block `least` rows or more; at least 1. On a device other than a CPU, one block holds the whole batch.
    """
    most = min(usable_cores(), count // least) if jax.default_backend() == "cpu" else 1
    number = next((number for number in range(most, 1, -1) if count % number == 0), 1)
    size = count // number
    return [slice(k * size, (k + 1) * size) for k in range(number)]


def call_on_cores(calls: Sequence[Callable[[], _R]]) -> list[_R]:
    """Call one or more compiled functions in parallel, the last on this thread, and return their results in order."""
    *others, last = calls
    pending = [_threads().submit(lambda call: jax.block_until_ready(call()), call) for call in others]
    result = last()
    return [*(future.result() for future in pending), result]


@functools.cache
def _threads() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(usable_cores(), thread_name_prefix="anser")


CACHE_VARIABLE = "ANSER_COMPILATION_CACHE"
"""Environment variable with a folder that replaces the user's cache folder, or with "off" for no cache."""


def cache_folder() -> Path | None:
    """Return the folder of compiled programs; None if `ANSER_COMPILATION_CACHE` is "off" or no folder is available.

    The folder is the first that is set: the environment variable `ANSER_COMPILATION_CACHE`, JAX's setting
    `jax_compilation_cache_dir`, the folder for anser in the user's cache folder.
    """
    environment_value = os.environ.get(CACHE_VARIABLE, "")
    if environment_value.lower() == "off":
        return None
    jax_folder: str | None = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    folder = Path(environment_value or jax_folder or platformdirs.user_cache_path("anser") / "compiled")
    return folder if environment_value or jax_folder or folder.is_absolute() else None


def program_store() -> FolderStore | None:
    """Return the store of compiled programs in the cache folder; None if there is no cache folder."""
    folder = cache_folder()
    return None if folder is None else FolderStore(folder / "programs")


def enable_compilation_cache() -> Path | None:
    """Store programs compiled from now on in `cache_folder`, and return the folder; None if caching is off."""
    use_program_store(program_store())
    return cache_folder()
