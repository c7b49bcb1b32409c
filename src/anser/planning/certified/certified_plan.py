"""A whole fleet planned for given arrival times, with bounds that prove what is kept."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from anser.compiling import compiled_by_older_generator
from anser.numerics import leading, namespace, zeros_as
from anser.numerics.stacking import rows_where
from anser.planning.certified.broad_phase import INTERVALS_PER_CYLINDER, fleet_clearance_ratio, fleet_cylinders
from anser.planning.certified.candidate_sets import CandidateSet
from anser.planning.certified.candidates import SPLINE, Candidates, fleet_candidates
from anser.planning.certified.clearance import Track, clearance_from_keep_outs
from anser.planning.certified.path_bounds import PathBounds, excess, path_bounds
from anser.planning.certified.placement import Placement, fewest_first, place
from anser.planning.certified.task import AircraftTask, Airspace
from anser.planning.certified.tracking import path_track
from anser.planning.limits import PathLimits
from anser.planning.timed_path import TimedPath
from anser.shapes import Count, Flag, Scalar, ScalarLike

FINE = 4
"""Intervals of the certificate's distances for each interval between a path's even knots."""


class Certificate(eqx.Module):
    """What a fleet's paths certainly keep, between the instants looked at too.

    Attributes
    ----------
    bounds
        Of each path.
    excess
        By how much each passes each limit, as a part of it, in the order of `CERTIFIED_LIMITS`; positive: broken.
    clearance_ratio
        Of each pair, the least ratio of distance to separation, or less; 1 is enough. Infinite for an aircraft and
        itself. In a large fleet it is exact for the nearest only, see `anser.planning.certified.broad_phase`.
    keep_out_clearance
        How far each stays out of each keep-out at least, m.
    """

    bounds: PathBounds
    excess: Float[Array, "aircraft limits"]
    clearance_ratio: Float[Array, "aircraft aircraft"]
    keep_out_clearance: Float[Array, "aircraft volumes"]

    @property
    def kept_alone(self) -> Bool[Array, " aircraft"]:
        """Whether each aircraft keeps everything but its distance from others."""
        xp = namespace(self)
        excess, clearance = xp.asarray(self.excess), xp.asarray(self.keep_out_clearance)
        return xp.all(excess <= _ROUNDING, axis=1) & xp.all(clearance >= -_ROUNDING_M, axis=1)

    @property
    def kept(self) -> Bool[Array, " aircraft"]:
        """Whether each aircraft keeps everything."""
        xp = namespace(self)
        return self.kept_alone & xp.all(xp.asarray(self.clearance_ratio) >= 1.0 - _ROUNDING, axis=1)


_ROUNDING = 1e-7  # as a part of a limit: a path that starts at it is not refused for rounding
_ROUNDING_M = 1e-3


class CertifiedPlan(eqx.Module):
    """Paths of a fleet; leading axis aircraft.

    Whether a path is good is said in steps: `valid`, one was found within its aircraft's own limits; then, of what was
    found, `certificate.kept_alone`, limits and keep-outs are kept between all knots too; `certificate.kept`, and the
    separation from the others; `feasible`, all of this together.

    Attributes
    ----------
    paths
        Where each is when.
    arrival_times
        When each is at its rendezvous, s.
    certificate
        What they keep.
    valid
        Whether a path was found for each within its own limits, as far as its samples tell.
    lengths
        Of the paths through the air, in space, from the plan's last renewal on, m.
    turned
        Sum of the sizes of all turns of each, as planned, rad.
    speeds
        Mean airspeeds, m/s.
    """

    paths: TimedPath
    arrival_times: Float[Array, " aircraft"]
    certificate: Certificate
    valid: Bool[Array, " aircraft"]
    lengths: Float[Array, " aircraft"]
    turned: Float[Array, " aircraft"]
    speeds: Float[Array, " aircraft"]

    def leading(self, count: int) -> "CertifiedPlan":
        """Of the first aircraft only; concrete."""
        first = leading(self, count)
        return eqx.tree_at(lambda p: p.certificate.clearance_ratio, first, first.certificate.clearance_ratio[:, :count])

    @property
    def feasible(self) -> Bool[Array, " aircraft"]:
        """Whether each aircraft's path is there and keeps everything."""
        return namespace(self).asarray(self.valid) & self.certificate.kept


