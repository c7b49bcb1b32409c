"""The autopilot as a function: state, single loops, compilation and derivatives."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.control import default_limits, published_gains
from anser.control.autopilot import attitude_control, rate_control
from anser.steady import TrimPoint
from support.autopilot_cases import Case, arrays, control, memory_of, model_of, turned_after_100_steps
from support.control_cases import QUICK


@pytest.fixture(scope="module")
def trim(trims) -> TrimPoint:
    """Level flight at 150 m/s and 5000 m, to the north."""
    return trims[0]


@pytest.fixture(scope="module")
def turn(trim) -> Case:
    """2 s of a small turn, climb and acceleration within the limits."""
    return arrays(Case(trim.state, memory_of(trim), 151.0, 0.005, 0.02, 0.02))


def test_the_state_keeps_its_shape_and_the_trim(trim, turn):
    memory = memory_of(trim)
    np.testing.assert_array_equal(memory.velocity_integral, np.zeros(3))
    np.testing.assert_array_equal(memory.rates_filter.state, trim.state.rates_b)
    np.testing.assert_array_equal(memory.surfaces_slow, trim.state.surfaces)
    (_, _, next_memory), _ = eqx.filter_eval_shape(
        control, turn, turn.state, memory, published_gains(), default_limits()
    )
    assert jax.tree.structure(next_memory) == jax.tree.structure(memory)
    for leaf in jax.tree.leaves((memory, next_memory)):
        assert leaf.shape == (3,)
        assert leaf.dtype == jnp.float64


def test_inner_loops_can_be_commanded_directly(trim):
    """Trim commanded to the rate loop and to the attitude loop gives the trimmed surfaces."""
    memory = memory_of(trim)

    @functools.partial(jax.jit, compiler_options=QUICK)
    def alone():
        model = model_of(trim.state, memory, published_gains(), default_limits(), 0.01)
        attitude = jnp.stack([trim.mu, trim.alpha, trim.beta])
        rates, inner, _ = attitude_control(model, published_gains(), memory, attitude, jnp.zeros(3))
        fast, _ = rate_control(model, published_gains(), memory, jnp.zeros(3), jnp.zeros(3))
        return rates, inner.surfaces, fast.surfaces

    rates, inner, fast = alone()
    # the trim's residual of up to 1e-8 rad/s^2 and g, times gains of 10 over an effectiveness of order 1
    np.testing.assert_allclose(rates, np.zeros(3), atol=1e-7)
    np.testing.assert_allclose(inner, trim.state.surfaces, atol=1e-6)
    np.testing.assert_allclose(fast, trim.state.surfaces, atol=1e-6)


@pytest.mark.long
def test_gains_and_limits_are_data(turn, turn_outputs):
    """Changed values use the same compiled code, and change the flight."""
    gains, limits = published_gains(), default_limits()
    nominal = turn_outputs(turn, gains, limits)
    softer = turn_outputs(
        turn, eqx.tree_at(lambda g: g.velocity.proportional, gains, jnp.array([0.5, 0.5, 0.5])), limits
    )
    tighter = turn_outputs(turn, gains, eqx.tree_at(lambda v: v.bank_max, limits, jnp.asarray(0.05, dtype=float)))
    assert np.abs(softer - nominal).max() > 1e-3
    assert np.abs(tighter - nominal).max() > 1e-3


@pytest.fixture(scope="module")
def slope():
    """Derivative of 2 s of flight along a direction in the space of gains."""

    def along(case, gains, limits, direction):
        return jax.jvp(lambda g: turned_after_100_steps(case, g, limits), (gains,), (direction,))[1]

    return jax.jit(along, compiler_options=QUICK)


@pytest.mark.long
@pytest.mark.parametrize("loop", ["velocity", "attitude", "rates"])
def test_gradient_with_respect_to_gains_agrees_with_differences(turn, turn_outputs, slope, loop):
    gains, limits = published_gains(), default_limits()
    direction = eqx.tree_at(
        lambda g: getattr(g, loop).proportional, jax.tree.map(jnp.zeros_like, gains), jnp.array([1.0, 0.7, 1.3])
    )

    def moved(amount):
        return turn_outputs(turn, jax.tree.map(lambda g, d: g + amount * d, gains, direction), limits)

    difference = (moved(1e-4) - moved(-1e-4)) / 2e-4
    exact = slope(turn, gains, limits, direction)
    # a breakpoint of a table between the two sides of the difference leaves a part of its kink
    np.testing.assert_allclose(difference, exact, rtol=1e-3, atol=1e-7)
    assert np.abs(exact).max() > 1e-5


@pytest.mark.long
@pytest.mark.parametrize("chi", [0.0, 3.0])
def test_gradients_are_finite_in_trim_and_at_the_limits(trim, slope, chi):
    """At 3 rad the bank and the roll rate are at their limits; at 0 the errors are exactly zero."""
    case = arrays(Case(trim.state, memory_of(trim), 150.0, 0.0, chi, 0.01))
    gains = published_gains()
    assert np.isfinite(slope(case, gains, default_limits(), jax.tree.map(jnp.ones_like, gains))).all()


@pytest.mark.long
def test_reverse_gradient_of_one_step_is_finite(trim):
    """Through the three loops, with respect to state, command, gains and limits."""

    def used(case, gains, limits):
        (controls, _, next_memory), _ = control(case, case.state, case.memory, gains, limits)
        return (
            jnp.sum(controls.surfaces) + controls.throttle + sum(jnp.sum(leaf) for leaf in jax.tree.leaves(next_memory))
        )

    slope_of = jax.jit(jax.grad(used, argnums=(0, 1, 2)), compiler_options=QUICK)
    for chi in (0.0, 3.0):
        case = arrays(Case(trim.state, memory_of(trim), 150.0, 0.0, chi, 0.01))
        for leaf in jax.tree.leaves(slope_of(case, published_gains(), default_limits())):
            assert np.isfinite(leaf).all()
