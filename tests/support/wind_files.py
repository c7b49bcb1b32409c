"""Wind fields in files: the published layout of ERA5 on pressure levels, and analytic fields in metres."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from anser.constants import STANDARD_GRAVITY_M_S2

LEVELS_HPA = (1000, 925, 850, 700, 500, 300)


def era5_file(path: Path, *, packed: bool = True, members: int = 0, east_deg: float = 9.0) -> Path:
    """Write a file as the Climate Data Store lays it out: falling latitudes, longitudes 0 to 360, omega, packed."""
    rng = np.random.default_rng(7)
    dims = ("valid_time", "pressure_level", "latitude", "longitude")
    coords: dict[str, Any] = {
        "valid_time": (
            "valid_time",
            np.array([1735689600, 1735693200, 1735696800]),
            {"standard_name": "time", "units": "seconds since 1970-01-01", "calendar": "proleptic_gregorian"},
        ),
        "pressure_level": (
            "pressure_level",
            np.array(LEVELS_HPA, float),
            {"standard_name": "air_pressure", "units": "hPa", "positive": "down"},
        ),
        "latitude": ("latitude", np.arange(46.0, 43.9, -0.25), {"standard_name": "latitude", "units": "degrees_north"}),
        "longitude": (
            "longitude",
            np.arange(east_deg - 1.0, east_deg + 1.1, 0.25) % 360.0,
            {"standard_name": "longitude", "units": "degrees_east"},
        ),
    }
    if members:
        dims = ("number", *dims)
        coords["number"] = ("number", np.arange(members), {"standard_name": "realization", "units": "1"})
    shape = tuple(coords[dim][1].size for dim in dims)
    along = [-1 if dim == "pressure_level" else 1 for dim in dims]
    height = 44330.0 * (1.0 - (np.array(LEVELS_HPA) / 1013.25) ** 0.19)
    geopotential = STANDARD_GRAVITY_M_S2 * (height.reshape(along) + 25.0 * rng.standard_normal(shape))
    names = {
        "u": (10.0 + 2.0 * rng.standard_normal(shape), "eastward_wind", "m s**-1"),
        "v": (2.0 * rng.standard_normal(shape) - 5.0, "northward_wind", "m s**-1"),
        "w": (2.0 * rng.standard_normal(shape), "lagrangian_tendency_of_air_pressure", "Pa s**-1"),
        "z": (geopotential, "geopotential", "m**2 s**-2"),
    }
    variables = {n: (dims, x, {"standard_name": s, "units": units}) for n, (x, s, units) in names.items()}
    dataset = xr.Dataset(variables, coords).assign_coords(expver=("valid_time", ["0001", "0001", "0005"]))
    if not members:
        dataset = dataset.assign_coords(number=((), 0, {"standard_name": "realization", "units": "1"}))
    encoding = {}
    for name, (values, _, _) in names.items():
        scale = float(np.ptp(values)) / 65000.0
        packing = {
            "dtype": "int16",
            "scale_factor": scale,
            "add_offset": 0.5 * float(values.min() + values.max()),
            "_FillValue": -32767,
        }
        encoding[name] = packing if packed else {}
    dataset.to_netcdf(path, engine="netcdf4", encoding=encoding)
    return path


def metric_file(
    path: Path,
    velocity: Callable[..., tuple[np.ndarray, np.ndarray, np.ndarray]],
    *,
    north: np.ndarray,
    east: np.ndarray,
    altitude: np.ndarray,
    times_s: np.ndarray | None = None,
) -> Path:
    """Write a field (east, north, up) of time, north, east and altitude on axes in metres and seconds."""
    times = np.zeros(1) if times_s is None else times_s
    t, h, n, e = np.meshgrid(times, altitude, north, east, indexing="ij")
    parts = velocity(t, n, e, h)
    names = ("eastward_wind", "northward_wind", "upward_air_velocity")
    dims = ("time", "altitude", "north", "east")
    variables = {
        short: (dims, np.broadcast_to(part, t.shape), {"standard_name": name, "units": "m s-1"})
        for short, name, part in zip("uvw", names, parts, strict=True)
    }
    units = {"time": ("s", times), "altitude": ("m", altitude), "north": ("m", north), "east": ("m", east)}
    coords = {name: (name, values, {"units": unit}) for name, (unit, values) in units.items()}
    xr.Dataset(variables, coords).to_netcdf(path, engine="netcdf4")
    return path
