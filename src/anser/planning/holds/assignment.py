"""The choice of holds for a fleet: circles that keep all aircraft apart until the flight ends."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.control.guidance import GuidanceSettings
from anser.planning.certified.clearance import (
    BoundingCylinders,
    Track,
    clearance_from_keep_outs,
    fleet_clearance_ratio,
    fleet_cylinders,
    path_track,
)
from anser.planning.certified.path_bounds import excess, path_bounds
from anser.planning.certified.task import AircraftTask, Airspace
from anser.planning.demand import turn_radius
from anser.planning.holds.hold_paths import (
    HOLD_INTERVALS_PER_CYLINDER,
    SAMPLES_PER_CELL,
    HoldCircle,
    PlannedHolds,
    hold_path,
    is_holding,
    join_tracks,
)
from anser.planning.limits import CERTIFIED_LIMITS
from anser.planning.separation import Separation
from anser.planning.timed_path import TimedPath
from anser.shapes import Count, Flag, Scalar, ScalarLike
from anser.spatial.rotations import safe_norm

_RATIO_CAP = 1e3  # of clearance to separation: more does not count
_ROUNDS = 3  # in which each aircraft chooses again, given what the others have chosen
_RADII = (1.0, 1.5, 2.25)  # of the scenario's, besides the tightest
_TIGHTEST_FACTOR = 1.2  # times the radius of the tightest turn over the ground
_LEVELS = (0.0, 1.0, 2.0, 3.0)  # heights above the rendezvous, in units of the vertical separation
_LEVEL_SPACING = 1.1  # of the vertical separation between two levels
_OFF_GOAL_M = 150.0  # the least distance from a goal on the surface; or the stand-off, where that is less
_SAME_PLACE_M = 1e-3  # by which a hold that begins at the stand-off itself may be nearer, for rounding
_ROUNDING = 1e-7  # of the separation
_ALTITUDES = tuple(limit for limit in CERTIFIED_LIMITS if limit.variable == "altitude")
_OPTIONS = (len(_RADII) + 1) * 2 * len(_LEVELS)


def _circles(task: AircraftTask, airspace: Airspace, settings: GuidanceSettings) -> HoldCircle:
    """The circles that one aircraft may choose from, the scenario's own first; stacked."""
    stacked = airspace.separation.vertical
    step = jnp.where(stacked > 0.0, _LEVEL_SPACING * stacked, 0.0)
    base = -task.rendezvous.stand_off_n[2]
    blowing_n = airspace.wind.at(task.rendezvous_n, 0.0)
    command_from_chart = task.speed + safe_norm(blowing_n - task.goal_velocity_n)
    tightest = turn_radius(command_from_chart, task.limits.bank_max, airspace.gravity)
    radii = [radius * settings.hold_radius for radius in _RADII]
    radii.append(jnp.minimum(_TIGHTEST_FACTOR * tightest, settings.hold_radius))
    made = [
        HoldCircle(radius, turn * settings.hold_turn, base + level * step)
        for level in _LEVELS
        for radius in radii
        for turn in (1.0, -1.0)
    ]
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *made)


class _HoldOption(eqx.Module):
    """One aircraft with one of its holds, or with none yet; stacked, a fleet.

    Attributes
    ----------
    path, circle
        The hold.
    whole, after
        Where it is at which time: all the way, and what of that is after its arrival.
    cylinders, cylinders_after
        Of these, for large fleets.
    fits
        Whether it stays within altitudes, off its goal and out of keep-outs.
    keep_out_clearance
        How far it stays out of each keep-out at least, m.
    """

    path: TimedPath
    circle: HoldCircle
    whole: Track
    hold_track: Track
    cylinders: BoundingCylinders
    cylinders_after: BoundingCylinders
    fits: Flag
    keep_out_clearance: Float[Array, " volumes"]


