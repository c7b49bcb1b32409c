"""Lateral bend for a required length."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.planning.published.trajectory import arc_length, bend_trajectory, solve_lateral_bend
from support.planning_cases import fit, position, published_path, trajectories, velocity

measure = jax.jit(arc_length)
bend_path = jax.jit(bend_trajectory)
solve = jax.jit(solve_lateral_bend)
bent_length = jax.jit(lambda path, kappa: arc_length(bend_trajectory(path, kappa)))
kappa_and_slope = jax.jit(jax.value_and_grad(lambda path, x, side: solve_lateral_bend(path, x, side).kappa, argnums=1))
bent_length_slope = jax.jit(jax.grad(lambda kappa, path: arc_length(bend_trajectory(path, kappa))))


@jax.jit
@jax.grad
def solved_length_slope(coefficients, path, target_length, side):
    changed_path = eqx.tree_at(lambda p: p.coefficients_n, path, coefficients)
    return arc_length(bend_trajectory(changed_path, solve_lateral_bend(changed_path, target_length, side).kappa))


@jax.jit
@functools.partial(jax.grad, argnums=(0, 1))
def bend_slopes(coefficients, length, path):
    return solve_lateral_bend(eqx.tree_at(lambda p: p.coefficients_n, path, coefficients), length, 1.0).kappa


@settings(deadline=None, max_examples=60)
@given(
    path=trajectories(),
    excess=st.one_of(st.floats(1e-9, 1e-3), st.floats(1e-3, 1.0)),
    side=st.sampled_from([-1.0, 1.0]),
    guess=st.floats(0.0, 1.0),
)
def test_the_bend_converges_from_either_side_up_to_twice_the_nominal_length(path, excess, side, guess):
    nominal = measure(path)
    target_length = (1.0 + excess) * nominal
    solution = solve(path, target_length, side)
    # From zero (left of the root), from far right (the bracket ends near 8 (L_ref + L)), and anywhere between.
    solutions = [
        solve(path, target_length, side, start) for start in (0.0, 1e9, 24.0 * guess * nominal, solution.kappa / 2)
    ]
    for bend in (solution, *solutions):
        assert bend.converged
        assert np.sign(bend.kappa) == side
        # The solver promises 1e-10 of the length.
        np.testing.assert_allclose(bent_length(path, bend.kappa), target_length, rtol=2e-10)


def test_published_lengths_give_the_published_bends():
    for b_4 in (0.0025, 0.005, 0.0075, 0.01):
        for side in (1.0, -1.0):
            target_length = measure(published_path(-30.0, side * b_4))
            bend = solve(published_path(-30.0), target_length, side)
            # L is met to 1e-10; b_4 follows with the sensitivity (L/b_4)/(dL/db_4), below 100 here.
            np.testing.assert_allclose(bend.kappa / 36.0**4, side * b_4, rtol=1e-8)


def test_the_nominal_length_gives_zero_bend_and_shorter_lengths_are_refused():
    path = published_path(-30.0)
    nominal = measure(path)
    at_rest = solve(path, nominal, 1.0)
    assert at_rest.kappa == 0.0
    assert at_rest.converged
    shorter = solve(path, 0.99 * nominal, -1.0)
    assert shorter.kappa == 0.0
    assert not shorter.converged


def test_a_path_due_east_can_be_lengthened():
    path = fit(
        0.0, 40.0, jnp.zeros(3), velocity(150.0, np.pi / 2), jnp.array([0.0, 6e3, 0.0]), velocity(150.0, np.pi / 2)
    )
    bend = solve(path, 6500.0, -1.0)
    assert bend.converged
    # Left of a path due East is North.
    assert position(bend_path(path, bend.kappa), 20.0)[0] > 100.0


@settings(deadline=None, max_examples=15)
@given(path=trajectories(), ratio=st.floats(1.02, 1.9), side=st.sampled_from([-1.0, 1.0]))
def test_the_gradient_is_the_implicit_derivative(path, ratio, side):
    target_length = ratio * measure(path)
    kappa, slope = kappa_and_slope(path, target_length, side)
    inverse = bent_length_slope(kappa, path)
    # One is the reciprocal of the other, by two routes.
    np.testing.assert_allclose(slope * inverse, 1.0, rtol=1e-9)

    # However the path changes, the solved length stays what was wanted: rounding of terms that cancel.
    np.testing.assert_allclose(solved_length_slope(path.coefficients_n, path, target_length, side), 0.0, atol=1e-8)


@pytest.mark.parametrize("extra", [-10.0, 0.0, 1e-12, 1e-6, 1e-3])
def test_the_gradient_is_finite_near_the_nominal_length(extra):
    path = published_path(-30.0)
    gradients = bend_slopes(path.coefficients_n, measure(path) + extra, path)
    assert all(jnp.all(jnp.isfinite(g)) for g in gradients)


def test_a_path_of_zero_length_is_finite():
    path = eqx.tree_at(lambda p: p.coefficients_n, published_path(-30.0), jnp.zeros((3, 5)))
    for length in (0.0, 100.0):
        value, gradient = kappa_and_slope(path, length, 1.0)
        assert jnp.isfinite(value)
        assert jnp.isfinite(gradient)


def test_a_batch_equals_single_bends():
    path, sides = published_path(-30.0), jnp.array([1.0, -1.0, 1.0])
    lengths = jnp.array([5600.0, 5800.0, 9000.0])
    batch = jax.jit(jax.vmap(lambda length, side: solve_lateral_bend(path, length, side).kappa))(lengths, sides)
    alone = [solve(path, length, side).kappa for length, side in zip(lengths, sides, strict=True)]
    np.testing.assert_allclose(batch, alone, rtol=1e-9)
