"""The published planner in flight: side of each detour (right or left), and check of the paths against the limits."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int, Real

from anser.compiling.options import compiled_by_older_generator
from anser.constants import STANDARD_GRAVITY_M_S2
from anser.control.ground_clearance import level_off_height
from anser.numerics.arrays import as_array, zeros_like_result
from anser.numerics.randomness import AbstractRandomness
from anser.parts.paths import polar
from anser.parts.planners import AbstractPlanner, AircraftPlan, AircraftReport, Performance
from anser.planning.demand import demand
from anser.planning.limits import PathLimits
from anser.planning.published.coordination import FleetPlan, PlanningTask, continue_plan, coordinate, replan
from anser.planning.published.trajectory import Trajectory, bend_trajectory, solve_lateral_bend, with_even_speed
from anser.shapes import Flag, Integer, Scalar, ScalarLike
from anser.spatial.vectors import safe_sqrt

_SAME_DISTANCE = 1.0  # m: smaller differences are ignored, because rendezvous points often limit both sides equally


def choose_sides(
    plan: FleetPlan,  # a plan of the fleet with any sides
    requested: Real[Array, " aircraft"],  # positive: right; negative: left; zero: free choice
    count: int = 65,  # number of instants for the comparison of distances
) -> Float[Array, " aircraft"]:
    """Choose the side of each aircraft's detour, +1 right or -1 left: as requested; if free, farther from the others.

    Aircraft are placed one after the other, the longest nominal path first. A free aircraft gets the side on which the
    least distance from the aircraft placed before is greater. If these distances are equal within 1 m, the smaller bend
    decides. Distances from inactive aircraft do not count.
    """
    straightened = jax.vmap(lambda path, kappa: bend_trajectory(path, -kappa))(plan.trajectories, plan.lateral_bends)
    nominal = eqx.tree_at(lambda path: path.law, straightened, plan.trajectories.law)
    fleet = plan.nominal_lengths.shape[0]

    def options(path: Trajectory) -> tuple[Float[Array, "2 count 3"], Float[Array, "2"]]:
        def side_option(side: Float[Array, ""]) -> tuple[Float[Array, "count 3"], Float[Array, ""]]:
            kappa = solve_lateral_bend(path, plan.reference_length, side).kappa
            bent_path = with_even_speed(
                bend_trajectory(path, kappa), path.law.speeds[0], exchange=path.law.exchange, even=path.law.even
            )
            return positions_along(bent_path, count), jnp.abs(kappa)

        return jax.vmap(side_option)(jnp.array([1.0, -1.0]))

    paths, bends = jax.vmap(options)(nominal)
    order = jnp.argsort(-plan.nominal_lengths)

    def place_aircraft(
        order_index: Int[Array, ""],
        carry: tuple[Float[Array, " aircraft"], Float[Array, "aircraft count 3"], Bool[Array, " aircraft"]],
    ) -> tuple[Array, Array, Array]:
        sides, chosen_paths, placed = carry
        index = order[order_index]
        offset = paths[index][:, None, :, :] - chosen_paths[None, :, :, :]
        square = jnp.min(jnp.sum(offset * offset, axis=3), axis=2)
        right_distance, left_distance = jnp.sqrt(jnp.min(jnp.where(placed[None, :], square, jnp.inf), axis=1))
        left_bend_smaller = (bends[index][1] < bends[index][0]) & (left_distance + _SAME_DISTANCE >= right_distance)
        free_side = jnp.where((left_distance > right_distance + _SAME_DISTANCE) | left_bend_smaller, -1.0, 1.0)
        side = jnp.where(requested[index] == 0, free_side, jnp.where(requested[index] < 0, -1.0, 1.0))
        path = jnp.where(side > 0.0, paths[index][0], paths[index][1])
        return sides.at[index].set(side), chosen_paths.at[index].set(path), placed.at[index].set(plan.active[index])

    start = (jnp.ones(fleet), jnp.zeros((fleet, count, 3)), jnp.zeros(fleet, dtype=bool))
    return lax.fori_loop(0, fleet, place_aircraft, start)[0]


def positions_along(trajectory: Trajectory, count: int) -> Float[Array, "count 3"]:
    """Return `count` positions over the ground at equal time intervals from start to rendezvous, NED, m."""
    times = trajectory.start_time + trajectory.duration * jnp.linspace(0.0, 1.0, count)
    return jax.vmap(trajectory.position_n)(times)


def separation_min(
    trajectories: Trajectory,  # stacked, leading axis aircraft; active aircraft have the same start time and duration
    # number of instants, both ends included; between instants, the distance may be smaller by up to half the relative
    # speed times the interval
    count: int = 65,
    # mask of the active aircraft; distances of inactive aircraft are infinite. None: every aircraft
    active: Bool[Array, " aircraft"] | None = None,
) -> Float[Array, "aircraft aircraft"]:
    """Return the least distance of each pair of aircraft at `count` instants, m; infinite on the diagonal."""
    positions = jnp.swapaxes(jax.vmap(lambda trajectory: positions_along(trajectory, count))(trajectories), 0, 1)
    fleet = positions.shape[1]

    def include_instant(
        minimum: Float[Array, "aircraft aircraft"], positions: Float[Array, "aircraft 3"]
    ) -> tuple[Array, None]:
        offset = positions[:, None, :] - positions[None, :, :]
        return jnp.minimum(minimum, jnp.sum(offset * offset, axis=2)), None

    # One instant at a time: memory is quadratic in the fleet.
    square, _ = lax.scan(include_instant, jnp.full((fleet, fleet), jnp.inf), positions)
    is_pair = ~jnp.eye(fleet, dtype=bool)
    if active is not None:
        is_pair = is_pair & active[:, None] & active[None, :]
    return jnp.where(is_pair, safe_sqrt(square), jnp.inf)


# Vertical acceleration that a plan assumes for the level-off in the hold: 1 g, which needs a lift of 2.2 times the
# weight at alpha_max (F-16: from 95 m/s); for a small load factor limit, 0.75 (limit - 1) g.
_PULL_MAX = STANDARD_GRAVITY_M_S2
_PULL_SHARE = 0.75


class LimitReport(eqx.Module):
    """Least and greatest flight quantities at samples of a trajectory, and whether the samples keep each limit.

    Airspeeds and rates are relative to the air. Between the samples, nothing is proven.
    """

    speed_min: Scalar  # m/s
    speed_max: Scalar  # m/s
    turn_rate_max: Scalar  # rad/s
    turn_utilization_max: Scalar  # turn rate / turn rate at the bank limit
    climb_rate_max: Scalar  # up or down, m/s
    altitude_min: Scalar  # m
    level_off_altitude: Scalar  # least altitude of the level-off after the arrival, m
    is_satisfied: Bool[Array, " limits"]  # for each limit of LIMIT_MESSAGES
    status: Integer  # index of the first violated limit in LIMIT_MESSAGES; 0: no violation


def check_limits(trajectory: Trajectory, limits: PathLimits, gravity: ScalarLike, count: int = 129) -> LimitReport:
    """Compare a trajectory with flight limits at `count` equidistant instants from start to rendezvous.

    Theory section 6, "Dynamic limits on the whole path": |chi_dot| < g tan(bank_max)/V. The least altitude must be kept
    on the path, and in a level-off from the state at the arrival.
    """
    times = trajectory.start_time + trajectory.duration * jnp.linspace(0.0, 1.0, count)
    points = jax.vmap(trajectory.at)(times)
    command = jax.vmap(polar)(points.velocity_n - trajectory.wind_n[None], points.acceleration_n)
    altitudes = -points.position_n[:, 2]
    altitude_min = jnp.min(altitudes)
    level_off_altitude = altitudes[-1] - _level_off_height(trajectory, limits, gravity)
    turn_rate = jnp.abs(command.chi_dot)
    turn_utilization_max = jnp.max(turn_rate * command.V) / (gravity * jnp.tan(limits.bank_max))
    climb_rate_max = jnp.max(jnp.abs(command.V * jnp.sin(command.gamma)))
    speed_min, speed_max = jnp.min(command.V), jnp.max(command.V)
    is_satisfied = jnp.stack(
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
        is_satisfied,
        status=jnp.where(jnp.all(is_satisfied), 0, 1 + jnp.argmin(is_satisfied)),
    )


def _level_off_height(trajectory: Trajectory, limits: PathLimits, gravity: ScalarLike) -> Scalar:
    """Return the height, m, that an aircraft loses from the end of a trajectory to level flight in the hold."""
    end = trajectory.start_time + trajectory.duration
    end_point = trajectory.at(end)
    end_demand = demand(end_point.velocity_n - trajectory.wind_n, end_point.acceleration_n, gravity)
    bank = jnp.arctan2(end_demand.side, jnp.maximum(end_demand.lift, 0.1 * gravity))
    pull = jnp.minimum(_PULL_MAX, _PULL_SHARE * (limits.load_factor_max - 1.0) * gravity)
    return level_off_height(end_demand.speed, end_point.velocity_n[2], end_point.acceleration_n[2], bank, pull)


class PublishedPlanState(eqx.Module):
    """State of the published planner: plan in force, and data since the first plan."""

    plan: FleetPlan
    sides: Float[Array, " aircraft"]  # sides of the detours: +1 right, -1 left
    deceleration: Float[Array, " aircraft"]  # deceleration with the engine idle in level flight at the start, m/s^2
    flown_length: Float[Array, " aircraft"]  # length flown through the air since the first plan, m
    replan_needed: Flag  # whether the fleet must be coordinated again


class PublishedPlanner(AbstractPlanner):
    """Planner of a fleet's simultaneous arrival by paths of equal length (theory section 8)."""

    start_positions_n: Float[Array, "aircraft 3"]  # NED, m
    sides: Int[Array, " aircraft"]  # sides of the detours: +1 right, -1 left, 0 free choice
    speed: Scalar  # mean airspeed, m/s
    even_speed: Flag  # whether the airspeed changes evenly along a path; False: the published time law

    def first_plan(self, time: ScalarLike, reports: AircraftReport, performance: Performance) -> PublishedPlanState:
        """Return the planner state with the first plan, at `time` (s)."""
        requested = self.sides.astype(float)
        flown_length, deceleration = jnp.zeros_like(requested), performance.deceleration
        tasks = self._tasks(time, reports, self.speed, flown_length, deceleration)
        start_time = jnp.asarray(time, dtype=float)

        @jax.jit  # one trace, also for the shapes
        def plan_with(sides: Float[Array, " aircraft"]) -> FleetPlan:
            return coordinate(start_time, tasks, self.speed, sides, self.even_speed)

        def choose_and_plan(_: object, carry: tuple[Array, Array, FleetPlan]) -> tuple[Array, Array, FleetPlan]:
            plan = plan_with(carry[0])
            return choose_sides(plan, requested), carry[0], plan

        # The first plan serves to choose the sides for the second. A loop compiles the planning only once.
        begin = (requested, requested, zeros_like_result(plan_with, requested))
        _, sides, plan = jax.lax.fori_loop(0, 2, choose_and_plan, begin)
        return PublishedPlanState(plan, sides, deceleration, flown_length, jnp.asarray(False))

    def replan(
        self, planner_state: PublishedPlanState, time: ScalarLike, reports: AircraftReport
    ) -> PublishedPlanState:
        """Refit each path from the reported position to the predicted rendezvous, with the same arrival time and shape.

        `replan_needed` is set if `continue_plan` requires that the fleet be coordinated again.
        """
        tasks = self._tasks_in_flight(planner_state, time, reports)
        plan, is_due = continue_plan(planner_state.plan, time, tasks, self.even_speed)
        return dataclasses.replace(planner_state, plan=plan, replan_needed=planner_state.replan_needed | is_due)

    def replan_between_steps(
        self, planner_state: PublishedPlanState, time: float, reports: AircraftReport
    ) -> PublishedPlanState:
        """Return the planner state with a new plan from the reported positions at `time` (s), if one is still required.

        If none is required, the plan in force is continued.
        """
        plan = _coordinate_again(self, planner_state, as_array(time), reports)
        return eqx.tree_at(lambda m: m.plan, planner_state, plan)

    def observe(
        self,
        planner_state: PublishedPlanState,
        reports: AircraftReport,
        number: Integer,
        step: ScalarLike,
        randomness: AbstractRandomness | None,
    ) -> PublishedPlanState:
        """Return the planner state after a step (s), with the length (m) flown through the air in the step added."""
        flown_length = planner_state.flown_length + jnp.where(reports.active, step * reports.airspeed, 0.0)
        return eqx.tree_at(lambda m: m.flown_length, planner_state, flown_length)

    def replan_needed(self, planner_state: PublishedPlanState) -> Flag:
        """Whether the fleet must be coordinated again: the flight then stops for `replan_between_steps`."""
        return planner_state.replan_needed

    def plans(self, planner_state: PublishedPlanState) -> AircraftPlan:
        """Return the plan of each aircraft for the closed loop."""
        plan = planner_state.plan
        replanning = jnp.zeros(plan.status.shape, dtype=jnp.int32)
        return AircraftPlan(
            plan.trajectories, plan.arrival_times, plan.status, plan.lengths, plan.lateral_bends, replanning
        )

    def _tasks_in_flight(
        self, planner_state: PublishedPlanState, time: ScalarLike, reports: AircraftReport
    ) -> PlanningTask:
        return self._tasks(
            time, reports, planner_state.plan.speed, planner_state.flown_length, planner_state.deceleration
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


@compiled_by_older_generator(None, "coordination")
def _coordinate_again(
    planner: PublishedPlanner, planner_state: PublishedPlanState, time: Scalar, reports: AircraftReport
) -> FleetPlan:
    tasks = planner._tasks_in_flight(planner_state, time, reports)
    return replan(planner_state.plan, time, tasks, planner_state.sides, planner.even_speed)
