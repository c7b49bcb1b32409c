"""Separation between aircraft, the ratio of distance to separation, and the distance from a keep-out."""

from typing import Any

import equinox as eqx

from anser.shapes import Scalar


class Separation(eqx.Module):
    """Required distances between two aircraft: the horizontal or the vertical distance, or both, must be kept."""

    horizontal: Scalar  #: Horizontal distance, m; 0: no separation is required.
    vertical: Scalar  #: Vertical distance, m; 0: only the horizontal distance counts.


def separation_ratio(level: Any, height: Any, horizontal: Any, vertical: Any) -> Any:
    """Return the ratio of distance to required separation: the larger of the horizontal and the vertical ratio.

    The ratio is at least 1 for separated aircraft, and infinite if no horizontal distance is required. `level` and
    `height` are the horizontal and vertical distance, m; `horizontal` and `vertical`: see `Separation`. NumPy or JAX
    arrays.
    """
    xp = level.__array_namespace__()
    is_required, is_vertical = horizontal > 0.0, vertical > 0.0
    horizontal_ratio = xp.where(is_required, level / xp.where(is_required, horizontal, 1.0), xp.inf)
    vertical_ratio = xp.where(is_vertical, height / xp.where(is_vertical, vertical, 1.0), -xp.inf)
    return xp.maximum(horizontal_ratio, vertical_ratio)


def keep_out_room(distance: Any, altitude: Any, radius: Any, bottom: Any, top: Any) -> Any:
    """Return the distance of a point outside an upright cylinder: the larger of horizontal and vertical distance, m.

    The result is negative inside. `distance` is the horizontal distance of the point from the axis. The cylinder
    extends from the altitude `bottom` to the altitude `top`. All arguments in m; NumPy or JAX arrays.
    """
    xp = distance.__array_namespace__()
    return xp.maximum(distance - radius, xp.maximum(bottom - altitude, altitude - top))


def closest_fraction(
    # initial relative position and its change, (..., axis), m; NumPy or JAX arrays
    begin: Any,
    change: Any,
    square_min: float = 1e-200,  # lower bound of the squared change, m^2; keeps derivatives finite
) -> Any:
    """Return the fraction of `change`, 0 to 1, at the closest approach: |begin + fraction * change| is least.

    The result has the shape (...), and is 0 if the relative position is constant.
    """
    xp = begin.__array_namespace__()
    square = xp.sum(change * change, axis=-1)
    return xp.clip(-xp.sum(begin * change, axis=-1) / xp.maximum(square, square_min), 0.0, 1.0)
