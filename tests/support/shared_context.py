"""One MLIR context for many small programs: JAX builds one with all dialects for each program, and keeps it."""

import functools
import threading

from jax import stages
from jax._src.interpreters import mlir
from jax._src.lib.mlir import ir

_RENEWAL = 500  # programs, after which a new context lets the memory of the former go


def _is_lowering() -> bool:
    """Whether a program is being lowered: a program compiled meanwhile would become a part of it in its context."""
    try:
        return ir.InsertionPoint.current is not None
    except ValueError:
        return False


def share_contexts() -> None:
    """Lower the programs that the main thread compiles at once, single operations among them, in a common context.

    A tenth of the time of tests of small functions, and half of their memory. Programs that are lowered for later, as
    anser's are, have a context of their own, since another thread may compile them meanwhile. Another version of JAX
    without these names is left as it is.
    """
    make_context, lower = getattr(mlir, "make_ir_context", None), stages.Traced.lower
    if make_context is None:
        return
    held = {"count": 0, "lowered for later": 0, "context": None}

    def common_context():
        if held["lowered for later"] or _is_lowering() or threading.current_thread() is not threading.main_thread():
            return make_context()
        if held["count"] % _RENEWAL == 0:
            held["context"] = make_context()
        held["count"] += 1
        return held["context"]

    @functools.wraps(lower)
    def lower_for_later(*arguments, **options):
        is_main = threading.current_thread() is threading.main_thread()
        held["lowered for later"] += is_main
        try:
            return lower(*arguments, **options)
        finally:
            held["lowered for later"] -= is_main

    mlir.make_ir_context, stages.Traced.lower = common_context, lower_for_later
