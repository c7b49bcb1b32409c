"""From the flights of a sweep to a labelled dataset over what was swept."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from anser.results.flight_row import FlightRow
from anser.results.provenance import version_attributes
from anser.results.variable_labels import attributes_of

_OF_AIRCRAFT = {
    "planned_arrival_s": ("s", "Arrival as planned at last"),
    "arrival_s": ("s", "Arrival"),
    "miss_m": ("m", "Least distance to the rendezvous"),
    "speed_mean_m_s": ("m s-1", "Mean airspeed up to the arrival"),
    "speed_min_m_s": ("m s-1", "Least airspeed up to the arrival"),
    "speed_max_m_s": ("m s-1", "Greatest airspeed up to the arrival"),
    "clearance_min_m": ("m", "Least distance to the goal"),
    "position_error_max_m": ("m", "Greatest distance from the planned position up to the arrival"),
    "tables_left_s": ("s", "Time outside the tables of the airframe"),
}
_OF_FLEET = {
    "arrival_spread_s": ("s", "Time between the first and the last arrival"),
    "separation_min_m": ("m", "Least distance between two aircraft"),
    "separation_ratio_min": ("1", "Least ratio of a distance to the separation asked for"),
}


def sweep_dataset(
    swept: Mapping[str, Sequence[object]],
    aircraft: Sequence[str],
    rows: Sequence[FlightRow],
    attributes: Mapping[str, str | int],
) -> xr.Dataset:
    """Label the flights of a sweep.

    Parameters
    ----------
    swept
        By path, the values put there, in the order in which they vary: the last fastest.
    aircraft
        Names.
    rows
        What came of each flight, in that order.
    attributes
        Of the whole dataset.

    Returns
    -------
    xr.Dataset
        One dimension for each path, with its values as coordinate, and `aircraft`; NaN and "no flight" where a flight
        could not begin, with the reason.
    """
    shape = tuple(len(values) for values in swept.values())
    dimensions = tuple(swept)

    def of_flights(values: Sequence[Any], *more: int) -> np.ndarray:
        return np.array(values).reshape(*shape, *more)

    def of_aircraft(key: str, missing: Any) -> np.ndarray:
        none = [missing] * len(aircraft)
        columns = [[_or(one.get(key), missing) for one in row.aircraft] or none for row in rows]
        return of_flights(columns, len(aircraft))

    data: dict[str, Any] = {
        key: ((*dimensions, "aircraft"), of_aircraft(key, np.nan).astype(float), attributes_of(*labels))
        for key, labels in _OF_AIRCRAFT.items()
    }
    words = attributes_of("", "What became of it")
    data["status"] = ((*dimensions, "aircraft"), of_aircraft("status", "no flight").astype(np.str_), words)
    for key, labels in _OF_FLEET.items():
        found = of_flights([_or(row.fleet.get(key), np.nan) for row in rows]).astype(float)
        if not np.isnan(found).all():
            data[key] = (dimensions, found, attributes_of(*labels))
    met = attributes_of("1", "Whether all arrived and every requirement is met")
    data["met"] = (dimensions, of_flights([row.met for row in rows]), met)
    unmet = [", ".join(one["name"] for one in row.requirements if not one["met"]) for row in rows]
    data["unmet"] = (dimensions, of_flights(unmet).astype(np.str_), attributes_of("", "Requirements that are not met"))
    reason = attributes_of("", "Why the flight could not begin; empty where it did")
    data["reason"] = (dimensions, of_flights([row.reason for row in rows]).astype(np.str_), reason)
    coordinates: dict[str, Any] = {
        path: (path, _plain(values), attributes_of("", f"{path} of the scenario")) for path, values in swept.items()
    }
    coordinates["aircraft"] = ("aircraft", np.array(aircraft, dtype=np.str_), {"long_name": "Aircraft"})
    about = {**attributes, "swept": json.dumps(list(swept)), **version_attributes()}
    return xr.Dataset(data, coordinates, about)


def _or(value: Any, missing: Any) -> Any:
    return missing if value is None else value


def _plain(values: Sequence[object]) -> np.ndarray:
    """Numbers as numbers, truth values as such; all else in words, tables as JSON."""
    if all(isinstance(value, bool) for value in values):
        return np.array(values, dtype=bool)
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return np.array(values, dtype=float)
    return np.array([value if isinstance(value, str) else json.dumps(value) for value in values], dtype=np.str_)
