"""Outputs of a recorded plan.

The machine-readable summary, format version 1, and the trajectories as a table in a text file.
"""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from anser.files import new_file
from anser.planning.limits import LIMITS
from anser.results.documents import escape_spreadsheet_text, finite_or_none

PLAN_FORMAT_VERSION = 1

_PLANNED = "planned"


def plan_summary(dataset: xr.Dataset) -> dict[str, Any]:
    """Sum up a plan.

    Parameters
    ----------
    dataset
        As `anser.results.plan_record` makes it.

    Returns
    -------
    dict
        The contract of `plan.json` (write it with `anser.results.write_summary`): plain numbers, text, lists and dicts;
        a number that does not exist is None. Margins are positive where a limit is kept; `bounds` tells whether they
        are proven between the samples, too.
    """
    of = dataset.attrs
    arrivals = dataset["arrival_time_s"].values
    names = [str(name) for name in dataset["aircraft"].values]
    margins = plan_margins(dataset)
    proven = any(name.startswith("bound_") for name in map(str, dataset.data_vars))
    return {
        "format_version": PLAN_FORMAT_VERSION,
        "scenario": {"name": of["title"], "hash": of["scenario_hash"]},
        "seed": int(of["seed"]),
        "versions": {key.removeprefix("version_"): of[key] for key in of if key.startswith("version_")},
        "planner": of["planner"],
        "bounds": "proven" if proven else "sampled",
        "status": "not flyable" if of["problems"] else _PLANNED,
        "problems": of["problems"].split("\n") if of["problems"] else [],
        "notes": of["notes"].split("\n") if of["notes"] else [],
        "arrival": {
            "rule": of["rule"],
            "first_s": finite_or_none(np.min(arrivals)),
            "last_s": finite_or_none(np.max(arrivals)),
        },
        "aircraft": [_aircraft_entry(dataset, k, names[k], margins) for k in range(len(names))],
        "least_distance": _least(dataset, "distance", names) | {"required_m": of.get("distance_limit_m")},
        "separation": _separation(dataset, names),
        "keep_outs": _keep_outs(dataset, names),
    }


def plan_margins(dataset: xr.Dataset) -> dict[str, np.ndarray]:
    """What a plan leaves to each limit, by the limit's name; (aircraft,), in its unit, negative where it is passed.

    Parameters
    ----------
    dataset
        As `anser.results.plan_record` makes it. Where a bound is proven the margin is that of the bound, else that of
        the samples; NaN where there is no limit.
    """
    found = {}
    for limit in LIMITS:
        proven = f"bound_{limit.name}"
        worst = dataset[proven if proven in dataset else limit.name].values
        room = worst - dataset[f"limit_{limit.name}"].values
        found[limit.name] = room if limit.is_lower_bound else -room
    return found


def _aircraft_entry(dataset: xr.Dataset, k: int, name: str, margins: dict[str, np.ndarray]) -> dict[str, Any]:
    def of(key: str) -> float | None:
        return finite_or_none(dataset[key].values[k])

    message = str(dataset["message"].values[k])
    row: dict[str, Any] = {
        "name": name,
        "goal": str(dataset["goal"].values[k]),
        "status": message or _PLANNED,
        "path": str(dataset["path"].values[k]),
        "arrival_s": of("arrival_time_s"),
        "length_m": of("length_m"),
        "speed_mean_m_s": of("airspeed_mean_m_s"),
        "speed_min_m_s": of("airspeed_min_m_s"),
        "speed_max_m_s": of("airspeed_max_m_s"),
    }
    row |= {key: of(key) for key in ("nominal_length_m", "turn_use") if key in dataset}
    if "hold_radius_m" in dataset:
        sense = "right" if dataset["hold_turn"].values[k] > 0.0 else "left"
        row["hold"] = {"direction": sense, "radius_m": of("hold_radius_m"), "height_m": of("hold_height_m")}
    row["limits"] = []
    for limit in LIMITS:
        if not np.isfinite(dataset[f"limit_{limit.name}"].values[k]):
            continue
        entry = {
            "name": limit.name,
            "limit": of(f"limit_{limit.name}"),
            "planned": of(limit.name),
            "margin": finite_or_none(margins[limit.name][k]),
        }
        if f"bound_{limit.name}" in dataset:
            entry["bound"] = of(f"bound_{limit.name}")
        row["limits"].append(entry)
    return row


def _least(dataset: xr.Dataset, what: str, names: list[str]) -> dict[str, Any]:
    pair = dataset[f"least_{what}_pair"].values
    return {
        "value_m": finite_or_none(dataset[f"least_{what}_m"].item()),
        "pair": [names[k] for k in pair] if pair[0] >= 0 else None,
        "time_s": finite_or_none(dataset[f"least_{what}_at_s"].item()),
        "horizontal_m": finite_or_none(dataset[f"least_{what}_level_m"].item()),
        "vertical_m": finite_or_none(dataset[f"least_{what}_height_m"].item()),
    }


def _separation(dataset: xr.Dataset, names: list[str]) -> dict[str, Any] | None:
    """None where none is asked for. The margin is what the pair has beyond it, in the plane or, scaled, in altitude."""
    of = dataset.attrs
    if "separation_horizontal_m" not in of:
        return None
    least = _least(dataset, "separation", names)
    asked = of["separation_horizontal_m"]
    margin = None if least["value_m"] is None else least["value_m"] - asked
    found = {"horizontal_asked_m": asked, "vertical_asked_m": of["separation_vertical_m"], **least, "margin_m": margin}
    if "separation_bound" in of:
        found["bound_ratio"] = finite_or_none(of["separation_bound"])
    if "hold_separation_bound" in of:
        found["hold_bound_ratio"] = finite_or_none(of["hold_separation_bound"])
    return found


def _keep_outs(dataset: xr.Dataset, names: list[str]) -> list[dict[str, Any]]:
    found = []
    for k in range(dataset.sizes.get("keep_out", 0)):
        room = dataset["keep_out_room_m"].values[:, k]
        who = int(np.argmin(np.where(np.isfinite(room), room, np.inf)))
        row = {
            "name": str(dataset["keep_out"].values[k]),
            "aircraft": names[who],
            "room_m": finite_or_none(room[who]),
            "time_s": finite_or_none(dataset["keep_out_at_s"].values[who, k]),
        }
        if "bound_keep_out_room_m" in dataset:
            row["bound_m"] = finite_or_none(np.min(dataset["bound_keep_out_room_m"].values[:, k]))
        found.append(row)
    return found


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
        As `anser.results.plan_record` makes it.
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
                (f"{time:.{_DIGITS}f}", escape_spreadsheet_text(str(name)), *(f"{value:.{_DIGITS}f}" for value in row))
                for time, row in zip(times[chosen], rounded, strict=True)
            )
