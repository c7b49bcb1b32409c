"""The published figures that come with the package, and how exactly a printed figure is known."""

import functools
import json
import math
from importlib import resources
from typing import Any

from anser.verification.check import Comparison


@functools.cache
def published(name: str) -> dict[str, Any]:
    """Read a file of published figures by its name without ending; its `about` says where the figures come from."""
    text = resources.files("anser.verification").joinpath(f"data/{name}.json").read_text(encoding="utf-8")
    return json.loads(text)


def half_of_last_digit(printed: str) -> float:
    """Half a unit of the last digit of a figure as it is printed, `2.6499e4`: by so much rounding may have moved it."""
    mantissa, _, exponent = printed.partition("e")
    decimals = len(mantissa.partition(".")[2])
    return 0.5 * 10.0 ** (int(exponent or 0) - decimals)


def half_of_significant(figure: float, digits: int) -> float:
    """Half a unit of the last of so many significant digits of a figure, for a file that does not keep final zeros."""
    return 0.5 * 10.0 ** (math.floor(math.log10(abs(figure))) - digits + 1)


def as_printed(group: str, where: str, unit: str, printed: str, obtained: float) -> Comparison:
    """Compare with a figure as it is printed, to half a unit of its last digit."""
    return Comparison(group, where, unit, float(printed), float(obtained), half_of_last_digit(printed))
