"""Surveys of an aircraft: trims, margins or flights at many conditions, computed in batches by compiled programs.

A row contains the inputs of one condition, such as a trim point or a flight.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.dispersions import F16Dispersion
from anser.analysis.trim_points import dispersed_airframe, require_seconds, require_step, resolve_airframe
from anser.compiling.options import compiled, enable_compilation_cache
from anser.compiling.program import Program
from anser.control.gains import AutopilotGains
from anser.control.limits import FlightLimits
from anser.environment.environment import Environment, standard_environment
from anser.missions.batches import BATCH, Progress, no_progress
from anser.results.documents import version_attributes
from anser.results.variable_labels import flag_attributes, unit_attributes
from anser.sensing.adaptation import adaptive_estimator
from anser.sensing.estimators import TrackingEstimator
from anser.sensing.ideal_sensors import DelayedSensors
from anser.simulation.survey_flight import (
    AUTOPILOT_LIMITS,
    BETA_BOUND,
    TABLE_AXES,
    SurveySummary,
    survey_flight,
)
from anser.steady.trim import TRIM_OBSTACLES, TrimMapPoint, TrimPoint, TrimTarget
from anser.units import DEG_RAD, RAD_DEG

_R = TypeVar("_R")


@dataclass(frozen=True)
class SurveyResult:
    """Result of a survey: dataset, and the wall times spent on compiling and on running, s."""

    dataset: xr.Dataset
    compile_s: float
    run_s: float


_Result = TypeVar("_Result", bound=SurveyResult)


SurveyVariables = dict[str, tuple[np.ndarray, dict[str, Any], tuple[str, ...]]]
"""Variables of a survey by name: values (first axis: flights or points), attributes, names of the further axes."""


class FlightRows(eqx.Module):
    """Inputs of surveyed flights, a row per flight: steady flight at the start, and step of the path command."""

    # steady flight at the start, and its trim target
    trim: TrimPoint
    target: TrimTarget
    # step and accepted error of (V, gamma, chi), m/s and rad
    size: Float[Array, "flight 3"]
    tolerance: Float[Array, "flight 3"]
    gains: AutopilotGains | None = None  # gains of each flight; None: the survey's gains
    dispersion: F16Dispersion | None = None  # dispersion of the F-16, unknown to its autopilot; None: nominal aircraft
    sensors: DelayedSensors | None = None  # None: ideal sensors
    #: Whether an adaptive estimator corrects the onboard model in flight.
    is_adaptive: bool = eqx.field(static=True, default=False)


class Survey:
    """Survey of one aircraft in the standard atmosphere and still air, by compiled programs for many trims or flights.

    Parameters
    ----------
    aircraft, variant
        Name of an airframe, path of an aircraft file, or an airframe; variant of the F-16.
    progress
        Called with a description of the current work and the completed part, 0 to 1; None: no reports.
    """

    def __init__(
        self, aircraft: str | AbstractAirframe = "f16", variant: str = "textbook", progress: Progress | None = None
    ) -> None:
        enable_compilation_cache()
        # the attributes describe the airframe in datasets
        self.airframe, self.attributes = resolve_airframe(aircraft, variant)
        self.environment = standard_environment()
        self.report = progress or no_progress
        self.compile_s = self.run_s = 0.0  # wall time spent so far

    def call(self, program: Program[..., _R], *arguments: Any) -> _R:
        """Compile a program, run it and return the result; add the wall times to `compile_s` and `run_s`."""
        start_time = time.perf_counter()
        compiled_call = program.ready(*arguments)
        compiled_time = time.perf_counter()
        result = jax.block_until_ready(compiled_call())
        self.compile_s += compiled_time - start_time
        self.run_s += time.perf_counter() - compiled_time
        return result

    def evaluate(
        self,
        description: str,  # current work, for progress reports
        # function of `fixed`, a batch of rows and `options`; returns a tree of arrays with one row per input row
        program: Program[..., _R],
        fixed: Any,  # arguments common to all rows
        rows: Any,  # tree of arrays with a leading axis over the rows, at least one
        *options: Any,  # further arguments common to all rows
        batch_size: int = BATCH,
        span: tuple[float, float] = (0.0, 1.0),  # completed part of the survey before and after this evaluation
        select: Callable[[_R], Any] = lambda result: result,  # part of the program's result to store
    ) -> Any:
        """Evaluate a program for every row, in batches of equal size; the last batch is padded with repeated rows.

        Returns a tree of NumPy arrays with one row per input row. Raises ValueError if there is no row.
        """
        rows = jax.tree.map(np.asarray, rows)
        total = len(jax.tree.leaves(rows)[0])
        if not total:
            raise ValueError(f"{description}: there is no steady flight to evaluate")
        batches = []
        for start in range(0, total, batch_size):
            part = start / total
            self.report(description, span[0] * (1.0 - part) + span[1] * part)
            batch = np.arange(start, start + batch_size) % total
            result = self.call(program, fixed, select_rows(rows, batch), *options)
            batches.append(jax.tree.map(np.asarray, select(result)))
        self.report(description, span[1])
        return jax.tree.map(lambda *leaves: np.concatenate(leaves)[:total], *batches)

    def fly(
        self,
        description: str,
        flights: FlightRows,
        gains: AutopilotGains,
        limits: FlightLimits,
        step_s: float,
        count: int,
        span: tuple[float, float] = (0.0, 1.0),
    ) -> "SurveyVariables":
        """Make `flights` of `count` sampling periods `step_s`; return metrics, outcome, reason as dataset variables.

        Gains in `flights`, if any, replace `gains`. `description` and `span` are for progress reports: see `evaluate`.
        """
        fixed = (self.airframe, self.environment, gains, limits)
        summaries = self.evaluate(description, _fly, fixed, flights, jnp.asarray(step_s), count, span=span)
        start_beyond, tolerances = _is_beyond_limits(flights, limits), np.asarray(flights.tolerance)
        return _flight_variables(summaries, classify_flights(summaries, tolerances, count * step_s, start_beyond))

    def result(
        self,
        result_class: type[_Result],
        data: Mapping[str, Any],
        coordinates: Mapping[str, Any],
        attributes: Mapping[str, str | int | float],
    ) -> _Result:
        """Return an object of `result_class`, with the survey's dataset and the wall times of compiling and running.

        Aircraft and software versions are added to the `attributes` of the dataset.
        """
        dataset = xr.Dataset(data, coordinates, {**self.attributes, **attributes, **version_attributes()})
        return result_class(dataset, self.compile_s, self.run_s)


@compiled
def _fly(
    fixed: tuple[AbstractAirframe, Environment, AutopilotGains, FlightLimits],
    flights: FlightRows,
    step: jax.Array,
    count: int,
) -> SurveySummary:
    airframe, environment, common_gains, limits = fixed

    def fly_row(flight: FlightRows) -> SurveySummary:
        flown = dispersed_airframe(airframe, flight.dispersion)
        estimator = None if flight.dispersion is None else TrackingEstimator(model=airframe)
        if flight.is_adaptive:
            estimator = adaptive_estimator(TrackingEstimator(model=airframe), airframe)
        gains = common_gains if flight.gains is None else flight.gains
        command = (flight.trim, flight.target, flight.size, flight.tolerance, step, count)
        return survey_flight(flown, environment, gains, limits, *command, flight.sensors, estimator)

    return jax.vmap(fly_row)(flights)


def sample_count(duration_s: float, step_s: float) -> int:
    """Return the number of sampling periods `step_s` in `duration_s` (s).

    Raises ValueError if a time is not valid, or the number is below 100.
    """
    require_seconds("duration_s", duration_s)
    require_step(step_s)
    count = round(duration_s / step_s)
    if count < 100:
        raise ValueError(f"duration_s: arrived {duration_s:g} with step_s {step_s:g}; expected 100 samples or more")
    return count


def select_rows(rows: Any, index: np.ndarray | int) -> Any:
    """Return rows of a tree of arrays by index, by indices or by a boolean mask."""
    return jax.tree.map(lambda leaf: leaf[index], rows)


def limit_attributes(limits: FlightLimits) -> dict[str, float]:
    """Return the autopilot's limits as dataset attributes with units in the names (m/s, deg)."""
    return {
        **{f"limit_{name}_m_s": float(getattr(limits, name)) for name in ("speed_min", "speed_max")},
        **{
            f"limit_{name}_deg": round(float(getattr(limits, name)) / DEG_RAD, 9)
            for name in ("bank_max", "alpha_min", "alpha_max")
        },
        **{f"limit_{name}": float(getattr(limits, name)) for name in ("load_factor_min", "load_factor_max")},
    }


