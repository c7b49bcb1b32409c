"""First plan of a scenario: common interface, and the classes for the published and the certified planner."""

import abc
import functools
import math
import weakref
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, cast

import equinox as eqx
import jax
import numpy as np

from anser.compiling.options import compiled, compiled_quickly
from anser.compiling.program import PreparedProgram
from anser.environment.environment import AbstractWind
from anser.missions.refusal import (
    Refusal,
    describe_sequence_start,
    diagnose_missing_holds,
    diagnose_refusal,
    diagnose_wind_field,
    unproven_paths,
)
from anser.numerics.arrays import as_array, first_rows
from anser.planning.certified.arrival_times import arrival_sets
from anser.planning.certified.certified_plan import CertifiedPlan, choose_interval_count
from anser.planning.certified.fitted_wind import FittedWind
from anser.planning.certified.planner import CertifiedPlanner, CertifiedPlanState
from anser.planning.certified.replanning import FIRST_PLAN
from anser.planning.certified.search import FleetTask, SearchOutcome
from anser.planning.certified.task import AircraftTask, Airspace, ArrivalRequest, Intervals
from anser.planning.decentralised.planner import DecentralisedPlanner
from anser.planning.holds.hold_paths import PlannedHolds
from anser.planning.limits import LIMIT_MESSAGES, PathLimits, describe_bend, describe_turns
from anser.planning.published.coordination import PLAN_MESSAGES, FleetPlan
from anser.planning.published.planner import LimitReport, PublishedPlanState, check_limits, separation_min
from anser.scenario.build_aircraft import build_path_limits
from anser.scenario.build_environment import ned
from anser.scenario.flight_checks import check_trimmable
from anser.scenario.schema import Scenario
from anser.scenario.schema_aircraft import Aircraft
from anser.scenario.schema_reach import time_to_go_s
from anser.simulation.closed_loop import STATUS_MESSAGES, is_breakaway
from anser.simulation.flight import Flight, FlightState, statuses
from anser.simulation.start import TrimmedFleet, initialize_flight, start_flight, trimmed_fleet

if TYPE_CHECKING:
    from anser.missions.plan_output import RecordedPlan

_SPEED_TOLERANCE = 1e-3  # relative difference from the preferred airspeed above which the notes mention a mean airspeed
_WIND_CHANGE_M_S = 0.5

OnProgress = Callable[[str], None]
"""Callback with a description of the current work."""
PrepareNext = Callable[[Flight, Any], PreparedProgram | None]
"""Function from a flight and the shapes of its first state to the program needed after planning, or to None."""


def prepare_nothing(flight: Flight, shapes: Any) -> PreparedProgram | None:
    """Return None, because no program follows. This function is the default `prepare_next` of `anser.plan`."""


class NoPlanError(Exception):
    """No plan was found; `reasons` has one sentence for each reason."""

    def __init__(self, reasons: tuple[str, ...]) -> None:
        super().__init__("; ".join(reasons))
        self.reasons = reasons


class PlanFileError(ValueError):
    """The file contains no plan, is damaged, belongs to another scenario, or is from another version of anser."""


