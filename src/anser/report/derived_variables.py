"""Quantities derived from a recorded flight.

Errors along and across the plan, separations, estimation errors, and events such as phases, replanning and limited
commands.
"""

import json
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import xarray as xr

from anser.results.separation import nearest_aircraft_distance
from anser.variables import PLAN_VARIABLES

HOLD = 2
"""Value of `phase` once the aircraft has arrived and holds."""

_CLIMB_RATE = next(variable for variable in PLAN_VARIABLES if variable.key == "climb_rate")
_LABELS = {
    "links_heard": ("1", "n_H", "Number of aircraft heard"),
    "along_error_m": ("m", "e_a", "Ahead of the planned point"),
    "across_error_m": ("m", "e_x", "Right of the planned path"),
    "height_error_m": ("m", "e_h", "Above the planned path"),
    "height_over_floor_m": ("m", "h_f", "Height over the lowest altitude allowed"),
    "separation_kept": ("1", "d_sep", "Separation kept over separation asked for"),
    "distance_min_m": ("m", "d_min", "Distance to the nearest other aircraft"),
    "goal_error_m": ("m", "e_g", "Distance of the goal from where it is taken to be"),
    "goal_band_m": ("m", "2σ_g", "Two standard deviations of the goal's place"),
    "own_error_m": ("m", "e_o", "Distance of the aircraft from where it takes itself to be"),
    "own_band_m": ("m", "2σ_o", "Two standard deviations of the own place"),
}
DERIVED_VARIABLES = (_CLIMB_RATE.name, *_LABELS)
"""Names of what `add_derived_variables` adds."""


