"""How much of every requirement and limit a flight used, the tightest first."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from anser.report.derived_variables import aircraft_limits

_Row = Mapping[str, Any]


@dataclass(frozen=True)
class Margin:
    """What was left to one requirement or limit.

    Attributes
    ----------
    what
        In words.
    kind
        "requirement": not meeting it fails the flight; "limit": of the plan and the autopilot.
    unit
        Of value and limit; empty where there is none.
    limit, value
        What was allowed, and the worst of the flight; None where there is no value.
    most
        Whether the limit is an upper one.
    met
        Whether it was kept.
    who
        Whose value it is; empty where it is the fleet's.
    when_s
        When, s; None where it is of no instant or not known.
    after_arrival
        Whether the limit was kept up to the arrivals and passed only in the hold after them.
    """

    description: str
    kind: str
    unit: str
    limit: float
    value: float | None
    is_upper: bool
    is_met: bool
    aircraft: str = ""
    time_s: float | None = None
    after_arrival: bool = False

    @property
    def utilization(self) -> float | None:
        """Part of the way to the limit, 1 at the limit: value over limit, or limit over value for a lower one.

        None where there is no value. A value on the other side of 0 than its limit has used nothing.
        """
        if self.value is None:
            return None
        if self.limit == 0.0:
            return 0.0 if self.is_met else np.inf
        if self.value * self.limit <= 0.0:
            return 0.0 if self.is_met else np.inf
        # a lower limit below 0 is met from above like an upper one above 0: the value grows towards it
        return self.value / self.limit if self.is_upper == (self.limit > 0.0) else self.limit / self.value


# Requirement: words, unit, key of the row of an aircraft whose worst value it is, whether the limit is an upper one.
_WORDS: dict[str, tuple[str, str, str | None, bool]] = {
    "miss_max_m": ("Miss of the rendezvous", "m", "miss_m", True),
    "arrival_error_max_s": ("Arrival off its planned time", "s", None, True),
    "arrival_spread_max_s": ("Arrival spread, first to last", "s", None, True),
    "position_error_max_m": ("Distance to the planned point", "m", "position_error_max_m", True),
    "speed_max_m_s": ("Highest airspeed up to the arrival", "m/s", "speed_max_m_s", True),
    "speed_min_m_s": ("Lowest airspeed up to the arrival", "m/s", "speed_min_m_s", False),
    "tables_left_max_s": ("Time outside the aerodynamic tables", "s", "tables_left_s", True),
    "separation_ratio_min": ("Separation kept over separation asked for", "", None, False),
    "separation_min_m": ("Distance between two aircraft", "m", None, False),
    "clearance_min_m": ("Distance to the goal", "m", "clearance_min_m", False),
    "clearance_surface_min_m": ("Distance to a goal on the surface", "m", "clearance_min_m", False),
    "clearance_airborne_min_m": ("Distance to an airborne goal", "m", "clearance_min_m", False),
}
_OF_SEVERAL = ("arrival_spread_max_s", "separation_ratio_min", "separation_min_m")
# Variable, key of the limit, sign on it, words, unit.
_LIMITS = (
    ("bank_deg", "bank_max_deg", 1, "Bank angle to the right", "°"),
    ("bank_deg", "bank_max_deg", -1, "Bank angle to the left", "°"),
    ("climb_rate_m_s", "climb_rate_max_m_s", 1, "Climb rate", "m/s"),
    ("climb_rate_m_s", "climb_rate_max_m_s", -1, "Rate of descent", "m/s"),
    ("altitude_m", "altitude_max_m", 1, "Highest altitude", "m"),
    ("altitude_m", "altitude_min_m", 0, "Lowest altitude", "m"),
    ("load_factor", "load_factor_max", 1, "Highest load factor", ""),
    ("load_factor", "load_factor_min", 0, "Lowest load factor", ""),
    ("alpha_deg", "alpha_max_deg", 1, "Highest angle of attack", "°"),
    ("alpha_deg", "alpha_min_deg", 0, "Lowest angle of attack", "°"),
)


def find_flight_margins(dataset: xr.Dataset, summary: Mapping[str, Any]) -> list[Margin]:
    """Margins of a flight, the one that used most of its limit first; what was not met in time stands before all.

    Requirements are those of the summary, as it judged them; the limits are those of each aircraft, over the whole
    record, and of a limit that differs between them the margin that is tightest is told.

    Parameters
    ----------
    dataset
        With the derived variables.
    summary
        As the run holds it.
    """
    alone = len(summary["aircraft"]) == 1  # nothing to arrive with, nothing to keep away from
    found = [
        _requirement(entry, summary["aircraft"], dataset)
        for entry in summary["requirements"]
        if not (alone and entry["name"] in _OF_SEVERAL)
    ]
    limits = aircraft_limits(dataset)
    arrivals = {row["name"]: row["arrival_s"] for row in summary["aircraft"]}
    ends = [np.inf if arrivals.get(str(name)) is None else arrivals[str(name)] for name in dataset["aircraft"].values]
    flying = dataset["time"].values[:, np.newaxis] <= np.array(ends)
    for name, key, sign, words, unit in _LIMITS:
        own = np.array([np.nan if row.get(key) is None else row[key] for row in limits], dtype=float)
        margins = [
            _limit(
                dataset, flying, np.where(own == limit, dataset[name].values, np.nan), float(limit), sign, words, unit
            )
            for limit in dict.fromkeys(own[np.isfinite(own)].tolist())
        ]
        found += sorted(margins, key=_place)[:1]
    return sorted(found, key=_place)


def _place(margin: Margin) -> tuple[bool, float]:
    """Order of margins: what was not met in time, then by how much of the limit was used."""
    return margin.is_met or margin.after_arrival, -np.inf if margin.utilization is None else -margin.utilization


def closest_pair(dataset: xr.Dataset) -> tuple[float, float, str, str] | None:
    """Least distance between two aircraft at an instant of the record, m; when, s; and which two. None without two."""
    if "distance_min_m" not in dataset or not np.isfinite(dataset["distance_min_m"].values).any():
        return None
    nearest = dataset["distance_min_m"].values
    row, one = np.unravel_index(np.nanargmin(nearest), nearest.shape)
    places = np.stack([dataset[name].values[row] for name in ("north_m", "east_m", "altitude_m")], axis=-1)
    away = np.linalg.norm(places - places[one], axis=-1)
    away[one] = np.inf
    names = [str(name) for name in dataset["aircraft"].values]
    other = int(np.nanargmin(away))
    return float(nearest[row, one]), float(dataset["time"].values[row]), names[int(one)], names[other]


def _requirement(entry: _Row, rows: Sequence[_Row], dataset: xr.Dataset) -> Margin:
    name = entry["name"]
    words, unit, key, most = _WORDS.get(name, (name, "", None, "max" in name))
    who, when = "", None
    if key is not None and entry["value"] is not None:
        match = next((row for row in rows if row[key] == entry["value"]), None)
        who = str(match["name"]) if match else ""
    elif name == "arrival_error_max_s" and entry["value"] is not None:
        pairs = [(r["arrival_s"], r["planned_arrival_s"], r["name"]) for r in rows]
        off = [(abs(a - p), who) for a, p, who in pairs if a is not None and p is not None]
        who = str(max(off)[1]) if off else ""
    elif name == "separation_ratio_min" and "separation_kept" in dataset:
        _, who, when = _extreme(dataset, dataset["separation_kept"].values, False)
    elif name == "separation_min_m" and (apart := closest_pair(dataset)) is not None:
        who, when = f"{apart[2]} and {apart[3]}", apart[1]
    return Margin(words, "requirement", unit, entry["limit"], entry["value"], most, bool(entry["met"]), who, when)


def _extreme(dataset: xr.Dataset, values: np.ndarray, greatest: bool) -> tuple[float | None, str, float | None]:
    """Least or greatest of values over (time, aircraft), whose it is and when, s; None where there is none."""
    if not np.isfinite(values).any():
        return None, "", None
    row, column = np.unravel_index(np.nanargmax(values) if greatest else np.nanargmin(values), values.shape)
    return float(values[row, column]), str(dataset["aircraft"].values[column]), float(dataset["time"].values[row])


def _limit(
    dataset: xr.Dataset, flying: np.ndarray, values: np.ndarray, limit: float, sign: int, words: str, unit: str
) -> Margin:
    """Margin to a limit: sign 1 upper, 0 lower, -1 lower at the limit with the opposite sign, told as an upper one.

    `flying` tells, of the shape (time, aircraft), what lies up to the aircraft's arrival; values that are not judged
    are NaN.
    """
    values = -values if sign == -1 else values
    most = sign != 0
    value, who, when = _extreme(dataset, values, most)
    if value is None:
        return Margin(words, "limit", unit, limit, None, most, False)
    met = value <= limit if most else value >= limit
    passed = values > limit if most else values < limit
    later = not met and not bool(np.any(passed & flying))
    return Margin(words, "limit", unit, limit, value, most, met, who, when, later)