@dataclass(frozen=True, repr=False)
class FirstPlan(abc.ABC):
    """The first plan of a scenario, made before the flight; the printed form lists arrival times and problems."""

    scenario: Scenario  #: Planned scenario.
    flight: Flight  #: The flight, with inactive aircraft added so that fleets of several sizes share programs.
    fleet: TrimmedFleet  #: The aircraft of `flight`, trimmed at the start.
    refusals: tuple[Refusal, ...]  #: Reasons for a missing plan, one sentence each; empty if a plan exists.
    plan_state: Any = None  # planner state at time 0, with the plan of all aircraft of `flight`; None: no plan
    start_state: FlightState | None = None  # flight state at time 0, if computed together with the plan
    state_type: ClassVar[type]  # type that `saved_state` returns; a plan file is read as this type

    @classmethod
    @abc.abstractmethod
    def make(
        cls, scenario: Scenario, flight: Flight, on_progress: OnProgress, prepare_next: PrepareNext
    ) -> "FirstPlan":
        """Trim every aircraft at its start and make the first plan; for arguments and errors see `anser.plan`."""

    @classmethod
    def restore(cls, scenario: Scenario, flight: Flight, fleet: TrimmedFleet, state: Any) -> "FirstPlan":
        """Rebuild the first plan from a trimmed fleet and the content of a plan file (`state`)."""
        return cls(scenario, flight, fleet, (), state)

    @functools.cached_property
    @abc.abstractmethod
    def plan(self) -> Any:
        """Plan of the scenario's aircraft, in the planner's own type; raises `NoPlanError` if there is no plan."""

    @abc.abstractmethod
    def problems(self) -> tuple[str, ...]:
        """Return reasons for a missing plan, or obstacles to flying the plan, one sentence each; empty if flyable."""

    @abc.abstractmethod
    def notes(self) -> tuple[str, ...]:
        """Return the differences between the plan and the request of the scenario, one sentence each."""

    @abc.abstractmethod
    def path_descriptions(self) -> tuple[str, ...]:
        """Return a description of each aircraft's path in two or three words, such as "bent left"."""

    def initial_state(self) -> FlightState:
        """Return the state of the flight at time 0, with the plan. Raises `NoPlanError` if there is no plan."""
        if self.start_state is not None:
            return self.start_state
        return initialize_compiled(self.flight, self.fleet, self._planned_state())

    def saved_state(self) -> Any:
        """Return the content of a plan file, an Equinox module. Raises `NoPlanError` if there is no plan."""
        return self._planned_state()

    def _planned_state(self) -> Any:
        if self.plan_state is None:
            raise NoPlanError(self.refusals)
        return self.plan_state

    @abc.abstractmethod
    def record(self) -> "RecordedPlan":
        """Return samples of the plan over time and the planner's report. Raises `NoPlanError` if there is no plan."""

    def network_summary(self, time_s: np.ndarray, history: Mapping[str, np.ndarray]) -> dict[str, Any] | None:
        """Compute the entry `network` of a summary from recorded times (s) and variables; None: central planner."""
        return None

    @property
    def arrivals_s(self) -> np.ndarray:
        """Planned arrival time of each aircraft of the scenario, s after the start of the flight."""
        return np.broadcast_to(np.asarray(self.plan.arrival_times), len(self.scenario.aircraft))

    @property
    def arrival_s(self) -> float:
        """Planned arrival time of the last aircraft, s after the start of the flight."""
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
        problems = self.problems() if self.refusals else [f"not flyable: {problem}" for problem in self.problems()]
        return [*problems, *(f"note: {note}" for note in self.notes())]


@compiled_quickly
def initialize_compiled(flight: Flight, fleet: TrimmedFleet, plan_state: Any) -> FlightState:
    """Return the state of a flight at time 0 from trimmed fleet and planner state, by a compiled program."""
    return initialize_flight(flight, fleet, flight.planner.initial_state(plan_state, flight.randomness))


def aircraft_planner(flight: Flight) -> CertifiedPlanner:
    """Return a flight's certified planner; in a decentralised fleet, the planner with which each aircraft plans."""
    return cast("CertifiedPlanner | DecentralisedPlanner", flight.planner).aircraft_planner


def start_next(prepare_next: PrepareNext, flight: Flight, shapes: Any) -> None:
    """Start to compile the program, if any, that `prepare_next` returns for a flight and the shapes of its state."""
    following = prepare_next(flight, shapes)
    if following is not None:
        following.start()


_start_flight = compiled_quickly(start_flight, "trim and first plan")


def trim_and_plan(
    scenario: Scenario, flight: Flight, on_progress: OnProgress, prepare_next: PrepareNext
) -> tuple[FlightState, TrimmedFleet]:
    """Return the state of the flight at time 0, with the first plan, and the trimmed fleet.

    Raises ScenarioError if an aircraft cannot be trimmed at its start.
    """
    on_progress("trimming and planning")
    start = _start_flight.prepare(flight)
    start_next(prepare_next, flight, start.shapes[0])  # the largest program first
    start.start()
    state, fleet = _start_flight(flight)
    check_trimmable(scenario, flight, fleet.is_trimmed, fleet.alphas)
    return state, fleet


_separation = compiled(separation_min)


@compiled
def _check_path_limits(plan: FleetPlan, limits: Any, gravity: Any) -> LimitReport:
    return jax.vmap(check_limits, in_axes=(0, None, None))(plan.trajectories, limits, gravity)


