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
"""Deviations from the nominal aircraft, each with the time from which it acts, s; factors of several multiply."""


def has_estimates(dataset: xr.Dataset) -> bool:
    """Whether any aircraft of the flight has an adaptive autopilot, whose estimates are recorded."""
    return "effectiveness_uncertainty" in dataset


def recorded_estimates(dataset: xr.Dataset) -> list[str]:
    """Return those names of `ESTIMATES` with a finite estimate in the flight; empty without an adaptive autopilot.

    The control effectiveness about an axis is relative to that of the model; NaN if the model has no control there.
    """
    if not has_estimates(dataset):
        return []
    return [name for name in ESTIMATES if np.isfinite(dataset[f"{name}_estimate"].values).any()]


def recorded_changes(dataset: xr.Dataset) -> Deviations:
    """Return the changes of the aircraft in a flight of one aircraft as (time in s, deviation); empty without changes.

    A deviation is a table of changes relative to the nominal aircraft, with the keys of a scenario's `deviation`.
    """
    changes = json.loads(dataset.attrs.get("change", "[]"))
    return [(float(change["time_s"]), change) for change in ([changes] if isinstance(changes, dict) else changes)]


def scenario_deviations(scenario: Mapping[str, Any], name: str) -> Deviations | None:
    """Return the deviations of the aircraft `name` from the nominal aircraft, as (time in s, deviation).

    The first is that at the start (time 0), the further ones are those of events. None if the scenario lacks the name.
    """
    tables = [table for table in scenario.get("aircraft", []) if table.get("name") == name]
    if not tables:
        return None
    events = [event for event in scenario.get("event", []) if event.get("aircraft") == name and event.get("deviation")]
    return [(0.0, tables[0].get("deviation") or {}), *((event["time_s"], event["deviation"]) for event in events)]


def true_effectiveness(time: np.ndarray, name: str, deviations: Deviations) -> np.ndarray:
    """Return the ratio of true to modelled control effectiveness at each time (s), for a name of `EFFECTIVENESS`.

    Effectiveness means the surface's moment, as the estimator infers it with the model's moments of inertia.
    `deviations` are those of the aircraft. The ratio is NaN after a change of the axis' moment of inertia and, in pitch
    and yaw, after a shift of the centre of gravity: the effect depends on data of the aircraft that the record does not
    contain.
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
