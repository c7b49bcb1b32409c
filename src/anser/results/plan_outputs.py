"""Files of a plan: the machine-readable summary `plan.json` (format version 1), and the paths as CSV."""

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
    """Return the summary of a plan, a result of `plan_dataset`, as plain data: the content of `plan.json`.

    Missing numbers are None. Margins are positive within the limit. `bounds` is "proven" if the planner proves limits
    between the samples, and "sampled" if the planner does not. `anser.results.write_summary` writes the file.
    """
    attrs = dataset.attrs
    arrivals = dataset["arrival_time_s"].values
    names = [str(name) for name in dataset["aircraft"].values]
    margins = plan_margins(dataset)
    proven = any(name.startswith("bound_") for name in map(str, dataset.data_vars))
    return {
        "format_version": PLAN_FORMAT_VERSION,
        "scenario": {"name": attrs["title"], "hash": attrs["scenario_hash"]},
        "seed": int(attrs["seed"]),
        "versions": {key.removeprefix("version_"): attrs[key] for key in attrs if key.startswith("version_")},
        "planner": attrs["planner"],
        "bounds": "proven" if proven else "sampled",
        "status": "not flyable" if attrs["problems"] else _PLANNED,
        "problems": attrs["problems"].split("\n") if attrs["problems"] else [],
        "notes": attrs["notes"].split("\n") if attrs["notes"] else [],
        "arrival": {
            "rule": attrs["rule"],
            "first_s": finite_or_none(np.min(arrivals)),
            "last_s": finite_or_none(np.max(arrivals)),
        },
        "aircraft": [_aircraft_entry(dataset, k, names[k], margins) for k in range(len(names))],
        "least_distance": _minimum_entry(dataset, "distance", names) | {"required_m": attrs.get("distance_limit_m")},
        "separation": _separation_entry(dataset, names),
        "keep_outs": _keep_out_entries(dataset, names),
    }


def plan_margins(dataset: xr.Dataset) -> dict[str, np.ndarray]:
    """Compute the margin of each aircraft's path to each limit, in the limit's unit: shape (aircraft,), by limit name.

    The margin is negative if the limit is exceeded, and infinite or NaN if the aircraft has no limit. The margin refers
    to the path's proven extreme, if the dataset has a proven extreme, or to the extreme of the samples.
    """
    margins = {}
    for limit in LIMITS:
        proven = f"bound_{limit.name}"
        extreme = dataset[proven if proven in dataset else limit.name].values
        excess = extreme - dataset[f"limit_{limit.name}"].values
        margins[limit.name] = excess if limit.is_lower_bound else -excess
    return margins


def _aircraft_entry(dataset: xr.Dataset, k: int, name: str, margins: dict[str, np.ndarray]) -> dict[str, Any]:
    """Return the entry of the aircraft with index `k` in `plan.json`; `margins` is the result of `plan_margins`."""

    def number(key: str) -> float | None:
        return finite_or_none(dataset[key].values[k])

    message = str(dataset["message"].values[k])
    entry: dict[str, Any] = {
        "name": name,
        "goal": str(dataset["goal"].values[k]),
        "status": message or _PLANNED,
        "path": str(dataset["path"].values[k]),
        "arrival_s": number("arrival_time_s"),
        "length_m": number("length_m"),
        **{f"speed_{kind}_m_s": number(f"airspeed_{kind}_m_s") for kind in ("mean", "min", "max")},
        **{key: number(key) for key in ("nominal_length_m", "turn_use") if key in dataset},
    }
    if "hold_radius_m" in dataset:
        direction = "right" if dataset["hold_turn"].values[k] > 0.0 else "left"
        sizes = {"radius_m": number("hold_radius_m"), "height_m": number("hold_height_m")}
        entry["hold"] = {"direction": direction, **sizes}
    entry["limits"] = [
        {
            "name": limit.name,
            "limit": number(f"limit_{limit.name}"),
            "planned": number(limit.name),
            "margin": finite_or_none(margins[limit.name][k]),
            **({"bound": number(f"bound_{limit.name}")} if f"bound_{limit.name}" in dataset else {}),
        }
        for limit in LIMITS
        if np.isfinite(dataset[f"limit_{limit.name}"].values[k])
    ]
    return entry


