"""Replanning in flight: correction or replacement of a certified plan, and the exit path of a departing aircraft.

The compiled loop corrects plans by `correct_plan`; new plans are made between two steps by `correct_or_replace_plan`,
and after an event by `anser.missions.event_replanning`. Planned velocity and acceleration continue without a jump.
"""

import dataclasses
from collections.abc import Callable, Iterator

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from anser.compiling.options import compiled_quickly
from anser.environment.environment import AbstractWind
from anser.numerics.arrays import as_array, select_rows
from anser.planning.certified.certified_plan import (
    CertifiedPlan,
    FixedPaths,
    certify,
    fleet_bounds,
    plan_at,
    within_limits,
)
from anser.planning.certified.path_bounds import PathBounds
from anser.planning.certified.profile import KINKS
from anser.planning.certified.routes import PIECES
from anser.planning.certified.task import AircraftTask, Airspace
from anser.planning.certified.timed_profiles import MINIMAL
from anser.planning.limits import PathLimits
from anser.planning.timed_path import TimedPath
from anser.shapes import Flag, Integer, Scalar, ScalarLike, Vector3
from anser.spatial.rotations import safe_hypot

FIRST_PLAN, CORRECTED, REPLANNED, UNCHANGED, AWAITING_GOAL, PARTLY_CORRECTED = range(6)
"""Origins of a plan:

- FIRST_PLAN: first plan
- CORRECTED: plan in force, corrected to the expected rendezvous
- REPLANNED: new plan from the planned state
- UNCHANGED: plan in force, because no correction and no new plan satisfies every limit
- AWAITING_GOAL: plan in force; some paths are uncorrected, because their goals' estimates justify no new plan
- PARTLY_CORRECTED: plan in force, corrected as far as the limits allow
"""
COMMITTED_S = 15.0
"""Time to the arrival, s, below which an aircraft's path may be corrected, but not replaced."""
_SAME_POSITION_M = 1e-6
SIGNIFICANT_DEVIATIONS = 3.0
"""Least shift of a rendezvous, in standard deviations of the goal's estimate, that justifies a new plan."""
_INHERITED_SHARE = 0.98
"""Least ratio of the new to the present clearance ratio, of a path and an exit path that are too near already."""
CORRECTION_FRACTIONS = (1.0, 0.75, 0.5, 0.25)
"""Fractions of a path's correction to try if the whole correction is infeasible and no new plan is found."""
DELAY_FRACTIONS = (0.0, 0.03, 0.08, 0.15)
"""Delays to try if the arrival rule leaves the times open, as fractions of the longest time to the arrival."""


def interval_count(paths: TimedPath) -> int:
    """Return the number of equal intervals of a planned path: knots at kinks of the path are not counted."""
    return paths.times.shape[-1] - 1 - (PIECES - 1) - KINKS


def correct_path(
    path: TimedPath,
    task: AircraftTask,
    time: ScalarLike,
    to_go: ScalarLike | None = None,  # time to the end of the path, s; None: end of the path - `time`
    lead: ScalarLike = 0.0,  # duration in which the path stays unchanged, s
) -> TimedPath:
    """Return the path with its end moved to the rendezvous expected from the goal measured now (in `task`).

    From the first knot after `time` + `lead` (s, as in `path.times`) to the end, the displacement d of the end is
    blended in by d (10 u^3 - 15 u^4 + 6 u^5), u from 0 to 1 in proportion to the time. Position, velocity and
    acceleration stay continuous.
    """
    end = path.times[-1]
    to_go = end - time if to_go is None else to_go
    offset = rendezvous_offset_n(path, task, to_go)
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
    has_moved = (jnp.sum(offset**2) > _SAME_POSITION_M**2) & (end > begin)
    corrected = path.air_n + shares[:, :, None] * offset[None, None, :]
    return eqx.tree_at(lambda p: p.air_n, path, jnp.where(has_moved, corrected, path.air_n))


def rendezvous_offset_n(path: TimedPath, task: AircraftTask, to_go: ScalarLike) -> Vector3:
    """Return the offset from the end of a path to the rendezvous expected `to_go` seconds from now, NED, m."""
    return task.meeting_n(to_go) - path.air_n[-1, 0] - path.drift_n[-1, 0]


