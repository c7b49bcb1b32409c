"""Gains derived from the aircraft: as published for the F-16; lower for slow actuators, sampling, surfaces."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft import air_data_and_forces
from anser.aircraft_files import load_airframe
from anser.analysis import margins_at
from anser.control import automatic_gains, published_gains
from anser.control.gains import derived_bandwidths
from anser.control.loop_separations import LOOP_SEPARATION_MIN
from anser.environment import standard_environment
from support.light_aircraft import light_aircraft
from support.loops import separations_of
from support.trims import target_deg, trim

ENVIRONMENT = standard_environment()


@eqx.filter_jit
def bandwidths_of(airframe, point, step):
    condition = air_data_and_forces(airframe, ENVIRONMENT, 0.0, point.state)
    return derived_bandwidths(airframe, condition, point.state.surfaces, point.power, step)


@pytest.fixture(scope="module")
def light():
    airframe = light_aircraft()
    return airframe, trim(airframe, ENVIRONMENT, target_deg(53.0, 500.0))


def test_derived_gains_of_the_f16_are_the_published_gains():
    f16 = load_airframe()
    derived = automatic_gains(bandwidths_of(f16, trim(f16, ENVIRONMENT, target_deg(150.0, 1000.0)), 0.01))
    for name, derived_leaf, published_leaf in zip(
        vars(published_gains()), jax.tree.leaves(derived), jax.tree.leaves(published_gains()), strict=False
    ):
        # the ratios are the published ones; the lag of the actuators, 1/20.2 s, is not 1/20 s, the sample bounds it
        np.testing.assert_allclose(derived_leaf, published_leaf, rtol=1e-9, err_msg=name)


def test_bandwidths_follow_actuators_sampling_and_authority(light):
    airframe, point = light
    nominal = bandwidths_of(airframe, point, 0.01)
    slow = eqx.tree_at(lambda a: a.actuators.time_constant, airframe, 2.0 * airframe.actuators.time_constant)
    np.testing.assert_allclose(bandwidths_of(slow, point, 0.01).rates[0], 0.5 * nominal.rates[0], rtol=1e-12)
    assert np.all(nominal.rates >= nominal.rates[0])
    np.testing.assert_allclose(bandwidths_of(airframe, point, 0.05).actuators, 8.0)
    # ailerons that hardly reach anything: roll waits, and yaw, which they have to balance
    weak = eqx.tree_at(
        lambda a: (a.actuators.lower, a.actuators.upper),
        airframe,
        (airframe.actuators.lower.at[1].set(-0.002), airframe.actuators.upper.at[1].set(0.002)),
    )
    derived = bandwidths_of(weak, point, 0.01)
    assert derived.rates[0] < 0.2 * nominal.rates[0]
    np.testing.assert_allclose(derived.rates[1], nominal.rates[1], rtol=1e-12)
    assert derived.velocity[2] < 0.2 * nominal.velocity[2]


@pytest.mark.long
def test_pitch_and_yaw_bandwidths_follow_from_the_cancelled_stiffness():
    uav = load_airframe("aerosonde")
    derived = bandwidths_of(uav, trim(uav, ENVIRONMENT, target_deg(25.0, 500.0)), 0.01)
    # by hand: -M_alpha = 0.5 rho V^2 S c 2.74/Jyy; an actuator with 3 times its gain, 2 of it beyond what is wanted
    qbar, lag, actuators = 0.5 * 1.1673 * 25.0**2, 0.05, 40.0
    stiffness = qbar * 0.55 * 0.18994 * 2.74 / 1.135
    share = 2.0 / (3.0 * lag * actuators * 2.0)
    np.testing.assert_allclose(derived.rates[1] * derived.attitude[1], share * stiffness, rtol=1e-3)
    np.testing.assert_allclose(derived.rates[np.array([0, 2])], 5.0)


@pytest.mark.long
@pytest.mark.parametrize("speed_m_s", [20.0, 25.0, 30.0])
def test_the_small_uav_keeps_six_decibels_and_forty_degrees(speed_m_s):
    margins = margins_at("aerosonde", speed_m_s=speed_m_s, altitude_m=500.0)
    assert float(margins["gain_margin_db"].min()) > 6.0
    assert float(margins["phase_margin_deg"].min()) > 40.0


def test_loop_bandwidths_stay_separated(light):
    airframe, point = light
    for pair in separations_of(automatic_gains(bandwidths_of(airframe, point, 0.01))):
        assert pair.ratio >= LOOP_SEPARATION_MIN - 1e-9, pair


@pytest.mark.long
def test_derivatives_are_finite(light):
    airframe, point = light

    def total(step):
        return sum(jnp.sum(leaf) for leaf in jax.tree.leaves(bandwidths_of(airframe, point, step)))

    assert jnp.isfinite(jax.grad(total)(0.02))