def recorded_scenario(dataset: xr.Dataset) -> dict[str, Any]:
    """Read the scenario that a dataset carries as JSON; empty where it carries none that can be read."""
    try:
        found = json.loads(dataset.attrs.get("scenario", "{}"))
    except (TypeError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def aircraft_limits(dataset: xr.Dataset) -> list[dict[str, Any]]:
    """Limits that each aircraft flew with, by the keys of a scenario's `limits`, and its `surfaces_deg`.

    A record without them, from before they were written, has the scenario's for the library's F-16, and none for other
    aircraft, whose own are not known.
    """
    if "limits" in dataset.attrs:
        return json.loads(dataset.attrs["limits"])
    scenario = recorded_scenario(dataset)
    limits, rows = scenario.get("limits", {}), scenario.get("aircraft", [{}] * dataset.sizes["aircraft"])
    is_own = [row.get("type", "f16") != "f16" or row.get("airframe") is not None for row in rows]
    return [{} if own else limits for own in is_own]


def has_certified_paths(scenario: Mapping[str, Any]) -> bool:
    """Whether the paths have certificates; these paths have turns, but no lateral bend."""
    return scenario.get("fleet", {}).get("planner", "published") != "published"


def required_separation(scenario: Mapping[str, Any]) -> tuple[float, float] | None:
    """Horizontal and vertical separation that a scenario asks for, m; vertical 0: altitude does not count."""
    asked = scenario.get("separation", {})
    if not asked.get("horizontal_m", 0.0) > 0.0:
        return None
    return float(asked["horizontal_m"]), float(asked.get("vertical_m", 0.0))


def add_derived_variables(dataset: xr.Dataset, scenario: Mapping[str, Any]) -> xr.Dataset:
    """Add what the report draws and no flight records; plan and errors end where the hold begins.

    Parameters
    ----------
    dataset
        A flight, dimensions (time, aircraft).
    scenario
        As `recorded_scenario` reads it: the floor and the separation asked for are taken from it, where it has them.

    Returns
    -------
    xr.Dataset
        The same with `climb_rate_m_s`, `along_error_m`, `across_error_m`, `height_error_m`; `distance_min_m` where
        there are two aircraft or more; `height_over_floor_m` and `separation_kept` where the scenario asks for them.
        `position_error_m` and the planned point are NaN in the hold. Where sensors have errors, how far goal and
        aircraft are from where they are taken to be, with two standard deviations (the root of the sum over the axes).
    """
    planned = dataset["phase"].values != HOLD
    changed = {
        name: dataset[name].where(planned)
        for name in ("position_error_m", "reference_north_m", "reference_east_m", "reference_altitude_m")
    }
    found = dataset.assign(changed)
    found[_CLIMB_RATE.name] = (-dataset["velocity_down_m_s"]).assign_attrs(
        units=_CLIMB_RATE.unit, symbol=_CLIMB_RATE.symbol, long_name=_CLIMB_RATE.long_name
    )
    along, across, height = _errors(dataset)
    for name, values in (("along_error_m", along), ("across_error_m", across), ("height_error_m", height)):
        _add(found, name, np.where(planned, values, np.nan))
    places = np.stack([dataset[name].values for name in ("north_m", "east_m", "altitude_m")], axis=-1)
    if dataset.sizes["aircraft"] > 1:
        _add(found, "distance_min_m", nearest_aircraft_distance(places))
    floor = scenario.get("limits", {}).get("altitude_min_m")
    if floor is not None:
        _add(found, "height_over_floor_m", dataset["altitude_m"].values - float(floor))
    apart_m = required_separation(scenario)
    if dataset.sizes["aircraft"] > 1 and apart_m is not None:
        # none is asked for of an aircraft that has arrived
        flying = dataset["phase"].values != HOLD
        _add(found, "separation_kept", nearest_aircraft_distance(places, apart_m, flying))
    if "goal_sigma_north_m" in dataset:
        for what, true, taken in (("goal", "goal_", "goal_estimate_"), ("own", "", "own_estimate_")):
            _add(found, f"{what}_error_m", _length(dataset[f"{true}{a}"] - dataset[f"{taken}{a}"] for a in _AXES))
            _add(found, f"{what}_band_m", 2.0 * _length(dataset[f"{what}_sigma_{axis}"] for axis in _AXES))
    if "heard_from" in dataset:
        _add(found, "links_heard", np.bitwise_count(dataset["heard_from"].values).astype(float))
    return found


_AXES = ("north_m", "east_m", "altitude_m")


def _length(parts: Iterable[xr.DataArray]) -> np.ndarray:
    return np.sqrt(sum(part.values**2 for part in parts))


def _errors(dataset: xr.Dataset) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Flown less planned place: along the planned path over ground, to its right, and up; m."""
    north, east, up = (
        dataset[name].values - dataset[f"reference_{name}"].values for name in ("north_m", "east_m", "altitude_m")
    )
    time = dataset["time"].values
    if time.size < 2:
        return np.zeros_like(up), np.zeros_like(up), up
    rate_n, rate_e = (np.gradient(dataset[f"reference_{name}"].values, time, axis=0) for name in ("north_m", "east_m"))
    speed = np.hypot(rate_n, rate_e)
    cosine, sine = (
        np.divide(rate, speed, out=np.full_like(speed, np.nan), where=speed > 0.0) for rate in (rate_n, rate_e)
    )
    return north * cosine + east * sine, east * cosine - north * sine, up


def _add(dataset: xr.Dataset, name: str, values: np.ndarray) -> None:
    unit, symbol, words = _LABELS[name]
    dataset[name] = (("time", "aircraft"), values, {"units": unit, "symbol": symbol, "long_name": words})


REPLANNING_OUTCOMES = (
    "fitted to where the goal is now",
    "corrected",
    "planned anew",
    "last good plan kept",
    "kept until the goal is known better",
    "bent as far as the limits allow",
)
"""What a renewal did, in the order of the numbers in `find_events`."""

LIMITED_COMMANDS = {
    "speed": "speed",
    "thrust": "thrust",
    "lift": "lift",
    "bank": "bank or its rate",
    "rates": "body rates",
    "surfaces": "surfaces",
}
"""Commands that the autopilot can hold at a limit, `speed_limited` and so on, in words."""

_FITTED, _CORRECTED, _ANEW, _KEPT = range(4)


def find_events(dataset: xr.Dataset) -> list[dict[str, Any]]:
    """Events of each aircraft.

    Returns
    -------
    list of dict
        One for each aircraft: `phases` and `failed`, [name or code, from, to] each; `renewals`, [time, what] each,
        `what` an index into `RENEWALS`: the instants at which the plan in force changed; `limited`, [index into
        `LIMITED`, from, to] each; `outside`, [from, to] each: outside the aerodynamic tables. Times in s.
    """
    time = dataset["time"].values
    return [_of_one(dataset.isel(aircraft=k), time) for k in range(dataset.sizes["aircraft"])]


def _of_one(one: xr.Dataset, time: np.ndarray) -> dict[str, Any]:
    names = str(one["phase"].attrs.get("flag_meanings", "approach frozen hold")).split()
    phases = [
        [names[code] if code < len(names) else str(code), *span] for code, *span in _stretches(one["phase"], time)
    ]
    limited = [
        [k, *span]
        for k, what in enumerate(LIMITED_COMMANDS)
        for held, *span in _stretches(one[f"{what}_limited"], time)
        if held
    ]
    return {
        "phases": phases,
        "renewals": _renewals(one, time),
        "limited": limited,
        "outside": [span for out, *span in _stretches(one["outside_tables"], time) if out],
        "failed": [[code, *span] for code, *span in _stretches(one["status"], time) if code],
    }


def _renewals(one: xr.Dataset, time: np.ndarray) -> list[list[float]]:
    how, arrival = one["renewal"].values.astype(int), one["arrival_time_s"].values
    shape = np.stack([one["planned_length_m"].values, np.nan_to_num(one["lateral_bend_m"].values)])
    new_way = np.diff(how) != 0
    new_shape = np.any(np.diff(shape, axis=1) != 0, axis=0)
    new_time = np.diff(arrival) != 0
    at = np.flatnonzero((new_way | new_shape | new_time) & np.isfinite(arrival[1:])) + 1
    # the published planner records no way; a new arrival time tells that it coordinated the fleet anew
    what = [_ANEW if how[k] == _FITTED and new_time[k - 1] else int(how[k]) for k in at]
    return [[round(float(time[k]), 4), code] for k, code in zip(at, what, strict=True)]


def _stretches(values: xr.DataArray, time: np.ndarray) -> list[list[Any]]:
    """Runs of equal values: [value, from, to] each; each lasts until the next begins."""
    codes = values.values.astype(int)
    starts = np.concatenate([[0], np.flatnonzero(np.diff(codes)) + 1])
    ends = [*starts[1:], codes.size - 1]
    return [
        [int(codes[start]), round(float(time[start]), 4), round(float(time[end]), 4)]
        for start, end in zip(starts, ends, strict=True)
    ]
