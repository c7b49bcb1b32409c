"""Intensities and scales of turbulence: every entry of the table, joints between the heights, what lies in between."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.environment.turbulence import ExceedanceTable, turbulence_levels
from anser.scenario.build_environment import exceedance_table

FOOT, KNOT = 0.3048, 1852.0 / 3600.0
PROBABILITIES = [2e-1, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6]
# MIL-F-8785C, figure 7: height in ft, sigma in ft/s for each probability; typed from the page, not read from the data
FIGURE_7 = np.array(
    [
        [500, 3.2, 4.2, 6.6, 8.6, 11.8, 15.6, 18.7],
        [1750, 2.2, 3.6, 6.9, 9.6, 13.0, 17.6, 21.5],
        [3750, 1.5, 3.3, 7.4, 10.6, 16.0, 23.0, 28.4],
        [7500, 0, 1.6, 6.7, 10.1, 15.1, 23.6, 30.2],
        [15000, 0, 0, 4.6, 8.0, 11.6, 22.1, 30.7],
        [25000, 0, 0, 2.7, 6.6, 9.7, 20.0, 31.0],
        [35000, 0, 0, 0.4, 5.0, 8.1, 16.0, 25.2],
        [45000, 0, 0, 0, 4.2, 8.2, 15.1, 23.1],
        [55000, 0, 0, 0, 2.7, 7.9, 12.1, 17.5],
        [65000, 0, 0, 0, 0, 4.9, 7.9, 10.7],
        [75000, 0, 0, 0, 0, 3.2, 6.2, 8.4],
        [80000, 0, 0, 0, 0, 2.1, 5.1, 7.2],
    ]
)

TABLE = exceedance_table()
_AT = jax.jit(lambda height, log_probability: TABLE.at(height, log_probability))
_LEVELS = {
    family: jax.jit(lambda h, wind, logp, family=family: turbulence_levels(h, wind, logp, TABLE, family))
    for family in ("dryden", "von-karman")
}


def test_table_entries_are_reproduced():
    heights, probabilities = np.meshgrid(FIGURE_7[:, 0] * FOOT, np.log10(PROBABILITIES), indexing="ij")
    entries = jax.vmap(jax.vmap(_AT))(jnp.asarray(heights), jnp.asarray(probabilities))
    np.testing.assert_allclose(entries, FIGURE_7[:, 1:] * FOOT, atol=1e-12)  # sums of weights of up to 10 m/s


@settings(deadline=None, max_examples=60)
@given(st.floats(-1e3, 3e4), st.floats(-8.0, 0.0))
def test_the_table_is_bilinear_and_held_at_its_ends(height, log_probability):
    """Against `numpy.interp`, first in height, then in the logarithm of the probability."""
    across = [np.interp(height / FOOT, FIGURE_7[:, 0], column) for column in FIGURE_7[:, 1:].T]
    expected = FOOT * np.interp(-log_probability, -np.log10(PROBABILITIES), across)
    np.testing.assert_allclose(_AT(height, log_probability), expected, atol=1e-12)


@pytest.mark.parametrize("height_ft", [2000.0, 3750.0, 30_000.0, 90_000.0])
def test_the_intensity_grows_with_decreasing_probability(height_ft):
    sigmas = jax.vmap(lambda p: _AT(height_ft * FOOT, p))(jnp.linspace(0.0, -7.0, 71))
    assert np.all(np.diff(np.asarray(sigmas)) >= -1e-12)


@pytest.mark.parametrize("family", ["dryden", "von-karman"])
@pytest.mark.parametrize("height_ft", [10.0, 1000.0, 2000.0])
def test_levels_are_continuous_between_altitude_ranges(family, height_ft):
    below, above = (_LEVELS[family]((height_ft + offset) * FOOT, 15.0, -3.0) for offset in (-1e-6, 1e-6))
    np.testing.assert_allclose(below.lengths, above.lengths, rtol=1e-6)
    np.testing.assert_allclose(below.sigmas, above.sigmas, rtol=1e-6)
    np.testing.assert_allclose(below.altitude_blend, above.altitude_blend, atol=1e-6)


@pytest.mark.parametrize("family", ["dryden", "von-karman"])
def test_the_low_altitude_law_at_a_thousand_feet_is_isotropic(family):
    """MIL-F-8785C: 0.177 + 0.823 is 1 at 1,000 ft, so that all scales are 1,000 ft and all intensities 0.1 W20."""
    levels = _LEVELS[family](1000.0 * FOOT, 30.0 * KNOT, -3.0)
    np.testing.assert_allclose(levels.lengths, 1000.0 * FOOT, rtol=1e-12)
    np.testing.assert_allclose(levels.sigmas, 3.0 * KNOT, rtol=1e-12)


@settings(deadline=None, max_examples=60)
@given(st.floats(-100.0, 25e3), st.floats(0.0, 40.0), st.floats(-7.0, 0.0), st.sampled_from(["dryden", "von-karman"]))
def test_levels_are_finite_and_at_low_altitude_proportional_to_the_wind(height, wind, log_probability, family):
    levels, levels_in_double_wind = (_LEVELS[family](height, k * wind, log_probability) for k in (1.0, 2.0))
    assert np.all(np.asarray(levels.lengths) >= 10.0 * FOOT * (1.0 - 1e-12))
    assert np.all(np.isfinite(levels.sigmas))
    assert np.all(np.asarray(levels.sigmas) >= -1e-12)
    assert 0.0 <= float(levels.altitude_blend) <= 1.0
    if height <= 1000.0 * FOOT:
        np.testing.assert_allclose(levels_in_double_wind.sigmas, 2.0 * np.asarray(levels.sigmas), rtol=1e-12)
    if height >= 2000.0 * FOOT:
        np.testing.assert_allclose(levels_in_double_wind.sigmas, levels.sigmas, rtol=1e-12, atol=1e-12)


def test_gradients_of_levels_are_the_slopes_of_the_table():
    """Between 7,500 and 15,000 ft at 1e-3: 8.0 - 10.1 ft/s over 7,500 ft."""
    height = 10_000.0 * FOOT
    slope = jax.jit(jax.grad(lambda h: turbulence_levels(h, 15.0, -3.0, TABLE, "dryden").sigmas[0]))(height)
    np.testing.assert_allclose(slope, (8.0 - 10.1) / 7500.0, rtol=1e-9)
    decade = jax.jit(jax.grad(lambda p: turbulence_levels(height, 15.0, p, TABLE, "dryden").sigmas[0]))(-3.5)
    at = [np.interp(10_000.0, FIGURE_7[:, 0], FIGURE_7[:, k]) * FOOT for k in (4, 5)]
    np.testing.assert_allclose(decade, at[0] - at[1], rtol=1e-9)
    heights = jnp.array([5.0, 500.0, 1500.0, 30_000.0]) * FOOT
    batch = jax.jit(jax.vmap(lambda h: turbulence_levels(h, 15.0, -3.0, TABLE, "von-karman")))(heights)
    for k, h in enumerate(heights):
        np.testing.assert_allclose(batch.sigmas[k], _LEVELS["von-karman"](h, 15.0, -3.0).sigmas, rtol=1e-12)


def test_a_user_defined_table_is_interpolated():
    table = ExceedanceTable(jnp.array([0.0, 1e4]), jnp.array([-1.0, -3.0]), jnp.array([[1.0, 5.0], [3.0, 7.0]]))
    np.testing.assert_allclose(table.at(5e3, -2.0), 4.0, rtol=1e-12)


def test_a_table_built_while_tracing_is_usable_afterwards():
    exceedance_table.cache_clear()
    jax.jit(lambda h: exceedance_table().at(h, -3.0))(1000.0)
    assert np.all(np.isfinite(exceedance_table().sigmas))
