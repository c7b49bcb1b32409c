"""Line of sight to a goal and its inverse (theory section 7)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from anser.parts.perception import goal_from_line_of_sight, measure_line_of_sight

coordinates = st.floats(-2e4, 2e4)
fast = st.floats(-200.0, 200.0)
measured = jax.jit(measure_line_of_sight)
recovered = jax.jit(goal_from_line_of_sight)
jacobians = jax.jit(jax.jacrev(measure_line_of_sight, argnums=(0, 1, 2, 3)))
along_time = jax.jit(lambda v, goal, w: jax.jacfwd(lambda t: measure_line_of_sight(t * v, v, goal + t * w, w))(0.0))


def vector(kind):
    return st.tuples(kind, kind, kind).map(np.array)


@settings(deadline=None, max_examples=50)
@given(position_n=vector(coordinates), v=vector(fast), goal=vector(coordinates), w=vector(fast))
@example(position_n=np.array([0.0, 0.0, 2113.0]), v=np.zeros(3), goal=np.array([0.0, 2.112e-9, 0.0]), w=np.zeros(3))
def test_goal_is_recovered_exactly(position_n, v, goal, w):
    if np.linalg.norm(goal - position_n) < 1.0:
        goal = goal + 100.0
    position, velocity = recovered(measured(position_n, v, goal, w), position_n, v)
    # Rounding of 2e4 m and 200 m/s; below a ratio of 1e-12 of horizontal distance to range the azimuth is the motion's.
    vertical = 2e-12 * np.linalg.norm(goal - position_n)
    np.testing.assert_allclose(position, goal, atol=1e-10 + vertical)
    np.testing.assert_allclose(velocity, w, atol=1e-11)


@settings(deadline=None, max_examples=30)
@given(
    aside=st.one_of(st.just(0.0), st.floats(-14.0, 2.0).map(lambda x: 10.0**x)),
    direction=st.floats(-3.1, 3.1),
    below=st.sampled_from([300.0, -250.0]),
    v=vector(fast),
    w=vector(fast),
)
def test_the_recovered_goal_is_exact_close_to_the_vertical(aside, direction, below, v, w):
    position_n = np.array([0.0, 0.0, -300.0])
    goal = position_n + np.array([aside * np.cos(direction), aside * np.sin(direction), below])
    sight = measured(position_n, v, goal, w)
    position, velocity = recovered(sight, position_n, v)
    assert all(np.isfinite(leaf) for leaf in jax.tree.leaves(sight))
    # Below a ratio of 1e-12 of horizontal distance to range the azimuth is the motion's: 6e-10 m at 300 m.
    np.testing.assert_allclose(position, goal, atol=1e-9)
    np.testing.assert_allclose(velocity, w, atol=1e-11)


def test_signs_of_the_angles():
    position_n, still = jnp.array([1000.0, 2000.0, -500.0]), jnp.zeros(3)
    east_and_up = measured(position_n, still, position_n + jnp.array([0.0, 300.0, -400.0]), jnp.array([10.0, 0.0, 0.0]))
    np.testing.assert_allclose([east_and_up.range, east_and_up.azimuth], [500.0, np.pi / 2])
    np.testing.assert_allclose(east_and_up.elevation, np.arctan2(4.0, 3.0))
    # 10 m/s northward at 300 m to the east turns the sight anticlockwise.
    np.testing.assert_allclose(east_and_up.azimuth_rate, -10.0 / 300.0)
    below = measured(position_n, still, position_n + jnp.array([0.0, 0.0, 300.0]), jnp.array([0.0, 6.0, -3.0]))
    np.testing.assert_allclose([below.elevation, below.range_rate], [-np.pi / 2, -3.0])
    np.testing.assert_allclose(below.elevation_rate, 6.0 / 300.0)


@settings(deadline=None, max_examples=20)
@given(goal=vector(st.floats(300.0, 5e3)), v=vector(fast), w=vector(fast))
def test_rates_are_derivatives(goal, v, w):
    position_n = jnp.zeros(3)
    rates = along_time(v, goal, w)
    sight = measured(position_n, v, goal, w)
    np.testing.assert_allclose(sight.range_rate, rates.range, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(sight.azimuth_rate, rates.azimuth, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(sight.elevation_rate, rates.elevation, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("goal", [(0.0, 0.0, 0.0), (0.0, 0.0, 300.0), (0.0, 0.0, -300.0), (1e-9, 0.0, 300.0)])
@pytest.mark.parametrize("w", [(0.0, 0.0, 0.0), (20.0, -5.0, 0.0), (0.0, 0.0, 4.0)])
def test_gradients_are_finite_at_singular_points(goal, w):
    arguments = (jnp.zeros(3), jnp.zeros(3), jnp.array(goal), jnp.array(w))
    jacobian = jacobians(*arguments)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(jacobian))


def test_gradient_through_sensor_and_back_is_the_identity():
    position_n, v = jnp.array([10.0, -20.0, -800.0]), jnp.array([150.0, 3.0, -2.0])
    goal, w = jnp.array([2000.0, 900.0, 0.0]), jnp.array([5.0, 25.0, 0.0])
    there_and_back = jax.jacfwd(
        lambda g, u: goal_from_line_of_sight(measure_line_of_sight(position_n, v, g, u), position_n, v), argnums=(0, 1)
    )
    jacobian = jax.jit(there_and_back)(goal, w)
    np.testing.assert_allclose(jacobian[0][0], np.eye(3), atol=1e-12)
    np.testing.assert_allclose(jacobian[1][1], np.eye(3), atol=1e-12)
    np.testing.assert_allclose(jacobian[1][0], np.zeros((3, 3)), atol=1e-12)


def test_vmap():
    goals = jnp.array([[100.0, 0.0, 0.0], [0.0, 0.0, 0.0], [7.0, -900.0, 30.0]])
    position_n, v = jnp.array([0.0, 0.0, -300.0]), jnp.array([150.0, 0.0, 0.0])
    sights = jax.jit(jax.vmap(measure_line_of_sight, in_axes=(None, None, 0, None)))(position_n, v, goals, jnp.zeros(3))
    np.testing.assert_allclose(sights.range, np.linalg.norm(np.asarray(goals) - np.asarray(position_n), axis=1))
