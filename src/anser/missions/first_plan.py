"""The first plan of a scenario: its interface for people, and first plans by the certified planner."""

import abc
import dataclasses
import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from jaxtyping import Array

from anser.compiling.options import compiled_quickly, enable_compilation_cache
from anser.compiling.program import PreparedProgram
from anser.missions.refusal import diagnose_missing_holds, diagnose_refusal
from anser.numerics.arrays import as_array, first_rows, unstack_rows
from anser.numerics.randomness import AbstractRandomness
from anser.planning.certified.certified_plan import CertifiedPlan
from anser.planning.certified.planner import CertifiedPlanner, CertifiedPlanState
from anser.planning.certified.replanning import FIRST_PLAN
from anser.planning.certified.search import FleetTask, SearchOutcome
from anser.planning.certified.task import AircraftTask, Airspace, ArrivalRequest
from anser.planning.holds.hold_paths import PlannedHolds
from anser.planning.limits import describe_turns
from anser.scenario.build import build_flight
from anser.scenario.flight_checks import check_trimmable
from anser.scenario.schema import Scenario
from anser.simulation.flight import Flight, FlightState
from anser.simulation.start import TrimmedFleet, initialize_flight, trimmed_fleet
from anser.steady.trim import TrimPoint

SPEED_TOLERANCE = 1e-3
"""Part of the fleet's speed by which a mean airspeed may differ without a note."""


PrepareNext = Callable[[Flight, Any], PreparedProgram | None]
"""Prepares the program that is needed after the plan, for a flight and the shapes of its first state."""


class NoPlanError(Exception):
    """The certified planner found no plan; `reasons` says why, one sentence each."""

    def __init__(self, reasons: tuple[str, ...]) -> None:
        super().__init__("; ".join(reasons))
        self.reasons = reasons


class PlanFileError(ValueError):
    """A file that holds no plan, or not one for the scenario."""


@dataclass(frozen=True, repr=False)
class FirstPlan(abc.ABC):
    """The first plan of a scenario; printed, it is when the aircraft arrive and what is wrong.

    Attributes
    ----------
    scenario
        What was planned.
    flight
        Its arrays, filled up to a size with aircraft that never fly.
    fleet
        All of these, trimmed at the start.
    refusals
        Why there is no plan, one sentence each; empty where there is one.
    """

    scenario: Scenario
    flight: Flight
    fleet: TrimmedFleet
    refusals: tuple[str, ...]

    @property
    def trims(self) -> tuple[TrimPoint, ...]:
        """Steady flight of each aircraft at its start."""
        of_kinds = zip(self.flight.groups, self.fleet.trims, strict=True)
        found = {
            place: one for kind, rows in of_kinds for place, one in zip(kind.members, unstack_rows(rows), strict=True)
        }
        return tuple(found[place] for place in range(len(self.scenario.aircraft)))

    @functools.cached_property
    @abc.abstractmethod
    def plan(self) -> Any:
        """The planner's own plan; raises `NoPlanError` if there is none."""

    @abc.abstractmethod
    def problems(self) -> tuple[str, ...]:
        """Why there is no plan, or why it cannot be flown as it stands, one sentence each; empty where it can."""

    @abc.abstractmethod
    def notes(self) -> tuple[str, ...]:
        """Where the plan differs from the scenario's words, one sentence each."""

    @abc.abstractmethod
    def path_descriptions(self) -> tuple[str, ...]:
        """How the path of each aircraft goes, in two or three words."""

    @abc.abstractmethod
    def initial_state(self) -> FlightState:
        """The fleet at its start, with the plan."""

    def saved_state(self) -> Any:
        """What a file keeps of it: arrays in a module."""
        return self.initial_state().planner

    def __repr__(self) -> str:
        return "\n  ".join([self._head(), *self._told()])

    def _repr_html_(self) -> str:
        from anser.results.documents import notebook_table

        rows = []
        if not self.refusals:
            arrivals = np.broadcast_to(np.asarray(self.plan.arrival_times), len(self.scenario.aircraft))
            rows = [
                {"aircraft": one.name, "goal": one.goal, "arrives at, s": f"{float(time):.2f}", "path": words}
                for one, time, words in zip(self.scenario.aircraft, arrivals, self.path_descriptions(), strict=True)
            ]
        return notebook_table(self._head(), rows, self._told())

    def _head(self) -> str:
        head = f"{self.scenario.name}, {self.scenario.fleet.planner} planner: "
        if self.refusals:
            return f"{head}no plan"
        from anser.results.arrival import format_planned_arrivals

        arrivals_s = np.asarray(self.plan.arrival_times)
        first_s, last_s = (float(end(arrivals_s)) for end in (np.min, np.max))
        return head + format_planned_arrivals(len(self.scenario.aircraft), first_s, last_s)

    def _told(self) -> list[str]:
        """What is wrong with it, and what is to be noted."""
        problems = self.problems() if self.refusals else [f"not flyable: {one}" for one in self.problems()]
        return [*problems, *(f"note: {one}" for one in self.notes())]


