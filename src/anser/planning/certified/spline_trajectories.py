"""Splines: trajectories in which nothing is prescribed, the last generator, where no shape and profile will do.

Where limits are narrow or time is short, shape, altitude and airspeed must suit each other: to turn tightly one slows
down, to descend in time one gives up a level arrival. Here all three are found at once: from many detours
(`anser.planning.certified.spline_guesses`), damped least squares lead to a spline over the ground that keeps the
limits.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.numerics.gauss_newton import Damping, Search, begin_search, closest_of, search_steps
from anser.numerics.tridiagonal import BlockTridiagonal, solve
from anser.planning.certified.path_bounds import PathBounds, excess, path_bounds
from anser.planning.certified.profile import KINKS
from anser.planning.certified.route import PIECES
from anser.planning.certified.spline import Spline, spline_path
from anser.planning.certified.spline_equations import (
    NormalEquations,
    SplineProblem,
    SplineStart,
    arrives_forward,
    normal_equations,
    step_metric,
    tightened,
    updated,
)
from anser.planning.certified.spline_guesses import Guess, guesses, spline_start
from anser.planning.certified.task import AircraftTask, Airspace
from anser.planning.certified.wide_turns import greatest_bank_rate
from anser.planning.timed_path import TimedPath
from anser.shapes import Count, Scalar, ScalarLike

CELLS = 64
"""Intervals of a spline; a path's divide them evenly."""
_FIRST_STEPS, _STEPS, _LAST_STEPS = 20, 40, 12
_TIGHTENED = 2  # times
_REFINED = 2  # times as many as are delivered
_DAMPING = Damping(lambda cost: 1e-2 * cost, 0.2, 5.0, 1e-9, 1e9)
_COST_ENOUGH = 1e-9  # cost at which violations are a small part of what the limits are tightened by


def _move(about: tuple[SplineStart, BlockTridiagonal], at: NormalEquations, damping: Scalar) -> Array:
    """Step of the unknowns, its size weighed as an aircraft feels it."""
    damped = jax.tree.map(lambda of, size: of + damping * size, at.form, about[1])
    return solve(damped, at.gradient)


class Splines(eqx.Module):
    """Spline trajectories of one aircraft; stacked, those of a fleet.

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
    valid: Bool[Array, "*splines"]
    turned: Float[Array, "*splines"]
    speeds: Float[Array, "*splines"]
    accelerations: Float[Array, "*splines cells"]


def find_splines(
    task: AircraftTask, airspace: Airspace, duration: ScalarLike, intervals: int, starts: int, kept: int
) -> Splines:
    """Spline trajectories of one aircraft that take a duration (s), from so many starts; the nearest few are delivered.

    Not differentiated: plans are chosen, not tuned. The number of even intervals between the knots of a path is a
    multiple of `CELLS`.
    """
    problem = jax.lax.stop_gradient(SplineProblem(task, airspace, jnp.asarray(duration, dtype=float)))
    task, airspace, duration = problem
    cell = duration / CELLS

    def begin_at(begun: SplineStart, metric: BlockTridiagonal) -> Search:
        none = jnp.zeros(metric.diagonal.shape[:2])
        unknown = NormalEquations(jnp.asarray(jnp.inf), none, jax.tree.map(jnp.zeros_like, metric))
        return begin_search((begun, metric), none, unknown)

    def begin(guess: Guess) -> Search:
        first = spline_start(problem, CELLS, guess)
        return begin_at(first, step_metric(problem, first))

    def fitted(searches: Search, steps: int) -> Search:
        def at(about: tuple[SplineStart, BlockTridiagonal], x: Array) -> NormalEquations:
            return normal_equations(problem, about[0], x)

        return search_steps(at, _move, _DAMPING, steps, searches, kept, _COST_ENOUGH)

    fits = fitted(jax.vmap(begin)(guesses(starts)), _FIRST_STEPS)
    fits = closest_of(fits, min(_REFINED * kept, starts))
    fits = closest_of(fitted(fits, _STEPS), kept)

    def delivered(one: Search) -> tuple[TimedPath, PathBounds]:
        found = Spline(duration, updated(one.about[0], cell, one.best))
        path = spline_path(0.0, found, airspace.wind, intervals, intervals + PIECES + KINKS)
        return path, path_bounds(path, airspace.wind, airspace.gravity)

    def restarted(one: Search) -> Search:
        """The same, within limits tightened by what it violates between the instants that were looked at."""
        begun, metric = one.about
        allowed = tightened(problem, begun.allowed, excess(delivered(one)[1], task.limits))
        return begin_at(SplineStart(updated(begun, cell, one.best), begun.frame, allowed), metric)

    def again(_: Count, fits: Search) -> Search:
        return fitted(jax.vmap(restarted)(fits), _LAST_STEPS)

    fits = jax.lax.fori_loop(0, _TIGHTENED, again, fits)

    def deliver(one: Search) -> Splines:
        path, bounds = delivered(one)
        north, east, _ = jnp.moveaxis(path.air_n[:, 1], 1, 0)
        north_dot, east_dot, _ = jnp.moveaxis(path.air_n[:, 2], 1, 0)
        level_square = jnp.maximum(north**2 + east**2, 1.0)
        spans = jnp.diff(path.times)
        good = jnp.all(excess(bounds, task.limits) <= 0.0) & arrives_forward(one.about[0], path.velocity_n(duration))
        if task.limits.bank_rate_max is not None:
            good &= greatest_bank_rate(path, airspace.gravity) <= task.limits.bank_rate_max
        return Splines(
            path,
            good & (task.side == 0),
            jnp.sum(spans * (jnp.abs(north * east_dot - east * north_dot) / level_square)[:-1]),
            jnp.sum(spans * jnp.sqrt(jnp.sum(path.air_n[:-1, 1] ** 2, axis=1))) / duration,
            bounds.cell_acceleration,
        )

    return jax.vmap(deliver)(fits)
