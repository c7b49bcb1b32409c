"""Simultaneous arrival of a fleet.

One arrival time, a trajectory for each aircraft that meets it, and replanning on the way with as little change of
shape as possible.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Real

from anser.numerics.arrays import select_rows, zeros_like_result
from anser.numerics.roots import bracketed_newton
from anser.parts.planners import Rendezvous, final_air_velocity, time_to_go
from anser.planning.published.trajectory import (
    Trajectory,
    arc_length,
    bend_trajectory,
    fit_trajectory,
    slowest_mean_speed,
    solve_lateral_bend,
    with_even_speed,
)
from anser.shapes import Count, Flag, Scalar, ScalarLike, Vector3
from anser.spatial.vectors import norm

PLANNED, GOAL_OUTRUNS, NO_COMMON_TIME, NO_BEND, DIRECTION_UNATTAINABLE, INACTIVE = range(6)
PLAN_MESSAGES = (
    "planned",
    "the goal outruns the aircraft: no path meets it at this airspeed in this wind; the others are planned without it",
    "no arrival time was found at which the longest path of the fleet takes just that time",
    "no lateral bend gives the path the length of the fleet's longest",
    "the prescribed direction of arrival cannot be flown in this wind; it was left free",
    "the aircraft does not fly (any more): the others are planned without it",
)

# Arrival times tried for a first change of sign, in units of the fleet's longest time to go. In a first plan that is a
# lower bound: no path is shorter than the straight line. A fleet that has fallen behind may have to be faster: hence
# the ratios below 1. Goals at rest need at most 2.1 (the slope terms of the cubic have length 0.505 T V at most); of
# 20,000 random tasks with goals at up to 60 percent of the airspeed none needed more than 1.7.
_TIME_RATIOS = (0.0, 0.3, 0.7, 0.9, 0.97, 0.999, 1.001, 1.05, 1.2, 1.5, 2.0, 3.0, 5.0, 10.0)
# The same tasks took 8 steps at most.
ARRIVAL_STEPS = 12
# The fixed point is met when the longest path takes the arrival time to within this, s.
ARRIVAL_TOLERANCE_S = 1e-9
# Least horizon, s: keeps a fleet that is already there from dividing by zero.
DURATION_MIN_S = 1e-3
# A path hardly changes with the speed: each round gains two digits.
_SPEED_ROUNDS = 3


class FleetPlan(eqx.Module):
    """One trajectory per aircraft, all of one arrival time but for those that no longer fly."""

    trajectories: Trajectory
    """Stacked, leading axis aircraft."""
    arrival_time: Scalar
    """Common time of arrival, s."""
    arrival_times: Float[Array, " aircraft"]
    """The same per aircraft, s; of one that stopped on the way, that of the last plan that was made with it."""
    nominal_lengths: Float[Array, " aircraft"]
    """Lengths of the unbent air paths, m."""
    speed: Scalar
    """Mean airspeed of the plan, m/s: the fleet's, or more where the farthest cannot come down so slowly."""
    reference_length: Scalar
    """The longest of them among active aircraft that can reach their goal, m; all fly it (plus what each is due)."""
    lengths: Float[Array, " aircraft"]
    """Lengths of the paths as planned, m."""
    lateral_bends: Float[Array, " aircraft"]
    """m, positive to the right; exactly 0 for the farthest, and for one that never flew."""
    farthest: Count
    """Index of the aircraft that flies its nominal path."""
    converged: Bool[Array, " aircraft"]
    """Whether this aircraft's trajectory has the reference length and arrival time."""
    goal_reachable: Bool[Array, " aircraft"]
    status: Int[Array, " aircraft"]
    """Index into PLAN_MESSAGES."""

    @property
    def active(self) -> Bool[Array, " aircraft"]:
        """Which aircraft are planned for, see `PlanningTask.active`."""
        return self.status != INACTIVE


