"""Replanning in flight.

Correcting or replanning a certified plan without a jump of velocity or acceleration, and the exit path of an
aircraft that leaves its fleet.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.environment.environment import AbstractWind
from anser.numerics.arrays import select_rows
from anser.planning.certified.certified_plan import CertifiedPlan, certify, fleet_bounds, plan_fleet_at, within_limits
from anser.planning.certified.path_bounds import PathBounds
from anser.planning.certified.profile import KINKS
from anser.planning.certified.routes import PIECES
from anser.planning.certified.task import AircraftTask, Airspace
from anser.planning.certified.timed_profiles import MINIMAL
from anser.planning.limits import PathLimits
from anser.planning.timed_path import TimedPath
from anser.shapes import Count, Flag, Scalar, ScalarLike, Vector3
from anser.spatial.rotations import safe_hypot

FIRST_PLAN, CORRECTED, REPLANNED, UNCHANGED, AWAITING_GOAL, PARTLY_CORRECTED = range(6)
REPLANNING_MESSAGES = (
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
SIGNIFICANT_DEVIATIONS = 3.0
"""By how many standard deviations, as the goal is known, a rendezvous is elsewhere before another plan is made for it.
Nearer, the next measurements may well bring it back."""
CORRECTION_FRACTIONS = (1.0, 0.75, 0.5, 0.25)
"""Parts of a bend that are tried, the greatest first, where no new plan is found."""
DELAY_FRACTIONS = (0.0, 0.03, 0.08, 0.15)
"""By which parts of the longest time to go the arrivals may be put off, where the arrival time is free."""


def interval_count(paths: TimedPath) -> int:
    """Even intervals between the knots of a path."""
    return paths.times.shape[-1] - 1 - (PIECES - 1) - KINKS


def correct_path(
    path: TimedPath, task: AircraftTask, time: ScalarLike, to_go: ScalarLike | None = None, lead: ScalarLike = 0.0
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
    to_go = end - time if to_go is None else to_go
    off = rendezvous_offset_n(path, task, to_go)
    begin = jnp.min(jnp.where(path.times > time + lead, path.times, end))
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


def rendezvous_offset_n(path: TimedPath, task: AircraftTask, to_go: ScalarLike) -> Vector3:
    """From where a path ends to where the rendezvous is expected after a time (s), NED, m."""
    return task.meeting_n(to_go) - path.air_n[-1, 0] - path.drift_n[-1, 0]


def rendezvous_has_moved(
    path: TimedPath, task: AircraftTask, covariance: Float[Array, "6 6"], to_go: ScalarLike
) -> Flag:
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
    off = rendezvous_offset_n(path, task, to_go)
    ahead = jnp.concatenate([off, to_go * off])
    variance = jnp.sum(ahead[:, None] * covariance * ahead[None, :])  # times the square of the distance
    return jnp.sum(off**2) ** 2 > SIGNIFICANT_DEVIATIONS**2 * variance


def task_from_plan(path: TimedPath, task: AircraftTask, time: ScalarLike) -> AircraftTask:
    """The task as its plan has it now: velocity and acceleration go on without a jump."""
    air, drift = path.states_n(time)
    return eqx.tree_at(
        lambda t: (t.position_n, t.air_velocity_n, t.air_acceleration_n),
        task,
        (air[0] + drift[0], air[1], air[2]),
    )


def arrival_delays(
    arrival_times: Float[Array, " aircraft"],
    time: ScalarLike,
    replannable: Bool[Array, " aircraft"],
    arrival_is_free: Flag,
    latest_arrival: ScalarLike,
    parts: tuple[float, ...] = DELAY_FRACTIONS,
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
    delays = jnp.asarray(parts) * jnp.maximum(last - time, 0.0)
    soon = jnp.sum(last + delays <= latest_arrival, dtype=jnp.int32)
    return delays, jnp.where(arrival_is_free & jnp.all(replannable), jnp.maximum(soon, 1), 1)


class ReplanningResult(eqx.Module):
    """A plan, its status (index into `REPLANNING_MESSAGES`), and whether a replanning that was due failed."""

    plan: CertifiedPlan
    status: Count
    replan_needed: Flag


def replan_certified(
    plan: CertifiedPlan,
    time: ScalarLike,
    tasks: AircraftTask,
    airspace: Airspace,
    arrival_is_free: Flag,
    freeze: ScalarLike = 0.0,
    latest_arrival: ScalarLike = jnp.inf,
    allow_replanning: bool = True,
    covariances: Float[Array, "aircraft 6 6"] | None = None,
    bent_limits: PathLimits | None = None,
) -> ReplanningResult:
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
        Whether the arrival times may be put off, see `arrival_delays`.
    freeze
        A path stands as it is for this long before its arrival, s.
    latest
        No arrival is put off beyond this, s.
    replans
        Whether a plan is made anew where one bent will not do.
    covariances
        Of the goals' positions and velocities, NED, m and m/s: no plan is made anew for one that is not
        `rendezvous_has_moved`, and its path stands where it cannot be bent. None: the goals are known exactly.
    bent_limits
        What a path that is bent may ask of each aircraft, where that is more than a new one may; None: the same.

    Returns
    -------
    The plan bent to where the rendezvous are now expected, if its certificate still keeps everything; else one planned
    anew from the planned positions, velocities and accelerations, with the limits of a new path or else with those of a
    bent one; else the last good plan, each path bent as far as its limits allow, if all still keep clear of each other.
    """
    intervals = interval_count(plan.paths)
    active = tasks.active > 0.0
    under_way = active & (plan.arrival_times > time)
    held_to = tasks if bent_limits is None else eqx.tree_at(lambda t: t.limits, tasks, bent_limits)
    paths = jax.vmap(correct_path, in_axes=(0, 0, None))(plan.paths, tasks, time)
    paths = select_rows(active & (plan.arrival_times - time > freeze), paths, plan.paths)
    bounds, awaited = None, jnp.zeros_like(under_way)
    if covariances is not None:
        sure = jax.vmap(rendezvous_has_moved)(plan.paths, tasks, covariances, plan.arrival_times - time)
        bounds = fleet_bounds(paths, airspace)
        awaited = under_way & ~sure & ~within_limits(bounds, held_to.limits)
        paths, bounds = select_rows(awaited, (plan.paths, plan.certificate.bounds), (paths, bounds))
    bent = _recertify(plan, paths, plan.arrival_times, held_to, airspace, intervals, time, under_way, bounds)
    fine = jnp.all(bent.feasible | ~under_way)
    how = jnp.where(jnp.any(awaited), AWAITING_GOAL, CORRECTED)
    if not allow_replanning:
        return ReplanningResult(bent, how, ~fine)

    free = active & (plan.arrival_times - time > jnp.maximum(freeze, COMMITTED_S))
    here = jax.vmap(task_from_plan, in_axes=(0, 0, None))(plan.paths, tasks, time)
    # They go on at the mean airspeed of their plans: to slow down in a descent may be more than the idle engine gives.
    speeds = jnp.where(plan.speeds > 0.0, plan.speeds, tasks.speed)
    here = eqx.tree_at(lambda t: (t.active, t.speed), here, (jnp.where(free, tasks.active, 0.0), speeds))

    counted = jnp.where(active, plan.arrival_times, -jnp.inf)
    delays, tries = arrival_delays(counted, time, free | ~active, arrival_is_free, latest_arrival)
    rounds = 1 if bent_limits is None else 2

    def certified(made: CertifiedPlan, paths: TimedPath, arrivals: Float[Array, " aircraft"]) -> CertifiedPlan:
        return _recertify(made, paths, arrivals, held_to, airspace, intervals, time, under_way)

    def again(carry: tuple[Count, Flag, CertifiedPlan]) -> tuple[Count, Flag, CertifiedPlan]:
        k, _, _ = carry
        durations = jnp.maximum(counted - time, COMMITTED_S) + delays[k % tries]
        limits = jax.tree.map(lambda new, bent: jnp.where(k < tries, new, bent), tasks.limits, held_to.limits)
        asking = eqx.tree_at(lambda t: t.limits, here, limits)
        made = plan_fleet_at(time, asking, airspace, durations, intervals, MINIMAL)
        # Those whose paths stand keep the sizes of these paths.
        made = eqx.tree_at(_plan_sizes, made, select_rows(free, _plan_sizes(made), _plan_sizes(plan)))
        arrivals = jnp.where(free, time + durations, plan.arrival_times)
        whole = certified(made, select_rows(free, made.paths, paths), arrivals)
        good = jnp.all(jnp.where(free, made.valid, True)) & jnp.all(whole.feasible | ~under_way)
        return k + 1, good, whole

    def in_part() -> tuple[Flag, CertifiedPlan]:
        def with_part(part: Scalar) -> tuple[TimedPath, Bool[Array, " aircraft"]]:
            bent_n = plan.paths.air_n + part * (paths.air_n - plan.paths.air_n)
            some = eqx.tree_at(lambda p: p.air_n, plan.paths, bent_n)
            return some, within_limits(fleet_bounds(some, airspace), held_to.limits)

        some, keeps = jax.lax.map(with_part, jnp.asarray(CORRECTION_FRACTIONS))
        most = jax.tree.map(lambda leaf: leaf[jnp.argmax(keeps, axis=0), jnp.arange(active.shape[0])], some)
        chosen = select_rows(jnp.any(keeps, axis=0), most, plan.paths)
        made = certified(plan, chosen, plan.arrival_times)
        moved = jnp.any(chosen.air_n != plan.paths.air_n)
        return moved & jnp.all(made.feasible | ~under_way), made

    def anew() -> ReplanningResult:
        _, found, made = jax.lax.while_loop(
            lambda c: (c[0] < rounds * tries) & ~c[1], again, (jnp.asarray(0), jnp.asarray(False), plan)
        )
        some, bent_in_part = in_part()
        kept = jax.tree.map(lambda a, b, c: jnp.where(found, a, jnp.where(some, b, c)), made, bent_in_part, plan)
        how = jnp.where(found, REPLANNED, jnp.where(some, PARTLY_CORRECTED, UNCHANGED))
        return ReplanningResult(kept, how, never)

    never = jnp.asarray(False)
    return jax.lax.cond(fine, lambda: ReplanningResult(bent, how, never), anew)


