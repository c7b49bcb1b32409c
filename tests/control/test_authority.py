"""Control authority against flights of the surfaces to their limits."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft.motion import angular_acceleration
from anser.control.allocation import surface_authority, surface_moments
from anser.units import DEG_RAD
from support.control_cases import AIRFRAME, QUICK, setting_of

LEVEL = np.array([150, 0.05, 0, 0, 0, 0, 0, 0, 0, -0.04, 0.0, 0.0, 20, 1000, 0, 0, 0])
SLOW = np.array([-5.0, 2.0, -3.0]) * DEG_RAD
SHARE = 0.3
"""Fraction of the authority available to one command."""


def _authority(x, surfaces_slow):
    setting = setting_of(x)
    moments = surface_moments(AIRFRAME, setting.condition, setting.state.rates_b, setting.state.surfaces)
    return surface_authority(AIRFRAME.actuators, AIRFRAME.mass_properties, moments, surfaces_slow)


authority_of = jax.jit(_authority)


@jax.jit
def acceleration_of(x, surfaces):
    setting = setting_of(x)
    moment_b = AIRFRAME.aerodynamics(setting.condition.air_data, setting.state.rates_b, surfaces).moment_b
    return angular_acceleration(AIRFRAME.mass_properties, setting.state.rates_b, moment_b)


def test_jerk_is_that_of_the_first_surface_at_its_rate_limit():
    """One axis at a time: the surfaces move in proportion until the first reaches its rate limit."""
    authority = authority_of(LEVEL, SLOW)
    time = 1e-3
    for axis in range(3):
        jerk = float(authority.rates_jerk[axis]) / SHARE
        rate = np.asarray(authority.deflection)[:, axis] * jerk
        assert np.max(np.abs(rate) / np.asarray(AIRFRAME.actuators.rate_limit)) == pytest.approx(1.0)
        # moments are linear in small deflections within one piece of the tables: rounding only
        gained = acceleration_of(LEVEL, LEVEL[9:12] + time * rate) - acceleration_of(LEVEL, LEVEL[9:12])
        np.testing.assert_allclose(gained / time, jerk * np.eye(3)[axis], atol=1e-9 * jerk + 1e-9)


def test_acceleration_is_that_of_the_first_surface_at_its_stop():
    """With the unit matrix for G, the outputs are the body axes; margins are measured from the slow deflections."""
    authority = authority_of(LEVEL, SLOW)
    upper = np.asarray(AIRFRAME.actuators.upper)
    np.testing.assert_allclose(authority.margin, upper - np.abs(SLOW))
    for axis in range(3):
        acceleration = float(authority.attitude_acceleration(jnp.eye(3))[axis]) / SHARE
        used = np.abs(np.asarray(authority.deflection)[:, axis]) * acceleration / np.asarray(authority.margin)
        assert used.max() == pytest.approx(1.0)


def test_authority_grows_with_dynamic_pressure_and_outputs_that_turn_more():
    faster = LEVEL.copy()
    faster[0] = 300.0
    slow, fast = authority_of(LEVEL, SLOW), authority_of(faster, SLOW)
    # four times the dynamic pressure; the tables do not know the Mach number
    np.testing.assert_allclose(fast.rates_jerk / slow.rates_jerk, 4.0, rtol=1e-9)
    doubled = slow.attitude_acceleration(2.0 * jnp.eye(3)) / slow.attitude_acceleration(jnp.eye(3))
    np.testing.assert_allclose(doubled, 2.0)


def test_a_surface_at_its_stop_keeps_a_little_authority():
    """The margin is at least a tenth of the half range, which keeps the loops active."""
    at_stop = authority_of(LEVEL, np.asarray(AIRFRAME.actuators.upper))
    np.testing.assert_allclose(at_stop.margin, 0.1 * np.asarray(AIRFRAME.actuators.upper))


@pytest.mark.long
def test_batches_and_gradients_are_finite():
    slow = jnp.stack([jnp.asarray(SLOW), jnp.zeros(3)])
    batch = jax.jit(jax.vmap(_authority, in_axes=(None, 0)), compiler_options=QUICK)(LEVEL, slow)
    np.testing.assert_allclose(batch.margin[0], authority_of(LEVEL, SLOW).margin)
    slopes_of = jax.jit(
        jax.jacfwd(lambda x: _authority(x, SLOW).attitude_acceleration(jnp.eye(3))), compiler_options=QUICK
    )
    slope = slopes_of(jnp.asarray(LEVEL))
    assert np.isfinite(slope).all()
