"""Results of the flights of a batch or campaign: a record per flight, and labelled arrays over the flights."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from anser.constants import AIRBORNE_STAND_OFF_MIN_M, SURFACE_STAND_OFF_MIN_M
from anser.results.arrival import ARRIVED, arrival_outcome
from anser.results.documents import finite_or_none
from anser.results.requirements import evaluate_requirements, scenario_requirements
from anser.results.variable_labels import unit_attributes
from anser.scenario.schema import Scenario
from anser.simulation.closed_loop import LEFT_FLEET
from anser.simulation.fleet_summary import FleetSummary

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class FlightRow:
    """Results of one flight of a batch or campaign."""

    # entries of the same names in `summary.json`; empty if the flight could not start
    aircraft: list[dict[str, Any]]
    fleet: dict[str, Any]
    requirements: list[dict[str, Any]]
    met: bool  # True: all requirements are met, and every aircraft arrived or left the fleet by an event
    reason: str = ""  # why the flight could not start
    # recorded time series by key of `anser.variables.CATALOGUE`, in dataset units; shape (aircraft, time)
    series: Mapping[str, np.ndarray] = field(default_factory=dict, compare=False)
    outputs: Mapping[str, float | None] = field(default_factory=dict)  # outputs that a study defines, by name

    @classmethod
    def failed_start(cls, reason: str) -> "FlightRow":
        """Return the results of a flight that could not start for a `reason`: empty, with `met` False."""
        return cls([], {}, [], met=False, reason=reason)


CLEARANCE_MIN_M = {"surface": SURFACE_STAND_OFF_MIN_M, "airborne": AIRBORNE_STAND_OFF_MIN_M}
"""Least distance required from a goal, m, by kind of goal; the same in every scenario."""


def build_flight_row(
    summary: FleetSummary,  # summary of one flight; its arrays must not be traced by JAX
    planned_s: Sequence[float] | np.ndarray,  # arrival times of the last plan, s; shape (aircraft,)
    scenario: Scenario,
    end_s: float | None = None,  # end of the record, s; None: the scenario's duration
    goals: Sequence[str] = (),  # name of the final goal by aircraft, if goals were reassigned
    # kind of a goal, and the least distance, m, of an aircraft from it while the aircraft flew to it; None: each
    # aircraft flew to the scenario's goal, and the distances are the summary's
    clearances: Sequence[tuple[str, float]] | None = None,
) -> FlightRow:
    """Compute the results of one flight from its summary; `series` and `outputs` of the result stay empty."""
    end_s = scenario.timing.duration_s if end_s is None else end_s
    aircraft = [_aircraft_entry(summary, k, float(planned_s[k]), scenario, end_s) for k in range(len(planned_s))]
    for entry, goal in zip(aircraft, goals, strict=bool(goals)):
        entry["goal"] = goal
    arrivals = [entry["arrival_s"] for entry in aircraft if "left_s" not in entry]
    fleet = {
        "arrival_spread_s": None if not arrivals or None in arrivals else max(arrivals) - min(arrivals),
        "separation_min_m": finite_or_none(summary.separation_min),
    }
    if scenario.separation.required_m is not None:
        fleet["separation_ratio_min"] = finite_or_none(summary.separation_ratio_min)
    if clearances is None:
        kinds = {goal.name: goal.kind for goal in scenario.goal}
        clearances = [
            (kinds[config.goal], float(least))
            for config, least in zip(scenario.aircraft, summary.clearance_min[: len(aircraft)], strict=True)
        ]
    required = [(kind, finite_or_none(least), CLEARANCE_MIN_M[kind]) for kind, least in clearances]
    requirements = evaluate_requirements(scenario_requirements(scenario), aircraft, fleet, required)
    has_arrived = all(entry["status"] == ARRIVED or "left_s" in entry for entry in aircraft)
    is_met = has_arrived and all(config["met"] for config in requirements)
    return FlightRow(aircraft, fleet, requirements, is_met)


def _aircraft_entry(
    summary: FleetSummary, index: int, planned_s: float, scenario: Scenario, end_s: float
) -> dict[str, Any]:
    config, first_status = scenario.aircraft[index], int(summary.first_status[index])
    off_plan_s = float(summary.off_plan_time[index])
    approach = arrival_outcome(
        (float(summary.pass_time[index]), float(summary.pass_distance[index])),
        planned_s,
        off_plan_s,
        end_s,
        (first_status, int(summary.last_status[index])),
    )
    speeds, error_max = summary.speeds_on_plan, summary.position_error_on_plan
    if approach.is_arrival:
        speeds, error_max = summary.speeds_until_pass, summary.position_error_until_pass
    duration_s, speed_min = approach.approach_end_s, speeds.minimum[index]
    has_left = first_status == LEFT_FLEET and not approach.is_arrival
    return {
        **({"left_s": off_plan_s} if has_left else {}),
        "name": config.name,
        "goal": config.goal,
        "planned_arrival_s": None if has_left else finite_or_none(planned_s),
        "arrival_s": None if has_left else finite_or_none(approach.time_s),
        "miss_m": None if has_left else finite_or_none(approach.miss_m),
        "speed_mean_m_s": finite_or_none(speeds.integral[index] / duration_s if duration_s > 0.0 else speed_min),
        "speed_min_m_s": finite_or_none(speed_min),
        "speed_max_m_s": finite_or_none(speeds.maximum[index]),
        "clearance_min_m": finite_or_none(summary.clearance_min[index]),
        "tables_left_s": finite_or_none(summary.tables_left_time[index]),
        **({"keep_out_room_min_m": finite_or_none(summary.keep_out_room_min[index])} if scenario.has_keep_outs else {}),
        "position_error_max_m": finite_or_none(error_max[index]),
        "status": approach.status,
    }


def goals_over_time(summary: Mapping[str, Any], scenario: Mapping[str, Any]) -> list[list[tuple[str, float]]]:
    """Return the goals of each aircraft in order of time, as (name of the goal, time of the assignment, s)."""
    assigned = {str(entry["name"]): str(entry["goal"]) for entry in scenario.get("aircraft") or [] if "goal" in entry}
    goals = {
        str(entry["name"]): [(assigned.get(entry["name"], str(entry["goal"])), 0.0)] for entry in summary["aircraft"]
    }
    for entry in summary.get("events", ()):
        if "goal" in entry:
            goals[str(entry["whom"])].append((str(entry["goal"]), float(entry["time_s"])))
    return list(goals.values())


AIRCRAFT_QUANTITIES = {
    "planned_arrival_s": ("s", "Planned arrival in the last plan"),
    "arrival_s": ("s", "Arrival; missing if the aircraft never arrived"),
    "miss_m": ("m", "Distance from the rendezvous at the arrival"),
    "speed_mean_m_s": ("m s-1", "Mean airspeed up to the arrival"),
    "speed_min_m_s": ("m s-1", "Least airspeed up to the arrival"),
    "speed_max_m_s": ("m s-1", "Greatest airspeed up to the arrival"),
    "clearance_min_m": ("m", "Least distance to the goal"),
    "position_error_max_m": ("m", "Greatest distance from the planned position while the plan is flown"),
    "tables_left_s": ("s", "Time outside the tables of the airframe"),
    "keep_out_room_min_m": ("m", "Least distance outside the keep-outs; missing without one"),
}
FLEET_QUANTITIES = {
    "arrival_spread_s": ("s", "Time between the first and the last arrival"),
    "separation_min_m": ("m", "Least distance between two aircraft"),
    "separation_ratio_min": ("1", "Least ratio of distance to required separation"),
}

FlightColumn = tuple[tuple[str, ...], np.ndarray, dict[str, Any]]
"""A quantity of many flights: dimensions, values, and attributes of the quantity (unit, long name).

