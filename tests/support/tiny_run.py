"""The folder of a run of one aircraft, level at the origin: sufficient for commands on a run."""

import json
from pathlib import Path

import numpy as np
import xarray as xr

from anser.results import to_dataset, write_netcdf
from anser.variables import CATALOGUE, RECORDED_KEYS

TIMES = 21


def tiny_dataset() -> xr.Dataset:
    """Two seconds at 900 m."""
    history = {v.key: np.zeros((TIMES, 1), v.dtype) for v in CATALOGUE if v.key in RECORDED_KEYS}
    history |= {
        "quaternion_0": np.ones((TIMES, 1)),
        "altitude": np.full((TIMES, 1), 900.0),
        "range_to_rendezvous": np.linspace(300.0, 10.0, TIMES)[:, None],
        "arrival_time": np.full((TIMES, 1), 2.0),
    }
    origin = {"reference_latitude_deg": 10.0, "reference_longitude_deg": 20.0}
    return to_dataset(np.linspace(0.0, 2.0, TIMES), history, ["one"], origin)


def make_run(folder: Path) -> Path:
    """Write `flight.nc` and `summary.json` into a new folder."""
    folder.mkdir()
    write_netcdf(tiny_dataset(), folder / "flight.nc")
    aircraft = {"name": "one", "goal": "buoy", "status": "arrived", "planned_arrival_s": 1.0}
    aircraft |= {"arrival_s": None, "miss_m": 0.0}
    fleet = {"separation_min_m": None, "simulated_s": 2.0}
    summary = {"format_version": 1, "scenario": {"name": "still"}, "aircraft": [aircraft], "fleet": fleet}
    (folder / "summary.json").write_text(json.dumps(summary | {"requirements": []}))
    return folder
