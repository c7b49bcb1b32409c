"""Words beside places on a map, on the side where they meet nothing."""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_NAMES = 40
"""Of more, none is written."""
MARK = 0.6
"""What a mark takes of a label's room."""
_OFFSET, _SLANT = 9.0, 0.3  # points, sines
_LABEL = (0.16, 0.045)  # width and height of a label, as parts of the map


def tell_place(
    axes: "Axes", words: str, place: tuple[float, float], towards: tuple[float, float], color: str, points: float
) -> None:
    """Words in letters of some points beside a place, on the side that a unit vector points to."""
    side, up = towards
    axes.annotate(
        words,
        place,
        xytext=(_OFFSET * side, _OFFSET * up),
        textcoords="offset points",
        color=color,
        fontsize=points,
        ha="left" if side > _SLANT else "right" if side < -_SLANT else "center",
        va="bottom" if up > _SLANT else "top" if up < -_SLANT else "center",
        bbox={"facecolor": "white", "alpha": 0.6, "edgecolor": "none", "pad": 0.4},  # a halo would make paths of text
        zorder=8,
    )


def free_side(
    place: np.ndarray, towards: tuple[float, float], extent: float, taken: list[tuple[np.ndarray, float]]
) -> tuple[float, float]:
    """The wanted side, or the one next to it where a label meets nothing: middles, and what they keep off in labels."""
    wanted = np.arctan2(towards[1], towards[0])
    turns = np.radians([0, 45, -45, 90, -90, 135, -135, 180])
    sides = [(float(np.cos(wanted + turn)), float(np.sin(wanted + turn))) for turn in turns]
    box = extent * np.array(_LABEL)
    middles = [place + box * np.array([0.75 * side, 0.9 * up]) for side, up in sides]
    clear = [all(np.any(np.abs(middle - other) > size * box) for other, size in taken) for middle in middles]
    k = clear.index(True) if True in clear else 0
    taken.append((middles[k], 1.0))
    return sides[k]
