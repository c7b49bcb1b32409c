"""Arrays of a campaign's store: what is written once, and room for what comes of every flight."""

import contextlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
import zarr

from anser.campaigns.study import Study
from anser.results import version_attributes
from anser.results.flight_columns import Column
from anser.scenario import Scenario

FORMAT = 2
FLOWN = "flown"
_WIDTHS = {"status": 64, "unmet": 256, "reason": 512}
"""Characters of texts; what is longer is cut, with dots."""


@contextlib.contextmanager
def every_chunk_written() -> Iterator[None]:
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
    columns: Mapping[str, Column],
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


def fixed_width(name: str, column: Column) -> Column:
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
