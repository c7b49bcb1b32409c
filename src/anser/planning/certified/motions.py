"""Motions in which nothing is prescribed: the last kind of candidate, for what no shape and no profile will do.

Where limits are narrow or time is short, shape, altitude and airspeed must suit each other: to turn tightly one slows
down, to descend in time one gives up a level arrival. Here all three are found at once: from many starts, damped
Gauss-Newton steps of least size lead to a steering (`anser.planning.certified.steering`) that arrives, and keeps the
limits that its splines do not keep by themselves.
"""

import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from anser.planning.certified.certificate import excess, path_bounds
from anser.planning.certified.least_steps import Missed, begin_steps, least_steps
from anser.planning.certified.profile import KINKS
from anser.planning.certified.request import Airspace, Traveller
from anser.planning.certified.route import PIECES
from anser.planning.certified.steering import (
    CELLS,
    Steering,
    first_coefficients,
    fly,
    steered,
    steered_path,
    wind_along,
)
from anser.planning.timed_path import TimedPath
from anser.shapes import Scalar, ScalarLike

_UNKNOWNS = 3 * CELLS
_FIRST_STEPS, _STEPS, _LAST_STEPS = 10, 24, 5
_GOING_ON = 3  # times as many as are delivered
_LONGEST_STEP = 1.0  # of the last steps
_KEPT = 0.998  # of the limits of airspeed and climb
_LOOKED_FOR = (0.988, 0.965)  # of those of bank, load and acceleration along the path, by turns
_RESERVE_M, _RESERVE_UP_M = 30.0, 10.0
_UP_WEIGHT = 3.0  # metres aside that one metre up or down is worth, to get out of a closed volume
_SOLVED = 1e-9  # part of the way by which the end may be missed
# What weighs the same: missing the end, m; its direction, rad; beyond a limit, m/s^2, m and parts of a range.
_PLACE_M, _DIRECTION, _FORCE, _HEIGHT_M, _INSIDE_M, _RANGE = 100.0, 0.05, 1.0, 50.0, 200.0, 0.1


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


class _Task(NamedTuple):
    traveller: Traveller
    airspace: Airspace
    duration: Scalar


class _Signals(NamedTuple):
    """What steering does at some instants; each follows linearly from the unknowns."""

    heading: Array
    heading_dot: Array
    climb: Array
    climb_dot: Array
    speed: Array
    speed_dot: Array
    altitude: Array


def _steering(task: _Task, x: Float[Array, " unknowns"]) -> Steering:
    """The steering that unknowns stand for: parts of what airspeed, climb and bank limits allow, -1 to 1."""
    traveller, airspace, duration = task
    limits, cell = traveller.limits, duration / CELLS
    velocity, acceleration = traveller.air_velocity_n, traveller.air_acceleration_n
    speed = jnp.sqrt(jnp.sum(velocity**2))
    square = jnp.maximum(jnp.sum(velocity[:2] ** 2), 1.0)
    turning = (velocity[0] * acceleration[1] - velocity[1] * acceleration[0]) / square
    gaining = jnp.sum(velocity * acceleration) / jnp.maximum(speed, 1.0)
    low, high = (2.0 - _KEPT) * limits.speed_min, _KEPT * limits.speed_max
    turn, climb, gain = x.reshape(3, CELLS)
    # Over the ground: what the wind's own rise adds is a part of a metre per second, which the certificate looks at.
    altitude_0 = -traveller.position_n[2]
    (wind,), (by_climb,) = wind_along(airspace.wind, altitude_0[None], jnp.ones(1))
    rising = -velocity[2] - wind[2]
    begun_climbing = first_coefficients(rising, -acceleration[2] - rising * by_climb[2], cell)
    speeds = 0.5 * (low + high) + 0.5 * (high - low) * gain
    climbs = _KEPT * jnp.minimum(limits.climb_rate_max, 0.7 * limits.speed_min) * climb
    total = jnp.minimum(limits.load_factor_max, 1e3)
    sideways = jnp.minimum(jnp.tan(limits.bank_max), jnp.sqrt(jnp.maximum(total**2 - 1.0, 1e-4)))
    rates = airspace.gravity * sideways / (0.5 * (low + high)) * turn
    begun, following = first_coefficients(jnp.arctan2(velocity[1], velocity[0]), turning, cell)
    headings = following + jnp.concatenate([jnp.zeros(1), jnp.cumsum(cell * rates)])
    return Steering(
        duration,
        altitude_0,
        traveller.position_n[:2],
        jnp.concatenate([begun[None], headings]),
        jnp.concatenate([jnp.stack(begun_climbing), climbs]),
        jnp.concatenate([jnp.stack(first_coefficients(speed, gaining, cell)), speeds]),
    )


