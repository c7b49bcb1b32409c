"""Export formats by name, and the selection of recorded times."""

from collections.abc import Callable, Mapping
from datetime import datetime
from typing import Any

import numpy as np
import xarray as xr

from anser.report.exports.geographic import to_czml, to_kml
from anser.report.exports.tables import to_csv, to_mat, to_parquet

FORMATS: dict[str, Callable[[xr.Dataset, Mapping[str, Any], datetime], bytes]] = {
    "czml": to_czml,
    "kml": to_kml,
    "csv": lambda dataset, summary, start: to_csv(dataset),
    "parquet": lambda dataset, summary, start: to_parquet(dataset),
    "mat": lambda dataset, summary, start: to_mat(dataset),
}
"""Function that makes the content of a file in each format, by name of the format.

The arguments are a flight's dataset, its summary and its start (date and time). The name is also the suffix of the
files."""


def thin_record(dataset: xr.Dataset, period_s: float) -> xr.Dataset:
    """Return a flight at the recorded times nearest to the first plus multiples of `period_s`, and at the last."""
    time = dataset["time"].values
    grid = time[0] + period_s * np.arange(int((time[-1] - time[0]) / period_s) + 1)
    nearest = dataset.indexes["time"].get_indexer(grid, method="nearest")
    return dataset.isel(time=sorted({*map(int, nearest), time.size - 1}))
