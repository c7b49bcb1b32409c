"""Stability margins of the autopilot at one trim point, with the loop responses, and over the trim map.

Their datasets and tables.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.f16 import AbstractF16
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
from anser.analysis.trim_maps import GRID_DIMENSIONS, TrimMap, limit_attributes, survey_limits, trim_map
from anser.analysis.trim_points import ConditionError, Inversion, default_gains, gains_for, map_points, resolve_airframe
from anser.compiling.options import compiled, enable_compilation_cache
from anser.control.gains import AutopilotGains
from anser.control.limits import FlightLimits
from anser.environment.environment import Environment, standard_environment
from anser.missions.batches import Progress, Stopwatch, SurveyResult, no_progress, run_in_batches
from anser.results.documents import finite_or_none, plain_attributes, version_attributes
from anser.results.variable_labels import flag_attributes, scatter_rows, unit_attributes
from anser.simulation.response import LoopCase
from anser.steady.trim import TrimPoint, trim_target
from anser.steady.trim_diagnosis import nearest_trims
from anser.units import RAD_DEG

GAIN_MIN_DB, PHASE_MIN_DEG = 6.0, 40.0
"""What falls short of either is marked as short."""
CLOSED_LOOP_STATES = ("no_trim", "held_back", "unstable", "stable")
"""What a point is: it cannot be flown steadily; a command of the autopilot stands at a limit there, so that the loop is
open; the closed loop is unstable; it is stable. Only the last has margins."""

_Variable = tuple[str, tuple[str, ...], np.ndarray, dict[str, Any]]
"""Name, dimensions beyond those of the points, values over points and those dimensions, labels."""


def margin_dataset(
    found: LoopAnalysis,
    response: LoopResponse,
    names: Sequence[str],
    step_s: float,
    attributes: Mapping[str, str | int | float],
) -> xr.Dataset:
    """Label the margins of one trim point, with the response of each loop.

    Parameters
    ----------
    found, response
        What `analyse_loops` found there.
    names
        Of the breakpoints.
    step_s
        Sampling period.
    attributes
        Of the whole dataset.

    Returns
    -------
    xr.Dataset
        Over (breakpoint) the margins, infinite where no boundary of stability was found, nan unless the closed loop is
        stable; over (breakpoint, frequency) gain and phase of the loop transfer function.
    """
    of_points = jax.tree.map(lambda leaf: np.asarray(leaf)[None], found)
    data: dict[str, Any] = {
        name: (dims, values[0], labels)
        for name, dims, values, labels in _variables(of_points, step_s, np.array([True]))
    }
    loops = np.asarray(response.open).T
    over = ("breakpoint", "frequency")
    phase = np.unwrap(np.angle(loops), axis=1) * RAD_DEG
    # begin between -360 and 0 deg: the same branch for all
    phase -= 360 * np.ceil(phase[:, :1] / 360)
    with np.errstate(divide="ignore"):
        gain = 20 * np.log10(np.abs(loops))
    data["loop_gain_db"] = (over, gain, unit_attributes("dB", "Gain of the loop"))
    data["loop_phase_deg"] = (over, phase, unit_attributes("degree", "Phase of the loop"))
    coordinates = _names(names) | {
        "frequency": ("frequency", np.asarray(response.omega), unit_attributes("rad s-1", "Frequency"))
    }
    return xr.Dataset(data, coordinates, _attributes(attributes, step_s))


def margin_map_dataset(
    trims: TrimMap,
    found: LoopAnalysis,
    names: Sequence[str],
    step_s: float,
    attributes: Mapping[str, str | int | float],
) -> xr.Dataset:
    """Label the margins over a trim map.

    Parameters
    ----------
    trims
        The map.
    found
        What `analyse_loops` found of the points that are trimmable, in order.
    names
        Of the breakpoints.
    step_s
        Sampling period.
    attributes
        Of the whole dataset.

    Returns
    -------
    xr.Dataset
        Over (condition, altitude, mach) and (condition, altitude, mach, breakpoint).
    """
    points, trimmable = trims.points, np.asarray(trims.points.trimmable)
    data: dict[str, Any] = {
        name: ((*GRID_DIMENSIONS, *dims), trims.gridded(values), labels)
        for name, dims, values, labels in _variables(found, step_s, trimmable)
    }
    alpha, load_factor = (np.where(trimmable, of, np.nan) for of in (points.trim.alpha, points.load_factor))
    data["with_reserve"] = trims.with_reserve()
    data["alpha_deg"] = trims.variable(alpha * RAD_DEG, "degree", "Angle of attack")
    data["load_factor"] = trims.variable(load_factor, "1", "Normal load factor")
    return xr.Dataset(data, _names(names) | trims.coordinates("Steady flight"), _attributes(attributes, step_s))


def margin_table(dataset: xr.Dataset, *, with_reserve: bool = True) -> list[dict[str, Any]]:
    """What the margins over a map come to: one row for each breakpoint.

    Least, 5th percentile and median of each margin over the stable points, and how many of them fall short of
    `GAIN_MIN_DB` or `PHASE_MIN_DEG`. Infinite figures are None.

    Parameters
    ----------
    dataset
        As `margin_map_dataset` makes it.
    with_reserve
        Only points with a tenth of power and surfaces left.
    """
    among = dataset["closed_loop"].values == CLOSED_LOOP_STATES.index("stable")
    if with_reserve:
        among = among & dataset["with_reserve"].values
    rows = []
    for k, name in enumerate(dataset["breakpoint"].values.tolist()):
        row: dict[str, Any] = {"breakpoint": name, "points": int(among.sum())}
        for margin in ("gain_margin_db", "phase_margin_deg", "delay_margin_ms", "disk_margin"):
            values = np.sort(dataset[margin].values[among][:, k])
            # by rank: no mean of a finite and an infinite margin
            for what, part in (("min", 0.0), ("p5", 0.05), ("median", 0.5)):
                value = values[math.floor(part * (values.size - 1))] if values.size else math.nan
                row[f"{margin}_{what}"] = finite_or_none(value)
        row["short"] = int(dataset["short"].values[among][:, k].sum())
        rows.append(row)
    return rows


def _variables(found: LoopAnalysis, step_s: float, trimmable: np.ndarray) -> list[_Variable]:
    """Figures of the trimmable points, spread over all points."""
    pole = largest_pole(np.asarray(found.A)) if trimmable.any() else np.zeros(0, dtype=complex)
    rate = np.log(pole) / step_s
    stable = np.abs(pole) <= 1 + NEUTRAL_POLE_TOLERANCE
    limited = np.asarray(found.limited)
    state = np.where(limited.any(axis=1), 1, np.where(stable, 3, 2)).astype(np.int32)
    m = {name: np.asarray(values) for name, values in vars(found.margins).items()}
    with np.errstate(divide="ignore"):
        up, down = 20 * np.log10(m["gain_up"]), -20 * np.log10(m["gain_down"])
        up_searched, down_searched = 20 * np.log10(m["gain_up_searched"]), -20 * np.log10(m["gain_down_searched"])
    gain, phase = np.minimum(up, down), m["phase"] * RAD_DEG
    numbers = {
        "gain_up_db": (up, "dB", "Factor by which the gain can rise"),
        "gain_down_db": (down, "dB", "Factor by which the gain can fall"),
        "gain_up_searched_db": (up_searched, "dB", "Rise of the gain up to which a boundary was searched"),
        "gain_down_searched_db": (down_searched, "dB", "Fall of the gain down to which a boundary was searched"),
        "gain_margin_db": (gain, "dB", "Gain margin, the lesser of both ways"),
        "phase_margin_deg": (phase, "degree", "Phase margin, either way"),
        "delay_margin_ms": (m["delay"] * 1000.0, "ms", "Delay margin"),
        "disk_margin": (m["disk"], "1", "Radius of the symmetric disk margin"),
        "gain_up_at_rad_s": (m["gain_up_at"], "rad s-1", "Where the gain can rise least"),
        "gain_down_at_rad_s": (m["gain_down_at"], "rad s-1", "Where the gain can fall least"),
        "crossover_rad_s": (m["crossover"], "rad s-1", "Gain crossover that has the phase margin"),
    }
    short = (gain < GAIN_MIN_DB) | (phase < PHASE_MIN_DEG)
    stable_points = trimmable.copy()
    stable_points[trimmable] = state == 3

    def add(name: str, values: Any, labels: dict[str, Any], *over: str) -> None:
        variables.append((name, over, scatter_rows(values, trimmable), labels))

    def add_stable(name: str, values: np.ndarray, labels: dict[str, Any], *over: str) -> None:
        variables.append((name, over, scatter_rows(values[state == 3], stable_points), labels))

    variables: list[_Variable] = []
    add("closed_loop", state, flag_attributes("What the closed loop is", CLOSED_LOOP_STATES))
    add("limited", limited, unit_attributes("1", "Whether the command stands at a limit"), "command")
    add("pole_real_1_s", rate.real, unit_attributes("s-1", "Real part of the rightmost pole"))
    add("pole_imag_1_s", rate.imag, unit_attributes("s-1", "Imaginary part of the rightmost pole"))
    add_stable("short", short, unit_attributes("1", "Whether a margin falls short"), "breakpoint")
    for name, (values, unit, words) in numbers.items():
        add_stable(name, values, unit_attributes(unit, words), "breakpoint")
    words = "Radius of the symmetric disk margin of all actuators at once"
    add_stable("actuators_disk_margin", np.asarray(found.actuators_disk), unit_attributes("1", words))
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
        **version_attributes(),
    }


_FORMAT_VERSION = 1
_BATCH = 32
"""Points of one compiled call: the responses of more do not stay in the processors' caches."""