class PlanningTask(eqx.Module):
    """What one aircraft knows when it plans; stacked, what a fleet knows.

    Attributes
    ----------
    position_n
        Its own, NED, m.
    air_velocity_n
        Its own velocity relative to the air, NED, m/s.
    goal_position_n, goal_velocity_n
        Its goal as sensed now, NED, m and m/s over the ground; predicted at steady velocity.
    rendezvous
        How it is to meet the goal.
    wind_n
        As it measures it, NED, m/s.
    origin_n
        Where it made its first plan, carried along with the air since, NED, m: its own position in a first plan. The
        line from there to the rendezvous sets the free direction of arrival and the direction of the bend.
    path_length_deficit
        How much less than speed times time it has flown since its first plan, m: 0 in a first plan. It is added to what
        it flies from here, so that the mean airspeed of the whole flight is the same for all, and a plan renewed on its
        own path is the same plan. (The speed varies along a trajectory: without this, the rest of a path has another
        mean speed than the whole, and the arrival time wanders from plan to plan.)
    deceleration
        What it can hold with the engine idle in level flight, m/s^2.
    active
        Whether it flies. One that does not (it has stopped, or never started) is planned without: it counts neither for
        the arrival time, the speed and the length that are common, nor for the farthest, nor for distances. Of a fleet
        in which none flies the first plan is as if all did, with status INACTIVE for each.
    """

    position_n: Vector3
    air_velocity_n: Vector3
    goal_position_n: Vector3
    goal_velocity_n: Vector3
    rendezvous: Rendezvous
    wind_n: Vector3
    origin_n: Vector3
    path_length_deficit: Scalar
    deceleration: Scalar
    active: Flag


def nominal_trajectory(
    task: PlanningTask,
    start_time: ScalarLike,
    duration: ScalarLike,
    speed: ScalarLike,
    stretches: tuple[Scalar, Scalar] | None = None,
) -> tuple[Trajectory, Flag]:
    """Unbent trajectory to where the rendezvous will be, and whether the prescribed arrival direction is flown.

    `stretches` are |dr/ds| at both ends, m; airspeed times duration where none are given.
    """
    drift = task.goal_velocity_n - task.wind_n
    end = task.goal_position_n + drift * duration + task.rendezvous.stand_off_n
    line = end - task.origin_n
    final, attainable = final_air_velocity(task.rendezvous, line, speed, task.wind_n)
    velocity_0 = task.air_velocity_n
    if stretches is not None:
        velocity_0 = velocity_0 * (stretches[0] / (duration * jnp.maximum(norm(velocity_0), 1.0)))
        final = final * (stretches[1] / (duration * speed))
    fit = fit_trajectory(
        start_time,
        duration,
        task.position_n,
        velocity_0,
        end,
        final,
        wind_n=task.wind_n,
        line_n=line,
    )
    return fit, attainable


def _lengths(tasks: PlanningTask, duration: Scalar, speed: Scalar) -> Float[Array, " aircraft"]:
    """Unbent lengths, less what each aircraft is behind (theory section 8's L_i where none is)."""
    return jax.vmap(
        lambda task: arc_length(nominal_trajectory(task, jnp.zeros(()), duration, speed)[0]) - task.path_length_deficit
    )(tasks)


def _counted(tasks: PlanningTask) -> Bool[Array, " aircraft"]:
    """Those that fly; all where none does, so that there is something to plan and every number is finite."""
    return tasks.active | ~jnp.any(tasks.active)


def _shortfall(duration: Scalar, data: tuple[PlanningTask, Scalar, Bool[Array, " aircraft"]]) -> tuple[Scalar, Scalar]:
    """Arrival time minus what the longest path takes at the airspeed, and its slope."""
    tasks, speed, counted = data

    def value(duration: Scalar) -> Scalar:
        return duration - jnp.max(jnp.where(counted, _lengths(tasks, duration, speed), 0.0)) / speed

    return jax.jvp(value, (duration,), (jnp.ones_like(duration),))


