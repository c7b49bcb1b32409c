"""Metrics of step responses against systems with closed-form responses."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.simulation.response import step_metrics

TIME = np.arange(4000) * 0.005
STOPS = (jnp.full(3, -0.4), jnp.full(3, 0.4))
STILL = jnp.zeros((4000, 3))
metrics_of = jax.jit(lambda measured, size: step_metrics(jnp.asarray(TIME), measured, size, STILL, STOPS))


def _channels(channel, start=0.0):
    return np.stack([start + channel, np.full_like(channel, 2.0), 0.3 * np.sin(TIME)], axis=1)


@settings(deadline=None, max_examples=20)
@given(st.floats(0.8, 5.0), st.floats(-3.0, 3.0).filter(lambda s: abs(s) > 0.1), st.floats(-5.0, 5.0))
def test_a_first_order_lag_has_its_known_metrics(rate, size, start):
    """1 - exp(-k t): rise time ln(9)/k, settling to 5 percent ln(20)/k, no overshoot; any size, sign and start."""
    metrics = metrics_of(_channels(size * (1 - np.exp(-rate * TIME)), start), np.array([size, 0.0, 0.0]))
    assert float(metrics.rise_time[0]) == pytest.approx(np.log(9) / rate, abs=1e-4)
    assert float(metrics.settling_time[0]) == pytest.approx(np.log(20) / rate, abs=6e-3)
    # What adding the start rounds away: an ulp of 5 at most, at either end, over the least size.
    assert float(metrics.overshoot[0]) <= 2 * np.spacing(5.0) / 0.1
    # the mean of what is left over the last 2 s
    remaining = np.mean(np.exp(-rate * np.asarray(TIME[3600:])))
    assert float(metrics.final_error[0]) == pytest.approx(remaining, abs=1e-9)
    np.testing.assert_allclose(metrics.coupling, [0.0, 0.0, 0.3], atol=1e-5)
    np.testing.assert_array_equal(metrics.stepped, [True, False, False])


@pytest.mark.parametrize("damping", [0.3, 0.5, 0.7])
def test_a_second_order_system_has_its_known_overshoot(damping):
    """exp(-pi zeta / sqrt(1 - zeta^2)) for a pair of poles."""
    w = 2.0 * np.sqrt(1 - damping**2)
    shape = 1 - np.exp(-2 * damping * TIME) * (np.cos(w * TIME) + 2 * damping / w * np.sin(w * TIME))
    metrics = metrics_of(_channels(shape), jnp.array([1.0, 0.0, 0.0]))
    assert float(metrics.overshoot[0]) == pytest.approx(np.exp(-np.pi * damping / np.sqrt(1 - damping**2)), abs=1e-4)


@pytest.mark.parametrize("share", [0.5, 0.05])
def test_an_unreached_step_has_infinite_rise_time(share):
    """Half of the step, or not even the 10 percent at which the rise begins."""
    metrics = metrics_of(_channels(share * (1 - np.exp(-TIME))), jnp.array([1.0, 0.0, 0.0]))
    assert float(metrics.rise_time[0]) == np.inf
    assert float(metrics.settling_time[0]) == np.inf
    assert float(metrics.final_error[0]) == pytest.approx(1.0 - share, abs=1e-6)
    np.testing.assert_array_equal(metrics.rise_time[1:], [0.0, 0.0])


def test_the_surface_utilization_uses_the_travel_on_either_side():
    surfaces = STILL.at[:, 0].set(0.1).at[5, 0].set(0.25).at[7, 1].set(-0.4).at[9, 2].set(0.2)
    time, measured, size = (jnp.asarray(x) for x in (TIME, _channels(TIME), [1.0, 0.0, 0.0]))
    metrics = jax.jit(step_metrics)(time, measured, size, surfaces, STOPS)
    np.testing.assert_allclose(metrics.surface_utilization, [0.5, 1.0, 0.5], rtol=1e-12)


@pytest.mark.parametrize("count", [1, 4])
def test_the_final_error_of_a_short_record_is_that_of_its_last_sample(count):
    measured, surfaces = np.tile(np.linspace(0.0, 1.5, count)[:, None], (1, 3)), np.zeros((count, 3))
    metrics = step_metrics(*map(jnp.asarray, (TIME[:count], measured, np.ones(3), surfaces)), STOPS)
    np.testing.assert_allclose(metrics.final_error, 1.0 - measured[-1])


@pytest.mark.long
def test_a_batch_equals_single_metrics():
    measured = np.stack([_channels(1 - np.exp(-k * TIME)) for k in (1.0, 2.0)])
    batch = jax.jit(jax.vmap(metrics_of, in_axes=(0, None)))(measured, jnp.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(batch.rise_time[:, 0], np.log(9) / np.array([1.0, 2.0]), atol=1e-4)
