"""Compiling what runs for milliseconds: then the compiler's time is all that counts."""

import functools
from collections.abc import Callable, Sequence
from typing import ParamSpec, TypeVar

import jax
import jax.numpy as jnp

from anser.compiling.program import Program

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


def known_options(wanted: dict[str, bool | str]) -> dict[str, bool | str]:
    """Those of some options that the compiler takes: XLA gives them up from one version to the next."""
    return {option: value for option, value in wanted.items() if _known(option, value)}


def compiled(function: Callable[_P, _R]) -> Program[_P, _R]:
    """Compile a function, with the compiler's own options."""
    return Program(function, dict)


def compiled_quickly(function: Callable[_P, _R]) -> Program[_P, _R]:
    """Compile a function without XLA's optimizer, in a sixth to a half of the time (measured: trims, linear models).

    The function runs more slowly, and its results differ by rounding.
    """
    return Program(function, lambda: known_options(_UNOPTIMIZED))


def compiled_by_older_generator(
    static_argnames: Sequence[str],
) -> Callable[[Callable[_P, _R]], Program[_P, _R]]:
    """Compile by XLA's older code generator for the CPU, where the installed one still has it.

    That compiles large programs in half the time, and they run as fast. All arguments but those named are traced.
    """

    def decorate(function: Callable[_P, _R]) -> Program[_P, _R]:
        return Program(function, lambda: known_options(_OLDER_GENERATOR), static_argnames)

    return decorate