@dataclass(frozen=True, repr=False)
class PublishedFirstPlan(FirstPlan):
    """First plan by the published planner, which always yields a plan; `problems` lists obstacles to the flight."""

    state_type = PublishedPlanState

    @classmethod
    def make(
        cls, scenario: Scenario, flight: Flight, on_progress: OnProgress, prepare_next: PrepareNext
    ) -> "PublishedFirstPlan":
        """Trim every aircraft at its start and plan a simultaneous arrival of the fleet."""
        state, fleet = trim_and_plan(scenario, flight, on_progress, prepare_next)
        return cls(scenario, flight, fleet, (), state.planner, state)

    @functools.cached_property
    def plan(self) -> FleetPlan:
        """Plan of the scenario's aircraft, without the padding of `flight`."""
        return first_rows(self._all, len(self.scenario.aircraft))

    @property
    def _all(self) -> FleetPlan:
        """Plan of all aircraft of `flight`, the padding included."""
        return self.plan_state.plan

    @functools.cached_property
    def limits(self) -> LimitReport:
        """Least and greatest airspeed, turn rate, climb rate and altitude of each path, compared with the limits.

        The values are those at samples of the paths; leading axis aircraft.
        """
        report = _check_path_limits(self._all, build_path_limits(self.scenario), self.flight.environment.gravity)
        return first_rows(report, len(self.scenario.aircraft))

    @functools.cached_property
    def separation_min_m(self) -> float | None:
        """Least planned distance between two aircraft before the arrival, m; None for a single aircraft."""
        if len(self.scenario.aircraft) == 1:
            return None
        return float(np.min(np.asarray(_separation(self._all.trajectories, active=self._all.active))))

    def notes(self) -> tuple[str, ...]:
        """Return the differences between the plan and the request of the scenario, one sentence each.

        The differences are a mean airspeed above the requested airspeed, and a wind at a rendezvous that differs by
        more than 0.5 m/s from the wind at the aircraft's start.
        """
        fleet, notes, speed_m_s = self.scenario.fleet, [], float(self.plan.speed)
        preferred_m_s = fleet.airspeed_m_s
        if speed_m_s > preferred_m_s * (1.0 + _SPEED_TOLERANCE):
            farthest = self.scenario.aircraft[int(self.plan.farthest)].name
            notes.append(
                f"the plan's mean airspeed is {speed_m_s:.1f} m/s instead of {fleet.airspeed_name('fleet')} = "
                f"{preferred_m_s:g} m/s: "
                f'aircraft "{farthest}" has the longest way and cannot slow down or come down more slowly'
            )
        changes = {
            aircraft.name: _wind_change_m_s(self.scenario, self.flight.environment.wind, aircraft, self.arrival_s)
            for aircraft in self.scenario.aircraft
        }
        name = max(changes, key=lambda aircraft: changes[aircraft])
        if changes[name] > _WIND_CHANGE_M_S:
            notes.append(
                "the plan reckons with the wind where each aircraft starts; that at the rendezvous differs, by "
                f'{changes[name]:.1f} m/s for aircraft "{name}": lengths and arrival time change as the plan is renewed'
            )
        return tuple(notes)

    def problems(self) -> tuple[str, ...]:
        """Return the obstacles to flying the plan, one sentence each; empty for a flyable plan.

        Obstacles are a last arrival at or after the end of the flight and, for each aircraft, the first of: an error
        status at the start, a failure of the planner, a violated limit.
        """
        problems, duration_s = [], self.scenario.timing.duration_s
        if self.arrival_s >= duration_s:
            problems.append(f"the fleet arrives at {self.arrival_s:.1f} s, the flight ends at {duration_s:g} s")
        status_codes, is_stopped = (np.asarray(values) for values in statuses(self.flight, self.initial_state()))
        plan_statuses, limit_statuses = np.asarray(self.plan.status), np.asarray(self.limits.status)
        for k, aircraft in enumerate(self.scenario.aircraft):
            status = int(status_codes[k])
            if is_stopped[k] or is_breakaway(status):
                problems.append(f'aircraft "{aircraft.name}": {STATUS_MESSAGES[status]}')
            elif plan_statuses[k]:
                problems.append(f'aircraft "{aircraft.name}": {PLAN_MESSAGES[int(plan_statuses[k])]}')
            elif limit_statuses[k]:
                problems.append(f'aircraft "{aircraft.name}": {LIMIT_MESSAGES[int(limit_statuses[k])]}')
        return tuple(problems)

    def path_descriptions(self) -> tuple[str, ...]:
        """Return the shape of the path of each aircraft: "nominal", "bent left" or "bent right"."""
        return tuple(describe_bend(float(bend)) for bend in np.asarray(self.plan.lateral_bends))

    def record(self) -> "RecordedPlan":
        """Return the samples of the plan over time and the planner's report."""
        from anser.missions.plan_output import record_published

        return record_published(self)


