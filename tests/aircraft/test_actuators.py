"""Actuators: first order with position and rate limits (theory section 4)."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.aircraft import FirstOrderActuators, SecondOrderActuators
from anser.aircraft.actuators import Deflections, without_lag
from anser.numerics.integration import rk4_step
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


def test_actuators_without_lag_move_at_the_commanded_rate_over_a_period():
    instant, position, rate = without_lag(ACTUATORS, 0.02), jnp.array([0.1, 0.0, -0.1]), jnp.array([1.0, -2.0, 0.0])
    moved = instant.before_step(Deflections(position), instant.command_for_rate(position, rate)).position
    np.testing.assert_allclose(moved - position, 0.02 * rate, atol=1e-15)
    np.testing.assert_array_equal(instant.travel_per_rate(0.02), np.full(3, 0.02))


def test_the_gradient_is_that_of_the_lag_and_zero_at_the_limit():
    def total(command):
        return jnp.sum(rate(jnp.zeros(3), command))

    np.testing.assert_allclose(jax.grad(total)(jnp.array([0.01, -0.02, 9.0])), [1 / 0.0495, 1 / 0.0495, 0.0])


def test_batches_equal_single_evaluations():
    positions, commands = jnp.linspace(-0.3, 0.3, 12).reshape(4, 3), jnp.linspace(0.5, -0.5, 12).reshape(4, 3)
    batch_rates = jax.vmap(rate)(positions, commands)
    np.testing.assert_array_equal(batch_rates, [rate(p, c) for p, c in zip(positions, commands, strict=True)])


def test_second_order_surfaces_rest_at_their_stops():
    """A lightly damped surface is sent to its stop: its free motion would overshoot by a third, at up to 600 deg/s."""
    limit, step = np.deg2rad(30.0), 0.01
    actuators = SecondOrderActuators(
        frequency=jnp.full(3, 40.0),
        damping=jnp.full(3, 0.3),
        lower=jnp.full(3, -limit),
        upper=jnp.full(3, limit),
        rate_limit=jnp.full(3, np.deg2rad(600.0)),
    )

    @jax.jit
    def fly(commands):
        def advance(state, command):
            state = actuators.before_step(state, command)
            moved = rk4_step(lambda _, s: actuators.rate(s, command, AIR), 0.0, state, step)
            return moved, (state.position, moved.position)

        return jax.lax.scan(advance, actuators.steady_state(jnp.zeros(3)), commands)[1]

    commands = np.tile([1.0, -1.0, 0.5], (200, 1)) * limit
    commands[100:, :2] = 0.0
    begun, moved = (np.asarray(values) for values in fly(jnp.asarray(commands)))
    assert np.all(np.abs(begun) <= limit)
    # Within a step a surface may pass the stop, by less than the way of the step.
    assert np.all(np.abs(moved) <= limit + np.deg2rad(600.0) * step)
    np.testing.assert_allclose(begun[95, :2], [limit, -limit], rtol=1e-3)
    # The stop does not hold it, and far from the stops nothing is changed.
    np.testing.assert_allclose(begun[-1, :2], 0.0, atol=1e-3)
    assert begun[:, 2].max() > 1.2 * 0.5 * limit
