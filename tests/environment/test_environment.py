"""The environment as a pytree: default values, and new numbers without a new compilation."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from anser.environment import Environment, FlatEarth, StandardAtmosphere, SteadyWind, standard_environment
from anser.environment.earth import somigliana


def test_the_default_environment_is_still_standard_air():
    environment = standard_environment()
    assert environment.gravity == 9.80665
    assert isinstance(environment.atmosphere, StandardAtmosphere)
    np.testing.assert_array_equal(environment.wind.at(jnp.zeros(3), 0.0), np.zeros(3))


def test_latitude_and_wind_set_gravity_and_drift():
    environment = standard_environment(0.6, jnp.array([1.0, 2.0, 0.0]))
    assert environment.gravity == somigliana(0.6)
    np.testing.assert_array_equal(environment.wind.at(jnp.zeros(3), 0.0), [1.0, 2.0, 0.0])


def test_numbers_vary_without_a_new_compilation():
    @eqx.filter_jit
    @eqx.debug.assert_max_traces(max_traces=1)
    def weight_and_drift(environment):
        air = environment.atmosphere.at(1000.0)
        return air.density * environment.gravity, environment.wind.at(jnp.zeros(3), 0.0)

    standard_weight, _ = weight_and_drift(standard_environment())
    new_weight, drift = weight_and_drift(standard_environment(0.3, jnp.array([0.0, 5.0, 0.0])))
    assert standard_weight != new_weight
    np.testing.assert_array_equal(drift, [0.0, 5.0, 0.0])


def test_environments_support_batches_and_gradients():
    """One environment per aircraft under vmap; the gradient reaches wind and gravity."""

    def drift_energy(environment):
        wind = environment.wind.at(jnp.zeros(3), 0.0)
        return environment.gravity * jnp.sum(wind**2)

    latitudes = jnp.array([0.1, 0.9])
    winds = jnp.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    fleet = jax.jit(jax.vmap(standard_environment))(latitudes, winds)
    expected = np.array([somigliana(latitude) for latitude in latitudes]) * [1.0, 4.0]
    np.testing.assert_allclose(jax.jit(jax.vmap(drift_energy))(fleet), expected, rtol=1e-15)
    environment = Environment(StandardAtmosphere(), SteadyWind(jnp.array([3.0, 4.0, 0.0])), FlatEarth(jnp.asarray(9.8)))
    gradient = jax.jit(jax.grad(drift_energy))(environment)
    assert gradient.gravity == 25.0
    np.testing.assert_allclose(gradient.wind.velocity_n, 9.8 * 2.0 * np.array([3.0, 4.0, 0.0]), rtol=1e-15)
