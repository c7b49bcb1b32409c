"""Renewing a fleet's plan on the way: from the present state, with as little change of shape as will do."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Real

from anser.numerics.stacking import rows_where
from anser.planning.arc_length import arc_length
from anser.planning.coordination import INACTIVE, SHORTEST_S, FleetPlan, PlanningTask, coordinate, nominal_trajectory
from anser.planning.trajectory import Trajectory, bend_trajectory, with_even_speed
from anser.planning.vectors import norm
from anser.shapes import Flag, Scalar, ScalarLike

# A path keeps its arrival time and shape while its mean airspeed stays within this part of the fleet's.
SPEED_BAND = 0.01
# With less time to go than this the arrival time and the shapes stand: see `renew`.
COMMITTED_S = 15.0


def _refit(
    plan: FleetPlan, time: ScalarLike, tasks: PlanningTask, speed: ScalarLike, even_speed: Flag | bool
) -> FleetPlan:
    """The same arrival time and the rest of the same paths, from the present state to where the rendezvous will be."""
    duration = jnp.maximum(plan.arrival_time - time, SHORTEST_S)

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

    rows = rows_where(active, own(made), own(plan))
    status = jnp.where(active, made.status, INACTIVE)
    return eqx.tree_at(lambda p: (*own(p), p.status, p.converged), made, (*rows, status, made.converged & active))


def renew(
    plan: FleetPlan,
    time: ScalarLike,
    tasks: PlanningTask,
    sides: Real[Array, " aircraft"],
    even_speed: Flag | bool = False,
) -> FleetPlan:
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
    made = jax.lax.cond(
        anew, lambda: coordinate(time, tasks, plan.speed, sides, even_speed, under_way=True), lambda: kept
    )
    return _standing(plan, made, tasks.active)