def _plan_sizes(plan: CertifiedPlan) -> tuple[Array, Array, Array]:
    return plan.lengths, plan.total_turn, plan.speeds


def _recertify(
    plan: CertifiedPlan,
    paths: TimedPath,
    arrivals: Float[Array, " aircraft"],
    tasks: AircraftTask,
    airspace: Airspace,
    intervals: int,
    time: ScalarLike,
    under_way: Bool[Array, " aircraft"],
    bounds: PathBounds | None = None,
) -> CertifiedPlan:
    """A plan with other paths, certified from now on."""
    watched = eqx.tree_at(lambda t: t.active, tasks, jnp.where(under_way, tasks.active, 0.0))
    certificate = certify(paths, watched, airspace, intervals, time, bounds)
    ahead = jax.vmap(TimedPath.air_length, in_axes=(0, None))(paths, time)
    return eqx.tree_at(
        lambda p: (p.paths, p.arrival_times, p.certificate, p.valid, p.lengths),
        plan,
        (paths, arrivals, certificate, jnp.ones_like(plan.valid), jnp.where(under_way, ahead, plan.lengths)),
    )


_FADE_S = 4.0  # in which the acceleration of the plan that is left dies down
_LEVEL_S = 12.0  # in which the climb or descent is ended
_BANK_MAX = 0.7  # rad, greatest of the turn
_BLEND_SLOPE_MAX = 1.875  # slope of the blend at its middle


