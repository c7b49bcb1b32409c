"""Renewing a certified plan on the way, without a jerk, and keeping the last good one where no new one will do."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.numerics.stacking import rows_where
from anser.planning.certified.candidate_sets import MINIMAL
from anser.planning.certified.certified_plan import (
    CertifiedPlan,
    certify,
    fleet_bounds,
    plan_fleet_at,
    within_limits,
)
from anser.planning.certified.path_bounds import PathBounds
from anser.planning.certified.profile import KINKS
from anser.planning.certified.route import PIECES
from anser.planning.certified.task import AircraftTask, Airspace
from anser.planning.limits import PathLimits
from anser.planning.timed_path import TimedPath
from anser.shapes import Count, Flag, Scalar, ScalarLike, Vector3

FIRST, CORRECTED, REPLANNED, KEPT, AWAITING, BENT_IN_PART = range(6)
RENEWAL_MESSAGES = (
    "the first plan",
    "the plan in force, bent to where the rendezvous is now expected",
    "planned anew from the planned state",
    "no new plan keeps all limits: the last good plan is kept",
    "the last good plan is kept until the goal is known well enough for another",
    "no new plan keeps all limits: the last good plan is bent as far as they allow",
)
COMMITTED_S = 15.0
"""With less time to go than this an aircraft's path is corrected, but not planned anew."""
_SAME_PLACE_M = 1e-6
SURE = 3.0
"""By how many standard deviations, as the goal is known, a rendezvous is elsewhere before another plan is made for it.
Nearer, the next measurements may well bring it back."""
PARTS_BENT = (1.0, 0.75, 0.5, 0.25)
"""Parts of a bend that are tried, the greatest first, where no new plan is found."""
LATER = (0.0, 0.03, 0.08, 0.15)
"""By which parts of the longest time to go the arrivals may be put off, where the arrival time is free."""


def intervals_of(paths: TimedPath) -> int:
    """Even intervals between the knots of a path."""
    return paths.times.shape[-1] - 1 - (PIECES - 1) - KINKS


def corrected(
    path: TimedPath, task: AircraftTask, now: ScalarLike, to_go: ScalarLike | None = None, lead: ScalarLike = 0.0
) -> TimedPath:
    """The same path, bent evenly from a knot on to where the rendezvous is expected; C2 everywhere.

    The bend is d (10 u^3 - 15 u^4 + 6 u^5): a quintic, so each cell's quintic takes it up exactly.

    Parameters
    ----------
    path, task
        With the goal as it is sensed now.
    now
        On the path's clock, s.
    to_go
        When the path ends, s from now; None: as its clock has it.
    lead
        The path stays as it is for this long, s.
    """
    end = path.times[-1]
    to_go = end - now if to_go is None else to_go
    off = moved_n(path, task, to_go)
    begin = jnp.min(jnp.where(path.times > now + lead, path.times, end))
    span = jnp.maximum(end - begin, 1e-3)
    u = jnp.clip((path.times - begin) / span, 0.0, 1.0)
    shares = jnp.stack(
        [
            u**3 * (10 + u * (-15 + 6 * u)),
            30 * (u * (1 - u)) ** 2 / span,
            60 * u * (1 - u) * (1 - 2 * u) / span**2,
        ],
        axis=1,
    )
    needed = (jnp.sum(off**2) > _SAME_PLACE_M**2) & (end > begin)
    bent = path.air_n + shares[:, :, None] * off[None, None, :]
    return eqx.tree_at(lambda p: p.air_n, path, jnp.where(needed, bent, path.air_n))


def moved_n(path: TimedPath, task: AircraftTask, to_go: ScalarLike) -> Vector3:
    """From where a path ends to where the rendezvous is expected after a time (s), NED, m."""
    return task.meeting_n(to_go) - path.air_n[-1, 0] - path.drift_n[-1, 0]


def surely_elsewhere(path: TimedPath, task: AircraftTask, covariance: Float[Array, "6 6"], to_go: ScalarLike) -> Flag:
    """Whether a rendezvous is farther from where a path ends than the errors of what is known of its goal explain.

    By `SURE` standard deviations of the goal's place at the arrival, in the direction from the one to the other.

    Parameters
    ----------
    path, task
        With the goal as it is sensed now.
    covariance
        Of the goal's position and velocity now, NED, m and m/s; foreseen at steady velocity.
    to_go
        To the arrival, s.
    """
    off = moved_n(path, task, to_go)
    ahead = jnp.concatenate([off, to_go * off])
    variance = jnp.sum(ahead[:, None] * covariance * ahead[None, :])  # times the square of the distance
    return jnp.sum(off**2) ** 2 > SURE**2 * variance


