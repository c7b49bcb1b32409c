"""Outcomes of surveyed flights: the limit or range that a flight met, and labelled variables common to the surveys."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from anser.results.variable_labels import flag_attributes, unit_attributes
from anser.simulation.survey_flight import AUTOPILOT_LIMITS, BETA_BOUND, TABLE_AXES, SurveySummary
from anser.units import RAD_DEG

OUTCOMES = ("not_flown", "reached", "limited", "failed")
"""Outcomes of a flight.

limited: in controlled flight the command was missed at a limit of thrust, alpha, load factor or bank, or the flight
left the range of the data in altitude or Mach number, or the starting flight was beyond the autopilot's limits.
failed: alpha or beta left the range of the data or sideslip exceeded its bound (for any reason, a start beyond the
limits included), surfaces or body rates were insufficient, or no limit explains the missed command."""

REASONS = ("none", *AUTOPILOT_LIMITS, *(f"tables_{axis}" for axis in TABLE_AXES), "start_beyond_limits", "unexplained")
"""Reasons of an outcome: the limit or the range of the data that was met; "none": not flown, or reached."""

_LONG = 0.1
"""Fraction of the flight spent at a limit from which this limit explains an error at the end."""
_BEFORE_SLIP = 0.1
"""Time spent at a limit from which this limit explains a later sideslip, s: twice the lag of the actuators."""

_INNER = ("body_rates", "surfaces", "surface_rates")
_EXPLAINS = {
    "V": ("thrust_max", "thrust_idle"),
    "gamma": ("alpha", "load_factor", "unloading", "bank"),
    "chi": ("bank", "alpha", "load_factor", "unloading"),
}
"""For each channel the limits that can keep it from its command; limits of the inner loops affect every channel."""


@dataclass(frozen=True)
class FlightOutcomes:
    """Outcome and reason of each flight, as indices into `OUTCOMES` and `REASONS`."""

    outcome: np.ndarray
    reason: np.ndarray


def classify_flights(
    summaries: SurveySummary, tolerance: np.ndarray, duration: float, start_beyond: np.ndarray | bool = False
) -> FlightOutcomes:
    """Determine the outcome and the reason of each flight of a batch.

    A command is reached if every channel ends within its tolerance, stepped or not, sideslip stays within `BETA_BOUND`
    and the aircraft stays inside its data. Otherwise the reason is the first applicable of:

    1. a start beyond the autopilot's limits, to be left under any command;
    2. alpha or beta beyond the data, whichever came first;
    3. for excessive sideslip, the inner-loop limit with the longest time before;
    4. altitude or Mach number beyond the data;
    5. for a missed channel, the relevant limit with the longest time, if active during most of the last tenth of the
       flight (the interval of the final error) or for a tenth of the flight.

    Parameters
    ----------
    summaries
        Summaries of the flights; leaves of shape (flights, ...).
    tolerance
        Tolerance of (V, gamma, chi), shape (flights, 3), m/s and rad.
    duration
        Duration of each flight, s.
    start_beyond
        True if the starting flight is beyond the autopilot's limits, shape (flights,).
    """
    is_missed = ~(np.asarray(summaries.final_error_max) <= tolerance)  # true for NaN
    has_slipped = ~(np.asarray(summaries.beta_max) <= BETA_BOUND)
    is_finite = np.asarray(summaries.finite)
    time_of_leaving = np.asarray(summaries.left_time)
    has_left = np.isfinite(time_of_leaving).any(axis=1)
    is_reached = ~is_missed.any(axis=1) & ~has_slipped & ~has_left & is_finite

    total_time, late_time = np.asarray(summaries.limited_time), np.asarray(summaries.limited_late)
    before_slip = np.asarray(summaries.limited_before_slip)
    is_inner = np.isin(AUTOPILOT_LIMITS, _INNER)
    limits_channel = np.array([np.isin(AUTOPILOT_LIMITS, (*outer, *_INNER)) for outer in _EXPLAINS.values()])
    is_at_limit = (is_missed @ limits_channel > 0) & (
        (late_time > 0.5 * _LONG * duration) | (total_time > _LONG * duration)
    )
    time_if_missed = np.where(is_at_limit, total_time, 0.0)
    time_if_slipped = np.where(is_inner & (before_slip >= _BEFORE_SLIP), before_slip, 0.0)
    time_at_limit = np.where(has_slipped[:, None], time_if_slipped, time_if_missed)

    unexplained = REASONS.index("unexplained")
    reason = np.where(time_at_limit.any(axis=1) & is_finite, 1 + time_at_limit.argmax(axis=1), unexplained)
    is_flow_axis = np.array([axis in ("alpha", "beta") for axis in TABLE_AXES])
    has_departed = np.asarray(np.isfinite(time_of_leaving[:, is_flow_axis]).any(axis=1))
    table_index = np.where(has_departed[:, None] & ~is_flow_axis, np.inf, time_of_leaving).argmin(axis=1)
    reason = np.where(has_departed | (has_left & ~has_slipped), 1 + len(AUTOPILOT_LIMITS) + table_index, reason)
    reason = np.where(start_beyond & is_finite, REASONS.index("start_beyond_limits"), reason)
    reason = np.where(is_reached, 0, reason)
    failure_reasons = [REASONS.index(name) for name in (*_INNER, "tables_alpha", "tables_beta", "unexplained")]
    is_failed = ~is_reached & (np.isin(reason, failure_reasons) | has_slipped | has_departed | ~is_finite)
    outcome = np.select(
        [is_reached, is_failed], [OUTCOMES.index("reached"), OUTCOMES.index("failed")], OUTCOMES.index("limited")
    )
    return FlightOutcomes(outcome.astype(np.int32), reason.astype(np.int32))


_CHANNELS = (
    ("airspeed", "m_s", "m s-1", 1.0),
    ("path_angle", "deg", "degree", RAD_DEG),
    ("course", "deg", "degree", RAD_DEG),
)
# Pattern after the channel's name, field of `SurveySummary`, unit (None: the channel's), description.
_CHANNEL_FIGURES = (
    ("final_error_{}", "final_error", None, "Command minus {}, mean of the last tenth"),
    ("final_error_max_{}", "final_error_max", None, "Largest error of the {} in the last tenth"),
    ("settling_s", "settling_time", "s", "Until the {} stays within its tolerance; inf: not before the end"),
    ("overshoot", "overshoot", "1", "Overshoot of the {}, part of the step"),
    ("coupling_{}", "coupling", None, "Largest error of the {} where it is not stepped"),
)

FlightVariables = dict[str, tuple[np.ndarray, dict[str, Any], tuple[str, ...]]]
"""Variables of flights by name: values (first axis: flights), attributes, and dimensions after the flights."""


def flight_coordinates(surfaces: Sequence[str]) -> dict[str, Any]:
    """Return the dataset coordinates of the dimensions that `flight_variables` adds to the flights."""
    return {
        "surface": ("surface", np.array(surfaces)),
        "axis": ("axis", np.array(("roll", "pitch", "yaw"))),
        "limit": ("limit", np.array(AUTOPILOT_LIMITS)),
        "table": ("table", np.array(TABLE_AXES)),
    }


def flight_variables(flights: SurveySummary, verdicts: FlightOutcomes) -> FlightVariables:
    """Return the dataset variables of flights.

    Errors of the channels, extremes, times at limits, outcome and reason.
    """
    variables: FlightVariables = {}

    def add(name: str, values: Any, unit: str, description: str, *dimensions: str) -> None:
        variables[name] = (np.asarray(values), unit_attributes(unit, description), dimensions)

    for k, (name, suffix, unit, factor) in enumerate(_CHANNELS):
        for name_pattern, field, figure_unit, description in _CHANNEL_FIGURES:
            values = np.asarray(getattr(flights, field))[:, k] * (factor if figure_unit is None else 1.0)
            long_name = description.format(name.replace("_", " "))
            add(
                f"{name}_{name_pattern.format(suffix)}", values, unit if figure_unit is None else figure_unit, long_name
            )
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
    variables["outcome"] = (verdicts.outcome, flag_attributes("What became of the flight", OUTCOMES), ())
    variables["reason"] = (verdicts.reason, flag_attributes("Limit that stood in the way", REASONS), ())
    return variables
