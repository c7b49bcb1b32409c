"""The certified planner in the closed loop: paths with certificates, and holds after the arrivals."""

from collections.abc import Callable, Iterator
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from anser.compiling.options import compiled_by_older_generator, compiled_quickly
from anser.compiling.program import PreparedProgram
from anser.control.guidance import GuidanceSettings
from anser.numerics.arrays import as_array
from anser.parts.planners import AbstractPlanner, AircraftPlan, AircraftReport, IdleDeceleration, Performance
from anser.planning.certified.certified_plan import (
    CertifiedPlan,
    FixedPaths,
    choose_interval_count,
    prepare_plan_at,
)
from anser.planning.certified.replanning import (
    COMMITTED_S,
    FIRST_PLAN,
    REPLANNED,
    PlanInFlight,
    arrival_delays,
    correct_or_replace_plan,
    correct_plan,
    exit_paths,
    interval_count,
    tasks_from_plan,
)
from anser.planning.certified.search import FleetTask, SearchOutcome, search
from anser.planning.certified.task import AircraftTask, Airspace, ArrivalRequest
from anser.planning.certified.timed_profiles import STANDARD, WITH_SPLINES, WITH_TURN_LEG_PATHS, CandidateSet
from anser.planning.holds.assignment import assign_holds
from anser.planning.holds.hold_paths import (
    CELL_S,
    PlannedHolds,
    broadcast_holds,
    choose_cell_count,
    goals_have_shifted,
    move_with_goals,
)
from anser.planning.limits import PathLimits, acceleration_limits, with_gentle_acceleration
from anser.planning.timed_path import TimedPath
from anser.shapes import Flag, Integer, Scalar, ScalarLike
from anser.steady.performance import ACCELERATION_FLOOR

# Greatest acceleration, m/s^2, along the paths of a search in flight after no separated holds were found. If it were
# greater, an aircraft with a longer path would accelerate, then decelerate with idle thrust and without reserve.
_ACCELERATION_M_S2 = 1.0
_WITHOUT_SPLINES = STANDARD, WITH_TURN_LEG_PATHS


@compiled_by_older_generator(None, "holds")
def _assign_holds(
    paths: TimedPath,
    tasks: AircraftTask,
    airspace: Airspace,
    guidance: GuidanceSettings,
    time: Any,
    end_time: Any,
    cells: int,
    former: PlannedHolds | None,
) -> PlannedHolds:
    """Assign a hold to each aircraft: a path from the arrival to `end_time` (s), with `cells` cells.

    Aircraft that have arrived by `time` (s) keep their hold in `former`, moved with the goal; None: no hold is kept.
    """
    moved = None if former is None else move_with_goals(former, tasks, time)
    return assign_holds(paths, tasks, airspace, guidance, time, end_time, cells, moved, one_kernel=True)


class CertifiedPlanState(eqx.Module):
    """State of the certified planner: plan in force, its holds, and the flight limits of the paths."""

    plan: CertifiedPlan  # plan in force
    replanning: Integer  # origin of the plan: `FIRST_PLAN`, ... of `anser.planning.certified.replanning`
    holds: PlannedHolds | None  # None: each aircraft flies the hold that its mission prescribes
    limits: PathLimits  # include the accelerations that the engine allows
    # whether the plan or its holds must be replaced between two steps
    replan_needed: Flag = eqx.field(default_factory=lambda: as_array(False, bool))


