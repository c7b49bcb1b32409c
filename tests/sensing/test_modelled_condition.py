"""Estimators with an onboard model: air data as measured, gusts included, forces and moments of the model."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import anser
from anser.aircraft.air_data import Disturbance
from anser.aircraft.corrected_airframe import without_aerodynamics
from anser.aircraft.motion import air_data_and_forces
from anser.aircraft_files.library import load_airframe
from anser.environment.environment import standard_environment
from anser.environment.gusts import Gust
from anser.parts.perception import Instant, Reading
from anser.sensing.adaptation import adaptive_estimator
from anser.sensing.estimators import TrackingEstimator
from anser.sensing.navigation import AirFilter
from anser.single_aircraft.starts import resolve_start
from anser.spatial.wind_axes import air_direction_b

AIRFRAME, ENVIRONMENT = load_airframe("f16"), standard_environment()
GUST = Disturbance(Gust(jnp.asarray([1.0, 2.0, -3.0]), jnp.zeros(3)), jnp.asarray(1.0))
INSTANT = Instant(ENVIRONMENT, jnp.asarray(0, dtype=jnp.int32), jnp.asarray(0.01), None)


condition_in_a_gust = jax.jit(
    lambda airframe, state: air_data_and_forces(airframe, ENVIRONMENT, 0.0, state, disturbance=GUST)
)
air_data_of = jax.jit(lambda reading: reading.air_data(ENVIRONMENT))


@eqx.filter_jit
def estimated(estimator, reading, airframe):
    return estimator.estimate(estimator.init(reading, airframe, INSTANT), reading, airframe, INSTANT)


@functools.cache
def reading_in_a_gust():
    trim = anser.aircraft("f16").trim(speed_m_s=150.0, altitude_m=1000.0)
    state = resolve_start(AIRFRAME, ENVIRONMENT, trim).state
    condition = condition_in_a_gust(AIRFRAME, state)
    return Reading(state, condition, condition.wrench.force_b / AIRFRAME.mass_properties.mass, None)


def test_the_estimator_without_filters_has_the_model_at_the_measured_air_data():
    reading = reading_in_a_gust()
    heavier = eqx.tree_at(lambda a: a.wing_area, AIRFRAME, 1.1 * AIRFRAME.wing_area)
    belief, _ = estimated(TrackingEstimator(model=heavier), reading, AIRFRAME)
    expected = condition_in_a_gust(heavier, reading.state)
    np.testing.assert_array_equal(belief.condition.air_data.alpha, reading.condition.air_data.alpha)
    np.testing.assert_allclose(belief.condition.wrench.force_b, expected.wrench.force_b, rtol=1e-12)
    np.testing.assert_allclose(belief.condition.wrench.moment_b, expected.wrench.moment_b, rtol=1e-12)


def test_measured_air_data_are_those_of_pitot_tube_and_vanes():
    reading = reading_in_a_gust()
    exact = air_data_of(reading)
    turned = 0.98 * exact.V * jax.jit(air_direction_b)(exact.alpha + 0.01, exact.beta)
    noisy = eqx.tree_at(lambda r: r.velocity_air_b, reading, turned, is_leaf=lambda leaf: leaf is None)
    measured = air_data_of(noisy)
    np.testing.assert_allclose(measured.alpha, exact.alpha + 0.01, rtol=1e-12)
    np.testing.assert_allclose(measured.qbar, 0.98**2 * exact.qbar, rtol=1e-12)


def test_without_known_aerodynamics_a_gust_belongs_to_the_measured_angle_of_attack():
    """With the lagging air data of the filter the lift of the gust would be missing at another angle of attack."""
    reading = reading_in_a_gust()
    blank = without_aerodynamics(AIRFRAME)
    slow = TrackingEstimator(air=AirFilter(jnp.asarray(20.0), jnp.asarray(10.0)), model=blank)
    estimator = adaptive_estimator(slow, blank, aerodynamics_known=False)
    belief, state = estimated(estimator, reading, AIRFRAME)
    measured, filtered = reading.condition.air_data, belief.condition.air_data
    assert abs(float(filtered.alpha - measured.alpha)) > 0.01
    moved = float(state.previous_regressors[0, 1] + state.reference[0, 1])
    np.testing.assert_allclose(moved, measured.alpha, rtol=1e-12)
    missing = reading.condition.aerodynamic.force_b[2] / (measured.qbar * AIRFRAME.wing_area)
    np.testing.assert_allclose(state.previous_missing[2], missing, rtol=1e-9)