def flight_attributes(count: int, step_s: float, limits: FlightLimits) -> dict[str, float]:
    """Return duration (s), sampling period (s) and autopilot limits of surveyed flights as dataset attributes."""
    return {"duration_s": count * step_s, "step_s": step_s, **limit_attributes(limits)}


def _is_beyond_limits(flights: FlightRows, limits: FlightLimits) -> np.ndarray:
    """Return True for each flight that starts beyond the autopilot's limits of alpha, bank or airspeed."""
    alpha, bank = np.asarray(flights.trim.alpha), np.abs(np.asarray(flights.trim.mu))
    airspeed = np.asarray(flights.target.speed)
    return np.asarray(
        (alpha < limits.alpha_min)
        | (alpha > limits.alpha_max)
        | (bank > limits.bank_max)
        | (airspeed < limits.speed_min)
        | (airspeed > limits.speed_max)
    )


def trim_stop(points: TrimMapPoint, long_name: str) -> tuple[np.ndarray, dict[str, Any]]:
    """Return codes of the first obstacle to each steady flight of a trim map, and attributes with `long_name`.

    The codes, shape (points,), are 0 for a flyable point, and 1 + the index in `TRIM_OBSTACLES` for an obstacle.
    """
    codes = np.where(np.asarray(points.trimmable), 0, 1 + np.asarray(points.obstacles).argmax(axis=1))
    return codes.astype(np.int32), flag_attributes(long_name, ("none", *TRIM_OBSTACLES))