def _clearance_ratios(
    who: Count, one: _HoldOption, fleet: _HoldOption, separation: Separation
) -> Float[Array, " aircraft"]:
    """Clearance ratio between one aircraft and each of a fleet, as soon as the first of both has arrived."""
    others = jnp.arange(fleet.fits.shape[0]) != who

    def least(
        own: Track, own_cylinders: BoundingCylinders, theirs: Track, cylinders: BoundingCylinders
    ) -> Float[Array, " aircraft"]:
        def some(those: Array) -> Track:
            return jax.tree.map(lambda leaf: leaf[those], theirs)

        return fleet_clearance_ratio(own, own_cylinders, cylinders, some, others, separation)

    return jnp.minimum(
        least(one.whole, one.cylinders, fleet.hold_track, fleet.cylinders_after),
        least(one.hold_track, one.cylinders_after, fleet.whole, fleet.cylinders),
    )


_Search = tuple[Count, Count, Scalar, _HoldOption, Flag]
"""The circle to try next, the best so far, its worth and its hold, and whether it is clear."""


class _Choice(eqx.Module):
    """How far the choice of holds has come; leading axis aircraft."""

    turn: Count
    options: _HoldOption
    pick: Array
    """Index of the circle of each."""
    clearance_ratio: Float[Array, "aircraft aircraft"]
    clear: Bool[Array, " aircraft"]