def rendezvous_has_moved(
    path: TimedPath, task: AircraftTask, covariance: Float[Array, "6 6"], to_go: ScalarLike
) -> Flag:
    """Return whether the rendezvous is farther from the end of the path than the uncertainty of its goal explains.

    `task` has the currently measured goal; `to_go` is the time to the arrival, s. For `covariance` and the threshold,
    see `exceeds_uncertainty`.
    """
    return exceeds_uncertainty(rendezvous_offset_n(path, task, to_go), covariance, to_go)


def exceeds_uncertainty(offset: Vector3, covariance: Float[Array, "6 6"], to_go: ScalarLike) -> Flag:
    """Return whether the deviation `offset` (NED, m) of a position in `to_go` seconds exceeds its uncertainty.

    The threshold is `SIGNIFICANT_DEVIATIONS` standard deviations along the offset, extrapolated at steady velocity from
    the `covariance` of the current position and velocity, NED, m and m/s.
    """
    weights = jnp.concatenate([offset, to_go * offset])
    # variance along the offset, times the offset's square
    variance = jnp.sum(weights[:, None] * covariance * weights[None, :])
    return jnp.sum(offset**2) ** 2 > SIGNIFICANT_DEVIATIONS**2 * variance


def task_from_plan(path: TimedPath, task: AircraftTask, time: ScalarLike) -> AircraftTask:
    """Return the planning problem that starts at position, velocity and acceleration of a path at a time (s)."""
    air, drift = path.states_n(time)
    return dataclasses.replace(task, position_n=air[0] + drift[0], air_velocity_n=air[1], air_acceleration_n=air[2])


def tasks_from_plan(plan: CertifiedPlan, tasks: AircraftTask, time: ScalarLike) -> AircraftTask:
    """Return the planning problems of a fleet that start at the planned states at a time (s)."""
    # The preferred airspeed is the plan's: idle thrust may not suffice for a deceleration in a descent.
    planned_tasks = jax.vmap(task_from_plan, in_axes=(0, 0, None))(plan.paths, tasks, time)
    return eqx.tree_at(lambda t: t.speed, planned_tasks, jnp.where(plan.speeds > 0.0, plan.speeds, tasks.speed))


def arrival_delays(
    arrival_times: Float[Array, " aircraft"],  # planned arrival times, s; -inf for an ignored aircraft
    time: ScalarLike,  # current time, s
    replannable: Bool[Array, " aircraft"],  # whether each aircraft may get a new plan; True for an ignored aircraft
    arrival_is_free: Flag,  # whether the arrival rule leaves the arrival times open
    latest_arrival: ScalarLike,  # latest allowed arrival time, s
    parts: tuple[float, ...] = DELAY_FRACTIONS,  # delays as fractions of the longest time to go
) -> tuple[Float[Array, " delays"], Integer]:
    """Return the delays to try for a fleet's arrivals, s, rising from zero, and how many of them are allowed.

    A delay of the whole fleet is allowed if the last aircraft then arrives by `latest_arrival`. If an aircraft cannot
    be replanned or the arrival rule fixes the times, only the delay zero is allowed. Zero is always allowed.
    """
    last_arrival = jnp.max(arrival_times)
    delays = jnp.asarray(parts) * jnp.maximum(last_arrival - time, 0.0)
    open_count = jnp.sum(last_arrival + delays <= latest_arrival, dtype=jnp.int32)
    return delays, jnp.where(arrival_is_free & jnp.all(replannable), jnp.maximum(open_count, 1), 1)


class AttemptLadder(eqx.Module):
    """Order of the attempts at a new plan in flight: every allowed delay with `limits`, then with `relaxed_limits`."""

    delays: Float[Array, " tries"]  # delays of the arrivals, s
    delay_count: Integer  # number of allowed delays, the first ones
    limits: PathLimits  # limits of a new path
    relaxed_limits: PathLimits | None  # wider limits, of a corrected path; None: no attempts with wider limits

    def attempts(self) -> Iterator[tuple[float, PathLimits]]:
        """Yield the delay of the arrivals (s) and the path limits of each attempt; not traceable by JAX."""
        delays = np.asarray(self.delays)[: int(self.delay_count)]
        for limits in (self.limits, self.relaxed_limits):
            if limits is not None:
                yield from ((float(delay), limits) for delay in delays)


