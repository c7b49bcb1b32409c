"""The autopilot as a controller: what it records where an inner loop is commanded directly."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.control import InversionAutopilot, LoopCommand, default_limits, published_gains
from anser.control.autopilot import rates_at_limit
from anser.simulation.response import exact_belief
from support.autopilot_cases import ENVIRONMENT, memory_of
from support.control_cases import AIRFRAME, QUICK

LIMITS = default_limits()


@pytest.mark.parametrize(
    ("loop", "command", "rates_b"),
    [
        ("attitude", (3.0, 0.0, 0.0), None),
        ("rates", (4.0, 1.0, 0.0), (4.0, 1.0, 0.0)),
    ],
)
def test_inner_loops_record_commanded_rates_and_limits(trims, loop, command, rates_b):
    trim = trims[0]
    autopilot = InversionAutopilot(published_gains(), LIMITS, loop=loop)

    @functools.partial(jax.jit, compiler_options=QUICK)
    def variables(value):
        belief = exact_belief(AIRFRAME, ENVIRONMENT, trim.state)
        commanded = LoopCommand(value, jnp.zeros(3), 0.2)
        return autopilot.control(memory_of(trim), belief, commanded, jnp.asarray(0.01))[1].variables()

    recorded = variables(jnp.array(command))
    rates = [recorded[f"{axis}_rate_command"] for axis in ("roll", "pitch", "yaw")]
    assert bool(recorded["surfaces_limited"])
    if rates_b is None:
        assert bool(recorded["rates_limited"])
        assert np.max(np.abs(rates) / LIMITS.rates_max) == pytest.approx(1.0)
    else:
        assert not bool(recorded["rates_limited"])
        np.testing.assert_array_equal(rates, rates_b)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_rates_scaled_to_the_limit_are_at_the_limit_in_either_precision(dtype):
    unlimited = np.random.default_rng(1).normal(0.0, 5.0, (20_000, 3)).astype(dtype)
    rates_max = np.asarray(LIMITS.rates_max, dtype)
    factor = np.maximum(np.max(np.abs(unlimited) / rates_max, axis=1, keepdims=True), dtype(1.0))
    at_limit = np.asarray(jax.vmap(rates_at_limit, in_axes=(0, None))(jnp.asarray(unlimited / factor), rates_max))
    np.testing.assert_array_equal(at_limit, factor[:, 0] > 1.0)
