"""The published planner as a part of the closed loop.

With the choice of detour sides and the check of its trajectories against the limits.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int, Real

from anser.constants import STANDARD_GRAVITY_M_S2
from anser.control.ground_clearance import level_off_height
from anser.numerics.arrays import zeros_like_result
from anser.numerics.randomness import AbstractRandomness
from anser.parts.paths import polar
from anser.parts.planners import AbstractPlanner, AircraftPlan, AircraftReport, Performance
from anser.planning.demand import demand
from anser.planning.limits import PathLimits
from anser.planning.published.coordination import FleetPlan, PlanningTask, coordinate, replan
from anser.planning.published.trajectory import Trajectory, bend_trajectory, solve_lateral_bend, with_even_speed
from anser.shapes import Count, Flag, Scalar, ScalarLike
from anser.spatial.vectors import safe_sqrt

# Least distances that differ by less than this (m) count as equal: often the rendezvous points decide for both sides.
_SAME_DISTANCE = 1.0


def choose_sides(plan: FleetPlan, requested: Real[Array, " aircraft"], count: int = 65) -> Float[Array, " aircraft"]:
    """Side of each aircraft's detour: as requested, else the one that keeps it farther from the others.

    Parameters
    ----------
    plan
        A plan of the fleet with any sides.
    requested
        Positive: right; negative: left; zero: choose.
    count
        Number of instants at which distances are compared.

    Returns
    -------
    +1 or -1 per aircraft. The aircraft are placed one after the other, the longest nominal path first; each free one
    takes the side with the greater least distance to those placed already; where that is the same within 1 m, the side
    with the smaller bend. Those that do not fly are kept clear of by none.
    """
    straightened = jax.vmap(lambda path, kappa: bend_trajectory(path, -kappa))(plan.trajectories, plan.lateral_bends)
    nominal = eqx.tree_at(lambda path: path.law, straightened, plan.trajectories.law)
    fleet = plan.nominal_lengths.shape[0]

    def options(path: Trajectory) -> tuple[Float[Array, "2 count 3"], Float[Array, "2"]]:
        def one(side: Float[Array, ""]) -> tuple[Float[Array, "count 3"], Float[Array, ""]]:
            kappa = solve_lateral_bend(path, plan.reference_length, side).kappa
            bent = with_even_speed(
                bend_trajectory(path, kappa), path.law.speeds[0], exchange=path.law.exchange, even=path.law.even
            )
            return positions_along(bent, count), jnp.abs(kappa)

        return jax.vmap(one)(jnp.array([1.0, -1.0]))

    paths, bends = jax.vmap(options)(nominal)
    order = jnp.argsort(-plan.nominal_lengths)

    def place(
        turn: Int[Array, ""],
        carry: tuple[Float[Array, " aircraft"], Float[Array, "aircraft count 3"], Bool[Array, " aircraft"]],
    ) -> tuple[Array, Array, Array]:
        sides, chosen, placed = carry
        who = order[turn]
        apart = paths[who][:, None, :, :] - chosen[None, :, :, :]
        square = jnp.min(jnp.sum(apart * apart, axis=3), axis=2)
        right, left = jnp.sqrt(jnp.min(jnp.where(placed[None, :], square, jnp.inf), axis=1))
        milder = (bends[who][1] < bends[who][0]) & (left + _SAME_DISTANCE >= right)
        free = jnp.where((left > right + _SAME_DISTANCE) | milder, -1.0, 1.0)
        side = jnp.where(requested[who] == 0, free, jnp.where(requested[who] < 0, -1.0, 1.0))
        path = jnp.where(side > 0.0, paths[who][0], paths[who][1])
        return sides.at[who].set(side), chosen.at[who].set(path), placed.at[who].set(plan.active[who])

    start = (jnp.ones(fleet), jnp.zeros((fleet, count, 3)), jnp.zeros(fleet, dtype=bool))
    return lax.fori_loop(0, fleet, place, start)[0]


def positions_along(trajectory: Trajectory, count: int) -> Float[Array, "count 3"]:
    """Positions over the ground at equal intervals from start to rendezvous, NED, m."""
    times = trajectory.start_time + trajectory.duration * jnp.linspace(0.0, 1.0, count)
    return jax.vmap(trajectory.position_n)(times)


def separation_min(
    trajectories: Trajectory, count: int = 65, active: Bool[Array, " aircraft"] | None = None
) -> Float[Array, "aircraft aircraft"]:
    """Least distance between any two aircraft during their common flight, m; infinite on the diagonal.

    Parameters
    ----------
    trajectories
        Stacked, leading axis aircraft; of those that are active, all with one start time and duration.
    count
        Number of instants looked at, ends included. Between them the distance may be less by no more than half
        the relative speed times the interval.
    active
        Which aircraft fly; infinite from and to one that does not. None: all fly.
    """
    positions = jnp.swapaxes(jax.vmap(lambda trajectory: positions_along(trajectory, count))(trajectories), 0, 1)
    fleet = positions.shape[1]

    def closer(least: Float[Array, "aircraft aircraft"], now: Float[Array, "aircraft 3"]) -> tuple[Array, None]:
        apart = now[:, None, :] - now[None, :, :]
        return jnp.minimum(least, jnp.sum(apart * apart, axis=2)), None

    # Instant by instant: memory stays quadratic in the fleet.
    square, _ = lax.scan(closer, jnp.full((fleet, fleet), jnp.inf), positions)
    unlike = ~jnp.eye(fleet, dtype=bool)
    if active is not None:
        unlike = unlike & active[:, None] & active[None, :]
    return jnp.where(unlike, safe_sqrt(square), jnp.inf)


# The pull, beyond carrying the weight, that a plan leaves to the hold: 1 g, as any speed allows at which the lift at
# alpha_max is 2.2 times the weight (the F-16 from 95 m/s on), and of a smaller load factor limit three quarters.
_PULL = STANDARD_GRAVITY_M_S2
_PULL_SHARE = 0.75


class LimitReport(eqx.Module):
    """Extremes along a trajectory, and which limits they keep."""

    speed_min: Scalar
    """m/s, relative to the air."""
    speed_max: Scalar
    """m/s, relative to the air."""
    turn_rate_max: Scalar
    """Greatest course rate, either way, rad/s."""
    turn_utilization_max: Scalar
    """Greatest ratio of the course rate to what the bank limit allows at the speed of that point; 1 is the limit."""
    climb_rate_max: Scalar
    """Greatest vertical speed relative to the air, up or down, m/s."""
    altitude_min: Scalar
    """m, over the ground frame's origin."""
    level_off_altitude: Scalar
    """Where the descent at arrival ends when the hold levels it off with 1 g beyond the weight, m."""
    is_satisfied: Bool[Array, " limits"]
    """In the order of LIMIT_MESSAGES, from the second on."""
    status: Count
    """First limit broken, an index into LIMIT_MESSAGES; 0 is none."""


