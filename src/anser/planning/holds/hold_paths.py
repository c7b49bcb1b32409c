"""Planned holds as paths over time, and approaches and holds combined.

The hold of an aircraft is a path from the arrival into a circle around its goal, predicted at constant velocity.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.compiling.single_kernel import as_single_kernel
from anser.control.feedback import wrap_angle
from anser.control.guidance import GuidanceSettings, hold
from anser.environment.environment import AbstractWind
from anser.numerics.integration import rk4_step
from anser.parts.paths import AbstractReference, PathPoint
from anser.planning.certified import clearance
from anser.planning.certified.clearance import Track, bounded_track, fleet_clearance_ratios
from anser.planning.certified.replanning import exceeds_uncertainty
from anser.planning.certified.task import AircraftTask, Airspace
from anser.planning.separation import Separation, separation_ratio
from anser.planning.timed_path import TimedPath
from anser.shapes import Flag, Integer, Scalar, ScalarLike, Vector3
from anser.spatial.rotations import safe_hypot, safe_norm

_SUBSTEPS = 4  # of the integration in each cell
_ROLL_LAG_S = 1.5
_COURSE_GAIN = 0.5  # 1/s
_SPEED_GAIN, _SPEED_RATE = 0.2, 0.8  # 1/s, m/s^2
_HEIGHT_GAIN, _CLIMB_LAG_S, _CLIMB_RATE = 0.2, 2.0, 4.0  # 1/s, s, m/s^2
_LEVEL_OFF_S = 8.0  # duration of the level-off of a steep arrival, if necessary with more than `_CLIMB_RATE`
_PULL_SHARE = 0.75  # share of the load factor beyond 1 for the level-off
_BANK_FRACTION = 0.95  # of the greatest bank angle
GOAL_VELOCITY_TOLERANCE = 0.1
"""Greatest deviation of a goal's velocity from the prediction, relative to the airspeed, for flying a planned hold."""
CELL_S = 2.0
"""Greatest duration of a cell (interval between knots) of a hold's path, s, in flights of up to 8192 s."""


class HoldCircle(eqx.Module):
    """Circle around the goal that a hold joins."""

    radius: Scalar  # m
    turn: Scalar  # +1 clockwise seen from above, -1 anticlockwise
    height: Scalar  # height above the goal, m


class PlannedHolds(eqx.Module):
    """Planned holds of a fleet, from the arrivals to the end of the flight; leading axis aircraft."""

    paths: TimedPath  # paths from the arrivals to the end of the flight
    circles: HoldCircle  # circles at the end of the paths
    # positions and velocities of the goals, NED, m and m/s, at `forecast_time` (s)
    goal_positions_n: Float[Array, "aircraft 3"]
    goal_velocities_n: Float[Array, "aircraft 3"]
    forecast_time: Scalar
    # least ratio of distance to separation of each pair after the first arrival of the pair
    clearance_ratio: Float[Array, "aircraft aircraft"]
    keep_out_clearance: Float[Array, "aircraft volumes"]  # least distance outside each keep-out, m
    clear: Bool[Array, " aircraft"]  # whether the hold keeps separation, keep-outs, altitudes, goal distance


def choose_cell_count(duration_s: float) -> int:
    """Return the number of cells of a hold's path: the least power of two, from 128 to 4096, with cells up to `CELL_S`.

    For durations over 8192 s, the cells are longer.
    """
    return next((cells for cells in (128, 256, 512, 1024, 2048) if CELL_S * cells >= duration_s), 4096)


def _forecast_errors(
    holds: PlannedHolds, tasks: AircraftTask, time: Scalar | Float[Array, " aircraft"]
) -> tuple[Float[Array, "aircraft 3"], Float[Array, "aircraft 3"]]:
    """Return the errors of the holds' forecast of the goals at `time` (s): positions (m) and velocities (m/s), NED.

    Errors are the values measured at `time` (in `tasks`) minus the forecast.
    """
    elapsed = jnp.broadcast_to(time - holds.forecast_time, holds.clear.shape)
    offsets_n = tasks.goal_position_n - holds.goal_positions_n - elapsed[:, None] * holds.goal_velocities_n
    return offsets_n, tasks.goal_velocity_n - holds.goal_velocities_n