@dataclasses.dataclass(frozen=True)
class MarginSurvey(SurveyResult):
    """Margins over the envelope; the dataset: see `anser.results.margin_map_dataset`."""

    def counts(self) -> dict[str, int]:
        """Points by what the closed loop is there."""
        states = self.dataset["closed_loop"].values
        return {what: int((states == k).sum()) for k, what in enumerate(CLOSED_LOOP_STATES)}

    def shortfalls(self) -> list[str]:
        """Points where the loop is unstable or, at some breakpoints, a margin falls short; one line each."""
        names = self.dataset["breakpoint"].values.tolist()
        lines = []
        states = self.dataset["closed_loop"].values
        for c, a, m in np.argwhere(
            (states == CLOSED_LOOP_STATES.index("unstable")) | self.dataset["short"].values.any(axis=-1)
        ):
            of = self.dataset.isel(condition=c, altitude=a, mach=m)
            place = f"{of.condition_meaning.item()}, {of.altitude.item():.0f} m, Mach {of.mach.item():.3f}"
            if states[c, a, m] == CLOSED_LOOP_STATES.index("unstable"):
                lines.append(f"{place}: unstable, pole {_pole(of)}")
                continue
            for name in names:
                at = of.sel(breakpoint=name)
                if at["short"].item():
                    lines.append(
                        f"{place}, {name}: {at['gain_margin_db'].item():.1f} dB, "
                        f"{at['phase_margin_deg'].item():.1f} deg"
                    )
        return lines

    def document(self) -> dict[str, Any]:
        """Counts and the table of the breakpoints, plain data for JSON."""
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
    """Margins of the whole autopilot in level flight, in the standard atmosphere and still air.

    One loop at a time is broken, all others stay closed.

    Parameters
    ----------
    aircraft, variant
        Of the library, or an airframe.
    speed_m_s, altitude_m
        True airspeed and geometric altitude.
    inversion
        What the autopilot inverts.
    step_s
        Of the autopilot's samples.
    gains
        Instead of the published ones of the F-16, or of the aircraft's own.

    Returns
    -------
    xr.Dataset
        As `anser.analysis.margins` makes it.

    Raises
    ------
    ConditionError
        There is no such steady flight, a command of the autopilot stands at a limit in it, or the closed loop is
        unstable: no margin exists. The message says which.
    ValueError
        No such airframe.
    """
    enable_compilation_cache()
    airframe, of = resolve_airframe(aircraft, variant)
    environment, limits = standard_environment(), _limits_around(airframe, speed_m_s)
    target = trim_target(speed_m_s, altitude_m)
    points = map_points(airframe, environment, jax.tree.map(lambda leaf: leaf[None], target))
    if not bool(points.trimmable[0]):
        raise ConditionError(nearest_trims(airframe, environment, target).message())
    trim = jax.tree.map(lambda leaf: leaf[0], points.trim)
    wanted = (
        default_gains(airframe, environment, trim, step_s, inversion) if gains is None else gains_for(inversion, gains)
    )
    # the survey's batch, filled with the one point: compiled once for both
    trims = jax.tree.map(lambda leaf: jnp.repeat(leaf, _BATCH, axis=0), points.trim)
    analysed = _analyse(
        airframe, environment, wanted, limits, trims, jnp.asarray(step_s), loop_state_fields(wanted, airframe)
    )
    found, response = jax.tree.map(lambda leaf: leaf[0], analysed)
    attributes = {**of, "speed_m_s": speed_m_s, "altitude_m": altitude_m, "inversion": inversion}
    dataset = margin_dataset(found, response, breakpoints(airframe), step_s, attributes)
    state = CLOSED_LOOP_STATES[dataset["closed_loop"].item()]
    if state == "held_back":
        which = ", ".join(name for name, at in zip(SATURABLE_COMMANDS, dataset["limited"].values, strict=True) if at)
        raise ConditionError(
            f"The autopilot does not hold this flight: its command stands at a limit ({which}), where the loop is open."
        )
    if state == "unstable":
        raise ConditionError(f"The closed loop is unstable, pole {_pole(dataset)}: there are no margins.")
    return dataset