def _integrated(rates: Float[Array, "instants *n"], cell: Scalar) -> Float[Array, "instants *n"]:
    """Integrals up to the ends and middles of the splines' intervals, of rates there: Simpson's rule."""
    begin, middle, end = rates[:-1:2], rates[1::2], rates[2::2]
    whole = cell / 6.0 * (begin + 4.0 * middle + end)
    half = cell / 24.0 * (5.0 * begin + 8.0 * middle - end)
    ends = jnp.concatenate([jnp.zeros_like(whole[:1]), jnp.cumsum(whole, axis=0)])
    both = jnp.stack([ends[:-1], ends[:-1] + half], axis=1)
    return jnp.concatenate([both.reshape(-1, *rates.shape[1:]), ends[-1:]])


def _signals(task: _Task, x: Float[Array, " unknowns"]) -> _Signals:
    """At the ends and middles of the splines' intervals: what is linear in between is greatest at an end."""
    steering = _steering(task, x)
    now = steered(steering, np.array([0.0, 0.5]))
    last = jax.tree.map(lambda leaf: leaf[-1:], steered(steering, np.ones(1)))
    now = jax.tree.map(lambda a, b: jnp.concatenate([a, b]), now, last)
    altitude = steering.altitude_0 + _integrated(now.climb, steering.cell)
    return _Signals(now.heading, now.heading_dot, now.climb, now.climb_dot, now.speed, now.speed_dot, altitude)


def _passed(task: _Task, share: Scalar, now: _Signals) -> tuple[Float[Array, "4"], Float[Array, "2"]]:
    """At one instant: what passes a share of limits, each in its unit; the velocity over the ground, level, m/s."""
    limits, gravity = task.traveller.limits, task.airspace.gravity
    (wind,), (wind_dot,) = wind_along(task.airspace.wind, now.altitude[None], now.climb[None])
    climb, climb_dot = now.climb + wind[2], now.climb_dot + wind_dot[2]  # through the air
    level = jnp.sqrt(jnp.maximum(now.speed**2 - climb**2, 1.0))
    level_dot = (now.speed * now.speed_dot - climb * climb_dot) / level
    cosine, sine = jnp.cos(now.heading), jnp.sin(now.heading)
    forward = level_dot + cosine * wind_dot[0] + sine * wind_dot[1]
    side = level * now.heading_dot + cosine * wind_dot[1] - sine * wind_dot[0]
    up = gravity + now.climb_dot
    lift = (level * up - climb * forward) / now.speed
    along = (level * forward + climb * up) / now.speed
    load = jnp.sqrt(side**2 + lift**2 + 1e-6) - share * jnp.minimum(limits.load_factor_max, 1e3) * gravity
    fast, slow = share * limits.acceleration_max, share * limits.deceleration_max
    low, high = limits.altitude_min + _RESERVE_UP_M, limits.altitude_max - _RESERVE_UP_M
    passed = [
        (jnp.abs(side) - share * lift * jnp.tan(limits.bank_max)) / _FORCE,
        load / _FORCE,
        jnp.maximum(along - fast, -along - slow) / _FORCE,
        jnp.maximum(low - now.altitude, now.altitude - high) / _HEIGHT_M,
    ]
    return jnp.maximum(jnp.stack(passed), 0.0), jnp.stack([level * cosine + wind[0], level * sine + wind[1]])


def _inside(task: _Task, time: Scalar, place: Float[Array, "2"], altitude: Scalar) -> Scalar:
    """How deep a place is inside closed volumes, summed over them."""
    limits, volumes = task.traveller.limits, task.airspace.keep_outs
    off = place[None, :] - volumes.position_n - time * volumes.velocity_n
    aside = volumes.radius + _RESERVE_M - jnp.sqrt(jnp.sum(off**2, axis=1) + 1.0)
    under, over = altitude - volumes.bottom + _RESERVE_UP_M, volumes.top + _RESERVE_UP_M - altitude
    # A way out that leads below the floor or above the ceiling is none.
    under = jnp.where(volumes.bottom > limits.altitude_min + 50.0, _UP_WEIGHT * under, jnp.inf)
    over = jnp.where(volumes.top < limits.altitude_max - 50.0, _UP_WEIGHT * over, jnp.inf)
    deep = jnp.minimum(aside, jnp.minimum(under, over))
    return jnp.sum(jnp.maximum(deep, 0.0)) / _INSIDE_M


