"""F-16 with lags shorter than a step resolves."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft.actuators import Deflections
from anser.aircraft.air_data import air_data
from anser.aircraft.engines import EnginePower
from anser.aircraft_files import load_airframe
from anser.environment import StandardAtmosphere
from anser.numerics import rk4_step
from anser.verification.nesc_flight import prompt_f16

STEP_S = 0.0025


@pytest.fixture(scope="module")
def air():
    return air_data(jnp.array([170.0, 0.0, 8.0]), jnp.asarray(3000.0), StandardAtmosphere().at(jnp.asarray(3000.0)))


def test_a_quarter_of_a_difference_remains_after_a_step(air):
    airframe = prompt_f16(STEP_S)
    command = jnp.array([0.1, -0.2, 0.3])

    def rates(t, y):
        return airframe.actuators.rate(y[0], command, air), airframe.engine.rate(y[1], jnp.asarray(0.4), air)

    start = Deflections(jnp.zeros(3)), EnginePower(jnp.asarray(20.0))
    surfaces, engine = jax.jit(lambda y: rk4_step(rates, jnp.asarray(0.0), y, STEP_S))(start)
    # Polynomial of the classical Runge-Kutta method at -1.6.
    remainder = 1 - 1.6 + 1.6**2 / 2 - 1.6**3 / 6 + 1.6**4 / 24
    np.testing.assert_allclose(surfaces.position, (1 - remainder) * command, rtol=1e-12)
    assert float(engine.power) == pytest.approx(40.0 - remainder * 20.0, rel=1e-12)
    assert 0.26 < remainder < 0.28


def test_the_prompt_aircraft_otherwise_equals_the_published_aircraft(air):
    prompt, published = prompt_f16(STEP_S), load_airframe("f16", "s119")
    rates_b, surfaces = jnp.array([0.1, 0.05, -0.02]), jnp.array([-0.05, 0.02, 0.01])
    aerodynamics = jax.jit(lambda airframe: airframe.aerodynamics(air, rates_b, surfaces))
    a, b = (aerodynamics(airframe) for airframe in (prompt, published))
    np.testing.assert_array_equal(a.force_b, b.force_b)
    np.testing.assert_array_equal(a.moment_b, b.moment_b)
    propulsion = jax.jit(lambda engine: engine.propulsion(30.0, air).force_b)
    thrusts = [propulsion(airframe.engine) for airframe in (prompt, published)]
    np.testing.assert_array_equal(*thrusts)
    power_for_thrust = jax.jit(lambda engine: engine.power_for_thrust(thrusts[0][0], air))
    for airframe in (prompt, published):
        assert float(power_for_thrust(airframe.engine)) == pytest.approx(30.0, rel=1e-12)
    assert float(prompt.engine.throttle_for_power(30.0)) == pytest.approx(0.3, rel=1e-14)
    assert float(prompt.engine.throttle_for_power_rate(30.0, 1e5)) == 1.0
    assert not bool(prompt.engine.outside_tables(air))
