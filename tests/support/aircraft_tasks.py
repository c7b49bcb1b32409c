"""A planning task of one aircraft, and an airspace without keep-outs."""

import jax.numpy as jnp

from anser.parts import make_rendezvous
from anser.planning import PathLimits, Separation
from anser.planning.certified.task import AircraftTask, Airspace, KeepOuts

SPEED_MAX, CLIMB_MAX = 200.0, 40.0


def aircraft_task(goal, moving=(0.0, 0.0, 0.0)):
    """At 2,000 m above the origin, flying north at 150 m/s; the rendezvous is 300 m above the goal."""
    return AircraftTask(
        position_n=jnp.array([0.0, 0.0, -2000.0]),
        air_velocity_n=jnp.array([150.0, 0.0, 0.0]),
        air_acceleration_n=jnp.zeros(3),
        goal_position_n=jnp.asarray(goal, dtype=float),
        goal_velocity_n=jnp.asarray(moving, dtype=float),
        rendezvous=make_rendezvous(jnp.array([0.0, 0.0, -300.0])),
        speed=jnp.asarray(150.0),
        side=jnp.asarray(0),
        limits=PathLimits(*(jnp.asarray(x) for x in (100.0, SPEED_MAX, 0.9, CLIMB_MAX, 200.0))),
        roll_rate_max=jnp.asarray(0.5),
        active=jnp.asarray(1.0),
    )


def no_keep_outs():
    """An empty stack of keep-outs."""
    return KeepOuts(*map(jnp.zeros, ((0, 2), (0, 2), 0, 0, 0)))


def airspace(wind, horizontal=0.0, vertical=0.0):
    """An airspace without keep-outs, with a required separation, m."""
    return Airspace(wind, jnp.asarray(9.81), Separation(jnp.asarray(horizontal), jnp.asarray(vertical)), no_keep_outs())
