"""Least squares of unknowns of which only neighbours have to do with each other: the best fit, from many starts."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from anser.numerics import compiled_quickly
from anser.planning.certified.damped_fit import Form, Normal, begin_fit, closest_of, fit, solve

GROUPS, SIZE = 4, 3


def dense(form):
    """The whole matrix of a block tridiagonal form."""
    own, before = np.asarray(form.own), np.asarray(form.before)
    groups, size = own.shape[:2]
    full = np.zeros((groups, size, groups, size))
    for k in range(groups):
        full[k, :, k] = own[k]
        if k:
            full[k, :, k - 1], full[k - 1, :, k] = before[k], before[k].T
    return full.reshape(groups * size, groups * size)


def random_form(seed):
    rng = np.random.default_rng(seed)
    # Of rows that reach two neighbouring groups each; what the first holds of the group before it means nothing.
    rows = rng.normal(0.0, 1.0, (GROUPS - 1, 9, 2 * SIZE))
    own, before = np.zeros((GROUPS, SIZE, SIZE)), rng.normal(0.0, 9.0, (GROUPS, SIZE, SIZE))
    for k, part in enumerate(rows):
        square = part.T @ part
        own[k] += square[:SIZE, :SIZE]
        own[k + 1] += square[SIZE:, SIZE:]
        before[k + 1] = square[SIZE:, :SIZE]
    return Form(jnp.asarray(own), jnp.asarray(before))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_solves_what_the_whole_matrix_would(seed):
    form = random_form(seed)
    right = np.random.default_rng(seed + 1).normal(0.0, 1.0, (GROUPS, SIZE))
    expected = np.linalg.solve(dense(form), right.ravel()).reshape(GROUPS, SIZE)
    np.testing.assert_allclose(solve(form, jnp.asarray(right)), expected, rtol=1e-6, atol=1e-8)


def missed(about, x):
    """A chain: each unknown bent, and tied to the next one."""
    flat = x.ravel()
    return jnp.concatenate([jnp.exp(0.3 * flat) - about, 2.0 * (flat[1:] - flat[:-1]) - 0.4])


def normal_at(about, x):
    rows = missed(about, x)
    jacobian = jax.jacfwd(lambda y: missed(about, y))(x).reshape(rows.size, GROUPS, SIZE)
    own = jnp.einsum("rgi,rgj->gij", jacobian, jacobian)
    before = jnp.einsum("rgi,rgj->gij", jacobian, jnp.roll(jacobian, 1, axis=1))
    gradient = jnp.einsum("r,rgi->gi", rows, jacobian)
    return Normal(0.5 * jnp.sum(rows**2), gradient, Form(own, before))


EVEN = Form(jnp.tile(jnp.eye(SIZE), (GROUPS, 1, 1)), jnp.zeros((GROUPS, SIZE, SIZE)))
TARGETS = np.random.default_rng(5).uniform(0.2, 6.0, (8, GROUPS * SIZE))


def fitted(steps, wanted=99, enough=0.0):
    def run():
        fits = jax.vmap(lambda about: begin_fit(about, EVEN))(jnp.asarray(TARGETS))
        return fit(normal_at, steps, fits, wanted, enough)

    return compiled_quickly(run)()


@pytest.fixture(scope="module")
def costs():
    return {steps: np.asarray(fitted(steps).normal.cost) for steps in (1, 3, 9, 40)}


def test_finds_what_scipy_finds(costs):
    found = fitted(40)
    for k, about in enumerate(TARGETS):
        expected = least_squares(
            lambda y, about=about: np.asarray(missed(about, jnp.asarray(y).reshape(GROUPS, SIZE))),
            np.zeros(GROUPS * SIZE),
            xtol=1e-14,
            ftol=1e-14,
        )
        np.testing.assert_allclose(found.best[k].ravel(), expected.x, atol=1e-5)
        np.testing.assert_allclose(costs[40][k], expected.cost, rtol=1e-8)


def test_never_leaves_a_better_place_and_tells_the_closest(costs):
    for more, fewer in ((3, 1), (9, 3), (40, 9)):
        assert np.all(costs[more] <= costs[fewer])
    assert np.all(costs[9] < costs[1])
    np.testing.assert_array_equal(closest_of(fitted(9), 3).normal.cost, np.sort(costs[9])[:3])


def test_stops_once_enough_of_them_cost_little_enough(costs):
    enough = float(np.sort(costs[3])[2])
    found = np.asarray(fitted(40, wanted=3, enough=enough).normal.cost)
    assert np.sum(found <= enough) >= 3
    np.testing.assert_array_equal(found, costs[3])