def _wind_change_m_s(scenario: Scenario, wind: AbstractWind, aircraft: Aircraft, arrival_s: float) -> float:
    """Return the difference (magnitude, m/s) between the wind at the start and at the rendezvous at `arrival_s` (s)."""
    if scenario.wind.field is None:
        up_m = scenario.goal_of(aircraft).position_m(arrival_s)[2] + aircraft.rendezvous.stand_off_up_m
        return math.dist(scenario.wind.velocity_m_s(up_m), scenario.wind.velocity_m_s(aircraft.start.altitude_m))
    rendezvous_m = np.add(scenario.goal_of(aircraft).position_m(arrival_s), aircraft.rendezvous.stand_off_m)
    at_rendezvous, at_start = (
        np.asarray(wind.at(ned([float(x) for x in position_m]), time_s))
        for position_m, time_s in ((rendezvous_m, arrival_s), (aircraft.start.position_m, 0.0))
    )
    return math.dist(at_rendezvous, at_start)


def trim_and_build_tasks(flight: Flight, planner: CertifiedPlanner) -> tuple[TrimmedFleet, AircraftTask]:
    """Return the fleet trimmed at its start, and each aircraft's planning task from its first readings."""
    fleet = trimmed_fleet(flight)
    return fleet, planner.aircraft_tasks(fleet.reports, planner.resolve_limits(fleet.performance))


trim_and_build_tasks_compiled = compiled_quickly(trim_and_build_tasks, "trim")


def certified_plan_state(plan: CertifiedPlan, holds: PlannedHolds | None, limits: PathLimits) -> CertifiedPlanState:
    """Return the state of the certified planner with a first plan, its holds and the flight limits of the paths."""
    return CertifiedPlanState(plan, as_array(FIRST_PLAN, np.int64), holds, limits)


def possible_arrivals(scenario: Scenario, flight: Flight) -> list[Intervals]:
    """Return the intervals of time, s after the start, in which each aircraft can arrive if the aircraft flies alone.

    An interval that contains the latest allowed arrival time ends at infinity. `flight` must be built from `scenario`.
    Raises ScenarioError if an aircraft cannot be trimmed at its start.
    """
    planner = aircraft_planner(flight)
    fleet, tasks = trim_and_build_tasks_compiled(flight, planner)
    check_trimmable(scenario, flight, fleet.is_trimmed, fleet.alphas)
    return arrival_sets(first_rows(tasks, len(scenario.aircraft)), planner.airspace, scenario.timing.latest_arrival_s)


def _search_without_difference(
    planner: CertifiedPlanner, scenario: Scenario, tasks: AircraftTask, fleet_task: FleetTask, outcome: SearchOutcome
) -> tuple[Refusal, ...]:
    """Test whether no plan was found because the wind field differs from the layers fitted to the field for planning.

    If a new search in the wind of the layers alone finds a plan, the result is this reason. The result is empty if the
    search finds no plan, or if there is no wind field. `outcome` is the result of the failed search, without padding.
    """
    if not isinstance(planner.airspace.wind, FittedWind):
        return ()
    no_difference = eqx.tree_at(lambda p: p.airspace.wind.residuals, planner, replace_fn=np.zeros_like)
    request = arrival_request(scenario, tasks.active.shape[0])
    without, _ = no_difference.search_plan(0.0, tasks, request, scenario.timing.duration_s)
    return diagnose_wind_field(fleet_task, outcome, has_plan_without=without.plan is not None)


