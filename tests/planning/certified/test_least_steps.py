"""Steps of least size: to the nearest solution of too few equations."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.planning.certified.least_steps import begin_steps, least_steps, nearest_of


def _solved(missed_at, starts, equations, steps=40, longest=100.0):
    begun = jax.vmap(lambda x: begin_steps((), x, equations))(starts)
    return jax.jit(lambda all_: least_steps(missed_at, longest, steps, all_))(begun)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10_000))
def test_of_linear_equations_it_is_the_solution_nearest_to_the_start(seed):
    rng = np.random.default_rng(seed)
    matrix, wanted, start = rng.normal(size=(3, 7)), rng.normal(size=3), rng.normal(size=7)
    found = _solved(lambda x, _: (matrix @ x - wanted, jnp.asarray(matrix)), jnp.asarray(start)[None], 3)
    nearest = start + np.linalg.pinv(matrix) @ (wanted - matrix @ start)
    np.testing.assert_allclose(found.best[0], nearest, atol=1e-7)


def _on_circle(x, about):
    return jnp.array([jnp.sum(x**2) - 1.0]), 2.0 * x[None, :]


def test_of_others_it_is_a_solution_near_to_it_and_the_nearest_are_told():
    angles = np.linspace(0.1, 6.0, 9)
    starts = jnp.asarray(np.stack([np.cos(angles), np.sin(angles)], axis=1) * np.linspace(0.5, 3.0, 9)[:, None])
    found = _solved(_on_circle, starts, 1)
    np.testing.assert_allclose(np.linalg.norm(found.best, axis=1), 1.0, atol=1e-9)
    # Each on its own side.
    np.testing.assert_allclose(np.arctan2(found.best[:, 1], found.best[:, 0]) % (2 * np.pi), angles, atol=1e-6)
    few = _solved(_on_circle, starts, 1, steps=2)
    kept = nearest_of(few, 3)
    assert np.max(np.abs(kept.missed)) <= np.sort(np.abs(np.asarray(few.missed)[:, 0]))[2]


def test_a_step_is_no_longer_than_asked():
    start = jnp.array([[30.0, 0.0]])
    once = _solved(_on_circle, start, 1, steps=2, longest=0.5)
    assert np.linalg.norm(once.best[0] - start[0]) <= 0.5 + 1e-12
    assert np.linalg.norm(once.trial[0] - once.best[0]) <= 0.5 + 1e-12
