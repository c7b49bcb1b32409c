"""Test inputs of an aircraft that learns."""

import types

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from anser.aircraft.airframe import Controls
from anser.aircraft_files import load_airframe
from anser.control.probing import probing_controller
from anser.parts.controllers import AbstractController


class FixedSignals(eqx.Module):
    """Signals with a command and a flag of its limit."""

    rate: Array
    limited: Array


class Fixed(AbstractController):
    """Controller that commands neutral surfaces and counts its samples."""

    def init(self, state, attitude):
        return jnp.asarray(0)

    def control(self, controller_state, belief, command, step):
        signals = FixedSignals(jnp.asarray(0.1), jnp.asarray(True))
        return Controls(jnp.zeros(3), jnp.asarray(0.3)), signals, controller_state + 1


AMPLITUDE = np.radians(1.0)


def test_inputs_start_near_zero_reach_the_amplitude_and_are_orthogonal():
    probing = probing_controller(Fixed(), 3, AMPLITUDE)
    time_s = np.arange(0.0, 5.0, 0.01)
    inputs = np.array([probing.deflections(t) for t in time_s])
    np.testing.assert_allclose(inputs[0], 0.0, atol=0.01 * AMPLITUDE)
    np.testing.assert_allclose(np.abs(inputs).max(axis=0), AMPLITUDE, rtol=0.02)
    np.testing.assert_allclose(probing.deflections(7.3), probing.deflections(2.3), atol=1e-12)
    centred = inputs - inputs.mean(axis=0)
    gram = centred.T @ centred
    assert np.all(np.abs(gram - np.diag(np.diag(gram))) < 1e-9 * gram.max())


def test_signals_of_commands_that_are_not_flown_are_blank():
    probing, airframe = probing_controller(Fixed(), 3, AMPLITUDE, learning_time=1.0), load_airframe()
    estimates = types.SimpleNamespace(effectiveness_uncertainty=jnp.asarray(0.0))
    belief = types.SimpleNamespace(estimates=estimates, airframe=airframe)
    state = probing.init(types.SimpleNamespace(surfaces=jnp.zeros(3), power=20.0), jnp.zeros(3))
    _, learning, state = probing.control(state, belief, None, 1.0)
    assert np.isnan(learning.rate)
    assert not bool(learning.limited)
    _, flown, _ = probing.control(state, belief, None, 1.0)
    assert (float(flown.rate), bool(flown.limited)) == (0.1, True)
