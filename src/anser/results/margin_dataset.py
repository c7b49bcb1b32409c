"""Stability margins, labelled: of one trim point and over a trim map; what they come to, breakpoint by breakpoint."""

import math
from collections.abc import Mapping
from typing import Any

import jax
import numpy as np
import xarray as xr

from anser.results.envelope_dataset import RESERVE_MIN
from anser.results.flight_variables import attributes_of
from anser.results.provenance import versions
from anser.simulation import BREAKPOINTS, HELD_BACK, NEUTRAL, LoopAnalysis, LoopResponse, MapPoint, largest_pole
from anser.units import RAD_DEG

GAIN_MIN_DB, PHASE_MIN_DEG = 6.0, 40.0
"""What falls short of either is marked as short."""
CLOSED_LOOP = ("no_trim", "held_back", "unstable", "stable")
"""What a point is: it cannot be flown steadily; a command of the autopilot stands at a limit there, so that the loop is
open; the closed loop is unstable; it is stable. Only the last has margins."""

_Variable = tuple[str, tuple[str, ...], np.ndarray, dict[str, Any]]
"""Name, dimensions beyond those of the points, values over points and those dimensions, labels."""

_POINT = ("condition", "altitude", "mach")
_NUMBERS = {
    "gain_up_db": ("dB", "Factor by which the gain can rise"),
    "gain_down_db": ("dB", "Factor by which the gain can fall"),
    "gain_margin_db": ("dB", "Gain margin, the lesser of both ways"),
    "phase_margin_deg": ("degree", "Phase margin, either way"),
    "delay_margin_ms": ("ms", "Delay margin"),
    "disk_margin": ("1", "Radius of the symmetric disk margin"),
    "gain_up_at_rad_s": ("rad s-1", "Where the gain can rise least"),
    "gain_down_at_rad_s": ("rad s-1", "Where the gain can fall least"),
    "crossover_rad_s": ("rad s-1", "Gain crossover that has the phase margin"),
}


