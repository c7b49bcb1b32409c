"""What becomes of a flight's plan when something happens: who leaves leaves clear of the others, who stays plans on."""

import dataclasses
import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import numpy as np

from anser.compiling import compiled_quickly
from anser.numerics import as_array
from anser.planning import PathLimits
from anser.planning.certified import REPLANNED, AircraftTask, ArrivalRequest, CertifiedPlan, Outcome, search
from anser.planning.certified.certified_plan import certify
from anser.planning.certified.renewal import intervals_of
from anser.planning.certified.task import KeepOuts
from anser.planning.timed_path import TimedPath
from anser.scenario import Scenario
from anser.scenario.schema_event import GOAL_EVENTS, Event
from anser.simulation import CertifiedPlanner, CertifiedPlanState, Flight, FlightState, assign_holds, moved_with_goals
from anser.simulation.replanning import TURNS, Present, leaving, present, with_plan

NO_PLAN = "no plan was found that keeps everything: the plan in force is kept"
_ACCELERATION_M_S2 = 2.0  # which the F-16's engine gives 3 s after idling; nearly all its thrust takes 5 s
_present = compiled_quickly(present)
_leaving = compiled_quickly(leaving)


@compiled_quickly
def _holds(paths: Any, tasks: Any, airspace: Any, guidance: Any, now: Any, until: Any, cells: int, former: Any) -> Any:
    """Holds for a plan made at a time, with those that are flown already going on with their goals."""
    moved = None if former is None else moved_with_goals(former, tasks, now)
    return assign_holds(paths, tasks, airspace, guidance, now, until, cells, moved)


@compiled_quickly
def _certificate(plan: CertifiedPlan, tasks: Any, airspace: Any, now: Any) -> Any:
    return certify(plan.paths, tasks, airspace, intervals_of(plan.paths), now)


@dataclass(frozen=True)
class EventOutcome:
    """What became of the plan after an event.

    Attributes
    ----------
    time_s, kind, whom
        The event.
    planned
        Whether the fleet has a plan that keeps everything.
    message
        What was done, in one sentence.
    """

    time_s: float
    kind: str
    whom: str
    planned: bool
    message: str

    def as_dict(self) -> dict[str, Any]:
        """For the summary."""
        return dataclasses.asdict(self)


def after_event(
    scenario: Scenario,
    flight: Flight,
    state: FlightState,
    number: int,
    event: Event,
    on_progress: Callable[[str], None] = lambda what: None,
) -> tuple[Flight, FlightState, EventOutcome]:
    """The flight, its state and what was done at the sample at which an event happens.

    Goals that change their motion need nothing: the plan is renewed towards where they are sensed.
    """
    names = [one.name for one in scenario.aircraft]
    whom = event.aircraft or event.goal or (event.keep_out.name if event.keep_out is not None else "all")
    done = _Done(event, whom)
    if event.kind in GOAL_EVENTS:
        return flight, state, done(True, "the plan is renewed towards where the goal is taken to be")
    on_progress(f"planning on after {event.kind} at {event.time_s:g} s")
    at = as_array(number, np.int32)
    if event.kind == "aircraft-leaves":
        who = names.index(str(event.aircraft))
        plan, _ = _leaving(
            flight, state, at, as_array(who, np.int32), as_array(scenario.timing.duration_s), _turns(state, who, event)
        )
        state = with_plan(state, dataclasses.replace(state.planner, plan=plan))
    if event.kind == "keep-out-appears":
        flight = _with_keep_out(scenario, flight, event)
    if event.kind == "thrust-lost":
        state = _with_less_thrust(state, names.index(str(event.aircraft)), event.thrust_left or 0.0)
        if scenario.fleet.planner == "decentralised":
            return flight, state, done(True, "its path is renewed within what it can do, and the others wait for it")
    return _planned_on(scenario, flight, state, number, event, done, on_progress)


@dataclass(frozen=True)
class _Done:
    event: Event
    whom: str

    def __call__(self, planned: bool, message: str) -> EventOutcome:
        return EventOutcome(self.event.time_s, self.event.kind, self.whom, planned, message)


def _planner(flight: Flight) -> CertifiedPlanner:
    assert isinstance(flight.planner, CertifiedPlanner), "events are for flights with the certified planner"
    return flight.planner


