"""A flight on disk: one compressed NetCDF-4 file."""

from pathlib import Path

import numpy as np
import xarray as xr


def write_netcdf(dataset: xr.Dataset, path: Path) -> None:
    """Write a dataset to a NetCDF-4 file, compressed without loss.

    Truth values are stored as int8 with their flag attributes, names of aircraft as text. The file appears under its
    name only when it is complete.

    Raises
    ------
    FileExistsError
        `path` exists: a recorded flight is never overwritten.
    """
    if path.exists():
        raise FileExistsError(f"{path} exists; a recorded flight is not overwritten: choose another folder")
    encoding = {
        name: {"zlib": True, "complevel": 4, "shuffle": True}
        | ({"_FillValue": None} if values.dtype.kind == "f" else {})
        for name, values in dataset.data_vars.items()
    }
    partial = path.with_name(path.name + ".part")
    try:
        dataset.to_netcdf(partial, mode="w", format="NETCDF4", engine="netcdf4", encoding=encoding)
        partial.rename(path)
    finally:
        partial.unlink(missing_ok=True)


def read_netcdf(path: Path) -> xr.Dataset:
    """Read a dataset that `write_netcdf` wrote, whole, equal to the one written."""
    # Times are plain seconds from the start of the flight, not dates.
    dataset = xr.load_dataset(path, engine="netcdf4", decode_times=False, decode_timedelta=False)
    if "aircraft" in dataset.coords:
        names = dataset["aircraft"]
        dataset = dataset.assign_coords(aircraft=("aircraft", names.values.astype(np.str_), names.attrs))
    return dataset
