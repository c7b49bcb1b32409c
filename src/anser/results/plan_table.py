"""The trajectories of a plan as a table in a text file."""

import csv
from pathlib import Path

import numpy as np
import xarray as xr

from anser.output_files import new_file
from anser.results.spreadsheet_text import spreadsheet_text

TRAJECTORY_COLUMNS = (
    "north_m",
    "east_m",
    "altitude_m",
    "velocity_north_m_s",
    "velocity_east_m_s",
    "airspeed_m_s",
    "ground_speed_m_s",
    "course_deg",
    "ground_course_deg",
    "path_angle_deg",
    "climb_rate_m_s",
    "bank_deg",
    "load_factor",
    "thrust_surplus_m_s2",
)
"""Columns after `time_s` and `aircraft`; course and path angle, climb rate and bank are those relative to the air."""

_DIGITS = 6


def write_trajectories(dataset: xr.Dataset, path: Path) -> None:
    """Write a plan to a new file of comma-separated values (RFC 4180): one row per aircraft and instant.

    Parameters
    ----------
    dataset
        As `anser.results.plan_dataset` makes it.
    path
        New file.

    Raises
    ------
    FileExistsError
        It exists: nothing is overwritten.

    Notes
    -----
    Aircraft after aircraft, each at the even instants up to its arrival and at the arrival itself; there is no row of
    an aircraft whose path is not finite.
    """
    times, even = dataset["time"].values, dataset["even"].values
    columns = [dataset[name].values for name in TRAJECTORY_COLUMNS]
    with new_file(path) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("time_s", "aircraft", *TRAJECTORY_COLUMNS))
        for k, name in enumerate(dataset["aircraft"].values):
            arrival = dataset["arrival_time_s"].values[k]
            rows = np.stack([column[:, k] for column in columns], axis=1)
            chosen = ((even & (times < arrival)) | (times == arrival)) & np.all(np.isfinite(rows), axis=1)
            # adding 0 makes 0 of -0
            rounded = np.round(rows[chosen], _DIGITS) + 0.0
            writer.writerows(
                (f"{time:.{_DIGITS}f}", spreadsheet_text(str(name)), *(f"{value:.{_DIGITS}f}" for value in row))
                for time, row in zip(times[chosen], rounded, strict=True)
            )
