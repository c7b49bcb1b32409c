"""Planned holds as paths with certificates, and the whole of an approach with its hold.

Each aircraft's hold is a path from the arrival into a circle about its goal, forecast at steady velocity. Sense,
radius and height of the circle are chosen so that the path stays clear of all others until the flight ends.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.control.feedback import wrap_angle
from anser.control.guidance import GuidanceSettings, hold
from anser.environment.environment import AbstractWind
from anser.numerics.integration import rk4_step
from anser.parts.paths import AbstractReference, PathPoint
from anser.planning.certified import clearance
from anser.planning.certified.clearance import Track, fleet_clearance_ratio, fleet_cylinders, path_track
from anser.planning.certified.path_bounds import path_bounds
from anser.planning.certified.task import AircraftTask, Airspace
from anser.planning.timed_path import TimedPath
from anser.shapes import Count, Flag, Scalar, ScalarLike, Vector3
from anser.spatial.rotations import safe_hypot, safe_norm

_SUBSTEPS = 4  # of the integration in each cell
_ROLL_LAG_S = 1.5
_COURSE_GAIN = 0.5  # 1/s
_SPEED_GAIN, _SPEED_RATE = 0.2, 0.8  # 1/s, m/s^2
_HEIGHT_GAIN, _CLIMB_LAG_S, _CLIMB_RATE = 0.2, 2.0, 4.0  # 1/s, s, m/s^2
_LEVEL_OFF_S = 8.0  # in which a steep arrival is levelled off, with more than `_CLIMB_RATE` where it must
_PULL_SHARE = 0.75  # of the load factor beyond 1 that is used for it
_BANK_FRACTION = 0.95  # of the greatest bank angle
GOAL_VELOCITY_TOLERANCE = 0.1
"""Part of the airspeed by which a goal's velocity may differ from what was foreseen with the hold still being flown."""


class HoldCircle(eqx.Module):
    """The circle of a hold.

    Attributes
    ----------
    radius
        m.
    turn
        +1: clockwise seen from above, -1: the other way.
    height
        Above the goal, m.
    """

    radius: Scalar
    turn: Scalar
    height: Scalar


class PlannedHolds(eqx.Module):
    """Holds of a fleet; leading axis aircraft.

    Attributes
    ----------
    paths
        From the arrivals to the end of the flight.
    circles
        What they join.
    goal_positions_n, goal_velocities_n, foreseen_at
        The goals as they were foreseen: places (m) and velocities (m/s) at a time, s.
    clearance_ratio
        Least ratio of distance to separation of each pair from the first arrival of the two until the flight ends;
        infinite for an aircraft and itself.
    keep_out_clearance
        How far each stays out of each keep-out at least after its arrival, m.
    clear
        Whether each keeps the separation from all others, stays out of keep-outs and within the limits of
        altitude, until the flight ends.
    """

    paths: TimedPath
    circles: HoldCircle
    goal_positions_n: Float[Array, "aircraft 3"]
    goal_velocities_n: Float[Array, "aircraft 3"]
    forecast_time: Scalar
    clearance_ratio: Float[Array, "aircraft aircraft"]
    keep_out_clearance: Float[Array, "aircraft volumes"]
    clear: Bool[Array, " aircraft"]


def choose_cell_count(duration_s: float) -> int:
    """Cells of a hold in a flight of so many seconds: a power of two, 2 s each or less where 4096 will do."""
    return next((cells for cells in (128, 256, 512, 1024, 2048) if 2.0 * cells >= duration_s), 4096)


