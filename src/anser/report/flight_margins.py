"""Margins of a flight to its requirements and to the limits of the aircraft, the tightest margin first."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from anser.report.derived_variables import aircraft_limits

_Table = Mapping[str, Any]


@dataclass(frozen=True)
class Margin:
    """Margin of a flight to a requirement, or to a limit of plan and autopilot; a flight may exceed a limit."""

    description: str
    kind: str  # "requirement" or "limit"
    unit: str  # of `limit` and `value`
    limit: float
    value: float | None  # worst value of the flight; None if missing
    is_upper: bool
    is_met: bool
    aircraft: str = ""  # aircraft with the worst value; empty if unknown
    time_s: float | None = None  # time of the worst value; None if unknown
    after_arrival: bool = False  # True: the limit was exceeded in the hold after the arrival only

    @property
    def utilization(self) -> float | None:
        """Utilization of the limit: less than 1 within the limit, 1 at the limit; None if the value is missing.

        - Positive upper or negative lower limit: value / limit
        - Positive lower or negative upper limit: limit / value
        - Opposite signs, or a 0: 0 if the limit is met; infinite if not
        """
        if self.value is None:
            return None
        if self.limit == 0.0:
            return 0.0 if self.is_met else np.inf
        if self.value * self.limit <= 0.0:
            return 0.0 if self.is_met else np.inf
        # a negative lower limit is approached with growing magnitude, like a positive upper limit
        return self.value / self.limit if self.is_upper == (self.limit > 0.0) else self.limit / self.value


# Requirement: description, unit, key of the aircraft's summary with the value, whether the limit is an upper limit.
_REQUIREMENTS: dict[str, tuple[str, str, str | None, bool]] = {
    "miss_max_m": ("Miss of the rendezvous", "m", "miss_m", True),
    "arrival_error_max_s": ("Arrival off its planned time", "s", None, True),
    "arrival_spread_max_s": ("Arrival spread, first to last", "s", None, True),
    "position_error_max_m": ("Distance to the planned point", "m", "position_error_max_m", True),
    "speed_max_m_s": ("Highest airspeed up to the arrival", "m/s", "speed_max_m_s", True),
    "speed_min_m_s": ("Lowest airspeed up to the arrival", "m/s", "speed_min_m_s", False),
    "tables_left_max_s": ("Time outside the aerodynamic tables", "s", "tables_left_s", True),
    "separation_ratio_min": ("Separation kept over required separation", "", None, False),
    "separation_min_m": ("Distance between two aircraft", "m", None, False),
    "keep_out_room_min_m": ("Distance outside the keep-outs", "m", "keep_out_room_min_m", False),
    "clearance_min_m": ("Distance to the goal", "m", "clearance_min_m", False),
    "clearance_surface_min_m": ("Distance to a goal on the surface", "m", "clearance_min_m", False),
    "clearance_airborne_min_m": ("Distance to an airborne goal", "m", "clearance_min_m", False),
}
_FLEET_REQUIREMENTS = ("arrival_spread_max_s", "separation_ratio_min", "separation_min_m")
# Variable, key of the limit, sign (see `_limit`), description, unit.
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
    """Return the margins of a flight to its requirements and to the limits of the aircraft.

    Margins that are not met up to the arrival come first, then all others; in each group, the utilization decreases.
    Limits are evaluated over the whole record; if aircraft have different limits, only the tightest margin is listed.
    `dataset` must contain the variables of `add_derived_variables`.
    """
    is_single = len(summary["aircraft"]) == 1
    flight_margins = [
        _requirement(entry, summary["aircraft"], dataset)
        for entry in summary["requirements"]
        if not (is_single and entry["name"] in _FLEET_REQUIREMENTS)
    ]
    limits = aircraft_limits(dataset)
    arrivals = {aircraft["name"]: aircraft["arrival_s"] for aircraft in summary["aircraft"]}
    arrival_times = np.array([arrivals.get(str(name)) for name in dataset["aircraft"].values], dtype=float)  # None: NaN
    is_before_arrival = dataset["time"].values[:, np.newaxis] <= np.nan_to_num(arrival_times, nan=np.inf)
    for name, key, sign, description, unit in _LIMITS:
        limit_values = np.array([aircraft.get(key) for aircraft in limits], dtype=float)
        margins = []
        for limit in dict.fromkeys(limit_values[np.isfinite(limit_values)].tolist()):
            values = np.where(limit_values == limit, dataset[name].values, np.nan)
            margin = _limit(dataset, is_before_arrival, values, limit, sign, description, unit)
            margins += [] if margin is None else [margin]
        flight_margins += sorted(margins, key=_sort_key)[:1]
    return sorted(flight_margins, key=_sort_key)


def _sort_key(margin: Margin) -> tuple[bool, float]:
    return margin.is_met or margin.after_arrival, -np.inf if margin.utilization is None else -margin.utilization


def closest_pair(dataset: xr.Dataset) -> tuple[float, float, str, str] | None:
    """Return the least recorded distance between two aircraft (m), its time (s), and the names of the two aircraft.

    None for a single aircraft, or if no distance is finite. `dataset` must contain the derived variables.
    """
    if "distance_min_m" not in dataset or not np.isfinite(dataset["distance_min_m"].values).any():
        return None
    nearest = dataset["distance_min_m"].values
    sample, index = np.unravel_index(np.nanargmin(nearest), nearest.shape)
    positions = np.stack([dataset[name].values[sample] for name in ("north_m", "east_m", "altitude_m")], axis=-1)
    distances = np.linalg.norm(positions - positions[index], axis=-1)
    distances[index] = np.inf
    names = [str(name) for name in dataset["aircraft"].values]
    neighbour = int(np.nanargmin(distances))
    return float(nearest[sample, index]), float(dataset["time"].values[sample]), names[int(index)], names[neighbour]


def _requirement(entry: _Table, fleet: Sequence[_Table], dataset: xr.Dataset) -> Margin:
    name = entry["name"]
    description, unit, key, is_upper = _REQUIREMENTS.get(name, (name, "", None, "max" in name))
    aircraft, time_s = "", None
    if key is not None and entry["value"] is not None:
        match = next((aircraft_row for aircraft_row in fleet if aircraft_row[key] == entry["value"]), None)
        aircraft = str(match["name"]) if match else ""
    elif name == "arrival_error_max_s" and entry["value"] is not None:
        pairs = [(r["arrival_s"], r["planned_arrival_s"], r["name"]) for r in fleet]
        errors = [(abs(a - p), aircraft) for a, p, aircraft in pairs if a is not None and p is not None]
        aircraft = str(max(errors)[1]) if errors else ""
    elif name == "separation_ratio_min" and "separation_kept" in dataset:
        _, aircraft, time_s = _extreme_value(dataset, dataset["separation_kept"].values, False)
    elif name == "separation_min_m" and (pair := closest_pair(dataset)) is not None:
        aircraft, time_s = f"{pair[2]} and {pair[3]}", pair[1]
    return Margin(
        description, "requirement", unit, entry["limit"], entry["value"], is_upper, bool(entry["met"]), aircraft, time_s
    )


def _extreme_value(dataset: xr.Dataset, values: np.ndarray, greatest: bool) -> tuple[float | None, str, float | None]:
    """Return the greatest or least of `values` (time, aircraft), aircraft name and time (s); None if none is finite."""
    if not np.isfinite(values).any():
        return None, "", None
    sample, index = np.unravel_index(np.nanargmax(values) if greatest else np.nanargmin(values), values.shape)
    return float(values[sample, index]), str(dataset["aircraft"].values[index]), float(dataset["time"].values[sample])


def _limit(
    dataset: xr.Dataset,
    is_before_arrival: np.ndarray,
    values: np.ndarray,
    limit: float,
    sign: int,
    description: str,
    unit: str,
) -> Margin | None:
    """Return the margin of `values` (time, aircraft; NaN where the limit does not apply); None if no value is finite.

    `sign` is 1 for an upper limit, 0 for a lower limit, and -1 for an upper limit on the negated values.
    `is_before_arrival` is a mask (time, aircraft).
    """
    values = -values if sign == -1 else values
    is_upper = sign != 0
    value, aircraft, time_s = _extreme_value(dataset, values, is_upper)
    if value is None:
        return None
    is_met = value <= limit if is_upper else value >= limit
    exceeded = values > limit if is_upper else values < limit
    after_arrival = not is_met and not bool(np.any(exceeded & is_before_arrival))
    return Margin(description, "limit", unit, limit, value, is_upper, is_met, aircraft, time_s, after_arrival)