def move_with_goals(
    holds: PlannedHolds, tasks: AircraftTask, time: ScalarLike | Float[Array, " aircraft"]
) -> PlannedHolds:
    """Return the holds moved with the goals, whose positions and velocities measured at `time` (s) are in `tasks`.

    Each path is shifted at its time t by (offset of the goal from the former forecast) + (change of the goal's
    velocity) * (t - `time`). The path through the air is shifted; the drift stays. `time` may be one time per aircraft;
    `forecast_time` of the result then has this shape, too.
    """
    time = jnp.asarray(time, dtype=float)
    offsets_n, changes_n = _forecast_errors(holds, tasks, time)

    def moved_path(path: TimedPath, goal_offset_n: Vector3, change_n: Vector3, start_time: Scalar) -> TimedPath:
        offset_n = goal_offset_n[None, :] + (path.times - start_time)[:, None] * change_n[None, :]
        return eqx.tree_at(lambda p: p.air_n, path, path.air_n.at[:, 0].add(offset_n).at[:, 1].add(change_n))

    return dataclasses.replace(
        holds,
        paths=jax.vmap(moved_path)(holds.paths, offsets_n, changes_n, jnp.broadcast_to(time, holds.clear.shape)),
        goal_positions_n=tasks.goal_position_n,
        goal_velocities_n=tasks.goal_velocity_n,
        forecast_time=time,
    )


_LOSS_MIN = 0.05  # least change of the ratio of distance to separation that counts as a shift of the goals


def goals_have_shifted(
    holds: PlannedHolds,
    tasks: AircraftTask,  # tasks with the currently measured goals
    arrival_times: Float[Array, " aircraft"],  # planned times of arrival, s
    time: ScalarLike,  # current time, s
    separation: Separation,
    # covariances of the goals' positions and velocities, NED, m and m/s; None: the goals are known exactly
    covariances: Float[Array, "aircraft 6 6"] | None,
) -> Bool[Array, "aircraft aircraft"]:
    """Return the mask of the pairs whose goals have shifted so far that the pair's holds may lack separation.

    The shift is the deviation of the goals' relative position from the forecast, as expected at the pair's first
    arrival. A pair is marked if shift / separation > max(clearance_ratio - 1, 0) + 0.05 with the ratio in `holds`. If
    `covariances` are given, the shift must be significant, too (`exceeds_uncertainty`). A pair with an inactive or
    arrived aircraft is never marked.
    """
    to_go = jnp.minimum(arrival_times[:, None], arrival_times[None, :]) - time
    offsets_n, changes_n = _forecast_errors(holds, tasks, jnp.asarray(time))
    relative_n, rates_n = (values[:, None] - values[None, :] for values in (offsets_n, changes_n))
    shifts_n = relative_n + to_go[:, :, None] * rates_n
    level, height = safe_hypot(shifts_n[..., 0], shifts_n[..., 1]), jnp.abs(shifts_n[..., 2])
    loss = separation_ratio(level, height, separation.horizontal, separation.vertical)
    flying = tasks.active > 0.0
    may_lack = loss > jnp.maximum(holds.clearance_ratio - 1.0, 0.0) + _LOSS_MIN
    may_lack = may_lack & flying[:, None] & flying[None, :] & (to_go > 0.0)
    if covariances is None:
        return may_lack
    is_significant = jax.vmap(jax.vmap(exceeds_uncertainty))(
        shifts_n, covariances[:, None] + covariances[None, :], jnp.maximum(to_go, 0.0)
    )
    return may_lack & is_significant


class HoldReference(AbstractReference):
    """Reference motion of one aircraft in its hold: the planned path, moved with the sensed goal."""

    path: TimedPath  # planned path of the hold
    # offset of the goal from its forecast at the time `now` (s), and rate of the offset; NED, m and m/s
    goal_offset_n: Vector3
    goal_offset_rate_n: Vector3
    now: Scalar

    def at(self, time: ScalarLike) -> PathPoint:
        """Return position, velocity and acceleration over the ground at a time (s); NED, m, m/s, m/s^2."""
        planned = self.path.at(time)
        return PathPoint(
            planned.position_n + self.goal_offset_n + (time - self.now) * self.goal_offset_rate_n,
            planned.velocity_n + self.goal_offset_rate_n,
            planned.acceleration_n,
        )


def broadcast_holds(holds: PlannedHolds) -> PlannedHolds:
    """Return the holds with a leading aircraft axis on every field, `forecast_time` too, for `vmap`."""
    count = holds.clear.shape[0]
    return eqx.tree_at(lambda h: h.forecast_time, holds, jnp.broadcast_to(holds.forecast_time, (count,)))


