"""Replanning after an event.

An exit path for the departing aircraft, checked for separation, and a new plan for the rest of the fleet.
"""

import dataclasses
import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from anser.compiling.options import compiled_quickly
from anser.numerics.arrays import as_array
from anser.parts.perception import Instant
from anser.planning.certified.certified_plan import CertifiedPlan, FixedPaths, certify
from anser.planning.certified.planner import CertifiedPlanner, CertifiedPlanState
from anser.planning.certified.replanning import COMMITTED_S, REPLANNED, exit_path, interval_count, task_from_plan
from anser.planning.certified.search import SearchOutcome, search
from anser.planning.certified.task import AircraftTask, ArrivalRequest, KeepOuts
from anser.planning.holds.assignment import assign_holds
from anser.planning.holds.hold_paths import move_with_goals
from anser.planning.limits import PathLimits
from anser.planning.timed_path import TimedPath
from anser.scenario.schema import Scenario
from anser.scenario.schema_event import GOAL_EVENTS, Event
from anser.shapes import Count
from anser.simulation.flight import Flight, FlightState, fleet_reports

EXIT_TURNS = (0.0, 0.25, -0.25, 0.5, -0.5, 0.8, -0.8, 1.2, -1.2, 1.6, -1.6, 2.2, -2.2, 3.1, -3.1)
"""Turns that are tried, in this order, for an aircraft that leaves, rad."""


class FleetSnapshot(NamedTuple):
    """A fleet in flight, as the planner sees it.

    Attributes
    ----------
    tasks
        From where the plan has each aircraft now to its goal as it is sensed now; active: those that may be planned.
    standing
        The paths in force of all others that fly: they have arrived, are about to, or have left.
    seen
        The tasks with every aircraft active that flies, those that have left among them.
    """

    tasks: AircraftTask
    fixed_paths: FixedPaths
    seen: AircraftTask


def take_snapshot(flight: Flight, state: FlightState, number: Count) -> FleetSnapshot:
    """A fleet planned by the certified planner, at a sample; `flight` says who has left by then."""
    instant = Instant(flight.environment, number, flight.timing.step, flight.randomness)
    planner, memory = _certified_planner(flight, state)
    _, reports = fleet_reports(flight, state, instant)
    plan, now = memory.plan, instant.time
    seen = planner.aircraft_tasks(reports, memory.limits)
    free = reports.active & (plan.arrival_times - now > jnp.maximum(planner.freeze, COMMITTED_S))
    left = has_departed(flight, state, now)
    here = jax.vmap(task_from_plan, in_axes=(0, 0, None))(plan.paths, seen, now)
    here = eqx.tree_at(lambda t: t.active, here, jnp.where(free, 1.0, 0.0))
    flies = reports.active | left
    standing = FixedPaths(flies & ~free, plan.paths, plan.arrival_times)
    seen = eqx.tree_at(lambda t: t.active, seen, jnp.where(flies, 1.0, 0.0))
    return FleetSnapshot(here, standing, seen)


def has_departed(flight: Flight, state: FlightState, time: Array) -> Bool[Array, " aircraft"]:
    """Who has left by a time (s), and is in the air."""
    rows = jnp.zeros(flight.count, dtype=bool)
    for kind, states in zip(flight.groups, state.vehicles, strict=True):
        gone = kind.vehicles.map(lambda vehicle, one: vehicle.faults.has_departed(time) & ~one.stopped, states)
        rows = rows.at[jnp.asarray(kind.members)].set(gone)
    return rows


def plan_exit(
    flight: Flight, state: FlightState, number: Count, aircraft: Count, end_time: Array, turns: Float[Array, " turns"]
) -> tuple[CertifiedPlan, Float[Array, " turns"]]:
    """The plan in force with one aircraft on its way out by the first of some turns that keeps clear of the others.

    Parameters
    ----------
    flight, state, number
        The fleet at a sample.
    who
        Its place in the fleet.
    until
        End of the flight, s.
    turns
        From its course, rad, in the order of preference.

    Returns
    -------
    The plan, in which it arrives nowhere before the end; and for each turn the least ratio of its distances from the
    others, on their paths, to the separation: 1 is enough. Where none keeps clear, the one that does most is flown.
    """
    planner, memory = _certified_planner(flight, state)
    plan, now = memory.plan, number * flight.timing.step
    airspace, tasks = planner.airspace, take_snapshot(flight, state, number).seen
    own = jax.tree.map(lambda leaf: leaf[aircraft], plan.paths)

    def along(turn: Array) -> tuple[CertifiedPlan, Array]:
        path = exit_path(own, now, end_time, turn, airspace.wind, airspace.gravity)
        paths = jax.tree.map(lambda all_, one: all_.at[aircraft].set(one), plan.paths, path)
        certificate = certify(paths, tasks, airspace, interval_count(paths), now)
        out = eqx.tree_at(
            lambda p: (p.paths, p.arrival_times, p.certificate),
            plan,
            (paths, plan.arrival_times.at[aircraft].set(end_time), certificate),
        )
        return out, jnp.min(certificate.clearance_ratio[aircraft])

    plans, ratios = jax.lax.map(along, turns)
    clear = ratios >= 1.0
    chosen = jnp.where(jnp.any(clear), jnp.argmax(clear), jnp.argmax(ratios))
    return jax.tree.map(lambda leaf: leaf[chosen], plans), ratios


