"""Outcomes of surveyed flights.

What ended or limited each flight, and the labelled variables that every survey shares.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from anser.results.variable_labels import flag_attributes, unit_attributes
from anser.simulation.survey_flight import AUTOPILOT_LIMITS, BETA_BOUND, TABLE_AXES, SurveySummary
from anser.units import RAD_DEG

OUTCOMES = ("not_flown", "reached", "limited", "failed")
"""Limited: in controlled flight the command was missed at a limit of thrust, alpha, load factor or bank, or the data
ended in altitude or Mach number, or the steady flight that is left lies beyond the autopilot's limits. Failed: alpha or
beta left the data, sideslip passed its bound (both whatever the reason, such a start included), the surfaces or the
body rates did not suffice, or no limit explains what was missed."""

REASONS = ("none", *AUTOPILOT_LIMITS, *(f"tables_{axis}" for axis in TABLE_AXES), "start_beyond_limits", "unexplained")
"""None: not flown, or reached."""

_LONG = 0.1
"""Part of the flight from which on the time at a limit explains an error at its end."""
_BEFORE_SLIP = 0.1
"""Time at a limit that explains a sideslip after it, s: twice the lag of the actuators."""

_INNER = ("body_rates", "surfaces", "surface_rates")
_EXPLAINS = {
    "V": ("thrust_max", "thrust_idle"),
    "gamma": ("alpha", "load_factor", "unloading", "bank"),
    "chi": ("bank", "alpha", "load_factor", "unloading"),
}
"""Limits that can keep a channel from its command; those of the inner loops stand in the way of all."""


@dataclass(frozen=True)
class FlightOutcomes:
    """One number for each flight: index into `OUTCOMES`, and into `REASONS`."""

    outcome: np.ndarray
    reason: np.ndarray


def classify_flights(
    summaries: SurveySummary, tolerance: np.ndarray, duration: float, start_beyond: np.ndarray | bool = False
) -> FlightOutcomes:
    """Judge a batch of flights.

    A command is reached if every channel ends within its tolerance, commanded or not, sideslip stayed within
    `BETA_BOUND` and the aircraft inside its data. The reason of all else is the first of these that applies: a start
    beyond the autopilot's limits, which it must leave whatever is commanded; alpha or beta beyond the data, whichever
    was first; for sideslip, the limit of the inner loops at which the autopilot stood longest before; altitude or Mach
    number beyond the data; for a channel that was missed, the limit bearing on it at which it stood longest, of those
    that stood during most of the last tenth, over which the error is taken, or for a tenth of the flight.

    Parameters
    ----------
    summaries
        Of the flights; leaves of shape (flights, ...).
    tolerance
        Of (V, gamma, chi), shape (flights, 3), m/s and rad.
    duration
        Of each flight, s.
    start_beyond
        Whether the steady flight that is left lies beyond the autopilot's limits, shape (flights,).
    """
    missed = ~(np.asarray(summaries.final_error_max) <= tolerance)  # true where there is no number
    slipped = ~(np.asarray(summaries.beta_max) <= BETA_BOUND)
    finite = np.asarray(summaries.finite)
    left_time = np.asarray(summaries.left_time)
    left = np.isfinite(left_time).any(axis=1)
    reached = ~missed.any(axis=1) & ~slipped & ~left & finite

    total, late = np.asarray(summaries.limited_time), np.asarray(summaries.limited_late)
    before_slip = np.asarray(summaries.limited_before_slip)
    inner = np.isin(AUTOPILOT_LIMITS, _INNER)
    bearing = np.array([np.isin(AUTOPILOT_LIMITS, (*outer, *_INNER)) for outer in _EXPLAINS.values()])
    stood = (missed @ bearing > 0) & ((late > 0.5 * _LONG * duration) | (total > _LONG * duration))
    of_missed = np.where(stood, total, 0.0)
    of_slip = np.where(inner & (before_slip >= _BEFORE_SLIP), before_slip, 0.0)
    standing = np.where(slipped[:, None], of_slip, of_missed)

    unexplained = REASONS.index("unexplained")
    reason = np.where(standing.any(axis=1) & finite, 1 + standing.argmax(axis=1), unexplained)
    flow = np.array([axis in ("alpha", "beta") for axis in TABLE_AXES])
    departed = np.asarray(np.isfinite(left_time[:, flow]).any(axis=1))
    of_tables = np.where(departed[:, None] & ~flow, np.inf, left_time).argmin(axis=1)
    reason = np.where(departed | (left & ~slipped), 1 + len(AUTOPILOT_LIMITS) + of_tables, reason)
    reason = np.where(start_beyond & finite, REASONS.index("start_beyond_limits"), reason)
    reason = np.where(reached, 0, reason)
    uncontrolled = [REASONS.index(name) for name in (*_INNER, "tables_alpha", "tables_beta", "unexplained")]
    failed = ~reached & (np.isin(reason, uncontrolled) | slipped | departed | ~finite)
    outcome = np.select(
        [reached, failed], [OUTCOMES.index("reached"), OUTCOMES.index("failed")], OUTCOMES.index("limited")
    )
    return FlightOutcomes(outcome.astype(np.int32), reason.astype(np.int32))


_CHANNELS = (
    ("airspeed", "m_s", "m s-1", 1.0),
    ("path_angle", "deg", "degree", RAD_DEG),
    ("course", "deg", "degree", RAD_DEG),
)
# Name after the channel's, field of `SurveySummary`, unit where it is not the channel's, words.
_OF_CHANNELS = (
    ("final_error_{}", "final_error", None, "Command minus {}, mean of the last tenth"),
    ("final_error_max_{}", "final_error_max", None, "Largest error of the {} in the last tenth"),
    ("settling_s", "settling_time", "s", "Until the {} stays within its tolerance; inf: not before the end"),
    ("overshoot", "overshoot", "1", "Overshoot of the {}, part of the step"),
    ("coupling_{}", "coupling", None, "Largest error of the {} where it is not stepped"),
)

FlightVariables = dict[str, tuple[np.ndarray, dict[str, Any], tuple[str, ...]]]
"""By name: values with the flights as their first axis, attributes, dimensions beyond the flights."""


def flight_coordinates(surfaces: Sequence[str]) -> dict[str, Any]:
    """Coordinates of the dimensions that `flight_variables` has beyond the flights; `surfaces` are the airframe's."""
    return {
        "surface": ("surface", np.array(surfaces)),
        "axis": ("axis", np.array(("roll", "pitch", "yaw"))),
        "limit": ("limit", np.array(AUTOPILOT_LIMITS)),
        "table": ("table", np.array(TABLE_AXES)),
    }


def flight_variables(flights: SurveySummary, verdicts: FlightOutcomes) -> FlightVariables:
    """Every variable of flights: errors of the channels, extremes, times at limits, what became of them and why."""
    found: FlightVariables = {}

    def add(name: str, values: Any, unit: str, words: str, *over: str) -> None:
        found[name] = (np.asarray(values), unit_attributes(unit, words), over)

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
    found["outcome"] = (verdicts.outcome, flag_attributes("What became of the flight", OUTCOMES), ())
    found["reason"] = (verdicts.reason, flag_attributes("Limit that stood in the way", REASONS), ())
    return found
