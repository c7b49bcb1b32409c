"""Stability margins, labelled: of one trim point and over a trim map; what they come to, breakpoint by breakpoint."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import numpy as np
import xarray as xr

from anser.results.plain import finite_or_none
from anser.results.provenance import version_attributes
from anser.results.trim_map import POINT, TrimMap
from anser.results.variable_labels import attributes_of, flags_of, scattered
from anser.simulation import FREQUENCY_MIN, HELD_BACK, NEUTRAL, LoopAnalysis, LoopResponse, largest_pole
from anser.units import RAD_DEG

GAIN_MIN_DB, PHASE_MIN_DEG = 6.0, 40.0
"""What falls short of either is marked as short."""
CLOSED_LOOP = ("no_trim", "held_back", "unstable", "stable")
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
    data["loop_gain_db"] = (over, gain, attributes_of("dB", "Gain of the loop"))
    data["loop_phase_deg"] = (over, phase, attributes_of("degree", "Phase of the loop"))
    coordinates = _names(names) | {
        "frequency": ("frequency", np.asarray(response.omega), attributes_of("rad s-1", "Frequency"))
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
        name: ((*POINT, *dims), trims.gridded(values), labels)
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
    among = dataset["closed_loop"].values == CLOSED_LOOP.index("stable")
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
    stable = np.abs(pole) <= 1 + NEUTRAL
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
        variables.append((name, over, scattered(values, trimmable), labels))

    def add_stable(name: str, values: np.ndarray, labels: dict[str, Any], *over: str) -> None:
        variables.append((name, over, scattered(values[state == 3], stable_points), labels))

    variables: list[_Variable] = []
    add("closed_loop", state, flags_of("What the closed loop is", CLOSED_LOOP))
    add("limited", limited, attributes_of("1", "Whether the command stands at a limit"), "command")
    add("pole_real_1_s", rate.real, attributes_of("s-1", "Real part of the rightmost pole"))
    add("pole_imag_1_s", rate.imag, attributes_of("s-1", "Imaginary part of the rightmost pole"))
    add_stable("short", short, attributes_of("1", "Whether a margin falls short"), "breakpoint")
    for name, (values, unit, words) in numbers.items():
        add_stable(name, values, attributes_of(unit, words), "breakpoint")
    words = "Radius of the symmetric disk margin of all actuators at once"
    add_stable("actuators_disk_margin", np.asarray(found.actuators_disk), attributes_of("1", words))
    return variables


def _names(breakpoints: Sequence[str]) -> dict[str, Any]:
    return {
        "breakpoint": ("breakpoint", np.array(breakpoints), {"long_name": "Where the loop is broken"}),
        "command": (
            "command",
            np.array(HELD_BACK),
            attributes_of("", "Command of the autopilot that can stand at a limit"),
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