def assign_holds(
    paths: TimedPath,
    tasks: AircraftTask,
    airspace: Airspace,
    settings: GuidanceSettings,
    start_time: ScalarLike,
    end_time: ScalarLike,
    cells: int,
    former: PlannedHolds | None = None,
    stays: Bool[Array, " aircraft"] | None = None,
) -> PlannedHolds:
    """Choose a hold for each aircraft that keeps the separation from all others until the flight ends.

    One after the other, the first to arrive first; each takes the first of its circles with which it stays clear of
    all paths and of the holds chosen so far, or else the one that leaves most. Then those in conflict choose again,
    given all the others.

    Parameters
    ----------
    paths
        To the arrivals; stacked.
    tasks
        As planned: goals as foreseen at `start_time`.
    airspace, settings
        Of the fleet.
    start_time
        Of the foresight, s; distances count from here on.
    until
        End of the flight, s.
    cells
        Of each hold's path, see `choose_cell_count`.
    former, stays
        Holds that stand, and whose do; None: those who have arrived at `start_time` fly theirs already.
    """
    arrival_times = paths.times[:, -1]
    fleet = arrival_times.shape[0]
    gravity, separation, volumes = airspace.gravity, airspace.separation, airspace.keep_outs
    end = jnp.maximum(end_time, jnp.max(arrival_times) + 1.0)
    times = start_time + (end - start_time) * jnp.linspace(0.0, 1.0, SAMPLES_PER_CELL * cells + 1)
    circles = jax.vmap(_circles, in_axes=(0, None, None))(tasks, airspace, settings)
    stays = arrival_times <= start_time if stays is None else stays

    def approach(path: TimedPath, active: Scalar) -> Track:
        return path_track(path, path_bounds(path, airspace.wind, gravity).cell_acceleration, active, times)

    approaches = jax.vmap(approach)(paths, tasks.active)

    @jax.jit  # traced once
    def option(who: Count, k: Count) -> _HoldOption:
        own, path, first = jax.tree.map(lambda leaf: leaf[who], (tasks, paths, approaches))
        circle, arrival = jax.tree.map(lambda leaf: leaf[who, k], circles), arrival_times[who]
        begin = path.position_n(arrival), path.velocity_n(arrival), arrival
        ahead_n = own.goal_position_n + (arrival - start_time) * own.goal_velocity_n
        goal = ahead_n, own.goal_velocity_n
        held = hold_path(own, begin, goal, circle, airspace.wind, end, settings, gravity, cells)
        if former is not None:
            old = jax.tree.map(lambda leaf: leaf[who], (former.paths, former.circles))
            held, circle = jax.tree.map(lambda a, b: jnp.where(stays[who], a, b), old, (held, circle))
        bounds = path_bounds(held, airspace.wind, gravity)
        second = path_track(held, bounds.cell_acceleration, own.active, times)
        whole = join_tracks(first, second, times, arrival)
        after = eqx.tree_at(lambda t: t.included, whole, jnp.where(is_holding(times, arrival), own.active, 0.0))
        keep_out_clearance = clearance_from_keep_outs(after, times, volumes)
        goal_n = own.goal_position_n[None, :] + (times - start_time)[:, None] * own.goal_velocity_n[None, :]
        least = jnp.minimum(safe_norm(own.rendezvous.stand_off_n) - _SAME_PLACE_M, _OFF_GOAL_M)
        off_goal = jnp.all((jax.vmap(safe_norm)(whole.positions_n - goal_n) >= least) | (times <= arrival))
        level = jnp.all(excess(bounds, own.limits, _ALTITUDES) <= _ROUNDING)
        fits = level & off_goal & jnp.all(keep_out_clearance >= 0.0)
        cylinders, cylinders_after = (
            fleet_cylinders(track, fleet, HOLD_INTERVALS_PER_CYLINDER) for track in (whole, after)
        )
        return _HoldOption(held, circle, whole, after, cylinders, cylinders_after, fits, keep_out_clearance)

    def choose(carry: tuple[_HoldOption, Array, Array], who: Count) -> tuple[tuple[_HoldOption, Array, Array], None]:
        held, pick, settled = carry

        def one_more(state: _Search) -> _Search:
            k, best, most, own, _ = state
            made = option(who, k)
            least = jnp.min(_clearance_ratios(who, made, held, separation))
            # One that does not fit is worse than any that does.
            value = jnp.where(made.fits, jnp.minimum(least, _RATIO_CAP), jnp.minimum(least, 1.0) - _RATIO_CAP)
            better = value > most
            own = jax.tree.map(lambda new, old: jnp.where(better, new, old), made, own)
            return k + 1, jnp.where(better, k, best), jnp.maximum(value, most), own, made.fits & (least >= 1.0)

        so_far = jax.tree.map(lambda every: every[who], held)
        start = (jnp.asarray(0), pick[who], jnp.asarray(-jnp.inf), so_far, settled[who])
        _, best, _, own, _ = jax.lax.while_loop(lambda s: (s[0] < _OPTIONS) & ~s[4], one_more, start)
        held = jax.tree.map(lambda every, one: every.at[who].set(one), held, own)
        return (held, pick.at[who].set(best), settled), None

    def all_choose(now: _Choice) -> _Choice:
        order = jnp.argsort(arrival_times)
        (held, pick, _), _ = jax.lax.scan(choose, (now.options, now.pick, now.clear), order)

        def ratios_of(who: Count) -> Float[Array, " aircraft"]:
            return _clearance_ratios(who, jax.tree.map(lambda leaf: leaf[who], held), held, separation)

        ratios = jax.lax.map(ratios_of, jnp.arange(fleet))
        clear = held.fits & jnp.all(ratios >= 1.0 - _ROUNDING, axis=1)
        return _Choice(now.turn + 1, held, pick, ratios, clear | (tasks.active == 0.0))

    shape = jax.eval_shape(option, jnp.asarray(0), jnp.asarray(0))
    empty = jax.tree.map(lambda leaf: jnp.zeros((fleet, *leaf.shape), leaf.dtype), shape)
    # On their way all count; nobody holds yet.
    on_way = approaches, fleet_cylinders(approaches, fleet, HOLD_INTERVALS_PER_CYLINDER)
    empty = eqx.tree_at(lambda h: (h.whole, h.cylinders), empty, on_way)
    unsettled = jnp.zeros(fleet, dtype=bool)
    begin = _Choice(jnp.asarray(0), empty, jnp.zeros(fleet, dtype=int), jnp.zeros((fleet, fleet)), unsettled)
    made = jax.lax.while_loop(lambda now: (now.turn < _ROUNDS) & ~jnp.all(now.clear), all_choose, begin)
    return PlannedHolds(
        paths=made.options.path,
        circles=made.options.circle,
        goal_positions_n=tasks.goal_position_n,
        goal_velocities_n=tasks.goal_velocity_n,
        forecast_time=jnp.asarray(start_time, dtype=float),
        clearance_ratio=made.clearance_ratio,
        keep_out_clearance=made.options.keep_out_clearance,
        clear=made.clear,
    )
