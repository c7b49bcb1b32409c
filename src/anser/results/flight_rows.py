"""Rows and columns of many flights.

The figures of one flight from its running summary, and one array per quantity with its unit and meaning.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from anser.results.arrival import ARRIVED, arrival_outcome
from anser.results.documents import finite_or_none
from anser.results.requirements import evaluate_requirements, scenario_requirements
from anser.results.summary import CLEARANCE_MIN_M
from anser.results.variable_labels import unit_attributes
from anser.scenario.schema import Scenario
from anser.simulation.closed_loop import LEFT_FLEET
from anser.simulation.fleet_summary import FleetSummary

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class FlightRow:
    """What came of one flight.

    Attributes
    ----------
    aircraft, fleet, requirements
        As in `summary.json`; empty where it could not begin.
    met
        Whether all arrived and every requirement is met.
    reason
        Why it could not begin; empty where it did.
    series
        By key of `anser.variables.CATALOGUE` what was kept over time: shape (aircraft, time), in the unit of a dataset.
    """

    aircraft: list[dict[str, Any]]
    fleet: dict[str, Any]
    requirements: list[dict[str, Any]]
    met: bool
    reason: str = ""
    series: Mapping[str, np.ndarray] = field(default_factory=dict, compare=False)

    @classmethod
    def failed_start(cls, reason: str) -> "FlightRow":
        """Of a flight that could not begin."""
        return cls([], {}, [], met=False, reason=reason)


def build_flight_row(summary: FleetSummary, planned_s: np.ndarray, scenario: Scenario) -> FlightRow:
    """Sum one flight up as `summarize` does.

    Parameters
    ----------
    summary
        Of one flight, concrete.
    planned_s
        Arrival times of the last plan, s.
    scenario
        What was flown.
    """
    aircraft = []
    for k, one in enumerate(scenario.aircraft):
        left = int(summary.first_status[k]) == LEFT_FLEET
        approach = arrival_outcome(
            (float(summary.pass_time[k]), float(summary.pass_distance[k])),
            float(planned_s[k]),
            float(summary.off_plan_time[k]),
            scenario.timing.duration_s,
            (int(summary.first_status[k]), int(summary.last_status[k])),
        )
        speeds, error_max = summary.speeds_on_plan, summary.position_error_on_plan
        if approach.is_arrival:
            speeds, error_max = summary.speeds_until_pass, summary.position_error_until_pass
        mean = (
            float(speeds.integral[k]) / approach.approach_end_s
            if approach.approach_end_s > 0.0
            else float(speeds.minimum[k])
        )
        aircraft.append(
            {
                "name": one.name,
                "goal": one.goal,
                "planned_arrival_s": None if left else finite_or_none(float(planned_s[k])),
                "arrival_s": None if left else finite_or_none(approach.time_s),
                "miss_m": None if left else finite_or_none(approach.miss_m),
                "speed_mean_m_s": finite_or_none(mean),
                "speed_min_m_s": finite_or_none(float(speeds.minimum[k])),
                "speed_max_m_s": finite_or_none(float(speeds.maximum[k])),
                "clearance_min_m": finite_or_none(float(summary.clearance_min[k])),
                "tables_left_s": finite_or_none(float(summary.tables_left_time[k])),
                "position_error_max_m": finite_or_none(float(error_max[k])),
                "status": approach.status,
            }
        )
    arrivals = [row["arrival_s"] for row in aircraft]
    fleet = {
        "arrival_spread_s": None if None in arrivals else max(arrivals) - min(arrivals),
        "separation_min_m": finite_or_none(float(summary.separation_min)),
    }
    if scenario.separation.required_m is not None:
        fleet["separation_ratio_min"] = finite_or_none(float(summary.separation_ratio_min))
    kinds = [scenario.goal_of(one).kind for one in scenario.aircraft]
    requirements = evaluate_requirements(
        scenario_requirements(scenario), aircraft, fleet, [(kind, CLEARANCE_MIN_M[kind]) for kind in kinds]
    )
    met = all(row["status"] == ARRIVED for row in aircraft) and all(one["met"] for one in requirements)
    return FlightRow(aircraft, fleet, requirements, met)


AIRCRAFT_QUANTITIES = {
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
FLEET_QUANTITIES = {
    "arrival_spread_s": ("s", "Time between the first and the last arrival"),
    "separation_min_m": ("m", "Least distance between two aircraft"),
    "separation_ratio_min": ("1", "Least ratio of a distance to the separation asked for"),
}

FlightColumn = tuple[tuple[str, ...], np.ndarray, dict[str, Any]]
"""Dimensions of one flight (none, or `aircraft`), values with a leading axis of flights, attributes."""


def tabulate_flights(rows: Sequence[FlightRow], aircraft: int) -> dict[str, FlightColumn]:
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

    found: dict[str, FlightColumn] = {
        key: (("aircraft",), of_aircraft(key, np.nan).astype(float), unit_attributes(*labels))
        for key, labels in AIRCRAFT_QUANTITIES.items()
    }
    words = unit_attributes("", "What became of it")
    found["status"] = (("aircraft",), of_aircraft("status", "no flight").astype(np.str_), words)
    for key, labels in FLEET_QUANTITIES.items():
        values = np.array([_or(row.fleet.get(key), np.nan) for row in rows], dtype=float)
        found[key] = ((), values, unit_attributes(*labels))
    met = unit_attributes("1", "Whether all arrived and every requirement is met")
    found["met"] = ((), np.array([row.met for row in rows], dtype=bool), met)
    unmet = [", ".join(one["name"] for one in row.requirements if not one["met"]) for row in rows]
    found["unmet"] = ((), np.array(unmet, dtype=np.str_), unit_attributes("", "Requirements that are not met"))
    reason = unit_attributes("", "Why the flight could not begin; empty where it did")
    found["reason"] = ((), np.array([row.reason for row in rows], dtype=np.str_), reason)
    return found


def applicable_quantities(names: Iterable[str], dataset: "xr.Dataset") -> tuple[str, ...]:
    """Those of the quantities that a fleet of this size has: one aircraft has neither spread nor separation."""
    return tuple(name for name in names if name not in FLEET_QUANTITIES or dataset.sizes["aircraft"] > 1)


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
