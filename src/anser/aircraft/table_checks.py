"""Suspect points of tables of coefficients: values that stand out from their neighbours and their mirror images."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

_NEIGHBOURS = 2  # rows of the first axis on either side whose noise counts as that of a row
_SPREAD_SHARE = 0.04  # part of the values' spread there that counts as noise, too
_DIGITS = 3.0  # last printed digits that do
_MISSING = 0.3  # departure that stands for a test that a point has no neighbours for
_TESTS = 3
_JOINED = 0.35  # part of a point's score from which a neighbour in the same row belongs to it
_REACH = 2
_SUSPECT = 4.2  # finds what readers of NASA TP-1538 found, and as many again
_SHARED, _SHARED_TABLES = 3.0, 5
_SCORE_MIN = 2.0
_LINE_POINTS, _LINE_AROUND = 5, 3  # fewest of a table of one axis, and on how many on either side its scatter counts


class GriddedTable(NamedTuple):
    """Values over their breakpoints, one array of breakpoints for each axis of `values`."""

    axes: tuple[np.ndarray, ...]
    values: np.ndarray


class SuspectPoint(NamedTuple):
    """A point that stands out.

    Attributes
    ----------
    table
        Its name; "all" where most tables stand out at one place of their first two axes.
    place
        Coordinates along the axes of the table.
    value
        What is tabulated; nan for "all".
    score
        How far it stands out, in units of what its surroundings scatter: see `suspect_points`.
    joined
        Places in its row that stand out with it.
    """

    table: str
    location: tuple[float, ...]
    value: float
    score: float
    neighbours: tuple[tuple[float, ...], ...]


def suspect_points(tables: Mapping[str, GriddedTable], threshold: float = _SUSPECT) -> tuple[SuspectPoint, ...]:
    """Points that stand out from neighbours and mirror images, the worst first.

    Each point is compared with the line between its neighbours along the first axis (angle of attack), with that along
    the second (sideslip), with its mirror image in the second axis where that is symmetric about 0 (even or odd about
    the value in the middle, whichever fits the table better), and, of three axes, with what its neighbours along the
    second axis say of its difference to the neighbours along the third (elevator). At an end of the first axis the
    difference to the next row is compared along the second. A departure is measured in the median departure of the rows
    around it, plus 4 % of the values' spread there, plus three last digits. The score is the geometric mean of the
    three greatest: an outlier departs in several ways, its neighbours and its mirror image in one. What stands beside a
    suspect point in its row with more than a third of its score is joined to it.

    A place of the first two axes is suspect in all tables if the median departure along the second axis over five or
    more tables that have it is above 3, in units of the noise of its row and column, the worst of each row; its points
    are not told again.

    Parameters
    ----------
    tables
        By name; those with fewer than two axes, or fewer than three breakpoints on one of the first two, are passed
        over: they have too few neighbours.
    threshold
        Least score.
    """
    usable = {n: t for n, t in tables.items() if t.values.ndim in (2, 3) and min(t.values.shape[:2]) >= 3}
    lines = {n: t for n, t in tables.items() if t.values.ndim == 1 and t.values.size >= _LINE_POINTS}
    shared = _shared(usable)
    places = {point.location for point in shared}
    found = [one for name, table in usable.items() for one in _of_table(name, table, places, threshold)]
    found += [one for name, table in lines.items() for one in _of_line(name, table, threshold)]
    return tuple(sorted([*shared, *found], key=lambda point: -point.score))


def _of_line(name: str, table: GriddedTable, threshold: float) -> list[SuspectPoint]:
    (points,), values = table.axes, table.values
    off = np.nan_to_num(_between(points, values, 0))
    common = _SPREAD_SHARE * float(np.std(values)) + _DIGITS * _last_digit(values) + 1e-12
    found = []
    for k in range(1, values.size - 1):
        straight = values.copy()
        straight[k] -= off[k]
        rest = np.nan_to_num(np.abs(_between(points, straight, 0)))[max(0, k - _LINE_AROUND) : k + _LINE_AROUND + 1]
        score = abs(float(off[k])) / (float(rest.max()) + common)
        if score >= threshold:
            found.append(SuspectPoint(name, (float(points[k]),), float(values[k]), score, ()))
    return found


def _of_table(name: str, table: GriddedTable, shared: set[tuple[float, ...]], threshold: float) -> list[SuspectPoint]:
    ordered = np.sort(_departures(table), axis=0)[::-1][:_TESTS]
    score = np.prod(np.maximum(ordered[2:], _MISSING), axis=0) * ordered[0] * ordered[1]
    score = score ** (1.0 / _TESTS) if len(ordered) == _TESTS else np.sqrt(ordered[0] * ordered[1])

    def at(index: tuple[int, ...]) -> tuple[float, ...]:
        return tuple(float(axis[k]) for axis, k in zip(table.axes, index, strict=True))

    rest = {
        tuple(map(int, index)): float(score[tuple(index)])
        for index in np.argwhere(score > _SCORE_MIN)
        if at(tuple(index))[:2] not in shared
    }
    found = []
    for index in sorted(rest, key=lambda i: -rest[i]):
        if index not in rest or rest[index] < threshold:
            continue
        worst = rest.pop(index)
        members, reached = [], [index]
        while reached:
            here = reached.pop()
            for step in range(-_REACH, _REACH + 1):
                beside = (here[0], here[1] + step, *here[2:])
                if rest.get(beside, 0.0) >= _JOINED * worst:
                    del rest[beside]
                    members.append(beside)
                    reached.append(beside)
        found.append(
            SuspectPoint(name, at(index), float(table.values[index]), worst, tuple(at(one) for one in sorted(members)))
        )
    return found


def _shared(tables: Mapping[str, GriddedTable]) -> list[SuspectPoint]:
    """Places of the first two axes where most tables depart from their neighbours along the second."""
    departures: dict[tuple[float, ...], list[float]] = {}
    for table in tables.values():
        off = _between(table.axes[1], table.values, 1)
        measured = np.abs(off) / (_noise(off, table.values, 0.0, 0.0) * _column_noise(off))
        of_place = measured if measured.ndim == 2 else np.median(measured, axis=2)
        for i, j in np.ndindex(of_place.shape):
            if 0 < j < of_place.shape[1] - 1:
                place = float(table.axes[0][i]), float(table.axes[1][j])
                departures.setdefault(place, []).append(float(of_place[i, j]))
    scores = {place: float(np.median(each)) for place, each in departures.items() if len(each) >= _SHARED_TABLES}
    found: list[SuspectPoint] = []
    for place in sorted(scores, key=lambda p: -scores[p]):
        # a neighbour in the row departs because this one does
        if scores[place] > _SHARED and not any(one.location[0] == place[0] for one in found):
            found.append(SuspectPoint("all", place, float("nan"), scores[place], ()))
    return found


def _departures(table: GriddedTable) -> np.ndarray:
    """How far each point departs, test by test, in units of the noise around it; 0 where a test has no neighbours."""
    values, (first, second) = table.values, table.axes[:2]
    tests = [_between(first, values, 0), _between(second, values, 1)]
    for end, beside in ((0, 1), (-1, -2)):
        tests[0][end] = _between(second, values[end] - values[beside], 0)
    if np.allclose(second, -second[::-1]) and second.size % 2:
        tests.append(_mirrored(values))
    if values.ndim == 3 and values.shape[2] >= 3:
        along = _between(second, _between(table.axes[2], values, 2), 1)
        for end, beside in ((0, 1), (-1, -2)):
            along[:, :, end] = _between(second, values[:, :, end] - values[:, :, beside], 1)
        tests.append(along)
    digit = _DIGITS * _last_digit(values)
    return np.stack([np.nan_to_num(np.abs(off) / _noise(off, values, _SPREAD_SHARE, digit)) for off in tests])


def _between(points: np.ndarray, values: np.ndarray, axis: int) -> np.ndarray:
    """Values less the line between their neighbours along an axis; nan at its ends."""
    rows = np.moveaxis(values, axis, 0)
    shape = (-1,) + (1,) * (values.ndim - 1)
    share = ((points[1:-1] - points[:-2]) / (points[2:] - points[:-2])).reshape(shape)
    off = np.full(rows.shape, np.nan)
    off[1:-1] = rows[1:-1] - (1.0 - share) * rows[:-2] - share * rows[2:]
    return np.moveaxis(off, 0, axis)


def _mirrored(values: np.ndarray) -> np.ndarray:
    image, middle = np.flip(values, 1), values[:, values.shape[1] // 2, None]
    even, odd = values - image, values + image - 2.0 * middle
    return even if np.median(np.abs(even)) < np.median(np.abs(odd)) else odd


def _noise(off: np.ndarray, values: np.ndarray, spread_share: float, digit: float) -> np.ndarray:
    """Of each row along the first axis, from it and those around it; never 0."""
    rows = [slice(max(0, k - _NEIGHBOURS), k + _NEIGHBOURS + 1) for k in range(values.shape[0])]
    noise = np.array([_median(np.abs(off[row])) + spread_share * np.std(values[row]) for row in rows])
    return (noise + digit + 1e-12).reshape((-1,) + (1,) * (values.ndim - 1))


def _column_noise(off: np.ndarray) -> np.ndarray:
    """By how much each column and its mirror image is noisier than the median one; at least 1."""
    each = np.array([_median(np.abs(off[:, [j, -1 - j]])) for j in range(off.shape[1])])
    factor = np.maximum(each / (_median(np.abs(off)) + 1e-12), 1.0)
    return factor.reshape((1, -1) + (1,) * (off.ndim - 2))


def _median(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else 0.0


def _last_digit(values: np.ndarray, digits: Sequence[int] = range(7)) -> float:
    """The decimal place in which nine tenths of the values end."""
    for count in digits:
        scaled = values * 10.0**count
        if np.mean(np.abs(scaled - np.round(scaled)) < 1e-6 * 10.0**count) >= 0.9:
            return 10.0**-count
    return 0.0