def replace_plan(state: FlightState, plan: CertifiedPlanState) -> FlightState:
    """The same fleet with another plan in force."""
    return eqx.tree_at(lambda s: s.planner, state, plan)


def _certified_planner(flight: Flight, state: FlightState) -> tuple[CertifiedPlanner, CertifiedPlanState]:
    if not isinstance(flight.planner, CertifiedPlanner):
        raise TypeError(f"planned anew in flight: arrived a {type(flight.planner).__name__}, expected CertifiedPlanner")
    return flight.planner, state.planner


NO_PLAN_MESSAGE = "no plan was found that keeps everything: the plan in force is kept"
_ACCELERATION_M_S2 = 2.0  # which the F-16's engine gives 3 s after idling; nearly all its thrust takes 5 s
_take_snapshot = compiled_quickly(take_snapshot)
_plan_exit = compiled_quickly(plan_exit)


@compiled_quickly
def _assign_holds(
    paths: Any, tasks: Any, airspace: Any, guidance: Any, now: Any, until: Any, cells: int, former: Any
) -> Any:
    """Holds for a plan made at a time, with those that are flown already going on with their goals."""
    moved = None if former is None else move_with_goals(former, tasks, now)
    return assign_holds(paths, tasks, airspace, guidance, now, until, cells, moved)


@compiled_quickly
def _certificate(plan: CertifiedPlan, tasks: Any, airspace: Any, now: Any) -> Any:
    return certify(plan.paths, tasks, airspace, interval_count(plan.paths), now)


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


