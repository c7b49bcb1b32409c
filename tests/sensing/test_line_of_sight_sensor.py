"""The line of sight over both Earth models: readings against pymap3d, and the recovered goal against the truth."""

import jax
import jax.numpy as jnp
import numpy as np
import pymap3d
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.environment import FlatEarth, wgs84_earth
from anser.parts import GoalState
from anser.planning import straight_goal
from anser.sensing.estimators import goal_from_sight
from anser.sensing.ideal_sensors import line_of_sight
from anser.units import DEG_RAD, RAD_DEG

EARTHS = {"flat": FlatEarth(jnp.asarray(9.81)), "round": wgs84_earth(45 * DEG_RAD, 10 * DEG_RAD)}
vectors = st.tuples(*(st.floats(-1.0, 1.0),) * 3)


@jax.jit
def recovered_goal(earth, goal, time, own_n, velocity_n):
    """The goal recovered from the line of sight of an ideal sensor."""
    sight = line_of_sight(earth, own_n, velocity_n, GoalState(goal.position_n(time), goal.velocity_n(time)))
    return goal_from_sight(earth, sight, own_n, velocity_n)


@pytest.mark.parametrize("name", EARTHS)
@settings(deadline=None, max_examples=25)
@given(vectors, vectors, st.floats(0.0, 100.0))
def test_recovered_motion_is_the_goal_s_own(name, offset, velocity, time):
    goal = straight_goal(jnp.array([500.0, -200.0, 0.0]), 25.0 * jnp.array(velocity))
    own_n = jnp.array([9000.0, 5000.0, -2000.0]) + 1000.0 * jnp.array(offset)
    recovered = recovered_goal(EARTHS[name], goal, time, own_n, jnp.array([100.0, -80.0, 5.0]))
    np.testing.assert_allclose(recovered.position_n, goal.position_n(time), atol=1e-7)
    np.testing.assert_allclose(recovered.velocity_n, goal.velocity_n(time), atol=1e-10)


def test_reading_over_the_round_earth_equals_pymap3d():
    """Azimuth, elevation and slant range of a boat 20 km away: the Earth bends 31 m away under the line."""
    earth = EARTHS["round"]
    own_n, boat_n = jnp.array([0.0, 0.0, -500.0]), jnp.array([16e3, 12e3, 0.0])
    sight = line_of_sight(earth, own_n, jnp.zeros(3), GoalState(boat_n, jnp.zeros(3)))
    vehicle_geodetic, boat_geodetic = (
        (float(lat) * RAD_DEG, float(lon) * RAD_DEG, float(h))
        for lat, lon, h in (earth.geodetic(own_n), earth.geodetic(boat_n))
    )
    azimuth, elevation, distance = pymap3d.geodetic2aer(*boat_geodetic, *vehicle_geodetic)
    assert float(sight.range) == pytest.approx(distance, abs=1e-7)
    assert float(sight.azimuth) * RAD_DEG == pytest.approx(azimuth, abs=1e-9)
    assert float(sight.elevation) * RAD_DEG == pytest.approx(elevation, abs=1e-9)
    flat = line_of_sight(EARTHS["flat"], own_n, jnp.zeros(3), GoalState(boat_n, jnp.zeros(3)))
    assert float(flat.elevation - sight.elevation) * distance == pytest.approx(20e3**2 / (2 * 6.38e6), rel=0.02)
