"""From the trim map and the flights of an envelope survey to a labelled dataset."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from anser.results.envelope_reasons import Verdicts
from anser.results.flight_variables import flight_axes, flight_variables
from anser.results.provenance import version_attributes
from anser.results.trim_map import POINT, TrimMap
from anser.results.variable_labels import attributes_of, flags_of, scattered
from anser.simulation import TRIM_STOPS, FlightSummary
from anser.units import RAD_DEG


def envelope_dataset(
    trims: TrimMap,
    commands: Mapping[str, str],
    flown: np.ndarray,
    summaries: FlightSummary,
    verdicts: Verdicts,
    attributes: Mapping[str, str | int | float],
) -> xr.Dataset:
    """Label a survey.

    Parameters
    ----------
    trims
        Steady flights that are left.
    commands
        Names and what they mean.
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
    data = _map_variables(trims)
    for name, (values, labels, over) in flight_variables(summaries, verdicts).items():
        data[name] = ((*POINT, "command", *over), trims.gridded(scattered(values, flown)), labels)
    coordinates = {
        **trims.coordinates("Steady flight that is left"),
        "command": ("command", np.array(list(commands)), attributes_of("", "Step of the path command")),
        "command_meaning": ("command", np.array(list(commands.values()))),
        **flight_axes(trims.surfaces),
    }
    return xr.Dataset(data, coordinates, {**attributes, **version_attributes()})


def _map_variables(trims: TrimMap) -> dict[str, Any]:
    points = trims.points
    trimmable, solved = np.asarray(points.trimmable), np.asarray(points.trim.converged)
    stop = np.where(trimmable, 0, 1 + np.asarray(points.stopped_by).argmax(axis=1)).astype(np.int32)

    def where_solved(values: Any, unit: str, words: str, *over: str) -> Any:
        array = np.asarray(values)
        known = np.where(solved.reshape(-1, *(1,) * (array.ndim - 1)), array, np.nan)
        return trims.variable(known * RAD_DEG if unit == "degree" else known, unit, words, *over)

    stop_labels = flags_of("What stops the steady flight, the first of several", ("none", *TRIM_STOPS))
    return {
        "trimmable": trims.variable(trimmable, "1", "Whether the steady flight can be flown"),
        "trim_stop": (POINT, trims.gridded(stop), stop_labels),
        "with_reserve": trims.with_reserve(),
        "alpha_deg": where_solved(points.trim.alpha, "degree", "Angle of attack"),
        "bank_deg": where_solved(points.trim.mu, "degree", "Bank about the velocity vector"),
        "power_percent": where_solved(points.trim.power, "percent", "Engine power"),
        "load_factor": where_solved(points.load_factor, "1", "Normal load factor"),
        "surface_deg": where_solved(points.trim.state.surfaces, "degree", "Deflection", "surface"),
        "power_left": where_solved(points.power_left, "1", "Power left up to the full, part of it"),
        "power_spare": where_solved(points.power_spare, "1", "Power that can be taken back, part of the full"),
        "surface_left": where_solved(
            points.surface_left, "1", "Way left to the stop, part of that from the middle", "surface"
        ),
    }