trim_at_start = compiled_quickly(trimmed_fleet)
"""`trimmed_fleet`, compiled."""
initialize_compiled = compiled_quickly(initialize_flight)
"""`begin`, compiled."""


@compiled_quickly
def trim_and_build_tasks(flight: Flight, planner: CertifiedPlanner) -> tuple[TrimmedFleet, AircraftTask]:
    """The fleet trimmed at its start, and what is asked of the planner for it."""
    fleet = trimmed_fleet(flight)
    return fleet, planner.aircraft_tasks(fleet.reports, planner.resolve_limits(fleet.performance))


def first_plan_status() -> Array:
    """That a plan is the first: index into `REPLANNING_MESSAGES`."""
    return as_array(FIRST_PLAN, np.int64)


UNPROVEN = "nothing proves that it keeps its limits, the separation and the keep-outs"
"""Message of a path that the certified planner delivers without a proof."""


@dataclass(frozen=True, repr=False)
class CertifiedFirstPlan(FirstPlan):
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

    outcome: SearchOutcome
    padded_tasks: AircraftTask
    airspace: Airspace
    holds: PlannedHolds | None

    @functools.cached_property
    def tasks(self) -> AircraftTask:
        """What was asked of the scenario's aircraft; leading axis aircraft."""
        return first_rows(self.padded_tasks, len(self.scenario.aircraft))

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
        return unproven_paths(self.scenario, np.asarray(self.plan.feasible))

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

    def path_descriptions(self) -> tuple[str, ...]:
        """How the path of each aircraft goes, such as "turns 83 deg"."""
        return tuple(describe_turns(math.degrees(float(turned))) for turned in np.asarray(self.plan.total_turn))

    def initial_state(self) -> FlightState:
        """The fleet at its start, with the plan."""
        if self.outcome.plan is None:
            raise NoPlanError(self.refusals)
        state = CertifiedPlanState(self.outcome.plan, first_plan_status(), self.holds, self.padded_tasks.limits)
        return initialize_compiled(self.flight, self.fleet, state)


def unproven_paths(scenario: Scenario, feasible: np.ndarray) -> tuple[str, ...]:
    """Whose paths are delivered without a proof, one sentence each."""
    pairs = zip(scenario.aircraft, feasible, strict=True)
    return tuple(f'aircraft "{one.name}": {UNPROVEN}' for one, good in pairs if not good)


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


def with_randomness(source: AbstractRandomness | None, flight: Flight) -> Flight:
    """A flight that draws its random numbers from another source; None: as it is."""
    return flight if source is None else dataclasses.replace(flight, randomness=source)


def plan_certified(
    scenario: Scenario,
    on_progress: Callable[[str], None] = lambda what: None,
    prepare_next: PrepareNext = lambda *of: None,
    randomness: AbstractRandomness | None = None,
) -> CertifiedFirstPlan:
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
    flight, count = with_randomness(randomness, build_flight(scenario, pad_fleet=True)), len(scenario.aircraft)
    planner = cast(CertifiedPlanner, flight.planner)
    start = trim_and_build_tasks.prepare(flight, planner).start()
    for program in _prepare_programs(scenario, flight, planner, start.shapes, prepare_next):
        program.start()
    fleet, tasks = trim_and_build_tasks(flight, planner)
    check_trimmable(scenario, flight, fleet.is_trimmed)
    request = arrival_request(scenario, flight.count)
    outcome, holds = planner.search_plan(0.0, tasks, request, scenario.timing.duration_s, on_progress)
    refusals: tuple[str, ...] = ()
    if outcome.plan is None:
        on_progress("looking for what stands in the way")
        wanted = FleetTask(first_rows(tasks, count), planner.airspace, arrival_request(scenario))
        refusals = (
            diagnose_refusal(scenario, wanted, outcome.leading(count))
            if holds is None
            else diagnose_missing_holds(scenario, wanted, holds)
        )
        holds = None
    return CertifiedFirstPlan(scenario, flight, fleet, refusals, outcome, tasks, planner.airspace, holds)


def _prepare_programs(
    scenario: Scenario, flight: Flight, planner: CertifiedPlanner, shapes: Any, prepare_next: PrepareNext
) -> Iterator[PreparedProgram]:
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
    for program in planner.prepare_programs(tasks, longest_s, scenario.timing.duration_s):
        found.append(program.shapes)
        yield program
    if found:
        plan, holds = found
        program = initialize_compiled.prepare(
            flight, fleet, CertifiedPlanState(plan, first_plan_status(), holds, tasks.limits)
        )
        yield program
        following = prepare_next(flight, program.shapes)
        if following is not None:
            yield following
