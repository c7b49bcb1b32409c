"""Variables, limits and events derived from the dataset of a flight for its report."""

import json
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import xarray as xr

from anser.report.estimates import (
    EFFECTIVENESS,
    ESTIMATES,
    recorded_estimates,
    scenario_deviations,
    true_effectiveness,
)
from anser.results.separation import nearest_aircraft_distance
from anser.variables import PLAN_VARIABLES

HOLD = 2
"""Value of the variable `phase` in the hold after the arrival."""

_CLIMB_RATE = next(variable for variable in PLAN_VARIABLES if variable.key == "climb_rate")
_LABELS = {
    "links_heard": ("1", "n_H", "Number of aircraft heard"),
    "along_error_m": ("m", "e_a", "Ahead of the planned point"),
    "across_error_m": ("m", "e_x", "Right of the planned path"),
    "height_error_m": ("m", "e_h", "Above the planned path"),
    "height_over_floor_m": ("m", "h_f", "Height over the lowest altitude allowed"),
    "separation_kept": ("1", "d_sep", "Separation kept over required separation"),
    "distance_min_m": ("m", "d_min", "Distance to the nearest other aircraft"),
    "goal_error_m": ("m", "e_g", "Distance of the goal from where it is taken to be"),
    "goal_band_m": ("m", "2σ_g", "Two standard deviations of the goal's place"),
    "own_error_m": ("m", "e_o", "Distance of the aircraft from where it takes itself to be"),
    "own_band_m": ("m", "2σ_o", "Two standard deviations of the own place"),
}
DERIVED_VARIABLES = (
    _CLIMB_RATE.name,
    *_LABELS,
    *(f"{name}_{kind}" for name in ESTIMATES for kind in ("low", "high")),
    *(f"{name}_truth" for name in EFFECTIVENESS),
)
"""Names of the variables that `add_derived_variables` can add."""


def recorded_table(dataset: xr.Dataset, name: str = "scenario") -> dict[str, Any]:
    """Return the table in the JSON attribute `name`, "scenario" or "network"; empty if missing or unreadable."""
    try:
        table = json.loads(dataset.attrs.get(name, "{}"))
    except (TypeError, ValueError):
        return {}
    return table if isinstance(table, dict) else {}


def aircraft_limits(dataset: xr.Dataset) -> list[dict[str, Any]]:
    """Return a table of limits for each aircraft, with the keys of the scenario's table `limits`, and `surfaces_deg`.

    `surfaces_deg` has [least, greatest] deflection, deg, by name of the surface. An older dataset has no such tables:
    the library's F-16 then gets the scenario's limits, and any other aircraft an empty table.
    """
    if "limits" in dataset.attrs:
        return json.loads(dataset.attrs["limits"])
    scenario = recorded_table(dataset)
    limits, aircraft_tables = scenario.get("limits", {}), scenario.get("aircraft", [{}] * dataset.sizes["aircraft"])
    has_unknown_limits = [
        table.get("type", "f16") != "f16" or table.get("airframe") is not None for table in aircraft_tables
    ]
    return [{} if is_unknown else limits for is_unknown in has_unknown_limits]


def limit_value(limits: Mapping[str, Any], key: str | None) -> float | None:
    """Return the limit with a key, in the key's unit; a leading "-" of the key negates the value. None if missing."""
    value = None if key is None else limits.get(key.removeprefix("-"))
    return None if key is None or value is None else -float(value) if key.startswith("-") else float(value)


def has_certified_paths(scenario: Mapping[str, Any]) -> bool:
    """Whether the planner is certified or decentralised, not the published planner with bent polynomial paths."""
    return scenario.get("fleet", {}).get("planner", "published") != "published"


def required_separation(scenario: Mapping[str, Any]) -> tuple[float, float] | None:
    """Return the required horizontal and vertical separation, m; None if no separation is required.

    If the vertical separation is 0, only the horizontal distance counts.
    """
    separation = scenario.get("separation", {})
    if not separation.get("horizontal_m", 0.0) > 0.0:
        return None
    return float(separation["horizontal_m"]), float(separation.get("vertical_m", 0.0))


