"""Compilation of small computations as a single CPU kernel.

XLA divides a step of a small fleet into hundreds of kernels, whose dispatch takes longer than the computation.
"""

from collections.abc import Callable, Iterator
from contextvars import ContextVar
from typing import Any

import equinox as eqx
import jax
from jax.experimental.xla_metadata import set_xla_metadata
from jax.extend.core import ClosedJaxpr, Jaxpr, jaxpr_as_fun

COMPUTED_MAX, MOVED_MAX = 512, 16_384
"""Greatest sizes, in elements, of computed arrays and of merely moved arrays within one kernel. XLA divides larger
arrays (from 256 KiB or 200,000 operations) among cores, which ends with an internal fault inside a kernel."""
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
"""JAX primitives that XLA's CPU compiler computes without a library; a single kernel cannot call a library."""


_tracing: ContextVar[bool] = ContextVar("tracing one kernel", default=False)


def is_tracing_single_kernel() -> bool:
    """Whether the code being traced may become a single kernel.

    Such code may use selections (`jnp.where`), which compute both alternatives, but no conditions (`jax.lax.cond`).
    """
    return _tracing.get()


def _equations(jaxpr: Jaxpr) -> Iterator[Any]:
    """Yield the equations (operations) of a traced program and, recursively, of the programs nested in it."""
    for equation in jaxpr.eqns:
        yield equation
        within = jax.tree.leaves(equation.params, is_leaf=lambda leaf: isinstance(leaf, Jaxpr | ClosedJaxpr))
        for value in within:
            if isinstance(value, Jaxpr | ClosedJaxpr):
                yield from _equations(value.jaxpr if isinstance(value, ClosedJaxpr) else value)


def is_elementary(jaxpr: Jaxpr) -> bool:
    """Whether a traced program is only arithmetic on small arrays, which XLA can compile as a single CPU kernel."""

    def fits(equation: Any) -> bool:
        name, largest = equation.primitive.name, max((out.aval.size for out in equation.outvars), default=0)
        if name == "scan":  # each iteration moves its slices of the operands, which have one axis less than these
            operands = zip(equation.invars, equation.params["jaxpr"].jaxpr.invars, strict=True)
            slices = [inner.aval.size for outer, inner in operands if outer.aval.ndim > inner.aval.ndim]
            largest = max([largest, *slices])
        return (name in _ARITHMETIC and largest <= COMPUTED_MAX) or (name in _MOVES and largest <= MOVED_MAX)

    return all(fits(equation) for equation in _equations(jaxpr))


def _without_attributes(program: Callable[..., Any]) -> Callable[..., Any]:
    """Return a program whose inner calls (`jnp.where`) lack the single-kernel attributes, so that XLA inlines them."""

    def call(*arrays: Any) -> Any:
        with set_xla_metadata(inlineable=None, xla_cpu_small_call=None):
            return program(*arrays)

    return call


def as_single_kernel(
    function: Callable[..., Any],
    otherwise: Callable[..., Any] | None = None,  # the same computation in another form; None: `function`
) -> Callable[..., Any]:
    """Return a function with the results of `function`, compiled as a single CPU kernel if `is_elementary` holds.

    On another device, or if the traced program is not elementary, `otherwise` is called instead. Call the returned
    function only while a larger function is traced. The larger function must not be batched by `vmap`: the batch axis
    would make the small arrays large.
    """

    def call(*args: Any) -> Any:
        if jax.default_backend() != "cpu":
            return (otherwise or function)(*args)
        token = _tracing.set(True)
        try:
            traced, shapes, static_result = eqx.filter_make_jaxpr(function)(*args)
        finally:
            _tracing.reset(token)
        program, arrays = jaxpr_as_fun(traced), jax.tree.leaves(eqx.filter(args, eqx.is_array))
        if is_elementary(traced.jaxpr):
            # XLA attributes of calls that become one kernel; XLA sets them on small loops.
            with set_xla_metadata(inlineable="false", xla_cpu_small_call="true"):
                results = jax.jit(_without_attributes(program))(*arrays)
        elif otherwise is not None:
            return otherwise(*args)
        else:
            results = program(*arrays)
        return eqx.combine(jax.tree.unflatten(jax.tree.structure(shapes), results), static_result)

    return call
