"""Simultaneous arrival of a fleet: common arrival time, one trajectory per aircraft, and replanning in flight."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Real

from anser.numerics.arrays import select_rows, zeros_like_result
from anser.numerics.roots import bracketed_newton
from anser.parts.planners import Rendezvous, final_air_velocity, time_to_go
from anser.planning.published.time_law import path_derivatives
from anser.planning.published.trajectory import (
    Trajectory,
    arc_length,
    bend_trajectory,
    fit_trajectory,
    slowest_mean_speed,
    solve_lateral_bend,
    with_even_speed,
)
from anser.shapes import Flag, Integer, Scalar, ScalarLike, Vector3
from anser.spatial.vectors import norm

PLANNED, GOAL_OUTRUNS, NO_COMMON_TIME, NO_BEND, DIRECTION_UNATTAINABLE, INACTIVE = range(6)
PLAN_MESSAGES = (
    "planned",
    "the goal outruns the aircraft: no path meets it at this airspeed in this wind; the others are planned without it",
    "no arrival time was found that equals the flight time of the fleet's longest path",
    "no lateral bend gives the path the length of the fleet's longest path",
    "the prescribed direction of arrival cannot be flown in this wind; it was left free",
    "the aircraft does not fly (any more): the others are planned without it",
)

# Trial arrival times for a first change of sign, in units of the fleet's longest time to go. In a first plan, the time
# to go is a lower bound, because no path is shorter than the straight line. A late fleet may have to be faster: hence
# the ratios below 1. Goals at rest need at most 2.1 (the slope terms of the cubic have length 0.505 T V at most); none
# of 20,000 random tasks with goals at up to 60 percent of the airspeed needed more than 1.7.
_TIME_RATIOS = (0.0, 0.3, 0.7, 0.9, 0.97, 0.999, 1.001, 1.05, 1.2, 1.5, 2.0, 3.0, 5.0, 10.0)
ARRIVAL_STEPS = 12  # the same tasks needed at most 8
ARRIVAL_TOLERANCE_S = 1e-9  # largest residual of the fixed point
DURATION_MIN_S = 1e-3  # avoids division by zero at the rendezvous
_SPEED_ROUNDS = 3  # each round gains two digits: the path hardly depends on the speed


class FleetPlan(eqx.Module):
    """Plan of a fleet: one trajectory per aircraft, with a common arrival time of the active aircraft.

    The aircraft with the longest path flies without bend; bends lengthen the other paths, see `reference_length`.
    """

    trajectories: Trajectory  # trajectories of the aircraft, stacked
    arrival_time: Scalar  # common arrival time, s
    arrival_times: Float[Array, " aircraft"]  # arrival times, s; an inactive aircraft keeps the time of its last plan
    nominal_lengths: Float[Array, " aircraft"]  # lengths of the paths without bend, m
    # mean airspeed of the plan, m/s: the requested airspeed, or more if the farthest aircraft needs more to descend
    speed: Scalar
    # greatest value of nominal length minus `path_length_deficit` among the active aircraft that can arrive, m. The
    # length of each planned path is the reference length plus the deficit of the aircraft
    reference_length: Scalar
    lengths: Float[Array, " aircraft"]  # lengths of the planned paths, m
    # lateral bend of each path (see `bend_trajectory`), m, right positive; 0 for the farthest aircraft, and for an
    # aircraft that never flew
    lateral_bends: Float[Array, " aircraft"]
    farthest: Integer  # index of the aircraft with the longest path, which flies without bend
    converged: Bool[Array, " aircraft"]  # whether the aircraft's trajectory has the reference length and arrival time
    goal_reachable: Bool[Array, " aircraft"]  # whether a path meets the aircraft's moving goal at the plan's airspeed
    status: Int[Array, " aircraft"]  # index into PLAN_MESSAGES

    @property
    def active(self) -> Bool[Array, " aircraft"]:
        """Mask of the aircraft for which the plan was made."""
        return self.status != INACTIVE


class PlanningTask(eqx.Module):
    """Planning problem of one aircraft for the published planner; stacked: of a fleet."""

    position_n: Vector3  # position of the aircraft, NED, m
    air_velocity_n: Vector3  # velocity of the aircraft relative to the air, NED, m/s
    # sensed goal, NED, m and m/s over the ground; predicted at constant velocity
    goal_position_n: Vector3
    goal_velocity_n: Vector3
    rendezvous: Rendezvous  # stand-off and arrival conditions at the goal
    wind_n: Vector3  # wind measured by the aircraft, NED, m/s
    # position at the first plan, moved with the air since then, NED, m. The line from this origin to the rendezvous
    # determines the arrival direction, if free, and the direction of the bend
    origin_n: Vector3
    # planned speed times time minus the length flown since the first plan, m; 0 in a first plan. The deficit is
    # subtracted from the remaining length, so that the plan keeps the mean airspeed of the whole flight. (The airspeed
    # varies along a trajectory: the mean of the remaining path would change the arrival time at every replanning.)
    path_length_deficit: Scalar
    deceleration: Scalar  # deceleration with the engine idle in level flight, m/s^2
    # whether the aircraft flies. An inactive aircraft does not constrain the fleet. If no aircraft is active, the first
    # plan treats every aircraft as active, with the status INACTIVE
    active: Flag


def nominal_trajectory(
    task: PlanningTask,
    start_time: ScalarLike,
    duration: ScalarLike,
    speed: ScalarLike,
    end_slopes: tuple[Scalar, Scalar] | None = None,
) -> tuple[Trajectory, Flag]:
    """Return an aircraft's trajectory without bend to the predicted rendezvous, and whether the arrival can be flown.

    The start time and the duration are in s, `speed` is the airspeed at the rendezvous, m/s. The flag is False only if
    the prescribed direction of arrival cannot be flown in the wind. `end_slopes` are |dr/ds| of the path at both ends,
    m; None: airspeed times duration.
    """
    drift = task.goal_velocity_n - task.wind_n
    end = task.goal_position_n + drift * duration + task.rendezvous.stand_off_n
    line = end - task.origin_n
    final, attainable = final_air_velocity(task.rendezvous, line, speed, task.wind_n)
    velocity_0 = task.air_velocity_n
    if end_slopes is not None:
        velocity_0 = velocity_0 * (end_slopes[0] / (duration * jnp.maximum(norm(velocity_0), 1.0)))
        final = final * (end_slopes[1] / (duration * speed))
    fit = fit_trajectory(start_time, duration, task.position_n, velocity_0, end, final, wind_n=task.wind_n, line_n=line)
    return fit, attainable


def _lengths(tasks: PlanningTask, duration: Scalar, speed: Scalar) -> Float[Array, " aircraft"]:
    """Return for each aircraft the length of the nominal trajectory minus `PlanningTask.path_length_deficit`, m."""
    return jax.vmap(
        lambda task: arc_length(nominal_trajectory(task, jnp.zeros(()), duration, speed)[0]) - task.path_length_deficit
    )(tasks)


def _planned_for(tasks: PlanningTask) -> Bool[Array, " aircraft"]:
    """Return the mask of the aircraft for which the plan is made: the active aircraft; if none is active, all."""
    return tasks.active | ~jnp.any(tasks.active)


def _shortfall(duration: Scalar, data: tuple[PlanningTask, Scalar, Bool[Array, " aircraft"]]) -> tuple[Scalar, Scalar]:
    """Return the time by which the aircraft with the longest path arrives before `duration` (s), and the derivative.

    `data`: tasks, mean airspeed (m/s), and the mask of the aircraft that count.
    """
    tasks, speed, included = data

    def value(duration: Scalar) -> Scalar:
        return duration - jnp.max(jnp.where(included, _lengths(tasks, duration, speed), 0.0)) / speed

    return jax.jvp(value, (duration,), (jnp.ones_like(duration),))


def _straight_times(
    tasks: PlanningTask, speed: ScalarLike
) -> tuple[Float[Array, " aircraft"], Bool[Array, " aircraft"]]:
    """Return the flight time, s, of each straight line to the moving rendezvous, and whether such a line exists."""

    def to_go(task: PlanningTask) -> tuple[Scalar, Flag]:
        line = task.goal_position_n + task.rendezvous.stand_off_n - task.position_n
        return time_to_go(line, task.goal_velocity_n - task.wind_n, speed)

    return jax.vmap(to_go)(tasks)


def _common_duration(tasks: PlanningTask, speed: Scalar) -> tuple[Scalar, Flag, Bool[Array, " aircraft"]]:
    """Solve for the least duration (s) that equals the flight time of the longest path at the mean airspeed (m/s).

    Also returns whether such a duration was found, and the mask of the active aircraft with reachable goals. If no
    solution is found, the duration is the longest flight time along straight lines.
    """
    included = _planned_for(tasks)
    straight, exists = _straight_times(tasks, speed)
    exists, straight = exists & included, jnp.where(included, straight, 0.0)
    # The result does not depend on the start of the search; its gradient is the implicit one.
    straight = jax.lax.stop_gradient(straight)
    duration_min = jnp.where(jnp.any(exists), jnp.max(jnp.where(exists, straight, 0.0)), jnp.max(straight))
    trials = jnp.maximum(duration_min, DURATION_MIN_S) * jnp.array(_TIME_RATIOS)
    flight_times = jax.vmap(lambda trial: _lengths(tasks, trial, speed))(trials) / speed
    in_time = flight_times <= trials[:, None]
    reachable = exists & jnp.any(in_time, axis=0)
    all_in_time = jnp.all(in_time | ~reachable[None, :], axis=1)
    # The first trial with every aircraft in time; the previous trial has a late aircraft. A fleet at the rendezvous, or
    # late by more than its whole path, is in time at the first trial.
    index = jnp.maximum(jnp.argmax(all_in_time), 1)
    low, high = trials[index - 1], trials[index]
    root = bracketed_newton(_shortfall, (tasks, speed, reachable), low, high, high, ARRIVAL_STEPS)
    is_solved = jnp.any(all_in_time) & jnp.any(reachable) & (jnp.abs(root.residual) <= ARRIVAL_TOLERANCE_S)
    return jnp.maximum(jnp.where(is_solved, root.x, duration_min), DURATION_MIN_S), is_solved, reachable


class _CommonTime(NamedTuple):
    """Mean airspeed and duration that are common to a fleet, and the nominal paths for this duration."""

    speed: Scalar  # mean airspeed, m/s
    duration: Scalar  # s
    is_solved: Flag  # whether the duration equals the flight time of the longest path
    reachable: Bool[Array, " aircraft"]  # mask of the aircraft with reachable goals
    nominal: Trajectory  # paths without bend
    attainable: Bool[Array, " aircraft"]  # whether the path has the prescribed direction of arrival
    lengths: Float[Array, " aircraft"]  # lengths of the nominal paths, m


def _solve_common_time(tasks: PlanningTask, start: Scalar, speed: Scalar, may_raise: Flag) -> _CommonTime:
    """Find the common flight duration and the nominal paths at the mean airspeed `speed` (m/s), from `start` (s) on.

    If `may_raise` is True, the airspeed is raised to the least mean airspeed at which the aircraft with the longest
    path can fly its descent with idle engine.
    """
    speeds_0 = jax.vmap(norm)(tasks.air_velocity_n)

    @jax.jit  # one trace, also for the shapes
    def solve_at(speed: Scalar) -> _CommonTime:
        duration, is_solved, reachable = _common_duration(tasks, speed)
        paths, attainable = jax.vmap(lambda task: nominal_trajectory(task, start, duration, speed))(tasks)
        return _CommonTime(speed, duration, is_solved, reachable, paths, attainable, jax.vmap(arc_length)(paths))

    def raise_speed(_: object, carry: tuple[Scalar, _CommonTime]) -> tuple[Scalar, _CommonTime]:
        trial = solve_at(carry[0])
        flight_lengths = jnp.where(trial.reachable, trial.lengths - tasks.path_length_deficit, 0.0)
        slowest = jax.vmap(slowest_mean_speed)(trial.nominal, speeds_0, tasks.deceleration)
        return jnp.where(may_raise, jnp.maximum(speed, slowest[jnp.argmax(flight_lengths)]), speed), trial

    return jax.lax.fori_loop(0, _SPEED_ROUNDS + 1, raise_speed, (speed, zeros_like_result(solve_at, speed)))[1]


@jax.jit  # one trace per program
def coordinate(
    time: ScalarLike,  # present time, s
    tasks: PlanningTask,  # stacked tasks, one per aircraft
    speed: ScalarLike,  # mean airspeed of the fleet, m/s
    sides: Real[Array, " aircraft"],  # positive or zero: detour to the right; negative: to the left
    # whether the airspeed changes evenly along the paths; False: the path parameter is linear in time, as published
    even_speed: Flag | bool = False,
    # True for replanning: `speed` is the mean airspeed of the first plan, to which `path_length_deficit` refers. False:
    # the airspeed is raised if the farthest aircraft cannot descend at `speed` and `even_speed` is True. (Raising the
    # airspeed again en route would diverge: a faster aircraft has more speed to lose on the remaining descent.)
    speed_is_fixed: Flag | bool = False,
) -> FleetPlan:
    """Return a plan for the simultaneous arrival of a fleet from its present state.

    Failures are marked in `status` per aircraft, see PLAN_MESSAGES; the numbers stay finite.

    Notes
    -----
    Theory section 8. The fixed point T = max_i L_i(T)/V is solved as a root by bracketed Newton steps, because the
    fixed-point iteration needs up to 160 iterations.
    """
    start, speed = jnp.asarray(time, dtype=float), jnp.asarray(speed, dtype=float)
    deficit = tasks.path_length_deficit
    may_raise = jnp.asarray(even_speed) & ~jnp.asarray(speed_is_fixed)
    speed, duration, is_solved, reachable, nominal, attainable, lengths = _solve_common_time(
        tasks, start, speed, may_raise
    )
    counted_lengths = jnp.where(reachable | (_planned_for(tasks) & ~jnp.any(reachable)), lengths - deficit, 0.0)
    farthest, reference = jnp.argmax(counted_lengths), jnp.max(counted_lengths)

    bends = jax.vmap(lambda path, side, path_deficit: solve_lateral_bend(path, reference + path_deficit, side))(
        nominal, sides, deficit
    )
    has_bend = tasks.active & (jnp.arange(lengths.shape[0]) != farthest)
    kappa = jnp.where(has_bend, bends.kappa, 0.0)
    bent_paths = jax.vmap(bend_trajectory)(nominal, kappa)
    trajectories = jax.vmap(
        lambda path, task: with_even_speed(path, norm(task.air_velocity_n), task.deceleration, even=even_speed)
    )(bent_paths, tasks)
    status = jnp.where(attainable, jnp.asarray(PLANNED, dtype=int), DIRECTION_UNATTAINABLE)
    status = jnp.where(bends.converged, status, NO_BEND)
    status = jnp.where(is_solved, status, NO_COMMON_TIME)
    status = jnp.where(reachable, status, GOAL_OUTRUNS)
    status = jnp.where(tasks.active, status, INACTIVE)
    return FleetPlan(
        trajectories=trajectories,
        arrival_time=start + duration,
        arrival_times=jnp.broadcast_to(start + duration, lengths.shape),
        nominal_lengths=lengths,
        speed=speed,
        reference_length=reference,
        lengths=jax.vmap(arc_length)(trajectories),
        lateral_bends=kappa,
        farthest=farthest,
        converged=bends.converged & is_solved & reachable & tasks.active,
        goal_reachable=reachable,
        status=status,
    )


SPEED_BAND = 0.01  # relative change of the mean airspeed within which arrival time and shape are kept
COMMITTED_S = 15.0  # time before the arrival without new coordination, see `replan`


def _refit_paths(
    plan: FleetPlan, time: ScalarLike, tasks: PlanningTask, speed: ScalarLike, even_speed: Flag | bool
) -> FleetPlan:
    """Return the plan with each path refitted to the rendezvous predicted at `time` (s); the arrival time stays."""
    duration = jnp.maximum(plan.arrival_time - time, DURATION_MIN_S)

    def continue_path(old_path: Trajectory, bend: Scalar, task: PlanningTask) -> tuple[Trajectory, Scalar]:
        clock = old_path.clock(time)
        # The rest of a path, with s scaled to 0..1, is a path of the same family.
        s = jnp.clip(clock.s, 0.0, 1.0 - 1e-6)
        remaining = 1.0 - s
        slopes_n = path_derivatives(old_path.coefficients_n, jnp.stack([clock.s, s, jnp.ones_like(s)]), (1,))[0]
        # From the planned velocity, not the flown one: a path from the flown speed and course would ignore the lag of
        # the aircraft at every replanning and shift it to the last seconds.
        task = eqx.tree_at(lambda t: t.air_velocity_n, task, slopes_n[:, 0] * clock.s_dot)
        slopes = remaining * norm(slopes_n[:, 1:], axis=0)
        end_slopes = (slopes[0], slopes[1])
        nominal, _ = nominal_trajectory(task, time, duration, speed, end_slopes)
        remaining_bend = bend * remaining**4
        path = bend_trajectory(nominal, remaining_bend)
        return with_even_speed(
            path, norm(task.air_velocity_n), exchange=old_path.law.exchange, even=even_speed
        ), remaining_bend

    trajectories, bends = jax.vmap(continue_path)(plan.trajectories, plan.lateral_bends, tasks)
    lengths = jax.vmap(arc_length)(trajectories)
    return eqx.tree_at(lambda p: (p.trajectories, p.lateral_bends, p.lengths), plan, (trajectories, bends, lengths))


def _keep_inactive(plan: FleetPlan, new_plan: FleetPlan, active: Bool[Array, " aircraft"]) -> FleetPlan:
    """Return the new plan in which inactive aircraft keep their entries of the former `plan`, with status INACTIVE."""

    def aircraft_fields(p: FleetPlan) -> tuple[object, ...]:
        return p.trajectories, p.arrival_times, p.nominal_lengths, p.lengths, p.lateral_bends, p.goal_reachable

    selected = select_rows(active, aircraft_fields(new_plan), aircraft_fields(plan))
    status = jnp.where(active, new_plan.status, INACTIVE)
    return eqx.tree_at(
        lambda p: (*aircraft_fields(p), p.status, p.converged),
        new_plan,
        (*selected, status, new_plan.converged & active),
    )


def continue_plan(
    plan: FleetPlan,
    time: ScalarLike,  # present time, s
    # stacked tasks, one per aircraft; deficits refer to the mean airspeed of the plan, which is kept
    tasks: PlanningTask,
    even_speed: Flag | bool = False,
) -> tuple[FleetPlan, Flag]:
    """Continue a plan from the present state; return the plan, and whether the fleet must be coordinated again.

    Every path is refitted from the aircraft's position to the predicted rendezvous, with the same arrival time and
    shape. An inactive aircraft keeps its last plan, and has no effect on the plans of the other aircraft.

    The flag is True if a new common arrival time is needed (`coordinate`):

    - if the mean airspeed of an aircraft differs from the plan's airspeed by more than 1 percent, or
    - if the plan has no solution for an aircraft whose goal can be reached.

    In the last 15 s the flag is False, because a bend that adds a few metres to the path would require many g.
    """
    continued = _refit_paths(plan, time, tasks, plan.speed, even_speed)
    duration = continued.trajectories.duration
    mean_speed = (continued.lengths - tasks.path_length_deficit) / duration
    is_off_speed = continued.goal_reachable & (jnp.abs(mean_speed / plan.speed - 1.0) > SPEED_BAND)
    # A goal that outruns its aircraft is no reason for another plan until it can be reached.
    is_unsolved = jnp.where(continued.goal_reachable, ~continued.converged, _straight_times(tasks, plan.speed)[1])
    is_due = jnp.any((is_off_speed | is_unsolved) & tasks.active) & (duration[0] > COMMITTED_S)
    return _keep_inactive(plan, continued, tasks.active), is_due


def replan(
    plan: FleetPlan,
    time: ScalarLike,  # present time, s
    tasks: PlanningTask,  # stacked tasks, one per aircraft, as for `continue_plan`
    sides: Real[Array, " aircraft"],  # positive or zero: detour to the right; negative: to the left
    even_speed: Flag | bool = False,
) -> FleetPlan:
    """Return the plan continued from the present state, or a new plan if `continue_plan` requires one.

    A new plan keeps the mean airspeed of the former plan.

    Notes
    -----
    Solving L(kappa) = L_ref for the bend kappa (m) at every replanning (theory section 8, literally) is
    ill-conditioned: near the minimum of the length L, a tracking error of one metre changes kappa by kilometres.
    """
    continued, is_due = continue_plan(plan, time, tasks, even_speed)
    new_plan = jax.lax.cond(
        is_due, lambda: coordinate(time, tasks, plan.speed, sides, even_speed, speed_is_fixed=True), lambda: continued
    )
    return _keep_inactive(plan, new_plan, tasks.active)