def margin_dataset(
    found: LoopAnalysis, response: LoopResponse, step_s: float, attributes: Mapping[str, str | int | float]
) -> xr.Dataset:
    """Label the margins of one trim point, with the response of each loop.

    Parameters
    ----------
    found, response
        What `analyse_loops` found there.
    step_s
        Sampling period.
    attributes
        Of the whole dataset.

    Returns
    -------
    xr.Dataset
        Over (breakpoint) the margins, infinite where nothing destabilizes, nan unless the closed loop is stable; over
        (breakpoint, frequency) gain and phase of the loop transfer function.
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
    coordinates = _names() | {
        "frequency": ("frequency", np.asarray(response.omega), attributes_of("rad s-1", "Frequency"))
    }
    return xr.Dataset(data, coordinates, _attributes(attributes, step_s))


def margin_map_dataset(
    conditions: Mapping[str, str],
    altitudes_m: np.ndarray,
    machs: np.ndarray,
    airspeeds_m_s: np.ndarray,
    points: MapPoint,
    found: LoopAnalysis,
    step_s: float,
    attributes: Mapping[str, str | int | float],
) -> xr.Dataset:
    """Label the margins over a trim map.

    Parameters
    ----------
    conditions
        Names of the steady flights and what they mean.
    altitudes_m, machs
        Axes of the grid.
    airspeeds_m_s
        True airspeed over (altitude, mach).
    points
        Trim map; leaves of shape (conditions x altitudes x machs, ...), the last running fastest.
    found
        What `analyse_loops` found of the points that are trimmable, in order.
    step_s
        Sampling period.
    attributes
        Of the whole dataset.

    Returns
    -------
    xr.Dataset
        Over (condition, altitude, mach) and (condition, altitude, mach, breakpoint).
    """
    grid = (len(conditions), len(altitudes_m), len(machs))
    trimmable = np.asarray(points.trimmable)
    data: dict[str, Any] = {}
    for name, dims, values, labels in _variables(found, step_s, trimmable):
        data[name] = ((*_POINT, *dims), values.reshape(*grid, *values.shape[1:]), labels)
    left = [np.asarray(points.power_left), np.asarray(points.power_spare), np.asarray(points.surface_left).min(axis=1)]
    reserve = trimmable & (np.minimum.reduce(left) >= RESERVE_MIN)
    of_points = {
        "with_reserve": (reserve, "1", "Whether a tenth of power and surfaces is left"),
        "alpha_deg": (np.where(trimmable, points.trim.alpha, np.nan) * RAD_DEG, "degree", "Angle of attack"),
        "load_factor": (np.where(trimmable, points.load_factor, np.nan), "1", "Normal load factor"),
    }
    for name, (values, unit, words) in of_points.items():
        data[name] = (_POINT, np.asarray(values).reshape(grid), attributes_of(unit, words))
    coordinates = _names() | {
        "condition": ("condition", np.array(list(conditions)), {"long_name": "Steady flight"}),
        "condition_meaning": ("condition", np.array(list(conditions.values()))),
        "altitude": ("altitude", np.asarray(altitudes_m, dtype=float), attributes_of("m", "Geometric altitude")),
        "mach": ("mach", np.asarray(machs, dtype=float), attributes_of("1", "Mach number")),
        "airspeed_m_s": (("altitude", "mach"), airspeeds_m_s, attributes_of("m s-1", "True airspeed")),
    }
    return xr.Dataset(data, coordinates, _attributes(attributes, step_s))


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
    for k, name in enumerate(BREAKPOINTS):
        row: dict[str, Any] = {"breakpoint": name, "points": int(among.sum())}
        for margin in ("gain_margin_db", "phase_margin_deg", "delay_margin_ms", "disk_margin"):
            values = np.sort(dataset[margin].values[among][:, k])
            # by rank: no mean of a finite and an infinite margin
            for what, part in (("min", 0.0), ("p5", 0.05), ("median", 0.5)):
                value = float(values[math.floor(part * (values.size - 1))]) if values.size else math.nan
                row[f"{margin}_{what}"] = value if math.isfinite(value) else None
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
    numbers = {
        "gain_up_db": up,
        "gain_down_db": down,
        "gain_margin_db": np.minimum(up, down),
        "phase_margin_deg": m["phase"] * RAD_DEG,
        "delay_margin_ms": m["delay"] * 1000.0,
        "disk_margin": m["disk"],
        "gain_up_at_rad_s": m["gain_up_at"],
        "gain_down_at_rad_s": m["gain_down_at"],
        "crossover_rad_s": m["crossover"],
    }
    short = (numbers["gain_margin_db"] < GAIN_MIN_DB) | (numbers["phase_margin_deg"] < PHASE_MIN_DEG)

    def spread(values: np.ndarray, nothing: Any, *, only_stable: bool = False) -> np.ndarray:
        full = np.full((trimmable.size, *values.shape[1:]), nothing, values.dtype)
        keep = state == 3 if only_stable else np.ones(state.shape, dtype=bool)
        full[np.flatnonzero(trimmable)[keep]] = values[keep]
        return full

    flags = {"flag_values": np.arange(len(CLOSED_LOOP), dtype=np.int32), "flag_meanings": " ".join(CLOSED_LOOP)}
    variables: list[_Variable] = [
        ("closed_loop", (), spread(state, 0), attributes_of("1", "What the closed loop is") | flags),
        ("limited", ("command",), spread(limited, False), attributes_of("1", "Whether the command stands at a limit")),
        ("pole_real_1_s", (), spread(rate.real, np.nan), attributes_of("s-1", "Real part of the rightmost pole")),
        ("pole_imag_1_s", (), spread(rate.imag, np.nan), attributes_of("s-1", "Imaginary part of the rightmost pole")),
        (
            "short",
            ("breakpoint",),
            spread(short, False, only_stable=True),
            attributes_of("1", "Whether a margin falls short"),
        ),
    ]
    for name, (unit, words) in _NUMBERS.items():
        values = spread(numbers[name], np.nan, only_stable=True)
        variables.append((name, ("breakpoint",), values, attributes_of(unit, words)))
    together = spread(np.asarray(found.actuators_disk), np.nan, only_stable=True)
    words = "Radius of the symmetric disk margin of all three actuators at once"
    return [*variables, ("actuators_disk_margin", (), together, attributes_of("1", words))]


def _names() -> dict[str, Any]:
    return {
        "breakpoint": ("breakpoint", np.array(BREAKPOINTS), {"long_name": "Where the loop is broken"}),
        "command": (
            "command",
            np.array(HELD_BACK),
            {"long_name": "Command of the autopilot that can stand at a limit"},
        ),
    }


def _attributes(attributes: Mapping[str, str | int | float], step_s: float) -> dict[str, str | int | float]:
    return {
        **attributes,
        "step_s": step_s,
        "gain_min_db": GAIN_MIN_DB,
        "phase_min_deg": PHASE_MIN_DEG,
        **{f"version_{name}": version for name, version in versions().items()},
    }
