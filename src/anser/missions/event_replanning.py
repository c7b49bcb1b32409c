"""Replanning after an event of the scenario, between two steps of the flight.

A departing aircraft gets an exit path, on which the aircraft flies to the end of the flight. The remaining aircraft get
a new plan if necessary. Periodic corrections of paths: see `anser.planning.certified.replanning`.
"""

import dataclasses
import functools
import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from anser.compiling.options import compiled_quickly
from anser.missions.first_plan import aircraft_planner
from anser.missions.segments import sense_fleet
from anser.numerics.arrays import as_array, select_if_any, with_rows
from anser.parts.planners import AircraftReport, Performance
from anser.planning.certified.certified_plan import CertifiedPlan, FixedPaths, certify
from anser.planning.certified.clearance import Track, bounded_track, pair_clearance_ratio
from anser.planning.certified.planner import CertifiedPlanState
from anser.planning.certified.replanning import COMMITTED_S, REPLANNED, exit_path, interval_count, task_from_plan
from anser.planning.certified.task import AircraftTask, Airspace, ArrivalRequest, KeepOuts
from anser.planning.holds.hold_paths import SAMPLES_PER_CELL, broadcast_holds, hold_reference, move_with_goals
from anser.planning.limits import CERTIFIED_LIMITS, PathLimits, with_gentle_acceleration
from anser.planning.timed_path import TimedPath
from anser.scenario.schema import Scenario
from anser.scenario.schema_airspace import AIRCRAFT_CHANGES, GOAL_EVENTS, Event
from anser.shapes import Integer, Scalar
from anser.simulation.flight import Flight, FlightState
from anser.steady.performance import ACCELERATION_FLOOR

EXIT_TURNS = (0.0, 0.25, -0.25, 0.5, -0.5, 0.8, -0.8, 1.2, -1.2, 1.6, -1.6, 2.2, -2.2, 3.1, -3.1)
"""Turns for the exit path of a departing aircraft, rad, right positive, in the order in which they are tried."""


class FleetSnapshot(NamedTuple):
    """Planning tasks (start, goal, limits) and fixed paths of a fleet in flight at one sample, for the planner."""

    # tasks with starts on the planned paths; `active` marks the aircraft that can be replanned
    replannable_tasks: AircraftTask
    fixed_paths: FixedPaths  # paths of the aircraft that have arrived, are about to arrive, or have left the fleet
    # tasks with starts at the reported motions; `active` marks every flying aircraft, departed aircraft included
    flying_tasks: AircraftTask
    remaining: Bool[Array, " aircraft"]  # mask of the aircraft that have not stopped, broken away or left the fleet


def take_snapshot(flight: Flight, state: FlightState, time: Scalar, reports: AircraftReport) -> FleetSnapshot:
    """Return the certified planner's input for replanning a fleet in flight at `time` (s), see `FleetSnapshot`."""
    planner, plan_state = aircraft_planner(flight), state.planner
    plan = plan_state.plan
    flying_tasks = planner.aircraft_tasks(reports, plan_state.limits)
    can_replan = reports.active & (plan.arrival_times - time > jnp.maximum(planner.freeze, COMMITTED_S))
    tasks = jax.vmap(task_from_plan, in_axes=(0, 0, None))(plan.paths, flying_tasks, time)
    tasks = eqx.tree_at(lambda t: t.active, tasks, as_array(can_replan))
    is_flying = reports.active | reports.has_left
    fixed_paths = FixedPaths(is_flying & ~can_replan, plan.paths, plan.arrival_times)
    flying_tasks = eqx.tree_at(lambda t: t.active, flying_tasks, as_array(is_flying))
    return FleetSnapshot(tasks, fixed_paths, flying_tasks, as_array(reports.active, bool))


