"""Engines with propellers and jets: the published thrust, torques in balance, inverses that undo, finite gradients."""

import json
from importlib import resources

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.aircraft import AirData, ElectricPropeller, JetEngine, PistonPropeller
from anser.aircraft.engines import EnginePower, InstantEngine
from anser.aircraft_files import load_airframe
from anser.numerics import make_axes, make_tables

AEROSONDE = load_airframe("aerosonde").engine
assert isinstance(AEROSONDE, ElectricPropeller)
PUBLISHED = json.loads(resources.files("anser.verification").joinpath("data/aerosonde_checks.json").read_text())
ONE, ZERO3 = jnp.asarray(1.0), jnp.zeros(3)
PISTON = PistonPropeller(
    shaft_power=jnp.asarray(120e3),
    efficiency=jnp.asarray(0.8),
    static_thrust=jnp.asarray(2500.0),
    torque_per_power=jnp.asarray(-1 / 280.0),
    lag=jnp.asarray(0.8),
    point_b=jnp.asarray([1.0, 0.0, 0.1]),
    thrust_factor=ONE,
)
JET = JetEngine(
    thrust_tables=make_tables(
        make_axes([[0.0, 5000.0, 10000.0], [0.0, 0.5, 1.0]], clamp=True),
        [((0, 1), [np.array([[1, 0, -1]] * 3) * 1e3, np.array([[9, 8, 7], [6, 5, 5], [3, 3, 4]]) * 1e3])],
    ),
    lag=jnp.asarray(2.0),
    point_b=jnp.asarray([0.0, 0.0, 0.5]),
    thrust_factor=ONE,
)
ENGINES = {"electric": AEROSONDE, "piston": PISTON, "jet": JET}
named = pytest.mark.parametrize("name", ENGINES)


def air(V, density=1.2, altitude=100.0):
    V, density = jnp.asarray(float(V)), jnp.asarray(float(density))
    zero = jnp.zeros(())
    return AirData(V, zero, zero, density, 0.5 * density * V * V, V / 340.0, jnp.asarray(float(altitude)))


propulsion = eqx.filter_jit(lambda engine, power, data: engine.propulsion(jnp.asarray(power), data))
motor_speed = eqx.filter_jit(lambda engine, power, data: engine.motor_speed(jnp.asarray(power), data))
torque_of = eqx.filter_jit(lambda engine, power, data: engine.thrust_and_torque(jnp.asarray(power), data)[1])
_power_for_thrust = eqx.filter_jit(lambda engine, thrust, data: engine.power_for_thrust(thrust, data))
_throttles = eqx.filter_jit(
    lambda engine, power, rate: (engine.throttle_for_power_rate(power, rate), engine.throttle_for_power(power))
)
_power_rate = eqx.filter_jit(
    lambda engine, power, throttle, data: engine.rate(EnginePower(power), throttle, data).power
)


def thrust_along_x(engine, power, data):
    return engine.propulsion(power, data).force_b[0]


_thrust = eqx.filter_jit(thrust_along_x)


def thrust(engine, power, data):
    return _thrust(engine, np.asarray(power), data)


_thrusts = eqx.filter_jit(jax.vmap(thrust_along_x, in_axes=(None, 0, None)))


def power_for_thrust(engine, required, data):
    return _power_for_thrust(engine, np.asarray(required), data)


@pytest.mark.parametrize("case", PUBLISHED["checks"], ids=lambda case: case["name"])
def test_thrust_and_torque_equal_the_authors_figures(case):
    """[BM] addendum; the `torque` in the authors' simulator is the propeller's; the reaction rolls left."""
    data = air(case.get("V", 25.0), PUBLISHED["rho_check_kg_m3"])
    wrench = propulsion(AEROSONDE, np.asarray(100.0 * case["controls"]["throttle"]), data)
    assert float(wrench.force_b[0]) == pytest.approx(case["thrust_N"], abs=1e-10)
    assert float(wrench.moment_b[0]) == pytest.approx(-case["torque_Nm"], abs=1e-10)


