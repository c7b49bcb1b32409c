"""Search for spline trajectories, the generator without a prescribed shape.

Random initial guesses and damped least squares. Where limits are narrow or time is short, shape, altitude and
airspeed must suit each other. From many detours as initial guesses, damped least squares lead to a spline over the
ground that keeps the limits.
"""

import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from anser.numerics.least_squares import Damping, SearchState, best_searches, search_steps, start_search
from anser.numerics.linear import BlockTridiagonal, solve_tridiagonal
from anser.planning.certified.detours import greatest_bank_rate
from anser.planning.certified.path_bounds import PathBounds, excess, path_bounds
from anser.planning.certified.profile import KINKS
from anser.planning.certified.routes import PIECES
from anser.planning.certified.splines import (
    NormalEquations,
    Spline,
    SplineProblem,
    SplineStart,
    arrives_forward,
    initial_limits,
    initial_state_n,
    knot_coefficients,
    normal_equations,
    spline_path,
    step_metric,
    tighten_limits,
    update_coefficients,
)
from anser.planning.certified.task import AircraftTask, Airspace
from anser.planning.demand import turn_radius
from anser.planning.timed_path import TimedPath
from anser.shapes import Count, Scalar, ScalarLike

_POINTS = 160  # intervals of a detour's polyline
_CORNER_FRACTION, _ZIGZAG_FRACTION = 0.45, 0.25  # parts of the starts; the others make circles
_CIRCLING = (0.1, 0.9)  # parts of the points between which circles are
_LEAST_CIRCLE = 1.05  # turn radii
_ROUNDING = 5.0  # smoothness against closeness: corners are rounded over a few intervals
_HALVINGS = 30
_LIMIT_FRACTIONS = (0.988, 0.965)  # of the limits of bank, load and acceleration along the path, by turns
_HUMP_M = 400.0
_TINY_M = 1e-6


class Guess(NamedTuple):
    """What is random in one guess; the same ones every time.

    Attributes
    ----------
    done
        Part of the way at each point.
    ahead, aside
        Detour of size 1 there, along the way and across it.
    angle
        There, of whole circles; 0 without.
    rounds
        Part of the circles that fit; negative: to the left.
    speed
        Part of the range of airspeeds that makes the length.
    first_leg, last_leg
        Straight on at first and last, turn radii.
    course
        Of arrival where none is prescribed, rad.
    hump
        In altitude, m.
    share
        Of the limits of bank, load factor and acceleration along the path.
    """

    line_fraction: Float[Array, " points"]
    along_detour: Float[Array, " points"]
    across_detour: Float[Array, " points"]
    angle: Float[Array, " points"]
    circle_fraction: Scalar
    speed: Scalar
    first_leg: Scalar
    last_leg: Scalar
    course: Scalar
    hump: Scalar
    limit_fraction: Scalar


def _detour(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]:
    """A corner on an ellipse, a zigzag or whole circles: the first five of `Guess`."""
    s, side = np.linspace(0.0, 1.0, _POINTS + 1), float(rng.choice([-1.0, 1.0]))
    none = np.zeros_like(s)
    kind = rng.random()
    if kind < _CORNER_FRACTION:
        angle = rng.uniform(0.0, 2.0 * np.pi) if rng.random() < 0.5 else side * rng.uniform(0.3, 0.7) * np.pi
        corner = 1.0 - np.abs(2.0 * s - 1.0)
        return s, np.cos(angle) * corner, np.sin(angle) * corner, none, side
    if kind < _CORNER_FRACTION + _ZIGZAG_FRACTION:
        bends = int(rng.integers(2, 5))
        return s, none, side * (2.0 / np.pi) * np.arcsin(np.sin(np.pi * bends * s)), none, side
    place = float(rng.choice([0.0, rng.random(), 1.0]))
    done = np.interp(s, [0.0, _CIRCLING[0], _CIRCLING[1], 1.0], [0.0, place, place, 1.0])
    turned = 2.0 * np.pi * np.clip((s - _CIRCLING[0]) / (_CIRCLING[1] - _CIRCLING[0]), 0.0, 1.0)
    return done, none, none, turned, side * rng.uniform(0.2, 1.0)