def check_limits(trajectory: Trajectory, limits: PathLimits, gravity: ScalarLike, count: int = 129) -> LimitReport:
    """Compare a trajectory with an aircraft's limits at `count` even instants from start to rendezvous.

    Theory section 6, "Dynamic limits on the whole path": |chi_dot| < g tan(bank_max)/V. Speed, turn and climb are
    those relative to the air, which is what the aircraft feels; altitude is over the ground. The end state is what a
    hold can catch: see `level_off_height`, with the bank and the vertical acceleration of the path's end.
    """
    times = trajectory.start_time + trajectory.duration * jnp.linspace(0.0, 1.0, count)
    points = jax.vmap(trajectory.at)(times)
    command = jax.vmap(polar)(points.velocity_n - trajectory.wind_n[None], points.acceleration_n)
    altitudes = -points.position_n[:, 2]
    altitude_min = jnp.min(altitudes)
    level_off_altitude = altitudes[-1] - _level_off_of_end(trajectory, limits, gravity)
    turn_rate = jnp.abs(command.chi_dot)
    turn_utilization_max = jnp.max(turn_rate * command.V) / (gravity * jnp.tan(limits.bank_max))
    climb_rate_max = jnp.max(jnp.abs(command.V * jnp.sin(command.gamma)))
    speed_min, speed_max = jnp.min(command.V), jnp.max(command.V)
    kept = jnp.stack(
        [
            speed_min >= limits.speed_min,
            speed_max <= limits.speed_max,
            turn_utilization_max <= 1.0,
            climb_rate_max <= limits.climb_rate_max,
            altitude_min >= limits.altitude_min,
            level_off_altitude >= limits.altitude_min,
        ]
    )
    return LimitReport(
        speed_min,
        speed_max,
        jnp.max(turn_rate),
        turn_utilization_max,
        climb_rate_max,
        altitude_min,
        level_off_altitude,
        kept,
        status=jnp.where(jnp.all(kept), 0, 1 + jnp.argmin(kept)),
    )


