"""How far apart aircraft are, and how much of the separation that is."""

from typing import Any

import equinox as eqx

from anser.shapes import Scalar


class Separation(eqx.Module):
    """How far apart two aircraft stay: horizontally or else vertically, m; 0: not asked."""

    horizontal: Scalar
    vertical: Scalar


def separation_ratio(level: Any, height: Any, horizontal: Any, vertical: Any) -> Any:
    """Distance over separation, the better of the two ratios; 1 is just enough, infinite where nothing is asked.

    Horizontal and vertical distance, m, are arrays of NumPy or of JAX, or both; separations as in `Separation`.
    """
    xp = level.__array_namespace__()
    asked, stacked = horizontal > 0.0, vertical > 0.0
    flat = xp.where(asked, level / xp.where(asked, horizontal, 1.0), xp.inf)
    tall = xp.where(stacked, height / xp.where(stacked, vertical, 1.0), -xp.inf)
    return xp.maximum(flat, tall)


def closest_fraction(begin: Any, along: Any, least_square: float = 1e-200) -> Any:
    """Part, 0 to 1, of the way from one offset to another at which it is shortest; 0 where the offset stays.

    Parameters
    ----------
    begin, along
        First offset and its change, (..., axis), m; arrays of NumPy or of JAX.
    least_square
        Squares of changes below this count as this, m^2; it keeps derivatives finite.
    """
    xp = begin.__array_namespace__()
    square = xp.sum(along * along, axis=-1)
    return xp.clip(-xp.sum(begin * along, axis=-1) / xp.maximum(square, least_square), 0.0, 1.0)
