"""Stability margins of the autopilot: at one trim point with frequency responses, and over a grid of trim points."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from anser.aircraft.airframe import AbstractAirframe
from anser.analysis.envelope import GRID_DIMENSIONS, survey_limits, trim_map
from anser.analysis.loop_margins import (
    FREQUENCY_MIN,
    NEUTRAL_POLE_TOLERANCE,
    SATURABLE_COMMANDS,
    LoopAnalysis,
    LoopResponse,
    analyse_rows,
    breakpoints,
    largest_pole,
    loop_state_fields,
)
from anser.analysis.surveys import Survey, SurveyResult, SurveyVariables, limit_attributes, select_rows
from anser.analysis.trim_points import (
    ConditionError,
    Inversion,
    flight_point,
    map_points,
    require_inversion,
    require_step,
    survey_gains,
)
from anser.control.gains import AutopilotGains
from anser.control.limits import FlightLimits
from anser.missions.batches import Progress
from anser.results.documents import finite_or_none, plain_attributes
from anser.results.variable_labels import flag_attributes, scatter_rows, unit_attributes
from anser.steady.trim import TrimPoint, trim_target
from anser.steady.trim_diagnosis import nearest_trims
from anser.units import RAD_DEG

GAIN_MIN_DB, PHASE_MIN_DEG = 6.0, 40.0
"""Required gain margin (dB) and phase margin (deg); a breakpoint with less of either is reported as `short`."""
CLOSED_LOOP_STATES = ("no_trim", "held_back", "unstable", "stable")
"""States of the closed loop at a trim point; only stable points have margins.

