"""How an aircraft moves at its arrival, as far as that is prescribed."""

import equinox as eqx
import jax
import jax.numpy as jnp

from anser.environment import AbstractWind
from anser.planning.certified.task import AircraftTask
from anser.planning.commands import polar
from anser.planning.rendezvous import final_air_velocity
from anser.shapes import Flag, Scalar, ScalarLike

_LEVEL_MIN = 1.0  # m/s: keeps the horizontal airspeed of a vertical arrival finite; such an arrival is not attainable


class ArrivalMotion(eqx.Module):
    """Motion at the arrival.

    Attributes
    ----------
    climb
        Vertical speed over the ground, up positive, m/s: that of the prescribed path angle, else the goal's.
    heading
        Of the velocity through the air, rad; where it is free, that along the straight line over the ground.
    heading_free
        Whether any heading will do.
    attainable
        Whether what is prescribed can be flown at this airspeed in this wind.
    """

    climb: Scalar
    heading: Scalar
    heading_free: Flag
    attainable: Flag


def arrival_motion(task: AircraftTask, wind: AbstractWind, duration: ScalarLike, speed: ScalarLike) -> ArrivalMotion:
    """Motion at the arrival after a duration (s) at an airspeed (m/s).

    In wind the climb rate of a prescribed path angle depends on the course over the ground. Where no course is
    prescribed with it, it is that of the straight line from here to the rendezvous, as seen from the ground.
    """
    rendezvous = task.rendezvous
    meeting = task.meeting_n(duration)
    line = (meeting - task.position_n) * jnp.array([1.0, 1.0, 0.0])
    blowing = wind.at(jnp.stack([jnp.zeros(()), jnp.zeros(()), meeting[2]]), duration)
    steep = rendezvous.path_angle_prescribed
    windy = jnp.any(blowing[:2] != 0.0)
    asked = eqx.tree_at(
        lambda r: (r.course, r.course_prescribed),
        rendezvous,
        (
            jnp.where(rendezvous.course_prescribed, rendezvous.course, polar(line, jnp.zeros(3)).chi),
            rendezvous.course_prescribed | (steep & windy),
        ),
    )
    # Without a prescribed angle the aircraft climbs as its goal does, which takes part of the airspeed.
    through = task.goal_velocity_n[2] - blowing[2]
    square = speed**2 - through**2
    level = jnp.sqrt(jnp.maximum(square, _LEVEL_MIN**2))
    flat = blowing * jnp.array([1.0, 1.0, 0.0])
    air, attainable = final_air_velocity(asked, line, jnp.where(steep, speed, level), jnp.where(steep, blowing, flat))
    return ArrivalMotion(
        climb=jnp.where(steep, -(air + blowing)[2], -task.goal_velocity_n[2]),
        heading=polar(air, jnp.zeros(3)).chi,
        heading_free=~asked.course_prescribed,
        attainable=attainable & (steep | (square > _LEVEL_MIN**2)),
    )


def climb_acceleration(task: AircraftTask, wind: AbstractWind) -> Scalar:
    """Rate of the first vertical speed over the ground, up positive, m/s^2: the wind's share included."""
    velocity_n = task.air_velocity_n + wind.at(task.position_n, 0.0)
    _, wind_dot_n = jax.jvp(lambda p: wind.at(p, 0.0), (task.position_n,), (velocity_n,))
    return -task.air_acceleration_n[2] - wind_dot_n[2]
