"""The first plan of a scenario: common interface, and first plans by the certified planner."""

import abc
import dataclasses
import functools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np
from jaxtyping import Array

from anser.compiling.options import compiled_quickly
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

if TYPE_CHECKING:
    from anser.missions.plan_output import RecordedPlan

SPEED_TOLERANCE = 1e-3
"""Relative difference from the preferred airspeed above which a mean airspeed is mentioned in the notes."""


OnProgress = Callable[[str], None]
"""Callback with a description of the current work."""
Randomness = AbstractRandomness | None
PrepareNext = Callable[[Flight, Any], PreparedProgram | None]
"""Callback that prepares the program needed after planning, from a flight and the shapes of its first state."""


class NoPlanError(Exception):
    """No plan was found; `reasons` has one sentence for each reason."""

    def __init__(self, reasons: tuple[str, ...]) -> None:
        super().__init__("; ".join(reasons))
        self.reasons = reasons


class PlanFileError(ValueError):
    """The file contains no plan, is damaged, or contains the plan of another scenario."""


@dataclass(frozen=True, repr=False)
class FirstPlan(abc.ABC):
    """The first plan of a scenario, made before the flight; the printed form lists arrival times and problems.

    Attributes
    ----------
    scenario
        Planned scenario.
    flight
        Arrays of the flight, padded with inactive aircraft to a multiple of a fixed size.
    fleet
        The aircraft of `flight`, trimmed at the start.
    refusals
        Reasons for a missing plan, one sentence each; empty if a plan exists.
    """

    scenario: Scenario
    flight: Flight
    fleet: TrimmedFleet
    refusals: tuple[str, ...]
    state_type: ClassVar[type]
    """Type of `saved_state`, by which a plan file is read."""

    @property
    def trims(self) -> tuple[TrimPoint, ...]:
        """Trimmed steady flight of each aircraft at its start."""
        groups = zip(self.flight.groups, self.fleet.trims, strict=True)
        trims = {
            position: trim
            for kind, stacked_trims in groups
            for position, trim in zip(kind.members, unstack_rows(stacked_trims), strict=True)
        }
        return tuple(trims[position] for position in range(len(self.scenario.aircraft)))

    @classmethod
    @abc.abstractmethod
    def make(
        cls, scenario: Scenario, on_progress: OnProgress, prepare_next: PrepareNext, randomness: Randomness
    ) -> "FirstPlan":
        """Trim every aircraft at its start and plan; parameters and errors as in `anser.plan`."""

    @classmethod
    @abc.abstractmethod
    def restore(cls, scenario: Scenario, flight: Flight, fleet: TrimmedFleet, state: Any) -> "FirstPlan":
        """Rebuild the first plan from a trimmed fleet and the content of a plan file (`state`)."""

    @functools.cached_property
    @abc.abstractmethod
    def plan(self) -> Any:
        """The planner's plan; raises `NoPlanError` if there is no plan."""

    @abc.abstractmethod
    def problems(self) -> tuple[str, ...]:
        """Reasons for a missing plan, or obstacles to flying the plan, one sentence each; empty for a flyable plan."""

    @abc.abstractmethod
    def notes(self) -> tuple[str, ...]:
        """Differences between the plan and the request of the scenario, one sentence each."""

    @abc.abstractmethod
    def path_descriptions(self) -> tuple[str, ...]:
        """Shape of each aircraft's path in two or three words."""

    @abc.abstractmethod
    def initial_state(self) -> FlightState:
        """State of the fleet at the start of the flight, with the plan."""

    @abc.abstractmethod
    def saved_state(self) -> Any:
        """Return the content of a plan file: a module of arrays. Raises `NoPlanError` if there is no plan."""

    @abc.abstractmethod
    def record(self) -> "RecordedPlan":
        """Sample and summarize the plan. Raises `NoPlanError` if there is no plan."""

    def network_summary(self, time_s: np.ndarray, history: Mapping[str, np.ndarray]) -> dict[str, Any] | None:
        """Compute the entry `network` of a flight's summary; None for a fleet with a central planner."""
        return None

    @property
    def arrivals_s(self) -> np.ndarray:
        """Planned arrival time of each aircraft, s."""
        return np.broadcast_to(np.asarray(self.plan.arrival_times), len(self.scenario.aircraft))

    @property
    def arrival_s(self) -> float:
        """Planned arrival time of the last aircraft, s."""
        return float(np.max(self.arrivals_s))

    def __repr__(self) -> str:
        return "\n  ".join([self._head(), *self._problems_and_notes()])

    def _repr_html_(self) -> str:
        from anser.results.documents import notebook_table

        table = []
        if not self.refusals:
            table = [
                {"aircraft": aircraft.name, "goal": aircraft.goal, "arrives at, s": f"{float(time):.2f}", "path": path}
                for aircraft, time, path in zip(
                    self.scenario.aircraft, self.arrivals_s, self.path_descriptions(), strict=True
                )
            ]
        return notebook_table(self._head(), table, self._problems_and_notes())

    def _head(self) -> str:
        head = f"{self.scenario.name}, {self.scenario.fleet.planner} planner: "
        if self.refusals:
            return f"{head}no plan"
        from anser.results.arrival import format_planned_arrivals

        return head + format_planned_arrivals(
            len(self.scenario.aircraft), float(np.min(self.arrivals_s)), self.arrival_s
        )

    def _problems_and_notes(self) -> list[str]:
        """Problems and notes, one line each."""
        problems = self.problems() if self.refusals else [f"not flyable: {problem}" for problem in self.problems()]
        return [*problems, *(f"note: {note}" for note in self.notes())]