def _common_duration(tasks: PlanningTask, speed: Scalar) -> tuple[Scalar, Flag, Bool[Array, " aircraft"]]:
    """Least time that the longest path just takes; whether it was found; which of those counted reach their goals."""

    def to_go(task: PlanningTask) -> tuple[Scalar, Flag]:
        line = task.goal_position_n + task.rendezvous.stand_off_n - task.position_n
        return time_to_go(line, task.goal_velocity_n - task.wind_n, speed)

    counted = _counted(tasks)
    straight, exists = jax.vmap(to_go)(tasks)
    exists, straight = exists & counted, jnp.where(counted, straight, 0.0)
    # Only where the search begins: the result does not depend on it, and its gradient is the implicit one.
    straight = jax.lax.stop_gradient(straight)
    least = jnp.where(jnp.any(exists), jnp.max(jnp.where(exists, straight, 0.0)), jnp.max(straight))
    trials = jnp.maximum(least, DURATION_MIN_S) * jnp.array(_TIME_RATIOS)
    taken = jax.vmap(lambda trial: _lengths(tasks, trial, speed))(trials) / speed
    in_time = taken <= trials[:, None]
    reachable = exists & jnp.any(in_time, axis=0)
    all_in_time = jnp.all(in_time | ~reachable[None, :], axis=1)
    # The first trial in time; its predecessor is not. Only a fleet that is there, or behind by more than its whole way,
    # is in time at once.
    index = jnp.maximum(jnp.argmax(all_in_time), 1)
    low, high = trials[index - 1], trials[index]
    root = bracketed_newton(_shortfall, (tasks, speed, reachable), low, high, high, ARRIVAL_STEPS)
    found = jnp.any(all_in_time) & jnp.any(reachable) & (jnp.abs(root.residual) <= ARRIVAL_TOLERANCE_S)
    # Without an answer the straight lines' time stands in.
    return jnp.maximum(jnp.where(found, root.x, least), DURATION_MIN_S), found, reachable


def _timed(path: Trajectory, task: PlanningTask, even_speed: Flag | bool) -> Trajectory:
    """Give a path its time law, from the aircraft's present airspeed."""
    return with_even_speed(path, norm(task.air_velocity_n), task.deceleration, even=even_speed)


class _Common(NamedTuple):
    """Mean airspeed and arrival time of a fleet, and the nominal paths that take it."""

    speed: Scalar
    duration: Scalar
    found: Flag
    reachable: Bool[Array, " aircraft"]
    nominal: Trajectory
    attainable: Bool[Array, " aircraft"]
    lengths: Float[Array, " aircraft"]


def _common(tasks: PlanningTask, start: Scalar, speed: Scalar, raised: Flag) -> _Common:
    """The fleet's mean airspeed, raised to the least with which the farthest that flies can come down its path."""
    speeds_0 = jax.vmap(norm)(tasks.air_velocity_n)

    @jax.jit  # traced once, though its shapes are asked for first
    def at(speed: Scalar) -> _Common:
        duration, found, reachable = _common_duration(tasks, speed)
        paths, attainable = jax.vmap(lambda task: nominal_trajectory(task, start, duration, speed))(tasks)
        return _Common(speed, duration, found, reachable, paths, attainable, jax.vmap(arc_length)(paths))

    def again(_: object, carry: tuple[Scalar, _Common]) -> tuple[Scalar, _Common]:
        tried = at(carry[0])
        flown = jnp.where(tried.reachable, tried.lengths - tasks.path_length_deficit, 0.0)
        slowest = jax.vmap(slowest_mean_speed)(tried.nominal, speeds_0, tasks.deceleration)
        return jnp.where(raised, jnp.maximum(speed, slowest[jnp.argmax(flown)]), speed), tried

    return jax.lax.fori_loop(0, _SPEED_ROUNDS + 1, again, (speed, zeros_like_result(at, speed)))[1]


