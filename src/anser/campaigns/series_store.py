"""Series of a campaign in its store: preallocated, a chunk of flights written whole before it is marked."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import zarr

from anser.campaigns.store_arrays import open_arrays
from anser.execution.series import SeriesKept
from anser.results.flight_row import FlightRow
from anser.results.series_values import is_number, missing_series, variable_of
from anser.results.variable_labels import labels_of, record_coordinates
from anser.scenario import Scenario

if TYPE_CHECKING:
    import xarray as xr

SERIES = "series"
_DIMENSIONS = ["flight", "aircraft", "time"]
_PIECE = 1 << 26
"""Numbers of a file of the store at most: of longer flights a chunk has several."""


def series_bytes(kept: SeriesKept, scenario: Scenario) -> int:
    """What the series of one flight take in the store, uncompressed."""
    return 4 * len(kept.keys) * len(scenario.aircraft) * kept.rows(scenario)


def create_series(group: zarr.Group, kept: SeriesKept, scenario: Scenario, flights: int, chunk: int) -> None:
    """Make room for the series of a campaign in the group of its store."""
    within, names, times_s = group.create_group(SERIES), [one.name for one in scenario.aircraft], kept.times_s(scenario)
    coordinates = {"flight": ("flight", np.arange(flights), {"long_name": "Number of the flight"})}
    coordinates |= record_coordinates(times_s, names)
    for name, (dimension, values, labels) in coordinates.items():
        within.create_array(
            name,
            data=values,
            chunks=values.shape,
            fill_value=None,
            attributes={**labels, "_ARRAY_DIMENSIONS": [dimension]},
        )
    piece = max(1, min(times_s.size, _PIECE // (chunk * len(names))))
    for key in kept.keys:
        variable = variable_of(key)
        within.create_array(
            variable.name,
            shape=(flights, len(names), times_s.size),
            chunks=(chunk, len(names), piece),
            dtype=_kind(key),
            # a code that fills would be read as missing by xarray, and with it every code as a float
            fill_value=np.nan if is_number(variable) else None,
            attributes={**_plain(labels_of(variable)), "_ARRAY_DIMENSIONS": _DIMENSIONS},
        )


def write_series(group: zarr.Group, kept: SeriesKept, place: slice, rows: Sequence[FlightRow]) -> list[str]:
    """Write the series of the flights of a chunk, float32, or int32 of codes; returns the names of their arrays."""
    for key in kept.keys:
        array = group[f"{SERIES}/{variable_of(key).name}"]
        assert isinstance(array, zarr.Array)
        shape = array.shape[1:]
        # a flight that could not begin has none
        values = [row.series.get(key, missing_series(key, shape)) for row in rows]
        array[place] = np.stack(values).astype(_kind(key))
    return [variable_of(key).name for key in kept.keys]


def series_dataset(store: Path, flown: np.ndarray) -> "xr.Dataset":
    """Series of the flights of a campaign that are complete; dimensions flight, aircraft, time; read when asked for."""
    return open_arrays(store, SERIES).isel(flight=flown)


def _kind(key: str) -> np.dtype:
    return np.dtype(np.float32 if is_number(variable_of(key)) else np.int32)


def _plain(labels: dict[str, object]) -> dict[str, Any]:
    """Attributes that JSON can hold."""
    return {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in labels.items()}