class Standing(eqx.Module):
    """Paths that stand as they are while the rest of a fleet is planned around them; leading axis aircraft.

    Attributes
    ----------
    which
        Whose paths stand.
    paths
        Where they are when; of the others they mean nothing.
    arrival_times
        When they are at their rendezvous, s.
    """

    which: Bool[Array, " aircraft"]
    paths: TimedPath
    arrival_times: Float[Array, " aircraft"]


def fleet_bounds(paths: TimedPath, airspace: Airspace) -> PathBounds:
    """Bounds of stacked paths."""
    return jax.vmap(path_bounds, in_axes=(0, None, None))(paths, airspace.wind, airspace.gravity)


def within_limits(bounds: PathBounds, limits: PathLimits) -> Bool[Array, " aircraft"]:
    """Whether each of stacked bounds keeps its aircraft's limits."""
    return jnp.all(jax.vmap(excess)(bounds, limits) <= _ROUNDING, axis=1)


def certify(
    paths: TimedPath,
    tasks: AircraftTask,
    airspace: Airspace,
    intervals: int,
    since: ScalarLike = -jnp.inf,
    bounds: PathBounds | None = None,
) -> Certificate:
    """What stacked paths keep; `intervals` even intervals lie between the knots of each.

    Limits are looked at over whole paths, distances from a time (s) on. `bounds` of the paths, where they are known.
    """
    bounds = fleet_bounds(paths, airspace) if bounds is None else bounds
    over = jax.vmap(excess)(bounds, tasks.limits)
    # A path that is none, which its own bounds tell, must not hide the others.
    starts, ends = paths.times[:, 0], paths.times[:, -1]
    start = jnp.min(jnp.where(jnp.isfinite(starts), starts, jnp.inf))
    end = jnp.max(jnp.where(jnp.isfinite(ends), ends, -jnp.inf))
    times = start + (end - start) * jnp.linspace(0.0, 1.0, FINE * intervals + 1)

    def tracked(path: TimedPath, accelerations: Array, active: Scalar) -> Track:
        return path_track(path, accelerations, active, times, since)

    tracks = jax.vmap(tracked)(paths, bounds.cell_acceleration, tasks.active)
    fleet = paths.times.shape[0]
    cylinders, everyone = fleet_cylinders(tracks, fleet, FINE * INTERVALS_PER_CYLINDER), jnp.arange(fleet)

    def ratios_of(who: Count) -> Float[Array, " aircraft"]:
        def tracks_of(some: Int[Array, " some"]) -> Track:
            return jax.tree.map(lambda leaf: leaf[some], tracks)

        one, own = jax.tree.map(lambda leaf: leaf[who], (tracks, cylinders))
        return fleet_clearance_ratio(one, own, cylinders, tracks_of, everyone != who, airspace.separation)

    ratios = jax.lax.map(ratios_of, everyone)
    clearance = jax.lax.map(lambda one: clearance_from_keep_outs(one, times, airspace.keep_outs), tracks)
    return Certificate(bounds, over, ratios, clearance)


def plan_fleet_at(
    start_time: ScalarLike,
    tasks: AircraftTask,
    airspace: Airspace,
    durations: Float[Array, " aircraft"],
    intervals: int,
    candidate_set: CandidateSet,
    extra_for: Bool[Array, " aircraft"] | None = None,
    standing: Standing | None = None,
) -> CertifiedPlan:
    """Plan a fleet from a time (s) on for given durations to each rendezvous (s).

    Parameters
    ----------
    intervals
        Even intervals between the knots of a path.
    extra_for
        Aircraft for which `candidate_set.extra` is looked at too; None: all that are active.
    standing
        Paths that the others keep clear of; these aircraft need not be active. None: there are none.
    """
    volumes = airspace.keep_outs
    begun = eqx.tree_at(
        lambda a: a.keep_outs.position_n, airspace, volumes.position_n + start_time * volumes.velocity_n
    )
    candidates = fleet_candidates(tasks, begun, durations, intervals, intervals, candidate_set, extra_for)
    fleet, since = jnp.arange(durations.shape[0]), -jnp.inf
    if standing is not None:
        candidates = _around(candidates, standing, airspace, start_time, durations, intervals)
        tasks = eqx.tree_at(lambda t: t.active, tasks, jnp.where(standing.which, 1.0, tasks.active))
        since = start_time

    def placed_of(valid: Bool[Array, "aircraft candidates"]) -> tuple[CertifiedPlan, Placement]:
        left = eqx.tree_at(lambda c: c.valid, candidates, valid)
        placed = place(left, airspace.separation, fewest_first(left))
        paths, arrivals = candidates.paths(start_time, placed.chosen), start_time + durations
        if standing is not None:
            paths = rows_where(standing.which, standing.paths, paths)
            arrivals = jnp.where(standing.which, standing.arrival_times, arrivals)
        plan = CertifiedPlan(
            paths=paths,
            arrival_times=arrivals,
            certificate=certify(paths, tasks, airspace, intervals, since),
            valid=placed.valid,
            lengths=jax.vmap(TimedPath.air_length)(paths),
            turned=candidates.turned[fleet, placed.chosen],
            speeds=candidates.speed[fleet, placed.chosen],
        )
        return plan, placed

    if candidate_set.rounds == 1:
        return placed_of(candidates.valid)[0]
    # Splines have been certified already: an aircraft that has some gives up the others when one is rejected.
    uncertified = candidates.generator != SPLINE
    given_up = uncertified & jnp.any(candidates.valid & ~uncertified, axis=1, keepdims=True)
    return _best_placed(placed_of, candidates.valid, given_up, tasks.active > 0.0, candidate_set.rounds)


