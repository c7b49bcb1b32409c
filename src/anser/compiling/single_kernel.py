"""Compiling small arithmetic as one kernel.

XLA makes hundreds of kernels of one step of a small fleet, and a CPU takes longer to dispatch them than to compute.
"""

from collections.abc import Callable, Iterator
from contextvars import ContextVar
from typing import Any

import equinox as eqx
import jax
from jax.experimental.xla_metadata import set_xla_metadata
from jax.extend.core import ClosedJaxpr, Jaxpr, jaxpr_as_fun

COMPUTED_MAX, MOVED_MAX = 320, 16_384
"""Elements of the largest array that is computed, or only moved, within one kernel. XLA divides larger ones among cores
(from 256 KiB on, or 200,000 operations), and cannot do that within a kernel: it ends with an internal fault."""
_MOVES = frozenset(
    """
    broadcast_in_dim concatenate convert_element_type copy copy_p custom_jvp_call custom_vmap_call dynamic_slice
    dynamic_update_slice gather iota jit pad reshape rev scan scatter select_n slice split squeeze stack transpose
    unstack while
    """.split()  # noqa: SIM905 - in quotes they are harder to read
)
_ARITHMETIC = frozenset(
    """
    abs acos add add_any and argmax argmin asin atan atan2 bitcast_convert_type ceil clamp cos cosh cumsum div eq
    erf_inv exp exp2 expm1 floor ge gt integer_pow is_finite le le_to log log1p logistic lt lt_to max min mul ne neg
    not or pow random_bits random_fold_in random_split random_unwrap random_wrap reduce_and reduce_max reduce_min
    reduce_or reduce_prod reduce_sum rem round rsqrt scatter-add shift_left shift_right_arithmetic shift_right_logical
    sign sin sinh sqrt square stop_gradient sub tan tanh threefry2x32 xor
    """.split()  # noqa: SIM905
)
"""Primitives that XLA's CPU compiler never hands to a library, which it cannot call from within a kernel either."""


_tracing: ContextVar[bool] = ContextVar("tracing one kernel", default=False)


def is_tracing_single_kernel() -> bool:
    """Whether what is traced now is meant for one kernel: it can hold no condition, only selections."""
    return _tracing.get()


def _equations(jaxpr: Jaxpr) -> Iterator[Any]:
    """All equations, those of the programs within among them."""
    for equation in jaxpr.eqns:
        yield equation
        within = jax.tree.leaves(equation.params, is_leaf=lambda leaf: isinstance(leaf, Jaxpr | ClosedJaxpr))
        for value in within:
            if isinstance(value, Jaxpr | ClosedJaxpr):
                yield from _equations(value.jaxpr if isinstance(value, ClosedJaxpr) else value)


def is_elementary(jaxpr: Jaxpr) -> bool:
    """Whether a program is only arithmetic on small arrays, which XLA can compile as one kernel of a CPU."""

    def fits(equation: Any) -> bool:
        name, largest = equation.primitive.name, max((out.aval.size for out in equation.outvars), default=0)
        return (name in _ARITHMETIC and largest <= COMPUTED_MAX) or (name in _MOVES and largest <= MOVED_MAX)

    return all(fits(equation) for equation in _equations(jaxpr))


def as_single_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same function, compiled as one kernel where it can be: on a CPU, and if it `is_elementary`.

    To be called while a larger function is traced, which must not be batched afterwards: what was small would be large
    then.
    """

    def call(*args: Any) -> Any:
        if jax.default_backend() != "cpu":
            return function(*args)
        before = _tracing.set(True)
        try:
            traced, shapes, rest = eqx.filter_make_jaxpr(function)(*args)
        finally:
            _tracing.reset(before)
        program, arrays = jaxpr_as_fun(traced), jax.tree.leaves(eqx.filter(args, eqx.is_array))
        if is_elementary(traced.jaxpr):
            # XLA's own attributes of a call, with which it marks the small loops that it makes one kernel itself.
            with set_xla_metadata(inlineable="false", xla_cpu_small_call="true"):
                found = jax.jit(program)(*arrays)
        else:
            found = program(*arrays)
        return eqx.combine(jax.tree.unflatten(jax.tree.structure(shapes), found), rest)

    return call