class CertifiedPlanner(AbstractPlanner):
    """Planner whose paths are proven to keep flight limits, separation and keep-outs, before and during the flight."""

    sides: Int[Array, " aircraft"]  #: Side of each aircraft's detour: +1 right, -1 left, 0 either.
    speed: Float[Array, " aircraft"]  #: Preferred mean airspeed per aircraft, m/s.
    limits: PathLimits  #: Flight limits of the paths; leading axis aircraft.
    roll_rates_max: Float[Array, " aircraft"]  #: Greatest rate of the bank angle along a path, rad/s.
    airspace: Airspace  #: Wind, required distances, keep-outs.
    guidance: GuidanceSettings  #: Settings of the guidance, among them radius and sense of the holds.
    latest_arrival: Scalar  #: Latest allowed arrival time, s after the start of the flight.
    freeze: Scalar  #: Duration before the arrival in which a path is frozen, s.
    #: Fraction of the limits of acceleration and deceleration that a new path leaves to the autopilot and to
    #: corrections.
    acceleration_reserve: Scalar = eqx.field(default_factory=lambda: as_array(0.0))

    @property
    def aircraft_planner(self) -> "CertifiedPlanner":
        """Return the planner itself: the fleet has a central planner (see `DecentralisedPlanner.aircraft_planner`)."""
        return self

    def first_plan(self, time: ScalarLike, reports: AircraftReport, performance: Performance) -> CertifiedPlanState:
        """Search for a plan with a common arrival time, and for holds that last until `latest_arrival`.

        Not traceable by JAX. Raises ValueError if no plan is found; `anser.missions.refusal` finds the reason. For
        other arrival rules see `search_plan`.
        """
        latest = float(self.latest_arrival)
        tasks = self.aircraft_tasks(reports, self.resolve_limits(performance))
        outcome, holds = self.search_plan(float(time), tasks, ArrivalRequest("together", latest), float(time) + latest)
        if outcome.plan is None:
            raise ValueError("the certified planner found no plan with a common arrival time")
        return CertifiedPlanState(outcome.plan, jnp.asarray(FIRST_PLAN), holds, tasks.limits)

    def resolve_limits(self, performance: Performance) -> PathLimits:
        """Return the flight limits with an acceleration and a deceleration limit for every aircraft.

        A limit that the scenario leaves open (infinite) follows from the engine and is at least `ACCELERATION_FLOOR`.
        The acceleration is for full thrust at the start; the deceleration is for idle thrust, and depends on airspeed
        and load factor. Both limits, prescribed or not, are multiplied by 1 - `acceleration_reserve`.
        """

        def resolve(prescribed: Array, available: Array) -> Array:
            return (1.0 - self.acceleration_reserve) * jnp.where(
                jnp.isinf(prescribed), jnp.maximum(available, ACCELERATION_FLOOR), prescribed
            )

        limits, idle = self.limits, performance.idle
        unprescribed = jnp.isinf(limits.deceleration_max)[:, None]
        accelerations = (
            resolve(limits.acceleration_max, performance.acceleration),
            resolve(limits.deceleration_max, performance.deceleration),
        )
        shares = jnp.where(unprescribed, idle.level, 1.0), jnp.where(unprescribed, idle.by_lift, 0.0)
        limits = eqx.tree_at(acceleration_limits, limits, accelerations)
        idle = IdleDeceleration(idle.speeds, *shares)
        return eqx.tree_at(lambda resolve: resolve.idle, limits, idle, is_leaf=lambda leaf: leaf is None)

    def correction_limits(self, limits: PathLimits) -> PathLimits:
        """Return the limits of a path corrected in flight, which may use the `acceleration_reserve`.

        `limits` are the limits of a new path. A negative acceleration limit, of an aircraft that decelerates even at
        full thrust, is raised as well.
        """

        def with_reserve(limit: Array) -> Array:
            return limit / jnp.where(limit < 0.0, 1.0 + self.acceleration_reserve, 1.0 - self.acceleration_reserve)

        return eqx.tree_at(acceleration_limits, limits, replace_fn=with_reserve)

    def search_plan(
        self,
        time: float,  # start of the search, s
        tasks: AircraftTask,  # tasks from `aircraft_tasks`
        request: ArrivalRequest,  # arrival rule, with times after the start of the search
        end_time: float,  # end of the flight, s, up to which the holds keep the separation
        on_progress: Callable[[str], None] = lambda message: None,  # callback for progress messages
        *,
        fixed_paths: FixedPaths | None = None,  # paths of aircraft that are avoided, but not planned
        intervals: int | None = None,  # number of equal intervals between the knots of a path; None: by the duration
        hold_tasks: AircraftTask | None = None,  # tasks of all flying aircraft, which all need holds; None: `tasks`
        former_holds: PlannedHolds | None = None,  # holds in use; None before the flight
        candidate_sets: tuple[CandidateSet, ...] = FleetTask.candidate_sets,  # see `FleetTask`
    ) -> tuple[SearchOutcome, PlannedHolds | None]:
        """Search for a plan with holds that keep separation, keep-outs, altitude limits and distance from the goals.

        Returns the outcome and the holds of its plan. If there is no plan, the holds of `outcome.plan_without_holds`
        are returned, or None if no attempt was feasible up to the arrivals.
        """
        tried: list[tuple[CertifiedPlan, PlannedHolds]] = []
        hold_tasks = tasks if hold_tasks is None else hold_tasks

        def check_holds(plan: CertifiedPlan) -> np.ndarray:
            on_progress("choosing the holds")
            holds = self.assign_holds(plan.paths, hold_tasks, time, end_time, former_holds)
            tried.append((plan, holds))
            return ~np.asarray(holds.clear)

        outcome = search(
            time,
            tasks,
            self.airspace,
            request,
            on_progress=on_progress,
            failed_after_arrival=check_holds,
            fixed_paths=fixed_paths,
            intervals=intervals,
            candidate_sets=candidate_sets,
        )
        selected_plan = outcome.plan_without_holds if outcome.plan is None else outcome.plan
        return outcome, next((holds for plan, holds in tried if plan is selected_plan), None)

    def assign_holds(
        self,
        paths: TimedPath,
        tasks: AircraftTask,
        time: float,
        end_time: float,  # end of the flight, s, up to which the holds keep the separation
        former: PlannedHolds | None = None,  # holds in use
    ) -> PlannedHolds:
        """Assign a hold to each path of a plan made at a time (s), by a compiled program.

        Aircraft that have arrived keep their holds of `former`, which follow the goals.
        """
        return _assign_holds(*self._hold_arguments(paths, tasks, time, end_time, former))

    def _hold_arguments(
        self, paths: TimedPath, tasks: AircraftTask, time: float, end_time: float, former: PlannedHolds | None = None
    ) -> tuple[Any, ...]:
        # If no active aircraft has arrived, `former` has no effect, and the program is that of the first plan.
        cells = choose_cell_count(end_time) if former is None else former.paths.times.shape[1] - 1
        if former is not None and not np.any(
            (np.asarray(paths.times)[:, -1] <= time) & (np.asarray(tasks.active) > 0.0)
        ):
            former = None
        return paths, tasks, self.airspace, self.guidance, as_array(time), as_array(end_time), cells, former

    def prepare_programs(
        self,
        tasks: AircraftTask,  # the fleet's tasks, or their shapes
        # rough flight time of the last aircraft, s; programs are compiled only if 0.95 and 1.2 times this time need the
        # same number of intervals
        longest: float,
        end_time: float,
    ) -> Iterator[PreparedProgram]:
        """Yield the compiled programs of a search from time 0, with holds to `end_time` (s): plans, then holds."""
        intervals = choose_interval_count(longest)
        if {choose_interval_count(0.95 * longest), choose_interval_count(1.2 * longest)} == {intervals}:
            shapes: Any = None
            for program in prepare_plan_at(tasks, self.airspace, intervals):
                yield program
                shapes = program.shapes
            yield _assign_holds.prepare(*self._hold_arguments(shapes.paths, tasks, 0.0, end_time))

    def replan(
        self, planner_state: CertifiedPlanState, time: ScalarLike, reports: AircraftReport
    ) -> CertifiedPlanState:
        """Correct the plan so that it leads to the currently measured goals; return the new planner state.

        `replan_needed` is set if the corrected plan is not proven to keep every constraint, or if goals have shifted
        too far for the holds; once set, the flag stays.
        """
        in_flight = self._plan_in_flight(planner_state, time, reports)
        plan, status, is_feasible = correct_plan(in_flight)
        is_outdated = self._holds_are_outdated(planner_state.holds, in_flight)
        replan_needed = planner_state.replan_needed | ~is_feasible | is_outdated
        return CertifiedPlanState(plan, status, planner_state.holds, planner_state.limits, replan_needed)

    def _plan_in_flight(
        self, planner_state: CertifiedPlanState, time: ScalarLike, reports: AircraftReport
    ) -> PlanInFlight:
        return PlanInFlight(
            plan=planner_state.plan,
            time=time,
            tasks=self.aircraft_tasks(reports, planner_state.limits),
            airspace=self.airspace,
            freeze=self.freeze,
            covariances=reports.goal_covariance,
            correction_limits=self.correction_limits(planner_state.limits),
            has_left=reports.has_left,
            arrival_is_free=self.arrival_is_free,
            latest_arrival=self.latest_arrival,
        )

    def _holds_are_outdated(self, holds: PlannedHolds | None, in_flight: PlanInFlight) -> Flag:
        """Return whether a goal has shifted too far for the holds, and any active aircraft's path is not frozen."""
        if holds is None:
            return jnp.asarray(False)
        tasks, arrivals, time = in_flight.tasks, in_flight.plan.arrival_times, in_flight.time
        can_choose = (tasks.active > 0.0) & (arrivals - time > self.freeze)
        separation = self.airspace.separation
        shifted = goals_have_shifted(holds, tasks, arrivals, time, separation, in_flight.covariances)
        return jnp.any(can_choose) & jnp.any(shifted)

    def replan_between_steps(
        self,
        planner_state: CertifiedPlanState,
        time: float,
        reports: AircraftReport,
    ) -> CertifiedPlanState:
        """Correct, replace or keep the plan, in the order of `correct_or_replace_plan`; return the new planner state.

        A new plan, or a plan with outdated holds, gets new holds. If a hold violates separation, keep-outs or altitude
        limits, a plan with other paths is searched, unless an arrival is too near.
        """
        former, has_left = planner_state.holds, np.asarray(reports.has_left)
        in_flight, planned_tasks, is_outdated = _replanning_inputs(self, planner_state, as_array(time), reports)
        plan, status = correct_or_replace_plan(in_flight)
        holds, tasks = former, in_flight.tasks
        if former is not None and (is_outdated or status == REPLANNED):
            # up to the end of the exit paths, after which no holds follow
            end_time = min(
                _end_of_holds(former), np.min(np.asarray(plan.arrival_times), where=has_left, initial=np.inf)
            )
            active, arrivals = np.asarray(tasks.active) > 0.0, np.asarray(plan.arrival_times)
            flying_tasks = eqx.tree_at(lambda t: t.active, tasks, as_array(active | has_left))
            holds = self.assign_holds(plan.paths, flying_tasks, time, end_time, former)
            can_search = active.any() and np.min(arrivals[active]) - time > max(COMMITTED_S, float(self.freeze))
            if can_search and not np.all(holds.clear):
                times_to_go = np.where(active, arrivals, np.max(arrivals[active])) - time
                intervals = interval_count(plan.paths)
                fixed_paths = exit_paths(plan, has_left)
                new_plan = self._search_in_flight(time, planned_tasks, times_to_go, end_time, intervals, fixed_paths)
                if new_plan is not None:
                    (plan, holds), status = new_plan, REPLANNED
        status_index = as_array(status, planner_state.replanning.dtype)
        return CertifiedPlanState(plan, status_index, holds, planner_state.limits, planner_state.replan_needed)

    def _search_in_flight(
        self,
        time: float,  # current time, s
        tasks: AircraftTask,  # planning problems that start at the planned states, see `tasks_from_plan`
        times_to_go: Float[np.ndarray, " aircraft"],  # times to the planned arrivals, s
        end_time: float,  # end of the holds, s
        intervals: int,  # number of equal intervals between the knots of a path
        fixed_paths: FixedPaths | None,  # exit paths of the aircraft that have left the fleet
    ) -> tuple[CertifiedPlan, PlannedHolds] | None:
        """Search for a plan with other paths and with holds that keep all limits; None if the search fails.

        The planned arrival times are tried first, then later ones if the arrival rule allows a delay, and last the
        planned times with splines. The acceleration along the paths is limited to `_ACCELERATION_M_S2`.
        """
        latest_to_go = float(self.latest_arrival) - time
        all_aircraft = as_array(np.ones(times_to_go.shape), bool)
        delays, count = arrival_delays(as_array(times_to_go), 0.0, all_aircraft, self.arrival_is_free, latest_to_go)
        attempts = [(float(delay), _WITHOUT_SPLINES) for delay in np.asarray(delays)[: int(count)]]
        tasks = eqx.tree_at(lambda t: t.limits, tasks, with_gentle_acceleration(tasks.limits, _ACCELERATION_M_S2))
        is_flying = tasks.active if fixed_paths is None else as_array(tasks.active) + fixed_paths.selected
        hold_tasks = eqx.tree_at(lambda t: t.active, tasks, is_flying)
        for delay, candidate_sets in [*attempts, (0.0, (WITH_SPLINES,))]:
            request = ArrivalRequest("times", latest_to_go, times_s=times_to_go + delay)
            outcome, holds = self.search_plan(
                time,
                tasks,
                request,
                end_time,
                fixed_paths=fixed_paths,
                intervals=intervals,
                hold_tasks=hold_tasks,
                candidate_sets=candidate_sets,
            )
            if outcome.plan is not None and holds is not None:
                return outcome.plan, holds
        return None

    def replan_needed(self, planner_state: CertifiedPlanState) -> Flag:
        """Return whether the plan or its holds must be replaced, for which the flight stops between two steps."""
        return planner_state.replan_needed

    def plans(self, planner_state: CertifiedPlanState) -> AircraftPlan:
        """Return the plan in force for the closed loop: each aircraft's path, arrival time (s), hold and status 0."""
        plan = planner_state.plan
        # Success: a fleet without a plan is refused before the flight.
        planned = jnp.zeros(plan.lengths.shape, dtype=jnp.int32)
        return AircraftPlan(
            trajectory=plan.paths,
            arrival_time=plan.arrival_times,
            status=planned,
            length=plan.lengths,
            lateral_bend=jnp.full_like(plan.lengths, jnp.nan),
            replanning=jnp.broadcast_to(planner_state.replanning, planned.shape),
            hold=None if planner_state.holds is None else broadcast_holds(planner_state.holds),
        )

    def aircraft_tasks(self, reports: AircraftReport, limits: PathLimits) -> AircraftTask:
        """Return the planning problem of each aircraft from its report; the initial acceleration is taken as 0."""
        return AircraftTask(
            position_n=reports.position_n,
            air_velocity_n=reports.air_velocity_n,
            air_acceleration_n=jnp.zeros_like(reports.air_velocity_n),
            goal_position_n=reports.goal_position_n,
            goal_velocity_n=reports.goal_velocity_n,
            rendezvous=reports.rendezvous,
            speed=self.speed,
            side=self.sides,
            limits=limits,
            roll_rate_max=self.roll_rates_max,
            active=as_array(reports.active),
        )


def _end_of_holds(holds: PlannedHolds) -> float:
    """Return the end of the holds, s; at most `CELL_S` times the number of cells, the reach of new holds."""
    times = np.asarray(holds.paths.times)
    cells = times.shape[1] - 1
    return min(float(np.max(times)), CELL_S * cells)


@compiled_quickly
def _replanning_inputs(
    planner: CertifiedPlanner, planner_state: CertifiedPlanState, time: Scalar, reports: AircraftReport
) -> tuple[PlanInFlight, AircraftTask, Flag]:
    """Return the plan in flight, the tasks from the planned states at `time` (s), and whether holds are outdated."""
    in_flight = planner._plan_in_flight(planner_state, time, reports)
    is_outdated = planner._holds_are_outdated(planner_state.holds, in_flight)
    return in_flight, tasks_from_plan(in_flight.plan, in_flight.tasks, time), is_outdated