def hold_reference(
    holds: PlannedHolds,
    time: ScalarLike,
    goal_position_n: Vector3,
    goal_velocity_n: Vector3,
    speed: ScalarLike,
    reach: ScalarLike | None = None,
) -> tuple[HoldReference, Flag]:
    """Return one aircraft's reference motion in its planned hold, and whether the reference may be flown at `time` (s).

    `holds` must be the holds of this aircraft alone, without the leading axis; position (m) and velocity (m/s) of the
    goal are estimates, NED. The reference may not be flown after its end, or if the goal's velocity deviates from the
    forecast by more than `GOAL_VELOCITY_TOLERANCE` times the airspeed `speed` (m/s). Exception: if `reach` (m) is
    given, the goal may have any velocity, and the reference moves with the goal by at most this distance.
    """
    offset_rate_n = goal_velocity_n - holds.goal_velocities_n
    offset_n = goal_position_n - holds.goal_positions_n - (time - holds.forecast_time) * holds.goal_velocities_n
    as_predicted = jnp.sum(offset_rate_n**2) <= (GOAL_VELOCITY_TOLERANCE * speed) ** 2
    if reach is not None:
        share = jnp.minimum(1.0, reach / jnp.maximum(safe_norm(offset_n), reach))
        offset_n, offset_rate_n = share * offset_n, jnp.where(share < 1.0, 0.0, 1.0) * offset_rate_n
        as_predicted = jnp.asarray(True)
    is_valid = as_predicted & (time <= holds.paths.times[-1])
    return HoldReference(holds.paths, offset_n, offset_rate_n, jnp.asarray(time, offset_n.dtype)), is_valid


class _PointMass(eqx.Module):
    """State of a point mass in a hold, or the rates of this state."""

    position_n: Vector3  # NED, m
    drift_n: Vector3  # displacement by the wind since the start of the hold, NED, m
    course: Scalar  # rad
    speed: Scalar  # airspeed, m/s
    climb: Scalar  # climb rate relative to the air, m/s
    turning: Scalar  # horizontal acceleration to the right, m/s^2


def _air_velocity_n(state: _PointMass) -> Vector3:
    level = jnp.sqrt(jnp.maximum(state.speed**2 - state.climb**2, 1.0))
    return jnp.stack([level * jnp.cos(state.course), level * jnp.sin(state.course), -state.climb])


def hold_path(
    task: AircraftTask,  # planning task, for speed and limits
    # position (m), velocity over the ground (m/s) and time (s) at the start of the hold
    arrival: tuple[Vector3, Vector3, ScalarLike],
    goal: tuple[Vector3, Vector3],  # position and velocity of the goal at the arrival, m and m/s over the ground
    circle: HoldCircle,  # circle of the hold
    wind: AbstractWind,
    end_time: ScalarLike,  # end of the path, s
    settings: GuidanceSettings,  # guidance settings; radius and turn direction are taken from the circle
    gravity: ScalarLike,
    cells: int,  # number of cells of the path
    *,
    one_kernel: bool = False,  # whether a cell may become one CPU kernel; the call must then not be batched
) -> TimedPath:
    """Compute the path of one hold: a point mass with finite roll, climb and speed rates follows the guidance.

    The wind depends on the position, but stays as at the time of the arrival. The path lasts at least one second, even
    if `end_time` is earlier.
    """
    position_n, velocity_n, begin = arrival
    goal_n, goal_velocity_n = goal
    settings = eqx.tree_at(lambda s: (s.hold_radius, s.hold_turn), settings, (circle.radius, circle.turn))
    span = jnp.maximum(end_time - begin, 1.0) / cells
    bank_rate_max = task.limits.bank_rate_max
    acceleration_max = gravity * jnp.tan(_BANK_FRACTION * task.limits.bank_max)
    air_n = velocity_n - wind.at(position_n, begin)
    level_off_rate = jnp.minimum(
        jnp.abs(air_n[2]) / _LEVEL_OFF_S, _PULL_SHARE * (task.limits.load_factor_max - 1.0) * gravity
    )
    climb_rate = jnp.maximum(_CLIMB_RATE, level_off_rate)
    start = _PointMass(
        position_n=position_n,
        drift_n=jnp.zeros(3),
        course=jnp.arctan2(air_n[1], air_n[0]),
        speed=jnp.sqrt(jnp.sum(air_n**2)),
        climb=-air_n[2],
        turning=jnp.zeros(()),
    )

    def rates(elapsed: ScalarLike, state: _PointMass) -> _PointMass:
        wind_n = wind.at(state.position_n, begin)
        ground_n = _air_velocity_n(state) + wind_n
        relative_n = state.position_n - goal_n - elapsed * goal_velocity_n
        command = hold(
            relative_n,
            ground_n,
            goal_velocity_n,
            wind_n,
            velocity_n - goal_velocity_n,
            circle.height,
            task.speed,
            settings,
        )
        turn_rate = command.chi_dot + _COURSE_GAIN * wrap_angle(command.chi - state.course)
        lateral_command = jnp.clip(state.speed * turn_rate, -acceleration_max, acceleration_max)
        climb_command = _HEIGHT_GAIN * (circle.height + relative_n[2])
        climb_command = jnp.clip(climb_command, -settings.climb_rate_max, settings.climb_rate_max)
        climb_demand = climb_command - goal_velocity_n[2] + wind_n[2]
        level = safe_hypot(*_air_velocity_n(state)[:2])
        lateral_rate = (lateral_command - state.turning) / _ROLL_LAG_S
        if bank_rate_max is not None:
            # the bound at wings level, which is conservative for banked flight
            lateral_rate = jnp.clip(lateral_rate, -gravity * bank_rate_max, gravity * bank_rate_max)
        return _PointMass(
            position_n=ground_n,
            drift_n=wind_n,
            course=state.turning / jnp.maximum(level, 1.0),
            speed=jnp.clip(_SPEED_GAIN * (task.speed - state.speed), -_SPEED_RATE, _SPEED_RATE),
            climb=jnp.clip((climb_demand - state.climb) / _CLIMB_LAG_S, -climb_rate, climb_rate),
            turning=lateral_rate,
        )

    def cell(state: _PointMass, k: Integer) -> tuple[_PointMass, tuple[Array, Array]]:
        step = span / _SUBSTEPS

        def substep(j: Integer, substep_state: _PointMass) -> _PointMass:
            return rk4_step(rates, k * span + j * step, substep_state, step)

        # Velocity rate by the chain rule, so that the knots have the true acceleration of the motion.
        motion = rates(k * span, state)
        air_n, air_dot_n = jax.jvp(_air_velocity_n, (state,), (motion,))
        wind_n, wind_dot_n = jax.jvp(lambda p: wind.at(p, begin), (state.position_n,), (motion.position_n,))
        knot = jnp.stack([state.position_n - state.drift_n, air_n, air_dot_n])
        drift = jnp.stack([state.drift_n, wind_n, wind_dot_n])
        return jax.lax.fori_loop(0, _SUBSTEPS, substep, state), (knot, drift)

    compute_cell = as_single_kernel(cell) if one_kernel else cell
    _, (knots, drifts) = jax.lax.scan(compute_cell, start, jnp.arange(cells + 1))
    return TimedPath(begin + span * jnp.arange(cells + 1), knots, drifts)


