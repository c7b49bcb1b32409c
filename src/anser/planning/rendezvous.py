"""Where, how and how soon at the earliest an aircraft meets its goal."""

import equinox as eqx
import jax.numpy as jnp

from anser.numerics import as_array
from anser.planning.commands import polar
from anser.planning.vectors import norm, root, unit
from anser.shapes import Flag, Scalar, ScalarLike, Vector3


class Rendezvous(eqx.Module):
    """How an aircraft is to meet its goal; arrays throughout, so that other numbers do not recompile."""

    stand_off_n: Vector3
    """From the goal to the rendezvous, NED, m (300 m above the goal is (0, 0, -300))."""
    course: Scalar
    """Prescribed course over the ground at arrival, rad."""
    course_prescribed: Flag
    path_angle: Scalar
    """Prescribed path angle over the ground at arrival, up positive, rad."""
    path_angle_prescribed: Flag


def make_rendezvous(
    stand_off_n: Vector3, course: ScalarLike | None = None, path_angle: ScalarLike | None = None
) -> Rendezvous:
    """Rendezvous with the final course and path angle (over the ground, rad) prescribed where given."""
    return Rendezvous(
        stand_off_n,
        as_array(0.0 if course is None else course),
        as_array(course is not None, bool),
        as_array(0.0 if path_angle is None else path_angle),
        as_array(path_angle is not None, bool),
    )


def time_to_go(relative_position: Vector3, relative_velocity: Vector3, speed: ScalarLike) -> tuple[Scalar, Flag]:
    """Shortest time in which a point of given speed can meet a steadily moving one on a straight line.

    Parameters
    ----------
    relative_position
        From the aircraft to the moving point, NED, m.
    relative_velocity
        Velocity of the moving point relative to the air, NED, m/s.
    speed
        Airspeed, m/s.

    Returns
    -------
    Time to go, s, and whether one exists. Where the goal outruns the aircraft, the time is a finite stand-in: the
    range over the sum of both speeds.

    Notes
    -----
    Theory section 7: (W^2 - V^2) t^2 + 2 (R.W) t + R^2 = 0, smallest positive root, in the form that does not cancel
    (section 9, item 5 for the sign of R.W).
    """
    a = jnp.sum(relative_velocity * relative_velocity) - speed**2
    b = jnp.sum(relative_position * relative_velocity)
    c = jnp.sum(relative_position * relative_position)
    discriminant = b * b - a * c
    exists = (a < 0.0) | ((b < 0.0) & (discriminant >= 0.0))
    between = root(discriminant)
    away = b > 0.0
    divisor = jnp.where(away, -a, between - b)
    usable = exists & (divisor > 0.0)
    time = jnp.where(away, between + b, c) / jnp.where(usable, divisor, 1.0)
    stand_in = norm(relative_position) / (speed + norm(relative_velocity))
    return jnp.where(usable, time, stand_in), exists


def final_air_velocity(
    rendezvous: Rendezvous, line_n: Vector3, speed: ScalarLike, wind_n: Vector3
) -> tuple[Vector3, Flag]:
    """Velocity relative to the air at arrival.

    Parameters
    ----------
    rendezvous
        What is prescribed.
    line_n
        From start to rendezvous in the frame that drifts with the air, NED, m: the direction of arrival where nothing
        is prescribed. Where one of course and path angle is, the other is that of this arrival seen from the ground.
    speed
        Airspeed at arrival, m/s.
    wind_n
        Steady wind, NED, m/s.

    Returns
    -------
    Velocity, NED, m/s, always of the given length, and whether the prescribed direction over the ground can be flown:
    the ground speed g > 0 solves |g d - wind| = speed. Where none does, the velocity is that of the free arrival.
    """
    free = jnp.asarray(speed) * unit(line_n, jnp.array([1.0, 0.0, 0.0]))
    seen = polar(free + wind_n, jnp.zeros(3))
    chi = jnp.where(rendezvous.course_prescribed, rendezvous.course, seen.chi)
    gamma = jnp.where(rendezvous.path_angle_prescribed, rendezvous.path_angle, seen.gamma)
    along = jnp.stack([jnp.cos(gamma) * jnp.cos(chi), jnp.cos(gamma) * jnp.sin(chi), -jnp.sin(gamma)])
    tail = jnp.sum(along * wind_n)
    discriminant = tail * tail - jnp.sum(wind_n * wind_n) + speed**2
    solvable = discriminant > 0.0
    ground_speed = tail + jnp.sqrt(jnp.where(solvable, discriminant, 1.0))
    prescribed = rendezvous.course_prescribed | rendezvous.path_angle_prescribed
    attainable = ~prescribed | (solvable & (ground_speed > 0.0))
    return jnp.where(prescribed & attainable, ground_speed * along - wind_n, free), attainable