def _limits_around(airframe: AbstractAirframe, speed_m_s: float) -> FlightLimits:
    """Limits of the survey, which suit an F-16; of another airframe half to twice the airspeed asked about."""
    limits = survey_limits()
    if isinstance(airframe, AbstractF16):
        return limits
    ends = jnp.asarray(0.5 * speed_m_s, dtype=float), jnp.asarray(2.0 * speed_m_s, dtype=float)
    limits = eqx.tree_at(lambda own: (own.speed_min, own.speed_max), limits, ends)
    return eqx.tree_at(lambda own: (own.alpha_min, own.alpha_max), limits, airframe.alpha_range)


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
    """Margins at every point of the envelope's trim map that can be flown steadily, in the standard atmosphere.

    The steady flights are the envelope survey's `CONDITIONS`, its limits `survey_limits`.

    Parameters
    ----------
    aircraft, variant, inversion, step_s, gains
        As of `margins_at`.
    coarse, altitudes_m, machs, progress
        As of `anser.execution.survey`.

    Raises
    ------
    ValueError
        No such airframe, an axis that is not of increasing numbers, or no point of the grid can be flown.
    """
    enable_compilation_cache()
    on_progress = progress or no_progress
    airframe, of = resolve_airframe(aircraft, variant)
    environment, limits = standard_environment(), survey_limits()
    wanted = gains_for(inversion, gains)
    clock, memory = Stopwatch(), loop_state_fields(wanted, airframe)
    on_progress("trimming", 0.0)
    trims = trim_map(clock, airframe, environment, altitudes_m, machs, coarse=coarse)
    which = np.flatnonzero(np.asarray(trims.points.trimmable))
    total = which.size

    def of_batch(numbers: np.ndarray) -> LoopAnalysis:
        some = jax.tree.map(lambda leaf: leaf[which[numbers]], trims.points.trim)
        return clock.run(_analyse, airframe, environment, wanted, limits, some, jnp.asarray(step_s), memory)[0]

    found = run_in_batches(
        of_batch, total, _BATCH, lambda k: on_progress(f"breaking the loops at {total} points", k / total)
    )
    attributes = {**of, "inversion": inversion, **limit_attributes(limits)}
    dataset = margin_map_dataset(trims, found, breakpoints(airframe), step_s, attributes)
    return MarginSurvey(dataset, clock.compile_s, clock.run_s)


