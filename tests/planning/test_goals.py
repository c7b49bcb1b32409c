"""Motion of goals."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.planning import straight_goal, waypoint_goal
from anser.planning.goals import pad_waypoints

TIMES = [10.0, 25.0, 70.0]
POINTS = jnp.array([[0.0, 0.0, 0.0], [150.0, -75.0, 0.0], [150.0, 825.0, -9.0]])


def ship():
    return waypoint_goal(TIMES, POINTS, jnp.array([3.0, 4.0, 0.0]))


position = jax.jit(lambda goal, time: goal.position_n(time))
velocity = jax.jit(lambda goal, time: goal.velocity_n(time))
position_rate = jax.jit(lambda goal, time: jax.jacfwd(goal.position_n)(time))
slopes = jax.jit(jax.grad(lambda g, t: jnp.sum(g.position_n(t) ** 2 + g.velocity_n(t) ** 2), argnums=(0, 1)))


@settings(deadline=None, max_examples=20)
@given(time=st.floats(0.0, 500.0))
def test_a_straight_goal_moves_at_constant_velocity(time):
    start, speed = jnp.array([100.0, -40.0, 0.0]), jnp.array([25.0, -3.0, 0.5])
    goal = straight_goal(start, speed)
    np.testing.assert_allclose(position(goal, time), start + time * speed, rtol=1e-13, atol=1e-11)
    np.testing.assert_array_equal(velocity(goal, time), speed)


@settings(deadline=None, max_examples=30)
@given(time=st.floats(-20.0, 200.0))
def test_waypoint_motion_equals_interpolation(time):
    goal = ship()
    moved = np.array([3.0, 4.0, 0.0]) * max(time - 70.0, 0.0)
    expected = [np.interp(time, TIMES, np.asarray(POINTS)[:, axis]) + moved[axis] for axis in range(3)]
    # Sums in another order: rounding of some 1e3 m.
    np.testing.assert_allclose(position(goal, time), expected, atol=1e-11)
    np.testing.assert_allclose(position(pad_waypoints(goal, 7), time), expected, atol=1e-11)


def test_the_velocity_is_that_of_the_leg():
    goal = ship()
    expected = {
        5.0: [0, 0, 0],
        10.0: [10, -5, 0],
        24.9: [10, -5, 0],
        25.0: [0, 20, -0.2],
        70.0: [3, 4, 0],
        1e4: [3, 4, 0],
    }
    for motion in (goal, pad_waypoints(goal, 5)):
        for time, expected_velocity in expected.items():
            np.testing.assert_allclose(velocity(motion, time), expected_velocity, atol=1e-14)
    assert np.all(velocity(waypoint_goal(TIMES, POINTS), 71.0) == 0.0)


def test_different_goals_can_be_stacked_after_padding():
    goals = [straight_goal(jnp.array([5.0, 6.0, 0.0]), jnp.array([1.0, 0.0, 0.0])), ship()]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *[pad_waypoints(goal, 4) for goal in goals])
    for time in (0.0, 30.0, 100.0):
        positions = jax.jit(jax.vmap(position, in_axes=(0, None)))(stacked, time)
        np.testing.assert_allclose(positions, np.stack([position(goal, time) for goal in goals]), atol=1e-12)


@pytest.mark.parametrize("time", [0.0, 10.0, 40.0, 70.0, 90.0])
def test_gradients_are_finite_with_padding(time):
    goal = pad_waypoints(ship(), 6)
    gradient = slopes(goal, time)
    assert all(jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(gradient))
    if time == 40.0:
        np.testing.assert_allclose(position_rate(goal, time), velocity(goal, time))


def test_wrong_waypoints_are_refused():
    with pytest.raises(ValueError, match="2 times and 3 positions"):
        waypoint_goal([0.0, 1.0], POINTS)
    with pytest.raises(ValueError, match="strictly increase"):
        waypoint_goal([0.0, 2.0, 2.0], POINTS)
    with pytest.raises(ValueError, match="more than the 2"):
        pad_waypoints(ship(), 2)
