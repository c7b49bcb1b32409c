"""Separation between aircraft, and the ratio of distance to separation."""

from typing import Any

import equinox as eqx

from anser.shapes import Scalar


class Separation(eqx.Module):
    """Required separation of two aircraft: horizontal or vertical, m; 0: no requirement."""

    horizontal: Scalar
    vertical: Scalar


def separation_ratio(level: Any, height: Any, horizontal: Any, vertical: Any) -> Any:
    """Ratio of distance to separation, the larger of both directions; 1 is sufficient, infinite without requirement.

    Horizontal and vertical distance, m, are NumPy or JAX arrays; separations as in `Separation`.
    """
    xp = level.__array_namespace__()
    is_required, is_vertical = horizontal > 0.0, vertical > 0.0
    horizontal_ratio = xp.where(is_required, level / xp.where(is_required, horizontal, 1.0), xp.inf)
    vertical_ratio = xp.where(is_vertical, height / xp.where(is_vertical, vertical, 1.0), -xp.inf)
    return xp.maximum(horizontal_ratio, vertical_ratio)


def closest_fraction(begin: Any, change: Any, square_min: float = 1e-200) -> Any:
    """Fraction (0 to 1) of the way between two offsets with the shortest offset; 0 for a constant offset.

    Parameters
    ----------
    begin, change
        First offset and its change, (..., axis), m; NumPy or JAX arrays.
    square_min
        Lower bound of the squared change, m^2; keeps derivatives finite.
    """
    xp = begin.__array_namespace__()
    square = xp.sum(change * change, axis=-1)
    return xp.clip(-xp.sum(begin * change, axis=-1) / xp.maximum(square, square_min), 0.0, 1.0)
