"""The certified planner as a part of the closed loop: paths with certificates, and the holds after them."""

from collections.abc import Callable, Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from anser.compiling.options import compiled_quickly
from anser.compiling.program import PreparedProgram
from anser.control.guidance import GuidanceSettings
from anser.numerics.arrays import any_in_batch, as_array
from anser.numerics.randomness import AbstractRandomness
from anser.parts.planners import AbstractPlanner, AircraftPlan, AircraftReport, IdleDeceleration, Performance
from anser.planning.certified.certified_plan import CertifiedPlan, choose_interval_count, plan_at
from anser.planning.certified.replanning import FIRST_PLAN, REPLANNED, replan_certified
from anser.planning.certified.search import SearchOutcome, search
from anser.planning.certified.task import AircraftTask, Airspace, ArrivalRequest
from anser.planning.certified.timed_profiles import STANDARD
from anser.planning.holds.assignment import assign_holds
from anser.planning.holds.hold_paths import PlannedHolds, broadcast_holds, choose_cell_count, move_with_goals
from anser.planning.limits import PathLimits, acceleration_limits
from anser.planning.timed_path import TimedPath
from anser.shapes import Count, Flag, Scalar, ScalarLike
from anser.steady.performance import ACCELERATION_FLOOR

_assign_holds = compiled_quickly(assign_holds)


class CertifiedPlanState(eqx.Module):
    """What the certified planner carries along.

    Attributes
    ----------
    plan
        In force.
    renewal
        How it came about: index into `REPLANNING_MESSAGES`.
    holds
        What the aircraft fly after their arrival; None: what their own hold says.
    limits
        What each path may ask, the accelerations that its engine gives among it; leading axis aircraft.
    asked
        Whether a plan made anew was due that a planner which does not replan could not make.
    """

    plan: CertifiedPlan
    replanning: Count
    holds: PlannedHolds | None
    limits: PathLimits
    replan_needed: Flag = eqx.field(default_factory=lambda: as_array(False, bool))


