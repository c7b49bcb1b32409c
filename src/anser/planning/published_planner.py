"""The published planner as a part of the closed loop: one arrival time for all, detours by lateral bends."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from anser.numerics import AbstractRandomness, zeros_as
from anser.planning.coordination import FleetPlan, PlanningTask, coordinate
from anser.planning.interface import AbstractPlanner, AircraftPlan, Performance, Report
from anser.planning.renewal import renew
from anser.planning.sides import choose_sides
from anser.shapes import Count, Flag, Scalar, ScalarLike


class PublishedPlanState(eqx.Module):
    """What the published planner carries along.

    Attributes
    ----------
    plan
        In force.
    sides
        Side of each detour, chosen with the first plan and kept.
    deceleration
        What each can hold with the engine idle in level flight at its start, m/s^2.
    flown
        Length of the path through the air flown so far, m.
    asked
        Whether a plan made anew was due that a planner which does not replan could not make.
    """

    plan: FleetPlan
    sides: Float[Array, " aircraft"]
    deceleration: Float[Array, " aircraft"]
    flown: Float[Array, " aircraft"]
    asked: Flag


class PublishedPlanner(AbstractPlanner):
    """Theory section 8, see `coordinate` and `renew`.

    Attributes
    ----------
    start_positions_n
        Where each begins, m.
    sides
        Side of the detour: +1 right, -1 left, 0 toward more separation.
    speed
        Mean airspeed that the plan gives to all, m/s.
    even_speed
        Whether paths are flown at an even speed rather than with the published time law.
    replans
        Whether the fleet is coordinated anew on the way where that is due. Without, it is a smaller program; its state
        says where the other one is needed.
    """

    start_positions_n: Float[Array, "aircraft 3"]
    sides: Int[Array, " aircraft"]
    speed: Scalar
    even_speed: Flag
    replans: bool = eqx.field(static=True, default=True)

    def first(self, time: ScalarLike, reports: Report, performance: Performance) -> PublishedPlanState:
        """Plan both ways, choose the sides of the detours, plan."""
        requested = self.sides.astype(float)
        flown, deceleration = jnp.zeros_like(requested), performance.deceleration
        tasks = self._tasks(time, reports, self.speed, flown, deceleration)
        start_time = jnp.asarray(time, dtype=float)

        def planned(sides: Float[Array, " aircraft"]) -> FleetPlan:
            return coordinate(start_time, tasks, self.speed, sides, self.even_speed)

        def again(_: object, carry: tuple[Array, Array, FleetPlan]) -> tuple[Array, Array, FleetPlan]:
            plan = planned(carry[0])
            return choose_sides(plan, requested), carry[0], plan

        # A loop: one copy of the planning in the compiled code.
        begin = (requested, requested, zeros_as(planned, requested))
        _, sides, plan = jax.lax.fori_loop(0, 2, again, begin)
        return PublishedPlanState(plan, sides, deceleration, flown, jnp.asarray(False))

    def renew(self, memory: PublishedPlanState, time: ScalarLike, reports: Report) -> PublishedPlanState:
        """The rest of the same paths, or a fleet coordinated anew."""
        tasks = self._tasks(time, reports, memory.plan.speed, memory.flown, memory.deceleration)
        plan, asked = renew(memory.plan, time, tasks, memory.sides, self.even_speed, self.replans)
        return eqx.tree_at(lambda m: (m.plan, m.asked), memory, (plan, memory.asked | asked))

    def observe(
        self,
        memory: PublishedPlanState,
        reports: Report,
        number: Count,
        step: ScalarLike,
        randomness: AbstractRandomness | None,
    ) -> PublishedPlanState:
        """Count the length flown."""
        flown = memory.flown + jnp.where(reports.active, step * reports.airspeed, 0.0)
        return eqx.tree_at(lambda m: m.flown, memory, flown)

    def plans(self, memory: PublishedPlanState) -> AircraftPlan:
        """See `AbstractPlanner`."""
        plan = memory.plan
        renewal = jnp.zeros(plan.status.shape, dtype=jnp.int32)
        return AircraftPlan(
            plan.trajectories, plan.arrival_times, plan.status, plan.lengths, plan.lateral_bends, renewal
        )

    def _tasks(
        self,
        time: ScalarLike,
        reports: Report,
        speed: ScalarLike,
        flown: Float[Array, " aircraft"],
        deceleration: Float[Array, " aircraft"],
    ) -> PlanningTask:
        return PlanningTask(
            position_n=reports.position_n,
            air_velocity_n=reports.air_velocity_n,
            goal_position_n=reports.goal_position_n,
            goal_velocity_n=reports.goal_velocity_n,
            rendezvous=reports.rendezvous,
            wind_n=reports.wind_n,
            origin_n=self.start_positions_n + reports.wind_n * time,
            path_length_deficit=speed * time - flown,
            deceleration=deceleration,
            active=reports.active,
        )
