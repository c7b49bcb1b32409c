"""Cases shared by the planning tests: published figures and generic boundary data."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import strategies as st

from anser.parts import Rendezvous, make_rendezvous
from anser.planning.published.coordination import PlanningTask, coordinate
from anser.planning.published.trajectory import arc_length, fit_trajectory
from anser.verification import polynomial_paths

angles = st.floats(-3.1, 3.1)
path_angles = st.floats(-0.6, 0.6)
SPEED = 150.0
fit = jax.jit(fit_trajectory)
published_path = jax.jit(polynomial_paths.published_path)
_stand_offs = jax.jit(jax.vmap(make_rendezvous))
# One compiled planner per fleet size for all tests.
_plan = jax.jit(coordinate)


def velocity(speed, course, path_angle=0.0):
    """Velocity NED from speed, course and path angle (up positive)."""
    level = speed * np.cos(path_angle)
    return jnp.asarray(np.stack([level * np.cos(course), level * np.sin(course), -speed * np.sin(path_angle)]))


@st.composite
def trajectories(draw):
    """Generic nominal trajectories: 0.5 to 20 km, 150 m/s at the ends, any courses."""
    line = draw(st.floats(500.0, 20000.0)) * velocity(1.0, draw(angles), draw(path_angles))
    duration = float(jnp.linalg.norm(line)) / 150.0 * draw(st.floats(0.8, 1.6))
    start = jnp.array([draw(st.floats(-1e4, 1e4)), draw(st.floats(-1e4, 1e4)), draw(st.floats(-3e3, 0.0))])
    end_velocities = [velocity(150.0, draw(angles), draw(path_angles)) for _ in range(2)]
    return fit(draw(st.floats(0.0, 100.0)), duration, start, end_velocities[0], start + line, end_velocities[1])


@st.composite
def flyable(draw):
    """Bent paths typical of fleets: 2 to 20 km, end courses within 75 deg of the line; |dr/ds| above half its mean."""
    distance, course = draw(st.floats(2e3, 2e4)), draw(angles)
    line = distance * velocity(1.0, course, draw(st.floats(-0.15, 0.15)))
    duration = distance / 150.0 * draw(st.floats(0.9, 1.3))
    end_velocities = [
        velocity(150.0, course + draw(st.floats(-1.3, 1.3)), draw(st.floats(-0.2, 0.2))) for _ in range(2)
    ]
    start = jnp.array([draw(st.floats(-1e4, 1e4)), draw(st.floats(-1e4, 1e4)), -3000.0])
    bend = distance * draw(st.floats(-2.0, 2.0))
    return fit(draw(st.floats(0.0, 100.0)), duration, start, end_velocities[0], start + line, end_velocities[1], bend)


def plan_at(time, tasks, sides, even=False, speed=SPEED):
    """A fleet's plan; every argument as an array of fixed type, so that the planner compiles once."""
    time, sides, speed = (jnp.asarray(x, dtype=float) for x in (time, sides, speed))
    return _plan(time, tasks, speed, sides, jnp.asarray(even))


def stand_offs(count: int, height: float = 300.0) -> Rendezvous:
    """Unconstrained arrivals straight above each goal."""
    return _stand_offs(jnp.asarray(np.tile([[0.0, 0.0, -height]], (count, 1))))


def fleet(
    positions_n, air_velocities_n, goal_positions_n, goal_velocities_n, rendezvous=None, wind_n=None, deceleration=1.0
):
    """A fleet's planning task at its first plan."""
    count = positions_n.shape[0]
    return PlanningTask(
        position_n=positions_n,
        air_velocity_n=air_velocities_n,
        goal_position_n=goal_positions_n,
        goal_velocity_n=goal_velocities_n,
        rendezvous=stand_offs(count) if rendezvous is None else rendezvous,
        wind_n=jnp.zeros((count, 3)) if wind_n is None else jnp.tile(jnp.asarray(wind_n), (count, 1)),
        origin_n=positions_n,
        path_length_deficit=jnp.zeros(count),
        deceleration=jnp.full(count, deceleration, dtype=float),
        active=jnp.ones(count, dtype=bool),
    )


def in_wind(tasks: PlanningTask, wind_n) -> PlanningTask:
    """The same tasks in moving air, seen from the ground; goals drift with the air."""
    wind = jnp.asarray(wind_n)
    return replace(
        tasks, goal_velocity_n=tasks.goal_velocity_n + wind[None], wind_n=jnp.tile(wind, (tasks.wind_n.shape[0], 1))
    )


def published_fleet() -> PlanningTask:
    """Theory section 8, three aircraft, 300 m above goals on the surface."""
    courses, goal_courses = np.deg2rad([-90.0, 20.0, 0.0]), np.deg2rad([0.0, 0.0, 90.0])
    return fleet(
        jnp.array([[1000.0, 9000.0, -1000.0], [-2000.0, -8000.0, -1500.0], [-6000.0, 5000.0, -1250.0]]),
        jnp.stack([velocity(150.0, course) for course in courses]),
        jnp.array([[100.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 100.0, 0.0]]),
        jnp.stack([velocity(v, course) for v, course in zip([25.0, 0.0, 15.0], goal_courses, strict=True)]),
    )


def random_fleet(seed: int, goal_speed_max: float, count: int = 3) -> PlanningTask:
    """Generic fleets within 20 km; 150 m/s; goals on the surface at up to the given speed."""
    rng = np.random.default_rng(seed)
    positions = np.column_stack([rng.uniform(-1e4, 1e4, (count, 2)), rng.uniform(-3000.0, -500.0, count)])
    goals = np.column_stack([rng.uniform(-1e4, 1e4, (count, 2)), np.zeros(count)])
    headings, goal_courses = rng.uniform(-np.pi, np.pi, (2, count))
    goal_speeds = goal_speed_max * rng.uniform(0.0, 1.0, count)
    return fleet(
        jnp.asarray(positions),
        jnp.asarray(150.0 * np.column_stack([np.cos(headings), np.sin(headings), 0.0 * headings])),
        jnp.asarray(goals),
        jnp.asarray(goal_speeds[:, None] * np.column_stack([np.cos(goal_courses), np.sin(goal_courses), 0 * headings])),
    )


def on_plan(plan, tasks: PlanningTask, time, elapsed, flown=None) -> PlanningTask:
    """Task of a fleet that has followed its plan exactly for a time, with goals moved as predicted."""
    states = along(plan.trajectories, time)
    if flown is None:
        flown = plan.lengths - rest_lengths(plan.trajectories, time)
    return replace(
        tasks,
        position_n=states[0],
        air_velocity_n=states[1],
        goal_position_n=tasks.goal_position_n + tasks.goal_velocity_n * elapsed,
        origin_n=tasks.position_n + tasks.wind_n * elapsed,
        path_length_deficit=plan.speed * elapsed - flown,
    )


position = jax.jit(lambda path, time: path.position_n(time))
ground_velocity = jax.jit(lambda path, time: path.velocity_n(time))
acceleration = jax.jit(lambda path, time: path.acceleration_n(time))
along = jax.jit(lambda paths, time: jax.vmap(lambda path: (path.position_n(time), path.air_velocity_n(time)))(paths))
rest_lengths = jax.jit(lambda paths, time: jax.vmap(lambda path: arc_length(path, path.clock(time).s))(paths))
lengths_of = jax.jit(jax.vmap(arc_length))