def _arrival(
    task: _Task, place: Float[Array, "2"], altitude: Scalar, velocity: Float[Array, "2"], climb: Scalar
) -> Float[Array, "5"]:
    """By how much the arrival is missed: place, m; and direction, parts of a radian."""
    traveller = task.traveller
    rendezvous = traveller.rendezvous
    meeting = traveller.goal_position_n + traveller.goal_velocity_n * task.duration + rendezvous.stand_off_n
    cosine, sine = jnp.cos(rendezvous.course), jnp.sin(rendezvous.course)
    ahead, aside = velocity[0] * cosine + velocity[1] * sine, velocity[1] * cosine - velocity[0] * sine
    level = jnp.sqrt(jnp.sum(velocity**2) + 1.0)
    steep = (climb - level * jnp.tan(rendezvous.path_angle)) / level
    return jnp.stack(
        [
            (place[0] - meeting[0]) / _PLACE_M,
            (place[1] - meeting[1]) / _PLACE_M,
            (altitude + meeting[2]) / _PLACE_M,
            jnp.where(rendezvous.course_prescribed, jnp.arctan2(aside, ahead) / _DIRECTION, 0.0),
            jnp.where(rendezvous.path_angle_prescribed, steep / _DIRECTION, 0.0),
        ]
    )


def _missed_nearly(
    task: _Task, slopes: _Signals, share: Scalar, x: Float[Array, " unknowns"]
) -> tuple[Float[Array, " rows"], Float[Array, "rows unknowns"]]:
    """All that is missed or passed, by a coarse quadrature, and how it changes with the unknowns.

    What is passed at an instant depends on seven signals there, each of which is linear in the unknowns, with given
    slopes: the derivatives are composed of those two.
    """
    now = _signals(task, x)
    one = functools.partial(_passed, task, share)
    passed, velocity = jax.vmap(one)(now)
    by_signal = jax.vmap(jax.jacfwd(one))(now)

    def composed(parts: _Signals) -> Array:
        """Slopes of what those are slopes of, with the unknowns: (instant, what, unknown)."""
        pairs = zip(parts, slopes, strict=True)
        return functools.reduce(jnp.add, (part[:, :, None] * slope[:, None, :] for part, slope in pairs))

    passed_by, velocity_by = (composed(parts) for parts in by_signal)
    cell = task.duration / CELLS
    places = task.traveller.position_n[None, :2] + _integrated(velocity, cell)
    places_by = _integrated(velocity_by, cell)
    last = _Signals(*(leaf[-1] for leaf in now))
    state = (places[-1], last.altitude, velocity[-1], last.climb)
    arrival = _arrival(task, *state)
    by_place, by_altitude, by_velocity, by_climb = jax.jacfwd(_arrival, argnums=(1, 2, 3, 4))(task, *state)
    arrival_by = (
        by_place @ places_by[-1]
        + by_velocity @ velocity_by[-1]
        + by_climb[:, None] * slopes.climb[-1][None, :]
        + by_altitude[:, None] * slopes.altitude[-1][None, :]
    )
    beyond = jnp.maximum(jnp.abs(x[CELLS:]) - 1.0, 0.0) / _RANGE
    beyond_by = jnp.eye(_UNKNOWNS)[CELLS:] * jnp.where(beyond > 0.0, jnp.sign(x[CELLS:]), 0.0)[:, None] / _RANGE
    rows = [arrival, passed.ravel(), beyond]
    rows_by = [arrival_by, passed_by.reshape(-1, _UNKNOWNS), beyond_by]
    if task.airspace.keep_outs.radius.shape[0]:
        times = 0.5 * cell * jnp.arange(2 * CELLS + 1)
        deep = functools.partial(_inside, task)
        rows.append(jax.vmap(deep)(times, places, now.altitude))
        by_place, by_height = jax.vmap(jax.jacfwd(deep, argnums=(1, 2)))(times, places, now.altitude)
        rows_by.append(jnp.einsum("ij,ijk->ik", by_place, places_by) + by_height[:, None] * slopes.altitude)
    return jnp.concatenate(rows), jnp.concatenate(rows_by)


