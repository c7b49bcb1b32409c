"""Operations of DAVE-ML formulas: in JAX, with finite derivatives everywhere, and in NumPy for constants."""

import functools
import operator
from collections.abc import Callable, Mapping
from typing import Any, Final

import jax
import jax.numpy as jnp
import numpy as np

from anser.dave_ml.formulas import Arithmetic


def _guarded(function: Callable[..., Any], *slopes: Callable[..., Any]) -> Callable[..., Any]:
    """Return `function` with the given partial derivatives, which are replaced by zero when not finite.

    `slopes` are functions of the arguments and the value, one per argument. Without the replacement, an unselected
    branch or a singular point (root of zero) would turn the whole gradient into NaN.
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


def _principal_arccot(xp: Any, a: Any) -> Any:
    """Return the arc cotangent between -pi/2 and pi/2; pi/2 at 0.

    MathML 2.0, appendix C: Abramowitz and Stegun, eq. 4.4.8.
    """
    return xp.arctan2(xp.where(a < 0.0, -1.0, 1.0), xp.abs(a))


_GUARDED: Final = {
    "divide": _guarded(lambda a, b: a / b, lambda a, b, y: 1.0 / b, lambda a, b, y: -y / b),
    "power": _guarded(jnp.power, lambda a, b, y: b * jnp.power(a, b - 1.0), lambda a, b, y: y * jnp.log(a)),
    "sqrt": _guarded(jnp.sqrt, lambda a, y: 0.5 / y),
    "exp": _guarded(jnp.exp, lambda a, y: y),
    "ln": _guarded(jnp.log, lambda a, y: 1.0 / a),
    "atan2": _guarded(jnp.arctan2, lambda a, b, y: b / (a * a + b * b), lambda a, b, y: -a / (a * a + b * b)),
    "tan": _guarded(jnp.tan, lambda a, y: 1.0 + y * y),
    "arcsin": _guarded(jnp.arcsin, lambda a, y: 1.0 / jnp.sqrt(1.0 - a * a)),
    "arccos": _guarded(jnp.arccos, lambda a, y: -1.0 / jnp.sqrt(1.0 - a * a)),
    "arccosh": _guarded(jnp.arccosh, lambda a, y: 1.0 / jnp.sqrt(a * a - 1.0)),
    "arctanh": _guarded(jnp.arctanh, lambda a, y: 1.0 / (1.0 - a * a)),
    "arccot": _guarded(functools.partial(_principal_arccot, jnp), lambda a, y: -1.0 / (1.0 + a * a)),
}
_POWER_MAX: Final = 16
"""Greatest integer exponent computed by repeated multiplication."""


def _power_of_number(base: Any, exponent: float) -> Any:
    """Return `base` to the power of a constant exponent."""
    if exponent == 0.5:
        return _GUARDED["sqrt"](base)
    if exponent.is_integer() and abs(exponent) <= _POWER_MAX:
        whole = base ** int(abs(exponent))
        return whole if exponent >= 0.0 else _GUARDED["divide"](1.0, whole)
    return _GUARDED["power"](base, exponent)


def _by_reciprocals(
    divide: Callable[[Any, Any], Any], basic_functions: Mapping[str, Callable[..., Any]]
) -> dict[str, Any]:
    """Return secant, cosecant, cotangent and similar functions, built from the basic functions and their inverses."""

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
_NAMES_IN_LIBRARIES: Final = {
    **{name: name for name in ("divide", "power", "sqrt", "exp", "abs", "floor", "sin", "cos", "tan", "sinh", "cosh")},
    **{name: name for name in ("tanh", "arcsin", "arccos", "arctan", "arcsinh", "arccosh", "arctanh")},
    "ln": "log",
    "ceiling": "ceil",
    "atan2": "arctan2",
    "not": "logical_not",
}
_FOLDED: Final = {"min": "minimum", "max": "maximum", "and": "logical_and", "or": "logical_or", "xor": "logical_xor"}


def _arithmetic(
    xp: Any, replacements: Mapping[str, Callable[..., Any]], constant_power: Callable[[Any, float], Any]
) -> Arithmetic:
    """Build the formula operations from an array library (NumPy or `jax.numpy`), with some functions replaced."""
    functions = {name: getattr(xp, library_name) for name, library_name in _NAMES_IN_LIBRARIES.items()}
    functions |= {"arccot": functools.partial(_principal_arccot, xp), **replacements}
    divide, power, sqrt, ln = (functions[name] for name in ("divide", "power", "sqrt", "ln"))
    operations = {
        **_SHARED,
        **functions,
        **{name: _folded(getattr(xp, library_name)) for name, library_name in _FOLDED.items()},
        **_by_reciprocals(divide, functions),
        "root": lambda a, degree=2.0: sqrt(a) if degree == 2.0 else power(a, divide(1.0, degree)),
        "log": lambda a, base=10.0: divide(ln(a), ln(base)),
    }
    return Arithmetic(operations, constant_power, xp.where)


IN_JAX: Final = _arithmetic(jnp, _GUARDED, _power_of_number)
"""Formula operations on traced values: scalars, or arrays of equal shape."""
IN_NUMPY: Final = _arithmetic(np, {}, np.power)
"""Formula operations on constants."""
