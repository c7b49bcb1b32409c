"""Compiling what runs for milliseconds: then the compiler's time is all that counts."""

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import equinox as eqx
import jax
from jax.core import Tracer

_P = ParamSpec("_P")
_R = TypeVar("_R")
_QUICKLY = {"xla_backend_optimization_level": 0, "xla_cpu_use_fusion_emitters": False}


def compiled_quickly(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a function without XLA's optimizer, in a sixth to a half of the time (measured: trims, linear models).

    The function runs more slowly, and its results differ by rounding. Within another compiled function or a derivative
    it is a part of that one, and compiled as that one is.
    """
    alone = eqx.filter_jit(function, compiler_options=_QUICKLY)  # pyright: ignore[reportCallIssue]
    within = eqx.filter_jit(function)

    @functools.wraps(function)
    def call(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        # JAX takes compiler options for the outermost function only.
        traced = any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((args, kwargs)))
        return (within if traced else alone)(*args, **kwargs)

    return call
