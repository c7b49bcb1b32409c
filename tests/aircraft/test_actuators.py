"""Actuators: first order with position and rate limits (theory section 4)."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.aircraft import FirstOrderActuators
from anser.aircraft.actuators import Deflections
from support.states import air_at

ACTUATORS = FirstOrderActuators(
    time_constant=jnp.full(3, 0.0495),
    lower=jnp.array([-0.4, -0.3, -0.5]),
    upper=jnp.array([0.4, 0.3, 0.6]),
    rate_limit=jnp.array([1.0, 1.4, 2.1]),
)
AIR = air_at(1000.0, 0.4)
rate = jax.jit(lambda position, command: ACTUATORS.rate(Deflections(position), command, AIR).position)
command_for_rate = jax.jit(lambda *x: ACTUATORS.command_for_rate(*x))
ANGLES = st.lists(st.floats(-0.7, 0.7), min_size=3, max_size=3).map(jnp.array)


def test_small_commands_decay_with_the_time_constant():
    np.testing.assert_allclose(
        rate(jnp.array([0.1, 0.0, -0.1]), jnp.array([0.12, -0.01, -0.1])), np.array([0.02, -0.01, 0.0]) / 0.0495
    )


def test_commands_stop_at_the_position_limits():
    np.testing.assert_array_equal(ACTUATORS.limit_command(jnp.array([0.5, -0.7, 0.55])), [0.4, -0.3, 0.55])
    # At its limit a surface does not move, however far beyond the command lies.
    np.testing.assert_array_equal(rate(ACTUATORS.upper, jnp.full(3, 9.0)), np.zeros(3))


def test_large_commands_move_at_the_rate_limit():
    np.testing.assert_array_equal(rate(jnp.zeros(3), jnp.array([0.4, -0.3, 0.6])), [1.0, -1.4, 2.1])


@settings(deadline=None, max_examples=50)
@given(position=ANGLES, command=ANGLES)
def test_surfaces_never_pass_their_limits(position, command):
    position = ACTUATORS.limit_command(position)
    speed = rate(position, command)
    assert (jnp.abs(speed) <= ACTUATORS.rate_limit).all()
    # Over any step up to the time constant the motion cannot overshoot the limited command.
    new_state = position + 0.0495 * speed
    assert (new_state <= ACTUATORS.upper + 1e-15).all()
    assert (new_state >= ACTUATORS.lower - 1e-15).all()


@settings(deadline=None, max_examples=50)
@given(position=ANGLES, required_rate=ANGLES)
def test_the_command_for_a_rate_gives_that_rate_where_possible(position, required_rate):
    position = 0.5 * ACTUATORS.limit_command(position)  # room for the command: 0.15 rad to the nearest limit
    given_rate = rate(position, command_for_rate(position, 2 * required_rate))
    np.testing.assert_allclose(
        given_rate, jnp.clip(2 * required_rate, -ACTUATORS.rate_limit, ACTUATORS.rate_limit), atol=1e-12
    )


def test_the_gradient_is_that_of_the_lag_and_zero_at_the_limit():
    def total(command):
        return jnp.sum(rate(jnp.zeros(3), command))

    np.testing.assert_allclose(jax.grad(total)(jnp.array([0.01, -0.02, 9.0])), [1 / 0.0495, 1 / 0.0495, 0.0])


def test_batches_equal_single_evaluations():
    positions, commands = jnp.linspace(-0.3, 0.3, 12).reshape(4, 3), jnp.linspace(0.5, -0.5, 12).reshape(4, 3)
    batch_rates = jax.vmap(rate)(positions, commands)
    np.testing.assert_array_equal(batch_rates, [rate(p, c) for p, c in zip(positions, commands, strict=True)])