def exit_start(
    plan_state: CertifiedPlanState,
    tasks: AircraftTask,  # tasks of all flying aircraft
    time: Scalar,  # current time, s
    aircraft: Integer,  # index of the departing aircraft in the fleet
) -> AircraftTask:
    """Return the planning task of a departing aircraft, for a path that starts at `time` (s).

    Before the arrival, the start is on the planned path; after the arrival, the start is in the planned hold (holding
    pattern). If there is no planned hold, or the aircraft cannot fly it as planned (see `hold_reference`), the start
    is the measured motion.
    """
    plan, holds = plan_state.plan, plan_state.holds
    task, path, arrival_time = jax.tree.map(lambda leaf: leaf[aircraft], (tasks, plan.paths, plan.arrival_times))
    in_hold = task
    if holds is not None:
        held, hold = (
            jax.tree.map(lambda leaf: leaf[aircraft], broadcast_holds(fleet_holds))
            for fleet_holds in (move_with_goals(holds, tasks, time), holds)
        )
        follows_plan = hold_reference(hold, time, task.goal_position_n, task.goal_velocity_n, task.speed)[1]
        in_hold = select_if_any(follows_plan, lambda: task_from_plan(held.paths, task, time), task)
    return select_if_any(time < arrival_time, lambda: task_from_plan(path, task, time), in_hold)


def plan_exit(
    plan_state: CertifiedPlanState,
    tasks: AircraftTask,  # tasks of all flying aircraft, with the limits of a path in flight
    airspace: Airspace,
    time: Scalar,  # current time, s
    aircraft: Integer,  # index of the departing aircraft in the fleet
    start: AircraftTask,  # task of the departing aircraft, from `exit_start`
    end_time: Array,  # end of the flight, s
    turns: Float[Array, " turns"],  # turns from the present course, rad, in the order of preference
) -> CertifiedPlan:
    """Return the plan with an exit path for a departing aircraft up to `end_time`, its new arrival time.

    The exit path keeps three requirements if possible; if not, an earlier requirement has priority over later ones:

    1. the separation from the paths of all other aircraft up to their arrivals, and from the holds that have begun;
    2. limits and keep-outs;
    3. the separation from the holds that begin later, because new holds can be planned for these aircraft.

    Among equally good turns, the first of `turns` is chosen. If no turn keeps the first requirement, the turn with the
    greatest ratio of distance to required separation is chosen. The returned certificate does not cover the holds.
    """
    plan, holds = plan_state.plan, plan_state.holds
    knot_count, count = plan.paths.times.shape[1], plan.arrival_times.shape[0]
    # An exit path lasts to the end of the flight: aircraft that have left have no hold.
    is_holder = (jnp.arange(count) != aircraft) & (tasks.active > 0.0) & (plan.arrival_times < end_time)
    hold_paths = None if holds is None else move_with_goals(holds, tasks, time).paths
    cell_count = 0 if hold_paths is None else hold_paths.times.shape[1] - 1
    times = time + (end_time - time) * jnp.linspace(0.0, 1.0, SAMPLES_PER_CELL * cell_count + 1)

    def tracked(path: TimedPath) -> Track:
        return bounded_track(path, airspace, 1.0, times)

    hold_tracks = None if hold_paths is None else jax.lax.map(tracked, hold_paths)

    def hold_ratios(path: TimedPath) -> Float[Array, " aircraft"]:
        """Return the ratio of distance to separation from each hold of another aircraft; infinite without a hold."""
        if hold_tracks is None:
            return jnp.full(count, jnp.inf)
        track = jax.tree.map(lambda leaf: leaf[None], tracked(path))
        return jnp.where(is_holder, pair_clearance_ratio(track, hold_tracks, airspace.separation), jnp.inf)

    def plan_turn(turn: Array) -> tuple[CertifiedPlan, Array, Array]:
        path = exit_path(start, time, end_time, turn, airspace.wind, airspace.gravity, knot_count)
        paths = jax.tree.map(lambda fleet_leaf, exit_leaf: fleet_leaf.at[aircraft].set(exit_leaf), plan.paths, path)
        certificate = certify(paths, tasks, airspace, interval_count(paths), time)
        exit_plan = dataclasses.replace(
            plan, paths=paths, arrival_times=plan.arrival_times.at[aircraft].set(end_time), certificate=certificate
        )
        from_paths, from_holds = certificate.clearance_ratio[aircraft], hold_ratios(path)
        from_flown = jnp.where(plan.arrival_times <= time, from_holds, jnp.inf)
        ratios = jnp.stack([jnp.min(jnp.minimum(from_paths, ratios)) for ratios in (from_holds, from_flown)])
        return exit_plan, ratios, certificate.satisfied_individually[aircraft]

    plans, ratios, is_within = jax.lax.map(plan_turn, turns)
    is_clear = ratios >= 1.0
    rank = jnp.where(is_clear[:, 1], 1.0 + 2.0 * is_within + is_clear[:, 0], ratios[:, 1])
    return jax.tree.map(lambda leaf: leaf[jnp.argmax(rank)], plans)


