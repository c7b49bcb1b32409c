"""Steady flights over a grid of altitude and Mach number, and what datasets over that grid have in common."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from anser.results.variable_labels import attributes_of
from anser.simulation import MapPoint, TrimTarget

RESERVE_MIN = 0.1
"""Part of the power, up and down, and of each surface's way that a point with reserve has left."""

POINT = ("condition", "altitude", "mach")
"""Dimensions of the grid."""


class TrimMap(NamedTuple):
    """Steady flights over a grid.

    Attributes
    ----------
    conditions
        Names of the steady flights and what they mean.
    altitudes, machs
        Axes of the grid, m and 1.
    airspeeds
        True airspeed, m/s, shape (altitude, mach).
    targets, points
        What is flown, and its trim; leaves of shape (conditions x altitudes x machs, ...), the last running fastest.
    surfaces
        Names of the airframe's control surfaces.
    """

    conditions: Mapping[str, str]
    altitudes: np.ndarray
    machs: np.ndarray
    airspeeds: np.ndarray
    targets: TrimTarget
    points: MapPoint
    surfaces: tuple[str, ...]

    def gridded(self, values: Any) -> np.ndarray:
        """Values of the points, shape (points, ...), over the grid."""
        array = np.asarray(values)
        return array.reshape(len(self.conditions), *self.airspeeds.shape, *array.shape[1:])

    def variable(self, values: Any, unit: str, words: str, *over: str) -> Any:
        """Variable of a dataset: values of the points over the grid and dimensions beyond it."""
        return (*POINT, *over), self.gridded(values), attributes_of(unit, words)

    def with_reserve(self) -> Any:
        """Variable that says which points have at least `RESERVE_MIN` left."""
        points = self.points
        left = np.minimum(np.asarray(points.power_left), np.asarray(points.power_spare))
        least = np.minimum(left, np.asarray(points.surface_left).min(axis=1))
        words = "Whether a tenth of power and surfaces is left"
        return self.variable(np.asarray(points.trimmable) & (least >= RESERVE_MIN), "1", words)

    def coordinates(self, condition: str) -> dict[str, Any]:
        """Coordinates of the grid; what a condition is, in words."""
        return {
            "condition": ("condition", np.array(list(self.conditions)), attributes_of("", condition)),
            "condition_meaning": ("condition", np.array(list(self.conditions.values()))),
            "altitude": ("altitude", np.asarray(self.altitudes, dtype=float), attributes_of("m", "Geometric altitude")),
            "mach": ("mach", np.asarray(self.machs, dtype=float), attributes_of("1", "Mach number")),
            "airspeed_m_s": (("altitude", "mach"), self.airspeeds, attributes_of("m s-1", "True airspeed")),
        }
