"""Suspect points of tables: against their neighbours and their mirror images; gaps, and ends inside the limits."""

from collections.abc import Iterator, Sequence

import numpy as np

from anser.scenario.airframe_file.schema import AirframeFile
from anser.scenario.airframe_file.schema_aerodynamics import CoefficientTable

_OUTLYING = 8.0
"""How many times the median bend of its table a point's own must be to be suspect."""
_SEEN = 0.05
"""Part of the range of its table by which a suspect point differs at least."""
_GAP = 4.0
"""Intervals of so many times the median one are gaps."""
_ODD, _EVEN = ("CY", "Cl", "Cn"), ("CL", "CD", "Cm")
"""Coefficients that change sign with the sideslip, and that do not, of a symmetric aircraft at rest in roll and yaw."""


def table_findings(file: AirframeFile) -> Iterator[tuple[str, str]]:
    """Place and text of what is suspect in the tables of a file."""
    for k, one in enumerate(file.table):
        place = f"table[{k}] ({one.replaces})"
        values = np.asarray(one.values, dtype=float)
        for index, text in _apart(values, one.breakpoints_deg):
            yield f"table[{k}].values{_brackets(index)} ({one.replaces})", f"{_at(one, index)}: {text}"
        yield from (
            (f"table[{k}].values{_brackets(i)} ({one.replaces})", text) for i, text in _unlike_mirror(one, values)
        )
        for axis, (name, points) in enumerate(zip(one.over, one.breakpoints_deg, strict=True)):
            yield from ((f"{place}, breakpoints_deg[{axis}]", text) for text in _of_axis(file, one, name, points))


def _brackets(index: Sequence[int]) -> str:
    return "".join(f"[{k}]" for k in index)


def _at(one: CoefficientTable, index: Sequence[int]) -> str:
    return ", ".join(
        f"{name} {points[k]:g} deg" for name, points, k in zip(one.over, one.breakpoints_deg, index, strict=True)
    )


def _bends(values: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Along the last axis, how far each inner point lies off the line through its two neighbours; the ends: 0."""
    share = (points[1:-1] - points[:-2]) / (points[2:] - points[:-2])
    straight = values[..., :-2] + share * (values[..., 2:] - values[..., :-2])
    return np.concatenate([0 * values[..., :1], values[..., 1:-1] - straight, 0 * values[..., :1]], axis=-1)


def _apart(values: np.ndarray, axes: Sequence[Sequence[float]]) -> Iterator[tuple[tuple[int, ...], str]]:
    """Points that bend their table far more than most points do, along every axis that has five or more."""
    extent = float(np.ptp(values))
    if extent == 0.0:
        return
    suspect: np.ndarray | None = None
    size = np.zeros_like(values)
    for axis, points in enumerate(axes):
        if len(points) < 5:
            continue
        bends = np.abs(np.moveaxis(_bends(np.moveaxis(values, axis, -1), np.asarray(points)), -1, axis))
        inner = np.take(bends, np.arange(1, len(points) - 1), axis=axis)
        # of a bump the point itself bends most, its neighbours half as much
        moved = np.moveaxis(bends, axis, -1)
        beside = np.maximum(
            np.concatenate([moved[..., 1:], 0 * moved[..., :1]], axis=-1),
            np.concatenate([0 * moved[..., :1], moved[..., :-1]], axis=-1),
        )
        peak = np.moveaxis(moved > beside, -1, axis)
        here = (bends > _OUTLYING * np.median(inner)) & (bends > _SEEN * extent) & peak
        suspect = here if suspect is None else suspect & here
        size = np.maximum(size, bends)
    if suspect is not None:
        for index in np.argwhere(suspect):
            where = tuple(int(k) for k in index)
            yield where, f"{values[where]:.4g} lies {size[where]:.3g} off the line through its neighbours"


def _unlike_mirror(one: CoefficientTable, values: np.ndarray) -> Iterator[tuple[tuple[int, ...], str]]:
    """Points of a whole coefficient over sideslip that differ from their mirror images more than most do."""
    row = one.replaces
    if "beta" not in one.over or row not in (*_ODD, *_EVEN):
        return
    axis = one.over.index("beta")
    points = np.asarray(one.breakpoints_deg[axis])
    if any(name not in ("alpha", "beta") for name in one.over) or not np.allclose(points, -points[::-1]):
        return  # a surface that is deflected has no mirror image in the same table
    image = np.flip(values, axis=axis) * (-1.0 if row in _ODD else 1.0)
    apart = np.abs(values - image)
    suspect = (apart > _SEEN * float(np.ptp(values))) & (apart > _OUTLYING * np.median(apart))
    for index in np.argwhere(suspect):
        where = tuple(int(k) for k in index)
        if points[where[axis]] >= 0.0:  # one of each pair
            yield where, f"{_at(one, where)}: {values[where]:.4g}, but by its mirror image {image[where]:.4g}"


def _of_axis(file: AirframeFile, one: CoefficientTable, name: str, points: Sequence[float]) -> Iterator[str]:
    steps = np.diff(points)
    for k in map(int, np.flatnonzero(steps > _GAP * np.median(steps))):
        yield f"a gap in {name} from {points[k]:g} to {points[k + 1]:g} deg, elsewhere every {np.median(steps):g} deg"
    ranges = {"alpha": file.validity.alpha_deg, "beta": file.validity.beta_deg}
    limits = ranges.get(name) or next(surface.stops_deg for surface in file.surface if surface.name == name)
    what = "the data are said to hold" if name in ranges else "the surface moves"
    way = "the last value is held" if one.beyond == "hold" else "the last slope goes on"
    if points[0] > limits[0]:
        yield f"{name} begins at {points[0]:g} deg, but {what} from {limits[0]:g} deg: {way}"
    if points[-1] < limits[1]:
        yield f"{name} ends at {points[-1]:g} deg, but {what} up to {limits[1]:g} deg: {way}"
