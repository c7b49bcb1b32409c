"""Stability margins of the autopilot at one trim point, with the loop responses, and over the trim map.

Datasets and tables of the margins.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from anser.aircraft.airframe import AbstractAirframe
from anser.analysis.loop_margins import (
    FREQUENCY_MIN,
    NEUTRAL_POLE_TOLERANCE,
    SATURABLE_COMMANDS,
    LoopAnalysis,
    LoopResponse,
    StateFields,
    analyse_loops,
    breakpoints,
    largest_pole,
    loop_state_fields,
)
from anser.analysis.surveys import Survey, SurveyResult, limit_attributes, select_rows
from anser.analysis.trim_maps import GRID_DIMENSIONS, TrimMap, survey_limits, trim_map
from anser.analysis.trim_points import ConditionError, Inversion, map_points, resolve_airframe, survey_gains
from anser.compiling.options import compiled
from anser.control.gains import AutopilotGains
from anser.control.limits import FlightLimits
from anser.environment.environment import Environment, standard_environment
from anser.missions.batches import Progress
from anser.results.documents import finite_or_none, plain_attributes
from anser.results.variable_labels import flag_attributes, scatter_rows, unit_attributes
from anser.simulation.response import LoopCase
from anser.steady.trim import TrimPoint, trim_target
from anser.steady.trim_diagnosis import nearest_trims
from anser.units import RAD_DEG

GAIN_MIN_DB, PHASE_MIN_DEG = 6.0, 40.0
"""Required gain margin (dB) and phase margin (deg); a breakpoint below either is reported as short."""
CLOSED_LOOP_STATES = ("no_trim", "held_back", "unstable", "stable")
"""State of the closed loop at a point: no steady flight exists; a command of the autopilot is at a limit, where the
loop is open; the closed loop is unstable; the closed loop is stable. Only stable points have margins."""

_Variable = tuple[str, tuple[str, ...], np.ndarray, dict[str, Any]]
"""Variable of a dataset: name, dimensions after that of the points, values, attributes."""


def _point_variables(analysis: LoopAnalysis, response: LoopResponse, step_s: float) -> dict[str, Any]:
    """Return the dataset variables of a single trim point, with the response of each loop.

    The arrays of `analysis` and `response` have one row.
    """
    data: dict[str, Any] = {
        name: (dimensions, values[0], labels)
        for name, dimensions, values, labels in _variables(analysis, step_s, np.array([True]))
    }
    loops = np.asarray(response.open)[0].T
    response_dimensions = ("breakpoint", "frequency")
    phase = np.unwrap(np.angle(loops), axis=1) * RAD_DEG
    # first phase between -360 and 0 deg: the same branch at all breakpoints
    phase -= 360 * np.ceil(phase[:, :1] / 360)
    with np.errstate(divide="ignore"):
        gain = 20 * np.log10(np.abs(loops))
    data["loop_gain_db"] = (response_dimensions, gain, unit_attributes("dB", "Gain of the loop"))
    data["loop_phase_deg"] = (response_dimensions, phase, unit_attributes("degree", "Phase of the loop"))
    return data


def _map_variables(trims: TrimMap, analysis: LoopAnalysis, step_s: float) -> dict[str, Any]:
    """Return the dataset variables over a trim map; `analysis` has a row per trimmable point, in the map's order."""
    points, trimmable = trims.points, np.asarray(trims.points.trimmable)
    data: dict[str, Any] = {
        name: ((*GRID_DIMENSIONS, *dimensions), trims.gridded(values), labels)
        for name, dimensions, values, labels in _variables(analysis, step_s, trimmable)
    }
    alpha, load_factor = (
        np.where(trimmable, point_values, np.nan) for point_values in (points.trim.alpha, points.load_factor)
    )
    data["with_reserve"] = trims.with_reserve()
    data["alpha_deg"] = trims.variable(alpha * RAD_DEG, "degree", "Angle of attack")
    data["load_factor"] = trims.variable(load_factor, "1", "Normal load factor")
    return data


