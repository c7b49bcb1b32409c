"""Zarr arrays of a campaign's store.

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

FORMAT = 2
FLOWN = "flown"
_WIDTHS = {"status": 64, "unmet": 256, "reason": 512}
"""Characters of texts; what is longer is cut, with dots."""


@contextlib.contextmanager
def write_every_chunk() -> Iterator[None]:
    """Have Zarr write chunks of nothing but fill values, too: a file that is not there is damage."""
    with zarr.config.set({"array.write_empty_chunks": True}):
        yield


def open_arrays(path: Path, group: str | None = None) -> xr.Dataset:
    """Open the arrays of a store, or of a group of it, as they were written; each is read when it is needed."""
    # in the first format zeros and empty texts are fill values, which xarray would take for missing
    found = xr.open_zarr(path, group=group, chunks=None, consolidated=False, mask_and_scale=False)
    for values in found.variables.values():
        values.attrs.pop("_FillValue", None)
    return found


def create_arrays(
    path: Path,
    study: Study,
    scenario: Scenario,
    applied: Mapping[str, np.ndarray],
    seeds: np.ndarray,
    chunk: int,
    columns: Mapping[str, FlightColumn],
) -> zarr.Group:
    """Make the group of a store: what is written once, and room for the columns.

    Only quantities have a fill value, NaN: xarray reads what equals a fill value as missing.
    """
    flights, names = seeds.size, [one.name for one in scenario.aircraft]
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
    for name, (dimensions, values, labels) in columns.items():
        group.create_array(
            name,
            shape=(flights, *values.shape[1:]),
            chunks=(chunk, *values.shape[1:]),
            dtype=values.dtype,
            fill_value=np.nan if values.dtype.kind == "f" else None,
            attributes={**labels, "_ARRAY_DIMENSIONS": ["flight", *dimensions]},
        )
    labels = {"long_name": "Whether the flight was flown", "_ARRAY_DIMENSIONS": ["flight"]}
    group.create_array(FLOWN, shape=(flights,), chunks=(chunk,), dtype="bool", fill_value=None, attributes=labels)
    return group


def to_fixed_width(name: str, column: FlightColumn) -> FlightColumn:
    """Texts in the width of the store."""
    dimensions, values, labels = column
    width = _WIDTHS.get(name)
    if width is None:
        return column
    cut = [one if len(one) <= width else f"{one[: width - 3]}..." for one in values.ravel().tolist()]
    return dimensions, np.array(cut, dtype=f"<U{width}").reshape(values.shape), labels


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
"""Numbers of a file of the store at most: of longer flights a chunk has several."""


def series_bytes(kept: SeriesSelection, scenario: Scenario) -> int:
    """What the series of one flight take in the store, uncompressed."""
    return 4 * len(kept.keys) * len(scenario.aircraft) * kept.rows(scenario)


def create_series(group: zarr.Group, kept: SeriesSelection, scenario: Scenario, flights: int, chunk: int) -> None:
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
        variable = catalogue_variable(key)
        within.create_array(
            variable.name,
            shape=(flights, len(names), times_s.size),
            chunks=(chunk, len(names), piece),
            dtype=_kind(key),
            # a code that fills would be read as missing by xarray, and with it every code as a float
            fill_value=np.nan if is_quantity(variable) else None,
            attributes={**_plain(catalogue_attributes(variable)), "_ARRAY_DIMENSIONS": _DIMENSIONS},
        )


def write_series(group: zarr.Group, kept: SeriesSelection, place: slice, rows: Sequence[FlightRow]) -> list[str]:
    """Write the series of the flights of a chunk, float32, or int32 of codes; returns the names of their arrays."""
    for key in kept.keys:
        array = group[f"{SERIES}/{catalogue_variable(key).name}"]
        assert isinstance(array, zarr.Array)
        shape = array.shape[1:]
        # a flight that could not begin has none
        values = [row.series.get(key, missing_series(key, shape)) for row in rows]
        array[place] = np.stack(values).astype(_kind(key))
    return [catalogue_variable(key).name for key in kept.keys]


def series_dataset(store: Path, flown: np.ndarray) -> "xr.Dataset":
    """Series of the flights of a campaign that are complete; dimensions flight, aircraft, time; read when asked for."""
    return open_arrays(store, SERIES).isel(flight=flown)


def _kind(key: str) -> np.dtype:
    return np.dtype(np.float32 if is_quantity(catalogue_variable(key)) else np.int32)


def _plain(labels: dict[str, object]) -> dict[str, Any]:
    """Attributes that JSON can hold."""
    return {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in labels.items()}
