"""Assignment of holds to a fleet: circles that keep the aircraft separated until the end of the flight."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.constants import SURFACE_STAND_OFF_MIN_M
from anser.control.guidance import GuidanceSettings
from anser.planning.certified.clearance import (
    BoundingCylinders,
    Track,
    bounded_track,
    clearance_from_keep_outs,
    fleet_clearance_ratio,
    fleet_cylinders,
    path_track,
)
from anser.planning.certified.fitted_wind import BEYOND_FIELD_M_S
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
from anser.shapes import Flag, Integer, Scalar, ScalarLike
from anser.spatial.rotations import safe_norm

_RATIO_CAP = 1e3  # of clearance to separation: larger ratios are equal
_ROUNDS = 3  # greatest number of rounds, in which each aircraft chooses among its circles once
_RADII = (1.0, 1.5, 2.25)  # multiples of the scenario's radius, besides the tightest
_TIGHTEST_FACTOR = 1.2  # times the radius of the tightest turn over the ground
_LEVELS = (0.0, 1.0, 2.0, 3.0)  # heights above the rendezvous, in units of the vertical separation
_LEVEL_SPACING = 1.1  # distance of two levels, in units of the vertical separation
_ROUNDING_M = 1e-3  # rounding tolerance of holds that begin at the stand-off
_ROUNDING = 1e-7  # relative to the separation
_ALTITUDES = tuple(limit for limit in CERTIFIED_LIMITS if limit.variable == "altitude")
_CIRCLE_COUNT = (len(_RADII) + 1) * 2 * len(_LEVELS)


def _candidate_circles(task: AircraftTask, airspace: Airspace, settings: GuidanceSettings) -> HoldCircle:
    """Return the circles to try for one aircraft's hold, in order, the scenario's circle first; stacked."""
    vertical_separation = airspace.separation.vertical
    step = jnp.where(vertical_separation > 0.0, _LEVEL_SPACING * vertical_separation, 0.0)
    base = -task.rendezvous.stand_off_n[2]
    wind_n = airspace.wind.at(task.rendezvous_n, 0.0)
    ground_speed_max = task.speed + safe_norm(wind_n - task.goal_velocity_n)
    tightest = turn_radius(ground_speed_max, task.limits.bank_max, airspace.gravity)
    radii = [radius * settings.hold_radius for radius in _RADII]
    radii.append(jnp.minimum(_TIGHTEST_FACTOR * tightest, settings.hold_radius))
    circles = [
        HoldCircle(radius, turn * settings.hold_turn, base + level * step)
        for level in _LEVELS
        for radius in radii
        for turn in (1.0, -1.0)
    ]
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *circles)


class _HoldOption(eqx.Module):
    """Candidate hold of one aircraft, with the approach before the hold; with a leading axis, of each aircraft."""

    path: TimedPath  # path of the hold
    circle: HoldCircle  # circle of the hold
    whole: Track  # track of approach and hold
    hold_track: Track  # part of `whole` after the arrival
    cylinders: BoundingCylinders  # enclose `whole`
    cylinders_after: BoundingCylinders  # enclose `hold_track`
    fits: Flag  # whether the hold keeps altitude limits, keep-outs and distance from the goal
    keep_out_clearance: Float[Array, " volumes"]  # least distance outside each keep-out, m


def _clearance_ratios(
    index: Integer, aircraft: _HoldOption, fleet: _HoldOption, separation: Separation
) -> Float[Array, " aircraft"]:
    """Return lower bounds of distance over separation between one aircraft and each aircraft of the fleet.

    The bounds hold after the first arrival of the two, for approaches and holds; the bound for the aircraft itself
    (`index`) is infinite.
    """
    is_other = jnp.arange(fleet.fits.shape[0]) != index

    def least_ratio(
        track: Track, track_cylinders: BoundingCylinders, fleet_tracks: Track, other_cylinders: BoundingCylinders
    ) -> Float[Array, " aircraft"]:
        def select_tracks(indices: Array) -> Track:
            return jax.tree.map(lambda leaf: leaf[indices], fleet_tracks)

        return fleet_clearance_ratio(track, track_cylinders, other_cylinders, select_tracks, is_other, separation)

    return jnp.minimum(
        least_ratio(aircraft.whole, aircraft.cylinders, fleet.hold_track, fleet.cylinders_after),
        least_ratio(aircraft.hold_track, aircraft.cylinders_after, fleet.whole, fleet.cylinders),
    )


_Search = tuple[Integer, Integer, Scalar, _HoldOption, Flag]
"""State of the search over circles: next circle, best circle, its value, its hold, and whether the hold is clear."""


class _Choice(eqx.Module):
    """State of the assignment of holds after some rounds of choices; leading axis aircraft."""

    turn: Integer  # number of rounds so far
    options: _HoldOption  # chosen holds
    pick: Array  # indices of the circles of the chosen holds
    # as in `PlannedHolds`
    clearance_ratio: Float[Array, "aircraft aircraft"]
    clear: Bool[Array, " aircraft"]


def assign_holds(
    paths: TimedPath,  # paths to the arrivals; stacked
    tasks: AircraftTask,  # planning tasks, with the goals predicted at `start_time`
    airspace: Airspace,
    settings: GuidanceSettings,
    start_time: ScalarLike,  # time of the prediction, s; distances count from here on
    end_time: ScalarLike,  # end of the flight, s
    cells: int,  # number of cells of a hold's path, see `choose_cell_count`
    # previous holds, and the mask of the holds that stay; mask None: holds of aircraft arrived at `start_time` stay
    former: PlannedHolds | None = None,
    stays: Bool[Array, " aircraft"] | None = None,
    *,
    one_kernel: bool = False,  # see `hold_path`
) -> PlannedHolds:
    """Choose a hold for each aircraft that keeps the separation from the fleet until the end of the flight.

    The aircraft choose one after another, in the order of arrival. Each takes its first circle whose hold keeps the
    altitude limits, the keep-outs, the distance from the goal, and the separation from all paths and chosen holds. If
    no circle does, the circle with the largest clearance ratio is taken, preferably among holds that lack only the
    separation. Aircraft in conflict choose again; there are at most three rounds in all. The field `clear` of the
    result tells for which aircraft a hold without conflict was found.
    """
    arrival_times = paths.times[:, -1]
    fleet = arrival_times.shape[0]
    gravity, separation, volumes = airspace.gravity, airspace.separation, airspace.keep_outs
    end = jnp.maximum(end_time, jnp.max(arrival_times) + 1.0)
    times = start_time + (end - start_time) * jnp.linspace(0.0, 1.0, SAMPLES_PER_CELL * cells + 1)
    circles = jax.lax.map(lambda task: _candidate_circles(task, airspace, settings), tasks)
    stays = arrival_times <= start_time if stays is None else stays

    approaches = jax.lax.map(lambda row: bounded_track(row[0], airspace, row[1], times), (paths, tasks.active))

    @jax.jit  # one trace
    def evaluate_circle(index: Integer, circle_index: Integer) -> _HoldOption:
        task, path, approach_track = jax.tree.map(lambda leaf: leaf[index], (tasks, paths, approaches))
        circle, arrival = jax.tree.map(lambda leaf: leaf[index, circle_index], circles), arrival_times[index]
        begin = path.position_n(arrival), path.velocity_n(arrival), arrival
        goal_position_n = task.goal_position_n + (arrival - start_time) * task.goal_velocity_n
        goal = goal_position_n, task.goal_velocity_n
        held_path = hold_path(
            task, begin, goal, circle, airspace.wind, end, settings, gravity, cells, one_kernel=one_kernel
        )
        if former is not None:
            previous = jax.tree.map(lambda leaf: leaf[index], (former.paths, former.circles))
            held_path, circle = jax.tree.map(lambda a, b: jnp.where(stays[index], a, b), previous, (held_path, circle))
        bounds = path_bounds(held_path, airspace.wind, gravity)
        hold_track = path_track(held_path, bounds.cell_acceleration, task.active, times)
        whole = join_tracks(approach_track, hold_track, times, arrival)
        hold_only = eqx.tree_at(lambda t: t.included, whole, jnp.where(is_holding(times, arrival), task.active, 0.0))
        keep_out_clearance = clearance_from_keep_outs(hold_only, times, volumes)
        goal_n = task.goal_position_n[None, :] + (times - start_time)[:, None] * task.goal_velocity_n[None, :]
        goal_distance_min = jnp.minimum(safe_norm(task.rendezvous.stand_off_n) - _ROUNDING_M, SURFACE_STAND_OFF_MIN_M)
        keeps_goal_distance = jnp.all(
            (jax.vmap(safe_norm)(whole.positions_n - goal_n) >= goal_distance_min) | (times <= arrival)
        )
        keeps_altitudes = jnp.all(excess(bounds, task.limits, _ALTITUDES) <= _ROUNDING)
        in_field = bounds.wind_error_max < BEYOND_FIELD_M_S
        fits = keeps_altitudes & keeps_goal_distance & in_field & jnp.all(keep_out_clearance >= 0.0)
        fits = fits | (arrival >= end_time)  # no hold follows an exit path, which lasts to the end of the flight
        cylinders, cylinders_after = (
            fleet_cylinders(track, fleet, HOLD_INTERVALS_PER_CYLINDER) for track in (whole, hold_only)
        )
        return _HoldOption(held_path, circle, whole, hold_only, cylinders, cylinders_after, fits, keep_out_clearance)

    def choose_circle(
        carry: tuple[_HoldOption, Array, Array], index: Integer
    ) -> tuple[tuple[_HoldOption, Array, Array], None]:
        holds, pick, settled = carry

        def try_circle(state: _Search) -> _Search:
            k, best, best_value, best_hold, _ = state
            candidate = evaluate_circle(index, k)
            ratio = jnp.min(_clearance_ratios(index, candidate, holds, separation))
            # Any fitting hold is better than one that does not fit.
            value = jnp.where(candidate.fits, jnp.minimum(ratio, _RATIO_CAP), jnp.minimum(ratio, 1.0) - _RATIO_CAP)
            is_better = value > best_value
            best_hold = jax.tree.map(lambda new, old: jnp.where(is_better, new, old), candidate, best_hold)
            return (
                k + 1,
                jnp.where(is_better, k, best),
                jnp.maximum(value, best_value),
                best_hold,
                candidate.fits & (ratio >= 1.0),
            )

        present_hold = jax.tree.map(lambda leaves: leaves[index], holds)
        start = (jnp.asarray(0), pick[index], jnp.asarray(-jnp.inf), present_hold, settled[index])
        _, best, _, chosen_hold, _ = jax.lax.while_loop(lambda s: (s[0] < _CIRCLE_COUNT) & ~s[4], try_circle, start)
        holds = jax.tree.map(lambda leaves, chosen_leaf: leaves.at[index].set(chosen_leaf), holds, chosen_hold)
        return (holds, pick.at[index].set(best), settled), None

    def choose_round(state: _Choice) -> _Choice:
        order = jnp.argsort(arrival_times)
        (holds, pick, _), _ = jax.lax.scan(choose_circle, (state.options, state.pick, state.clear), order)

        def ratios_of(index: Integer) -> Float[Array, " aircraft"]:
            return _clearance_ratios(index, jax.tree.map(lambda leaf: leaf[index], holds), holds, separation)

        ratios = jax.lax.map(ratios_of, jnp.arange(fleet))
        clear = holds.fits & jnp.all(ratios >= 1.0 - _ROUNDING, axis=1)
        return _Choice(state.turn + 1, holds, pick, ratios, clear | (tasks.active == 0.0))

    shape = jax.eval_shape(evaluate_circle, jnp.asarray(0), jnp.asarray(0))
    empty = jax.tree.map(lambda leaf: jnp.zeros((fleet, *leaf.shape), leaf.dtype), shape)
    # Initially every approach counts, and no hold.
    approach_tracks = approaches, fleet_cylinders(approaches, fleet, HOLD_INTERVALS_PER_CYLINDER)
    empty = eqx.tree_at(lambda h: (h.whole, h.cylinders), empty, approach_tracks)
    unsettled = jnp.zeros(fleet, dtype=bool)
    begin = _Choice(jnp.asarray(0), empty, jnp.zeros(fleet, dtype=int), jnp.zeros((fleet, fleet)), unsettled)
    assignment = jax.lax.while_loop(lambda s: (s.turn < _ROUNDS) & ~jnp.all(s.clear), choose_round, begin)
    return PlannedHolds(
        paths=assignment.options.path,
        circles=assignment.options.circle,
        goal_positions_n=tasks.goal_position_n,
        goal_velocities_n=tasks.goal_velocity_n,
        forecast_time=jnp.asarray(start_time, dtype=float),
        clearance_ratio=assignment.clearance_ratio,
        keep_out_clearance=assignment.options.keep_out_clearance,
        clear=assignment.clear,
    )
