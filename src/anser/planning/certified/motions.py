"""Motions in which nothing is prescribed: the last kind of candidate, for what no shape and no profile will do.

Where limits are narrow or time is short, shape, altitude and airspeed must suit each other: to turn tightly one slows
down, to descend in time one gives up a level arrival. Here all three are found at once: from many starts, damped least
squares lead to a steering (`anser.planning.certified.steering`) that keeps the limits and nearly arrives, and a few
steps of least size make the arrival exact.
"""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from anser.planning.certified.certificate import excess, path_bounds
from anser.planning.certified.damped_fit import begin_fit, closest_of, fit
from anser.planning.certified.least_steps import Missed, begin_steps, least_steps
from anser.planning.certified.motion_terms import (
    PLACE_M,
    UNKNOWNS,
    MotionTask,
    arrival_missed,
    missed_nearly,
    signals_of,
    steering_of,
)
from anser.planning.certified.profile import KINKS
from anser.planning.certified.request import Airspace, Traveller
from anser.planning.certified.route import PIECES
from anser.planning.certified.steering import CELLS, fly, steered_path
from anser.planning.timed_path import TimedPath
from anser.shapes import Scalar, ScalarLike

_FIRST_STEPS, _STEPS, _LAST_STEPS = 10, 24, 5
_GOING_ON = 3  # times as many as are delivered
_LONGEST_STEP = 1.0  # of the last steps
_LOOKED_FOR = (0.988, 0.965)  # of the limits of bank, load and acceleration along the path, by turns
_SOLVED = 1e-9  # part of the way by which the end may be missed


class Motions(eqx.Module):
    """Motions of one aircraft; stacked, those of a fleet.

    Attributes
    ----------
    paths
        Where it is when.
    valid
        Whether its certificate keeps everything of its own.
    lengths
        Horizontal, through the air, m.
    turned
        Sum of the sizes of all changes of heading, rad.
    speeds
        Mean airspeeds, m/s.
    accelerations
        Bound in each interval of each path, m/s^2.
    """

    paths: TimedPath
    valid: Bool[Array, "*motions"]
    lengths: Float[Array, "*motions"]
    turned: Float[Array, "*motions"]
    speeds: Float[Array, "*motions"]
    accelerations: Float[Array, "*motions cells"]


def first_guesses(task: MotionTask, count: int, seed: int = 0) -> Float[Array, "starts unknowns"]:
    """Unknowns of so many starts: turning, climbing and speed that change slowly, the same ones every time."""
    rng = np.random.default_rng([13, seed])
    at = np.linspace(0.0, 1.0, CELLS)

    def slowly(points: int, size: np.ndarray) -> np.ndarray:
        drawn = size[:, None] * rng.normal(0.0, 1.0, (count, points))
        return np.stack([np.interp(at, np.linspace(0.0, 1.0, points), row) for row in drawn])

    always = rng.choice([0.0, 0.5], count) * rng.normal(0.0, 1.0, count)
    turning = np.clip(slowly(5, rng.choice([0.2, 0.5, 1.0], count)) + always[:, None], -1.0, 1.0)
    climbing = slowly(4, rng.choice([0.02, 0.1, 0.3], count))
    speeds = slowly(3, rng.choice([0.2, 0.6], count)) + rng.uniform(-0.8, 0.8, (count, 1))
    traveller = task.traveller
    end = traveller.goal_position_n + traveller.goal_velocity_n * task.duration + traveller.rendezvous.stand_off_n
    rise = (traveller.position_n[2] - end[2]) / (task.duration * traveller.limits.climb_rate_max)
    climbing = jnp.asarray(climbing) + jnp.clip(rise, -1.0, 1.0)
    return jnp.concatenate([turning, climbing, np.clip(speeds, -1.0, 1.0)], axis=1)


def find_motions(
    traveller: Traveller, airspace: Airspace, duration: ScalarLike, ticks: int, starts: int, kept: int
) -> Motions:
    """Motions of one aircraft that take a duration (s), from so many starts; the nearest few are delivered.

    Not differentiated: plans are chosen, not tuned.

    Parameters
    ----------
    traveller, airspace
        The task.
    duration
        s.
    ticks
        Even intervals between the knots of a path, a multiple of `anser.planning.certified.steering.CELLS`.
    starts, kept
        How many to begin with and to deliver.
    """
    task = jax.lax.stop_gradient(MotionTask(traveller, airspace, jnp.asarray(duration, dtype=float)))
    slopes = jax.jacfwd(functools.partial(signals_of, task))(jnp.zeros(UNKNOWNS))

    def nearly(x: Float[Array, " unknowns"], share: Scalar) -> Missed:
        return missed_nearly(task, slopes, share, x)

    shares = jnp.asarray(np.resize(_LOOKED_FOR, starts))
    fits = fit(nearly, _FIRST_STEPS, jax.vmap(begin_fit)(shares, first_guesses(task, starts)))
    fits = closest_of(fit(nearly, _STEPS, closest_of(fits, min(_GOING_ON * kept, starts))), kept)

    # A coarse quadrature arrives nearly: a few least steps with that of the path itself.
    def arrived(x: Float[Array, " unknowns"]) -> Array:
        flown = fly(steering_of(task, x), airspace.wind, ticks)
        last = flown.at_ends.through(flown.winds_n, flown.winds_dot_n).level_velocity[:, -1]
        place, climb = flown.level_n[-1] + flown.drifts_n[-1, :2], flown.at_ends.climb[-1]
        return arrival_missed(task, place, flown.altitudes[-1], last + flown.winds_n[-1, :2], climb)

    def missed_at(x: Float[Array, " unknowns"], about: object) -> Missed:
        return arrived(x), jax.jacrev(arrived)(x)

    again = jax.vmap(lambda x: begin_steps((), x, 5))(fits.best)
    solved = least_steps(missed_at, _LONGEST_STEP, _LAST_STEPS, again).best

    def deliver(x: Float[Array, " unknowns"]) -> Motions:
        steering = steering_of(task, x)
        path, flown = steered_path(0.0, steering, airspace.wind, ticks, ticks + PIECES + KINKS)
        bounds = path_bounds(path, airspace.wind, airspace.gravity)
        way = task.duration * jnp.mean(flown.at_ends.speed)
        met = jnp.max(jnp.abs(arrived(x))) * PLACE_M <= _SOLVED * way
        return Motions(
            path,
            jnp.all(excess(bounds, traveller.limits) <= 0.0) & met & (traveller.side == 0),
            jnp.mean(flown.at_ends.through(flown.winds_n, flown.winds_dot_n).level[:-1]) * task.duration,
            jnp.sum(jnp.abs(jnp.diff(steering.headings))),
            jnp.mean(flown.at_ends.speed[:-1]),
            bounds.cell_acceleration,
        )

    return jax.vmap(deliver)(solved)
