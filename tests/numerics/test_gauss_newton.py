"""Damped Gauss-Newton from many starts: the best fit of scipy, the nearest solution of too few equations."""

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


def chain(about, x):
    """A chain: each unknown bent, and tied to the next one."""
    flat = x.ravel()
    return jnp.concatenate([jnp.exp(0.3 * flat) - about, 2.0 * (flat[1:] - flat[:-1]) - 0.4])


class Normal(NamedTuple):
    cost: Any
    gradient: Any
    form: BlockTridiagonal


def normal_at(about, x):
    rows = chain(about, x)
    jacobian = jax.jacfwd(lambda y: chain(about, y))(x).reshape(rows.size, GROUPS, SIZE)
    own = jnp.einsum("rgi,rgj->gij", jacobian, jacobian)
    before = jnp.einsum("rgi,rgj->gij", jacobian, jnp.roll(jacobian, 1, axis=1))
    gradient = jnp.einsum("r,rgi->gi", rows, jacobian)
    return Normal(0.5 * jnp.sum(rows**2), gradient, BlockTridiagonal(own, before))


EVEN = BlockTridiagonal(jnp.tile(jnp.eye(SIZE), (GROUPS, 1, 1)), jnp.zeros((GROUPS, SIZE, SIZE)))
TARGETS = np.random.default_rng(5).uniform(0.2, 6.0, (8, GROUPS * SIZE))


def fitted(steps, wanted=99, enough=0.0):
    none = jnp.zeros((GROUPS, SIZE))
    unknown = Normal(jnp.asarray(jnp.inf), none, EVEN)

    def move(_, at, damping):
        return solve_tridiagonal(jax.tree.map(lambda of, size: of + damping * size, at.form, EVEN), at.gradient)

    def run():
        begun = jax.vmap(lambda about: start_search(about, none, unknown))(jnp.asarray(TARGETS))
        return search_steps(normal_at, move, Damping(lambda cost: 1e-2 * cost, 0.2, 5.0), steps, begun, wanted, enough)

    return compiled_quickly(run)()


@pytest.fixture(scope="module")
def costs():
    return {steps: np.asarray(fitted(steps).at.cost) for steps in (1, 3, 9, 40)}


def test_finds_what_scipy_finds(costs):
    found = fitted(40)
    for k, about in enumerate(TARGETS):
        expected = least_squares(
            lambda y, about=about: np.asarray(chain(about, jnp.asarray(y).reshape(GROUPS, SIZE))),
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
    np.testing.assert_array_equal(best_searches(fitted(9), 3).at.cost, np.sort(costs[9])[:3])


def test_stops_once_enough_of_them_cost_little_enough(costs):
    enough = float(np.sort(costs[3])[2])
    found = np.asarray(fitted(40, wanted=3, enough=enough).at.cost)
    assert np.sum(found <= enough) >= 3
    np.testing.assert_array_equal(found, costs[3])


def _solved(missed_at, starts, equations, steps=40, longest=100.0):
    def linearized(_, x):
        return Linearized(*missed_at(x))

    unknown = Linearized(jnp.full(equations, 1e6), jnp.zeros((equations, starts.shape[1])))
    begun = jax.vmap(lambda x: start_search((), x, unknown))(starts)
    damping = Damping(lambda _: jnp.asarray(1e-4), 0.1, 20.0, 1e-14, 1e6)
    return jax.jit(lambda all_: search_steps(linearized, minimum_norm_step(longest), damping, steps, all_))(begun)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10_000))
def test_of_linear_equations_it_is_the_solution_nearest_to_the_start(seed):
    rng = np.random.default_rng(seed)
    matrix, wanted, start = rng.normal(size=(3, 7)), rng.normal(size=3), rng.normal(size=7)
    found = _solved(lambda x: (matrix @ x - wanted, jnp.asarray(matrix)), jnp.asarray(start)[None], 3)
    nearest = start + np.linalg.pinv(matrix) @ (wanted - matrix @ start)
    np.testing.assert_allclose(found.best[0], nearest, atol=1e-7)


def _on_circle(x):
    return jnp.array([jnp.sum(x**2) - 1.0]), 2.0 * x[None, :]


def test_of_others_it_is_a_solution_near_to_it_and_the_nearest_are_told():
    angles = np.linspace(0.1, 6.0, 9)
    starts = jnp.asarray(np.stack([np.cos(angles), np.sin(angles)], axis=1) * np.linspace(0.5, 3.0, 9)[:, None])
    found = _solved(_on_circle, starts, 1)
    np.testing.assert_allclose(np.linalg.norm(found.best, axis=1), 1.0, atol=1e-9)
    # Each on its own side.
    np.testing.assert_allclose(np.arctan2(found.best[:, 1], found.best[:, 0]) % (2 * np.pi), angles, atol=1e-6)
    few = _solved(_on_circle, starts, 1, steps=2)
    kept = best_searches(few, 3)
    assert np.max(np.abs(kept.at.residual)) <= np.sort(np.abs(np.asarray(few.at.residual)[:, 0]))[2]


def test_a_step_is_no_longer_than_asked():
    start = jnp.array([[30.0, 0.0]])
    once = _solved(_on_circle, start, 1, steps=2, longest=0.5)
    assert np.linalg.norm(once.best[0] - start[0]) <= 0.5 + 1e-12
    assert np.linalg.norm(once.trial[0] - once.best[0]) <= 0.5 + 1e-12