def replace_plan(state: FlightState, plan: CertifiedPlanState) -> FlightState:
    """Return the state of the flight with the planner's state replaced by `plan`."""
    return eqx.tree_at(lambda s: s.planner, state, plan)


NO_PLAN_MESSAGE = "no new plan within the limits, the separation and the keep-outs was found: the plan in force stays"
_ACCELERATION_M_S2 = 2.0  # reached by the F-16's engine 3 s after idling; full thrust takes about 5 s
_take_snapshot = compiled_quickly(take_snapshot)
_exit_start = compiled_quickly(exit_start)
_plan_exit = compiled_quickly(plan_exit)


@compiled_quickly
def _certificate(plan: CertifiedPlan, tasks: Any, airspace: Any, time: Any) -> Any:
    return certify(plan.paths, tasks, airspace, interval_count(plan.paths), time)


@dataclass(frozen=True)
class EventOutcome:
    """Effect of an event on the plan, for the flight's summary."""

    time_s: float  # time of the event, s after the start of the flight
    kind: str  # type of the event, as in the scenario
    subject: str  # name of the aircraft, goal or keep-out; "all" if the event names none
    has_valid_plan: bool  # whether the fleet has a valid plan afterwards
    message: str  # response of the planner, in one sentence
    goal: str | None = None  # name of the goal that the aircraft `subject` took over; None: no goal was taken over

    def as_dict(self) -> dict[str, Any]:
        """Return the entry of the list `events` in `summary.json`, with the keys of the file."""
        return {
            "time_s": self.time_s,
            "kind": self.kind,
            "whom": self.subject,
            "planned": self.has_valid_plan,
            "message": self.message,
        } | ({} if self.goal is None else {"goal": self.goal})


def apply_event(
    scenario: Scenario,
    flight: Flight,
    state: FlightState,
    sample: int,
    event: Event,
    performance: Performance | None,  # accelerations of the fleet at its start; required if thrust is lost
    on_progress: Callable[[str], None] = lambda message: None,  # called with a description of the current work
) -> tuple[Flight, FlightState, EventOutcome]:
    """Apply an event's effect on the plan at sample `sample`; return the new flight and state, and the outcome.

    The physical effect of the event (less thrust, a lost sensor, a turning goal) is part of the flight from its start,
    see `anser.scenario.build`.
    """
    names = [aircraft.name for aircraft in scenario.aircraft]
    subject = event.aircraft or event.goal or (event.keep_out.name if event.keep_out is not None else "all")
    outcome = functools.partial(EventOutcome, event.time_s, event.kind, subject)
    if event.kind in GOAL_EVENTS and scenario.timing.replan_period_s > 0.0:
        return flight, state, outcome(True, "periodic replanning follows the estimated goal")
    if event.kind in GOAL_EVENTS:
        message = "the plan in force stays: with timing.replan_period_s = 0 no plan follows the estimated goal"
        return flight, state, outcome(event.kind == "goal-sensor-lost", message)
    if event.kind == AIRCRAFT_CHANGES:
        return flight, state, outcome(True, "unknown to autopilot and planner: the plan in force stays")
    on_progress(f"replanning after {event.kind} at {event.time_s:g} s")
    planned_times_s = np.asarray(state.planner.plan.arrival_times)  # including an aircraft that leaves now
    violations = ""
    if event.kind == "aircraft-leaves":
        planner, time = aircraft_planner(flight), as_array(sample * scenario.timing.step_s)
        tasks = snapshot_at(flight, state, sample).flying_tasks
        tasks = _with_limits(tasks, planner.correction_limits(state.planner.limits))
        departing = as_array(names.index(str(event.aircraft)), np.int32)
        start = _exit_start(state.planner, tasks, time, departing)
        plan = _plan_exit(
            state.planner,
            tasks,
            planner.airspace,
            time,
            departing,
            start,
            as_array(scenario.timing.duration_s),
            _exit_turns(start, event),
        )
        violations = _exit_violations(scenario, plan, int(departing))
        state = replace_plan(state, dataclasses.replace(state.planner, plan=plan))
    if event.kind == "keep-out-appears":
        flight = _with_keep_out(scenario, flight, event)
    if event.kind == "thrust-lost":
        assert performance is not None
        aircraft = names.index(str(event.aircraft))
        state = _with_less_thrust(flight, state, performance, aircraft, event.thrust_left or 0.0)
        if not scenario.fleet.is_central:
            message = "it corrects its path within its remaining thrust, or looks for another that the fleet waits for"
            return flight, state, outcome(True, message)
    state, is_planned, message = _replan_if_needed(scenario, flight, state, sample, event, planned_times_s, on_progress)
    return flight, state, outcome(is_planned, message + violations)


