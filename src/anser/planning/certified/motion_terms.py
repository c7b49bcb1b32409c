"""What a steering misses and passes, and how that changes with it: the equations behind free motions.

Everything at an instant depends on seven signals, each linear in the unknowns; places are integrals of what does.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.planning.certified.request import Airspace, Traveller
from anser.planning.certified.steering import CELLS, Steering, first_coefficients, steered, wind_along
from anser.shapes import Scalar

UNKNOWNS = 3 * CELLS
"""Parts of what the limits allow, -1 to 1: turning, climb, airspeed, at the ends of the splines' intervals."""
PLACE_M = 100.0
"""What `arrival_missed` takes for 1, m."""
_DIRECTION, _FORCE, _HEIGHT_M, _INSIDE_M, _RANGE = 0.05, 1.0, 50.0, 200.0, 0.1
"""What weighs as much: of the direction, rad; beyond a limit, m/s^2, m; in a volume, m; beyond -1 to 1."""
_KEPT = 0.998  # of the limits of airspeed and climb
_RESERVE_M, _RESERVE_UP_M = 30.0, 10.0
_UP_WEIGHT = 3.0  # metres aside that one metre up or down is worth, to get out of a closed volume


class MotionTask(NamedTuple):
    """Who flies, where, and how long, s."""

    traveller: Traveller
    airspace: Airspace
    duration: Scalar


class Signals(NamedTuple):
    """What steering does at some instants; each follows linearly from the unknowns."""

    heading: Array
    heading_dot: Array
    climb: Array
    climb_dot: Array
    speed: Array
    speed_dot: Array
    altitude: Array


def steering_of(task: MotionTask, x: Float[Array, " unknowns"]) -> Steering:
    """The steering that unknowns stand for: parts of what airspeed, climb and bank limits allow, -1 to 1."""
    traveller, airspace, duration = task
    limits, cell = traveller.limits, duration / CELLS
    velocity, acceleration = traveller.air_velocity_n, traveller.air_acceleration_n
    speed = jnp.sqrt(jnp.sum(velocity**2))
    square = jnp.maximum(jnp.sum(velocity[:2] ** 2), 1.0)
    turning = (velocity[0] * acceleration[1] - velocity[1] * acceleration[0]) / square
    gaining = jnp.sum(velocity * acceleration) / jnp.maximum(speed, 1.0)
    # Where no airspeed is too high, twice the preferred one is enough to look at.
    high = jnp.where(jnp.isfinite(limits.speed_max), limits.speed_max, 2.0 * traveller.speed)
    low, high = (2.0 - _KEPT) * limits.speed_min, _KEPT * high
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


def signals_of(task: MotionTask, x: Float[Array, " unknowns"]) -> Signals:
    """At the ends and middles of the splines' intervals: what is linear in between is greatest at an end."""
    steering = steering_of(task, x)
    now = steered(steering, np.array([0.0, 0.5]))
    last = jax.tree.map(lambda leaf: leaf[-1:], steered(steering, np.ones(1)))
    now = jax.tree.map(lambda a, b: jnp.concatenate([a, b]), now, last)
    altitude = steering.altitude_0 + _integrated(now.climb, steering.cell)
    return Signals(now.heading, now.heading_dot, now.climb, now.climb_dot, now.speed, now.speed_dot, altitude)


def _passed(task: MotionTask, share: Scalar, now: Signals) -> tuple[Float[Array, "4"], Float[Array, "2"]]:
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


def _inside(task: MotionTask, time: Scalar, place: Float[Array, "2"], altitude: Scalar) -> Scalar:
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


def arrival_missed(
    task: MotionTask, place: Float[Array, "2"], altitude: Scalar, velocity: Float[Array, "2"], climb: Scalar
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
            (place[0] - meeting[0]) / PLACE_M,
            (place[1] - meeting[1]) / PLACE_M,
            (altitude + meeting[2]) / PLACE_M,
            jnp.where(rendezvous.course_prescribed, jnp.arctan2(aside, ahead) / _DIRECTION, 0.0),
            jnp.where(rendezvous.path_angle_prescribed, steep / _DIRECTION, 0.0),
        ]
    )


def missed_nearly(
    task: MotionTask, slopes: Signals, share: Scalar, x: Float[Array, " unknowns"]
) -> tuple[Float[Array, " rows"], Float[Array, "rows unknowns"]]:
    """All that is missed or passed, by a coarse quadrature, and how it changes with the unknowns.

    What is passed at an instant depends on seven signals there, each of which is linear in the unknowns, with given
    slopes: the derivatives are composed of those two.
    """
    now = signals_of(task, x)
    one = functools.partial(_passed, task, share)
    passed, velocity = jax.vmap(one)(now)
    by_signal = jax.vmap(jax.jacfwd(one))(now)

    def composed(parts: Signals) -> Array:
        """Slopes of what those are slopes of, with the unknowns: (instant, what, unknown)."""
        pairs = zip(parts, slopes, strict=True)
        return functools.reduce(jnp.add, (part[:, :, None] * slope[:, None, :] for part, slope in pairs))

    passed_by, velocity_by = (composed(parts) for parts in by_signal)
    cell = task.duration / CELLS
    places = task.traveller.position_n[None, :2] + _integrated(velocity, cell)
    places_by = _integrated(velocity_by, cell)
    last = Signals(*(leaf[-1] for leaf in now))
    state = (places[-1], last.altitude, velocity[-1], last.climb)
    arrival = arrival_missed(task, *state)
    by_place, by_altitude, by_velocity, by_climb = jax.jacfwd(arrival_missed, argnums=(1, 2, 3, 4))(task, *state)
    arrival_by = (
        by_place @ places_by[-1]
        + by_velocity @ velocity_by[-1]
        + by_climb[:, None] * slopes.climb[-1][None, :]
        + by_altitude[:, None] * slopes.altitude[-1][None, :]
    )
    beyond = jnp.maximum(jnp.abs(x[CELLS:]) - 1.0, 0.0) / _RANGE
    beyond_by = jnp.eye(UNKNOWNS)[CELLS:] * jnp.where(beyond > 0.0, jnp.sign(x[CELLS:]), 0.0)[:, None] / _RANGE
    rows = [arrival, passed.ravel(), beyond]
    rows_by = [arrival_by, passed_by.reshape(-1, UNKNOWNS), beyond_by]
    if task.airspace.keep_outs.radius.shape[0]:
        times = 0.5 * cell * jnp.arange(2 * CELLS + 1)
        deep = functools.partial(_inside, task)
        rows.append(jax.vmap(deep)(times, places, now.altitude))
        by_place, by_height = jax.vmap(jax.jacfwd(deep, argnums=(1, 2)))(times, places, now.altitude)
        rows_by.append(jnp.einsum("ij,ijk->ik", by_place, places_by) + by_height[:, None] * slopes.altitude)
    return jnp.concatenate(rows), jnp.concatenate(rows_by)
