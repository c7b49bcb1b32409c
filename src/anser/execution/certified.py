"""Planning a scenario with the certified planner, or saying why no plan exists."""

import dataclasses
import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from jaxtyping import Array

from anser.compiling import Prepared, compiled_quickly, enable_compilation_cache
from anser.execution.plan_interface import SPEED_TOLERANCE, Ahead, NoPlanError, Planned
from anser.execution.refusal import explain, explain_missing_holds
from anser.execution.untrimmable import refuse_untrimmable
from anser.numerics import AbstractRandomness, as_array, leading
from anser.planning import turn_words
from anser.planning.certified import FIRST, AircraftTask, Airspace, ArrivalRequest, CertifiedPlan, FleetTask, Outcome
from anser.scenario import Scenario, build_flight
from anser.simulation import (
    CertifiedPlanner,
    CertifiedPlanState,
    Flight,
    FlightState,
    PlannedHolds,
    TrimmedFleet,
    begin,
    trimmed_fleet,
)

trimmed = compiled_quickly(trimmed_fleet)
"""`trimmed_fleet`, compiled."""
begun = compiled_quickly(begin)
"""`begin`, compiled."""


@compiled_quickly
def asked(flight: Flight, planner: CertifiedPlanner) -> tuple[TrimmedFleet, AircraftTask]:
    """The fleet trimmed at its start, and what is asked of the planner for it."""
    fleet = trimmed_fleet(flight)
    return fleet, planner.aircraft_tasks(fleet.reports, planner.limits_with(fleet.performance))


def first_renewal() -> Array:
    """That a plan is the first: index into `RENEWAL_MESSAGES`."""
    return as_array(FIRST, np.int64)


NOT_PROVEN = "nothing proves that it keeps its limits, the separation and the keep-outs"
"""Message of a path that the certified planner delivers without a proof."""


@dataclass(frozen=True, repr=False)
class CertifiedPlanned(Planned):
    """What came of planning a scenario with the certified planner.

    Attributes
    ----------
    outcome
        Of the search.
    all_tasks, airspace
        What was asked of the planner.
    holds
        What the aircraft fly after their arrivals; None where there is no plan.

    Notes
    -----
    Outcome, all tasks and holds are of all aircraft of the flight, those that only fill it up among them.
    """

    outcome: Outcome
    all_tasks: AircraftTask
    airspace: Airspace
    holds: PlannedHolds | None

    @functools.cached_property
    def tasks(self) -> AircraftTask:
        """What was asked of the scenario's aircraft; leading axis aircraft."""
        return leading(self.all_tasks, len(self.scenario.aircraft))

    @functools.cached_property
    def plan(self) -> CertifiedPlan:
        """The plan; raises `NoPlanError` if there is none: the message says why."""
        if self.outcome.plan is None:
            raise NoPlanError(self.refusals)
        return self.outcome.plan.leading(len(self.scenario.aircraft))

    def problems(self) -> tuple[str, ...]:
        """Why there is no plan, or why it cannot be flown as it stands, one sentence each; empty where it can."""
        if self.outcome.plan is None:
            return self.refusals
        return not_proven(self.scenario, np.asarray(self.plan.feasible))

    def notes(self) -> tuple[str, ...]:
        """Where the plan differs from what the scenario prefers, the mean airspeed, in one sentence; or nothing."""
        if self.outcome.plan is None:
            return ()
        asked_m_s = np.array([self.scenario.speed_for(one) for one in self.scenario.aircraft])
        plan = self.plan
        found_m_s = np.asarray(plan.lengths) / np.asarray(plan.arrival_times)
        others = np.flatnonzero(np.abs(found_m_s / asked_m_s - 1.0) > SPEED_TOLERANCE)
        if not others.size:
            return ()
        names = ", ".join(f"{self.scenario.aircraft[k].name} {found_m_s[k]:.1f} m/s" for k in others)
        if np.ptp(asked_m_s) > 0.0:
            return (f"mean airspeeds other than preferred: {names}",)
        return (f"mean airspeeds other than the preferred fleet.speed_m_s = {asked_m_s[0]:g} m/s: {names}",)

    def path_words(self) -> tuple[str, ...]:
        """How the path of each aircraft goes, such as "turns 83 deg"."""
        return tuple(turn_words(math.degrees(float(turned))) for turned in np.asarray(self.plan.turned))

    def begun(self) -> FlightState:
        """The fleet at its start, with the plan."""
        if self.outcome.plan is None:
            raise NoPlanError(self.refusals)
        state = CertifiedPlanState(self.outcome.plan, first_renewal(), self.holds, self.all_tasks.limits)
        return begun(self.flight, self.fleet, state)


