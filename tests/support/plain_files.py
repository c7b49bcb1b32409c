"""Files of the package read by other programs: by xarray, pandas, SciPy or a parser alone."""

import json
from pathlib import Path

import xarray as xr

from anser.results import read_netcdf


def read_alone(path: Path) -> xr.Dataset:
    """Dataset read by xarray alone, checked to equal the package's reading except for the format version."""
    alone = xr.load_dataset(path)
    assert alone.attrs.pop("format_version") == 1
    xr.testing.assert_identical(alone, read_netcdf(path))
    return alone


def parsed(path: Path) -> object:
    """A document read by a strict JSON parser: NaN and infinity are refused."""

    def refused(name: str) -> None:
        raise ValueError(f"{path}: {name} is no JSON")

    return json.loads(path.read_bytes().decode("utf-8"), parse_constant=refused)