The dimensions are those of one flight's value (none, or `aircraft`); the values have a leading axis over flights."""


def tabulate_flights(
    flights: Sequence[FlightRow],  # results of flights with the same fleet
    aircraft: int,  # number of aircraft
    outputs: Mapping[str, tuple[str, str]] = MappingProxyType({}),  # (unit, description) of a study's outputs by name
) -> dict[str, FlightColumn]:
    """Arrange the results of many flights as one column per quantity, by name.

    A flight that could not start has NaN, the status "no flight" for each aircraft, and the reason as text.
    """

    def aircraft_values(key: str, missing: Any) -> np.ndarray:
        none = [missing] * aircraft
        return np.array(
            [[_or_missing(entry.get(key), missing) for entry in flight.aircraft] or none for flight in flights]
        )

    columns: dict[str, FlightColumn] = {
        key: (("aircraft",), aircraft_values(key, np.nan).astype(float), unit_attributes(*labels))
        for key, labels in AIRCRAFT_QUANTITIES.items()
    }
    status_labels = unit_attributes("", "Status at the end of the flight")
    columns["status"] = (("aircraft",), aircraft_values("status", "no flight").astype(np.str_), status_labels)
    for key, labels in FLEET_QUANTITIES.items():
        values = np.array([_or_missing(result.fleet.get(key), np.nan) for result in flights], dtype=float)
        columns[key] = ((), values, unit_attributes(*labels))
    for key, labels in outputs.items():
        values = np.array([_or_missing(result.outputs.get(key), np.nan) for result in flights], dtype=float)
        columns[key] = ((), values, unit_attributes(*labels))
    met_labels = unit_attributes("1", "Whether all arrived and every requirement is met")
    columns["met"] = ((), np.array([result.met for result in flights], dtype=bool), met_labels)
    unmet = [
        ", ".join(requirement["name"] for requirement in result.requirements if not requirement["met"])
        for result in flights
    ]
    columns["unmet"] = ((), np.array(unmet, dtype=np.str_), unit_attributes("", "Requirements that are not met"))
    reason_labels = unit_attributes("", "Reason for a failed start; empty otherwise")
    columns["reason"] = ((), np.array([result.reason for result in flights], dtype=np.str_), reason_labels)
    return columns