def _exit_violations(scenario: Scenario, plan: CertifiedPlan, aircraft: int) -> str:
    """Return a clause on the keep-outs and limits that an exit path violates; empty if the path violates none."""
    certificate = plan.certificate
    if certificate.satisfied_individually[aircraft]:
        return ""
    appearing = [event.keep_out for event in scenario.event if event.keep_out is not None]
    # Padding follows the keep-outs in the planner's table.
    keep_outs = zip(
        [*scenario.keep_out, *appearing], np.asarray(certificate.keep_out_clearance)[aircraft], strict=False
    )
    limits = zip(CERTIFIED_LIMITS, np.asarray(certificate.excess)[aircraft], strict=True)
    violations = [f'enters the keep-out "{keep_out.name}"' for keep_out, distance in keep_outs if not distance >= 0.0]
    violations += [
        f"exceeds the limit of the {limit.description} (limits.{limit.scenario_key})"
        for limit, excess in limits
        if not excess <= 0.0
    ]
    return f"; the exit path {' and '.join(violations)}: no turn that was tried avoids this and keeps the separation"


def _exit_turns(start: AircraftTask, event: Event) -> Any:
    """Return the turns to try for a departing aircraft, rad, right positive: `EXIT_TURNS` or the prescribed turn."""
    if event.course_deg is None:
        return as_array(EXIT_TURNS)
    air_n = np.asarray(start.air_velocity_n)
    turn = np.radians(event.course_deg) - np.arctan2(air_n[1], air_n[0])
    # as many turns as in `EXIT_TURNS`: both cases share a compiled program
    return as_array([(turn + np.pi) % (2 * np.pi) - np.pi] * len(EXIT_TURNS))


def _with_keep_out(scenario: Scenario, flight: Flight, event: Event) -> Flight:
    appeared, volumes = event.keep_out, aircraft_planner(flight).airspace.keep_outs
    assert appeared is not None
    earlier = [keep_out_event for keep_out_event in scenario.event if keep_out_event.kind == event.kind]
    index = len(scenario.keep_out) + earlier.index(event)
    north, east, _ = appeared.velocity_m_s()
    origin = [appeared.north_m - event.time_s * north, appeared.east_m - event.time_s * east]
    row = KeepOuts(*map(as_array, (origin, [north, east], appeared.radius_m, appeared.bottom_m, appeared.top_m)))
    return eqx.tree_at(lambda f: f.planner.airspace.keep_outs, flight, with_rows(volumes, index, row))


def _with_less_thrust(
    flight: Flight, state: FlightState, performance: Performance, aircraft: int, thrust_share: float
) -> FlightState:
    """Return the state with an aircraft's greatest acceleration along the path reduced to the remaining thrust.

    `thrust_share` (0..1) is the remaining part of the difference between full and idle thrust; `performance` has the
    accelerations with full and with idle thrust at the start.
    """
    planner = aircraft_planner(flight)
    gain, loss = (
        max(float(values[aircraft]), ACCELERATION_FLOOR)
        for values in (performance.acceleration, performance.deceleration)
    )
    remaining = min(thrust_share * (gain + loss) - loss, float(planner.limits.acceleration_max[aircraft]))
    # the reserve also reduces a negative acceleration, of an aircraft that can only decelerate
    reduced = remaining - float(planner.acceleration_reserve) * abs(remaining)
    acceleration_max = with_rows(state.planner.limits.acceleration_max, aircraft, reduced)
    return eqx.tree_at(lambda s: s.planner.limits.acceleration_max, state, acceleration_max)