class PlanInFlight(eqx.Module):
    """A certified plan in flight, with the data for its correction or replacement at the current time."""

    plan: CertifiedPlan
    time: ScalarLike  # current time, s
    # planning problems with the currently measured goals; the motion of the aircraft is taken from the plan. The path
    # and the arrival time of an inactive aircraft stay; active aircraft avoid this path only after the aircraft left
    tasks: AircraftTask
    airspace: Airspace
    freeze: ScalarLike  # duration before the arrival in which a path is frozen, s
    # covariances of the goals' positions and velocities, NED, m and m/s; None: the goals are exact. If a correction is
    # infeasible and the shift of the goal is not significant (`rendezvous_has_moved`), the path stays, and no new plan
    # is made
    covariances: Float[Array, "aircraft 6 6"] | None
    correction_limits: PathLimits | None  # limits of a corrected path; None: limits of the tasks
    has_left: Bool[Array, " aircraft"]  # mask of the aircraft on exit paths, which the fleet avoids
    arrival_is_free: Flag  # whether arrivals may be postponed
    latest_arrival: ScalarLike  # latest allowed arrival time, s

    @property
    def under_way(self) -> Bool[Array, " aircraft"]:
        """Mask of the active aircraft that have not arrived."""
        return (self.tasks.active > 0.0) & (self.plan.arrival_times > self.time)

    @property
    def replannable(self) -> Bool[Array, " aircraft"]:
        """Mask of the active aircraft that may get a new path: farther from arrival than `freeze` and `COMMITTED_S`."""
        is_early = self.plan.arrival_times - self.time > jnp.maximum(self.freeze, COMMITTED_S)
        return (self.tasks.active > 0.0) & is_early

    @property
    def path_limits(self) -> PathLimits:
        """Limits of a corrected path."""
        return self.tasks.limits if self.correction_limits is None else self.correction_limits

    def certified(
        self,
        plan: CertifiedPlan,
        paths: TimedPath,
        arrivals: Float[Array, " aircraft"],
        bounds: PathBounds | None = None,
    ) -> CertifiedPlan:
        """Return a plan with other paths and arrival times (s), certified with the limits of a corrected path.

        Distances count from the current time on, for aircraft under way and on exit paths. `valid` is set to True;
        `bounds` are the bounds of the paths, None: computed here.
        """
        active = jnp.where(self.under_way | self.has_left, 1.0, 0.0)
        certified_tasks = dataclasses.replace(self.tasks, active=active, limits=self.path_limits)
        certificate = certify(paths, certified_tasks, self.airspace, interval_count(paths), self.time, bounds)
        remaining_lengths = jax.vmap(TimedPath.air_length, in_axes=(0, None))(paths, self.time)
        return dataclasses.replace(
            plan,
            paths=paths,
            arrival_times=arrivals,
            certificate=certificate,
            valid=jnp.ones_like(plan.valid),
            lengths=jnp.where(self.under_way, remaining_lengths, plan.lengths),
        )

    def accepts(self, plan: CertifiedPlan) -> Flag:
        """Return whether a certified plan satisfies every constraint of the aircraft under way.

        Exception: a path that is too near to an exit path already in the plan in force may stay too near. The clearance
        ratio must then be at least `_INHERITED_SHARE` times the ratio in the plan in force.
        """
        # No plan resolved such a conflict at the event.
        ratios, in_force = plan.certificate.clearance_ratio, self.plan.certificate.clearance_ratio
        is_inherited = self.has_left[None, :] & (in_force < 1.0) & (ratios >= _INHERITED_SHARE * in_force)
        ratios = jnp.where(is_inherited, jnp.inf, ratios)
        certificate = dataclasses.replace(plan.certificate, clearance_ratio=ratios)
        return jnp.all((plan.valid & certificate.satisfied) | ~self.under_way)