def _level_off_of_end(trajectory: Trajectory, limits: PathLimits, gravity: ScalarLike) -> Scalar:
    """Height that the hold needs to end the descent with which a trajectory arrives, m."""
    end = trajectory.start_time + trajectory.duration
    last = trajectory.at(end)
    asked = demand(last.velocity_n - trajectory.wind_n, last.acceleration_n, gravity)
    bank = jnp.arctan2(asked.side, jnp.maximum(asked.lift, 0.1 * gravity))
    pull = jnp.minimum(_PULL, _PULL_SHARE * (limits.load_factor_max - 1.0) * gravity)
    return level_off_height(asked.speed, last.velocity_n[2], last.acceleration_n[2], bank, pull)


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
    flown_length: Float[Array, " aircraft"]
    replan_needed: Flag


class PublishedPlanner(AbstractPlanner):
    """Theory section 8, see `coordinate` and `replan`.

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
    allow_replanning: bool = eqx.field(static=True, default=True)

    def first_plan(self, time: ScalarLike, reports: AircraftReport, performance: Performance) -> PublishedPlanState:
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
        begin = (requested, requested, zeros_like_result(planned, requested))
        _, sides, plan = jax.lax.fori_loop(0, 2, again, begin)
        return PublishedPlanState(plan, sides, deceleration, flown, jnp.asarray(False))

    def replan(
        self, planner_state: PublishedPlanState, time: ScalarLike, reports: AircraftReport
    ) -> PublishedPlanState:
        """The rest of the same paths, or a fleet coordinated anew."""
        tasks = self._tasks(
            time, reports, planner_state.plan.speed, planner_state.flown_length, planner_state.deceleration
        )
        plan, asked = replan(
            planner_state.plan, time, tasks, planner_state.sides, self.even_speed, self.allow_replanning
        )
        return eqx.tree_at(
            lambda m: (m.plan, m.replan_needed), planner_state, (plan, planner_state.replan_needed | asked)
        )

    def observe(
        self,
        planner_state: PublishedPlanState,
        reports: AircraftReport,
        number: Count,
        step: ScalarLike,
        randomness: AbstractRandomness | None,
    ) -> PublishedPlanState:
        """Count the length flown."""
        flown = planner_state.flown_length + jnp.where(reports.active, step * reports.airspeed, 0.0)
        return eqx.tree_at(lambda m: m.flown_length, planner_state, flown)

    def plans(self, planner_state: PublishedPlanState) -> AircraftPlan:
        """See `AbstractPlanner`."""
        plan = planner_state.plan
        renewal = jnp.zeros(plan.status.shape, dtype=jnp.int32)
        return AircraftPlan(
            plan.trajectories, plan.arrival_times, plan.status, plan.lengths, plan.lateral_bends, renewal
        )

    def _tasks(
        self,
        time: ScalarLike,
        reports: AircraftReport,
        speed: ScalarLike,
        flown_length: Float[Array, " aircraft"],
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
            path_length_deficit=speed * time - flown_length,
            deceleration=deceleration,
            active=reports.active,
        )