def add_derived_variables(dataset: xr.Dataset, scenario: Mapping[str, Any]) -> xr.Dataset:
    """Return a flight's dataset with the derived variables of the report; `scenario` may be empty.

    - `climb_rate_m_s`, relative to the air
    - `along_error_m`, `across_error_m`, `height_error_m`: errors from the planned position; NaN in the hold at the end
    - `distance_min_m`, if the flight has two or more aircraft; `separation_kept`, if a separation is required as well
    - `height_over_floor_m`, if the scenario has a lowest altitude
    - `goal_error_m`, `own_error_m`: errors of the estimated positions, and `goal_band_m`, `own_band_m`: two standard
      deviations (root of the sum of squares over the axes), if sensors have errors
    - `links_heard`: number of aircraft heard, if the planner is decentralised
    - `..._low`, `..._high`: each estimate -/+ two standard deviations, and `..._truth`: true effectiveness, if an
      autopilot is adaptive

    Planned positions are set to NaN in the hold as well.
    """
    is_before_hold = dataset["phase"].values != HOLD
    names = ("position_error_m", *(f"reference_{axis}" for axis in _AXES))
    derived = dataset.assign({name: dataset[name].where(is_before_hold) for name in names})
    # relative to the air, as in plans and limits
    airspeed = dataset["airspeed_mean_wind_m_s" if "airspeed_mean_wind_m_s" in dataset else "airspeed_m_s"]
    derived[_CLIMB_RATE.name] = (airspeed * np.sin(np.radians(dataset["path_angle_deg"]))).assign_attrs(
        units=_CLIMB_RATE.unit, symbol=_CLIMB_RATE.symbol, long_name=_CLIMB_RATE.long_name
    )
    for direction, values in zip(("along", "across", "height"), _errors(dataset), strict=True):
        _add_variable(derived, f"{direction}_error_m", np.where(is_before_hold, values, np.nan))
    positions = np.stack([dataset[name].values for name in _AXES], axis=-1)
    if dataset.sizes["aircraft"] > 1:
        _add_variable(derived, "distance_min_m", nearest_aircraft_distance(positions))
    floor = scenario.get("limits", {}).get("altitude_min_m")
    if floor is not None:
        _add_variable(derived, "height_over_floor_m", dataset["altitude_m"].values - float(floor))
    separation_m = required_separation(scenario)
    if dataset.sizes["aircraft"] > 1 and separation_m is not None:
        _add_variable(derived, "separation_kept", nearest_aircraft_distance(positions, separation_m))
    if "goal_sigma_north_m" in dataset:
        for subject, prefix in (("goal", "goal_"), ("own", "")):
            error = _length(dataset[f"{prefix}{axis}"] - dataset[f"{subject}_estimate_{axis}"] for axis in _AXES)
            band = 2.0 * _length(dataset[f"{subject}_sigma_{axis}"] for axis in _AXES)
            _add_variable(derived, f"{subject}_error_m", error)
            _add_variable(derived, f"{subject}_band_m", band)
    if "heard_from" in dataset:
        _add_variable(derived, "links_heard", np.bitwise_count(dataset["heard_from"].values).astype(float))
    _add_bands(derived, scenario)
    return derived


def _add_bands(dataset: xr.Dataset, scenario: Mapping[str, Any]) -> None:
    time, names = dataset["time"].values, [str(name) for name in dataset["aircraft"].values]
    for name in recorded_estimates(dataset):
        estimate, sigma = dataset[f"{name}_estimate"], dataset[f"{name}_sigma"].values
        ends = {"low": estimate.values - 2.0 * sigma, "high": estimate.values + 2.0 * sigma}
        if name in EFFECTIVENESS:
            deviations = [scenario_deviations(scenario, aircraft) for aircraft in names]
            unknown = np.full(time.size, np.nan)
            truths = [unknown if item is None else true_effectiveness(time, name, item) for item in deviations]
            ends["truth"] = np.where(np.isfinite(estimate.values), np.stack(truths, axis=1), np.nan)
        for kind, values in ends.items():
            dataset[f"{name}_{kind}"] = (("time", "aircraft"), values, estimate.attrs)


_AXES = ("north_m", "east_m", "altitude_m")


def _length(parts: Iterable[xr.DataArray]) -> np.ndarray:
    return np.sqrt(sum(part.values**2 for part in parts))