def margin_table(dataset: xr.Dataset, *, with_reserve: bool = True) -> list[dict[str, Any]]:
    """Summarize the margins over a trim map: a row per breakpoint.

    A row has the least value, the 5th percentile and the median of each margin over the stable points, and the number
    of points below `GAIN_MIN_DB` or `PHASE_MIN_DEG`. Infinite figures are None.

    Parameters
    ----------
    dataset
        Dataset of `survey_margins`.
    with_reserve
        Select only points with a tenth of power and surface travel in reserve.
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


def _variables(analysis: LoopAnalysis, step_s: float, trimmable: np.ndarray) -> list[_Variable]:
    """Return the dataset variables of the trimmable points, as arrays over all points of the grid (NaN elsewhere)."""
    pole = largest_pole(np.asarray(analysis.A)) if trimmable.any() else np.zeros(0, dtype=complex)
    rate = np.log(pole) / step_s
    stable = np.abs(pole) <= 1 + NEUTRAL_POLE_TOLERANCE
    limited = np.asarray(analysis.limited)
    state = np.where(limited.any(axis=1), 1, np.where(stable, 3, 2)).astype(np.int32)
    margins = {name: np.asarray(values) for name, values in vars(analysis.margins).items()}
    with np.errstate(divide="ignore"):
        up, down = 20 * np.log10(margins["gain_up"]), -20 * np.log10(margins["gain_down"])
        up_searched, down_searched = (
            20 * np.log10(margins["gain_up_searched"]),
            -20 * np.log10(margins["gain_down_searched"]),
        )
    gain, phase = np.minimum(up, down), margins["phase"] * RAD_DEG
    numbers = {
        "gain_up_db": (up, "dB", "Factor by which the gain can rise"),
        "gain_down_db": (down, "dB", "Factor by which the gain can fall"),
        "gain_up_searched_db": (up_searched, "dB", "Rise of the gain up to which a boundary was searched"),
        "gain_down_searched_db": (down_searched, "dB", "Fall of the gain down to which a boundary was searched"),
        "gain_margin_db": (gain, "dB", "Gain margin, the lesser of both ways"),
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

    def add(name: str, values: Any, attributes: dict[str, Any], *dimensions: str) -> None:
        variables.append((name, dimensions, scatter_rows(values, trimmable), attributes))

    def add_stable(name: str, values: np.ndarray, attributes: dict[str, Any], *dimensions: str) -> None:
        variables.append((name, dimensions, scatter_rows(values[state == 3], stable_points), attributes))

    variables: list[_Variable] = []
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


def _names(breakpoints: Sequence[str]) -> dict[str, Any]:
    return {
        "breakpoint": ("breakpoint", np.array(breakpoints), {"long_name": "Where the loop is broken"}),
        "command": (
            "command",
            np.array(SATURABLE_COMMANDS),
            unit_attributes("", "Command of the autopilot that can stand at a limit"),
        ),
    }


def _attributes(attributes: Mapping[str, str | int | float], step_s: float) -> dict[str, str | int | float]:
    return {
        **attributes,
        "step_s": step_s,
        "frequency_min_rad_s": FREQUENCY_MIN,
        "frequency_max_rad_s": math.pi / step_s,
        "gain_min_db": GAIN_MIN_DB,
        "phase_min_deg": PHASE_MIN_DEG,
    }


_FORMAT_VERSION = 1
_BATCH = 32
"""Points of one compiled call; the responses of a larger batch do not fit into the processor's caches."""