class _Fit(NamedTuple):
    """How far a least-squares search has come; `share`: of the limits, that it looks for."""

    share: Scalar
    best: Float[Array, " unknowns"]
    trial: Float[Array, " unknowns"]
    cost: Scalar
    normal: Float[Array, "unknowns unknowns"]
    right: Float[Array, " unknowns"]
    damping: Scalar


def _begin(share: Scalar, x: Float[Array, " unknowns"]) -> _Fit:
    square = jnp.zeros((_UNKNOWNS, _UNKNOWNS))
    return _Fit(share, x, x, jnp.asarray(jnp.inf), square, jnp.zeros(_UNKNOWNS), jnp.asarray(jnp.nan))


def _fitted(task: _Task, slopes: _Signals, at: _Fit) -> _Fit:
    """One damped step (Levenberg and Marquardt)."""
    missed, jacobian = _missed_nearly(task, slopes, at.share, at.trial)
    cost = jnp.sum(missed**2)
    better = cost < at.cost
    best = jnp.where(better, at.trial, at.best)
    normal = jnp.where(better, jacobian.T @ jacobian, at.normal)
    right = jnp.where(better, jacobian.T @ missed, at.right)
    damping = jnp.where(jnp.isnan(at.damping), 1e-2 * cost, at.damping * jnp.where(better, 0.2, 5.0))
    damping = jnp.clip(damping, 1e-9, 1e9)
    factor = jax.scipy.linalg.cho_factor(normal + damping * jnp.eye(_UNKNOWNS))
    return _Fit(
        at.share,
        best,
        best - jax.scipy.linalg.cho_solve(factor, right),
        jnp.where(better, cost, at.cost),
        normal,
        right,
        damping,
    )


def _first_guesses(task: _Task, count: int, seed: int = 0) -> Float[Array, "starts unknowns"]:
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
    task = jax.lax.stop_gradient(_Task(traveller, airspace, jnp.asarray(duration, dtype=float)))
    slopes = jax.jacfwd(functools.partial(_signals, task))(jnp.zeros(_UNKNOWNS))

    def fitted(number: int, fits: _Fit) -> _Fit:
        return jax.lax.fori_loop(
            0, number, lambda _, all_: jax.vmap(lambda one: _fitted(task, slopes, one))(all_), fits
        )

    def nearest(fits: _Fit, count: int) -> _Fit:
        best = jax.lax.top_k(-fits.cost, count)[1]
        return jax.tree.map(lambda leaf: leaf[best], fits)

    shares = jnp.asarray(np.resize(_LOOKED_FOR, starts))
    fits = fitted(_FIRST_STEPS, jax.vmap(_begin)(shares, _first_guesses(task, starts)))
    fits = nearest(fitted(_STEPS, nearest(fits, min(_GOING_ON * kept, starts))), kept)

    # A coarse quadrature arrives nearly: a few least steps with that of the path itself.
    def arrived(x: Float[Array, " unknowns"]) -> Array:
        flown = fly(_steering(task, x), airspace.wind, ticks)
        last = flown.at_ends.through(flown.winds_n, flown.winds_dot_n).level_velocity[:, -1]
        place, climb = flown.level_n[-1] + flown.drifts_n[-1, :2], flown.at_ends.climb[-1]
        return _arrival(task, place, flown.altitudes[-1], last + flown.winds_n[-1, :2], climb)

    def missed_at(x: Float[Array, " unknowns"], about: object) -> Missed:
        return arrived(x), jax.jacrev(arrived)(x)

    again = jax.vmap(lambda x: begin_steps((), x, 5))(fits.best)
    solved = least_steps(missed_at, _LONGEST_STEP, _LAST_STEPS, again).best

    def deliver(x: Float[Array, " unknowns"]) -> Motions:
        steering = _steering(task, x)
        path, flown = steered_path(0.0, steering, airspace.wind, ticks, ticks + PIECES + KINKS)
        bounds = path_bounds(path, airspace.wind, airspace.gravity)
        met = jnp.max(jnp.abs(arrived(x))) * _PLACE_M <= _SOLVED * task.duration * traveller.limits.speed_max
        return Motions(
            path,
            jnp.all(excess(bounds, traveller.limits) <= 0.0) & met & (traveller.side == 0),
            jnp.mean(flown.at_ends.through(flown.winds_n, flown.winds_dot_n).level[:-1]) * task.duration,
            jnp.sum(jnp.abs(jnp.diff(steering.headings))),
            jnp.mean(flown.at_ends.speed[:-1]),
            bounds.cell_acceleration,
        )

    return jax.vmap(deliver)(solved)
