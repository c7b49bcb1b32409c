"""Search for suspect entries of coefficient tables: outliers against neighbouring values and mirror images."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

_NEIGHBOURS = 2  # rows along the first axis, on either side, included in a row's noise
_SPREAD_SHARE = 0.04  # fraction of the values' standard deviation added to the noise
_DIGITS = 3.0  # last printed digits added to the noise
_MISSING = 0.3  # least value of the third departure in the score
_TESTS = 3  # number of greatest departures in the score
_JOINED = 0.35  # fraction of a suspect's score above which a neighbour in the same row belongs to the suspect
_REACH = 2  # greatest distance of the neighbour along the second axis, in breakpoints
_SUSPECT = 4.2  # default threshold of the score: finds the entries of NASA TP-1538 known as suspect, and as many again
_SHARED, _SHARED_TABLES = 3.0, 5  # threshold and least number of tables for a point suspect in all tables
_SCORE_MIN = 2.0  # least score of an entry that is considered at all
_LINE_POINTS, _LINE_AROUND = 5, 3  # minimum size of a table with one axis; points on either side for the scatter


class GriddedTable(NamedTuple):
    """A table: strictly rising breakpoints for each axis, and an array of values with one dimension for each axis."""

    axes: tuple[np.ndarray, ...]
    values: np.ndarray


class SuspectPoint(NamedTuple):
    """A table entry that is an outlier, or a point at which most tables have an outlier (`table` "all")."""

    table: str
    location: tuple[float, ...]  #: Coordinates along the axes.
    value: float  #: NaN for `table` "all".
    score: float  #: Departure divided by the scatter of the surrounding entries; see `suspect_points`.
    neighbours: tuple[tuple[float, ...], ...]  #: Locations of nearby entries that are outliers due to this entry.


def suspect_points(tables: Mapping[str, GriddedTable], threshold: float = _SUSPECT) -> tuple[SuspectPoint, ...]:
    """Return the table entries that depart from their neighbours and mirror images, highest score first.

    Entries of a table with two or three axes (angle of attack, sideslip, elevator) undergo these tests:

    1. departure from the straight line through the two neighbours along the first axis;
    2. departure from the straight line through the two neighbours along the second axis;
    3. difference from the mirror image, if the second axis is symmetric about 0;
    4. departure along the third axis, compared with this departure at the neighbours along the second axis.

    Each departure is divided by the noise. The noise is the sum of the median departure of the surrounding rows
    (entries with equal first coordinate), 4 % of the standard deviation of the values, and three units of the last
    decimal digit. The score is the geometric mean of the three greatest departures, or of two if only two tests apply.

    In a table with one axis, the score is the departure from the line through the neighbours. The divisor is the
    greatest departure nearby after the entry is put on that line, plus 4 % of the standard deviation, plus three units
    of the last decimal digit.

    A point of the first two axes is suspect in all tables (`table` "all") if the median of the departures in test 2,
    over five or more tables, exceeds 3. Only the worst such point of each row is reported. The entries of single tables
    at a reported point are left out.

    Parameters
    ----------
    tables
        Tables by name. Skipped are:

        - tables with more than three axes;
        - tables with two or three axes and fewer than three breakpoints on the first or second axis;
        - tables with one axis and fewer than five breakpoints.
    threshold
        Minimum score of a reported entry of a single table.
    """
    usable = {n: t for n, t in tables.items() if t.values.ndim in (2, 3) and min(t.values.shape[:2]) >= 3}
    lines = {n: t for n, t in tables.items() if t.values.ndim == 1 and t.values.size >= _LINE_POINTS}
    shared = _shared_suspects(usable)
    shared_locations = {point.location for point in shared}
    suspects = [
        suspect
        for name, table in usable.items()
        for suspect in _table_suspects(name, table, shared_locations, threshold)
    ]
    suspects += [suspect for name, table in lines.items() for suspect in _line_suspects(name, table, threshold)]
    return tuple(sorted([*shared, *suspects], key=lambda point: -point.score))


def _line_suspects(name: str, table: GriddedTable, threshold: float) -> list[SuspectPoint]:
    (points,), values = table.axes, table.values
    departures = np.nan_to_num(_departure_from_line(points, values, 0))
    noise_floor = _SPREAD_SHARE * float(np.std(values)) + _DIGITS * _last_digit(values) + 1e-12
    suspects = []
    for k in range(1, values.size - 1):
        straight = values.copy()
        straight[k] -= departures[k]
        nearby_departures = np.nan_to_num(np.abs(_departure_from_line(points, straight, 0)))[
            max(0, k - _LINE_AROUND) : k + _LINE_AROUND + 1
        ]
        score = abs(float(departures[k])) / (float(nearby_departures.max()) + noise_floor)
        if score >= threshold:
            suspects.append(SuspectPoint(name, (float(points[k]),), float(values[k]), score, ()))
    return suspects


def _table_suspects(
    name: str, table: GriddedTable, shared: set[tuple[float, ...]], threshold: float
) -> list[SuspectPoint]:
    ordered = np.sort(_departures(table), axis=0)[::-1][:_TESTS]
    score = np.prod(np.maximum(ordered[2:], _MISSING), axis=0) * ordered[0] * ordered[1]
    score = score ** (1.0 / _TESTS) if len(ordered) == _TESTS else np.sqrt(ordered[0] * ordered[1])

    def location_of(index: tuple[int, ...]) -> tuple[float, ...]:
        return tuple(float(axis[k]) for axis, k in zip(table.axes, index, strict=True))

    remaining = {
        tuple(map(int, index)): float(score[tuple(index)])
        for index in np.argwhere(score > _SCORE_MIN)
        if location_of(tuple(index))[:2] not in shared
    }
    suspects = []
    for index in sorted(remaining, key=lambda i: -remaining[i]):
        if index not in remaining or remaining[index] < threshold:
            continue
        top_score = remaining.pop(index)
        members, open_indices = [], [index]
        while open_indices:
            current = open_indices.pop()
            for step in range(-_REACH, _REACH + 1):
                neighbour = (current[0], current[1] + step, *current[2:])
                if remaining.get(neighbour, 0.0) >= _JOINED * top_score:
                    del remaining[neighbour]
                    members.append(neighbour)
                    open_indices.append(neighbour)
        suspects.append(
            SuspectPoint(
                name,
                location_of(index),
                float(table.values[index]),
                top_score,
                tuple(location_of(member) for member in sorted(members)),
            )
        )
    return suspects


def _shared_suspects(tables: Mapping[str, GriddedTable]) -> list[SuspectPoint]:
    """Return the points of the first two axes that are suspect in all tables, at most one for each first coordinate."""
    departures_by_location: dict[tuple[float, ...], list[float]] = {}
    for table in tables.values():
        departure = _departure_from_line(table.axes[1], table.values, 1)
        measured = np.abs(departure) / (_noise(departure, table.values, 0.0, 0.0) * _column_noise(departure))
        by_location = measured if measured.ndim == 2 else np.median(measured, axis=2)
        for i, j in np.ndindex(by_location.shape):
            if 0 < j < by_location.shape[1] - 1:
                location = float(table.axes[0][i]), float(table.axes[1][j])
                departures_by_location.setdefault(location, []).append(float(by_location[i, j]))
    scores = {
        location: float(np.median(values))
        for location, values in departures_by_location.items()
        if len(values) >= _SHARED_TABLES
    }
    suspects: list[SuspectPoint] = []
    for location in sorted(scores, key=lambda p: -scores[p]):
        # neighbours in the row depart because of this location
        if scores[location] > _SHARED and not any(suspect.location[0] == location[0] for suspect in suspects):
            suspects.append(SuspectPoint("all", location, float("nan"), scores[location], ()))
    return suspects


def _departures(table: GriddedTable) -> np.ndarray:
    """Return |departure from the line or mirror image| / noise of each entry in each test of `suspect_points`.

    The shape is (tests, *shape of the table). The value is 0 at an entry that lacks the neighbours for a test.
    """
    values, (axis_1, axis_2) = table.values, table.axes[:2]
    tests = [_departure_from_line(axis_1, values, 0), _departure_from_line(axis_2, values, 1)]
    for end, inner in ((0, 1), (-1, -2)):
        tests[0][end] = _departure_from_line(axis_2, values[end] - values[inner], 0)
    if np.allclose(axis_2, -axis_2[::-1]) and axis_2.size % 2:
        tests.append(_departure_from_mirror(values))
    if values.ndim == 3 and values.shape[2] >= 3:
        along = _departure_from_line(axis_2, _departure_from_line(table.axes[2], values, 2), 1)
        for end, inner in ((0, 1), (-1, -2)):
            along[:, :, end] = _departure_from_line(axis_2, values[:, :, end] - values[:, :, inner], 1)
        tests.append(along)
    digit = _DIGITS * _last_digit(values)
    return np.stack(
        [np.nan_to_num(np.abs(departure) / _noise(departure, values, _SPREAD_SHARE, digit)) for departure in tests]
    )


def _departure_from_line(points: np.ndarray, values: np.ndarray, axis: int) -> np.ndarray:
    """Return the values minus the linear interpolation between their neighbours along an axis; NaN at the ends."""
    leading = np.moveaxis(values, axis, 0)
    shape = (-1,) + (1,) * (values.ndim - 1)
    share = ((points[1:-1] - points[:-2]) / (points[2:] - points[:-2])).reshape(shape)
    departure = np.full(leading.shape, np.nan)
    departure[1:-1] = leading[1:-1] - (1.0 - share) * leading[:-2] - share * leading[2:]
    return np.moveaxis(departure, 0, axis)


def _departure_from_mirror(values: np.ndarray) -> np.ndarray:
    image, middle = np.flip(values, 1), values[:, values.shape[1] // 2, None]
    even, odd = values - image, values + image - 2.0 * middle
    return even if np.median(np.abs(even)) < np.median(np.abs(odd)) else odd


def _noise(departure: np.ndarray, values: np.ndarray, spread_share: float, digit: float) -> np.ndarray:
    """Return the noise (see `suspect_points`) around each row, in the unit of `values`; shape (rows, 1, ...).

    `spread_share` is the factor on the standard deviation; `digit` is the term for the last decimal digit.
    """
    windows = [slice(max(0, k - _NEIGHBOURS), k + _NEIGHBOURS + 1) for k in range(values.shape[0])]
    noise = np.array([_median(np.abs(departure[window])) + spread_share * np.std(values[window]) for window in windows])
    return (noise + digit + 1e-12).reshape((-1,) + (1,) * (values.ndim - 1))


def _column_noise(departure: np.ndarray) -> np.ndarray:
    """Return the median departure of each column over the table's median, at least 1; shape (1, columns, 1, ...)."""
    column_medians = np.array([_median(np.abs(departure[:, [j, -1 - j]])) for j in range(departure.shape[1])])
    factor = np.maximum(column_medians / (_median(np.abs(departure)) + 1e-12), 1.0)
    return factor.reshape((1, -1) + (1,) * (departure.ndim - 2))


def _median(values: np.ndarray) -> float:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else 0.0


def _last_digit(values: np.ndarray) -> float:
    """Return the unit (1, 0.1, ..., 1e-8) of the last decimal digit of the values; 0 for more than eight decimals."""
    for count in range(9):
        scaled = values * 10.0**count
        tolerance = np.minimum(1e-9 * np.abs(scaled), 1e-3)
        if np.mean(np.abs(scaled - np.round(scaled)) <= tolerance) >= 0.9:
            return 10.0**-count
    return 0.0
