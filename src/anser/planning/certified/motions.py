"""Motions in which nothing is prescribed: the last kind of candidate, for what no shape and no profile will do.

Where limits are narrow or time is short, shape, altitude and airspeed must suit each other: to turn tightly one slows
down, to descend in time one gives up a level arrival. Here all three are found at once: from many detours
(`anser.planning.certified.motion_guesses`), damped least squares lead to a spline over the ground that keeps the
limits.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.numerics.gauss_newton import Damping, Search, begin_search, closest_of, search_steps
from anser.numerics.tridiagonal import Form, solve
from anser.planning.certified.certificate import PathBounds, excess, path_bounds
from anser.planning.certified.motion_guesses import Draw, beginning, draws
from anser.planning.certified.motion_terms import (
    Beginning,
    MotionTask,
    Normal,
    arrives_onward,
    missed_by,
    moved,
    narrower,
    step_measure,
)
from anser.planning.certified.profile import KINKS
from anser.planning.certified.request import Airspace, Traveller
from anser.planning.certified.route import PIECES
from anser.planning.certified.spline_motion import SplineMotion, motion_path
from anser.planning.timed_path import TimedPath
from anser.shapes import Count, Scalar, ScalarLike

CELLS = 64
"""Intervals of a motion; a path's divide them evenly."""
_FIRST_STEPS, _STEPS, _LAST_STEPS = 20, 40, 12
_TIGHTENED = 2  # times
_GOING_ON = 2  # times as many as are delivered
_DAMPING = Damping(lambda cost: 1e-2 * cost, 0.2, 5.0, 1e-9, 1e9)
_ENOUGH = 1e-9  # cost at which what is passed is a small part of what is held back


def _move(about: tuple[Beginning, Form], at: Normal, damping: Scalar) -> Array:
    """Step of the unknowns, its size weighed as an aircraft feels it."""
    damped = jax.tree.map(lambda of, size: of + damping * size, at.form, about[1])
    return solve(damped, at.gradient)


class Motions(eqx.Module):
    """Motions of one aircraft; stacked, those of a fleet.

    Attributes
    ----------
    paths
        Where it is when.
    valid
        Whether its certificate keeps everything of its own.
    turned
        Sum of the sizes of all changes of heading, rad.
    speeds
        Mean airspeeds, m/s.
    accelerations
        Bound in each interval of each path, m/s^2.
    """

    paths: TimedPath
    valid: Bool[Array, "*motions"]
    turned: Float[Array, "*motions"]
    speeds: Float[Array, "*motions"]
    accelerations: Float[Array, "*motions cells"]


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
        Even intervals between the knots of a path, a multiple of `CELLS`.
    starts, kept
        How many to begin with and to deliver.
    """
    task = jax.lax.stop_gradient(MotionTask(traveller, airspace, jnp.asarray(duration, dtype=float)))
    traveller, airspace, duration = task
    cell = duration / CELLS

    def begin_at(begun: Beginning, measure: Form) -> Search:
        none = jnp.zeros(measure.own.shape[:2])
        unknown = Normal(jnp.asarray(jnp.inf), none, jax.tree.map(jnp.zeros_like, measure))
        return begin_search((begun, measure), none, unknown)

    def begin(draw: Draw) -> Search:
        first = beginning(task, CELLS, draw)
        return begin_at(first, step_measure(task, first))

    def fitted(searches: Search, steps: int) -> Search:
        return search_steps(
            lambda about, x: missed_by(task, about[0], x), _move, _DAMPING, steps, searches, kept, _ENOUGH
        )

    fits = fitted(jax.vmap(begin)(draws(starts)), _FIRST_STEPS)
    fits = closest_of(fits, min(_GOING_ON * kept, starts))
    fits = closest_of(fitted(fits, _STEPS), kept)

    def delivered(one: Search) -> tuple[TimedPath, PathBounds]:
        motion = SplineMotion(duration, moved(one.about[0], cell, one.best))
        path = motion_path(0.0, motion, airspace.wind, ticks, ticks + PIECES + KINKS)
        return path, path_bounds(path, airspace.wind, airspace.gravity)

    def tightened(one: Search) -> Search:
        """The same, allowed less of what it passes between the instants that were looked at."""
        begun, measure = one.about
        allowed = narrower(task, begun.allowed, excess(delivered(one)[1], traveller.limits))
        return begin_at(Beginning(moved(begun, cell, one.best), begun.frame, allowed), measure)

    def again(_: Count, fits: Search) -> Search:
        return fitted(jax.vmap(tightened)(fits), _LAST_STEPS)

    fits = jax.lax.fori_loop(0, _TIGHTENED, again, fits)

    def deliver(one: Search) -> Motions:
        path, bounds = delivered(one)
        north, east, _ = jnp.moveaxis(path.air_n[:, 1], 1, 0)
        north_dot, east_dot, _ = jnp.moveaxis(path.air_n[:, 2], 1, 0)
        level_square = jnp.maximum(north**2 + east**2, 1.0)
        spans = jnp.diff(path.times)
        good = jnp.all(excess(bounds, traveller.limits) <= 0.0) & arrives_onward(
            one.about[0], path.velocity_n(duration)
        )
        return Motions(
            path,
            good & (traveller.side == 0),
            jnp.sum(spans * (jnp.abs(north * east_dot - east * north_dot) / level_square)[:-1]),
            jnp.sum(spans * jnp.sqrt(jnp.sum(path.air_n[:-1, 1] ** 2, axis=1))) / duration,
            bounds.cell_acceleration,
        )

    return jax.vmap(deliver)(fits)
