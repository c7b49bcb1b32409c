"""Estimates of adaptive autopilots in a recorded flight: names, and true values as far as the dataset has them."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

EFFECTIVENESS = tuple(f"{axis}_effectiveness" for axis in ("roll", "pitch", "yaw"))
"""Names of the estimates of control effectiveness about each axis, without the endings `_estimate` and `_sigma`."""
STATIC_DERIVATIVES = ("cz_alpha", "cm_alpha", "cl_beta", "cn_beta")
"""Names of the estimates of the static derivatives, without the endings `_estimate` and `_sigma`."""
ESTIMATES = (*EFFECTIVENESS, *STATIC_DERIVATIVES)
# Greatest surface of each axis, and the factors of a deviation that multiply its moment (F-16, file, DAVE-ML).
_SURFACES = {
    "roll_effectiveness": ("aileron", ("Clda", "Cl_aileron", "Cl")),
    "pitch_effectiveness": ("elevator", ("Cm0", "Cm_elevator", "Cm")),
    "yaw_effectiveness": ("rudder", ("Cndr", "Cn_rudder", "Cn")),
}
# Deviations that change the estimates by data of the aircraft, with their neutral values: the estimator divides by the
# moments of inertia of the model, and the forces of the surfaces have levers about the centre of gravity.
_UNKNOWN = {
    "roll_effectiveness": {"second_moment_y": 1.0, "second_moment_z": 1.0},
    "pitch_effectiveness": {"second_moment_x": 1.0, "second_moment_z": 1.0, "cg_shift": 0.0},
    "yaw_effectiveness": {"second_moment_x": 1.0, "second_moment_y": 1.0, "cg_shift": 0.0},
}

Deviations = Sequence[tuple[float, Mapping[str, Any]]]
"""Deviations from the nominal aircraft as (start of the effect, s; deviation); their factors are multiplied.

A deviation is a table with the keys of a scenario's `deviation`."""


def has_estimates(dataset: xr.Dataset) -> bool:
    """Whether an aircraft of the flight has an adaptive autopilot."""
    return "effectiveness_uncertainty" in dataset


def recorded_estimates(dataset: xr.Dataset) -> list[str]:
    """Return the names of `ESTIMATES` that have a finite estimate in the flight.

    Control effectiveness is the ratio to the model's value; an axis that the model cannot control has no estimate.
    """
    if not has_estimates(dataset):
        return []
    return [name for name in ESTIMATES if np.isfinite(dataset[f"{name}_estimate"].values).any()]


def recorded_changes(dataset: xr.Dataset) -> Deviations:
    """Return the changes of the aircraft during a flight of `anser.simulate`; empty if the aircraft did not change."""
    changes = json.loads(dataset.attrs.get("change", "[]"))
    return [(float(change["time_s"]), change) for change in ([changes] if isinstance(changes, dict) else changes)]


def scenario_deviations(scenario: Mapping[str, Any], name: str) -> Deviations | None:
    """Return the deviations of the aircraft `name` at time 0 and at events; None for an unknown name."""
    tables = [table for table in scenario.get("aircraft", []) if table.get("name") == name]
    if not tables:
        return None
    events = [event for event in scenario.get("event", []) if event.get("aircraft") == name and event.get("deviation")]
    return [(0.0, tables[0].get("deviation") or {}), *((event["time_s"], event["deviation"]) for event in events)]


def true_effectiveness(time: np.ndarray, name: str, deviations: Deviations) -> np.ndarray:
    """Return the ratio of true to modelled control effectiveness at each time, for a `name` of `EFFECTIVENESS`.

    The ratio is NaN after a change of the axis' moment of inertia and, in pitch and yaw, after a shift of the centre of
    gravity, because the record lacks the aircraft data for these effects.
    """
    surface, factors = _SURFACES[name]
    truth = np.ones(time.size)
    for time_s, deviation in deviations:
        coefficients = deviation.get("coefficients") or {}
        factor = (deviation.get("surface_effectiveness") or {}).get(surface, 1.0)
        factor *= np.prod([coefficients.get(key, 1.0) for key in factors])
        if any(deviation.get(key, neutral) != neutral for key, neutral in _UNKNOWN[name].items()):
            factor = np.nan
        truth = np.where(time >= time_s, factor * truth, truth)
    return truth
