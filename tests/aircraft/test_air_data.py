"""Air data of a velocity through the air (theory section 2)."""

import jax
import jax.numpy as jnp
import numpy as np

from anser.aircraft.air_data import air_data
from anser.environment import StandardAtmosphere


def test_air_data_of_a_known_flow():
    # 3-4-12: V = 13; alpha = atan2(W, U), beta = asin(V_y / V).
    air = StandardAtmosphere().at(0.0)
    data = air_data(jnp.array([12.0, 3.0, 4.0]), 0.0, air)
    np.testing.assert_allclose(data.V, 13.0, rtol=1e-15)
    np.testing.assert_allclose(data.alpha, np.arctan2(4.0, 12.0), rtol=1e-15)
    np.testing.assert_allclose(data.beta, np.arcsin(3.0 / 13.0), rtol=1e-14)
    # 1.225 kg/m^3 and 340.294 m/s, [USSA76] at sea level, to the digits printed.
    np.testing.assert_allclose(data.qbar, 0.5 * 1.2250 * 169, rtol=1e-5)
    np.testing.assert_allclose(data.mach, 13 / 340.294, rtol=1e-5)


def test_the_altitude_is_always_an_array():
    data = air_data(jnp.array([100.0, 0.0, 5.0]), 2000, StandardAtmosphere().at(2000.0))
    assert data.altitude.shape == ()
    assert float(data.altitude) == 2000.0


def test_gradients_are_finite_at_rest_and_without_sideslip():
    def total(velocity_b, altitude):
        data = air_data(velocity_b, altitude, StandardAtmosphere().at(altitude))
        return data.V + data.alpha + data.beta + data.qbar + data.mach

    for velocity_b in ([0.0, 0.0, 0.0], [150.0, 0.0, 0.0], [0.0, 10.0, 0.0]):
        gradient = jax.grad(total, argnums=(0, 1))(jnp.array(velocity_b), 1000.0)
        assert all(jnp.isfinite(leaf).all() for leaf in gradient)


def test_batches_and_compiled_code_equal_single_evaluations():
    velocities = jnp.array([[150.0, 3.0, 20.0], [80.0, -9.0, 30.0]])
    air = StandardAtmosphere().at(3000.0)
    batch_data = jax.jit(jax.vmap(lambda v: air_data(v, 3000.0, air)))(velocities)
    for k, velocity in enumerate(velocities):
        single = air_data(velocity, 3000.0, air)
        np.testing.assert_allclose(
            [batch_data.alpha[k], batch_data.beta[k], batch_data.qbar[k]],
            [single.alpha, single.beta, single.qbar],
            rtol=1e-14,
        )