def move_with_goals(
    holds: PlannedHolds, tasks: AircraftTask, now: ScalarLike | Float[Array, " aircraft"]
) -> PlannedHolds:
    """The same holds about goals that are foreseen otherwise at `now` (s), seen from which nothing jumps but the rates.

    A hold goes with its goal; its path through the air changes by as much as the goal's velocity does. Where `now` is a
    time for each, so is `forecast_time` after it.
    """
    now = jnp.asarray(now, dtype=float)
    elapsed = jnp.broadcast_to(now - holds.forecast_time, holds.clear.shape)
    off = tasks.goal_position_n - holds.goal_positions_n - elapsed[:, None] * holds.goal_velocities_n
    faster = tasks.goal_velocity_n - holds.goal_velocities_n

    def one(path: TimedPath, goal_offset_n: Vector3, faster_n: Vector3, since: Scalar) -> TimedPath:
        added = goal_offset_n[None, :] + (path.times - since)[:, None] * faster_n[None, :]
        return eqx.tree_at(lambda p: p.air_n, path, path.air_n.at[:, 0].add(added).at[:, 1].add(faster_n))

    return eqx.tree_at(
        lambda h: (h.paths, h.goal_positions_n, h.goal_velocities_n, h.forecast_time),
        holds,
        (
            jax.vmap(one)(holds.paths, off, faster, jnp.broadcast_to(now, elapsed.shape)),
            tasks.goal_position_n,
            tasks.goal_velocity_n,
            now,
        ),
    )


class HoldReference(AbstractReference):
    """The hold's path of one aircraft, carried along with its goal as it is sensed now.

    Attributes
    ----------
    path
        As planned.
    off_n, off_rate_n
        How far the goal is from where it was foreseen, m, and how fast that changes, m/s.
    now
        When it is, s.
    """

    path: TimedPath
    goal_offset_n: Vector3
    goal_offset_rate_n: Vector3
    now: Scalar

    def at(self, time: ScalarLike) -> PathPoint:
        """Motion over the ground at a time."""
        planned = self.path.at(time)
        return PathPoint(
            planned.position_n + self.goal_offset_n + (time - self.now) * self.goal_offset_rate_n,
            planned.velocity_n + self.goal_offset_rate_n,
            planned.acceleration_n,
        )


def broadcast_holds(holds: PlannedHolds) -> PlannedHolds:
    """Holds every field of which has a leading axis aircraft, for `vmap`."""
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
    """What one aircraft of some holds (no leading axis) is to fly about its goal as sensed, and whether it is to.

    Not where the goal moves otherwise than foreseen by more than `GOAL_VELOCITY_TOLERANCE` of the airspeed (m/s), nor
    beyond the end.
    With a `reach` (m) it is flown however the goal moves, and goes with it no farther than that.
    """
    off_rate_n = goal_velocity_n - holds.goal_velocities_n
    off_n = goal_position_n - holds.goal_positions_n - (time - holds.forecast_time) * holds.goal_velocities_n
    as_foreseen = jnp.sum(off_rate_n**2) <= (GOAL_VELOCITY_TOLERANCE * speed) ** 2
    if reach is not None:
        share = jnp.minimum(1.0, reach / jnp.maximum(safe_norm(off_n), reach))
        off_n, off_rate_n = share * off_n, jnp.where(share < 1.0, 0.0, 1.0) * off_rate_n
        as_foreseen = jnp.asarray(True)
    flown = as_foreseen & (time <= holds.paths.times[-1])
    return HoldReference(holds.paths, off_n, off_rate_n, jnp.asarray(time, off_n.dtype)), flown


class _PointMass(eqx.Module):
    """A point mass in a hold; position over the ground and what of it is the air's drift, m."""

    position_n: Vector3
    drift_n: Vector3
    course: Scalar
    """Through the air, rad."""
    speed: Scalar
    """Airspeed, m/s."""
    climb: Scalar
    """Relative to the air, m/s."""
    turning: Scalar
    """Horizontal acceleration to the right, m/s^2."""


def _air_velocity_n(now: _PointMass) -> Vector3:
    level = jnp.sqrt(jnp.maximum(now.speed**2 - now.climb**2, 1.0))
    return jnp.stack([level * jnp.cos(now.course), level * jnp.sin(now.course), -now.climb])