def _around(
    candidates: Candidates,
    standing: Standing,
    airspace: Airspace,
    start_time: ScalarLike,
    durations: Float[Array, " aircraft"],
    intervals: int,
) -> Candidates:
    """Candidates with those of aircraft whose paths stand replaced by these paths."""
    times = start_time + jnp.max(durations) / intervals * jnp.arange(intervals + 1)

    def tracked(path: TimedPath) -> Track:
        bounds = path_bounds(path, airspace.wind, airspace.gravity)
        return path_track(path, bounds.cell_acceleration, 1.0, times)

    tracks, count = jax.vmap(tracked)(standing.paths), candidates.valid.shape[1]
    tracks = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf[:, None], (leaf.shape[0], count, *leaf.shape[1:])), tracks)
    own = tracks, jnp.ones_like(candidates.valid), jnp.zeros_like(candidates.cost), jnp.zeros_like(candidates.cost)
    held = (candidates.tracks, candidates.valid, candidates.cost, candidates.penetration)
    return eqx.tree_at(
        lambda c: (c.tracks, c.valid, c.cost, c.penetration), candidates, rows_where(standing.which, own, held)
    )


def _best_placed(
    placed_of: Callable[[Bool[Array, "aircraft candidates"]], tuple[CertifiedPlan, Placement]],
    valid: Bool[Array, "aircraft candidates"],
    given_up: Bool[Array, "aircraft candidates"],
    active: Bool[Array, " aircraft"],
    rounds: int,
) -> CertifiedPlan:
    """The plan in which the fewest aircraft fail, placed again without the candidates that a certificate rejects.

    With the first of its candidates, an aircraft loses those that are given up. What a candidate is held to is looked
    at from instant to instant; its certificate bounds what lies between too, and may find a limit violated by little.
    """
    fleet = jnp.arange(valid.shape[0])

    def again(
        carry: tuple[Count, Array, Array, CertifiedPlan, Flag],
    ) -> tuple[Count, Array, Array, CertifiedPlan, Flag]:
        turn, left, fewest, best, _ = carry
        plan, placed = placed_of(left)
        failed = jnp.sum(active & ~plan.feasible)
        rejected = active & plan.valid & ~plan.certificate.kept_alone
        best = jax.tree.map(lambda a, b: jnp.where(failed < fewest, a, b), plan, best)
        left = left.at[fleet, placed.chosen].min(~rejected) & ~(given_up & rejected[:, None])
        return turn + 1, left, jnp.minimum(failed, fewest), best, (failed > 0) & jnp.any(rejected)

    placed_of = jax.jit(placed_of)  # traced once, though its shapes are asked for first
    empty, _ = zeros_as(placed_of, valid)
    begin = (jnp.asarray(0), valid, jnp.asarray(fleet.size + 1), empty, jnp.asarray(True))
    return jax.lax.while_loop(lambda c: (c[0] < rounds) & c[4], again, begin)[3]


plan_at = compiled_by_older_generator(static_argnames=("intervals", "candidate_set"))(plan_fleet_at)
"""`plan_fleet_at`, compiled."""


def intervals_for(duration_s: float) -> int:
    """Even intervals for a path of a duration: a power of two from 64 to 2048, at most 2 s long where that will do."""
    return next((intervals for intervals in (64, 128, 256, 512, 1024) if 2.0 * intervals >= duration_s), 2048)