def _minimum_entry(dataset: xr.Dataset, quantity: str, names: list[str]) -> dict[str, Any]:
    """Return the entry of `plan.json` on the closest pair of aircraft; `quantity` is "distance" or "separation"."""
    pair = dataset[f"least_{quantity}_pair"].values
    value_m, time_s, horizontal_m, vertical_m = (
        finite_or_none(dataset[f"least_{quantity}_{suffix}"].item()) for suffix in ("m", "at_s", "level_m", "height_m")
    )
    return {
        "value_m": value_m,
        "pair": [names[k] for k in pair] if pair[0] >= 0 else None,
        "time_s": time_s,
        "horizontal_m": horizontal_m,
        "vertical_m": vertical_m,
    }


def _separation_entry(dataset: xr.Dataset, names: list[str]) -> dict[str, Any] | None:
    """Return the entry on the least separation in the plan; None if no separation is required.

    In a separation, vertical distances are multiplied by the ratio of required horizontal to vertical separation.
    """
    attrs = dataset.attrs
    if "separation_horizontal_m" not in attrs:
        return None
    minimum = _minimum_entry(dataset, "separation", names)
    required = attrs["separation_horizontal_m"]
    margin = None if minimum["value_m"] is None else minimum["value_m"] - required
    bounds = {"bound_ratio": "separation_bound", "hold_bound_ratio": "hold_separation_bound"}
    return {
        "horizontal_asked_m": required,
        "vertical_asked_m": attrs["separation_vertical_m"],
        **minimum,
        "margin_m": margin,
        **{key: finite_or_none(attrs[name]) for key, name in bounds.items() if name in attrs},
    }


def _keep_out_entries(dataset: xr.Dataset, names: list[str]) -> list[dict[str, Any]]:
    """Return an entry for each keep-out: name, nearest aircraft, distance outside (m, negative inside) and time."""
    entries = []
    for k in range(dataset.sizes.get("keep_out", 0)):
        margins = dataset["keep_out_room_m"].values[:, k]
        index = int(np.argmin(np.where(np.isfinite(margins), margins, np.inf)))
        keep_out_entry = {
            "name": str(dataset["keep_out"].values[k]),
            "aircraft": names[index],
            "room_m": finite_or_none(margins[index]),
            "time_s": finite_or_none(dataset["keep_out_at_s"].values[index, k]),
        }
        if "bound_keep_out_room_m" in dataset:
            keep_out_entry["bound_m"] = finite_or_none(np.min(dataset["bound_keep_out_room_m"].values[:, k]))
        entries.append(keep_out_entry)
    return entries


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
"""Columns of the CSV after `time_s` and `aircraft`; course, path angle, climb rate and bank are relative to the air."""

_DIGITS = 6


def write_trajectories(dataset: xr.Dataset, path: Path) -> None:
    """Write the paths of a plan to a new CSV file (RFC 4180): one row per aircraft and time.

    Rows are sorted by aircraft, then by time. An aircraft's times are the regular sample times before its arrival, and
    the arrival. Samples that are not finite are left out. Raises FileExistsError if `path` exists.
    """
    times, is_regular = dataset["time"].values, dataset["even"].values
    columns = [dataset[name].values for name in TRAJECTORY_COLUMNS]
    with new_file(path) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("time_s", "aircraft", *TRAJECTORY_COLUMNS))
        for k, name in enumerate(dataset["aircraft"].values):
            arrival = dataset["arrival_time_s"].values[k]
            table = np.stack([column[:, k] for column in columns], axis=1)
            is_written = ((is_regular & (times < arrival)) | (times == arrival)) & np.all(np.isfinite(table), axis=1)
            # adding 0 turns -0 into 0
            rounded = np.round(table[is_written], _DIGITS) + 0.0
            writer.writerows(
                (
                    f"{time:.{_DIGITS}f}",
                    escape_spreadsheet_text(str(name)),
                    *(f"{value:.{_DIGITS}f}" for value in numbers),
                )
                for time, numbers in zip(times[is_written], rounded, strict=True)
            )