@dataclasses.dataclass(frozen=True)
class MarginSurvey(SurveyResult):
    """Result of a margin survey.

    Its dataset has variables over (condition, altitude, mach) and margins over (condition, altitude, mach, breakpoint).
    """

    def counts(self) -> dict[str, int]:
        """Return the number of points in each state of the closed loop (`CLOSED_LOOP_STATES`)."""
        state_codes = self.dataset["closed_loop"].values
        return {state: int((state_codes == k).sum()) for k, state in enumerate(CLOSED_LOOP_STATES)}

    def shortfalls(self) -> list[str]:
        """List the unstable points and the breakpoints with a margin below the minimum, one line each."""
        names = self.dataset["breakpoint"].values.tolist()
        lines = []
        states = self.dataset["closed_loop"].values
        for c, a, m in np.argwhere(
            (states == CLOSED_LOOP_STATES.index("unstable")) | self.dataset["short"].values.any(axis=-1)
        ):
            point = self.dataset.isel(condition=c, altitude=a, mach=m)
            label = f"{point.condition_meaning.item()}, {point.altitude.item():.0f} m, Mach {point.mach.item():.3f}"
            if states[c, a, m] == CLOSED_LOOP_STATES.index("unstable"):
                lines.append(f"{label}: unstable, pole {_pole(point)}")
                continue
            for name in names:
                loop = point.sel(breakpoint=name)
                if loop["short"].item():
                    lines.append(
                        f"{label}, {name}: {loop['gain_margin_db'].item():.1f} dB, "
                        f"{loop['phase_margin_deg'].item():.1f} deg"
                    )
        return lines

    def document(self) -> dict[str, Any]:
        """Return counts and margin tables as plain data for JSON."""
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
    speed_m_s: float,
    altitude_m: float,
    inversion: Inversion = "model",
    step_s: float = 0.01,
    gains: AutopilotGains | None = None,
) -> xr.Dataset:
    """Compute the margins of the autopilot in level flight, in the standard atmosphere and still air.

    One loop at a time is broken; the other loops stay closed.

    Parameters
    ----------
    aircraft, variant
        Aircraft: see `resolve_airframe`.
    speed_m_s, altitude_m
        True airspeed and geometric altitude.
    inversion
        Inversion of the autopilot: of the onboard model, or incremental.
    step_s
        Sampling period of the autopilot.
    gains
        Gains of the autopilot; None: the published gains of the F-16, or gains derived from the aircraft.

    Returns
    -------
    xr.Dataset
        Margins over (breakpoint): infinite without a boundary of stability, nan unless the closed loop is stable. Gain
        and phase of the loop transfer function over (breakpoint, frequency).

    Raises
    ------
    ConditionError
        No margin exists: the steady flight does not exist, a command of the autopilot is at a limit, or the closed loop
        is unstable. The message gives the reason.
    ValueError
        No airframe has this name.
    """
    survey = Survey()
    airframe, attributes = resolve_airframe(aircraft, variant)
    environment, limits = standard_environment(), survey_limits(airframe, speed_m_s)
    target = trim_target(speed_m_s, altitude_m)
    points = map_points(airframe, environment, jax.tree.map(lambda leaf: leaf[None], target))
    if not bool(points.trimmable[0]):
        raise ConditionError(nearest_trims(airframe, environment, target).message())
    # a batch of the survey's size: one compiled program for both
    analysis, response = _analyse_rows(
        survey, "breaking the loops", airframe, environment, limits, points.trim, step_s, inversion, gains
    )
    attributes |= {"speed_m_s": speed_m_s, "altitude_m": altitude_m, "inversion": inversion}
    omega = ("frequency", response.omega[0], unit_attributes("rad s-1", "Frequency"))
    dataset = survey.result(
        SurveyResult,
        _point_variables(analysis, response, step_s),
        _names(breakpoints(airframe)) | {"frequency": omega},
        _attributes(attributes, step_s),
    ).dataset
    state = CLOSED_LOOP_STATES[dataset["closed_loop"].item()]
    if state == "held_back":
        limits_reached = ", ".join(
            name for name, is_limited in zip(SATURABLE_COMMANDS, dataset["limited"].values, strict=True) if is_limited
        )
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
    """Compute the margins at every trimmable point of the envelope's trim map, in the standard atmosphere.

    Steady flights and limits are those of the envelope survey: `CONDITIONS` and `survey_limits`.

    Parameters
    ----------
    aircraft, variant, inversion, step_s, gains
        See `margins_at`.
    coarse, altitudes_m, machs, progress
        See `survey_envelope`.

    Raises
    ------
    ValueError
        No airframe has this name, an axis is not of increasing numbers, or the grid has no trimmable point.
    """
    survey = Survey(progress)
    airframe, attributes = resolve_airframe(aircraft, variant)
    environment = standard_environment()
    trims = trim_map(survey, airframe, environment, altitudes_m, machs, coarse=coarse)
    limits = survey_limits(airframe, trims.airspeeds)
    rows = select_rows(trims.points.trim, np.asarray(trims.points.trimmable))
    description = f"breaking the loops at {len(rows.alpha)} points"
    analysis, _ = _analyse_rows(survey, description, airframe, environment, limits, rows, step_s, inversion, gains)
    attributes |= {"inversion": inversion, **limit_attributes(limits)}
    coordinates = _names(breakpoints(airframe)) | trims.coordinates("Steady flight")
    data = _map_variables(trims, analysis, step_s)
    return survey.result(MarginSurvey, data, coordinates, _attributes(attributes, step_s))


