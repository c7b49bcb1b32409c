"""Compiling what runs for milliseconds: then the compiler's time is all that counts."""

import functools
from collections.abc import Callable, Sequence
from typing import ParamSpec, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import Tracer

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


def compiled_quickly(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a function without XLA's optimizer, in a sixth to a half of the time (measured: trims, linear models).

    The function runs more slowly, and its results differ by rounding. Within another compiled function or a derivative
    it is a part of that one, and compiled as that one is.
    """
    within = eqx.filter_jit(function)

    @functools.cache
    def alone() -> Callable[_P, _R]:
        options = known_options(_UNOPTIMIZED)
        return eqx.filter_jit(function, compiler_options=options)  # pyright: ignore[reportCallIssue]

    @functools.wraps(function)
    def call(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        # JAX takes compiler options for the outermost function only.
        traced = any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((args, kwargs)))
        return (within if traced else alone())(*args, **kwargs)

    return call


def compiled_by_older_generator(
    static_argnames: Sequence[str],
) -> Callable[[Callable[_P, _R]], Callable[_P, _R]]:
    """Decorate with `jax.jit` by XLA's older code generator for the CPU, where the installed one still has it.

    That compiles large programs in half the time, and they run as fast. Not for use within another compiled function.
    """

    def decorate(function: Callable[_P, _R]) -> Callable[_P, _R]:
        @functools.cache
        def compiled() -> Callable[_P, _R]:
            options = known_options(_OLDER_GENERATOR)
            return jax.jit(function, static_argnames=static_argnames, compiler_options=options)

        @functools.wraps(function)
        def call(*args: _P.args, **kwargs: _P.kwargs) -> _R:
            return compiled()(*args, **kwargs)

        return call

    return decorate
