"""Time to go and the velocity of arrival."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from anser.parts import make_rendezvous
from anser.parts.paths import polar
from anser.parts.planners import final_air_velocity, time_to_go
from support.planning_cases import angles, path_angles, velocity

ABOVE = jnp.array([0.0, 0.0, -300.0])
to_go = jax.jit(time_to_go)
arrival, polar_of = jax.jit(final_air_velocity), jax.jit(polar)
slopes = jax.jit(jax.jacrev(lambda x, w, how: final_air_velocity(how, x, 150.0, w)[0], argnums=(0, 1)))
slopes_to_go = jax.jit(jax.jacrev(lambda x, w: time_to_go(x, w, 150.0)[0], argnums=(0, 1)))


@settings(deadline=None, max_examples=50)
@given(
    distance=st.floats(10.0, 5e4), bearing=angles, slope=path_angles, course=angles, goal_speed=st.floats(0.0, 400.0)
)
def test_time_to_go_solves_its_equation(distance, bearing, slope, course, goal_speed):
    relative, w = distance * np.asarray(velocity(1.0, bearing, slope)), np.asarray(velocity(goal_speed, course))
    time, exists = to_go(relative, w, 150.0)
    assert np.isfinite(time)
    # Oracle: roots of the quadratic of theory section 7 by numpy.
    roots = np.roots([float(w @ w) - 150.0**2, 2.0 * float(relative @ w), distance**2])
    positive = sorted(r.real for r in roots if abs(r.imag) == 0.0 and r.real > 0.0)
    assert bool(exists) == bool(positive)
    if exists:
        # numpy's roots cancel where the goal is about as fast as the aircraft.
        np.testing.assert_allclose(time, positive[0], rtol=1e-6)
        # A line of that direction meets the goal then: rounding, times 1/(1 - W/V) at worst near equal speeds.
        assume(abs(goal_speed - 150.0) > 1e-3)
        np.testing.assert_allclose(np.linalg.norm(relative + w * float(time)), 150.0 * float(time), rtol=1e-7)


def test_goals_that_outrun_the_aircraft_are_reported():
    relative = jnp.array([1000.0, 0.0, 0.0])
    assert not to_go(relative, jnp.array([160.0, 0.0, 0.0]), 150.0)[1]
    assert to_go(relative, jnp.array([-160.0, 0.0, 0.0]), 150.0)[1]
    # Equal speeds: met head-on after half the distance, never in a tail chase.
    time, exists = to_go(relative, jnp.array([-150.0, 0.0, 0.0]), 150.0)
    assert exists
    np.testing.assert_allclose(time, 1000.0 / 300.0)
    assert not to_go(relative, jnp.array([150.0, 0.0, 0.0]), 150.0)[1]
    assert to_go(jnp.zeros(3), jnp.array([20.0, 0.0, 0.0]), 150.0)[0] == 0.0


@settings(deadline=None, max_examples=30)
@given(
    bearing=angles, slope=path_angles, course=angles, path_angle=path_angles, wind=st.floats(0.0, 100.0), blow=angles
)
def test_prescribed_arrival_over_the_ground(bearing, slope, course, path_angle, wind, blow):
    line, wind_n = 5e3 * np.asarray(velocity(1.0, bearing, slope)), np.asarray(velocity(wind, blow))
    for chi, gamma in ((None, None), (course, None), (None, path_angle), (course, path_angle)):
        air, attainable = arrival(make_rendezvous(ABOVE, chi, gamma), line, 150.0, wind_n)
        assert attainable
        np.testing.assert_allclose(np.linalg.norm(air), 150.0, rtol=1e-13)
        over_ground = polar_of(np.asarray(air) + wind_n, np.zeros(3))
        straight = polar_of(150.0 * line / np.linalg.norm(line) + wind_n, np.zeros(3))
        # The ground speed is at least 50 m/s: no loss of digits.
        np.testing.assert_allclose(over_ground.chi, straight.chi if chi is None else chi, atol=1e-12)
        np.testing.assert_allclose(over_ground.gamma, straight.gamma if gamma is None else gamma, atol=1e-12)


def test_an_unattainable_direction_is_reported_and_ignored():
    line, storm = jnp.array([5e3, 0.0, 0.0]), jnp.array([0.0, 160.0, 0.0])
    air, attainable = arrival(make_rendezvous(ABOVE, 0.0), line, 150.0, storm)
    assert not attainable
    np.testing.assert_allclose(air, [150.0, 0.0, 0.0], atol=1e-12)
    assert arrival(make_rendezvous(ABOVE), line, 150.0, storm)[1]


@pytest.mark.parametrize("line", [(0.0, 0.0, 0.0), (0.0, 0.0, 500.0), (1e3, 2e3, 100.0)])
@pytest.mark.parametrize("wind", [(0.0, 0.0, 0.0), (-150.0, 0.0, 0.0), (0.0, 300.0, 0.0)])
@pytest.mark.parametrize("chi", [None, 0.3])
def test_gradients_are_finite(line, wind, chi):
    jacobian = slopes(jnp.array(line), jnp.array(wind), make_rendezvous(ABOVE, chi))
    times = slopes_to_go(jnp.array(line), jnp.array(wind))
    assert all(np.all(np.isfinite(leaf)) for leaf in (*jacobian, *times))


def test_vmap_and_one_trace_for_any_numbers():
    traces = []

    @jax.jit
    def final(rendezvous, lines):
        traces.append(1)
        return jax.vmap(lambda line: final_air_velocity(rendezvous, line, 150.0, jnp.zeros(3))[0])(lines)

    lines = jnp.array([[1e3, 0.0, 0.0], [0.0, 1e3, 0.0]])
    np.testing.assert_allclose(final(make_rendezvous(ABOVE), lines), 0.15 * lines, atol=1e-12)
    np.testing.assert_allclose(final(make_rendezvous(ABOVE, 0.0, 0.0), lines)[1], [150.0, 0.0, 0.0], atol=1e-12)
    assert len(traces) == 1