def from_plan(path: TimedPath, task: AircraftTask, now: ScalarLike) -> AircraftTask:
    """The task as its plan has it now: velocity and acceleration go on without a jump."""
    air, drift = path.states_n(now)
    return eqx.tree_at(
        lambda t: (t.position_n, t.air_velocity_n, t.air_acceleration_n),
        task,
        (air[0] + drift[0], air[1], air[2]),
    )


def postponements(
    arrival_times: Float[Array, " aircraft"],
    now: ScalarLike,
    free: Bool[Array, " aircraft"],
    movable: Flag,
    latest: ScalarLike,
    parts: tuple[float, ...] = LATER,
) -> tuple[Float[Array, " tries"], Count]:
    """By how much a fleet's arrivals may be put off, and how many of these delays there are.

    All by the same, so that those who arrive together go on to do so and the spacing of a sequence stays. So none is
    put off where one is no longer free: it has arrived, or is about to.

    Parameters
    ----------
    arrival_times
        As planned so far, s; -inf for one that does not count.
    now, latest
        s; no arrival is put off beyond the latter.
    parts
        Of the longest time to go: the delays.
    free
        Whether each may be planned anew, or does not count.
    movable
        Whether the rule leaves the arrival times open.

    Returns
    -------
    Delays, s, from none on, and the number of them that are open, at least one.
    """
    last = jnp.max(arrival_times)
    delays = jnp.asarray(parts) * jnp.maximum(last - now, 0.0)
    soon = jnp.sum(last + delays <= latest, dtype=jnp.int32)
    return delays, jnp.where(movable & jnp.all(free), jnp.maximum(soon, 1), 1)


class Renewed(eqx.Module):
    """A plan, what became of it (index into `RENEWAL_MESSAGES`), and whether none was made anew where one was due."""

    plan: CertifiedPlan
    how: Count
    asked: Flag


