"""First guesses for splines: detours of many kinds, as long as the time asks for."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.planning.certified.spline import end_slopes
from anser.planning.certified.spline_equations import (
    SplineProblem,
    SplineStart,
    first_state,
    initial_limits,
)
from anser.planning.demand import turn_radius
from anser.shapes import Scalar

_POINTS = 160  # intervals of a detour's polyline
_CORNERS, _ZIGZAGS = 0.45, 0.25  # parts of the starts; the others make circles
_CIRCLING = (0.1, 0.9)  # parts of the points between which circles are
_LEAST_CIRCLE = 1.05  # turn radii
_ROUNDING = 5.0  # smoothness against closeness: corners are rounded over a few intervals
_HALVINGS = 30
_SHARES = (0.988, 0.965)  # of the limits of bank, load and acceleration along the path, by turns
_HUMP_M = 400.0
_NONE_M = 1e-6


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

    done: Float[Array, " points"]
    ahead: Float[Array, " points"]
    aside: Float[Array, " points"]
    angle: Float[Array, " points"]
    rounds: Scalar
    speed: Scalar
    first_leg: Scalar
    last_leg: Scalar
    course: Scalar
    hump: Scalar
    share: Scalar


def _detour(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]:
    """A corner on an ellipse, a zigzag or whole circles: the first five of `Guess`."""
    s, side = np.linspace(0.0, 1.0, _POINTS + 1), float(rng.choice([-1.0, 1.0]))
    none = np.zeros_like(s)
    kind = rng.random()
    if kind < _CORNERS:
        angle = rng.uniform(0.0, 2.0 * np.pi) if rng.random() < 0.5 else side * rng.uniform(0.3, 0.7) * np.pi
        corner = 1.0 - np.abs(2.0 * s - 1.0)
        return s, np.cos(angle) * corner, np.sin(angle) * corner, none, side
    if kind < _CORNERS + _ZIGZAGS:
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
        rows.append((*detour, rng.random(), *legs, rng.uniform(-np.pi, np.pi), hump, _SHARES[k % len(_SHARES)]))
    return tuple(np.array(parts) for parts in zip(*rows, strict=True))


def guesses(count: int, seed: int = 0) -> Guess:
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
    state, meeting = first_state(problem), task.meeting_n(duration)
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
    straight = jnp.sqrt(jnp.sum((end - begin) ** 2) + _NONE_M)
    along = (end - begin) / straight
    across = jnp.stack([-along[1], along[0]])
    line = begin[None] + guess.done[:, None] * (end - begin)[None]
    wanted = length - first_leg - last_leg
    circles_max = jnp.maximum(wanted - straight, 0.0) / (2.0 * jnp.pi * _LEAST_CIRCLE * radius)
    turned = jnp.maximum(jnp.round(jnp.abs(guess.rounds) * circles_max), 1.0) * guess.angle
    ahead_of, aside_of = guess.ahead + jnp.sin(turned), guess.aside + jnp.sign(guess.rounds) * (1.0 - jnp.cos(turned))
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
    slopes = end_slopes(duration / cells)
    first, last = slopes @ state, slopes @ jnp.stack([meeting, velocity, jnp.zeros(3)])
    smooth = jnp.asarray(_smoothing(cells)) @ jnp.concatenate([first, wished[3:-3], last])
    return SplineStart(jnp.concatenate([first, smooth[3:-3], last]), frame, initial_limits(problem, guess.share))
