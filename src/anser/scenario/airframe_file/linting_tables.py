"""What is suspect in the tables of an aircraft file: points, gaps, and ends inside the limits."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from anser.aircraft import GriddedTable, SuspectPoint, suspect_points
from anser.scenario.airframe_file.schema import AirframeFile
from anser.scenario.airframe_file.schema_aerodynamics import CoefficientTable

_GAP = 4.0
"""Intervals of so many times the median one are gaps."""
_ORDER = ("alpha", "beta")


def table_findings(file: AirframeFile) -> Iterator[tuple[str, str]]:
    """Place and text of what is suspect in the tables of a file."""
    named = {f"table[{k}]": one for k, one in enumerate(file.table)}
    for point in suspect_points({place: _in_order(one) for place, one in named.items()}):
        if point.table not in named:
            yield "table", f"at {_at(_ORDER[:2], point.place)}: {suspicion(point)}"
            continue
        one = named[point.table]
        over = _ordered(one)
        at = dict(zip(over, point.place, strict=True))
        index = [points.index(at[name]) for name, points in zip(one.over, one.breakpoints_deg, strict=True)]
        brackets = "".join(f"[{k}]" for k in index)
        yield f"{point.table}.values{brackets} ({one.replaces})", f"{_at(over, point.place)}: {suspicion(point)}"
    for place, one in named.items():
        for axis, (name, points) in enumerate(zip(one.over, one.breakpoints_deg, strict=True)):
            where = f"{place} ({one.replaces}), breakpoints_deg[{axis}]"
            yield from ((where, text) for text in _of_axis(file, one, name, points))


def suspicion(point: SuspectPoint) -> str:
    """What is said of a suspect point."""
    what = "most tables stand out from their" if math.isnan(point.value) else f"{point.value:.4g} stands out from its"
    beside = f", with {len(point.joined)} beside it in its row" if point.joined else ""
    return f"{what} neighbours by {point.score:.1f} times their scatter{beside}"


def _ordered(one: CoefficientTable) -> tuple[str, ...]:
    """What a table is over: alpha first, then beta, then surfaces."""
    return tuple(sorted(one.over, key=lambda name: _ORDER.index(name) if name in _ORDER else len(_ORDER)))


def _in_order(one: CoefficientTable) -> GriddedTable:
    over = _ordered(one)
    places = [one.over.index(name) for name in over]
    values = np.transpose(np.asarray(one.values, dtype=float), places)
    return GriddedTable(tuple(np.asarray(one.breakpoints_deg[k], dtype=float) for k in places), values)


def _at(over: Sequence[str], place: Sequence[float]) -> str:
    return ", ".join(f"{name} {value:g} deg" for name, value in zip(over, place, strict=True))


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
