"""From rows of flights to columns: one array for each quantity, with its unit and meaning."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from anser.results.flight_row import FlightRow
from anser.results.variable_labels import attributes_of

if TYPE_CHECKING:
    import xarray as xr

OF_AIRCRAFT = {
    "planned_arrival_s": ("s", "Arrival as planned at last"),
    "arrival_s": ("s", "Arrival; none of an aircraft that never arrived"),
    "miss_m": ("m", "Distance from the rendezvous at the arrival"),
    "speed_mean_m_s": ("m s-1", "Mean airspeed up to the arrival"),
    "speed_min_m_s": ("m s-1", "Least airspeed up to the arrival"),
    "speed_max_m_s": ("m s-1", "Greatest airspeed up to the arrival"),
    "clearance_min_m": ("m", "Least distance to the goal"),
    "position_error_max_m": (
        "m",
        "Greatest distance from the planned position while the plan is flown",
    ),
    "tables_left_s": ("s", "Time outside the tables of the airframe"),
}
OF_FLEET = {
    "arrival_spread_s": ("s", "Time between the first and the last arrival"),
    "separation_min_m": ("m", "Least distance between two aircraft"),
    "separation_ratio_min": ("1", "Least ratio of a distance to the separation asked for"),
}

Column = tuple[tuple[str, ...], np.ndarray, dict[str, Any]]
"""Dimensions of one flight (none, or `aircraft`), values with a leading axis of flights, attributes."""


def flight_columns(rows: Sequence[FlightRow], aircraft: int) -> dict[str, Column]:
    """Arrays of all that rows hold; NaN and "no flight" where a flight could not begin, with the reason.

    Parameters
    ----------
    rows
        Of flights with the same fleet.
    aircraft
        How many.
    """

    def of_aircraft(key: str, missing: Any) -> np.ndarray:
        none = [missing] * aircraft
        return np.array([[_or(one.get(key), missing) for one in row.aircraft] or none for row in rows])

    found: dict[str, Column] = {
        key: (("aircraft",), of_aircraft(key, np.nan).astype(float), attributes_of(*labels))
        for key, labels in OF_AIRCRAFT.items()
    }
    words = attributes_of("", "What became of it")
    found["status"] = (("aircraft",), of_aircraft("status", "no flight").astype(np.str_), words)
    for key, labels in OF_FLEET.items():
        values = np.array([_or(row.fleet.get(key), np.nan) for row in rows], dtype=float)
        found[key] = ((), values, attributes_of(*labels))
    met = attributes_of("1", "Whether all arrived and every requirement is met")
    found["met"] = ((), np.array([row.met for row in rows], dtype=bool), met)
    unmet = [", ".join(one["name"] for one in row.requirements if not one["met"]) for row in rows]
    found["unmet"] = ((), np.array(unmet, dtype=np.str_), attributes_of("", "Requirements that are not met"))
    reason = attributes_of("", "Why the flight could not begin; empty where it did")
    found["reason"] = ((), np.array([row.reason for row in rows], dtype=np.str_), reason)
    return found


def of_this_fleet(names: Iterable[str], dataset: "xr.Dataset") -> tuple[str, ...]:
    """Those of the quantities that a fleet of this size has: one aircraft has neither spread nor separation."""
    return tuple(name for name in names if name not in OF_FLEET or dataset.sizes["aircraft"] > 1)


def worst_of_fleet(columns: "xr.Dataset | Mapping[str, np.ndarray]", name: str, *, upper: bool = True) -> np.ndarray:
    """Worst value of each flight: the greatest of its aircraft, or the least if `upper` is False.

    A flight with an aircraft that never arrived is infinitely bad in every quantity, also in those that it has: a crash
    far from the goal must not improve the least distance. An aircraft without a number counts as one that never
    arrived, unless the flight met every requirement without it (the aircraft had left).

    Parameters
    ----------
    columns
        Of flights: a dataset, or arrays by name, with `met`, `miss_m` (NaN of an aircraft that never arrived) and the
        quantity.
    name
        Of the quantity, of dimensions (flight) or (flight, aircraft); NaN where there is none.
    upper
        Whether more is worse.
    """
    values, met = np.asarray(columns[name]), np.asarray(columns["met"])
    has_arrived = met | ~np.isnan(np.asarray(columns["miss_m"])).any(axis=-1)
    rows = (values if upper else -values).reshape(values.shape[0], math.prod(values.shape[1:]))
    missing = np.where(met, -np.inf, np.inf)[:, None]
    worst = np.where(has_arrived, np.max(np.where(np.isnan(rows), missing, rows), axis=1), np.inf)
    return worst if upper else -worst


def _or(value: Any, missing: Any) -> Any:
    return missing if value is None else value