@given(power=st.floats(1.0, 100.0), V=st.floats(0.0, 45.0), density=st.floats(0.6, 1.3))
@settings(max_examples=50, deadline=None)
def test_motor_and_propeller_torques_balance(power, V, density):
    data = air(V, density)
    omega = float(motor_speed(AEROSONDE, np.asarray(power), data))
    constant, resistance = float(AEROSONDE.motor_constant), float(AEROSONDE.resistance)
    current = (float(AEROSONDE.voltage_max) * power / 100 - constant * omega) / resistance
    motor = constant * (current - float(AEROSONDE.no_load_current))
    torque = torque_of(AEROSONDE, np.asarray(power), data)
    if omega > 0:
        assert float(motor) == pytest.approx(float(torque), abs=1e-9)
    else:
        assert float(motor) <= float(torque) + 1e-9  # friction holds it


@given(power=st.floats(0.0, 100.0), V=st.floats(0.0, 45.0), density=st.floats(0.6, 1.3))
@settings(max_examples=60, deadline=None)
def test_the_power_for_a_thrust_gives_that_thrust(power, V, density):
    data = air(V, density)
    for engine in ENGINES.values():
        required = thrust(engine, power, data)
        inverse_power = power_for_thrust(engine, required, data)
        assert 0.0 <= float(inverse_power) <= 100.0
        assert float(thrust(engine, inverse_power, data)) == pytest.approx(float(required), rel=1e-6, abs=1e-5)


@given(wanted=st.floats(-80.0, 300.0), V=st.floats(0.0, 45.0))
@settings(max_examples=50, deadline=None)
def test_no_power_comes_nearer_to_a_thrust(wanted, V):
    """The nearest available thrust; the power of least thrust need not be 0."""
    data = air(V)
    inverse_power = power_for_thrust(AEROSONDE, wanted, data)
    best = np.abs(np.asarray(_thrusts(AEROSONDE, np.linspace(0, 100, 501), data)) - wanted).min()
    assert abs(float(thrust(AEROSONDE, inverse_power, data)) - wanted) <= best + 1e-6


def test_a_slow_propeller_in_fast_air_brakes():
    assert float(thrust(AEROSONDE, 20.0, air(30.0))) < -20.0
    # at rest nothing brakes, and a motor without voltage does not turn backwards
    assert float(thrust(AEROSONDE, 0.0, air(0.0))) == 0.0
    assert float(motor_speed(AEROSONDE, np.asarray(0.0), air(0.0))) == 0.0


def test_a_left_handed_propeller_rolls_the_aircraft_to_the_right():
    left_handed = eqx.tree_at(lambda e: e.direction, AEROSONDE, -ONE)
    a, b = (propulsion(engine, np.asarray(80.0), air(20.0)) for engine in (AEROSONDE, left_handed))
    assert float(a.moment_b[0]) == -float(b.moment_b[0]) < 0.0
    np.testing.assert_array_equal(a.force_b, b.force_b)


def test_piston_power_falls_with_density_and_thrust_is_limited_at_rest():
    """Gagg and Farrar: no power at 0.132 / 1.132 of the sea-level density."""
    assert float(thrust(PISTON, 100.0, air(0.0, 1.225))) == pytest.approx(2500.0)
    fast = air(80.0, 1.225)
    assert float(thrust(PISTON, 100.0, fast)) * 80.0 == pytest.approx(0.8 * 120e3, rel=0.15)
    half = float(thrust(PISTON, 100.0, air(80.0, 0.6125))) / float(thrust(PISTON, 100.0, fast))
    assert half == pytest.approx(1.132 * 0.5 - 0.132)
    assert float(thrust(PISTON, 100.0, air(80.0, 0.05))) > 0.0
    wrench = propulsion(PISTON, np.asarray(100.0), fast)
    assert float(wrench.moment_b[0]) == pytest.approx(-120e3 / 280.0)
    assert float(wrench.moment_b[1]) == pytest.approx(0.1 * float(wrench.force_b[0]))  # from below: nose up