@dataclass(frozen=True, repr=False, kw_only=True)
class CertifiedFirstPlan(FirstPlan):
    """First plan of a scenario by the certified planner, or the reasons for a missing plan (`refusals`)."""

    state_type = CertifiedPlanState
    padded_tasks: AircraftTask  # input of the search, for all aircraft of `flight`
    outcome: SearchOutcome | None = None  # result of the search; None if there was no central search

    @classmethod
    def make(
        cls, scenario: Scenario, flight: Flight, on_progress: OnProgress, prepare_next: PrepareNext
    ) -> "CertifiedFirstPlan":
        """Trim every aircraft and search for a plan and holds; if none is found, diagnose the reasons (`refusals`).

        Raises ScenarioError if an aircraft cannot be trimmed at its start.
        """
        on_progress("trimming")
        planner, count = aircraft_planner(flight), len(scenario.aircraft)
        start = trim_and_build_tasks_compiled.prepare(flight, planner).start()
        start_programs(scenario, flight, planner, start, prepare_next)
        fleet, tasks = trim_and_build_tasks_compiled(flight, planner)
        check_trimmable(scenario, flight, fleet.is_trimmed, fleet.alphas)
        request = arrival_request(scenario, flight.count)
        outcome, holds = planner.search_plan(0.0, tasks, request, scenario.timing.duration_s, on_progress)
        if outcome.plan is not None:
            plan_state = certified_plan_state(outcome.plan, holds, tasks.limits)
            return cls(scenario, flight, fleet, (), plan_state, padded_tasks=tasks, outcome=outcome)
        on_progress("diagnosing the refusal")
        fleet_task = FleetTask(first_rows(tasks, count), planner.airspace, arrival_request(scenario))
        refusals = _search_without_difference(planner, scenario, tasks, fleet_task, outcome.leading(count))
        if not refusals:
            refusals = (
                diagnose_refusal(scenario, fleet_task, outcome.leading(count))
                if holds is None
                else diagnose_missing_holds(scenario, fleet_task, holds)
            )
        return cls(scenario, flight, fleet, refusals, padded_tasks=tasks, outcome=outcome)

    @classmethod
    def restore(cls, scenario: Scenario, flight: Flight, fleet: TrimmedFleet, state: Any) -> "CertifiedFirstPlan":
        """Rebuild the first plan from a trimmed fleet and the content of a plan file (`state`)."""
        tasks = aircraft_planner(flight).aircraft_tasks(fleet.reports, state.limits)
        return cls(scenario, flight, fleet, (), state, padded_tasks=tasks)

    @property
    def airspace(self) -> Airspace:
        """Wind, gravity, required separation and keep-outs with which the planner searches."""
        return aircraft_planner(self.flight).airspace

    @property
    def holds(self) -> PlannedHolds | None:
        """Holds (holding patterns after the arrivals) of all aircraft of `flight`; None if there is no plan."""
        return None if self.plan_state is None else self.plan_state.holds

    @functools.cached_property
    def tasks(self) -> AircraftTask:
        """Planning tasks of the scenario's aircraft, without padding; leading axis aircraft."""
        return first_rows(self.padded_tasks, len(self.scenario.aircraft))

    @functools.cached_property
    def plan(self) -> CertifiedPlan:
        """Certified plan of the scenario's aircraft; raises `NoPlanError` with the reasons if there is no plan."""
        return self._planned_state().plan.leading(len(self.scenario.aircraft))

    def problems(self) -> tuple[str, ...]:
        """Return the reasons for a missing plan or, if a plan exists, a sentence for each path that is not proven.

        The result is empty if every path is proven to keep limits, keep-outs and separation.
        """
        if self.plan_state is None:
            return self.refusals
        return unproven_paths(self.scenario, np.asarray(self.plan_state.plan.feasible)[: len(self.scenario.aircraft)])

    def notes(self) -> tuple[str, ...]:
        """Return the notes on the plan, one sentence each; empty if there is no plan.

        A note states how much a wind field differs from the layers of wind used for planning, which mean airspeeds
        differ from the preferred airspeed, or when a sequence of arrivals begins.
        """
        if self.plan_state is None:
            return ()
        return (*self._wind_notes(), *self._airspeed_notes(), *self._sequence_notes())

    def _wind_notes(self) -> tuple[str, ...]:
        if not isinstance(self.airspace.wind, FittedWind):
            return ()
        error_m_s = float(np.max(np.asarray(self.plan.certificate.bounds.wind_error_max)))
        return (
            "the plan reckons with layers fitted to the wind field; along its paths the field differs from them by "
            f"at most {error_m_s:.1f} m/s, which the certificate allows for",
        )

    def _sequence_notes(self) -> tuple[str, ...]:
        if self.scenario.arrival.rule != "sequence":
            return ()
        fleet_task = FleetTask(self.tasks, self.airspace, arrival_request(self.scenario))
        outcome = None if self.outcome is None else self.outcome.leading(len(self.scenario.aircraft))
        return (describe_sequence_start(self.scenario, fleet_task, self.arrivals_s, outcome),)

    def _airspeed_notes(self) -> tuple[str, ...]:
        preferred_m_s = np.array([self.scenario.speed_for(aircraft) for aircraft in self.scenario.aircraft])
        plan = self._planned_state().plan
        planned_m_s = (np.asarray(plan.lengths) / np.asarray(plan.arrival_times))[: len(preferred_m_s)]
        differing = np.flatnonzero(np.abs(planned_m_s / preferred_m_s - 1.0) > _SPEED_TOLERANCE)
        if not differing.size:
            return ()
        names = ", ".join(f"{self.scenario.aircraft[k].name} {planned_m_s[k]:.1f} m/s" for k in differing)
        if np.ptp(preferred_m_s) > 0.0:
            return (f"mean airspeeds other than preferred: {names}",)
        preferred = f"{self.scenario.fleet.airspeed_name('fleet')} = {preferred_m_s[0]:g} m/s"
        return (f"mean airspeeds other than the preferred {preferred}: {names}",)

    def path_descriptions(self) -> tuple[str, ...]:
        """Return the sum of turns of each aircraft's path as text, such as "turns 83 deg"."""
        return tuple(describe_turns(math.degrees(float(total_turn))) for total_turn in np.asarray(self.plan.total_turn))

    def record(self) -> "RecordedPlan":
        """Return samples of the plan over time and the planner's report with the proven bounds of the paths."""
        from anser.missions.plan_output import record_certified

        gravity = self.airspace.gravity
        plan = self._planned_state().plan
        return record_certified(self.scenario, plan, self.padded_tasks, gravity, self.holds, self.notes())


