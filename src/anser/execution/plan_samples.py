"""Planned paths at instants: what each asks of its aircraft, and its least and greatest."""

from typing import Any, Protocol

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from anser.compiling import compiled_quickly
from anser.execution.plan_distances import FLEET, keep_out_rooms, nearest_pairs, track_of
from anser.numerics import as_array, each_of, filled_up
from anser.planning import CERTIFIED_LIMITS, IdleDeceleration, PathLimits, PathPoint, polar
from anser.planning.demand import demand
from anser.results import PlanExtremes, PlanSamples
from anser.scenario.schema_airspace import KeepOut
from anser.shapes import Scalar, ScalarLike, Vector3

SAMPLE_STEP_S = 0.5
"""Between two instants of the record."""
_FINE = 1024  # instants of a path at which its extremes are looked for: every fifth of a second or less of most
_BLOCK = 256
_SAME_TIME_S = 1e-6


class PlannedPath(Protocol):
    """A path in time, of either planner: NED, SI units."""

    def at(self, time: ScalarLike) -> PathPoint:
        """Motion over the ground."""
        ...

    def air_velocity_n(self, time: ScalarLike) -> Vector3:
        """Velocity relative to the air, m/s."""
        ...


def sample_times(start_s: float, arrival_times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Even instants from the start to the last arrival, and every arrival; and which are even ones."""
    arrivals = np.unique(arrival_times)
    count = int(np.ceil((arrivals[-1] - start_s) / SAMPLE_STEP_S))
    even = start_s + SAMPLE_STEP_S * np.arange(max(count, 1))
    # An arrival at an even instant stands for it.
    nearest = np.abs(even[:, None] - arrivals[None, :])
    times = np.union1d(even[nearest.min(axis=1) > _SAME_TIME_S], arrivals)
    phase = (times - start_s) / SAMPLE_STEP_S
    return times, np.abs(phase - np.round(phase)) * SAMPLE_STEP_S <= _SAME_TIME_S


def asked_of(path: PlannedPath, time: ScalarLike, gravity: ScalarLike) -> dict[str, Scalar]:
    """What the path of one aircraft asks at a time (s), by key of `anser.variables`; SI units and radians.

    Notes
    -----
    Bank angle and load factor are those of coordinated flight along the path: the part of the specific force across
    the velocity relative to the air (theory section 6).
    """
    point, air = path.at(time), path.air_velocity_n(time)
    position, ground, acceleration = point.position_n, point.velocity_n, point.acceleration_n
    over, through = polar(ground, acceleration), polar(air, acceleration)
    asked = demand(air, acceleration, gravity)
    return {
        "north": position[0],
        "east": position[1],
        "altitude": -position[2],
        "velocity_north": ground[0],
        "velocity_east": ground[1],
        "airspeed": through.V,
        "ground_speed": over.V,
        "course": through.chi,
        "ground_course": over.chi,
        "path_angle": through.gamma,
        "climb_rate": -air[2],
        "bank": asked.bank,
        "load_factor": asked.normal / gravity,
        "thrust_surplus": asked.along,
    }


@compiled_quickly
def _asked(
    paths: PlannedPath, times: Float[Array, "aircraft block"], gravity: Scalar
) -> dict[str, Float[Array, "aircraft block"]]:
    def one(path: PlannedPath, instants: Float[Array, " block"]) -> dict[str, Scalar]:
        return jax.vmap(lambda time: asked_of(path, time, gravity))(instants)

    return eqx.filter_vmap(one, in_axes=(eqx.if_array(0), 0))(paths, times)


def _asked_in_blocks(paths: PlannedPath, times: np.ndarray, gravity: ScalarLike) -> dict[str, np.ndarray]:
    """What each path asks at its own times, (aircraft, time): fleets and blocks of few sizes, which seldom compile."""
    fleet, count = times.shape
    filled = np.pad(times, ((0, -fleet % FLEET), (0, -count % _BLOCK)), mode="edge")
    paths, weight = filled_up(paths, FLEET), as_array(gravity)
    blocks = [_asked(paths, as_array(block), weight) for block in np.split(filled, filled.shape[1] // _BLOCK, axis=1)]
    found = {key: np.concatenate([np.asarray(one[key]) for one in blocks], axis=1) for key in blocks[0]}
    return {key: values[:fleet, :count] for key, values in found.items()}


def sample_paths(
    paths: PlannedPath, arrival_times: np.ndarray, times_s: np.ndarray, gravity: ScalarLike
) -> dict[str, np.ndarray]:
    """What the paths of a fleet ask, by key of `anser.variables`; (time, aircraft), NaN after the arrival.

    Parameters
    ----------
    paths
        Stacked, leading axis aircraft.
    arrival_times
        (aircraft,), s.
    times_s
        (time,), s.
    gravity
        m/s^2.
    """
    arrivals = np.asarray(arrival_times)[:, None]
    found = _asked_in_blocks(paths, np.minimum(np.asarray(times_s)[None, :], arrivals), gravity)
    under_way = np.asarray(times_s)[None, :] <= arrivals
    return {key: np.where(under_way, values, np.nan).T for key, values in found.items()}


def sample_extremes(
    paths: PlannedPath,
    start_s: float,
    arrival_times: np.ndarray,
    gravity: ScalarLike,
    limits: PathLimits | None = None,
) -> PlanExtremes:
    """Least and greatest of each path, from its start to its arrival; arguments as of `sample_paths`.

    With limits, the accelerations are those that ask as much of each aircraft at its start; else the paths' own.
    """
    duration = np.asarray(arrival_times) - start_s
    asked = _asked_in_blocks(paths, start_s + duration[:, None] * np.linspace(0.0, 1.0, _FINE)[None, :], gravity)
    speed = asked["airspeed"]
    mean = np.trapezoid(speed, axis=1) / (_FINE - 1)
    values = {limit.key: limit.extreme(asked[limit.variable], 1) for limit in CERTIFIED_LIMITS}
    if limits is not None and limits.idle is not None:
        own = each_of((limits.idle, limits.deceleration_max))
        rows = zip(own, asked["thrust_surplus"], speed, asked["load_factor"], strict=True)
        found = np.array([_along_at_start(*one, *row) for one, *row in rows])
        values |= {"thrust_surplus_max": found[:, 0], "thrust_deficit_max": found[:, 1]}
    return PlanExtremes(length=mean * duration, speed_mean=mean, values=values)


def _along_at_start(
    idle: IdleDeceleration, deceleration: ScalarLike, along: np.ndarray, speed: np.ndarray, load_factor: np.ndarray
) -> tuple[Any, Any]:
    """The greatest acceleration and deceleration of a path as `PathBounds.along_at_start` has them, m/s^2."""
    gained = along + deceleration * idle.rise(speed, load_factor)
    return np.max(gained), np.max(-along / idle.share(speed, load_factor))


def sample_plan(
    paths: PlannedPath,
    start_s: float,
    arrival_times: np.ndarray,
    gravity: ScalarLike,
    goals_n: np.ndarray,
    times: tuple[np.ndarray, np.ndarray],
    separation_m: tuple[float, float] | None,
    keep_outs: tuple[KeepOut, ...],
    limits: PathLimits | None = None,
) -> PlanSamples:
    """Everything that is recorded of a plan.

    Parameters
    ----------
    paths
        Stacked, leading axis aircraft.
    start_s, arrival_times
        When all start and each arrives, s.
    gravity
        m/s^2.
    goals_n
        The aircraft's goals, (time, aircraft, NED axis), m.
    times
        As `sample_times` gives them.
    separation_m, keep_outs
        What a scenario asks for.
    limits
        As of `sample_extremes`.
    """
    history = sample_paths(paths, arrival_times, times[0], gravity)
    motion = track_of(times[0], history)
    rooms, when = keep_out_rooms(motion, keep_outs)
    under_way = times[0][:, None] <= np.asarray(arrival_times)[None, :]
    return PlanSamples(
        time_s=times[0],
        even=times[1],
        arrival_times_s=np.asarray(arrival_times, dtype=float),
        history=history,
        goals_n=np.where(under_way[:, :, None], goals_n, np.nan),
        extremes=sample_extremes(paths, start_s, arrival_times, gravity, limits),
        nearest=nearest_pairs(motion, None),
        separated=None if separation_m is None else nearest_pairs(motion, separation_m),
        keep_out_room_m=rooms,
        keep_out_at_s=when,
    )