OUTCOMES = ("not_flown", "reached", "limited", "failed")
"""Outcomes of a flight.

- limited: the command was missed at a limit of thrust, alpha, load factor or bank; or the flight left the data in
  altitude or Mach number; or the flight started beyond the autopilot's limits.
- failed: alpha or beta left the data or sideslip exceeded `BETA_BOUND`, even if the flight started beyond the limits;
  or surfaces or body rates were insufficient; or no limit explains the missed command."""

REASONS = ("none", *AUTOPILOT_LIMITS, *(f"tables_{axis}" for axis in TABLE_AXES), "start_beyond_limits", "unexplained")
"""Reasons of an outcome: limit of the autopilot, or axis on which the data ended; "none": not flown, or reached."""

_LONG = 0.1
"""Least fraction of the flight at a limit for which the limit explains an error at the end."""
_BEFORE_SLIP = 0.1
"""Least time at a limit for which the limit explains a later sideslip, s: twice the lag of the actuators."""

_INNER = ("body_rates", "surfaces", "surface_rates")
_EXPLAINS = {
    "V": ("thrust_max", "thrust_idle"),
    "gamma": ("alpha", "load_factor", "unloading", "bank"),
    "chi": ("bank", "alpha", "load_factor", "unloading"),
}
"""For each channel, the limits that can keep the channel from its command; inner-loop limits affect every channel."""


@dataclass(frozen=True)
class FlightOutcomes:
    """Outcome and reason of each flight, as indices into `OUTCOMES` and `REASONS`."""

    outcome: np.ndarray
    reason: np.ndarray


def classify_flights(
    summaries: SurveySummary,
    tolerance: np.ndarray,  # tolerance of (V, gamma, chi), shape (flights, 3), m/s and rad
    duration: float,  # s
    start_beyond: np.ndarray | bool = False,  # whether the starting flight is beyond the autopilot's limits
) -> FlightOutcomes:
    """Determine the outcome and the reason of each flight of a batch.

    A command is reached if airspeed, path angle and course, stepped or not, end within their tolerances, sideslip stays
    within `BETA_BOUND` and the aircraft stays inside its data. If not, the first case that applies gives the reason:

    1. The flight starts beyond the autopilot's limits: "start_beyond_limits".
    2. Alpha or beta leaves the data: the first of the two.
    3. Sideslip exceeds its bound: the inner-loop limit that was active longest before, for 0.1 s or more;
       "unexplained" if none was.
    4. Altitude or Mach number leaves the data: the first of the two.
    5. A channel misses its command: the limit that was active longest, of the limits that affect the channel and were
       active for over a tenth of the flight or over half of its last tenth; "unexplained" if none was.
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


def flight_coordinates(surfaces: Sequence[str]) -> dict[str, Any]:
    """Return the dataset coordinates `surface`, `axis` (roll, ...), `limit` of the autopilot, `table` (alpha, ...)."""
    return {
        "surface": ("surface", np.array(surfaces)),
        "axis": ("axis", np.array(("roll", "pitch", "yaw"))),
        "limit": ("limit", np.array(AUTOPILOT_LIMITS)),
        "table": ("table", np.array(TABLE_AXES)),
    }


def _flight_variables(flights: SurveySummary, verdicts: FlightOutcomes) -> SurveyVariables:
    variables: SurveyVariables = {}

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