def hold_path(
    task: AircraftTask,
    arrival: tuple[Vector3, Vector3, ScalarLike],
    goal: tuple[Vector3, Vector3],
    circle: HoldCircle,
    wind: AbstractWind,
    end_time: ScalarLike,
    settings: GuidanceSettings,
    gravity: ScalarLike,
    cells: int,
) -> TimedPath:
    """Path of one hold: the guidance's field, flown by a point mass that rolls, climbs and speeds up at finite rates.

    Parameters
    ----------
    task
        Its speed and limits count.
    arrival
        Position (m), velocity over the ground (m/s) and time (s) with which the hold begins.
    goal
        Position and velocity of the goal at the arrival, m and m/s over the ground.
    circle
        To be joined.
    wind
        As in the plan.
    until
        When the path ends, s.
    settings
        Of the guidance; radius and sense are the circle's.
    gravity
        m/s^2.
    cells
        Of the path.
    """
    place_n, velocity_n, begin = arrival
    goal_n, goal_velocity_n = goal
    settings = eqx.tree_at(lambda s: (s.hold_radius, s.hold_turn), settings, (circle.radius, circle.turn))
    span = jnp.maximum(end_time - begin, 1.0) / cells
    most, rate_most = gravity * jnp.tan(_BANK_FRACTION * task.limits.bank_max), task.limits.bank_rate_max
    air_n = velocity_n - wind.at(place_n, begin)
    steep = jnp.minimum(jnp.abs(air_n[2]) / _LEVEL_OFF_S, _PULL_SHARE * (task.limits.load_factor_max - 1.0) * gravity)
    climb_rate = jnp.maximum(_CLIMB_RATE, steep)
    start = _PointMass(
        position_n=place_n,
        drift_n=jnp.zeros(3),
        course=jnp.arctan2(air_n[1], air_n[0]),
        speed=jnp.sqrt(jnp.sum(air_n**2)),
        climb=-air_n[2],
        turning=jnp.zeros(()),
    )

    def rates(elapsed: ScalarLike, now: _PointMass) -> _PointMass:
        blowing_n = wind.at(now.position_n, begin)
        ground_n = _air_velocity_n(now) + blowing_n
        relative_n = now.position_n - goal_n - elapsed * goal_velocity_n
        wanted = hold(
            relative_n,
            ground_n,
            goal_velocity_n,
            blowing_n,
            velocity_n - goal_velocity_n,
            circle.height,
            task.speed,
            settings,
        )
        turn_rate = wanted.chi_dot + _COURSE_GAIN * wrap_angle(wanted.chi - now.course)
        asked = jnp.clip(now.speed * turn_rate, -most, most)
        rising = _HEIGHT_GAIN * (circle.height + relative_n[2])
        rising = jnp.clip(rising, -settings.climb_rate_max, settings.climb_rate_max)
        wanted_climb = rising - goal_velocity_n[2] + blowing_n[2]
        level = safe_hypot(*_air_velocity_n(now)[:2])
        rolling = (asked - now.turning) / _ROLL_LAG_S
        if rate_most is not None:
            rolling = jnp.clip(rolling, -gravity * rate_most, gravity * rate_most)  # more of it beyond wings level
        return _PointMass(
            position_n=ground_n,
            drift_n=blowing_n,
            course=now.turning / jnp.maximum(level, 1.0),
            speed=jnp.clip(_SPEED_GAIN * (task.speed - now.speed), -_SPEED_RATE, _SPEED_RATE),
            climb=jnp.clip((wanted_climb - now.climb) / _CLIMB_LAG_S, -climb_rate, climb_rate),
            turning=rolling,
        )

    def cell(now: _PointMass, k: Count) -> tuple[_PointMass, tuple[Array, Array]]:
        step = span / _SUBSTEPS

        def substep(j: Count, at: _PointMass) -> _PointMass:
            return rk4_step(rates, k * span + j * step, at, step)

        # The velocity's rate by the chain rule, so that knots have the acceleration of the motion itself.
        motion = rates(k * span, now)
        air_n, air_dot_n = jax.jvp(_air_velocity_n, (now,), (motion,))
        blowing_n, blowing_dot_n = jax.jvp(lambda p: wind.at(p, begin), (now.position_n,), (motion.position_n,))
        knot = jnp.stack([now.position_n - now.drift_n, air_n, air_dot_n])
        drift = jnp.stack([now.drift_n, blowing_n, blowing_dot_n])
        return jax.lax.fori_loop(0, _SUBSTEPS, substep, now), (knot, drift)

    _, (knots, drifts) = jax.lax.scan(cell, start, jnp.arange(cells + 1))
    return TimedPath(begin + span * jnp.arange(cells + 1), knots, drifts)