def correct_plan(in_flight: PlanInFlight) -> tuple[CertifiedPlan, Integer, Flag]:
    """Correct the paths that are not frozen so that they end at the rendezvous expected from the goals measured now.

    A path stays as it is if its correction exceeds a limit and the shift of its goal is not significant. Returns the
    plan, its origin (`AWAITING_GOAL` if such a path exists, else `CORRECTED`), and whether the plan satisfies every
    constraint.
    """
    plan, tasks, time, under_way = in_flight.plan, in_flight.tasks, in_flight.time, in_flight.under_way
    paths = jax.vmap(correct_path, in_axes=(0, 0, None))(plan.paths, tasks, time)
    paths = select_rows((tasks.active > 0.0) & (plan.arrival_times - time > in_flight.freeze), paths, plan.paths)
    bounds, awaiting = None, jnp.zeros_like(under_way)
    if in_flight.covariances is not None:
        significant = jax.vmap(rendezvous_has_moved)(
            plan.paths, tasks, in_flight.covariances, plan.arrival_times - time
        )
        bounds = fleet_bounds(paths, in_flight.airspace)
        awaiting = under_way & ~significant & ~within_limits(bounds, in_flight.path_limits)
        paths, bounds = select_rows(awaiting, (plan.paths, plan.certificate.bounds), (paths, bounds))
    corrected = in_flight.certified(plan, paths, plan.arrival_times, bounds)
    status = jnp.where(jnp.any(awaiting), AWAITING_GOAL, CORRECTED)
    return corrected, status, in_flight.accepts(corrected)


class ReplanningProblem(eqx.Module):
    """Data of the attempts at another plan, if the plan in force cannot be corrected to the expected rendezvous."""

    in_flight: PlanInFlight
    paths: TimedPath  # corrected paths
    planned_tasks: AircraftTask  # tasks from which new paths start
    times_to_go: Float[Array, " aircraft"]  # durations of new paths before the delays of the `ladder`, s
    ladder: AttemptLadder

    def accept(self, new_plan: CertifiedPlan, durations: Float[Array, " aircraft"]) -> tuple[Flag, CertifiedPlan]:
        """Return whether a new plan is feasible for the fleet, and the fleet's plan with its certificate.

        The new paths take `durations` (s). Aircraft that may not be replanned keep their corrected paths and arrival
        times.
        """
        plan, replannable = self.in_flight.plan, self.in_flight.replannable
        # Aircraft with a fixed path keep its length, turn and speed.
        new_plan = eqx.tree_at(
            _plan_sizes, new_plan, select_rows(replannable, _plan_sizes(new_plan), _plan_sizes(plan))
        )
        arrivals = jnp.where(replannable, self.in_flight.time + durations, plan.arrival_times)
        paths = select_rows(replannable, new_plan.paths, self.paths)
        fleet_plan = self.in_flight.certified(new_plan, paths, arrivals)
        is_valid = jnp.all(jnp.where(replannable, new_plan.valid, True))
        return is_valid & self.in_flight.accepts(fleet_plan), fleet_plan

    def correct_partly(self) -> tuple[Flag, CertifiedPlan]:
        """Correct each path by the greatest of `CORRECTION_FRACTIONS` that its limits allow, or not at all.

        The first result tells whether a path has changed and the plan satisfies every constraint.
        """
        plan, under_way = self.in_flight.plan, self.in_flight.under_way

        def correct_by(fraction: Scalar) -> tuple[TimedPath, Bool[Array, " aircraft"]]:
            corrected_n = plan.paths.air_n + fraction * (self.paths.air_n - plan.paths.air_n)
            trial_paths = eqx.tree_at(lambda p: p.air_n, plan.paths, corrected_n)
            bounds = fleet_bounds(trial_paths, self.in_flight.airspace)
            return trial_paths, within_limits(bounds, self.in_flight.path_limits)

        trial_paths, satisfies = jax.lax.map(correct_by, jnp.asarray(CORRECTION_FRACTIONS))
        corrected_paths = jax.tree.map(
            lambda leaf: leaf[jnp.argmax(satisfies, axis=0), jnp.arange(under_way.shape[0])], trial_paths
        )
        chosen = select_rows(jnp.any(satisfies, axis=0), corrected_paths, plan.paths)
        candidate_plan = self.in_flight.certified(plan, chosen, plan.arrival_times)
        has_moved = jnp.any(chosen.air_n != plan.paths.air_n)
        return has_moved & self.in_flight.accepts(candidate_plan), candidate_plan