def apply_event(
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
    done = _OutcomeOf(event, whom)
    if event.kind in GOAL_EVENTS:
        return flight, state, done(True, "the plan is renewed towards where the goal is taken to be")
    on_progress(f"planning on after {event.kind} at {event.time_s:g} s")
    at = as_array(number, np.int32)
    if event.kind == "aircraft-leaves":
        who = names.index(str(event.aircraft))
        plan, _ = _plan_exit(
            flight,
            state,
            at,
            as_array(who, np.int32),
            as_array(scenario.timing.duration_s),
            _exit_turns(state, who, event),
        )
        state = replace_plan(state, dataclasses.replace(state.planner, plan=plan))
    if event.kind == "keep-out-appears":
        flight = _with_keep_out(scenario, flight, event)
    if event.kind == "thrust-lost":
        state = _with_less_thrust(state, names.index(str(event.aircraft)), event.thrust_left or 0.0)
        if scenario.fleet.planner == "decentralised":
            return flight, state, done(True, "its path is renewed within what it can do, and the others wait for it")
    return _replan_if_needed(scenario, flight, state, number, event, done, on_progress)


@dataclass(frozen=True)
class _OutcomeOf:
    event: Event
    whom: str

    def __call__(self, planned: bool, message: str) -> EventOutcome:
        return EventOutcome(self.event.time_s, self.event.kind, self.whom, planned, message)


def _planner(flight: Flight) -> CertifiedPlanner:
    assert isinstance(flight.planner, CertifiedPlanner), "events are for flights with the certified planner"
    return flight.planner


def _exit_turns(state: FlightState, who: int, event: Event) -> Any:
    """Turns of an aircraft that leaves, rad, of one number: that onto its course, or those to be tried."""
    if event.course_deg is None:
        return as_array(EXIT_TURNS)
    paths = state.planner.plan.paths
    air_n = np.asarray(_air_velocity(paths, as_array(who, np.int32), as_array(event.time_s)))
    turn = np.radians(event.course_deg) - np.arctan2(air_n[1], air_n[0])
    return as_array([(turn + np.pi) % (2 * np.pi) - np.pi] * len(EXIT_TURNS))


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


def _replan_if_needed(
    scenario: Scenario,
    flight: Flight,
    state: FlightState,
    number: int,
    event: Event,
    done: _OutcomeOf,
    on_progress: Callable[[str], None],
) -> tuple[Flight, FlightState, EventOutcome]:
    """The plan in force where it still keeps everything; else one made anew; else the plan in force all the same."""
    memory, now_s = state.planner, number * scenario.timing.step_s
    seen = snapshot_at(flight, state, number)
    free = np.asarray(seen.tasks.active) > 0.0
    times_s = np.asarray(memory.plan.arrival_times)
    planner = _planner(flight)
    held_to = _with_limits(seen.seen, planner.correction_limits(memory.limits))
    certificate = _certificate(memory.plan, held_to, planner.airspace, as_array(now_s))
    kept = np.asarray(certificate.satisfied)
    wanted_s = _target_times(scenario, times_s, free, event)
    unmoved = bool(np.all(wanted_s[free] == times_s[free]))
    if not free.any():
        return flight, state, done(bool(kept.all()), "nobody is left who could be planned anew")
    if unmoved and kept[free].all():
        kept_plan = dataclasses.replace(memory, plan=dataclasses.replace(memory.plan, certificate=certificate))
        return flight, replace_plan(state, kept_plan), done(True, "the plan in force keeps everything")
    planned = _search_plan(scenario, flight, state, seen, now_s, wanted_s, on_progress)
    if planned is None:
        return flight, state, done(False, NO_PLAN_MESSAGE)
    return flight, planned, done(True, "planned anew")


def _with_limits(tasks: AircraftTask, limits: PathLimits) -> AircraftTask:
    return eqx.tree_at(lambda task: task.limits, tasks, limits)


def _with_gentle_acceleration(limits: PathLimits) -> PathLimits:
    """Limits with no more acceleration along the path than an engine gives soon."""
    gentle = np.minimum(np.asarray(limits.acceleration_max), _ACCELERATION_M_S2)
    return eqx.tree_at(lambda own: own.acceleration_max, limits, as_array(gentle))


def snapshot_at(flight: Flight, state: FlightState, number: int) -> FleetSnapshot:
    """A fleet in flight as the planner sees it at a sample."""
    return _take_snapshot(flight, state, as_array(number, np.int32))


def replan_fleet(
    scenario: Scenario, flight: Flight, state: FlightState, number: int, on_progress: Callable[[str], None]
) -> FlightState | None:
    """The flight's state with a plan made anew at a sample, for the arrivals in force or what the rule allows."""
    times_s, now_s = np.asarray(state.planner.plan.arrival_times), number * scenario.timing.step_s
    seen = snapshot_at(flight, state, number)
    if not (np.asarray(seen.tasks.active) > 0.0).any():
        return None
    return _search_plan(scenario, flight, state, seen, now_s, times_s, on_progress)


def _target_times(scenario: Scenario, times_s: np.ndarray, free: np.ndarray, event: Event) -> np.ndarray:
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


def _search_plan(
    scenario: Scenario,
    flight: Flight,
    state: FlightState,
    seen: FleetSnapshot,
    now_s: float,
    wanted_s: np.ndarray,
    on_progress: Callable[[str], None],
) -> FlightState | None:
    memory, planner = state.planner, _planner(flight)
    free = np.asarray(seen.tasks.active) > 0.0
    intervals = interval_count(memory.plan.paths)
    until, cells = as_array(scenario.timing.duration_s), memory.holds.paths.times.shape[1] - 1
    tried: list[tuple[CertifiedPlan, Any]] = []

    def after(plan: CertifiedPlan) -> np.ndarray:
        holds = _assign_holds(
            plan.paths, seen.seen, planner.airspace, planner.guidance, as_array(now_s), until, cells, memory.holds
        )
        tried.append((plan, holds))
        return ~np.asarray(holds.clear)

    times_s = np.asarray(memory.plan.arrival_times)
    held_to = _with_gentle_acceleration(memory.limits), planner.correction_limits(memory.limits)
    for request, limits in itertools.product(_requests(scenario, times_s, free, now_s, wanted_s), held_to):
        outcome: SearchOutcome = search(
            now_s,
            _with_limits(seen.tasks, limits),
            planner.airspace,
            request,
            on_progress=on_progress,
            failed_after_arrival=after,
            fixed_paths=seen.fixed_paths,
            intervals=intervals,
        )
        if outcome.plan is not None:
            holds = next(holds for plan, holds in tried if plan is outcome.plan)
            how = as_array(REPLANNED, np.asarray(memory.replanning).dtype)
            return replace_plan(state, CertifiedPlanState(outcome.plan, how, holds, memory.limits))
    return None
