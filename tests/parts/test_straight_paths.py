"""Straight paths to the rendezvous: ends, the common arrival, and the earliest arrival in wind."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.parts import AircraftPlan, AircraftReport, StraightPath, make_rendezvous
from anser.planning.published.coordination import GOAL_OUTRUNS

WIND_N = np.array([5.0, -8.0, 0.0])
POSITIONS_N = np.array([[0.0, 0.0, -1000.0], [-3000.0, 2000.0, -900.0], [9000.0, -9000.0, -1100.0]])
GOALS_N = np.array([[6000.0, 1000.0, 0.0], [5000.0, 2000.0, 0.0], [8000.0, -8000.0, 0.0]])
GOAL_VELOCITIES_N = np.array([[10.0, 0.0, 0.0], [0.0, -12.0, 0.0], [0.0, 0.0, 0.0]])
STAND_OFF_N = np.array([0.0, 0.0, -300.0])
TIME_S, AIRSPEED = 3.0, 150.0


def reports(active=(True, True, True)):
    rendezvous = make_rendezvous(jnp.asarray(STAND_OFF_N))
    return AircraftReport(
        position_n=jnp.asarray(POSITIONS_N),
        air_velocity_n=jnp.zeros((3, 3)),
        wind_n=jnp.broadcast_to(WIND_N, (3, 3)),
        airspeed=jnp.full(3, AIRSPEED),
        goal_position_n=jnp.asarray(GOALS_N),
        goal_velocity_n=jnp.asarray(GOAL_VELOCITIES_N),
        rendezvous=jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (3, *jnp.shape(leaf))), rendezvous),
        active=jnp.asarray(active),
        has_left=jnp.zeros(3, dtype=bool),
    )


@functools.cache
def straight(arrival_time=None, active=(True, True, True)):
    return jax.jit(AircraftPlan.straight)(reports(active), TIME_S, arrival_time)


def motion(plan, time):
    return jax.vmap(lambda path: path.at(time))(plan.trajectory)


def test_straight_paths_lead_from_the_positions_to_the_rendezvous_at_the_arrival_time():
    plan = straight(63.0)
    np.testing.assert_array_equal(plan.arrival_time, [63.0] * 3)
    start, end = motion(plan, TIME_S), motion(plan, 63.0)
    np.testing.assert_array_equal(start.position_n, POSITIONS_N)
    np.testing.assert_allclose(end.position_n, GOALS_N + 60.0 * GOAL_VELOCITIES_N + STAND_OFF_N, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(start.velocity_n, end.velocity_n)
    np.testing.assert_array_equal(start.acceleration_n, np.zeros((3, 3)))


@pytest.mark.parametrize("active", [(True, True, True), (True, False, True)])
def test_the_earliest_common_arrival_needs_the_airspeed_of_the_last_active_aircraft(active):
    plan = straight(None, active)
    airspeeds = np.linalg.norm(np.asarray(motion(plan, TIME_S).velocity_n) - WIND_N, axis=1)[list(active)]
    assert airspeeds.max() == pytest.approx(AIRSPEED, rel=1e-12)


def test_an_aircraft_that_its_goal_outruns_has_that_status_and_nobody_waits_for_it():
    chasing = dataclasses.replace(reports(), goal_velocity_n=jnp.asarray([[400.0, 0.0, 0.0], *GOAL_VELOCITIES_N[1:]]))
    plan = jax.jit(AircraftPlan.straight)(chasing, TIME_S)
    np.testing.assert_array_equal(plan.status, [GOAL_OUTRUNS, 0, 0])
    np.testing.assert_array_equal(plan.arrival_time, straight(None, (False, True, True)).arrival_time)


def test_straight_paths_without_an_active_aircraft_are_finite():
    assert np.all(np.isfinite(motion(straight(None, (False, False, False)), TIME_S).velocity_n))


def test_the_derivative_of_a_straight_path_is_its_velocity():
    path = StraightPath(jnp.zeros(3), jnp.array([1.0, 2.0, -3.0]), 2.0, 6.0)
    np.testing.assert_allclose(jax.jacfwd(lambda t: path.at(t).position_n)(5.0), path.at(5.0).velocity_n, rtol=1e-15)
