"""Damped Gauss-Newton from many starts: the best fit of scipy, the nearest solution of too few equations."""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from anser.compiling.options import compiled_quickly
from anser.numerics.least_squares import (
    Damping,
    Linearized,
    best_searches,
    minimum_norm_step,
    search_steps,
    start_search,
)
from anser.numerics.linear import BlockTridiagonal, solve_tridiagonal

GROUPS, SIZE = 4, 3


def chain(targets, x):
    """Residuals of a chain: each unknown is bent, and coupled to the next."""
    flat = x.ravel()
    return jnp.concatenate([jnp.exp(0.3 * flat) - targets, 2.0 * (flat[1:] - flat[:-1]) - 0.4])


residuals = jax.jit(chain)


class Normal(NamedTuple):
    cost: Any
    gradient: Any
    form: BlockTridiagonal


def normal_at(targets, x):
    residuals = chain(targets, x)
    jacobian = jax.jacfwd(lambda y: chain(targets, y))(x).reshape(residuals.size, GROUPS, SIZE)
    diagonal = jnp.einsum("rgi,rgj->gij", jacobian, jacobian)
    subdiagonal = jnp.einsum("rgi,rgj->gij", jacobian, jnp.roll(jacobian, 1, axis=1))
    gradient = jnp.einsum("r,rgi->gi", residuals, jacobian)
    return Normal(0.5 * jnp.sum(residuals**2), gradient, BlockTridiagonal(diagonal, subdiagonal))


EVEN = BlockTridiagonal(jnp.tile(jnp.eye(SIZE), (GROUPS, 1, 1)), jnp.zeros((GROUPS, SIZE, SIZE)))
TARGETS = np.random.default_rng(5).uniform(0.2, 6.0, (8, GROUPS * SIZE))


def fit(steps, required_count=99, enough=0.0):
    zeros = jnp.zeros((GROUPS, SIZE))
    unknown = Normal(jnp.asarray(jnp.inf), zeros, EVEN)

    def move(_, at, damping):
        return solve_tridiagonal(jax.tree.map(lambda block, size: block + damping * size, at.form, EVEN), at.gradient)

    def run():
        searches = jax.vmap(lambda targets: start_search(targets, zeros, unknown))(jnp.asarray(TARGETS))
        return search_steps(
            normal_at, move, Damping(lambda cost: 1e-2 * cost, 0.2, 5.0), steps, searches, required_count, enough
        )

    return compiled_quickly(run)()


@pytest.fixture(scope="module")
def fits():
    return {steps: fit(steps) for steps in (1, 3, 9, 40)}


@pytest.fixture(scope="module")
def costs(fits):
    return {steps: np.asarray(searches.at.cost) for steps, searches in fits.items()}


def test_searches_find_the_solution_of_scipy(fits, costs):
    searches = fits[40]
    for k, targets in enumerate(TARGETS):
        expected = least_squares(
            lambda y, targets=targets: np.asarray(residuals(targets, y.reshape(GROUPS, SIZE))),
            np.zeros(GROUPS * SIZE),
            xtol=1e-14,
            ftol=1e-14,
        )
        np.testing.assert_allclose(searches.best[k].ravel(), expected.x, atol=1e-5)
        np.testing.assert_allclose(costs[40][k], expected.cost, rtol=1e-8)


def test_costs_never_increase_and_the_best_searches_are_returned(fits, costs):
    for steps, fewer_steps in ((3, 1), (9, 3), (40, 9)):
        assert np.all(costs[steps] <= costs[fewer_steps])
    assert np.all(costs[9] < costs[1])
    np.testing.assert_array_equal(best_searches(fits[9], 3).at.cost, np.sort(costs[9])[:3])


def test_the_batch_stops_at_the_required_count_of_sufficient_costs(costs):
    enough = float(np.sort(costs[3])[2])
    final_costs = np.asarray(fit(40, required_count=3, enough=enough).at.cost)
    assert np.sum(final_costs <= enough) >= 3
    np.testing.assert_array_equal(final_costs, costs[3])


@functools.partial(jax.jit, static_argnums=(0, 3, 4, 5))
def _solved(missed_at, context, starts, equations, steps=40, longest=100.0):
    def linearized(search_context, x):
        return Linearized(*missed_at(search_context, x))

    unknown = Linearized(jnp.full(equations, 1e6), jnp.zeros((equations, starts.shape[1])))
    searches = jax.vmap(lambda x: start_search(context, x, unknown))(starts)
    damping = Damping(lambda _: jnp.asarray(1e-4), 0.1, 20.0, 1e-14, 1e6)
    return search_steps(linearized, minimum_norm_step(longest), damping, steps, searches)


def _linear(context, x):
    matrix, right_side = context
    return matrix @ x - right_side, matrix


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10_000))
def test_linear_equations_give_the_solution_nearest_to_the_start(seed):
    rng = np.random.default_rng(seed)
    matrix, right_side, start = rng.normal(size=(3, 7)), rng.normal(size=3), rng.normal(size=7)
    searches = _solved(_linear, (matrix, right_side), start[None], 3)
    nearest = start + np.linalg.pinv(matrix) @ (right_side - matrix @ start)
    np.testing.assert_allclose(searches.best[0], nearest, atol=1e-7)


def _on_circle(_, x):
    return jnp.array([jnp.sum(x**2) - 1.0]), 2.0 * x[None, :]


def test_nonlinear_equations_give_a_solution_near_the_start():
    angles = np.linspace(0.1, 6.0, 9)
    starts = jnp.asarray(np.stack([np.cos(angles), np.sin(angles)], axis=1) * np.linspace(0.5, 3.0, 9)[:, None])
    searches = _solved(_on_circle, (), starts, 1)
    np.testing.assert_allclose(np.linalg.norm(searches.best, axis=1), 1.0, atol=1e-9)
    # Each on its own side.
    np.testing.assert_allclose(np.arctan2(searches.best[:, 1], searches.best[:, 0]) % (2 * np.pi), angles, atol=1e-6)
    unfinished = _solved(_on_circle, (), starts, 1, 2)
    best = best_searches(unfinished, 3)
    assert np.max(np.abs(best.at.residual)) <= np.sort(np.abs(np.asarray(unfinished.at.residual)[:, 0]))[2]


def test_steps_do_not_exceed_the_length_limit():
    start = jnp.array([[30.0, 0.0]])
    once = _solved(_on_circle, (), start, 1, 2, 0.5)
    assert np.linalg.norm(once.best[0] - start[0]) <= 0.5 + 1e-12
    assert np.linalg.norm(once.trial[0] - once.best[0]) <= 0.5 + 1e-12
