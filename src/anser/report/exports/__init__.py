"""A recorded flight in the formats of other programs: Cesium, Google Earth, tables, MATLAB; a campaign as tables."""

from collections.abc import Callable, Mapping
from datetime import datetime
from typing import Any

import numpy as np
import xarray as xr

from anser.report.exports.campaign_tables import write_campaign_tables
from anser.report.exports.czml import to_czml
from anser.report.exports.geography import NEEDED_VARIABLES
from anser.report.exports.kml import to_kml
from anser.report.exports.matlab import to_mat
from anser.report.exports.tables import PARQUET_MISSING, has_parquet, to_csv, to_parquet

__all__ = [
    "FORMATS",
    "NEEDED_VARIABLES",
    "PARQUET_MISSING",
    "has_parquet",
    "thinned",
    "to_csv",
    "to_czml",
    "to_kml",
    "to_mat",
    "to_parquet",
    "write_campaign_tables",
]

FORMATS: dict[str, Callable[[xr.Dataset, Mapping[str, Any], datetime], bytes]] = {
    "czml": to_czml,
    "kml": to_kml,
    "csv": lambda dataset, summary, start: to_csv(dataset),
    "parquet": lambda dataset, summary, start: to_parquet(dataset),
    "mat": lambda dataset, summary, start: to_mat(dataset),
}
"""Name of a format, which is also its files' suffix, and what makes the file from a flight, its summary, its start."""


def thinned(dataset: xr.Dataset, period_s: float) -> xr.Dataset:
    """Recorded times nearest to every `period_s` from the first, and the last: nothing is interpolated."""
    time = dataset["time"].values
    wanted = time[0] + period_s * np.arange(int((time[-1] - time[0]) / period_s) + 1)
    nearest = dataset.indexes["time"].get_indexer(wanted, method="nearest")
    return dataset.isel(time=sorted({*map(int, nearest), time.size - 1}))
