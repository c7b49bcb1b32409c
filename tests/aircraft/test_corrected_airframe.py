"""Airframe with linear increments of its coefficients."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft.air_data import Wrench, air_data
from anser.aircraft.corrected_airframe import (
    corrected_airframe,
    reference_lengths,
    reference_regressors,
    regressors,
    without_aerodynamics,
)
from anser.aircraft_files.library import load_airframe
from anser.environment.environment import standard_environment

aerodynamics = eqx.filter_jit(lambda airframe, condition: airframe.aerodynamics(condition, RATES_B, SURFACES))


@pytest.fixture(scope="module")
def condition():
    V, alpha, beta = 160.0, 0.08, -0.03
    velocity_b = V * np.array([np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)])
    return jax.jit(lambda v: air_data(v, 1500.0, standard_environment().atmosphere.at(1500.0)))(velocity_b)


RATES_B, SURFACES = jnp.array([0.2, -0.1, 0.05]), jnp.array([-0.05, 0.03, 0.02])


def test_coefficients_are_the_inverse_of_the_wrench(condition):
    lengths = reference_lengths(load_airframe("f16"))
    wrench = aerodynamics(load_airframe("f16"), condition)
    again = lengths.wrench(condition.qbar, lengths.coefficients(condition.qbar, wrench))
    np.testing.assert_allclose(again.force_b, wrench.force_b, rtol=1e-12)
    np.testing.assert_allclose(again.moment_b, wrench.moment_b, rtol=1e-12)


def test_increments_are_linear_in_the_deviations_from_the_reference(condition):
    airframe = load_airframe("f16")
    lengths = reference_lengths(airframe)
    reference = reference_regressors(jnp.asarray(0.05), jnp.array([-0.04, 0.0, 0.0]))
    increments = jnp.zeros((6, 7)).at[4, 4].set(-0.1).at[4, 1].set(0.3).at[3, 3].set(0.2).at[0, 0].set(-0.01)
    corrected = corrected_airframe(airframe, lengths, reference, increments)
    change = aerodynamics(corrected, condition), aerodynamics(airframe, condition)
    dC = lengths.coefficients(
        condition.qbar, Wrench(change[0].force_b - change[1].force_b, change[0].moment_b - change[1].moment_b)
    )
    alpha, double_V = float(condition.alpha), 2.0 * float(condition.V)
    Cm = -0.1 * (-0.05 + 0.04) + 0.3 * (alpha - 0.05)
    Cl = 0.2 * 0.05 * float(lengths.span) / double_V
    np.testing.assert_allclose(dC, [-0.01, 0.0, 0.0, Cl, Cm, 0.0], atol=1e-12)


def test_an_airframe_without_aerodynamics_has_none(condition):
    blank = without_aerodynamics(load_airframe("f16"))
    wrench = blank.aerodynamics(condition, RATES_B, SURFACES)
    assert not np.any(wrench.force_b)
    assert not np.any(wrench.moment_b)
    assert blank.mass_properties is blank.base.mass_properties


def test_regressors_are_dimensionless(condition):
    lengths = reference_lengths(load_airframe("f16"))
    rows = regressors(lengths, condition, RATES_B, SURFACES)
    double_V = 2.0 * float(condition.V)
    expected = [1.0, float(condition.alpha), -0.1 * float(lengths.mean_chord) / double_V, 0.0, *SURFACES]
    np.testing.assert_allclose(rows[0], expected, rtol=1e-12)


class Bare:
    """An airframe without reference lengths."""


def test_an_airframe_without_reference_lengths_is_refused():
    with pytest.raises(ValueError, match="Bare has no span, mean_chord, wing_area; expected span, mean_chord"):
        reference_lengths(Bare())
