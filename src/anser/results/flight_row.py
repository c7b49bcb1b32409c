"""What is told of one flight of many: the same numbers as in `summary.json`, from the running summary."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from anser.results.arrival import ARRIVED, arrival_outcome
from anser.results.plain import finite_or_none
from anser.results.requirements import judge, requirements_of
from anser.results.summary import CLEARANCE_MIN_M
from anser.scenario import Scenario
from anser.simulation import FleetSummary
from anser.simulation.status import LEFT


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
    def failed(cls, reason: str) -> "FlightRow":
        """Of a flight that could not begin."""
        return cls([], {}, [], met=False, reason=reason)


def flight_row(summary: FleetSummary, planned_s: np.ndarray, scenario: Scenario) -> FlightRow:
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
        left = int(summary.first_status[k]) == LEFT
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
        mean = float(speeds.integral[k]) / approach.flown_s if approach.flown_s > 0.0 else float(speeds.least[k])
        aircraft.append(
            {
                "name": one.name,
                "goal": one.goal,
                "planned_arrival_s": None if left else finite_or_none(float(planned_s[k])),
                "arrival_s": None if left else finite_or_none(approach.time_s),
                "miss_m": None if left else finite_or_none(approach.miss_m),
                "speed_mean_m_s": finite_or_none(mean),
                "speed_min_m_s": finite_or_none(float(speeds.least[k])),
                "speed_max_m_s": finite_or_none(float(speeds.greatest[k])),
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
    if scenario.separation.asked_m is not None:
        fleet["separation_ratio_min"] = finite_or_none(float(summary.separation_ratio_min))
    kinds = [scenario.goal_of(one).kind for one in scenario.aircraft]
    requirements = judge(requirements_of(scenario), aircraft, fleet, [(kind, CLEARANCE_MIN_M[kind]) for kind in kinds])
    met = all(row["status"] == ARRIVED for row in aircraft) and all(one["met"] for one in requirements)
    return FlightRow(aircraft, fleet, requirements, met)