def exit_path(
    path: TimedPath, now: ScalarLike, until: ScalarLike, turn: ScalarLike, wind: AbstractWind, gravity: ScalarLike
) -> TimedPath:
    """Path from where a planned path is now to a time (s), with as many knots.

    It goes on without a jump of velocity or acceleration, levels off, turns by an angle (rad, right positive) at a bank
    of at most 40 deg, and keeps its level airspeed.

    Parameters
    ----------
    path
        In force.
    now, until
        s.
    turn
        From the present course through the air, rad.
    wind
        As planned with.
    gravity
        m/s^2.
    """
    air, drift = path.states_n(now)
    place_n, velocity_n, acceleration_n = air[0] + drift[0], air[1], air[2]
    level = jnp.maximum(safe_hypot(velocity_n[0], velocity_n[1]), 1.0)
    turning_s = jnp.maximum(_BLEND_SLOPE_MAX * jnp.abs(turn) * level / (gravity * jnp.tan(_BANK_MAX)), 1.0)
    times = now + (until - now) * jnp.linspace(0.0, 1.0, path.times.shape[0])

    def velocity_at(elapsed: Scalar) -> Vector3:
        angle = turn * _blend(elapsed / turning_s)
        cosine, sine = jnp.cos(angle), jnp.sin(angle)
        turned = jnp.stack(
            [
                cosine * velocity_n[0] - sine * velocity_n[1],
                sine * velocity_n[0] + cosine * velocity_n[1],
                velocity_n[2] * (1.0 - _blend(elapsed / _LEVEL_S)),
            ]
        )
        left = jnp.maximum(1.0 - elapsed / _FADE_S, 0.0)
        return turned + acceleration_n * elapsed * left**2

    def with_rate(function: Callable[[Scalar], Vector3], at: Scalar) -> tuple[Array, Array]:
        return jax.jvp(function, (at,), (jnp.ones_like(at),))

    elapsed = times - now
    velocities, rates = jax.vmap(lambda t: with_rate(velocity_at, t))(elapsed)
    places = _integrated(elapsed, velocities, rates)
    downs = place_n[2] + places[:, 2]

    def blowing(down: Scalar, falling: Scalar) -> tuple[Array, Array]:
        at = jnp.stack([place_n[0], place_n[1], down])
        return jax.jvp(lambda p: wind.at(p, now), (at,), (jnp.stack([0.0 * down, 0.0 * down, falling]),))

    # The wind's own vertical part moves the aircraft to other layers too; it is steady, and small.
    winds, wind_rates = jax.vmap(blowing)(downs, velocities[:, 2])
    drifts = _integrated(elapsed, winds, wind_rates)
    return TimedPath(
        times,
        jnp.stack([place_n[None] + places, velocities, rates], axis=1),
        jnp.stack([drifts, winds, wind_rates], axis=1),
    )


def _blend(u: Scalar) -> Scalar:
    u = jnp.clip(u, 0.0, 1.0)
    return u**3 * (10.0 + u * (-15.0 + 6.0 * u))


def _integrated(
    times: Float[Array, " knots"], slopes: Float[Array, "knots 3"], rates: Float[Array, "knots 3"]
) -> Float[Array, "knots 3"]:
    """Integral from the first knot on of what has such values and slopes, by Hermite's rule."""
    span = (times[1:] - times[:-1])[:, None]
    steps = 0.5 * span * (slopes[1:] + slopes[:-1]) + span**2 / 12.0 * (rates[:-1] - rates[1:])
    return jnp.concatenate([jnp.zeros((1, 3)), jnp.cumsum(steps, axis=0)])