@jax.jit  # traced once, however often a program plans
def coordinate(
    time: ScalarLike,
    tasks: PlanningTask,
    speed: ScalarLike,
    sides: Real[Array, " aircraft"],
    even_speed: Flag | bool = False,
    speed_is_fixed: Flag | bool = False,
) -> FleetPlan:
    """Plan a fleet's simultaneous arrival from its present state.

    Parameters
    ----------
    time
        Now, s.
    tasks
        Stacked, one per aircraft.
    speed
        Mean airspeed of all, m/s.
    sides
        Positive or zero: detour to the right; negative: to the left.
    even_speed
        Whether paths are flown at an even speed; otherwise the parameter runs evenly with time, as published.
    under_way
        Whether the mean airspeed stands, as that of a first plan to which the tasks' `path_length_deficit` refers.
        Otherwise it is raised where the farthest aircraft cannot come down so slowly. (Raised again on the way it would
        run away: who is told to be faster has still more speed to lose on what is left of the way down.)

    Returns
    -------
    The plan. Failures stand in `status` per aircraft, see PLAN_MESSAGES; the numbers stay finite.

    Notes
    -----
    Theory section 8. The fixed point T = max_i L_i(T)/V is solved as a root, Newton in a bracket, because plain
    iteration contracts slowly: to 1e-9 s it takes up to 40 rounds with goals at 20 percent of the airspeed and up to
    160 at 60 percent. The longest time to go along straight lines is a lower bound of it.
    """
    start, speed = jnp.asarray(time, dtype=float), jnp.asarray(speed, dtype=float)
    deficit = tasks.path_length_deficit
    raised = jnp.asarray(even_speed) & ~jnp.asarray(speed_is_fixed)
    speed, duration, found, reachable, nominal, attainable, lengths = _common(tasks, start, speed, raised)
    counted = jnp.where(reachable | (_counted(tasks) & ~jnp.any(reachable)), lengths - deficit, 0.0)
    farthest, reference = jnp.argmax(counted), jnp.max(counted)

    bends = jax.vmap(lambda path, side, behind: solve_lateral_bend(path, reference + behind, side))(
        nominal, sides, deficit
    )
    bent_at_all = tasks.active & (jnp.arange(lengths.shape[0]) != farthest)
    kappa = jnp.where(bent_at_all, bends.kappa, 0.0)
    bent = jax.vmap(bend_trajectory)(nominal, kappa)
    trajectories = jax.vmap(_timed, in_axes=(0, 0, None))(bent, tasks, even_speed)
    status = jnp.where(attainable, jnp.asarray(PLANNED, dtype=int), DIRECTION_UNATTAINABLE)
    status = jnp.where(bends.converged, status, NO_BEND)
    status = jnp.where(found, status, NO_COMMON_TIME)
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
        converged=bends.converged & found & reachable & tasks.active,
        goal_reachable=reachable,
        status=status,
    )


# A path keeps its arrival time and shape while its mean airspeed stays within this part of the fleet's.
SPEED_BAND = 0.01
# With less time to go than this the arrival time and the shapes stand: see `replan`.
COMMITTED_S = 15.0


