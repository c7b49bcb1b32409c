"""Least squares in a batch: the best fit, from many starts, and which of them are closest."""

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import least_squares

from anser.numerics import compiled_quickly
from anser.planning.certified.damped_fit import begin_fit, closest_of, fit

TIMES = np.linspace(0.0, 4.0, 25)
MEASURED = 2.0 * np.exp(-0.7 * TIMES) + 0.3 + 0.05 * np.sin(9.0 * TIMES)


def missed_at(x, share):
    def missed(y):
        return share * (y[0] * jnp.exp(-y[1] * TIMES) + y[2] - MEASURED)

    return missed(x), jax.jacfwd(missed)(x)


def fitted(starts, steps=40):
    shares = jnp.linspace(0.5, 2.0, starts.shape[0])
    return compiled_quickly(lambda: fit(missed_at, steps, jax.vmap(begin_fit)(shares, starts)))()


def test_finds_what_scipy_finds():
    starts = jnp.asarray([[1.0, 0.2, 0.0], [3.0, 2.0, 1.0], [0.5, 1.0, -0.5]])
    found = fitted(starts)
    expected = least_squares(lambda y: y[0] * np.exp(-y[1] * TIMES) + y[2] - MEASURED, [1.0, 0.2, 0.0], xtol=1e-14)
    for k in range(3):
        np.testing.assert_allclose(found.best[k], expected.x, rtol=1e-6)
        np.testing.assert_allclose(found.cost[k], 2.0 * expected.cost * np.linspace(0.5, 2.0, 3)[k] ** 2, rtol=1e-9)


def test_never_leaves_a_better_place_and_tells_the_closest():
    starts = jnp.asarray(np.random.default_rng(3).uniform(-3.0, 3.0, (12, 3)))
    costs = [np.asarray(fitted(starts, steps).cost) for steps in (1, 3, 9)]
    assert np.all(costs[1] <= costs[0])
    assert np.all(costs[2] <= costs[1])
    found = fitted(starts, 9)
    np.testing.assert_array_equal(closest_of(found, 4).cost, np.sort(costs[2])[:4])