def applicable_quantities(names: Iterable[str], dataset: "xr.Dataset") -> tuple[str, ...]:
    """Return the `names` that a dataset of flights has, in order.

    Quantities of the fleet (`FLEET_QUANTITIES`: arrival spread, separation) are left out for a single aircraft.
    """
    given = [name for name in names if name in dataset]
    return tuple(name for name in given if name not in FLEET_QUANTITIES or dataset.sizes["aircraft"] > 1)


def worst_of_fleet(
    # columns of flights: a dataset, or arrays by name, with `met`, `miss_m` (NaN for a missing arrival) and the
    # quantity
    columns: "xr.Dataset | Mapping[str, np.ndarray]",
    name: str,  # name of a quantity with dimensions (flight) or (flight, aircraft); NaN for missing values
    *,
    upper: bool = True,  # True: larger values are worse
) -> np.ndarray:
    """Return the worst value of each flight over the aircraft, shape (flights,): maximum, or minimum if not `upper`.

    - Flight that missed a requirement: inf (-inf if not `upper`) if an aircraft has no arrival or no value
    - Flight that met every requirement: missing values are ignored; -inf (inf if not `upper`) if all are missing
    - Output of a study: inf (-inf if not `upper`) if the value is missing, also in a flight that met every requirement
    """
    # A crash far from the goal must not improve the least distance: a missing value of a failed flight is the worst. In
    # a successful flight, a quantity is missing where it does not apply (an aircraft that left); an output always does.
    is_output = name not in AIRCRAFT_QUANTITIES and name not in FLEET_QUANTITIES
    values, is_met = np.asarray(columns[name]), np.asarray(columns["met"])
    has_arrived = is_met | ~np.isnan(np.asarray(columns["miss_m"])).any(axis=-1)
    badness = (values if upper else -values).reshape(values.shape[0], math.prod(values.shape[1:]))
    missing = np.where(is_met & (not is_output), -np.inf, np.inf)[:, None]
    worst = np.where(has_arrived, np.max(np.where(np.isnan(badness), missing, badness), axis=1), np.inf)
    return worst if upper else -worst


def _or_missing(value: Any, missing: Any) -> Any:
    return missing if value is None else value