def _refit(
    plan: FleetPlan, time: ScalarLike, tasks: PlanningTask, speed: ScalarLike, even_speed: Flag | bool
) -> FleetPlan:
    """The same arrival time and the rest of the same paths, from the present state to where the rendezvous will be."""
    duration = jnp.maximum(plan.arrival_time - time, DURATION_MIN_S)

    def one(old: Trajectory, bend: Scalar, task: PlanningTask) -> tuple[Trajectory, Scalar]:
        # The planned velocity goes on, not the flown one: a new path from the flown speed and course would forgive
        # every lag of the aircraft, second after second, and leave it to the last seconds.
        now = old.clock(time)
        task = eqx.tree_at(lambda t: t.air_velocity_n, task, old.path_derivative(now.s, 1) * now.s_dot)
        # The rest of a path of this family, with s running from 0 to 1 on it, is a path of this family.
        s = jnp.clip(now.s, 0.0, 1.0 - 1e-6)
        rest = 1.0 - s
        stretches = (rest * norm(old.path_derivative(s, 1)), rest * norm(old.path_derivative(1.0, 1)))
        nominal, _ = nominal_trajectory(task, time, duration, speed, stretches)
        kept = bend * rest**4
        path = bend_trajectory(nominal, kept)
        return with_even_speed(path, norm(task.air_velocity_n), exchange=old.law.exchange, even=even_speed), kept

    trajectories, bends = jax.vmap(one)(plan.trajectories, plan.lateral_bends, tasks)
    lengths = jax.vmap(arc_length)(trajectories)
    return eqx.tree_at(lambda p: (p.trajectories, p.lateral_bends, p.lengths), plan, (trajectories, bends, lengths))


def _standing(plan: FleetPlan, made: FleetPlan, active: Bool[Array, " aircraft"]) -> FleetPlan:
    """A plan in which those that do not fly keep what they had in the last, and have no other part."""

    def own(p: FleetPlan) -> tuple[object, ...]:
        return p.trajectories, p.arrival_times, p.nominal_lengths, p.lengths, p.lateral_bends, p.goal_reachable

    rows = select_rows(active, own(made), own(plan))
    status = jnp.where(active, made.status, INACTIVE)
    return eqx.tree_at(lambda p: (*own(p), p.status, p.converged), made, (*rows, status, made.converged & active))


def replan(
    plan: FleetPlan,
    time: ScalarLike,
    tasks: PlanningTask,
    sides: Real[Array, " aircraft"],
    even_speed: Flag | bool = False,
    allow_replanning: bool = True,
) -> tuple[FleetPlan, Flag]:
    """Plan again from the present state.

    Every path is fitted anew from where its aircraft is to where its rendezvous will be. The arrival time and the shape
    of the path's rest are kept (exactly: a plan renewed on its own path is the same plan) as long as each aircraft's
    mean airspeed stays within 1 percent of the plan's; when one leaves that band, because its goal moved otherwise than
    foreseen, the fleet is coordinated anew. In the last 15 s it is not: there, a few metres of path to make up would
    take a bend of many g, and a little speed does it as well.

    An aircraft that is no longer active keeps its last plan, arrival time included, and the others go on without it:
    as they are, if it was the farthest of them too, until one of them leaves the band; what is planned anew is planned
    without it.

    Parameters
    ----------
    plan
        The plan in force.
    time
        Now, s.
    tasks, sides, even_speed
        As for `coordinate`; the lengths due are those at the plan's mean airspeed, which stands.
    replans
        Whether a fleet is coordinated anew where that is due.

    Returns
    -------
    The plan, and whether it is not coordinated anew though that was due.

    Notes
    -----
    Solving L(kappa) = L_ref at every renewal (theory section 8 read to the letter) is badly conditioned on the way:
    near L's minimum the bend goes with the square root of the length, so that a metre of tracking error in the middle
    of a detour moves kappa by kilometres, and the fleet's aircraft take turns in being the farthest.
    """
    kept = _refit(plan, time, tasks, plan.speed, even_speed)
    duration = kept.trajectories.duration
    mean_speed = (kept.lengths - tasks.path_length_deficit) / duration
    strayed = kept.goal_reachable & (jnp.abs(mean_speed / plan.speed - 1.0) > SPEED_BAND)
    anew = jnp.any((strayed | ~kept.converged) & tasks.active) & (duration[0] > COMMITTED_S)
    if not allow_replanning:
        return _standing(plan, kept, tasks.active), anew
    made = jax.lax.cond(
        anew, lambda: coordinate(time, tasks, plan.speed, sides, even_speed, speed_is_fixed=True), lambda: kept
    )
    return _standing(plan, made, tasks.active), jnp.asarray(False)