@compiled_quickly
def _correct_and_prepare(
    in_flight: PlanInFlight,
) -> tuple[tuple[CertifiedPlan, Integer, Flag], ReplanningProblem]:
    """Return the results of `correct_plan`, and the data of the attempts at another plan."""
    correction = correct_plan(in_flight)
    plan, tasks, time, replannable = in_flight.plan, in_flight.tasks, in_flight.time, in_flight.replannable
    active = tasks.active > 0.0
    planned_tasks = dataclasses.replace(
        tasks_from_plan(plan, tasks, time), active=jnp.where(replannable, tasks.active, 0.0)
    )
    active_arrivals = jnp.where(active, plan.arrival_times, -jnp.inf)
    delays, tries = arrival_delays(
        active_arrivals, time, replannable | ~active, in_flight.arrival_is_free, in_flight.latest_arrival
    )
    times_to_go = jnp.maximum(active_arrivals - time, COMMITTED_S)
    ladder = AttemptLadder(delays, tries, tasks.limits, in_flight.correction_limits)
    return correction, ReplanningProblem(in_flight, correction[0].paths, planned_tasks, times_to_go, ladder)


_accept = compiled_quickly(ReplanningProblem.accept)
_correct_partly = compiled_quickly(ReplanningProblem.correct_partly)


def correct_or_replace_plan(in_flight: PlanInFlight) -> tuple[CertifiedPlan, int]:
    """Correct or replace a plan so that it leads to the currently measured goals; not traceable by JAX.

    Returns the first feasible of these plans, and its origin:

    1. the current plan, corrected to the expected rendezvous;
    2. a new plan from the planned positions, velocities and accelerations, with the limits of a new path, for each
       allowed delay of the arrivals;
    3. a new plan with the limits of a corrected path, for each allowed delay;
    4. the current plan, with each path corrected as far as its limits allow;
    5. the current plan unchanged.
    """
    (corrected, status, is_feasible), problem = _correct_and_prepare(in_flight)
    if is_feasible:
        return corrected, int(status)
    plan, times_to_go = in_flight.plan, np.asarray(problem.times_to_go)
    fixed_paths = exit_paths(plan, np.asarray(in_flight.has_left))
    for delay, limits in problem.ladder.attempts():
        durations = as_array(times_to_go + delay)
        tasks = dataclasses.replace(problem.planned_tasks, limits=limits)
        intervals, time = interval_count(plan.paths), float(in_flight.time)
        new_plan = plan_at(time, tasks, in_flight.airspace, durations, intervals, MINIMAL, fixed_paths)
        is_new, new_plan = _accept(problem, new_plan, durations)
        if is_new:
            return new_plan, REPLANNED
    is_corrected, corrected_plan = _correct_partly(problem)
    return (corrected_plan, PARTLY_CORRECTED) if is_corrected else (plan, UNCHANGED)


def _plan_sizes(plan: CertifiedPlan) -> tuple[Array, Array, Array]:
    return plan.lengths, plan.total_turn, plan.speeds


def exit_paths(plan: CertifiedPlan, has_left: Bool[np.ndarray, " aircraft"]) -> FixedPaths | None:
    """Return the exit paths in a plan as fixed paths for a search; None if no aircraft has left the fleet."""
    return FixedPaths(as_array(has_left, bool), plan.paths, plan.arrival_times) if np.any(has_left) else None


_FADE_S = 4.0  # duration in which the acceleration of the abandoned plan fades out
_LEVEL_S = 12.0  # duration of the level-off
_BANK_MAX = 0.7  # rad, greatest bank angle of the turn
_BANK_FRACTION = 0.9  # of the aircraft's bank limit, which the bounds of the certificate must keep too
_BLEND_SLOPE_MAX = 1.875  # greatest slope of the blend, at its middle