trim_at_start = compiled_quickly(trimmed_fleet)
"""`trimmed_fleet`, compiled."""


@compiled_quickly
def initialize_compiled(flight: Flight, fleet: TrimmedFleet, plan_state: Any) -> FlightState:
    """State of a flight at time 0 with the planner's first state `plan_state`, computed by a compiled program."""
    return initialize_flight(flight, fleet, flight.planner.initial_state(plan_state, flight.randomness))


@compiled_quickly
def trim_and_build_tasks(flight: Flight, planner: CertifiedPlanner) -> tuple[TrimmedFleet, AircraftTask]:
    """Trim the fleet at its start and build the planning tasks."""
    fleet = trimmed_fleet(flight)
    return fleet, planner.aircraft_tasks(fleet.reports, planner.resolve_limits(fleet.performance))


def first_plan_status() -> Array:
    """Status that marks a first plan: index into `REPLANNING_MESSAGES`."""
    return as_array(FIRST_PLAN, np.int64)


UNPROVEN = "nothing proves that it keeps its limits, the separation and the keep-outs"
"""Message for a path that is delivered although the certificate does not prove it."""


@dataclass(frozen=True, repr=False)
class CertifiedFirstPlan(FirstPlan):
    """The first plan of a scenario by the certified planner.

    Notes
    -----
    Outcome, padded tasks and holds contain all aircraft of `flight`, the padding included.
    """

    state_type = CertifiedPlanState
    outcome: SearchOutcome  # result of the search
    # input of the search
    padded_tasks: AircraftTask
    airspace: Airspace
    holds: PlannedHolds | None  # paths after the arrivals; None without a plan

    @classmethod
    def make(
        cls, scenario: Scenario, on_progress: OnProgress, prepare_next: PrepareNext, randomness: Randomness
    ) -> "CertifiedFirstPlan":
        """Trim every aircraft and search for a certified plan; if none is found, diagnose the reasons (`refusals`)."""
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
            on_progress("diagnosing the refusal")
            fleet_task = FleetTask(first_rows(tasks, count), planner.airspace, arrival_request(scenario))
            refusals = (
                diagnose_refusal(scenario, fleet_task, outcome.leading(count))
                if holds is None
                else diagnose_missing_holds(scenario, fleet_task, holds)
            )
            holds = None
        return cls(scenario, flight, fleet, refusals, outcome, tasks, planner.airspace, holds)

    @classmethod
    def restore(cls, scenario: Scenario, flight: Flight, fleet: TrimmedFleet, state: Any) -> "CertifiedFirstPlan":
        """Rebuild the first plan from a trimmed fleet and the content of a plan file (`state`)."""
        return cls(*restored_arguments(scenario, flight, fleet, state, cast(CertifiedPlanner, flight.planner)))

    @functools.cached_property
    def tasks(self) -> AircraftTask:
        """Planning tasks of the scenario's aircraft; leading axis aircraft."""
        return first_rows(self.padded_tasks, len(self.scenario.aircraft))

    @functools.cached_property
    def plan(self) -> CertifiedPlan:
        """The plan; raises `NoPlanError` with the reasons if there is no plan."""
        if self.outcome.plan is None:
            raise NoPlanError(self.refusals)
        return self.outcome.plan.leading(len(self.scenario.aircraft))

    def problems(self) -> tuple[str, ...]:
        """Reasons for a missing plan, or unproven paths, one sentence each."""
        if self.outcome.plan is None:
            return self.refusals
        return unproven_paths(self.scenario, np.asarray(self.plan.feasible))

    def notes(self) -> tuple[str, ...]:
        """Mean airspeeds that differ from the preferred airspeeds, in one sentence; empty without a difference."""
        if self.outcome.plan is None:
            return ()
        preferred_m_s = np.array([self.scenario.speed_for(aircraft) for aircraft in self.scenario.aircraft])
        plan = self.plan
        planned_m_s = np.asarray(plan.lengths) / np.asarray(plan.arrival_times)
        differing = np.flatnonzero(np.abs(planned_m_s / preferred_m_s - 1.0) > SPEED_TOLERANCE)
        if not differing.size:
            return ()
        names = ", ".join(f"{self.scenario.aircraft[k].name} {planned_m_s[k]:.1f} m/s" for k in differing)
        if np.ptp(preferred_m_s) > 0.0:
            return (f"mean airspeeds other than preferred: {names}",)
        return (f"mean airspeeds other than the preferred fleet.speed_m_s = {preferred_m_s[0]:g} m/s: {names}",)

    def path_descriptions(self) -> tuple[str, ...]:
        """Shape of the path of each aircraft, such as "turns 83 deg"."""
        return tuple(describe_turns(math.degrees(float(total_turn))) for total_turn in np.asarray(self.plan.total_turn))

    def initial_state(self) -> FlightState:
        """State of the fleet at the start of the flight, with the plan."""
        return initialize_compiled(self.flight, self.fleet, self._plan_state())

    def saved_state(self) -> Any:
        """Return the content of a plan file: the planner's state."""
        return self._plan_state()

    def _plan_state(self) -> CertifiedPlanState:
        if self.outcome.plan is None:
            raise NoPlanError(self.refusals)
        return CertifiedPlanState(self.outcome.plan, first_plan_status(), self.holds, self.padded_tasks.limits)

    def record(self) -> "RecordedPlan":
        """Sample and summarize the plan with its proven bounds."""
        from anser.missions.plan_output import record_certified

        gravity = self.airspace.gravity
        return record_certified(self.scenario, self.plan, self.tasks, gravity, self.holds, self.notes())


