"""Formula operations in JAX, with finite derivatives everywhere, and in NumPy for constants."""

import functools
import operator
from collections.abc import Callable, Mapping
from typing import Any, Final

import jax
import jax.numpy as jnp
import numpy as np

from anser.dave_ml.formulas import Arithmetic


def _guarded(function: Callable[..., Any], *slopes: Callable[..., Any]) -> Callable[..., Any]:
    """Attach partial derivatives, functions of the arguments and the value, to a function.

    Non-finite partial derivatives are replaced by zero. Otherwise an unselected branch or a singular point (root of
    zero) would turn the whole gradient into NaN.
    """

    @jax.custom_jvp
    def guarded(*arguments: Any) -> Any:
        return function(*arguments)

    @guarded.defjvp
    def _(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Any, Any]:
        value = function(*primals)
        parts = [slope(*primals, value) for slope in slopes]
        parts = [jnp.where(jnp.isfinite(part), part, jnp.zeros_like(part)) for part in parts]
        return value, functools.reduce(operator.add, (p * t for p, t in zip(parts, tangents, strict=True)))

    return guarded


_divide = _guarded(lambda a, b: a / b, lambda a, b, y: 1.0 / b, lambda a, b, y: -y / b)
_power = _guarded(jnp.power, lambda a, b, y: b * jnp.power(a, b - 1.0), lambda a, b, y: y * jnp.log(a))
_sqrt = _guarded(jnp.sqrt, lambda a, y: 0.5 / y)
_ln = _guarded(jnp.log, lambda a, y: 1.0 / a)
_atan2 = _guarded(jnp.arctan2, lambda a, b, y: b / (a * a + b * b), lambda a, b, y: -a / (a * a + b * b))
_arcsin = _guarded(jnp.arcsin, lambda a, y: 1.0 / jnp.sqrt(1.0 - a * a))
_arccos = _guarded(jnp.arccos, lambda a, y: -1.0 / jnp.sqrt(1.0 - a * a))
_arccosh = _guarded(jnp.arccosh, lambda a, y: 1.0 / jnp.sqrt(a * a - 1.0))
_arctanh = _guarded(jnp.arctanh, lambda a, y: 1.0 / (1.0 - a * a))
_arccot = _guarded(lambda a: _principal_arccot(jnp, a), lambda a, y: -1.0 / (1.0 + a * a))
_tan = _guarded(jnp.tan, lambda a, y: 1.0 + y * y)
_exp = _guarded(jnp.exp, lambda a, y: y)

_POWER_MAX: Final = 16
"""Greatest integer exponent computed by repeated multiplication."""


def _power_of_number(base: Any, exponent: float) -> Any:
    """Power with a constant exponent."""
    if exponent == 0.5:
        return _sqrt(base)
    if exponent.is_integer() and abs(exponent) <= _POWER_MAX:
        whole = base ** int(abs(exponent))
        return whole if exponent >= 0.0 else _divide(1.0, whole)
    return _power(base, exponent)


def _principal_arccot(xp: Any, a: Any) -> Any:
    """Arc cotangent between -pi/2 and pi/2, pi/2 at 0 (MathML 2.0, appendix C: Abramowitz and Stegun, eq. 4.4.8)."""
    return xp.arctan2(xp.where(a < 0.0, -1.0, 1.0), xp.abs(a))


def _by_reciprocals(
    divide: Callable[[Any, Any], Any], basic_functions: Mapping[str, Callable[..., Any]]
) -> dict[str, Any]:
    """Secant, cosecant, cotangent and similar functions, from the basic functions and their inverses."""

    def inverse(name: str) -> Callable[[Any], Any]:
        return lambda a: basic_functions[name](divide(1.0, a))

    return {
        "sec": lambda a: divide(1.0, basic_functions["cos"](a)),
        "csc": lambda a: divide(1.0, basic_functions["sin"](a)),
        "cot": lambda a: divide(basic_functions["cos"](a), basic_functions["sin"](a)),
        "arcsec": inverse("arccos"),
        "arccsc": inverse("arcsin"),
        "sech": lambda a: divide(1.0, basic_functions["cosh"](a)),
        "csch": lambda a: divide(1.0, basic_functions["sinh"](a)),
        "coth": lambda a: divide(1.0, basic_functions["tanh"](a)),
        "arcsech": inverse("arccosh"),
        "arccsch": inverse("arcsinh"),
        "arccoth": inverse("arctanh"),
    }


