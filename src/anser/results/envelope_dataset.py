"""From the trim map and the flights of an envelope survey to a labelled dataset."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from anser.results.envelope_reasons import OUTCOMES, REASONS, Verdicts
from anser.results.provenance import versions
from anser.simulation import AUTOPILOT_LIMITS, TABLE_AXES, TRIM_STOPS, FlightSummary, MapPoint
from anser.units import RAD_DEG

__all__ = ["RESERVE_MIN", "envelope_dataset"]

RESERVE_MIN = 0.1
"""Part of the power, up and down, and of each surface's way that a point with reserve has left."""

_POINT = ("condition", "altitude", "mach")
_CHANNELS = (
    ("airspeed", "m_s", "m s-1", 1.0),
    ("path_angle", "deg", "degree", RAD_DEG),
    ("course", "deg", "degree", RAD_DEG),
)
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
        data[name] = (dims, array.reshape(*grid, *array.shape[1:]), _labels(unit, words))

    def of_flights(name: str, values: Any, unit: str, words: str, over: str | None = None) -> None:
        array = np.asarray(values)
        full = np.full((*flown.shape, *array.shape[1:]), 0 if array.dtype.kind == "i" else np.nan, array.dtype)
        full[flown] = array
        dims = (*_POINT, "command") if over is None else (*_POINT, "command", over)
        data[name] = (dims, full.reshape(*grid, *full.shape[1:]), _labels(unit, words))

    _add_map(of_points, points)
    _add_flights(of_flights, summaries)
    of_flights("outcome", verdicts.outcome, "1", "What became of the flight")
    of_flights("reason", verdicts.reason, "1", "Limit that stood in the way")
    for name, meanings in (("trim_stop", ("none", *TRIM_STOPS)), ("outcome", OUTCOMES), ("reason", REASONS)):
        _, values, labels = data[name]
        labels["flag_values"] = np.arange(len(meanings), dtype=values.dtype)
        labels["flag_meanings"] = " ".join(meanings)
    coordinates: dict[str, Any] = {
        "condition": ("condition", np.array(list(conditions)), _labels("", "Steady flight that is left")),
        "command": ("command", np.array(list(commands)), _labels("", "Step of the path command")),
        "altitude": ("altitude", np.asarray(altitudes_m, dtype=float), _labels("m", "Geometric altitude")),
        "mach": ("mach", np.asarray(machs, dtype=float), _labels("1", "Mach number")),
        "airspeed_m_s": (("altitude", "mach"), airspeeds_m_s, _labels("m s-1", "True airspeed")),
        "condition_meaning": ("condition", np.array(list(conditions.values()))),
        "command_meaning": ("command", np.array(list(commands.values()))),
        "surface": ("surface", np.array(_SURFACES)),
        "axis": ("axis", np.array(_RATES)),
        "limit": ("limit", np.array(AUTOPILOT_LIMITS)),
        "table": ("table", np.array(TABLE_AXES)),
    }
    of = {**attributes, **{f"version_{name}": version for name, version in versions().items()}}
    return xr.Dataset(data, coordinates, of)


def _labels(unit: str, words: str) -> dict[str, Any]:
    return {"units": unit, "long_name": words} if unit else {"long_name": words}


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


def _add_flights(add: Any, flights: FlightSummary) -> None:
    for k, (name, suffix, unit, factor) in enumerate(_CHANNELS):
        words = name.replace("_", " ")
        add(
            f"{name}_final_error_{suffix}",
            np.asarray(flights.final_error)[:, k] * factor,
            unit,
            f"Command minus {words}, mean of the last tenth",
        )
        add(
            f"{name}_final_error_max_{suffix}",
            np.asarray(flights.final_error_max)[:, k] * factor,
            unit,
            f"Largest error of the {words} in the last tenth",
        )
        add(
            f"{name}_settling_s",
            np.asarray(flights.settling_time)[:, k],
            "s",
            f"Until the {words} stays within its tolerance; inf: not before the end",
        )
        add(
            f"{name}_overshoot", np.asarray(flights.overshoot)[:, k], "1", f"Overshoot of the {words}, part of the step"
        )
        add(
            f"{name}_coupling_{suffix}",
            np.asarray(flights.coupling)[:, k] * factor,
            unit,
            f"Largest error of the {words} where it is not stepped",
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
    add(
        "limited_before_slip_s",
        flights.limited_before_slip,
        "s",
        "Time at each limit until sideslip first passes its bound",
        "limit",
    )
    add("left_s", flights.left_time, "s", "First time outside the data; inf: never", "table")
    add("finite", np.asarray(flights.finite).astype(np.int32), "1", "Whether the state stayed finite; 0 if not flown")