no_trim: no steady flight exists; held_back: a command of the autopilot is at a limit, which opens the loop."""


def _response_variables(response: LoopResponse) -> dict[str, Any]:
    """Return dataset variables over (breakpoint, frequency): gain (dB) and unwrapped phase (deg) of the open loops."""
    loops = np.asarray(response.open)[0].T
    dimensions = ("breakpoint", "frequency")
    phase = np.unwrap(np.angle(loops), axis=1) * RAD_DEG
    # first phase between -360 and 0 deg: the same branch at all breakpoints
    phase -= 360 * np.ceil(phase[:, :1] / 360)
    with np.errstate(divide="ignore"):
        gain = 20 * np.log10(np.abs(loops))
    return {
        "loop_gain_db": (dimensions, gain, unit_attributes("dB", "Gain of the loop")),
        "loop_phase_deg": (dimensions, phase, unit_attributes("degree", "Phase of the loop")),
    }


def margin_table(dataset: xr.Dataset, *, with_reserve: bool = True) -> list[dict[str, Any]]:
    """Return statistics over the stable points of a dataset of `survey_margins`, a dictionary per breakpoint.

    Each dictionary has minimum, 5th percentile and median of the gain (dB), phase (deg), delay (ms) and disk margins,
    and `short`, the number of points with a margin below `GAIN_MIN_DB` or `PHASE_MIN_DEG`. If `with_reserve` is True,
    only points with a reserve (`TrimMap.with_reserve`) count. A statistic is None if infinite or without points.
    """
    is_selected = dataset["closed_loop"].values == CLOSED_LOOP_STATES.index("stable")
    if with_reserve:
        is_selected = is_selected & dataset["with_reserve"].values
    table = []
    for k, name in enumerate(dataset["breakpoint"].values.tolist()):
        entry: dict[str, Any] = {"breakpoint": name, "points": int(is_selected.sum())}
        for margin in ("gain_margin_db", "phase_margin_deg", "delay_margin_ms", "disk_margin"):
            values = np.sort(dataset[margin].values[is_selected][:, k])
            # by rank: no mean of a finite and an infinite margin
            for statistic, quantile in (("min", 0.0), ("p5", 0.05), ("median", 0.5)):
                value = values[math.floor(quantile * (values.size - 1))] if values.size else math.nan
                entry[f"{margin}_{statistic}"] = finite_or_none(value)
        entry["short"] = int(dataset["short"].values[is_selected][:, k].sum())
        table.append(entry)
    return table


def _margin_variables(analysis: LoopAnalysis, step_s: float, trimmable: np.ndarray) -> SurveyVariables:
    """Return margins, poles and flags as dataset variables over all points; a point without values has NaN or 0.

    `trimmable` marks the points that `analysis` contains; `step_s` is the sampling period.
    """
    pole = largest_pole(np.asarray(analysis.A)) if trimmable.any() else np.zeros(0, dtype=complex)
    rate = np.log(pole) / step_s
    stable = np.abs(pole) <= 1 + NEUTRAL_POLE_TOLERANCE
    limited = np.asarray(analysis.limited)
    state = np.where(limited.any(axis=1), 1, np.where(stable, 3, 2)).astype(np.int32)
    margins = {name: np.asarray(values) for name, values in vars(analysis.margins).items()}
    with np.errstate(divide="ignore"):
        up, up_searched = (20 * np.log10(margins[name]) for name in ("gain_up", "gain_up_searched"))
        down, down_searched = (-20 * np.log10(margins[name]) for name in ("gain_down", "gain_down_searched"))
    # beyond the searched change of gain, another boundary could lie below the searched frequencies
    gain = np.min([up, up_searched, down, down_searched], axis=0)
    phase = margins["phase"] * RAD_DEG
    numbers = {
        "gain_up_db": (up, "dB", "Factor by which the gain can rise"),
        "gain_down_db": (down, "dB", "Factor by which the gain can fall"),
        "gain_up_searched_db": (up_searched, "dB", "Rise of the gain up to which a boundary was searched"),
        "gain_down_searched_db": (down_searched, "dB", "Fall of the gain down to which a boundary was searched"),
        "gain_margin_db": (gain, "dB", "Gain margin, the lesser of both ways, within the searched changes"),
        "phase_margin_deg": (phase, "degree", "Phase margin, either way"),
        "delay_margin_ms": (margins["delay"] * 1000.0, "ms", "Delay margin"),
        "disk_margin": (margins["disk"], "1", "Radius of the symmetric disk margin"),
        "gain_up_at_rad_s": (margins["gain_up_at"], "rad s-1", "Where the gain can rise least"),
        "gain_down_at_rad_s": (margins["gain_down_at"], "rad s-1", "Where the gain can fall least"),
        "crossover_rad_s": (margins["crossover"], "rad s-1", "Gain crossover that has the phase margin"),
    }
    short = (gain < GAIN_MIN_DB) | (phase < PHASE_MIN_DEG)
    stable_points = trimmable.copy()
    stable_points[trimmable] = state == 3

    variables: SurveyVariables = {}

    def add(name: str, values: Any, attributes: dict[str, Any], *dimensions: str) -> None:
        variables[name] = (scatter_rows(values, trimmable), attributes, dimensions)

    def add_stable(name: str, values: np.ndarray, attributes: dict[str, Any], *dimensions: str) -> None:
        variables[name] = (scatter_rows(values[state == 3], stable_points), attributes, dimensions)

    add("closed_loop", state, flag_attributes("What the closed loop is", CLOSED_LOOP_STATES))
    add("limited", limited, unit_attributes("1", "Whether the command stands at a limit"), "command")
    add("pole_real_1_s", rate.real, unit_attributes("s-1", "Real part of the rightmost pole"))
    add("pole_imag_1_s", rate.imag, unit_attributes("s-1", "Imaginary part of the rightmost pole"))
    add_stable("short", short, unit_attributes("1", "Whether a margin falls short"), "breakpoint")
    for name, (values, unit, long_name) in numbers.items():
        add_stable(name, values, unit_attributes(unit, long_name), "breakpoint")
    long_name = "Radius of the symmetric disk margin of all actuators at once"
    add_stable("actuators_disk_margin", np.asarray(analysis.actuators_disk), unit_attributes("1", long_name))
    return variables


def _names(airframe: AbstractAirframe) -> dict[str, Any]:
    command = unit_attributes("", "Command of the autopilot that can stand at a limit")
    return {
        "breakpoint": ("breakpoint", np.array(breakpoints(airframe)), unit_attributes("", "Where the loop is broken")),
        "command": ("command", np.array(SATURABLE_COMMANDS), command),
    }


def _attributes(step_s: float) -> dict[str, float]:
    return {
        "step_s": step_s,
        "frequency_min_rad_s": FREQUENCY_MIN,
        "frequency_max_rad_s": math.pi / step_s,
        "gain_min_db": GAIN_MIN_DB,
        "phase_min_deg": PHASE_MIN_DEG,
    }


_FORMAT_VERSION = 1
_BATCH = 32
"""Number of trim points of one compiled call; the responses of a larger batch do not fit into the caches."""


@dataclasses.dataclass(frozen=True)
class MarginSurvey(SurveyResult):
    """Result of `survey_margins`: dataset over (condition, altitude, mach), margins also over (breakpoint)."""

    def counts(self) -> dict[str, int]:
        """Return the number of grid points in each state of the closed loop (`CLOSED_LOOP_STATES`)."""
        state_codes = self.dataset["closed_loop"].values
        return {state: int((state_codes == k).sum()) for k, state in enumerate(CLOSED_LOOP_STATES)}

    def shortfalls(self) -> list[str]:
        """Return a line for each unstable grid point, and for each breakpoint with a margin below the minimum."""
        lines = []
        is_unstable = self.dataset["closed_loop"].values == CLOSED_LOOP_STATES.index("unstable")
        for c, a, m in np.argwhere(is_unstable | self.dataset["short"].values.any(axis=-1)):
            point = self.dataset.isel(condition=c, altitude=a, mach=m)
            label = f"{point.condition_meaning.item()}, {point.altitude.item():.0f} m, Mach {point.mach.item():.3f}"
            if is_unstable[c, a, m]:
                lines.append(f"{label}: unstable, pole {_pole(point)}")
                continue
            for k in np.flatnonzero(point["short"]):
                loop = point.isel(breakpoint=k)
                gain, phase = loop["gain_margin_db"].item(), loop["phase_margin_deg"].item()
                lines.append(f"{label}, {loop['breakpoint'].item()}: {gain:.1f} dB, {phase:.1f} deg")
        return lines

    def document(self) -> dict[str, Any]:
        """Return counts, statistics of the margins and shortfalls as plain data for JSON."""
        return {
            "format_version": _FORMAT_VERSION,
            "survey": plain_attributes(self.dataset.attrs),
            "points": self.counts(),
            "with_reserve": int(self.dataset["with_reserve"].sum()),
            "compile_s": round(self.compile_s, 3),
            "run_s": round(self.run_s, 3),
            "breakpoints_with_reserve": margin_table(self.dataset),
            "breakpoints_all": margin_table(self.dataset, with_reserve=False),
            "shortfalls": self.shortfalls(),
        }


def margins_at(
    aircraft: str | AbstractAirframe = "f16",
    variant: str = "textbook",
    *,
    speed_m_s: float | None = None,
    altitude_m: float | None = None,
    speed_cas_m_s: float | None = None,
    speed_eas_m_s: float | None = None,
    mach: float | None = None,
    inversion: Inversion = "model",
    step_s: float = 0.01,
    gains: AutopilotGains | None = None,
    model: AbstractAirframe | None = None,
) -> xr.Dataset:
    """Compute the stability margins of the autopilot in level flight, in the standard atmosphere and still air.

    One loop at a time is broken; the remaining loops stay closed.

    Raises ConditionError, with the reason, if the steady flight does not exist, a command of the autopilot is at a
    limit, or the closed loop is unstable; ValueError if the aircraft is unknown or a number is not valid.

    Parameters
    ----------
    aircraft, variant
        Name of an airframe, path of an aircraft file, or an airframe; variant of the F-16.
    speed_m_s, altitude_m
        True airspeed and geometric altitude.
    speed_cas_m_s, speed_eas_m_s, mach
        Calibrated or equivalent airspeed, or Mach number, instead of the true airspeed.
    inversion
        "model": dynamic inversion of the onboard model; "incremental": inversion from measured accelerations.
    step_s
        Sampling period of the autopilot.
    gains
        Gains of the autopilot; None: the published gains of the F-16, or gains derived from the aircraft.
    model
        Onboard model that differs from the aircraft, only with incremental inversion; None: the aircraft itself.

    Returns
    -------
    xr.Dataset
        Gain (dB), phase (deg), delay (ms) and disk margin over (breakpoint), infinite if no change makes the loop
        unstable; gain (dB) and phase (deg) of the loop transfer function over (breakpoint, frequency).
    """
    if model is not None and inversion == "model":
        raise ValueError('inversion: arrived "model" with an onboard model; expected "incremental"')
    require_step(step_s)
    require_inversion(inversion)
    survey = Survey(aircraft, variant)
    airframe, environment = survey.airframe, survey.environment
    speed_m_s, altitude_m = flight_point(environment, altitude_m, speed_m_s, speed_cas_m_s, speed_eas_m_s, mach)
    target = trim_target(speed_m_s, altitude_m)
    points = map_points((airframe, environment), (jax.tree.map(lambda leaf: leaf[None], target), None))
    if not bool(points.trimmable[0]):
        raise ConditionError(nearest_trims(airframe, environment, target).message())
    # a batch of the size in `survey_margins`: one compiled program for the two functions
    limits = survey_limits(airframe, speed_m_s)
    analysis, response = _analyse_rows(
        survey, "breaking the loops", limits, points.trim, step_s, inversion, gains, model
    )
    variables = _margin_variables(analysis, step_s, np.array([True]))
    data = {name: (dimensions, values[0], labels) for name, (values, labels, dimensions) in variables.items()}
    omega = ("frequency", response.omega[0], unit_attributes("rad s-1", "Frequency"))
    attributes = {"speed_m_s": speed_m_s, "altitude_m": altitude_m, "inversion": inversion, **_attributes(step_s)}
    coordinates = _names(airframe) | {"frequency": omega}
    dataset = survey.result(SurveyResult, data | _response_variables(response), coordinates, attributes).dataset
    state = CLOSED_LOOP_STATES[dataset["closed_loop"].item()]
    if state == "held_back":
        limits_reached = ", ".join(np.array(SATURABLE_COMMANDS)[dataset["limited"].values.astype(bool)])
        raise ConditionError(
            f"The autopilot does not hold this flight: its command stands at a limit ({limits_reached}), "
            "where the loop is open."
        )
    if state == "unstable":
        raise ConditionError(f"The closed loop is unstable, pole {_pole(dataset)}: there are no margins.")
    return dataset


def survey_margins(
    aircraft: str | AbstractAirframe = "f16",
    variant: str = "textbook",
    *,
    inversion: Inversion = "model",
    coarse: bool = False,
    altitudes_m: Sequence[float] | None = None,
    machs: Sequence[float] | None = None,
    step_s: float = 0.01,
    gains: AutopilotGains | None = None,
    progress: Progress | None = None,
) -> MarginSurvey:
    """Compute the stability margins at every trimmable point of a grid of steady flights, altitudes and Mach numbers.

    Grid, autopilot limits and parameters are described in `survey_envelope`. `gains` are the gains of the autopilot;
    None: the published gains of the F-16, or gains derived from the aircraft. Raises ValueError if the aircraft is
    unknown, an axis does not increase, or no point can be trimmed.
    """
    require_step(step_s)
    require_inversion(inversion)
    survey = Survey(aircraft, variant, progress)
    trims = trim_map(survey, altitudes_m, machs, coarse=coarse)
    points, trimmable = trims.points, np.asarray(trims.points.trimmable)
    limits, rows = survey_limits(survey.airframe, trims.airspeeds), select_rows(points.trim, trimmable)
    description = f"breaking the loops at {len(rows.alpha)} points"
    analysis, _ = _analyse_rows(survey, description, limits, rows, step_s, inversion, gains)
    alpha, load_factor = (np.where(trimmable, values, np.nan) for values in (points.trim.alpha, points.load_factor))
    variables = _margin_variables(analysis, step_s, trimmable)
    data = {
        **{
            name: ((*GRID_DIMENSIONS, *dimensions), trims.gridded(values), labels)
            for name, (values, labels, dimensions) in variables.items()
        },
        "with_reserve": trims.with_reserve(),
        "alpha_deg": trims.variable(alpha * RAD_DEG, "degree", "Angle of attack"),
        "load_factor": trims.variable(load_factor, "1", "Normal load factor"),
    }
    attributes = {"inversion": inversion, **limit_attributes(limits), **_attributes(step_s)}
    coordinates = _names(survey.airframe) | trims.coordinates("Steady flight")
    return survey.result(MarginSurvey, data, coordinates, attributes)


def margin_document(dataset: xr.Dataset) -> dict[str, Any]:
    """Return condition and margins of the dataset of `margins_at` as plain data for JSON; infinite figures are None."""
    table = []
    for name in dataset["breakpoint"].values.tolist():
        loop = dataset.sel(breakpoint=name)
        keys = [key for key, variable in dataset.data_vars.items() if variable.dims == ("breakpoint",)]
        figures = {key: loop[key].item() if key == "short" else finite_or_none(loop[key].item()) for key in keys}
        table.append({"breakpoint": name, **figures})
    return {
        "format_version": _FORMAT_VERSION,
        "condition": plain_attributes(dataset.attrs),
        "actuators_disk_margin": dataset["actuators_disk_margin"].item(),
        "breakpoints": table,
    }


def _analyse_rows(
    survey: Survey,
    description: str,
    limits: FlightLimits,
    trims: TrimPoint,
    step_s: float,
    inversion: Inversion,
    gains: AutopilotGains | None,
    model: AbstractAirframe | None = None,
) -> tuple[LoopAnalysis, LoopResponse]:
    airframe, environment = survey.airframe, survey.environment
    common_gains, row_gains = survey_gains(airframe, environment, trims, step_s, inversion, gains)
    fields = loop_state_fields(common_gains if row_gains is None else row_gains, airframe)
    fixed = (airframe, environment, common_gains, limits, jnp.asarray(step_s), model)
    return survey.evaluate(description, analyse_rows, fixed, (trims, row_gains), fields, batch_size=_BATCH)


def _pole(point: xr.Dataset) -> str:
    real, imaginary = point["pole_real_1_s"].item(), point["pole_imag_1_s"].item()
    return f"{real:+.3g} 1/s" if not imaginary else f"{real:+.3g} +- {imaginary:.3g}i 1/s"
