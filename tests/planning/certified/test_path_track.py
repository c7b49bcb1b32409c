"""Tracks of delivered paths: each interval has the acceleration bound of every overlapping cell."""

import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.compiling.options import compiled_quickly
from anser.planning import TimedPath
from anser.planning.certified.clearance import path_track

KNOTS, INTERVALS = 40, 96
tracked = compiled_quickly(path_track)


@settings(deadline=None)  # the first example compiles
@given(seed=st.integers(0, 10**6), spread=st.sampled_from([0.01, 0.3, 1.0]))
def test_each_interval_has_the_greatest_bound_of_its_cells(seed, spread):
    # Knots in heaps and far apart: cells from none to many intervals long, some of them empty.
    rng = np.random.default_rng(seed)
    spans = rng.exponential(1.0, KNOTS - 1) ** (1.0 / spread) * rng.choice([0.0, 1.0, 1.0], KNOTS - 1)
    spans[rng.integers(KNOTS - 1)] += 1e-3
    knots = 10.0 + 50.0 * np.concatenate([[0.0], np.cumsum(spans)]) / np.sum(spans)
    start = rng.choice([10.0, 4.0])
    times = np.linspace(start, 60.0, INTERVALS + 1)
    bounds = np.where(np.diff(knots) > 0.0, rng.uniform(0.0, 30.0, KNOTS - 1), 0.0)
    path = TimedPath(jnp.asarray(knots), jnp.zeros((KNOTS, 3, 3)), jnp.zeros((KNOTS, 3, 3)))
    track = tracked(path, jnp.asarray(bounds), 1.0, jnp.asarray(times))

    step = times[1] - times[0]
    touching = (knots[:-1] < times[1:, None]) & (knots[1:] > times[:-1, None])
    lower = np.max(np.where(touching, bounds, 0.0), axis=1)
    # Not more than that of the cells that a hair's breadth would make it touch.
    tolerance = 1e-6 * step
    nearly = (knots[:-1] < times[1:, None] + tolerance) & (knots[1:] > times[:-1, None] - tolerance)
    upper = np.max(np.where(nearly, bounds, 0.0), axis=1)
    error_bound = np.asarray(track.error_bound) * 8.0 / step**2
    inside = times[1:] > knots[0]
    assert np.all(error_bound[inside] >= lower[inside] * (1.0 - 1e-12))
    assert np.all(error_bound[inside] <= upper[inside] * (1.0 + 1e-12))
    flown = (times[:-1] < knots[-1] - 1e-6) & (times[1:] > knots[0])
    assert np.array_equal(track.included > 0.0, flown)