def test_the_jet_follows_its_tables():
    at_node = AirData(*(jnp.asarray(x) for x in (170.0, 0.0, 0.0, 0.7, 1e4, 0.5, 5000.0)))
    assert float(thrust(JET, 0.0, at_node)) == 0.0
    assert float(thrust(JET, 100.0, at_node)) == pytest.approx(5000.0)
    assert float(thrust(JET, 40.0, at_node)) == pytest.approx(2000.0)
    assert not JET.outside_tables(at_node)
    assert JET.outside_tables(air(10.0, altitude=10001.0))


@named
@given(power=st.floats(0.0, 100.0), rate=st.floats(-200.0, 200.0))
@settings(max_examples=30, deadline=None)
def test_the_throttle_for_a_rate_gives_that_rate_where_possible(name, power, rate):
    engine, data = ENGINES[name], air(20.0)
    throttle, steady_throttle = _throttles(engine, np.asarray(power), np.asarray(rate))
    given_rate = float(_power_rate(engine, np.asarray(power), throttle, data))
    slowest, fastest = -power / float(engine.lag), (100 - power) / float(engine.lag)
    assert given_rate == pytest.approx(np.clip(rate, slowest, fastest), abs=1e-9)
    assert float(_power_rate(engine, np.asarray(power), steady_throttle, data)) == pytest.approx(0.0, abs=1e-9)


def test_an_engine_without_lag_changes_its_power_at_the_required_rate_over_a_period():
    instant = InstantEngine(JET, np.asarray(0.05))
    throttle = instant.throttle_for_power_rate(40.0, -100.0)
    assert float(instant.before_step(EnginePower(np.asarray(40.0)), throttle).power) == pytest.approx(35.0)


@pytest.mark.long
@named
def test_gradients_are_finite_at_rest_and_at_every_edge(name):
    engine = ENGINES[name]

    @jax.jit
    @jax.vmap
    def slopes(power, V):
        forward = jax.grad(lambda p, v: thrust_along_x(engine, p, air_of(v)), argnums=(0, 1))(power, V)
        back = jax.grad(lambda t, v: engine.power_for_thrust(t, air_of(v)), argnums=(0, 1))(-1e3, V)
        return *forward, *back

    powers, speeds = (x.ravel() for x in np.meshgrid((0.0, 13.7, 100.0), (0.0, 1e-9, 13.0, 40.0)))
    assert np.all(np.isfinite(slopes(powers, speeds)))


def air_of(V):
    zero = 0.0 * V
    density = 1.2 + zero
    return AirData(V, zero, zero, density, 0.5 * density * V * V, V / 340.0, 100.0 + zero)


@pytest.mark.long
@named
def test_batches_and_compiled_code_equal_single_evaluations(name):
    engine = ENGINES[name]
    powers, speeds = np.linspace(0.0, 100.0, 7), np.linspace(0.0, 40.0, 7)
    alone = [thrust_along_x(engine, p, air_of(v)) for p, v in zip(powers, speeds, strict=True)]
    batch = jax.jit(jax.vmap(lambda p, v: thrust_along_x(engine, p, air_of(v))))(powers, speeds)
    np.testing.assert_allclose(batch, alone, rtol=1e-12)
    np.testing.assert_allclose(thrust(engine, powers[3], air_of(speeds[3])), alone[3], rtol=1e-12)


@named
def test_the_thrust_is_extrapolated_beyond_the_power_range(name):
    """Extrapolation shows a trim solver the excess of power."""
    data = air(20.0)
    low, high = thrust(ENGINES[name], -10.0, data), thrust(ENGINES[name], 110.0, data)
    assert float(low) < float(thrust(ENGINES[name], 0.0, data))
    assert float(high) > float(thrust(ENGINES[name], 100.0, data))