def _replan_if_needed(
    scenario: Scenario,
    flight: Flight,
    state: FlightState,
    sample: int,
    event: Event,
    planned_times_s: np.ndarray,  # arrival times before the event, s
    on_progress: Callable[[str], None],
) -> tuple[FlightState, bool, str]:
    """Replan the fleet after an event, unless the plan in force meets all requirements, arrival times included.

    Returns the state, whether the fleet has a valid plan, and a sentence for the summary. If no new plan is found, the
    paths in force stay. After a new keep-out or a departure, the paths in force get new holds, if every new hold keeps
    separation, keep-outs and altitude limits.
    """
    plan_state, now_s = state.planner, sample * scenario.timing.step_s
    snapshot = snapshot_at(flight, state, sample)
    can_replan, remaining = np.asarray(snapshot.replannable_tasks.active) > 0.0, np.asarray(snapshot.remaining)
    times_s = np.asarray(plan_state.plan.arrival_times)
    planner = aircraft_planner(flight)
    limited_tasks = _with_limits(snapshot.flying_tasks, planner.correction_limits(plan_state.limits))
    certificate = _certificate(plan_state.plan, limited_tasks, planner.airspace, as_array(now_s))
    is_satisfied = np.asarray(certificate.satisfied)
    target_times_s = _target_times(scenario, times_s, can_replan, event, planned_times_s)
    is_unchanged = bool(np.all(target_times_s[can_replan] == times_s[can_replan]))
    # A new keep-out and an exit path concern the holds after the arrivals too; aircraft that have arrived keep theirs.
    holds, is_clear = plan_state.holds, True
    if event.kind in ("keep-out-appears", "aircraft-leaves") and holds is not None:
        on_progress("choosing the holds")
        paths, end_time_s = plan_state.plan.paths, scenario.timing.duration_s
        holds = planner.assign_holds(paths, snapshot.flying_tasks, now_s, end_time_s, holds)
        is_clear = bool(np.all(holds.clear))
    held_state = replace_plan(state, dataclasses.replace(plan_state, holds=holds)) if is_clear else state
    if not can_replan.any():
        # Aircraft about to arrive keep their paths, but fly the new holds; their arrivals are not put off.
        is_planned = event.kind != "arrival-put-off" and is_clear and bool(is_satisfied[remaining].all())
        return held_state, is_planned, "no aircraft is left that could be replanned"
    if is_unchanged and is_clear and is_satisfied[can_replan].all():
        plan = dataclasses.replace(plan_state.plan, certificate=certificate)
        certified_state = replace_plan(state, dataclasses.replace(plan_state, plan=plan, holds=holds))
        return certified_state, True, "the plan in force still meets all requirements"
    last_s, latest_s = float(np.max(target_times_s[can_replan])), scenario.timing.latest_arrival_s
    is_put_off = event.kind == "arrival-put-off"
    if is_put_off and last_s > latest_s:
        message = f"not put off: an arrival at {last_s:.1f} s would be after the latest one, {latest_s:g} s"
        return held_state, False, message
    requests = _requests(scenario, times_s, can_replan, now_s, target_times_s)
    # Only the first request has the requested times.
    requests = itertools.islice(requests, 1) if is_put_off else requests
    replanned_state = _search_plan(scenario, flight, state, snapshot, now_s, requests, on_progress)
    return (held_state, False, NO_PLAN_MESSAGE) if replanned_state is None else (replanned_state, True, "planned anew")


def _with_limits(tasks: AircraftTask, limits: PathLimits) -> AircraftTask:
    return eqx.tree_at(lambda task: task.limits, tasks, limits)


def snapshot_at(flight: Flight, state: FlightState, sample: int) -> FleetSnapshot:
    """Return the planner's input (`FleetSnapshot`) for a fleet in flight at sample `sample`, by compiled programs."""
    reports = sense_fleet(flight, state, as_array(sample, np.int32))
    return _take_snapshot(flight, state, as_array(sample * float(flight.timing.step)), reports)


def replan_fleet(
    scenario: Scenario, flight: Flight, state: FlightState, sample: int, on_progress: Callable[[str], None]
) -> FlightState | None:
    """Search for a new plan from sample `sample`, and return the flight's state with the new plan.

    The search tries the arrival times in force, then the scenario's arrival rule. None if no plan is found or no
    aircraft can be replanned.
    """
    times_s, now_s = np.asarray(state.planner.plan.arrival_times), sample * scenario.timing.step_s
    snapshot = snapshot_at(flight, state, sample)
    can_replan = np.asarray(snapshot.replannable_tasks.active) > 0.0
    if not can_replan.any():
        return None
    requests = _requests(scenario, times_s, can_replan, now_s, times_s)
    return _search_plan(scenario, flight, state, snapshot, now_s, requests, on_progress)