SAMPLES_PER_CELL = 8
"""Number of distance samples per cell of a hold's path; the distance bounds also hold between the samples."""
HOLD_INTERVALS_PER_CYLINDER = 4 * clearance.INTERVALS_PER_CYLINDER


class ApproachAndHold(eqx.Module):
    """Paths of the approaches to the rendezvous and of the holds after the arrivals; leading axis aircraft."""

    path: TimedPath  # paths to the arrivals
    hold: PlannedHolds  # holds after the arrivals, see `broadcast_holds`


def is_holding(times: Float[Array, " instants"], arrival: ScalarLike) -> Bool[Array, " intervals"]:
    """Return the mask of the intervals between instants (s) in which an aircraft is in its hold, at least partly."""
    return times[1:] > arrival


def join_tracks(
    approach_track: Track, hold_track: Track, times: Float[Array, " instants"], arrival: ScalarLike
) -> Track:
    """Join the tracks of an approach and its hold at `times` (s), with the greater error bound where both are flown."""
    holding, underway = is_holding(times, arrival), times[:-1] < arrival
    error_bound = jnp.maximum(
        jnp.where(holding, hold_track.error_bound, 0.0), jnp.where(underway, approach_track.error_bound, 0.0)
    )
    positions_n = jnp.where((times > arrival)[:, None], hold_track.positions_n, approach_track.positions_n)
    return Track(positions_n, error_bound, jnp.maximum(approach_track.included, hold_track.included))


def pairwise_clearance_ratios(
    approaches: ApproachAndHold, active: Float[Array, " paths"], airspace: Airspace, from_time: ScalarLike
) -> Float[Array, "paths paths"]:
    """Return a lower bound of the ratio of distance to separation of each pair of paths, holds included.

    The bounds hold from `from_time` (s) to the end of the holds, and are infinite on the diagonal. The time before the
    start of a path is ignored, and so are paths with `active` 0.
    """
    cells = approaches.hold.paths.times.shape[1] - 1
    end_time = jnp.max(approaches.hold.paths.times)
    times = from_time + (end_time - from_time) * jnp.linspace(0.0, 1.0, SAMPLES_PER_CELL * cells + 1)

    def joined_track(path: TimedPath, hold: TimedPath, included: Scalar) -> Track:
        approach_track, hold_track = (bounded_track(flown, airspace, included, times) for flown in (path, hold))
        return join_tracks(approach_track, hold_track, times, path.times[-1])

    tracks = jax.vmap(joined_track)(approaches.path, approaches.hold.paths, active)
    return fleet_clearance_ratios(tracks, airspace.separation, HOLD_INTERVALS_PER_CYLINDER)