def _minus(minuend: Any, *subtrahend: Any) -> Any:
    return minuend - subtrahend[0] if subtrahend else -minuend


def _folded(binary_operation: Callable[[Any, Any], Any]) -> Callable[..., Any]:
    return lambda *arguments: functools.reduce(binary_operation, arguments)


_SHARED: Final[dict[str, Callable[..., Any]]] = {
    "plus": _folded(operator.add),
    "minus": _minus,
    "times": _folded(operator.mul),
    "lt": operator.lt,
    "leq": operator.le,
    "gt": operator.gt,
    "geq": operator.ge,
    "eq": operator.eq,
    "neq": operator.ne,
}
_JNP_FUNCTIONS: Final[dict[str, Callable[..., Any]]] = {
    "sin": jnp.sin,
    "cos": jnp.cos,
    "tan": _tan,
    "arcsin": _arcsin,
    "arccos": _arccos,
    "arctan": jnp.arctan,
    "sinh": jnp.sinh,
    "cosh": jnp.cosh,
    "tanh": jnp.tanh,
    "arcsinh": jnp.arcsinh,
    "arccosh": _arccosh,
    "arctanh": _arctanh,
}
_NP_FUNCTIONS: Final[dict[str, Callable[..., Any]]] = {
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "arcsin": np.arcsin,
    "arccos": np.arccos,
    "arctan": np.arctan,
    "sinh": np.sinh,
    "cosh": np.cosh,
    "tanh": np.tanh,
    "arcsinh": np.arcsinh,
    "arccosh": np.arccosh,
    "arctanh": np.arctanh,
}

IN_JAX: Final = Arithmetic(
    {
        **_SHARED,
        "divide": _divide,
        "power": _power,
        "root": lambda a, degree=2.0: _sqrt(a) if degree == 2.0 else _power(a, _divide(1.0, degree)),
        "exp": _exp,
        "ln": _ln,
        "log": lambda a, base=10.0: _divide(_ln(a), _ln(base)),
        "abs": jnp.abs,
        "floor": jnp.floor,
        "ceiling": jnp.ceil,
        "min": _folded(jnp.minimum),
        "max": _folded(jnp.maximum),
        "atan2": _atan2,
        **_JNP_FUNCTIONS,
        **_by_reciprocals(_divide, _JNP_FUNCTIONS),
        "arccot": _arccot,
        "and": _folded(jnp.logical_and),
        "or": _folded(jnp.logical_or),
        "xor": _folded(jnp.logical_xor),
        "not": jnp.logical_not,
    },
    _power_of_number,
    jnp.where,
)
"""Operations on traced values: scalars, or arrays of equal shape."""

IN_NUMPY: Final = Arithmetic(
    {
        **_SHARED,
        "divide": np.divide,
        "power": np.power,
        "root": lambda a, degree=2.0: np.sqrt(a) if degree == 2.0 else np.power(a, np.divide(1.0, degree)),
        "exp": np.exp,
        "ln": np.log,
        "log": lambda a, base=10.0: np.divide(np.log(a), np.log(base)),
        "abs": np.abs,
        "floor": np.floor,
        "ceiling": np.ceil,
        "min": _folded(np.minimum),
        "max": _folded(np.maximum),
        "atan2": np.arctan2,
        **_NP_FUNCTIONS,
        **_by_reciprocals(np.divide, _NP_FUNCTIONS),
        "arccot": functools.partial(_principal_arccot, np),
        "and": _folded(np.logical_and),
        "or": _folded(np.logical_or),
        "xor": _folded(np.logical_xor),
        "not": np.logical_not,
    },
    np.power,
    np.where,
)
"""Operations on constants."""