def exit_path(
    start: AircraftTask,  # position, velocity and acceleration at `start_time`; limit of the bank angle
    start_time: ScalarLike,
    end_time: ScalarLike,
    turn: ScalarLike,  # change of course, rad, right positive
    wind: AbstractWind,
    gravity: ScalarLike,
    knot_count: int,
) -> TimedPath:
    """Return the path of `knot_count` knots from `start_time` to `end_time` (s) on which an aircraft leaves the fleet.

    Velocity and acceleration continue without a jump. The aircraft levels off in 12 s, turns by `turn` at a bank angle
    of at most 40 deg and 0.9 of its limit, and keeps its horizontal airspeed. Limits, separation and keep-outs are not
    checked.
    """
    position_n, velocity_n, acceleration_n = start.position_n, start.air_velocity_n, start.air_acceleration_n
    level_speed = jnp.maximum(safe_hypot(velocity_n[0], velocity_n[1]), 1.0)
    side = gravity * jnp.tan(jnp.minimum(_BANK_MAX, _BANK_FRACTION * start.limits.bank_max))
    turning_s = jnp.maximum(_BLEND_SLOPE_MAX * jnp.abs(turn) * level_speed / side, 1.0)
    times = start_time + (end_time - start_time) * jnp.linspace(0.0, 1.0, knot_count)

    def velocity_at(elapsed: Scalar) -> Vector3:
        angle = turn * _blend(elapsed / turning_s)
        cosine, sine = jnp.cos(angle), jnp.sin(angle)
        velocity = jnp.stack(
            [
                cosine * velocity_n[0] - sine * velocity_n[1],
                sine * velocity_n[0] + cosine * velocity_n[1],
                velocity_n[2] * (1.0 - _blend(elapsed / _LEVEL_S)),
            ]
        )
        fade = jnp.maximum(1.0 - elapsed / _FADE_S, 0.0)
        return velocity + acceleration_n * elapsed * fade**2

    def with_rate(function: Callable[[Scalar], Vector3], at: Scalar) -> tuple[Array, Array]:
        return jax.jvp(function, (at,), (jnp.ones_like(at),))

    elapsed = times - start_time
    velocities, rates = jax.vmap(lambda t: with_rate(velocity_at, t))(elapsed)
    displacements = _integrated(elapsed, velocities, rates)
    downs = position_n[2] + displacements[:, 2]

    def wind_along(down: Scalar, falling: Scalar) -> tuple[Array, Array]:
        at = jnp.stack([position_n[0], position_n[1], down])
        return jax.jvp(lambda p: wind.at(p, start_time), (at,), (jnp.stack([0.0 * down, 0.0 * down, falling]),))

    # The small, steady vertical wind is neglected in the change of layers.
    winds, wind_rates = jax.vmap(wind_along)(downs, velocities[:, 2])
    drifts = _integrated(elapsed, winds, wind_rates)
    return TimedPath(
        times,
        jnp.stack([position_n[None] + displacements, velocities, rates], axis=1),
        jnp.stack([drifts, winds, wind_rates], axis=1),
    )


def _blend(u: Scalar) -> Scalar:
    u = jnp.clip(u, 0.0, 1.0)
    return u**3 * (10.0 + u * (-15.0 + 6.0 * u))


def _integrated(
    times: Float[Array, " knots"], slopes: Float[Array, "knots 3"], rates: Float[Array, "knots 3"]
) -> Float[Array, "knots 3"]:
    """Integrate `slopes` over `times` (s) from the first knot to each knot; `rates` are derivatives of `slopes`."""
    span = (times[1:] - times[:-1])[:, None]
    # corrected trapezoidal rule
    steps = 0.5 * span * (slopes[1:] + slopes[:-1]) + span**2 / 12.0 * (rates[:-1] - rates[1:])
    return jnp.concatenate([jnp.zeros((1, 3)), jnp.cumsum(steps, axis=0)])
