"""The engine of [SL] appendix A: gearing, lag, thrust and their inverses (theory section 4)."""

import functools
import json
from importlib import resources

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from anser.aircraft.f16 import f16_from_data
from anser.units import FOOT_M, LBF_N
from support.states import air_at

DATA = json.loads(resources.files("anser.aircraft").joinpath("data/f16.json").read_text(encoding="utf-8"))
ENGINE = f16_from_data(DATA).engine
PERCENT = st.floats(0.0, 100.0)

power_rate = jax.jit(lambda *x: ENGINE.power_rate(*x))
gearing, throttle_for_power = jax.jit(lambda t: ENGINE.gearing(t)), jax.jit(lambda p: ENGINE.throttle_for_power(p))
command_for_rate = jax.jit(lambda *x: ENGINE.power_command_for_rate(*x))
thrust = jax.jit(lambda *x: ENGINE.thrust(*x))
power_for_thrust = jax.jit(lambda T, altitude, mach: ENGINE.power_for_thrust(T, air_at(altitude, mach)))
rates_of_all_commands = jax.jit(
    lambda power: jax.vmap(lambda c: ENGINE.power_rate(power, c))(jnp.linspace(0.0, 100.0, 10001))
)


@pytest.mark.parametrize(
    ("throttle", "power"),
    [(0.0, 0.0), (0.5, 32.47), (0.77, 50.0038), (0.9, 78.262), (1.0, 100.0), (-0.2, 0.0), (1.3, 100.0)],
)
def test_the_gearing_equals_the_published_one(throttle, power):
    # Theory section 4: 64.94 t up to 0.77, 217.38 t - 117.38 above; held at its stops.
    assert float(gearing(throttle)) == pytest.approx(power, abs=1e-12)


@settings(deadline=None, max_examples=50)
@given(power=PERCENT)
def test_the_throttle_is_the_inverse_of_the_gearing(power):
    # The published gearing jumps down by 0.0012 percent at throttle 0.77; powers inside the jump come out within it.
    assert float(gearing(throttle_for_power(power))) == pytest.approx(power, abs=0.00121)


@settings(deadline=None, max_examples=50)
@given(throttle=st.floats(0.0, 1.0))
def test_the_gearing_is_the_inverse_of_the_throttle(throttle):
    # 0.0012 percent over the lower slope 64.94 percent.
    assert float(throttle_for_power(gearing(throttle))) == pytest.approx(throttle, abs=2e-5)


@pytest.mark.parametrize(
    ("power", "command", "rate"),
    [
        (60.0, 80.0, 5 * (80 - 60)),  # lit and stays lit: 5 1/s toward the command
        (90.0, 55.0, 5 * (55 - 90)),
        (30.0, 80.0, (1.9 - 0.036 * 30) * 30),  # not yet lit: toward 60 at k(60 - 30)
        (45.0, 80.0, 1.0 * 15),
        (5.0, 100.0, 0.1 * 55),
        (70.0, 20.0, 5 * (40 - 70)),  # lit and must go out: 5 1/s toward 40
        (20.0, 40.0, 1.0 * 20),  # dry: k of the gap
        (10.0, 45.0, (1.9 - 0.036 * 35) * 35),
        (0.0, 49.9, (1.9 - 0.036 * 49.9) * 49.9),
        (40.0, 10.0, 1.0 * -30),
        (50.0, 50.0, 0.0),
    ],
)
def test_the_lag_equals_the_published_branches(power, command, rate):
    assert float(power_rate(power, command)) == pytest.approx(rate, abs=1e-12)


@settings(deadline=None, max_examples=100)
@given(power=PERCENT, wanted=st.floats(-60.0, 60.0))
def test_the_command_gives_the_required_rate_where_possible(power, wanted):
    reachable = np.asarray(rates_of_all_commands(power))
    # The grid's own resolution in rate is 5 1/s times 0.01 percent.
    assume(np.min(np.abs(reachable - wanted)) < 0.05)
    # What would be commanded just below 50 percent is commanded across it, and there the lag is another.
    assume(power >= 50.0 or not 49.95 < power + wanted < 50.06)
    # The fastest dry rate is 25.07 percent/s, at a gap of 26.4; the inverse stops at the 25 of a gap of 25.
    assert float(power_rate(power, command_for_rate(power, wanted))) == pytest.approx(wanted, abs=0.13)


