"""Detection of faults: synthetic missing coefficients of each fault, and of a healthy aircraft."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.sensing.fault_detection import CENTRE_OF_GRAVITY, FAULT_SIZES, NO_FAULT, fault_detection

STEP_S, SAMPLES, SURFACES = 0.02, 1000, 3
FAULT_COUNT = 3 + SURFACES
NOISE = np.array([0.003, 0.003, 0.01, 0.0005, 0.002, 0.0005])


@jax.jit
def advance_along(responses, effects):
    detection = fault_detection(SURFACES)

    def advance(state, row):
        return detection.advance(state, row[0], row[1], jnp.asarray(NOISE), 1.0, STEP_S), None

    return jax.lax.scan(advance, detection.init(), (responses, effects))[0]


def detect(share, noise, seed=0):
    """Final state for a part `share` of each fault (fault,), with white noise in units of the detection's noise."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(SAMPLES) * STEP_S
    # each fault shows in its own mix of coefficients, with its own motion
    mix = np.random.default_rng(3).normal(size=(FAULT_COUNT, 6)) * 8.0 * NOISE
    motion = 1.0 + np.sin(2.0 * np.pi * np.outer(np.arange(1, FAULT_COUNT + 1) / 9.0, time_s))
    effects = motion.T[:, :, None] * mix
    response = np.einsum("f,nfc->nc", share, effects) + noise * NOISE * rng.normal(size=(SAMPLES, 6))
    return advance_along(response, effects)


@pytest.mark.parametrize("fault", range(FAULT_COUNT))
def test_a_fault_is_named_with_its_size(fault):
    state = detect(np.eye(FAULT_COUNT)[fault], noise=1.0)
    assert int(state.code) == fault + 1
    unit = [*FAULT_SIZES[:-1], *[FAULT_SIZES[-1]] * SURFACES][fault]
    np.testing.assert_allclose(float(state.size), unit, rtol=0.1)


def test_of_the_faults_the_centre_of_gravity_alone_has_both_signs():
    state = detect(-np.eye(FAULT_COUNT)[CENTRE_OF_GRAVITY - 1], noise=1.0)
    assert int(state.code) == CENTRE_OF_GRAVITY
    np.testing.assert_allclose(float(state.size), -FAULT_SIZES[0], rtol=0.1)
    for fault in range(CENTRE_OF_GRAVITY, FAULT_COUNT):
        assert int(detect(-np.eye(FAULT_COUNT)[fault], noise=1.0).code) != fault + 1


@pytest.mark.parametrize("noise", [0.0, 1.0, 3.0])
def test_a_healthy_aircraft_has_no_fault(noise):
    for seed in range(5):
        assert int(detect(np.zeros(FAULT_COUNT), noise, seed).code) == NO_FAULT