def not_proven(scenario: Scenario, feasible: np.ndarray) -> tuple[str, ...]:
    """Whose paths are delivered without a proof, one sentence each."""
    pairs = zip(scenario.aircraft, feasible, strict=True)
    return tuple(f'aircraft "{one.name}": {NOT_PROVEN}' for one, good in pairs if not good)


def arrival_request(scenario: Scenario, count: int | None = None) -> ArrivalRequest:
    """When the aircraft of a scenario are to arrive; of a count of them, with the last repeated."""
    arrival, aircraft = scenario.arrival, scenario.aircraft
    times = offsets = windows = None
    if arrival.rule == "at":
        times = np.full(len(aircraft), arrival.time_s)
    if arrival.rule == "times":
        times = np.array([one.arrive_s for one in aircraft], dtype=float)
    if arrival.rule == "windows":
        windows = np.array([(one.arrive_from_s, one.arrive_to_s) for one in aircraft], dtype=float)
    if arrival.rule == "sequence":
        names = arrival.order if arrival.order is not None else tuple(one.name for one in aircraft)
        assert arrival.spacing_s is not None
        offsets = np.array([names.index(one.name) for one in aircraft]) * arrival.spacing_s
    more = 0 if count is None else count - len(aircraft)
    rows = (None if own is None else np.concatenate([own, *[own[-1:]] * more]) for own in (times, offsets, windows))
    return ArrivalRequest(arrival.rule, scenario.timing.latest_arrival_s, *rows)


def drawing_from(source: AbstractRandomness | None, flight: Flight) -> Flight:
    """A flight that draws its random numbers from another source; None: as it is."""
    return flight if source is None else dataclasses.replace(flight, randomness=source)


def plan_certified(
    scenario: Scenario,
    on_progress: Callable[[str], None] = lambda what: None,
    ahead: Ahead = lambda *of: None,
    randomness: AbstractRandomness | None = None,
) -> CertifiedPlanned:
    """Trim every aircraft, look for a plan that keeps everything, and where none is found say why.

    Parameters
    ----------
    scenario
        With `fleet.planner = "certified"`.
    on_progress, ahead, randomness
        As of `anser.plan`.

    Raises
    ------
    ScenarioError
        If an aircraft cannot fly steadily at its start.
    """
    enable_compilation_cache()
    on_progress("trimming")
    flight, count = drawing_from(randomness, build_flight(scenario, filled_up=True)), len(scenario.aircraft)
    planner = cast(CertifiedPlanner, flight.planner)
    start = asked.prepare(flight, planner).begin()
    for program in _programs_ahead(scenario, flight, planner, start.shapes, ahead):
        program.begin()
    fleet, tasks = asked(flight, planner)
    refuse_untrimmable(scenario, flight, fleet.steady)
    request = arrival_request(scenario, flight.count)
    outcome, holds = planner.searched(0.0, tasks, request, scenario.timing.duration_s, on_progress)
    refusals: tuple[str, ...] = ()
    if outcome.plan is None:
        on_progress("looking for what stands in the way")
        wanted = FleetTask(leading(tasks, count), planner.airspace, arrival_request(scenario))
        refusals = (
            explain(scenario, wanted, outcome.leading(count))
            if holds is None
            else explain_missing_holds(scenario, wanted, holds)
        )
        holds = None
    return CertifiedPlanned(scenario, flight, fleet, refusals, outcome, tasks, planner.airspace, holds)


def _programs_ahead(
    scenario: Scenario, flight: Flight, planner: CertifiedPlanner, shapes: Any, ahead: Ahead
) -> Iterator[Prepared]:
    """Prepare what will be needed, as far as the shapes of fleet and tasks tell; the last is what comes `ahead`."""
    fleet, tasks = shapes
    longest_s = max(
        math.dist(one.start.position_m, scenario.goal_of(one).position_m(0.0))
        / min(scenario.speed_for(one), scenario.limits_for(one).speed_max_m_s)
        for one in scenario.aircraft
    )
    given_s = [one.arrive_s for one in scenario.aircraft if one.arrive_s is not None] + [scenario.arrival.time_s or 0.0]
    longest_s = max(longest_s, *given_s)
    found = []
    for program in planner.programs_ahead(tasks, longest_s, scenario.timing.duration_s):
        found.append(program.shapes)
        yield program
    if found:
        plan, holds = found
        program = begun.prepare(flight, fleet, CertifiedPlanState(plan, first_renewal(), holds, tasks.limits))
        yield program
        following = ahead(flight, program.shapes)
        if following is not None:
            yield following