@functools.cache
def _random_guesses(count: int, seed: int) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng([13, seed])
    rows = []
    for k in range(count):
        detour = _detour(rng)
        legs = rng.choice([0.0, 0.5, 1.5]) * rng.random(), rng.uniform(0.3, 2.0)
        hump = rng.choice([0.0, 0.0, 1.0]) * rng.normal(0.0, _HUMP_M)
        rows.append(
            (
                *detour,
                rng.random(),
                *legs,
                rng.uniform(-np.pi, np.pi),
                hump,
                _LIMIT_FRACTIONS[k % len(_LIMIT_FRACTIONS)],
            )
        )
    return tuple(np.array(parts) for parts in zip(*rows, strict=True))


def make_guesses(count: int, seed: int = 0) -> Guess:
    """So many, stacked."""
    return Guess(*(jnp.asarray(parts) for parts in _random_guesses(count, seed)))


@functools.cache
def _smoothing(cells: int) -> Float[np.ndarray, "n n"]:
    """From coefficients wished for (the three at either end kept) to smooth ones: least squares with the jumps."""
    count = cells + 3
    jumps = np.diff(np.eye(count), 3, axis=0)
    weight = np.concatenate([np.full(3, 1e9), np.ones(count - 6), np.full(3, 1e9)])
    return np.linalg.solve(np.diag(weight) + _ROUNDING * jumps.T @ jumps, np.diag(weight))


def _last_velocity(
    problem: SplineProblem, last: Float[Array, "2"], speed: Scalar, wind: Float[Array, "2"], freely: Float[Array, "3"]
) -> tuple[Float[Array, "3"], Float[Array, "3 3"]]:
    """Velocity of arrival over the ground, and the directions in which it may change, see `SplineStart.frame`.

    Along `last` at an airspeed where a course or an angle is prescribed, else `freely`.
    """
    rendezvous = problem.task.rendezvous
    steep = rendezvous.path_angle_prescribed
    tangent = jnp.tan(rendezvous.path_angle) * steep
    cosine = 1.0 / jnp.sqrt(1.0 + tangent**2)
    direction = cosine * jnp.append(last, -tangent)
    onward = jnp.sqrt(jnp.sum((speed * cosine * last + wind) ** 2)) / cosine
    climbing = jnp.array([0.0, 0.0, 1.0]) * jnp.where(steep, 0.0, 1.0)
    bound = rendezvous.course_prescribed | steep
    frame = jnp.stack([direction, climbing, jnp.zeros(3)], axis=1)
    return jnp.where(bound, direction * onward, freely), jnp.where(bound, frame, jnp.eye(3))


