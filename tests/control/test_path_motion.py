"""Path motion of the onboard model against the rigid body (theory section 2), differentiated along the motion."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings

from anser.aircraft import Controls
from anser.aircraft.motion import flat_earth_derivative
from anser.numerics.linear import solve3
from support.control_cases import (
    AIRFRAME,
    DEGREE,
    QUICK,
    believed_motion,
    environment_of,
    flights,
    setting_of,
    state_of,
)

modest = settings(deadline=None, max_examples=40)


@jax.jit
def rates_two_ways(x):
    """Rates of (mu, alpha, beta) and (V, gamma, chi): by derivatives of the equations of motion, and as published."""
    state = state_of(x)
    controls = Controls(state.surfaces, jnp.asarray(0.5))
    moving = flat_earth_derivative(AIRFRAME, environment_of(x), 0.0, state, controls)

    def angles(s):
        motion = believed_motion(s, x)[1]
        return jnp.stack([motion.mu, motion.alpha, motion.beta, motion.V, motion.gamma, motion.chi])

    angles_now, true_rates = jax.jvp(angles, (state,), (moving,))
    motion = believed_motion(state, x)[1]
    attitude_rates = motion.force_rates + jnp.sum(motion.rate_matrix * state.rates_b[None, :], axis=1)
    return angles_now, true_rates, jnp.concatenate([attitude_rates, motion.path_rates])


@modest
@given(flights)
def test_published_rates_are_the_rates_of_the_simulated_motion(x):
    """Exact identities of kinematics: only rounding, amplified by tan gamma < 2.6, remains of rates of order 1."""
    angles, true_rates, published = rates_two_ways(x)
    # V in the middle is m/s: the same tolerance relative to its size
    np.testing.assert_allclose(published, true_rates, rtol=1e-10, atol=1e-11)
    np.testing.assert_allclose(angles, np.concatenate([x[[3, 1, 2, 0]], x[4:6]]), rtol=0, atol=1e-10)


@jax.jit
def inverted(x, target):
    motion = setting_of(x).motion
    rates_b = solve3(motion.rate_matrix, target - motion.force_rates)
    return motion.force_rates + jnp.sum(motion.rate_matrix * rates_b[None, :], axis=1)


@modest
@given(flights)
def test_the_effectiveness_is_invertible_in_the_whole_envelope(x):
    target = np.array([0.3, -0.1, 0.2])
    np.testing.assert_allclose(inverted(x, target), target, atol=1e-12)


def _outputs(x):
    motion = setting_of(x).motion
    return jnp.concatenate([motion.force_rates, motion.rate_matrix.ravel(), motion.path_rates, motion.mu[None]])


_outputs_jit = jax.jit(_outputs)
_jacobian = jax.jit(jax.jacrev(_outputs), compiler_options=QUICK)
_LEVEL = np.array([150, 0.05, 0, 0, 0, 0, 0, 0, 0, -0.04, 0, 0, 10, 1000, 0, 0, 0.0])


def _changed(**entries):
    x = _LEVEL.copy()
    for name, value in entries.items():
        x[["V", "alpha", "beta", "mu", "gamma"].index(name)] = value
    return x


@pytest.mark.long
@pytest.mark.parametrize(
    "x",
    [
        _LEVEL,
        _changed(gamma=np.pi / 2),
        _changed(gamma=-np.pi / 2),
        _changed(mu=np.pi),
        _changed(beta=np.pi / 2),
        _changed(V=0.0),
        _changed(V=0.1, alpha=90 * DEGREE),
    ],
    ids=["level", "straight up", "straight down", "inverted", "sideways", "at rest", "sinking"],
)
def test_values_and_gradients_are_finite_outside_the_domain_too(x):
    assert np.isfinite(_outputs_jit(x)).all()
    assert np.isfinite(_jacobian(x)).all()


@pytest.mark.long
def test_a_batch_equals_single_evaluations():
    batch = np.stack([_LEVEL, _changed(mu=1.0, gamma=0.3), _changed(beta=0.2, V=200.0)])
    together = jax.jit(jax.vmap(_outputs), compiler_options=QUICK)(batch)
    for x, batch_row in zip(batch, together, strict=True):
        np.testing.assert_allclose(batch_row, _outputs_jit(x), rtol=1e-12, atol=1e-12)