def arrival_request(scenario: Scenario, count: int | None = None) -> ArrivalRequest:
    """Return the arrival rule of a scenario with its arrival times, offsets or windows (s), as input of the search.

    The values of the last aircraft are repeated for padding up to `count` aircraft; `count` None: no padding.
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


def _rough_flight_time_s(scenario: Scenario) -> float:
    """Estimate the time of the last arrival, s, from the arrival rule and straight flights in the wind at the start."""
    request = arrival_request(scenario)
    if request.times_s is not None:
        return float(np.max(request.times_s))

    def straight_time_s(aircraft: Aircraft) -> float:
        goal, start = scenario.goal_of(aircraft), aircraft.start
        speed_m_s = min(scenario.speed_for(aircraft), scenario.limits_for(aircraft).speed_max_m_s)
        line_m = np.add(goal.position_m(0.0), aircraft.rendezvous.stand_off_m) - start.position_m
        drift_m_s = np.subtract(goal.velocity_m_s(), scenario.wind.velocity_m_s(start.altitude_m))
        time_s = time_to_go_s(tuple(line_m), tuple(drift_m_s), speed_m_s)
        return math.hypot(*line_m) / speed_m_s if time_s is None else time_s

    times_s = np.array([straight_time_s(aircraft) for aircraft in scenario.aircraft])
    if request.windows_s is not None:
        times_s = np.clip(times_s, *request.windows_s.T)
    offsets_s = request.offsets(times_s.size)
    return float(np.max(times_s - offsets_s) + np.max(offsets_s))


def start_search_programs(scenario: Scenario, planner: CertifiedPlanner, tasks: AircraftTask) -> list[Any]:
    """Start to compile the programs of a search for a plan, for the shapes of `tasks` (arrays or shapes).

    Returns the shapes of the programs' results; the last two results are plan and holds. If the estimated flight time
    does not determine the number of intervals per path, nothing is compiled and the list is empty.
    """
    programs = planner.prepare_programs(tasks, _rough_flight_time_s(scenario), scenario.timing.duration_s)
    return [program.start().shapes for program in programs]


_started: "weakref.WeakKeyDictionary[PreparedProgram, set[tuple[Any, ...]]]" = weakref.WeakKeyDictionary()
"""Sizes of plans and holds for which the programs of a search were started, by program of the trim."""


def start_programs(
    scenario: Scenario, flight: Flight, planner: CertifiedPlanner, trim: PreparedProgram, prepare_next: PrepareNext
) -> None:
    """Start to compile the programs of the search, of the state at time 0, and of `prepare_next`.

    `trim` is the prepared program that trims the fleet. If `prepare_next` is `prepare_nothing`, a second call for plans
    of the same sizes starts nothing.
    """
    fleet, tasks = trim.shapes
    longest_s = _rough_flight_time_s(scenario)
    if prepare_next is prepare_nothing:
        sizes = *(choose_interval_count(share * longest_s) for share in (0.95, 1.0, 1.2)), scenario.timing.duration_s
        started = _started.setdefault(trim, set())
        if sizes in started:
            return
        started.add(sizes)
    planned_shapes = start_search_programs(scenario, planner, tasks)
    if planned_shapes:
        *_, plan, holds = planned_shapes
        start = initialize_compiled.prepare(flight, fleet, certified_plan_state(plan, holds, tasks.limits)).start()
        start_next(prepare_next, flight, start.shapes)
