"""Delivered paths: knots that are consistent with each other."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.compiling.options import compiled_quickly
from anser.planning.certified.candidates import deliver
from anser.planning.certified.detours import WORDS, direct_path, solve_detour
from anser.planning.certified.path_bounds import path_bounds
from anser.planning.certified.profile import make_profile, tabulate
from anser.planning.certified.routes import PathEndpoints, route
from support.certified_cases import GRAVITY, LAYERED, STEADY, detours_of, number


@pytest.mark.long
@pytest.mark.parametrize("wind", [STEADY, LAYERED], ids=["steady", "layered"])
def test_close_knots_do_not_make_accelerations(wind):
    # A knot every 1.5195 s, and one 0.04 s before the second for the end of a fading acceleration: there the table's
    # length is off by what the change of speed that ended at 2 s cost it.
    duration, intervals = 194.5, 128
    profile = make_profile(duration, (2000.0, 1500.0), (0.0, 0.0), 0.0, 0.0, (169.0, 169.1, 165.0), 0.0)
    assert 0.02 < 2 * duration / intervals - 3.0 < 0.05
    table = tabulate(profile, wind, intervals)
    distance = 0.9 * table.length
    endpoints = PathEndpoints(
        0j + number(0.0),
        number(0.0),
        number(0.0),
        0j + distance,
        number(0.0),
        jnp.asarray(False),
        number(1 / 3000.0),
        number(1 / 3000.0 / 300.0),
        number(1.0),
    )

    @compiled_quickly
    def make_path():
        base = direct_path(endpoints, jnp.asarray(WORDS[0]))
        detour = jax.tree.map(lambda leaf: leaf[0], detours_of(range(1), np.ones(1)))
        path = deliver(0.0, table, route(endpoints, solve_detour(endpoints, base, detour, table.length)))
        return path, path_bounds(path, wind, GRAVITY)

    path, bounds = make_path()
    spans = np.diff(np.asarray(path.times))
    assert np.any((spans > 0.0) & (spans < 0.05))
    # Gains and losses of 1 m/s^2 at most: climb, push over, change of speed, wind that changes with height.
    assert float(bounds.deceleration_max) < 1.0
    assert float(bounds.acceleration_max) < 1.0
    # It ends where it was to end.
    end = np.asarray(path.position_n(number(duration)) - jnp.append(table.drift_n[:2], -1500.0))
    np.testing.assert_allclose(end, [float(distance), 0.0, 0.0], atol=1e-2)
