"""Variables of a dataset that hold the summaries of flights."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from anser.results.envelope_reasons import OUTCOMES, REASONS, Verdicts
from anser.results.variable_labels import attributes_of, flags_of
from anser.simulation import AUTOPILOT_LIMITS, TABLE_AXES, FlightSummary
from anser.units import RAD_DEG

_CHANNELS = (
    ("airspeed", "m_s", "m s-1", 1.0),
    ("path_angle", "deg", "degree", RAD_DEG),
    ("course", "deg", "degree", RAD_DEG),
)
# Name after the channel's, field of `FlightSummary`, unit where it is not the channel's, words.
_OF_CHANNELS = (
    ("final_error_{}", "final_error", None, "Command minus {}, mean of the last tenth"),
    ("final_error_max_{}", "final_error_max", None, "Largest error of the {} in the last tenth"),
    ("settling_s", "settling_time", "s", "Until the {} stays within its tolerance; inf: not before the end"),
    ("overshoot", "overshoot", "1", "Overshoot of the {}, part of the step"),
    ("coupling_{}", "coupling", None, "Largest error of the {} where it is not stepped"),
)

FlightVariables = dict[str, tuple[np.ndarray, dict[str, Any], tuple[str, ...]]]
"""By name: values with the flights as their first axis, attributes, dimensions beyond the flights."""


def flight_axes(surfaces: Sequence[str]) -> dict[str, Any]:
    """Coordinates of the dimensions that `flight_variables` has beyond the flights; `surfaces` are the airframe's."""
    return {
        "surface": ("surface", np.array(surfaces)),
        "axis": ("axis", np.array(("roll", "pitch", "yaw"))),
        "limit": ("limit", np.array(AUTOPILOT_LIMITS)),
        "table": ("table", np.array(TABLE_AXES)),
    }


def flight_variables(flights: FlightSummary, verdicts: Verdicts) -> FlightVariables:
    """Every variable of flights: errors of the channels, extremes, times at limits, what became of them and why."""
    found: FlightVariables = {}

    def add(name: str, values: Any, unit: str, words: str, *over: str) -> None:
        found[name] = (np.asarray(values), attributes_of(unit, words), over)

    for k, (name, suffix, unit, factor) in enumerate(_CHANNELS):
        for what, field, own_unit, words in _OF_CHANNELS:
            values = np.asarray(getattr(flights, field))[:, k] * (factor if own_unit is None else 1.0)
            said = words.format(name.replace("_", " "))
            add(f"{name}_{what.format(suffix)}", values, unit if own_unit is None else own_unit, said)
    add("beta_max_deg", np.asarray(flights.beta_max) * RAD_DEG, "degree", "Largest sideslip, either way")
    add("alpha_min_deg", np.asarray(flights.alpha_min) * RAD_DEG, "degree", "Least angle of attack")
    add("alpha_max_deg", np.asarray(flights.alpha_max) * RAD_DEG, "degree", "Greatest angle of attack")
    add("load_factor_min", flights.load_factor_min, "1", "Least normal load factor")
    add("load_factor_max", flights.load_factor_max, "1", "Greatest normal load factor")
    add("surface_share", flights.surface_share, "1", "Largest deflection, part of the way to the stop", "surface")
    add("surface_rate_share", flights.surface_rate_share, "1", "Largest rate of the surface over its limit", "surface")
    add("body_rate_share", flights.body_rate_share, "1", "Largest body rate over the autopilot's limit", "axis")
    add("limited_s", flights.limited_time, "s", "Time at each limit of the autopilot", "limit")
    add("limited_late_s", flights.limited_late, "s", "Time at each limit in the last tenth of the flight", "limit")
    before_slip = "Time at each limit until sideslip first passes its bound"
    add("limited_before_slip_s", flights.limited_before_slip, "s", before_slip, "limit")
    add("left_s", flights.left_time, "s", "First time outside the data; inf: never", "table")
    add("finite", np.asarray(flights.finite).astype(np.int32), "1", "Whether the state stayed finite; 0 if not flown")
    found["outcome"] = (verdicts.outcome, flags_of("What became of the flight", OUTCOMES), ())
    found["reason"] = (verdicts.reason, flags_of("Limit that stood in the way", REASONS), ())
    return found