def _turns(state: FlightState, who: int, event: Event) -> Any:
    """Turns of an aircraft that leaves, rad, of one number: that onto its course, or those to be tried."""
    if event.course_deg is None:
        return as_array(TURNS)
    paths = state.planner.plan.paths
    air_n = np.asarray(_air_velocity(paths, as_array(who, np.int32), as_array(event.time_s)))
    turn = np.radians(event.course_deg) - np.arctan2(air_n[1], air_n[0])
    return as_array([(turn + np.pi) % (2 * np.pi) - np.pi] * len(TURNS))


@compiled_quickly
def _air_velocity(paths: TimedPath, who: Any, time: Any) -> Any:
    """Planned velocity through the air of one aircraft at a time, NED, m/s."""
    return jax.tree.map(lambda leaf: leaf[who], paths).air_velocity_n(time)


def _with_keep_out(scenario: Scenario, flight: Flight, event: Event) -> Flight:
    """The planner with one more keep-out, in a row that was kept free for it."""
    appeared, volumes = event.keep_out, _planner(flight).airspace.keep_outs
    assert appeared is not None
    earlier = [one for one in scenario.event if one.kind == event.kind]
    row = len(scenario.keep_out) + earlier.index(event)
    north, east, _ = appeared.velocity_m_s()
    begin = np.array([appeared.north_m - event.time_s * north, appeared.east_m - event.time_s * east])
    new = (begin, np.array([north, east]), appeared.radius_m, appeared.bottom_m, appeared.top_m)
    rows = []
    for held, value in zip(
        (volumes.position_n, volumes.velocity_n, volumes.radius, volumes.bottom, volumes.top), new, strict=True
    ):
        table = np.array(held)
        table[row] = value
        rows.append(as_array(table))
    return eqx.tree_at(lambda f: f.planner.airspace.keep_outs, flight, KeepOuts(*rows))


def _with_less_thrust(state: FlightState, who: int, left: float) -> FlightState:
    """What the aircraft can do along its path with part of its thrust: (thrust - drag) / mass.

    Of idle and full thrust only the differences from the drag are known, at the start; the part lost is that of full
    thrust over idle.
    """
    limits = state.planner.limits
    acceleration, deceleration = np.array(limits.acceleration_max), np.array(limits.deceleration_max)
    acceleration[who] = left * (acceleration[who] + deceleration[who]) - deceleration[who]
    return eqx.tree_at(lambda s: s.planner.limits.acceleration_max, state, as_array(acceleration))


def _planned_on(
    scenario: Scenario,
    flight: Flight,
    state: FlightState,
    number: int,
    event: Event,
    done: _Done,
    on_progress: Callable[[str], None],
) -> tuple[Flight, FlightState, EventOutcome]:
    """The plan in force where it still keeps everything; else one made anew; else the plan in force all the same."""
    memory, now_s = state.planner, number * scenario.timing.step_s
    seen = seen_at(flight, state, number)
    free = np.asarray(seen.tasks.active) > 0.0
    times_s = np.asarray(memory.plan.arrival_times)
    planner = _planner(flight)
    held_to = _with_limits(seen.seen, planner.when_bent(memory.limits))
    certificate = _certificate(memory.plan, held_to, planner.airspace, as_array(now_s))
    kept = np.asarray(certificate.kept)
    wanted_s = _wanted(scenario, times_s, free, event)
    unmoved = bool(np.all(wanted_s[free] == times_s[free]))
    if not free.any():
        return flight, state, done(bool(kept.all()), "nobody is left who could be planned anew")
    if unmoved and kept[free].all():
        kept_plan = dataclasses.replace(memory, plan=dataclasses.replace(memory.plan, certificate=certificate))
        return flight, with_plan(state, kept_plan), done(True, "the plan in force keeps everything")
    planned = _searched(scenario, flight, state, seen, now_s, wanted_s, on_progress)
    if planned is None:
        return flight, state, done(False, NO_PLAN)
    return flight, planned, done(True, "planned anew")


def _with_limits(tasks: AircraftTask, limits: PathLimits) -> AircraftTask:
    return eqx.tree_at(lambda task: task.limits, tasks, limits)


