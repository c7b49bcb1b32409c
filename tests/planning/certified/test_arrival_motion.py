"""Arrivals in wind: the delivered path has the prescribed course, path angle or climb."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.compiling.options import compiled_quickly
from anser.environment import SteadyWind
from anser.parts import Rendezvous
from anser.planning import PathLimits, Separation
from anser.planning.certified.candidates import deliver
from anser.planning.certified.detours import solve_detour
from anser.planning.certified.routes import route
from anser.planning.certified.task import AircraftTask, Airspace
from anser.planning.certified.timed_profiles import arrival_motion, speeds_for_mean, timed_profile
from support.aircraft_tasks import no_keep_outs
from support.certified_cases import GRAVITY, LAYERED, detours_of, number, picked

CASES, INTERVALS, SPEED = 24, 64, 140.0
NO_LIMITS = PathLimits(number(40.0), number(400.0), number(1.2), number(1e3), number(-1e5))


def made_tasks(seed, climbing, turning=0.0):
    """Stacked tasks: with a course, a path angle, or both, in turn; goals climb by up to `climbing` m/s."""
    rng = np.random.default_rng(seed)
    heading = rng.uniform(-np.pi, np.pi, CASES)
    zero = np.zeros(CASES)
    level = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    air_velocity = np.concatenate([SPEED * level, zero[:, None]], axis=1)
    across = np.stack([-level[:, 1], level[:, 0]], axis=1)
    course = rng.uniform(-np.pi, np.pi, CASES)
    distance = rng.uniform(9e3, 14e3, CASES)[:, None]
    goal = distance * np.stack([np.cos(course), np.sin(course)], axis=1)
    kind = np.arange(CASES) % 3
    return AircraftTask(
        position_n=jnp.asarray(np.concatenate([np.zeros((CASES, 2)), rng.uniform(-1900, -1100, (CASES, 1))], axis=1)),
        air_velocity_n=jnp.asarray(air_velocity - np.array([0.0, 0.0, 6.0])),
        air_acceleration_n=jnp.asarray(np.concatenate([turning * across, np.full((CASES, 1), 0.2)], axis=1)),
        goal_position_n=jnp.asarray(np.concatenate([goal, rng.uniform(-1700, -1300, (CASES, 1))], axis=1)),
        goal_velocity_n=jnp.asarray(rng.uniform(-1, 1, (CASES, 3)) * [15.0, 15.0, climbing]),
        rendezvous=Rendezvous(
            jnp.tile(jnp.array([0.0, 0.0, -300.0]), (CASES, 1)),
            jnp.asarray(rng.uniform(-np.pi, np.pi, CASES)),
            jnp.asarray(kind != 1),
            jnp.asarray(np.radians(rng.uniform(-6.0, 6.0, CASES))),
            jnp.asarray(kind != 0),
        ),
        speed=jnp.full(CASES, SPEED),
        side=jnp.zeros(CASES, dtype=int),
        limits=jax.tree.map(lambda leaf: jnp.full(CASES, leaf), NO_LIMITS),
        roll_rate_max=jnp.full(CASES, 0.5),
        active=jnp.ones(CASES),
    )


def in_wind(wind):
    return Airspace(wind, number(GRAVITY), Separation(number(0.0), number(0.0)), no_keep_outs())


motion_at = jax.jit(arrival_motion)


@compiled_quickly
def flown(tasks, wind):
    """For each task: whether the path is valid, and its first and last states through the air and of the drift."""

    def fly_task(task, detour):
        airspace = in_wind(wind)
        duration = number(1.35 * 12_000.0 / SPEED)
        speeds = speeds_for_mean(task, duration, SPEED)
        timed = timed_profile(task, airspace, duration, INTERVALS, jnp.zeros(()), speeds)
        solved = solve_detour(timed.endpoints, picked(timed.direct, 0), detour, timed.table.length)
        path = deliver(0.0, timed.table, route(timed.endpoints, solved))
        return timed.within_limits & solved.exists, path.states_n(0.0), path.states_n(duration)

    return jax.vmap(fly_task)(tasks, detours_of(np.zeros(CASES, dtype=int), np.ones(CASES)))


@pytest.mark.long
@pytest.mark.parametrize("wind", [SteadyWind(jnp.array([-20.0, 30.0, 0.0])), LAYERED], ids=["steady", "layered"])
def test_the_delivered_path_arrives_as_prescribed(wind):
    tasks = made_tasks(1, climbing=15.0)
    valid, _, final_states = (jax.tree.map(np.asarray, leaf) for leaf in flown(tasks, wind))
    assert valid.sum() > CASES // 2
    velocity = (final_states[0] + final_states[1])[:, 1]
    course = np.arctan2(velocity[:, 1], velocity[:, 0])
    angle = np.arctan2(-velocity[:, 2], np.hypot(velocity[:, 0], velocity[:, 1]))
    rendezvous = tasks.rendezvous
    course_error = (course - np.asarray(rendezvous.course) + np.pi) % (2 * np.pi) - np.pi
    by_course, by_angle = (
        valid & np.asarray(b) for b in (rendezvous.course_prescribed, rendezvous.path_angle_prescribed)
    )
    assert np.max(np.abs(course_error[by_course])) < 1e-6
    assert np.max(np.abs(angle - np.asarray(rendezvous.path_angle))[by_angle]) < 1e-6
    climbs = velocity[:, 2] - np.asarray(tasks.goal_velocity_n)[:, 2]
    assert np.max(np.abs(climbs[valid & ~np.asarray(rendezvous.path_angle_prescribed)])) < 1e-9


@pytest.mark.long
def test_the_path_continues_the_initial_acceleration():
    # Up where the wind rises with the altitude: its rate is part of the acceleration over the ground.
    tasks = made_tasks(2, climbing=0.0, turning=2.0)
    valid, initial_states, _ = (jax.tree.map(np.asarray, leaf) for leaf in flown(tasks, LAYERED))
    assert valid.sum() > CASES // 2
    initial = initial_states[0][valid]
    # Altitude exactly; in the plane but for the speed's share of a part in a million of the length.
    assert np.allclose(initial[:, 2, 2], np.asarray(tasks.air_acceleration_n)[valid, 2], rtol=0, atol=1e-9)
    assert np.allclose(initial[:, 1], np.asarray(tasks.air_velocity_n)[valid], rtol=0, atol=1e-3)


def test_an_arrival_against_a_strong_wind_is_not_attainable():
    task = picked(made_tasks(3, climbing=0.0), 0)
    strong = SteadyWind(jnp.array([0.0, 80.0, 0.0]))
    north = eqx.tree_at(lambda t: t.rendezvous.course, task, number(0.0))
    assert not motion_at(north, strong, 100.0, 71.0).attainable
    assert motion_at(north, strong, 100.0, 90.0).attainable
    free_course = eqx.tree_at(lambda t: t.rendezvous.course_prescribed, north, jnp.asarray(False))
    assert motion_at(free_course, strong, 100.0, 71.0).attainable
    lifted = eqx.tree_at(lambda t: t.goal_velocity_n, free_course, jnp.array([0.0, 0.0, -72.0]))
    assert not motion_at(lifted, strong, 100.0, 71.0).attainable


def test_the_heading_is_free_without_a_course_unless_wind_and_path_angle_determine_it():
    angled = picked(made_tasks(4, climbing=0.0), 1)
    calm, windy = (SteadyWind(jnp.array([0.0, east, 0.0])) for east in (0.0, 10.0))
    assert motion_at(angled, calm, 100.0, SPEED).heading_free
    assert not motion_at(angled, windy, 100.0, SPEED).heading_free
    free_angle = eqx.tree_at(lambda t: t.rendezvous.path_angle_prescribed, angled, jnp.asarray(False))
    assert motion_at(free_angle, windy, 100.0, SPEED).heading_free


def test_gradients_are_finite():
    task = eqx.tree_at(lambda t: t.goal_position_n, picked(made_tasks(5, climbing=5.0), 1), jnp.zeros(3))
    at_rest = eqx.tree_at(lambda t: (t.position_n, t.goal_velocity_n), task, (jnp.zeros(3), jnp.zeros(3)))

    def climb(speed):
        motion = arrival_motion(at_rest, LAYERED, 100.0, speed)
        return motion.climb + motion.heading

    assert np.isfinite(jax.jit(jax.grad(climb))(SPEED))