SAMPLES_PER_CELL = 8
"""Per cell of a hold's path, at which distances are looked at; bounds hold between them."""
HOLD_INTERVALS_PER_CYLINDER = 4 * clearance.INTERVALS_PER_CYLINDER


class ApproachAndHold(eqx.Module):
    """Paths and holds; leading axis aircraft.

    Attributes
    ----------
    path
        To the arrivals.
    hold
        From there on, see `anser.planning.holds.hold_paths.broadcast_holds`.
    """

    path: TimedPath
    hold: PlannedHolds


def is_holding(times: Float[Array, " instants"], arrival: ScalarLike) -> Bool[Array, " intervals"]:
    """In which intervals between some instants an aircraft holds, at least at the end."""
    return times[1:] > arrival


def join_tracks(
    approach_track: Track, hold_track: Track, times: Float[Array, " instants"], arrival: ScalarLike
) -> Track:
    """One track of an approach and the hold after it, by the same instants (s); that of the arrival is of both."""
    holding, underway = is_holding(times, arrival), times[:-1] < arrival
    error_bound = jnp.maximum(
        jnp.where(holding, hold_track.error_bound, 0.0), jnp.where(underway, approach_track.error_bound, 0.0)
    )
    places = jnp.where((times > arrival)[:, None], hold_track.positions_n, approach_track.positions_n)
    return Track(places, error_bound, jnp.maximum(approach_track.included, hold_track.included))


def pairwise_clearance_ratios(
    approaches: ApproachAndHold, active: Float[Array, " ways"], airspace: Airspace, from_time: ScalarLike
) -> Float[Array, "ways ways"]:
    """Least ratio of distance to separation of each pair of ways from a time (s) to the end of their holds, or less.

    Infinite for a way and itself. What is before a path begins does not count; nor do ways whose `active` is 0.
    """
    cells, count = approaches.hold.paths.times.shape[1] - 1, active.shape[0]
    until = jnp.max(approaches.hold.paths.times)
    times = from_time + (until - from_time) * jnp.linspace(0.0, 1.0, SAMPLES_PER_CELL * cells + 1)

    def tracked(path: TimedPath, counts: Scalar) -> Track:
        bounds = path_bounds(path, airspace.wind, airspace.gravity)
        return path_track(path, bounds.cell_acceleration, counts, times)

    def whole(path: TimedPath, hold: TimedPath, counts: Scalar) -> Track:
        return join_tracks(tracked(path, counts), tracked(hold, counts), times, path.times[-1])

    tracks = jax.vmap(whole)(approaches.path, approaches.hold.paths, active)
    cylinders, everyone = fleet_cylinders(tracks, count, HOLD_INTERVALS_PER_CYLINDER), jnp.arange(count)

    def ratios_of(who: Count) -> Float[Array, " ways"]:
        one, own = jax.tree.map(lambda leaf: leaf[who], (tracks, cylinders))
        others = everyone != who
        return fleet_clearance_ratio(
            one, own, cylinders, lambda some: jax.tree.map(lambda leaf: leaf[some], tracks), others, airspace.separation
        )

    return jax.lax.map(ratios_of, everyone)