def renew_certified(
    plan: CertifiedPlan,
    now: ScalarLike,
    tasks: AircraftTask,
    airspace: Airspace,
    movable: Flag,
    freeze: ScalarLike = 0.0,
    latest: ScalarLike = jnp.inf,
    replans: bool = True,
    covariances: Float[Array, "aircraft 6 6"] | None = None,
    bent_limits: PathLimits | None = None,
) -> Renewed:
    """Plan again from the planned state, towards the goals as they are seen now.

    Parameters
    ----------
    plan
        The plan in force.
    now
        s.
    tasks
        The fleet with its goals as sensed now; position and motion are taken from the plan. One that is no longer
        active keeps its last path and arrival time: the others neither keep clear of it nor wait for it.
    airspace
        What they share.
    movable
        Whether the arrival times may be put off, see `postponements`.
    freeze
        A path stands as it is for this long before its arrival, s.
    latest
        No arrival is put off beyond this, s.
    replans
        Whether a plan is made anew where one bent will not do.
    covariances
        Of the goals' positions and velocities, NED, m and m/s: no plan is made anew for one that is not
        `surely_elsewhere`, and its path stands where it cannot be bent. None: the goals are known exactly.
    bent_limits
        What a path that is bent may ask of each aircraft, where that is more than a new one may; None: the same.

    Returns
    -------
    The plan bent to where the rendezvous are now expected, if its certificate still keeps everything; else one planned
    anew from the planned positions, velocities and accelerations, with the limits of a new path or else with those of a
    bent one; else the last good plan, each path bent as far as its limits allow, if all still keep clear of each other.
    """
    intervals = intervals_of(plan.paths)
    active = tasks.active > 0.0
    under_way = active & (plan.arrival_times > now)
    held_to = tasks if bent_limits is None else eqx.tree_at(lambda t: t.limits, tasks, bent_limits)
    paths = jax.vmap(corrected, in_axes=(0, 0, None))(plan.paths, tasks, now)
    paths = rows_where(active & (plan.arrival_times - now > freeze), paths, plan.paths)
    bounds, awaited = None, jnp.zeros_like(under_way)
    if covariances is not None:
        sure = jax.vmap(surely_elsewhere)(plan.paths, tasks, covariances, plan.arrival_times - now)
        bounds = fleet_bounds(paths, airspace)
        awaited = under_way & ~sure & ~within_limits(bounds, held_to.limits)
        paths, bounds = rows_where(awaited, (plan.paths, plan.certificate.bounds), (paths, bounds))
    bent = _certified(plan, paths, plan.arrival_times, held_to, airspace, intervals, now, under_way, bounds)
    fine = jnp.all(bent.feasible | ~under_way)
    how = jnp.where(jnp.any(awaited), AWAITING, CORRECTED)
    if not replans:
        return Renewed(bent, how, ~fine)

    free = active & (plan.arrival_times - now > jnp.maximum(freeze, COMMITTED_S))
    here = jax.vmap(from_plan, in_axes=(0, 0, None))(plan.paths, tasks, now)
    # They go on at the mean airspeed of their plans: to slow down in a descent may be more than the idle engine gives.
    speeds = jnp.where(plan.speeds > 0.0, plan.speeds, tasks.speed)
    here = eqx.tree_at(lambda t: (t.active, t.speed), here, (jnp.where(free, tasks.active, 0.0), speeds))

    counted = jnp.where(active, plan.arrival_times, -jnp.inf)
    delays, tries = postponements(counted, now, free | ~active, movable, latest)
    rounds = 1 if bent_limits is None else 2

    def certified(made: CertifiedPlan, paths: TimedPath, arrivals: Float[Array, " aircraft"]) -> CertifiedPlan:
        return _certified(made, paths, arrivals, held_to, airspace, intervals, now, under_way)

    def again(carry: tuple[Count, Flag, CertifiedPlan]) -> tuple[Count, Flag, CertifiedPlan]:
        k, _, _ = carry
        durations = jnp.maximum(counted - now, COMMITTED_S) + delays[k % tries]
        limits = jax.tree.map(lambda new, bent: jnp.where(k < tries, new, bent), tasks.limits, held_to.limits)
        asking = eqx.tree_at(lambda t: t.limits, here, limits)
        made = plan_fleet_at(now, asking, airspace, durations, intervals, MINIMAL)
        # Those whose paths stand keep the sizes of these paths.
        made = eqx.tree_at(_sizes, made, rows_where(free, _sizes(made), _sizes(plan)))
        arrivals = jnp.where(free, now + durations, plan.arrival_times)
        whole = certified(made, rows_where(free, made.paths, paths), arrivals)
        good = jnp.all(jnp.where(free, made.valid, True)) & jnp.all(whole.feasible | ~under_way)
        return k + 1, good, whole

    def in_part() -> tuple[Flag, CertifiedPlan]:
        def with_part(part: Scalar) -> tuple[TimedPath, Bool[Array, " aircraft"]]:
            bent_n = plan.paths.air_n + part * (paths.air_n - plan.paths.air_n)
            some = eqx.tree_at(lambda p: p.air_n, plan.paths, bent_n)
            return some, within_limits(fleet_bounds(some, airspace), held_to.limits)

        some, keeps = jax.lax.map(with_part, jnp.asarray(PARTS_BENT))
        most = jax.tree.map(lambda leaf: leaf[jnp.argmax(keeps, axis=0), jnp.arange(active.shape[0])], some)
        chosen = rows_where(jnp.any(keeps, axis=0), most, plan.paths)
        made = certified(plan, chosen, plan.arrival_times)
        moved = jnp.any(chosen.air_n != plan.paths.air_n)
        return moved & jnp.all(made.feasible | ~under_way), made

    def anew() -> Renewed:
        _, found, made = jax.lax.while_loop(
            lambda c: (c[0] < rounds * tries) & ~c[1], again, (jnp.asarray(0), jnp.asarray(False), plan)
        )
        some, bent_in_part = in_part()
        kept = jax.tree.map(lambda a, b, c: jnp.where(found, a, jnp.where(some, b, c)), made, bent_in_part, plan)
        how = jnp.where(found, REPLANNED, jnp.where(some, BENT_IN_PART, KEPT))
        return Renewed(kept, how, never)

    never = jnp.asarray(False)
    return jax.lax.cond(fine, lambda: Renewed(bent, how, never), anew)


def _sizes(plan: CertifiedPlan) -> tuple[Array, Array, Array]:
    return plan.lengths, plan.turned, plan.speeds


def _certified(
    plan: CertifiedPlan,
    paths: TimedPath,
    arrivals: Float[Array, " aircraft"],
    tasks: AircraftTask,
    airspace: Airspace,
    intervals: int,
    now: ScalarLike,
    under_way: Bool[Array, " aircraft"],
    bounds: PathBounds | None = None,
) -> CertifiedPlan:
    """A plan with other paths, certified from now on."""
    watched = eqx.tree_at(lambda t: t.active, tasks, jnp.where(under_way, tasks.active, 0.0))
    certificate = certify(paths, watched, airspace, intervals, now, bounds)
    ahead = jax.vmap(TimedPath.air_length, in_axes=(0, None))(paths, now)
    return eqx.tree_at(
        lambda p: (p.paths, p.arrival_times, p.certificate, p.valid, p.lengths),
        plan,
        (paths, arrivals, certificate, jnp.ones_like(plan.valid), jnp.where(under_way, ahead, plan.lengths)),
    )
