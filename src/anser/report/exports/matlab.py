"""A flight as a MATLAB file."""

import io

import numpy as np
import xarray as xr
from scipy.io import savemat

_LONGEST = 63  # characters of a name in MATLAB
_LABELS = ("units", "long_name", "frame")


def to_mat(dataset: xr.Dataset) -> bytes:
    """Write a flight as a MATLAB 5 file, which MATLAB and Octave load.

    It holds `time_s` (a column), `aircraft` (a cell array of names), every variable as a matrix with a row for each
    time and a column for each aircraft, and the structures `units`, `long_name`, `frame` (a field for each variable)
    and `attributes`.

    Raises
    ------
    ValueError
        A name is none that MATLAB can hold.
    """
    matrices = {"time_s": dataset["time"].values[:, None]} | {
        str(name): values.transpose("time", "aircraft").values for name, values in dataset.items()
    }
    names = np.empty((dataset.sizes["aircraft"], 1), dtype=object)
    names[:, 0] = [str(name) for name in dataset["aircraft"].values]
    structures = {
        label: {"time_s": str(dataset["time"].attrs.get(label, ""))}
        | {str(name): str(values.attrs.get(label, "")) for name, values in dataset.items()}
        for label in _LABELS
    } | {"attributes": {str(key): value for key, value in dataset.attrs.items()}}
    for name in (*matrices, *structures, *structures["attributes"]):
        if not (name.isascii() and name.isidentifier() and name[0].isalpha() and len(name) <= _LONGEST):
            raise ValueError(f"MATLAB cannot hold the name {name!r}: letters, digits and underscores, 63 at most")
    buffer = io.BytesIO()
    savemat(buffer, matrices | {"aircraft": names} | structures, long_field_names=True, do_compression=True)
    return buffer.getvalue()