class CertifiedPlanner(AbstractPlanner):
    """See `anser.planning.certified`.

    Attributes
    ----------
    sides
        Side of each aircraft's detour: +1 right, -1 left, 0 either.
    speed
        Mean airspeed that each prefers, m/s.
    limits
        What each path may ask; leading axis aircraft.
    roll_rates_max
        How fast a path may change the bank angle, rad/s.
    airspace
        Wind, distances, keep-outs.
    guidance
        Numbers of the holds.
    movable
        Whether arrival times may be put off on the way.
    latest
        But not beyond this, s.
    freeze
        A path stands as it is for this long before its arrival, s.
    replans
        Whether a plan is made anew on the way where one bent will not do. Without, it is a much smaller program; its
        state says where the other one is needed.
    spared
        Part of the accelerations along the path that a new path leaves to the autopilot, above all to the engine's
        spooling down, and for being bent.
    """

    sides: Int[Array, " aircraft"]
    speed: Float[Array, " aircraft"]
    limits: PathLimits
    roll_rates_max: Float[Array, " aircraft"]
    airspace: Airspace
    guidance: GuidanceSettings
    arrival_is_free: Flag
    latest_arrival: Scalar
    freeze: Scalar
    allow_replanning: bool = eqx.field(static=True, default=True)
    acceleration_reserve: Scalar = eqx.field(default_factory=lambda: as_array(0.0))

    def first_plan(self, time: ScalarLike, reports: AircraftReport, performance: Performance) -> CertifiedPlanState:
        """Search for a plan in which all arrive together, with holds up to the latest arrival: not to be traced.

        For other rules of arrival, and for what stands in the way of a plan, see `searched`.

        Raises
        ------
        ValueError
            No plan was found.
        """
        latest = float(self.latest_arrival)
        tasks = self.aircraft_tasks(reports, self.resolve_limits(performance))
        outcome, holds = self.search_plan(float(time), tasks, ArrivalRequest("together", latest), float(time) + latest)
        if outcome.plan is None:
            raise ValueError("the certified planner found no plan in which all arrive together")
        return CertifiedPlanState(outcome.plan, jnp.asarray(FIRST_PLAN), holds, tasks.limits)

    def resolve_limits(self, performance: Performance) -> PathLimits:
        """The limits with the accelerations that the engine gives, where none are prescribed.

        With all its thrust that is what it gives at the start; idle, it changes with airspeed and load factor. What is
        `acceleration_reserve` is taken off.
        """

        def own(prescribed: Array, able: Array) -> Array:
            return (1.0 - self.acceleration_reserve) * jnp.where(
                jnp.isinf(prescribed), jnp.maximum(able, ACCELERATION_FLOOR), prescribed
            )

        limits, idle = self.limits, performance.idle
        free = jnp.isinf(limits.deceleration_max)[:, None]
        accelerations = (
            own(limits.acceleration_max, performance.acceleration),
            own(limits.deceleration_max, performance.deceleration),
        )
        shares = jnp.where(free, idle.level, 1.0), jnp.where(free, idle.by_lift, 0.0)
        limits = eqx.tree_at(acceleration_limits, limits, accelerations)
        idle = IdleDeceleration(idle.speeds, *shares)
        return eqx.tree_at(lambda own: own.idle, limits, idle, is_leaf=lambda leaf: leaf is None)

    def correction_limits(self, limits: PathLimits) -> PathLimits:
        """Limits of a path that is corrected on the way: those of a new path, with `acceleration_reserve` added."""
        return eqx.tree_at(
            acceleration_limits, limits, replace_fn=lambda most: most / (1.0 - self.acceleration_reserve)
        )

    def search_plan(
        self,
        time: float,
        tasks: AircraftTask,
        request: ArrivalRequest,
        end_time: float,
        on_progress: Callable[[str], None] = lambda what: None,
    ) -> tuple[SearchOutcome, PlannedHolds | None]:
        """A first plan with its holds; or, without a plan, the holds that came nearest, if any were tried.

        Parameters
        ----------
        time
            Now, s.
        tasks
            From `aircraft_tasks`.
        request
            When the aircraft are to arrive.
        until
            End of the flight, s: up to then the holds keep the separation.
        on_progress
            Called with what is being done.
        """
        tried: list[tuple[CertifiedPlan, PlannedHolds]] = []

        def after(plan: CertifiedPlan) -> np.ndarray:
            on_progress("choosing the holds")
            holds = _assign_holds(*self._hold_arguments(plan.paths, tasks, time, end_time))
            tried.append((plan, holds))
            return ~np.asarray(holds.clear)

        outcome = search(time, tasks, self.airspace, request, on_progress=on_progress, failed_after_arrival=after)
        wanted = outcome.plan_without_holds if outcome.plan is None else outcome.plan
        return outcome, next((holds for plan, holds in tried if plan is wanted), None)

    def _hold_arguments(self, paths: TimedPath, tasks: AircraftTask, time: float, end_time: float) -> tuple[Any, ...]:
        return (
            paths,
            tasks,
            self.airspace,
            self.guidance,
            as_array(time),
            as_array(end_time),
            choose_cell_count(end_time),
        )

    def prepare_programs(self, tasks: AircraftTask, longest: float, end_time: float) -> Iterator[PreparedProgram]:
        """Prepare, one after the other, the programs that a search from time 0 will need.

        Parameters
        ----------
        tasks
            The fleet, or shapes of it.
        longest
            Roughly how long the last aircraft will be on its way, s: where that leaves the size of the paths open,
            nothing is prepared.
        until
            As of `searched`.

        Yields
        ------
        Those that make plans (`CertifiedPlan`) and holds (`PlannedHolds`).
        """
        intervals = choose_interval_count(longest)
        if {choose_interval_count(0.95 * longest), choose_interval_count(1.2 * longest)} == {intervals}:
            durations = jax.ShapeDtypeStruct(tasks.active.shape, tasks.active.dtype)
            first = plan_at.prepare(0.0, tasks, self.airspace, durations, intervals, STANDARD, None)
            yield first
            yield _assign_holds.prepare(*self._hold_arguments(first.shapes.paths, tasks, 0.0, end_time))

    def replan(
        self, planner_state: CertifiedPlanState, time: ScalarLike, reports: AircraftReport
    ) -> CertifiedPlanState:
        """The plan bent, made anew or kept, see `replan_certified`; with it the holds that are not flown yet."""
        own = self.aircraft_tasks(reports, planner_state.limits)
        made = replan_certified(
            planner_state.plan,
            time,
            own,
            self.airspace,
            self.arrival_is_free,
            self.freeze,
            self.latest_arrival,
            self.allow_replanning,
            reports.goal_covariance,
            self.correction_limits(planner_state.limits),
        )
        former, asked = planner_state.holds, planner_state.replan_needed | made.replan_needed
        if former is None or not self.allow_replanning:
            return CertifiedPlanState(made.plan, made.status, former, planner_state.limits, asked)
        planned_anew = made.status == REPLANNED

        def chosen_anew() -> PlannedHolds:
            until, cells = jnp.max(former.paths.times), former.paths.times.shape[1] - 1
            moved = move_with_goals(former, own, time)
            return assign_holds(made.plan.paths, own, self.airspace, self.guidance, time, until, cells, moved)

        holds = jax.lax.cond(any_in_batch(planned_anew), chosen_anew, lambda: former)
        holds = jax.tree.map(lambda new, old: jnp.where(planned_anew, new, old), holds, former)
        return CertifiedPlanState(made.plan, made.status, holds, planner_state.limits, asked)

    def observe(
        self,
        planner_state: CertifiedPlanState,
        reports: AircraftReport,
        number: Count,
        step: ScalarLike,
        randomness: AbstractRandomness | None,
    ) -> CertifiedPlanState:
        """Nothing is taken from the way flown."""
        return planner_state

    def plans(self, planner_state: CertifiedPlanState) -> AircraftPlan:
        """See `AbstractPlanner`: a fleet without a plan is refused before it flies, so all are "planned"."""
        plan = planner_state.plan
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
        """What the planner reckons with for each aircraft; in steady straight flight, as at the start."""
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
            active=jnp.where(reports.active, 1.0, 0.0),
        )
