"""Units by the names of ANSI/AIAA S-119: numerator, underscore, denominator, powers as digits (``ft_s2``)."""

import functools
import re
from dataclasses import dataclass
from typing import Final

from anser.dave_ml.errors import shown
from anser.units import DEG_RAD, FOOT_M, KNOT_M_S, LBF_N, NAUTICAL_MILE_M, POUND_KG, PSF_PA, RANKINE_K, SLUG_KG

_INCH_M: Final = FOOT_M / 12.0
_M, _KG, _S, _RAD, _K, _A = range(6)
_SYMBOLS: Final = ("m", "kg", "s", "rad", "K", "A")


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit and the way to SI: ``value_si = factor * value + offset``.

    Attributes
    ----------
    factor, offset
        To metre, kilogram, second, radian, kelvin, ampere and what is made of them; percent to a fraction.
    dimension
        Exponents of m, kg, s, rad, K and A.
    """

    factor: float
    offset: float = 0.0
    dimension: tuple[int, ...] = (0, 0, 0, 0, 0, 0)

    @property
    def si(self) -> str:
        """The SI unit, such as ``m s^-2``; empty for a plain number."""
        powers = zip(_SYMBOLS, self.dimension, strict=True)
        return " ".join(name if power == 1 else f"{name}^{power}" for name, power in powers if power)


def _unit(factor: float, *powers: tuple[int, int], offset: float = 0.0) -> Unit:
    dimension = [0] * len(_SYMBOLS)
    for base, power in powers:
        dimension[base] = power
    return Unit(factor, offset, tuple(dimension))


_FORCE: Final = ((_M, 1), (_KG, 1), (_S, -2))
_PRESSURE: Final = ((_M, -1), (_KG, 1), (_S, -2))
_POWER: Final = ((_M, 2), (_KG, 1), (_S, -3))

_NAMED: Final = {
    "m": _unit(1.0, (_M, 1)),
    "km": _unit(1e3, (_M, 1)),
    "cm": _unit(1e-2, (_M, 1)),
    "mm": _unit(1e-3, (_M, 1)),
    "ft": _unit(FOOT_M, (_M, 1)),
    "in": _unit(_INCH_M, (_M, 1)),
    "nmi": _unit(NAUTICAL_MILE_M, (_M, 1)),
    "kg": _unit(1.0, (_KG, 1)),
    "slug": _unit(SLUG_KG, (_KG, 1)),
    "lbm": _unit(POUND_KG, (_KG, 1)),
    "s": _unit(1.0, (_S, 1)),
    "min": _unit(60.0, (_S, 1)),
    "h": _unit(3600.0, (_S, 1)),
    "hr": _unit(3600.0, (_S, 1)),
    "rad": _unit(1.0, (_RAD, 1)),
    "deg": _unit(DEG_RAD, (_RAD, 1)),
    "rev": _unit(360.0 * DEG_RAD, (_RAD, 1)),
    "K": _unit(1.0, (_K, 1)),
    "degK": _unit(1.0, (_K, 1)),
    "degR": _unit(RANKINE_K, (_K, 1)),
    "degC": _unit(1.0, (_K, 1), offset=273.15),
    "degF": _unit(RANKINE_K, (_K, 1), offset=459.67 * RANKINE_K),
    "N": _unit(1.0, *_FORCE),
    "kN": _unit(1e3, *_FORCE),
    "lbf": _unit(LBF_N, *_FORCE),
    "Pa": _unit(1.0, *_PRESSURE),
    "hPa": _unit(1e2, *_PRESSURE),
    "kPa": _unit(1e3, *_PRESSURE),
    "psf": _unit(PSF_PA, *_PRESSURE),
    "psi": _unit(144.0 * PSF_PA, *_PRESSURE),
    "J": _unit(1.0, (_M, 2), (_KG, 1), (_S, -2)),
    "W": _unit(1.0, *_POWER),
    "kW": _unit(1e3, *_POWER),
    "hp": _unit(550.0 * FOOT_M * LBF_N, *_POWER),
    "kt": _unit(KNOT_M_S, (_M, 1), (_S, -1)),
    "Hz": _unit(1.0, (_S, -1)),
    "A": _unit(1.0, (_A, 1)),
    "V": _unit(1.0, *_POWER, (_A, -1)),
    "nd": Unit(1.0),
    "ND": Unit(1.0),
    "non-dimensional": Unit(1.0),
    "nondimensional": Unit(1.0),
    "frac": Unit(1.0),
    "fract": Unit(1.0),
    "pct": Unit(0.01),
}
"""Units that have a name of their own."""
_LONGEST_FIRST: Final = sorted(_NAMED, key=len, reverse=True)
_NAME_MAX: Final = 40


def unit_of(name: str) -> Unit:
    """The unit of a name; a plain number where it is empty.

    Raises
    ------
    ValueError
        The name is not known.
    """
    found = _unit_of(name.strip()) if len(name) <= _NAME_MAX else None
    if found is None:
        raise ValueError(f"unit {shown(name)}; known are {', '.join(_NAMED)}, and products and quotients such as ft_s2")
    return found


def converts(name: str, other: str) -> bool:
    """Whether values of a unit are values of another one times a factor: of one dimension, or the same text."""
    if name == other:
        return True
    try:
        return unit_of(name).dimension == unit_of(other).dimension
    except ValueError:
        return False


@functools.lru_cache(maxsize=1024)
def _unit_of(name: str) -> Unit | None:
    if name in ("", *_NAMED):
        return _NAMED.get(name, Unit(1.0))
    parts = name.replace("/", "_").split("_")
    if len(parts) > 2:
        return None
    factor, dimension = 1.0, [0] * len(_SYMBOLS)
    for part, sign in zip(parts, (1, -1), strict=False):
        product = _product(part) if part else ()
        if product is None:
            return None
        for unit, power in product:
            factor *= unit.factor ** (sign * power)
            dimension = [have + sign * power * one for have, one in zip(dimension, unit.dimension, strict=True)]
    return Unit(factor, 0.0, tuple(dimension))


@functools.lru_cache(maxsize=4096)
def _product(text: str) -> tuple[tuple[Unit, int], ...] | None:
    """The units in a row, each with its power; a longer name goes before a shorter one.

    Remembered for each rest of a text: without, a name can be made for which the ways to part it are too many to try.
    """
    if not text:
        return ()
    for name in _LONGEST_FIRST:
        matched = re.match(f"{name}([2-9]?)", text)
        if matched is None:
            continue
        rest = _product(text[matched.end() :])
        if rest is not None:
            return ((_NAMED[name], int(matched[1] or 1)), *rest)
    return None
