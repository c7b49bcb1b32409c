"""Recorded flights on disk: compressed NetCDF-4 files with a checksum, and the check of times, names and positions."""

import errno
from pathlib import Path

import numpy as np
import xarray as xr

from anser.files import new_file
from anser.results.checksums import append_checksum, damaged_file_error, verify_checksum

FORMAT_VERSION = 1
_VERSION = "format_version"
"""Name of the attribute with the format version, in every file with a checksum; older files lack both."""
_UNREADABLE = OSError, ValueError, KeyError, TypeError, AttributeError, IndexError, RuntimeError, MemoryError
"""Exceptions that the libraries raise for damaged files of older versions, which have no checksum."""
_EXPECTED = "a file as anser wrote it"


def write_netcdf(dataset: xr.Dataset, path: Path) -> None:
    """Write a dataset to a new, losslessly compressed NetCDF-4 file, with a checksum.

    Booleans are stored as int8 with flag attributes, aircraft names as text. An interrupted call leaves no file.

    Raises
    ------
    FileExistsError
        If `path` exists.
    OSError
        If the file cannot be written.
    """
    encoding = {
        name: {"zlib": True, "complevel": 4, "shuffle": True}
        | ({"_FillValue": None} if values.dtype.kind == "f" else {})
        for name, values in dataset.data_vars.items()
    }
    versioned = dataset.assign_attrs({_VERSION: FORMAT_VERSION})
    with new_file(path) as partial:
        try:
            versioned.to_netcdf(partial, mode="w", format="NETCDF4", engine="netcdf4", encoding=encoding)
        except RuntimeError as error:  # error of the library for a full disk, without the system's reason
            raise OSError(errno.EIO, f"not written by the NetCDF library: {error}", str(path)) from None
        append_checksum(partial)


def read_netcdf(path: Path) -> xr.Dataset:
    """Read a dataset that `write_netcdf` wrote, into memory; times are in seconds, not dates.

    A file of an older version has neither a checksum nor a format version; such a file is read as well.

    Raises
    ------
    DamagedFileError
        If the file cannot be decoded, differs from its checksum, or has another format version.
    """
    verified = verify_checksum(path)
    try:
        # Times are plain seconds from the start of the flight, not dates.
        dataset = xr.load_dataset(path, engine="netcdf4", decode_times=False, decode_timedelta=False)
        names = dataset.coords.get("aircraft")
        if names is not None:
            dataset = dataset.assign_coords(aircraft=(names.dims, names.values.astype(np.str_), names.attrs))
    except _UNREADABLE as error:
        raise damaged_file_error(path, f"a file that cannot be read ({error})", _EXPECTED) from None
    version = dataset.attrs.pop(_VERSION, None)
    if version is None and not verified:
        return dataset
    if version != FORMAT_VERSION:
        raise damaged_file_error(path, f"{_VERSION} {version}", str(FORMAT_VERSION))
    if not verified:
        finding = "a file without its checksum, cut or written by another program"
        raise damaged_file_error(
            path, finding, f"{_EXPECTED}, or without the attribute {_VERSION} if the change is intended"
        )
    return dataset


_POSITION = "north_m", "east_m", "altitude_m"


def flight_problem(dataset: xr.Dataset) -> str | None:
    """Return a message on the first defect in a flight's times, aircraft names or positions; None if valid.

    Every position must be finite. The recorded state of a crashed or diverged aircraft stays at its last finite value.
    """
    for name in ("time", "aircraft", *_POSITION):
        if name not in dataset.variables:
            return f"arrived without {name}; expected a flight, which has it"
        dimensions = ("time", "aircraft") if name in _POSITION else (name,)
        variable = dataset[name]
        if variable.dims != dimensions or 0 in variable.shape:
            return f"arrived {name} over {dict(variable.sizes)}; expected it over {' and '.join(dimensions)}"
        if name != "aircraft" and variable.dtype.kind != "f":
            return f"arrived {name} as {variable.dtype}; expected floating-point numbers"
        if name != "aircraft" and not np.isfinite(variable.values).all():
            return f"arrived {name} with values that are not finite; expected finite ones at all times"
    if np.any(np.diff(dataset["time"].values) <= 0.0):
        return "arrived time that does not increase; expected increasing times"
    names = dataset["aircraft"].values.tolist()
    if len(set(names)) != len(names):
        return f"arrived aircraft {', '.join(map(str, names))}; expected each name once"
    return None
