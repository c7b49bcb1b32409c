"""Zarr arrays of a campaign store.

Coordinates and sampled values, preallocated result columns, and time series of the flights.
"""

import contextlib
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
import zarr

from anser.campaigns.store_integrity import FORMAT
from anser.campaigns.study import Study
from anser.missions.series import SeriesSelection
from anser.results.documents import version_attributes
from anser.results.flight_rows import FlightColumn, FlightRow
from anser.results.variable_labels import (
    catalogue_attributes,
    catalogue_variable,
    is_quantity,
    missing_series,
    record_coordinates,
)
from anser.scenario.schema import Scenario

FLOWN = "flown"
_WIDTHS = {"status": 64, "unmet": 256, "reason": 512}
"""Maximum characters of text columns; longer texts are truncated with dots."""


@contextlib.contextmanager
def write_every_chunk() -> Iterator[None]:
    """Make Zarr also write files that hold only fill values, in the `with` block: a missing file then means damage."""
    with zarr.config.set({"array.write_empty_chunks": True}):
        yield


def open_arrays(path: Path, group: str | None = None) -> xr.Dataset:
    """Open the arrays of a store, or of a group in it, as a dataset; values are read when used and are not decoded."""
    # in the first format zeros and empty texts are fill values, which xarray would treat as missing
    dataset = xr.open_zarr(path, group=group, chunks=None, consolidated=False, mask_and_scale=False)
    for values in dataset.variables.values():
        values.attrs.pop("_FillValue", None)
    return dataset


def create_arrays(
    path: Path,
    study: Study,
    scenario: Scenario,
    applied: Mapping[str, np.ndarray],
    seeds: np.ndarray,
    chunk: int,
    columns: Mapping[str, FlightColumn],
) -> zarr.Group:
    """Create the Zarr group of a store: coordinates, seeds and sampled values, and empty arrays for the results.

    Only result columns of type float have a fill value, NaN, since xarray treats fill values as missing.

    Parameters
    ----------
    applied
        Sampled values as applied to the scenario, one per flight, by key path.
    seeds
        Seed of each flight.
    chunk
        Number of flights per chunk.
    columns
        Result columns by name, as examples of type, dimensions and attributes; their values are not written.
    """
    flights, names = seeds.size, [aircraft.name for aircraft in scenario.aircraft]
    group = zarr.open_group(path, mode="w-", zarr_format=2)
    group.attrs.update(
        {
            "format_version": FORMAT,
            "title": study.name,
            "study": study.model_dump_json(exclude_unset=True),
            "study_hash": study.hash,
            "precision": study.precision,
            "scenario": scenario.model_dump_json(exclude_unset=True),
            "scenario_hash": scenario.hash,
            "varied": json.dumps(list(applied)),
            "chunk": chunk,
            **version_attributes(),
        }
    )
    _put_whole(group, "flight", np.arange(flights), ("flight",), {"long_name": "Number of the flight"})
    _put_whole(group, "aircraft", np.array(names, dtype=np.str_), ("aircraft",), {"long_name": "Aircraft"})
    _put_whole(group, "seed", seeds, ("flight",), {"long_name": "Seed of the flight's scenario"})
    for key_path, values in applied.items():
        _put_whole(group, key_path, values, ("flight",), {"long_name": f"{key_path} of the scenario, as flown"})
    for name, (dimensions, values, attributes) in columns.items():
        group.create_array(
            name,
            shape=(flights, *values.shape[1:]),
            chunks=(chunk, *values.shape[1:]),
            dtype=values.dtype,
            fill_value=np.nan if values.dtype.kind == "f" else None,
            attributes={**attributes, "_ARRAY_DIMENSIONS": ["flight", *dimensions]},
        )
    attributes = {"long_name": "Whether the flight was flown", "_ARRAY_DIMENSIONS": ["flight"]}
    group.create_array(FLOWN, shape=(flights,), chunks=(chunk,), dtype="bool", fill_value=None, attributes=attributes)
    return group


def to_fixed_width(name: str, column: FlightColumn) -> FlightColumn:
    """Convert a text column to the fixed text width of the store, cutting longer texts; leave other columns as is."""
    dimensions, values, labels = column
    width = _WIDTHS.get(name)
    if width is None:
        return column
    texts = [text if len(text) <= width else f"{text[: width - 3]}..." for text in values.ravel().tolist()]
    return dimensions, np.array(texts, dtype=f"<U{width}").reshape(values.shape), labels


def _put_whole(
    group: zarr.Group, name: str, values: np.ndarray, dimensions: tuple[str, ...], labels: dict[str, Any]
) -> None:
    group.create_array(
        name,
        data=values,
        chunks=values.shape,
        fill_value=None,
        attributes={**labels, "_ARRAY_DIMENSIONS": list(dimensions)},
    )


SERIES = "series"
_DIMENSIONS = ["flight", "aircraft", "time"]
_PIECE = 1 << 26
"""Maximum number of values in a file of the store: longer time series are divided into several files."""


def series_bytes(selection: SeriesSelection, scenario: Scenario) -> int:
    """Return the uncompressed size of the time series of one flight, bytes."""
    return 4 * len(selection.keys) * len(scenario.aircraft) * selection.rows(scenario)


def create_series(group: zarr.Group, selection: SeriesSelection, scenario: Scenario, flights: int, chunk: int) -> None:
    """Allocate empty arrays for the selected time series of all flights, in the group `series` of the store."""
    series_group, names, times_s = (
        group.create_group(SERIES),
        [aircraft.name for aircraft in scenario.aircraft],
        selection.times_s(scenario),
    )
    coordinates = {"flight": ("flight", np.arange(flights), {"long_name": "Number of the flight"})}
    coordinates |= record_coordinates(times_s, names)
    for name, (dimension, values, attributes) in coordinates.items():
        _put_whole(series_group, name, values, (dimension,), attributes)
    piece = max(1, min(times_s.size, _PIECE // (chunk * len(names))))
    for key in selection.keys:
        variable = catalogue_variable(key)
        series_group.create_array(
            variable.name,
            shape=(flights, len(names), times_s.size),
            chunks=(chunk, len(names), piece),
            dtype=_kind(key),
            # with a fill value xarray would treat codes as missing, and convert them to floats
            fill_value=np.nan if is_quantity(variable) else None,
            attributes={**_plain(catalogue_attributes(variable)), "_ARRAY_DIMENSIONS": _DIMENSIONS},
        )


def write_series(
    group: zarr.Group, selection: SeriesSelection, chunk_slice: slice, flight_rows: Sequence[FlightRow]
) -> list[str]:
    """Write the time series of a chunk's flights, float32 or, for codes, int32; return the names of the variables."""
    for key in selection.keys:
        array = group[f"{SERIES}/{catalogue_variable(key).name}"]
        assert isinstance(array, zarr.Array)
        shape = array.shape[1:]
        # a flight that could not start has no series
        values = [flight_row.series.get(key, missing_series(key, shape)) for flight_row in flight_rows]
        array[chunk_slice] = np.stack(values).astype(_kind(key))
    return [catalogue_variable(key).name for key in selection.keys]


def series_dataset(store: Path, flown: np.ndarray) -> "xr.Dataset":
    """Open the time series of the given flights, with dimensions flight, aircraft, time; values are read when used."""
    return open_arrays(store, SERIES).isel(flight=flown)


def _kind(key: str) -> np.dtype:
    return np.dtype(np.float32 if is_quantity(catalogue_variable(key)) else np.int32)


def _plain(labels: dict[str, object]) -> dict[str, Any]:
    """Convert attributes to JSON types."""
    return {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in labels.items()}