@pytest.mark.parametrize(("power", "wanted"), [(45.0, 20.0), (49.0, 3.0), (52.0, -20.0), (50.0, -1.0)])
def test_the_command_crosses_half_power_without_sticking(power, wanted):
    rates, start = [], power
    for _ in range(100):
        rate = float(power_rate(power, command_for_rate(power, wanted)))
        rates.append(rate)
        power += 0.01 * rate
    assert (np.array(rates) * wanted > 0).all()
    assert (power - 50) * (start - 50 - 1e-9 * np.sign(wanted)) < 0


@settings(deadline=None, max_examples=50)
@given(power=PERCENT, altitude_ft=st.floats(0.0, 50000.0), mach=st.floats(0.0, 1.0))
def test_the_power_for_a_thrust_is_the_inverse_of_the_thrust(power, altitude_ft, mach):
    altitude = altitude_ft * FOOT_M
    # Almost at rest above 40,000 ft the published idle thrust exceeds military thrust: no inverse, and no flight.
    assume(thrust(50.0, altitude, mach) - thrust(0.0, altitude, mach) > 1500.0)
    inverse_power = power_for_thrust(thrust(power, altitude, mach), altitude, mach)
    # There thrust rises by at least 30 N per percent: rounding is far below.
    assert float(inverse_power) == pytest.approx(power, abs=1e-9)


def test_the_power_for_a_thrust_stays_within_limits():
    assert float(power_for_thrust(-5000.0, 3000.0, 0.5)) == 0.0
    assert float(power_for_thrust(1e6, 3000.0, 0.5)) == 100.0


def test_the_thrust_at_table_nodes_is_exact():
    for i, altitude_ft in enumerate(DATA["axes"]["altitude_ft"]):
        for j, mach in enumerate(DATA["axes"]["mach"]):
            for power, name in ((0.0, "T_idle"), (50.0, "T_mil"), (100.0, "T_max")):
                expected = DATA["tables"][name]["values"][i][j] * LBF_N
                assert float(thrust(power, altitude_ft * FOOT_M, mach)) == pytest.approx(expected, abs=1e-6)


def _exactly(altitude, mach):
    """Air data with a bit-exact Mach number, on the edge of the tables."""
    return eqx.tree_at(lambda d: d.mach, air_at(altitude, mach), jnp.asarray(mach))


def test_conditions_outside_the_thrust_tables_are_reported():
    inside = [ENGINE.outside_tables(_exactly(*case)) for case in ((0.0, 0.0), (50000 * FOOT_M, 1.0), (5000.0, 0.5))]
    outside = [ENGINE.outside_tables(_exactly(*case)) for case in ((-1.0, 0.5), (15241.0, 0.5), (5000.0, 1.01))]
    assert not np.any(inside)
    assert np.all(outside)


@jax.jit
@functools.partial(jax.grad, argnums=(0, 1, 2, 3))
def slopes_of_total(power, throttle, altitude, mach):
    rate = ENGINE.power_rate(power, ENGINE.gearing(throttle))
    command = ENGINE.power_command_for_rate(power, rate)
    back = ENGINE.power_for_thrust(ENGINE.thrust(power, altitude, mach), air_at(altitude, mach))
    return rate + command + back + ENGINE.throttle_for_power(command)


@pytest.mark.parametrize("power", [0.0, 50.0, 100.0])
def test_gradients_are_finite_at_the_joints(power):
    assert np.isfinite(slopes_of_total(power, 0.77, 10000 * FOOT_M, 0.6)).all()


def test_batches_equal_single_evaluations():
    powers = jnp.array([10.0, 49.0, 51.0, 90.0])
    batch = jax.jit(jax.vmap(lambda p: ENGINE.thrust(p, 4000.0, 0.55)))(powers)
    np.testing.assert_allclose(batch, [float(thrust(p, 4000.0, 0.55)) for p in powers], rtol=1e-14)