def margin_document(dataset: xr.Dataset) -> dict[str, Any]:
    """Margins of one trim point, as `margins_at` finds them, in plain data for JSON; what is infinite is None."""
    rows = []
    for name in dataset["breakpoint"].values.tolist():
        of = dataset.sel(breakpoint=name)
        figures = {key: of[key].item() for key, of_key in dataset.data_vars.items() if of_key.dims == ("breakpoint",)}
        rows.append(
            {
                "breakpoint": name,
                **{key: value if key == "short" else finite_or_none(value) for key, value in figures.items()},
            }
        )
    return {
        "format_version": _FORMAT_VERSION,
        "condition": plain_attributes(dataset.attrs),
        "actuators_disk_margin": dataset["actuators_disk_margin"].item(),
        "breakpoints": rows,
    }


@compiled
def _analyse(
    airframe: AbstractAirframe,
    environment: Environment,
    gains: AutopilotGains,
    limits: FlightLimits,
    trims: TrimPoint,
    step: jax.Array,
    memory: StateFields,
) -> tuple[LoopAnalysis, LoopResponse]:
    def one(trim: TrimPoint) -> tuple[LoopAnalysis, LoopResponse]:
        return analyse_loops(LoopCase(airframe, environment, gains, limits, trim, step), memory)

    return jax.vmap(one)(trims)


def _pole(at: xr.Dataset) -> str:
    real, imaginary = at["pole_real_1_s"].item(), at["pole_imag_1_s"].item()
    return f"{real:+.3g} 1/s" if not imaginary else f"{real:+.3g} +- {imaginary:.3g}i 1/s"