def _target_times(
    scenario: Scenario, times_s: np.ndarray, can_replan: np.ndarray, event: Event, planned_times_s: np.ndarray
) -> np.ndarray:
    """Return the arrival times required after an event, (aircraft,), s after the start of the flight.

    The result is `times_s`, the times in force, with two exceptions. An event "arrival-put-off" delays the aircraft in
    the mask `can_replan`. If an aircraft leaves a sequence before its arrival (`planned_times_s`, before the event),
    the aircraft behind arrive one spacing earlier, up to an aircraft outside the mask; not if `event.gaps` is "keep".
    """
    if event.kind == "arrival-put-off":
        return np.where(can_replan, times_s + (event.later_s or 0.0), times_s)
    arrival = scenario.arrival
    if event.kind == "aircraft-leaves" and arrival.rule == "sequence" and event.gaps != "keep":
        names = [aircraft.name for aircraft in scenario.aircraft]
        order, spacing_s = list(arrival.order or names), arrival.spacing_s or 0.0
        earlier_leavers = {e.aircraft for e in scenario.event if e.kind == event.kind and e.time_s <= event.time_s}
        followers = [name for name in order[order.index(str(event.aircraft)) + 1 :] if name not in earlier_leavers]
        # An aircraft that cannot move up keeps its place, and so do the aircraft behind.
        moving = list(itertools.takewhile(lambda k: can_replan[k], map(names.index, followers)))
        if planned_times_s[names.index(str(event.aircraft))] > event.time_s:  # not arrived before the event
            closer_s = times_s.copy()
            closer_s[moving] -= spacing_s
            return closer_s
    return times_s


def _requests(
    scenario: Scenario, times_s: np.ndarray, can_replan: np.ndarray, now_s: float, target_times_s: np.ndarray
) -> Iterator[ArrivalRequest]:
    """Yield the arrival requests to try in a search, in order; their times (s) count from `now_s`.

    The order is: `target_times_s`; the times in force, `times_s`; if the arrival rule allows, times that the search
    chooses. Times later than the latest allowed arrival are omitted.
    """
    latest_s = scenario.timing.latest_arrival_s - now_s
    rule = scenario.arrival.rule
    remaining_times = [
        np.where(can_replan, times - now_s, np.max((times - now_s)[can_replan])) for times in (target_times_s, times_s)
    ]
    for k, times in enumerate(remaining_times):
        if np.max(times[can_replan]) <= latest_s and not (k and np.array_equal(times, remaining_times[0])):
            yield ArrivalRequest("times", latest_s, times_s=times)
    if rule in ("together", "earliest"):
        yield ArrivalRequest("together", latest_s)
    if rule == "sequence":
        offsets = remaining_times[0] - np.min(remaining_times[0][can_replan])
        yield ArrivalRequest("sequence", latest_s, offsets_s=np.maximum(offsets, 0.0))


def _search_plan(
    scenario: Scenario,
    flight: Flight,
    state: FlightState,
    snapshot: FleetSnapshot,
    now_s: float,
    requests: Iterable[ArrivalRequest],
    on_progress: Callable[[str], None],
) -> FlightState | None:
    """Search for a new plan that starts at `now_s` (s); return the flight's state with the plan, or None.

    Each request is tried first with an acceleration along the path of at most 2 m/s^2, then with the greater limits of
    `correction_limits`.
    """
    plan_state, planner = state.planner, aircraft_planner(flight)
    limit_sets = (
        with_gentle_acceleration(plan_state.limits, _ACCELERATION_M_S2),
        planner.correction_limits(plan_state.limits),
    )
    for request, limits in itertools.product(requests, limit_sets):
        outcome, holds = planner.search_plan(
            now_s,
            _with_limits(snapshot.replannable_tasks, limits),
            request,
            scenario.timing.duration_s,
            on_progress,
            fixed_paths=snapshot.fixed_paths,
            intervals=interval_count(plan_state.plan.paths),
            hold_tasks=snapshot.flying_tasks,
            former_holds=plan_state.holds,
        )
        if outcome.plan is not None:
            replanning_status = as_array(REPLANNED, np.asarray(plan_state.replanning).dtype)
            return replace_plan(state, CertifiedPlanState(outcome.plan, replanning_status, holds, plan_state.limits))
    return None
