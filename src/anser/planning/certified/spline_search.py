"""Search for spline trajectories: candidates without a prescribed shape.

Shape, altitude and airspeed are adjusted together, for narrow limits or short times. Damped least squares lead from
many random detours to splines in time, over the ground, within the limits.
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
from anser.shapes import Integer, Scalar, ScalarLike

_POINTS = 160  # intervals of a detour's polyline
_CORNER_FRACTION, _ZIGZAG_FRACTION = 0.45, 0.25  # fractions of the starts; the remaining starts have circles
_CIRCLING = (0.1, 0.9)  # range of the polyline in which circles are flown
_CIRCLE_MIN = 1.05  # least radius of a circle, turn radii
_ROUNDING = 5.0  # smoothness against closeness: corners are rounded over a few intervals
_HALVINGS = 30
_LIMIT_FRACTIONS = (0.988, 0.965)  # of the limits of bank, load factor and acceleration along the path, alternating
_HUMP_M = 400.0
_TINY_M = 1e-6


class Guess(NamedTuple):
    """Random parameters of one initial guess of the spline search, a polyline with a detour; stacked for several."""

    line_fraction: Float[Array, " points"]  # position on the line between the legs, 0 to 1
    # detour along and across the line, in units of a size that gives the polyline its required length
    along_detour: Float[Array, " points"]
    across_detour: Float[Array, " points"]
    angle: Float[Array, " points"]  # angle flown in a circle, rad; multiplied by the number of circles
    circle_fraction: Scalar  # number of circles as a fraction of the possible number; negative: to the left
    speed: Scalar  # airspeed as a fraction of the range between the limits
    # straight legs at both ends, in turn radii
    first_leg: Scalar
    last_leg: Scalar
    course: Scalar  # course at the arrival if none is prescribed, rad
    hump: Scalar  # greatest additional altitude, m
    limit_fraction: Scalar  # fraction of the limits that applies at first, see `initial_limits`


def _detour(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]:
    """Draw a detour: a corner, a zigzag or full circles; return the first five fields of `Guess`."""
    s, side = np.linspace(0.0, 1.0, _POINTS + 1), float(rng.choice([-1.0, 1.0]))
    zeros = np.zeros_like(s)
    kind = rng.random()
    if kind < _CORNER_FRACTION:
        angle = rng.uniform(0.0, 2.0 * np.pi) if rng.random() < 0.5 else side * rng.uniform(0.3, 0.7) * np.pi
        corner = 1.0 - np.abs(2.0 * s - 1.0)
        return s, np.cos(angle) * corner, np.sin(angle) * corner, zeros, side
    if kind < _CORNER_FRACTION + _ZIGZAG_FRACTION:
        bends = int(rng.integers(2, 5))
        return s, zeros, side * (2.0 / np.pi) * np.arcsin(np.sin(np.pi * bends * s)), zeros, side
    circle_position = float(rng.choice([0.0, rng.random(), 1.0]))
    line_fraction = np.interp(s, [0.0, _CIRCLING[0], _CIRCLING[1], 1.0], [0.0, circle_position, circle_position, 1.0])
    angles = 2.0 * np.pi * np.clip((s - _CIRCLING[0]) / (_CIRCLING[1] - _CIRCLING[0]), 0.0, 1.0)
    return line_fraction, zeros, zeros, angles, side * rng.uniform(0.2, 1.0)


@functools.cache
def _random_guesses(count: int, seed: int) -> tuple[np.ndarray, ...]:
    """Draw the parameters of `count` guesses: one array (guess, ...) for each field of `Guess`."""
    rng = np.random.default_rng([13, seed])
    guesses = []
    for k in range(count):
        detour = _detour(rng)
        legs = rng.choice([0.0, 0.5, 1.5]) * rng.random(), rng.uniform(0.3, 2.0)
        hump = rng.choice([0.0, 0.0, 1.0]) * rng.normal(0.0, _HUMP_M)
        guesses.append(
            (
                *detour,
                rng.random(),
                *legs,
                rng.uniform(-np.pi, np.pi),
                hump,
                _LIMIT_FRACTIONS[k % len(_LIMIT_FRACTIONS)],
            )
        )
    return tuple(np.array(field_values) for field_values in zip(*guesses, strict=True))


def make_guesses(count: int, seed: int = 0) -> Guess:
    """Draw `count` initial guesses of the spline search, stacked; equal seeds give equal guesses."""
    return Guess(*(jnp.asarray(field_values) for field_values in _random_guesses(count, seed)))


@functools.cache
def _smoothing(cells: int) -> Float[np.ndarray, "n n"]:
    """Return the matrix that smooths the coefficients of a spline with `cells` intervals; n = cells + 3.

    Third differences are penalized; three coefficients at either end stay unchanged.
    """
    count = cells + 3
    jumps = np.diff(np.eye(count), 3, axis=0)
    weight = np.concatenate([np.full(3, 1e9), np.ones(count - 6), np.full(3, 1e9)])
    return np.linalg.solve(np.diag(weight) + _ROUNDING * jumps.T @ jumps, np.diag(weight))


def _last_velocity(
    problem: SplineProblem,
    direction_2d: Float[Array, "2"],
    speed: Scalar,
    wind: Float[Array, "2"],
    free_velocity: Float[Array, "3"],
) -> tuple[Float[Array, "3"], Float[Array, "3 3"]]:
    """Return the velocity over the ground at the arrival (NED, m/s), and the frame of its allowed changes.

    If neither course nor path angle is prescribed, the velocity is `free_velocity`. If one is prescribed, the velocity
    has the horizontal direction `direction_2d` (north, east), and the prescribed path angle or path angle 0. The
    horizontal speed is |`wind` + horizontal airspeed along `direction_2d`| for the airspeed `speed`, m/s. The frame is
    explained in `SplineStart.frame`.
    """
    rendezvous = problem.task.rendezvous
    angle_prescribed = rendezvous.path_angle_prescribed
    tangent = jnp.tan(rendezvous.path_angle) * angle_prescribed
    cosine = 1.0 / jnp.sqrt(1.0 + tangent**2)
    direction = cosine * jnp.append(direction_2d, -tangent)
    onward = jnp.sqrt(jnp.sum((speed * cosine * direction_2d + wind) ** 2)) / cosine
    climbing = jnp.array([0.0, 0.0, 1.0]) * jnp.where(angle_prescribed, 0.0, 1.0)
    is_prescribed = rendezvous.course_prescribed | angle_prescribed
    frame = jnp.stack([direction, climbing, jnp.zeros(3)], axis=1)
    return jnp.where(is_prescribed, direction * onward, free_velocity), jnp.where(is_prescribed, frame, jnp.eye(3))


def spline_start(problem: SplineProblem, cells: int, guess: Guess) -> SplineStart:
    """Build the initial spline of a search, with `cells` equal intervals, from a guess."""
    task, airspace, duration = problem
    limits, rendezvous = task.limits, task.rendezvous
    state, meeting = initial_state_n(problem), task.meeting_n(duration)
    start = state[0]
    heights = jnp.linspace(-start[2], -meeting[2], 9)
    wind_positions = jnp.stack([jnp.zeros(9), jnp.zeros(9), -heights], axis=1)
    wind = jnp.mean(jax.vmap(lambda p: airspace.wind.at(p, 0.0))(wind_positions), axis=0)[:2]
    target = meeting[:2] - start[:2] - wind * duration
    speed_max = jnp.where(jnp.isfinite(limits.speed_max), limits.speed_max, 2.0 * task.speed)
    length = (limits.speed_min + guess.speed * (speed_max - limits.speed_min)) * duration
    radius = turn_radius(0.5 * (limits.speed_min + speed_max), limits.bank_max, airspace.gravity)
    start_direction = task.air_velocity_n[:2]
    start_direction = start_direction / jnp.sqrt(jnp.sum(start_direction**2) + 1e-6)
    course = jnp.where(rendezvous.course_prescribed, rendezvous.course, guess.course)
    arrival_direction = jnp.stack([jnp.cos(course), jnp.sin(course)])
    is_prescribed = rendezvous.course_prescribed | rendezvous.path_angle_prescribed
    first_leg, last_leg = guess.first_leg * radius, jnp.where(is_prescribed, guess.last_leg, 0.0) * radius
    begin, end = first_leg * start_direction, target - last_leg * arrival_direction
    straight = jnp.sqrt(jnp.sum((end - begin) ** 2) + _TINY_M)
    along = (end - begin) / straight
    across = jnp.stack([-along[1], along[0]])
    line = begin[None] + guess.line_fraction[:, None] * (end - begin)[None]
    target_length = length - first_leg - last_leg
    circles_max = jnp.maximum(target_length - straight, 0.0) / (2.0 * jnp.pi * _CIRCLE_MIN * radius)
    circle_angle = jnp.maximum(jnp.round(jnp.abs(guess.circle_fraction) * circles_max), 1.0) * guess.angle
    along_shape = guess.along_detour + jnp.sin(circle_angle)
    across_shape = guess.across_detour + jnp.sign(guess.circle_fraction) * (1.0 - jnp.cos(circle_angle))
    detour = along_shape[:, None] * along[None] + across_shape[:, None] * across[None]

    def detour_length(size: Scalar) -> Scalar:
        return jnp.sum(jnp.sqrt(jnp.sum(jnp.diff(line + size * detour, axis=0) ** 2, axis=1)))

    def halve(_: int, bracket: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
        low, high = bracket
        middle = 0.5 * (low + high)
        is_short = detour_length(middle) < target_length
        return jnp.where(is_short, middle, low), jnp.where(is_short, high, middle)

    size = jax.lax.fori_loop(0, _HALVINGS, halve, (jnp.zeros(()), jnp.maximum(length, 1.0)))[0]
    points = jnp.concatenate([jnp.zeros((1, 2)), line + size * detour, target[None]])
    distances = jnp.cumsum(jnp.sqrt(jnp.sum(jnp.diff(points, axis=0) ** 2, axis=1)))
    distances = jnp.concatenate([jnp.zeros(1), distances])
    # A coefficient approximates the position at its knot; the outermost knots lie before the start and after the end.
    fractions = jnp.clip((jnp.arange(cells + 3) - 1.0) / cells, 0.0, 1.0)
    horizontal = jnp.stack([jnp.interp(fractions * distances[-1], distances, points[:, k]) for k in range(2)], axis=1)
    horizontal = horizontal + start[None, :2] + wind[None] * (fractions * duration)[:, None]
    height = -start[2] + (start[2] - meeting[2]) * fractions + guess.hump * jnp.sin(jnp.pi * fractions)
    height = jnp.clip(height, limits.altitude_min, limits.altitude_max)
    target_coefficients = jnp.concatenate([horizontal, -height[:, None]], axis=1)

    free_velocity = (target_coefficients[-2] - target_coefficients[-4]) * 0.5 * cells / duration
    velocity, frame = _last_velocity(problem, arrival_direction, distances[-1] / duration, wind, free_velocity)
    slopes = knot_coefficients(duration / cells)
    first_coefficients, arrival_direction = slopes @ state, slopes @ jnp.stack([meeting, velocity, jnp.zeros(3)])
    smooth = jnp.asarray(_smoothing(cells)) @ jnp.concatenate(
        [first_coefficients, target_coefficients[3:-3], arrival_direction]
    )
    return SplineStart(
        jnp.concatenate([first_coefficients, smooth[3:-3], arrival_direction]),
        frame,
        initial_limits(problem, guess.limit_fraction),
    )


CELLS = 64
"""Number of intervals of a spline; divides the number of intervals of a path."""
_FIRST_STEPS, _STEPS, _LAST_STEPS = 12, 24, 16
_TIGHTENING_ROUNDS = 3
_REFINED_FACTOR = 2  # number of searches continued after the first steps, per returned spline
_DAMPING = Damping(lambda cost: 1e-2 * cost, 0.2, 5.0, 1e-9, 1e9)
_COST_CONVERGED = 1e-9  # cost at which violations are small against the tightening of the limits


def _spline_step(context: tuple[SplineStart, BlockTridiagonal], equations: NormalEquations, damping: Scalar) -> Array:
    """Return the damped Gauss-Newton step, to be subtracted from the unknowns.

    `context` has the start of the search and the `step_metric` for the damping.
    """
    damped = jax.tree.map(lambda block, size: block + damping * size, equations.form, context[1])
    return solve_tridiagonal(damped, equations.gradient)


class Splines(eqx.Module):
    """Spline trajectories of one aircraft, as timed paths; with a leading axis, of a fleet."""

    paths: TimedPath  # position over time
    # whether the proven bounds are within the flight limits (keep-outs are not checked), the arrival is along the
    # prescribed course, and the task prescribes no side of detours
    valid: Bool[Array, "*splines"]
    total_turn: Float[Array, "*splines"]  # sum of the absolute changes of heading, rad
    speeds: Float[Array, "*splines"]  # mean airspeeds, m/s
    accelerations: Float[Array, "*splines cells"]  # bound of the acceleration in each interval of each path, m/s^2


def find_splines(
    task: AircraftTask, airspace: Airspace, duration: ScalarLike, intervals: int, starts: int, max_splines: int
) -> Splines:
    """Find spline trajectories with which one aircraft arrives after a duration (s), from `starts` random guesses.

    Returns the `max_splines` splines with the smallest violations of the limits, even if limits are violated; all
    derivatives are 0. `intervals`, the number of equal intervals between a path's knots, must be a multiple of `CELLS`.
    """
    problem = jax.lax.stop_gradient(SplineProblem(task, airspace, jnp.asarray(duration, dtype=float)))
    task, airspace, duration = problem
    cell = duration / CELLS

    def start_at(start: SplineStart, metric: BlockTridiagonal) -> SearchState:
        zeros = jnp.zeros(metric.diagonal.shape[:2])
        unevaluated = NormalEquations(jnp.asarray(jnp.inf), zeros, jax.tree.map(jnp.zeros_like, metric))
        return start_search((start, metric), zeros, unevaluated)

    def initialize(guess: Guess) -> SearchState:
        start = spline_start(problem, CELLS, guess)
        return start_at(start, step_metric(problem, start))

    # one search after another: the arrays of one search fit into the processor's cache, those of all do not
    @jax.custom_batching.sequential_vmap
    def equations_at(context: tuple[SplineStart, BlockTridiagonal], x: Array) -> NormalEquations:
        return normal_equations(problem, context[0], x)

    def fit(searches: SearchState, steps: int) -> SearchState:
        return search_steps(equations_at, _spline_step, _DAMPING, steps, searches, max_splines, _COST_CONVERGED)

    fits = fit(jax.vmap(initialize)(make_guesses(starts)), _FIRST_STEPS)
    fits = best_searches(fits, min(_REFINED_FACTOR * max_splines, starts))
    fits = best_searches(fit(fits, _STEPS), max_splines)

    def path_and_bounds(state: SearchState) -> tuple[TimedPath, PathBounds]:
        spline = Spline(duration, update_coefficients(state.context[0], cell, state.best))
        path = spline_path(0.0, spline, airspace.wind, intervals, intervals + PIECES + KINKS)
        return path, path_bounds(path, airspace.wind, airspace.gravity)

    def restart(state: SearchState) -> SearchState:
        """Restart a search within limits that are tightened by its violations between the sample points."""
        start, metric = state.context
        allowed = tighten_limits(problem, start.allowed, excess(path_and_bounds(state)[1], task.limits))
        return start_at(SplineStart(update_coefficients(start, cell, state.best), start.frame, allowed), metric)

    def tighten(_: Integer, fits: SearchState) -> SearchState:
        return fit(jax.vmap(restart)(fits), _LAST_STEPS)

    fits = jax.lax.fori_loop(0, _TIGHTENING_ROUNDS, tighten, fits)

    def deliver(state: SearchState) -> Splines:
        path, bounds = path_and_bounds(state)
        north, east, _ = jnp.moveaxis(path.air_n[:, 1], 1, 0)
        north_dot, east_dot, _ = jnp.moveaxis(path.air_n[:, 2], 1, 0)
        level_square = jnp.maximum(north**2 + east**2, 1.0)
        spans = jnp.diff(path.times)
        is_valid = jnp.all(excess(bounds, task.limits) <= 0.0) & arrives_forward(
            state.context[0], path.velocity_n(duration)
        )
        if task.limits.bank_rate_max is not None:
            is_valid &= greatest_bank_rate(path, airspace.gravity) <= task.limits.bank_rate_max
        return Splines(
            path,
            is_valid & (task.side == 0),
            jnp.sum(spans * (jnp.abs(north * east_dot - east * north_dot) / level_square)[:-1]),
            jnp.sum(spans * jnp.sqrt(jnp.sum(path.air_n[:-1, 1] ** 2, axis=1))) / duration,
            bounds.cell_acceleration,
        )

    return jax.vmap(deliver)(fits)
