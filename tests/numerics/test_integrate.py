"""The fixed-step integrator: its order, and agreement with diffrax."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.numerics import rk4_step


def march(derivative, y, t_0, t_1, steps):
    """Integrate over an interval in equal steps."""
    h = (t_1 - t_0) / steps
    return jax.lax.scan(lambda y, i: (rk4_step(derivative, t_0 + i * h, y, h), None), y, jnp.arange(steps))[0]


def pendulum(t, state):
    """Damped, driven pendulum: nonlinear and dependent on time; a pytree."""
    return {
        "angle": state["rate"],
        "rate": -9.0 * jnp.sin(state["angle"]) - 0.3 * state["rate"] + jnp.cos(2.0 * t)[None],
    }


START = {"angle": jnp.array([1.2]), "rate": jnp.array([-0.4])}
swing = jax.jit(lambda y, steps: march(pendulum, y, 0.5, 3.5, steps), static_argnums=1)


@pytest.fixture(scope="module")
def reference():
    """The solution by diffrax, to 1e-12."""
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(lambda t, y, args: pendulum(t, y)),
        diffrax.Dopri8(),
        0.5,
        3.5,
        0.01,
        START,
        stepsize_controller=diffrax.PIDController(rtol=1e-12, atol=1e-12),
    )
    return jax.tree.map(lambda leaf: leaf[-1], solution.ys)


def error(y, reference):
    return max(np.max(np.abs(np.asarray(y[name]) - np.asarray(reference[name]))) for name in reference)


def test_the_integrator_agrees_with_diffrax(reference):
    # h^4 = 1e-9 at 600 steps of 5 ms, times a constant of some 1e0.
    assert error(swing(START, 600), reference) < 1e-8


def test_the_order_is_four(reference):
    errors = [error(swing(START, steps), reference) for steps in (50, 100, 200)]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    # The next term of the error is of one order more: at h = 60 ms it still weighs a tenth.
    np.testing.assert_allclose(orders, 4.0, atol=0.25)


@jax.jit
def cubic_step(coefficients, t, h):
    return rk4_step(lambda s, y: jnp.polyval(coefficients, s) + 0.0 * y, t, jnp.asarray(1.0), h)


linear_step = jax.jit(lambda rate, h: rk4_step(lambda t, y: rate * y, 0.0, jnp.asarray(3.0), h))


@settings(deadline=None, max_examples=30)
@given(t=st.floats(-5.0, 5.0), h=st.floats(0.01, 2.0), c=st.tuples(*[st.floats(-3.0, 3.0)] * 4))
def test_quadrature_of_cubics_is_exact(t, h, c):
    # Where the derivative depends on time alone the method is Simpson's rule, exact to third degree.
    step = cubic_step(jnp.array(c[::-1]), t, h)
    integral = np.polynomial.Polynomial(c).integ()
    np.testing.assert_allclose(step - 1.0, integral(t + h) - integral(t), rtol=1e-11, atol=1e-10)


@settings(deadline=None, max_examples=30)
@given(rate=st.floats(-2.0, 2.0), h=st.floats(0.01, 1.0))
def test_a_linear_problem_gives_the_fourth_taylor_polynomial(rate, h):
    z = rate * h
    step = linear_step(rate, h)
    np.testing.assert_allclose(step, 3.0 * (1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24), rtol=1e-13)


def test_pytrees_of_different_leaves_are_integrated():
    state = (jnp.ones(3), {"a": jnp.asarray(2.0), "b": jnp.zeros((2, 2))})
    new_state = rk4_step(lambda t, y: jax.tree.map(lambda leaf: -leaf + 1.0, y), 0.0, state, 0.1)
    assert jax.tree.structure(new_state) == jax.tree.structure(state)
    for old, new in zip(jax.tree.leaves(state), jax.tree.leaves(new_state), strict=True):
        assert old.shape == new.shape
        # y' = 1 - y: towards 1 by exp(-h); 1e-7 is h^5/120.
        np.testing.assert_allclose(new, 1.0 + (old - 1.0) * np.exp(-0.1), atol=1e-6)


def test_results_support_gradient_jit_and_vmap():
    def end(angle, rate):
        return march(pendulum, {"angle": angle[None], "rate": rate[None]}, 0.5, 3.5, 100)["angle"][0]

    slopes = jax.jit(jax.grad(end, argnums=(0, 1)))
    angle, rate = jnp.asarray(1.2), jnp.asarray(-0.4)
    step, value = 1e-5, jax.jit(end)
    numeric = (
        (value(angle + step, rate) - value(angle - step, rate)) / (2 * step),
        (value(angle, rate + step) - value(angle, rate - step)) / (2 * step),
    )
    # Central differences: 1e-10 of truncation and 1e-16/1e-5 of rounding.
    np.testing.assert_allclose(slopes(angle, rate), numeric, rtol=1e-7)
    # The step itself as well, and forwards.
    by_step = jax.jit(jax.jacfwd(lambda h: rk4_step(lambda t, y: -y, 0.0, jnp.asarray(1.0), h)))(0.1)
    np.testing.assert_allclose(by_step, -(1 - 0.1 + 0.1**2 / 2 - 0.1**3 / 6), rtol=1e-13)

    angles = jnp.array([0.3, 1.2, 2.0])
    batch = jax.jit(jax.vmap(lambda a: end(a, rate)))(angles)
    np.testing.assert_allclose(batch, [value(a, rate) for a in angles], rtol=1e-12)