def _gentle(limits: PathLimits) -> PathLimits:
    """Limits with no more acceleration along the path than an engine gives soon."""
    gentle = np.minimum(np.asarray(limits.acceleration_max), _ACCELERATION_M_S2)
    return eqx.tree_at(lambda own: own.acceleration_max, limits, as_array(gentle))


def seen_at(flight: Flight, state: FlightState, number: int) -> Present:
    """A fleet in flight as the planner sees it at a sample."""
    return _present(flight, state, as_array(number, np.int32))


def planned_anew(
    scenario: Scenario, flight: Flight, state: FlightState, number: int, on_progress: Callable[[str], None]
) -> FlightState | None:
    """The flight's state with a plan made anew at a sample, for the arrivals in force or what the rule allows."""
    times_s, now_s = np.asarray(state.planner.plan.arrival_times), number * scenario.timing.step_s
    seen = seen_at(flight, state, number)
    if not (np.asarray(seen.tasks.active) > 0.0).any():
        return None
    return _searched(scenario, flight, state, seen, now_s, times_s, on_progress)


def _wanted(scenario: Scenario, times_s: np.ndarray, free: np.ndarray, event: Event) -> np.ndarray:
    """Arrival times of all after an event, as the rule has them, s."""
    if event.kind == "arrival-put-off":
        return np.where(free, times_s + (event.later_s or 0.0), times_s)
    arrival = scenario.arrival
    if event.kind == "aircraft-leaves" and arrival.rule == "sequence" and event.gaps != "keep":
        names = [one.name for one in scenario.aircraft]
        order = list(arrival.order or names)
        behind = order[order.index(str(event.aircraft)) + 1 :]
        moves = [k < len(names) and names[k] in behind for k in range(times_s.size)]
        return np.where(free & np.array(moves), times_s - (arrival.spacing_s or 0.0), times_s)
    return times_s


def _requests(scenario: Scenario, times_s: np.ndarray, free: np.ndarray, now_s: float, asked_s: np.ndarray) -> Any:
    """What to ask the search for, one after the other: the times wanted, those in force, then what the rule allows."""
    latest_s = scenario.timing.latest_arrival_s - now_s
    rule = scenario.arrival.rule
    filled = [np.where(free, times - now_s, np.max((times - now_s)[free])) for times in (asked_s, times_s)]
    yield ArrivalRequest("times", latest_s, times_s=filled[0])
    if not np.array_equal(filled[0], filled[1]):
        yield ArrivalRequest("times", latest_s, times_s=filled[1])
    if rule in ("together", "earliest"):
        yield ArrivalRequest("together", latest_s)
    if rule == "sequence":
        offsets = filled[0] - np.min(filled[0][free])
        yield ArrivalRequest("sequence", latest_s, offsets_s=np.maximum(offsets, 0.0))


def _searched(
    scenario: Scenario,
    flight: Flight,
    state: FlightState,
    seen: Present,
    now_s: float,
    wanted_s: np.ndarray,
    on_progress: Callable[[str], None],
) -> FlightState | None:
    memory, planner = state.planner, _planner(flight)
    free = np.asarray(seen.tasks.active) > 0.0
    intervals = intervals_of(memory.plan.paths)
    until, cells = as_array(scenario.timing.duration_s), memory.holds.paths.times.shape[1] - 1
    tried: list[tuple[CertifiedPlan, Any]] = []

    def after(plan: CertifiedPlan) -> np.ndarray:
        holds = _holds(
            plan.paths, seen.seen, planner.airspace, planner.guidance, as_array(now_s), until, cells, memory.holds
        )
        tried.append((plan, holds))
        return ~np.asarray(holds.clear)

    times_s = np.asarray(memory.plan.arrival_times)
    held_to = _gentle(memory.limits), planner.when_bent(memory.limits)
    for request, limits in itertools.product(_requests(scenario, times_s, free, now_s, wanted_s), held_to):
        outcome: Outcome = search(
            now_s,
            _with_limits(seen.tasks, limits),
            planner.airspace,
            request,
            on_progress=on_progress,
            failed_after_arrival=after,
            standing=seen.standing,
            intervals=intervals,
        )
        if outcome.plan is not None:
            holds = next(holds for plan, holds in tried if plan is outcome.plan)
            how = as_array(REPLANNED, np.asarray(memory.renewal).dtype)
            return with_plan(state, CertifiedPlanState(outcome.plan, how, holds, memory.limits))
    return None