def restored_arguments(
    scenario: Scenario, flight: Flight, fleet: TrimmedFleet, state: CertifiedPlanState, planner: CertifiedPlanner
) -> tuple[Scenario, Flight, TrimmedFleet, tuple[str, ...], SearchOutcome, AircraftTask, Airspace, PlannedHolds | None]:
    """Arguments for the constructor of a `CertifiedFirstPlan` with the plan, holds and limits of a plan file."""
    outcome, tasks = SearchOutcome(state.plan, 0), planner.aircraft_tasks(fleet.reports, state.limits)
    return scenario, flight, fleet, (), outcome, tasks, planner.airspace, state.holds


def unproven_paths(scenario: Scenario, feasible: np.ndarray) -> tuple[str, ...]:
    """One sentence for each aircraft whose path is not proven (`feasible` is False)."""
    pairs = zip(scenario.aircraft, feasible, strict=True)
    return tuple(f'aircraft "{aircraft.name}": {UNPROVEN}' for aircraft, is_proven in pairs if not is_proven)


def arrival_request(scenario: Scenario, count: int | None = None) -> ArrivalRequest:
    """Arrival rule of a scenario with its times, as input of the search.

    Padded to `count` aircraft by repeating the times of the last aircraft.
    """
    arrival, fleet = scenario.arrival, scenario.aircraft
    times = offsets = windows = None
    if arrival.rule == "at":
        times = np.full(len(fleet), arrival.time_s)
    if arrival.rule == "times":
        times = np.array([aircraft.arrive_s for aircraft in fleet], dtype=float)
    if arrival.rule == "windows":
        windows = np.array([(aircraft.arrive_from_s, aircraft.arrive_to_s) for aircraft in fleet], dtype=float)
    if arrival.rule == "sequence":
        names = arrival.order if arrival.order is not None else tuple(aircraft.name for aircraft in fleet)
        assert arrival.spacing_s is not None
        offsets = np.array([names.index(aircraft.name) for aircraft in fleet]) * arrival.spacing_s
    padding = 0 if count is None else count - len(fleet)
    padded = (
        None if values is None else np.concatenate([values, *[values[-1:]] * padding])
        for values in (times, offsets, windows)
    )
    return ArrivalRequest(arrival.rule, scenario.timing.latest_arrival_s, *padded)


def with_randomness(source: AbstractRandomness | None, flight: Flight) -> Flight:
    """Replace a flight's source of random numbers; None leaves it unchanged."""
    return flight if source is None else dataclasses.replace(flight, randomness=source)


def _prepare_programs(
    scenario: Scenario, flight: Flight, planner: CertifiedPlanner, shapes: Any, prepare_next: PrepareNext
) -> Iterator[PreparedProgram]:
    """Yield the prepared programs for the planning and for the work after it, from the shapes of fleet and tasks."""
    fleet, tasks = shapes
    longest_s = max(
        math.dist(aircraft.start.position_m, scenario.goal_of(aircraft).position_m(0.0))
        / min(scenario.speed_for(aircraft), scenario.limits_for(aircraft).speed_max_m_s)
        for aircraft in scenario.aircraft
    )
    prescribed_s = [aircraft.arrive_s for aircraft in scenario.aircraft if aircraft.arrive_s is not None] + [
        scenario.arrival.time_s or 0.0
    ]
    longest_s = max(longest_s, *prescribed_s)
    planned_shapes = []
    for program in planner.prepare_programs(tasks, longest_s, scenario.timing.duration_s):
        planned_shapes.append(program.shapes)
        yield program
    if planned_shapes:
        plan, holds = planned_shapes
        program = initialize_compiled.prepare(
            flight, fleet, CertifiedPlanState(plan, first_plan_status(), holds, tasks.limits)
        )
        yield program
        following = prepare_next(flight, program.shapes)
        if following is not None:
            yield following