def spline_start(problem: SplineProblem, cells: int, guess: Guess) -> SplineStart:
    """Where a search begins.

    The way through the air runs from the start some way ahead, makes its detour, and goes some way along the direction
    of arrival to the rendezvous; at an even speed and climb, the mean wind added.
    """
    task, airspace, duration = problem
    limits, rendezvous = task.limits, task.rendezvous
    state, meeting = initial_state_n(problem), task.meeting_n(duration)
    start = state[0]
    heights = jnp.linspace(-start[2], -meeting[2], 9)
    places = jnp.stack([jnp.zeros(9), jnp.zeros(9), -heights], axis=1)
    wind = jnp.mean(jax.vmap(lambda p: airspace.wind.at(p, 0.0))(places), axis=0)[:2]
    aim = meeting[:2] - start[:2] - wind * duration
    high = jnp.where(jnp.isfinite(limits.speed_max), limits.speed_max, 2.0 * task.speed)
    length = (limits.speed_min + guess.speed * (high - limits.speed_min)) * duration
    radius = turn_radius(0.5 * (limits.speed_min + high), limits.bank_max, airspace.gravity)
    ahead = task.air_velocity_n[:2]
    ahead = ahead / jnp.sqrt(jnp.sum(ahead**2) + 1e-6)
    course = jnp.where(rendezvous.course_prescribed, rendezvous.course, guess.course)
    last = jnp.stack([jnp.cos(course), jnp.sin(course)])
    bound = rendezvous.course_prescribed | rendezvous.path_angle_prescribed
    first_leg, last_leg = guess.first_leg * radius, jnp.where(bound, guess.last_leg, 0.0) * radius
    begin, end = first_leg * ahead, aim - last_leg * last
    straight = jnp.sqrt(jnp.sum((end - begin) ** 2) + _TINY_M)
    along = (end - begin) / straight
    across = jnp.stack([-along[1], along[0]])
    line = begin[None] + guess.line_fraction[:, None] * (end - begin)[None]
    wanted = length - first_leg - last_leg
    circles_max = jnp.maximum(wanted - straight, 0.0) / (2.0 * jnp.pi * _LEAST_CIRCLE * radius)
    turned = jnp.maximum(jnp.round(jnp.abs(guess.circle_fraction) * circles_max), 1.0) * guess.angle
    ahead_of, aside_of = (
        guess.along_detour + jnp.sin(turned),
        guess.across_detour + jnp.sign(guess.circle_fraction) * (1.0 - jnp.cos(turned)),
    )
    aside = ahead_of[:, None] * along[None] + aside_of[:, None] * across[None]

    def long(size: Scalar) -> Scalar:
        return jnp.sum(jnp.sqrt(jnp.sum(jnp.diff(line + size * aside, axis=0) ** 2, axis=1)))

    def halve(_: int, ends: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
        low, top = ends
        middle = 0.5 * (low + top)
        short = long(middle) < wanted
        return jnp.where(short, middle, low), jnp.where(short, top, middle)

    size = jax.lax.fori_loop(0, _HALVINGS, halve, (jnp.zeros(()), jnp.maximum(length, 1.0)))[0]
    points = jnp.concatenate([jnp.zeros((1, 2)), line + size * aside, aim[None]])
    done = jnp.cumsum(jnp.sqrt(jnp.sum(jnp.diff(points, axis=0) ** 2, axis=1)))
    done = jnp.concatenate([jnp.zeros(1), done])
    # A coefficient stands for the place at its own knot, one before the start and one after the end beside them.
    share = jnp.clip((jnp.arange(cells + 3) - 1.0) / cells, 0.0, 1.0)
    flat = jnp.stack([jnp.interp(share * done[-1], done, points[:, k]) for k in range(2)], axis=1)
    flat = flat + start[None, :2] + wind[None] * (share * duration)[:, None]
    height = -start[2] + (start[2] - meeting[2]) * share + guess.hump * jnp.sin(jnp.pi * share)
    height = jnp.clip(height, limits.altitude_min, limits.altitude_max)
    wished = jnp.concatenate([flat, -height[:, None]], axis=1)

    freely = (wished[-2] - wished[-4]) * 0.5 * cells / duration
    velocity, frame = _last_velocity(problem, last, done[-1] / duration, wind, freely)
    slopes = knot_coefficients(duration / cells)
    first, last = slopes @ state, slopes @ jnp.stack([meeting, velocity, jnp.zeros(3)])
    smooth = jnp.asarray(_smoothing(cells)) @ jnp.concatenate([first, wished[3:-3], last])
    return SplineStart(
        jnp.concatenate([first, smooth[3:-3], last]), frame, initial_limits(problem, guess.limit_fraction)
    )


CELLS = 64
"""Intervals of a spline; a path's divide them evenly."""
_FIRST_STEPS, _STEPS, _LAST_STEPS = 20, 40, 12
_TIGHTENING_ROUNDS = 2  # times
_REFINED_FACTOR = 2  # times as many as are delivered
_DAMPING = Damping(lambda cost: 1e-2 * cost, 0.2, 5.0, 1e-9, 1e9)
_COST_CONVERGED = 1e-9  # cost at which violations are a small part of what the limits are tightened by


def _spline_step(about: tuple[SplineStart, BlockTridiagonal], at: NormalEquations, damping: Scalar) -> Array:
    """Step of the unknowns, its size weighed as an aircraft feels it."""
    damped = jax.tree.map(lambda of, size: of + damping * size, at.form, about[1])
    return solve_tridiagonal(damped, at.gradient)


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
    total_turn: Float[Array, "*splines"]
    speeds: Float[Array, "*splines"]
    accelerations: Float[Array, "*splines cells"]


def find_splines(
    task: AircraftTask, airspace: Airspace, duration: ScalarLike, intervals: int, starts: int, max_splines: int
) -> Splines:
    """Spline trajectories of one aircraft that take a duration (s), from so many starts; the nearest few are delivered.

    Not differentiated: plans are chosen, not tuned. The number of even intervals between the knots of a path is a
    multiple of `CELLS`.
    """
    problem = jax.lax.stop_gradient(SplineProblem(task, airspace, jnp.asarray(duration, dtype=float)))
    task, airspace, duration = problem
    cell = duration / CELLS

    def begin_at(begun: SplineStart, metric: BlockTridiagonal) -> SearchState:
        none = jnp.zeros(metric.diagonal.shape[:2])
        unknown = NormalEquations(jnp.asarray(jnp.inf), none, jax.tree.map(jnp.zeros_like, metric))
        return start_search((begun, metric), none, unknown)

    def begin(guess: Guess) -> SearchState:
        first = spline_start(problem, CELLS, guess)
        return begin_at(first, step_metric(problem, first))

    def fitted(searches: SearchState, steps: int) -> SearchState:
        def at(about: tuple[SplineStart, BlockTridiagonal], x: Array) -> NormalEquations:
            return normal_equations(problem, about[0], x)

        return search_steps(at, _spline_step, _DAMPING, steps, searches, max_splines, _COST_CONVERGED)

    fits = fitted(jax.vmap(begin)(make_guesses(starts)), _FIRST_STEPS)
    fits = best_searches(fits, min(_REFINED_FACTOR * max_splines, starts))
    fits = best_searches(fitted(fits, _STEPS), max_splines)

    def delivered(one: SearchState) -> tuple[TimedPath, PathBounds]:
        found = Spline(duration, update_coefficients(one.context[0], cell, one.best))
        path = spline_path(0.0, found, airspace.wind, intervals, intervals + PIECES + KINKS)
        return path, path_bounds(path, airspace.wind, airspace.gravity)

    def restarted(one: SearchState) -> SearchState:
        """The same, within limits tightened by what it violates between the instants that were looked at."""
        begun, metric = one.context
        allowed = tighten_limits(problem, begun.allowed, excess(delivered(one)[1], task.limits))
        return begin_at(SplineStart(update_coefficients(begun, cell, one.best), begun.frame, allowed), metric)

    def again(_: Count, fits: SearchState) -> SearchState:
        return fitted(jax.vmap(restarted)(fits), _LAST_STEPS)

    fits = jax.lax.fori_loop(0, _TIGHTENING_ROUNDS, again, fits)

    def deliver(one: SearchState) -> Splines:
        path, bounds = delivered(one)
        north, east, _ = jnp.moveaxis(path.air_n[:, 1], 1, 0)
        north_dot, east_dot, _ = jnp.moveaxis(path.air_n[:, 2], 1, 0)
        level_square = jnp.maximum(north**2 + east**2, 1.0)
        spans = jnp.diff(path.times)
        good = jnp.all(excess(bounds, task.limits) <= 0.0) & arrives_forward(one.context[0], path.velocity_n(duration))
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
