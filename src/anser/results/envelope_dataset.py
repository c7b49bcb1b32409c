"""From the trim map and the flights of an envelope survey to a labelled dataset."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from anser.results.envelope_reasons import OUTCOMES, REASONS, Verdicts
from anser.results.flight_variables import add_flights, attributes_of
from anser.results.provenance import versions
from anser.simulation import AUTOPILOT_LIMITS, TABLE_AXES, TRIM_STOPS, FlightSummary, MapPoint
from anser.units import RAD_DEG

RESERVE_MIN = 0.1
"""Part of the power, up and down, and of each surface's way that a point with reserve has left."""

_POINT = ("condition", "altitude", "mach")
_SURFACES = ("elevator", "aileron", "rudder")
_RATES = ("roll", "pitch", "yaw")


def envelope_dataset(
    conditions: Mapping[str, str],
    commands: Mapping[str, str],
    altitudes_m: np.ndarray,
    machs: np.ndarray,
    points: MapPoint,
    airspeeds_m_s: np.ndarray,
    flown: np.ndarray,
    summaries: FlightSummary,
    verdicts: Verdicts,
    attributes: Mapping[str, str | int | float],
) -> xr.Dataset:
    """Label a survey.

    Parameters
    ----------
    conditions, commands
        Names and what they mean.
    altitudes_m, machs
        Axes of the grid.
    points
        Trim map; leaves of shape (conditions x altitudes x machs, ...), the last running fastest.
    airspeeds_m_s
        True airspeed over (altitude, mach).
    flown
        Which point (row) was flown with which command (column).
    summaries, verdicts
        Of the flights, in the order of the true entries of `flown`.
    attributes
        Of the whole dataset.

    Returns
    -------
    xr.Dataset
        Over (condition, altitude, mach) the trim map, over (condition, altitude, mach, command) the flights; NaN where
        nothing was flown.
    """
    grid = (len(conditions), len(altitudes_m), len(machs))
    data: dict[str, Any] = {}

    def of_points(name: str, values: Any, unit: str, words: str, over: str | None = None) -> None:
        array = np.asarray(values)
        dims = _POINT if over is None else (*_POINT, over)
        data[name] = (dims, array.reshape(*grid, *array.shape[1:]), attributes_of(unit, words))

    def of_flights(name: str, values: Any, unit: str, words: str, over: str | None = None) -> None:
        array = np.asarray(values)
        full = np.full((*flown.shape, *array.shape[1:]), 0 if array.dtype.kind == "i" else np.nan, array.dtype)
        full[flown] = array
        dims = (*_POINT, "command") if over is None else (*_POINT, "command", over)
        data[name] = (dims, full.reshape(*grid, *full.shape[1:]), attributes_of(unit, words))

    _add_map(of_points, points)
    add_flights(of_flights, summaries)
    of_flights("outcome", verdicts.outcome, "1", "What became of the flight")
    of_flights("reason", verdicts.reason, "1", "Limit that stood in the way")
    for name, meanings in (("trim_stop", ("none", *TRIM_STOPS)), ("outcome", OUTCOMES), ("reason", REASONS)):
        _, values, labels = data[name]
        labels["flag_values"] = np.arange(len(meanings), dtype=values.dtype)
        labels["flag_meanings"] = " ".join(meanings)
    coordinates: dict[str, Any] = {
        "condition": ("condition", np.array(list(conditions)), attributes_of("", "Steady flight that is left")),
        "command": ("command", np.array(list(commands)), attributes_of("", "Step of the path command")),
        "altitude": ("altitude", np.asarray(altitudes_m, dtype=float), attributes_of("m", "Geometric altitude")),
        "mach": ("mach", np.asarray(machs, dtype=float), attributes_of("1", "Mach number")),
        "airspeed_m_s": (("altitude", "mach"), airspeeds_m_s, attributes_of("m s-1", "True airspeed")),
        "condition_meaning": ("condition", np.array(list(conditions.values()))),
        "command_meaning": ("command", np.array(list(commands.values()))),
        "surface": ("surface", np.array(_SURFACES)),
        "axis": ("axis", np.array(_RATES)),
        "limit": ("limit", np.array(AUTOPILOT_LIMITS)),
        "table": ("table", np.array(TABLE_AXES)),
    }
    of = {**attributes, **{f"version_{name}": version for name, version in versions().items()}}
    return xr.Dataset(data, coordinates, of)


def _add_map(add: Any, points: MapPoint) -> None:
    stopped = np.asarray(points.stopped_by)
    trimmable = ~stopped.any(axis=1)
    power_left, power_spare = np.asarray(points.power_left), np.asarray(points.power_spare)
    surface_left = np.asarray(points.surface_left)
    solved = np.asarray(points.trim.converged)

    def where_solved(values: Any) -> np.ndarray:
        array = np.asarray(values)
        return np.where(solved.reshape(-1, *(1,) * (array.ndim - 1)), array, np.nan)

    least = np.minimum(np.minimum(power_left, power_spare), surface_left.min(axis=1))
    stop = np.where(trimmable, 0, 1 + stopped.argmax(axis=1)).astype(np.int32)
    add("trimmable", trimmable, "1", "Whether the steady flight can be flown")
    add("trim_stop", stop, "1", "What stops the steady flight, the first of several")
    add("with_reserve", trimmable & (least >= RESERVE_MIN), "1", "Whether a tenth of power and surfaces is left")
    add("alpha_deg", where_solved(points.trim.alpha) * RAD_DEG, "degree", "Angle of attack")
    add("bank_deg", where_solved(points.trim.mu) * RAD_DEG, "degree", "Bank about the velocity vector")
    add("power_percent", where_solved(points.trim.power), "percent", "Engine power")
    add("load_factor", where_solved(points.load_factor), "1", "Normal load factor")
    surfaces = where_solved(points.trim.state.surfaces) * RAD_DEG
    add("surface_deg", surfaces, "degree", "Deflection", "surface")
    add("power_left", where_solved(power_left), "1", "Power left up to the full, part of it")
    add("power_spare", where_solved(power_spare), "1", "Power that can be taken back, part of the full")
    add(
        "surface_left", where_solved(surface_left), "1", "Way left to the stop, part of that from the middle", "surface"
    )