def margin_document(dataset: xr.Dataset) -> dict[str, Any]:
    """Return the dataset of `margins_at` as plain data for JSON; infinite figures are None."""
    table = []
    for name in dataset["breakpoint"].values.tolist():
        loop = dataset.sel(breakpoint=name)
        figures = {
            key: loop[key].item() for key, variable in dataset.data_vars.items() if variable.dims == ("breakpoint",)
        }
        table.append(
            {
                "breakpoint": name,
                **{key: value if key == "short" else finite_or_none(value) for key, value in figures.items()},
            }
        )
    return {
        "format_version": _FORMAT_VERSION,
        "condition": plain_attributes(dataset.attrs),
        "actuators_disk_margin": dataset["actuators_disk_margin"].item(),
        "breakpoints": table,
    }


def _analyse_rows(
    survey: Survey,
    description: str,
    airframe: AbstractAirframe,
    environment: Environment,
    limits: FlightLimits,
    trims: TrimPoint,
    step_s: float,
    inversion: Inversion,
    gains: AutopilotGains | None,
) -> tuple[LoopAnalysis, LoopResponse]:
    common_gains, row_gains = survey_gains(airframe, environment, trims, step_s, inversion, gains)
    fields = loop_state_fields(common_gains if row_gains is None else row_gains, airframe)
    fixed = (airframe, environment, common_gains, limits, jnp.asarray(step_s))
    return survey.evaluate(description, _analyse, fixed, (trims, row_gains), fields, batch_size=_BATCH)


@compiled
def _analyse(
    fixed: tuple[AbstractAirframe, Environment, AutopilotGains, FlightLimits, jax.Array],
    rows: tuple[TrimPoint, AutopilotGains | None],
    fields: StateFields,
) -> tuple[LoopAnalysis, LoopResponse]:
    airframe, environment, common_gains, limits, step = fixed

    def analyse_point(trim: TrimPoint, row_gains: AutopilotGains | None) -> tuple[LoopAnalysis, LoopResponse]:
        gains = common_gains if row_gains is None else row_gains
        return analyse_loops(LoopCase(airframe, environment, gains, limits, trim, step), fields)

    return jax.vmap(analyse_point)(*rows)


def _pole(point: xr.Dataset) -> str:
    real, imaginary = point["pole_real_1_s"].item(), point["pole_imag_1_s"].item()
    return f"{real:+.3g} 1/s" if not imaginary else f"{real:+.3g} +- {imaginary:.3g}i 1/s"