def _errors(dataset: xr.Dataset) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return actual minus planned position, m: along the planned ground track, to the right of the track, and up."""
    north, east, up = (dataset[name].values - dataset[f"reference_{name}"].values for name in _AXES)
    time = dataset["time"].values
    if time.size < 2:
        return np.zeros_like(up), np.zeros_like(up), up
    rate_n, rate_e = (np.gradient(dataset[f"reference_{name}"].values, time, axis=0) for name in ("north_m", "east_m"))
    speed = np.hypot(rate_n, rate_e)
    cosine, sine = (
        np.divide(rate, speed, out=np.full_like(speed, np.nan), where=speed > 0.0) for rate in (rate_n, rate_e)
    )
    return north * cosine + east * sine, east * cosine - north * sine, up


def _add_variable(dataset: xr.Dataset, name: str, values: np.ndarray) -> None:
    unit, symbol, long_name = _LABELS[name]
    dataset[name] = (("time", "aircraft"), values, {"units": unit, "symbol": symbol, "long_name": long_name})


REPLANNING_OUTCOMES = (
    "fitted to where the goal is now",
    "corrected",
    "planned anew",
    "last good plan kept",
    "kept until the goal is known better",
    "bent as far as the limits allow",
)
"""Outcomes of a replanning as text, in the order of the codes of the variable `renewal`."""

LIMITED_COMMANDS = {
    "speed": "speed",
    "thrust": "thrust",
    "lift": "lift",
    "bank": "bank or its rate",
    "rates": "body rates",
    "surfaces": "surfaces",
}
"""Display name of each command that the autopilot can limit; the variable `speed_limited` belongs to "speed"."""

_FITTED, _CORRECTED, _ANEW, _KEPT = range(4)


def find_events(dataset: xr.Dataset) -> list[dict[str, Any]]:
    """Return the events of each aircraft in a recorded flight, as lists by name; times are in s.

    - `phases`: [name of the phase, from, to]
    - `failed`: [non-zero status code, from, to]
    - `renewals`: [time, index into `REPLANNING_OUTCOMES`], for each change of the plan in force
    - `limited`: [index into `LIMITED_COMMANDS`, from, to]
    - `outside`: [from, to] outside the aerodynamic tables
    """
    time = dataset["time"].values
    return [_aircraft_events(dataset.isel(aircraft=k), time) for k in range(dataset.sizes["aircraft"])]


def _aircraft_events(aircraft: xr.Dataset, time: np.ndarray) -> dict[str, Any]:
    names = str(aircraft["phase"].attrs.get("flag_meanings", "approach frozen hold")).split()
    phases = [
        [names[code] if code < len(names) else str(code), *span]
        for code, *span in _runs_of_equal_values(aircraft["phase"], time)
    ]
    limited = [
        [k, *span]
        for k, command in enumerate(LIMITED_COMMANDS)
        for is_limited, *span in _runs_of_equal_values(aircraft[f"{command}_limited"], time)
        if is_limited
    ]
    return {
        "phases": phases,
        "renewals": _renewals(aircraft, time),
        "limited": limited,
        "outside": [
            span for is_outside, *span in _runs_of_equal_values(aircraft["outside_tables"], time) if is_outside
        ],
        "failed": [[code, *span] for code, *span in _runs_of_equal_values(aircraft["status"], time) if code],
    }


def _renewals(aircraft: xr.Dataset, time: np.ndarray) -> list[list[float]]:
    outcome, arrival = aircraft["renewal"].values.astype(int), aircraft["arrival_time_s"].values
    shape = np.stack([aircraft["planned_length_m"].values, np.nan_to_num(aircraft["lateral_bend_m"].values)])
    new_outcome = np.diff(outcome) != 0
    new_shape = np.any(np.diff(shape, axis=1) != 0, axis=0)
    new_time = np.diff(arrival) != 0
    indices = np.flatnonzero((new_outcome | new_shape | new_time) & np.isfinite(arrival[1:])) + 1
    # the published planner records no outcome: a new arrival time means that it planned the fleet anew
    codes = [_ANEW if outcome[k] == _FITTED and new_time[k - 1] else int(outcome[k]) for k in indices]
    return [[round(float(time[k]), 4), code] for k, code in zip(indices, codes, strict=True)]


def _runs_of_equal_values(values: xr.DataArray, time: np.ndarray) -> list[list[Any]]:
    """Return the spans of constant `values` as [value, from, to], times in s; a span ends where the next one starts."""
    codes = values.values.astype(int)
    starts = np.concatenate([[0], np.flatnonzero(np.diff(codes)) + 1])
    stops = [*starts[1:], codes.size - 1]
    return [
        [int(codes[start]), round(float(time[start]), 4), round(float(time[stop]), 4)]
        for start, stop in zip(starts, stops, strict=True)
    ]


def evenly_spaced(indices: np.ndarray, count: int) -> np.ndarray:
    """Return at most `count` of the `indices`, evenly spaced."""
    if indices.size <= count:
        return indices
    return indices[np.linspace(0, indices.size - 1, count).round().astype(int)] if count else indices[:0]
