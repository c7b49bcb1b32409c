"""Dispersions of a robustness study."""

import numpy as np
import pytest

from anser.aircraft.f16 import F16_COEFFICIENTS
from anser.analysis.robustness import (
    CONDITIONS,
    DELAY_MAX_S,
    FACTORS,
    dispersed_cases,
    dispersion_of,
    single_factor_cases,
    spread_cases,
)

NAMES = [factor.name for factor in FACTORS]
DELAY, SHIFT = NAMES.index("sensor_delay"), NAMES.index("cg_shift")


def test_samples_fill_the_spread_evenly():
    """Uniform: the mean of 4000 samples is within 4 deviations, 4 * 0.2 / sqrt(3 * 4000), of the middle."""
    cases = dispersed_cases(4000, 0.2, 7)
    noise = 4 * 0.2 / np.sqrt(3 * 4000)
    two_way_changes = np.delete(cases.changes, DELAY, axis=1)
    assert np.abs(two_way_changes).max() <= 0.2
    assert np.abs(two_way_changes).max(axis=0).min() > 0.199
    np.testing.assert_allclose(two_way_changes.mean(axis=0), 0.0, atol=noise)
    delay = cases.changes[:, DELAY]
    assert delay.min() >= 0.0
    assert delay.mean() == pytest.approx(0.1, abs=noise)
    correlation = np.corrcoef(cases.changes.T) - np.eye(len(FACTORS))
    assert np.abs(correlation).max() < 5 / np.sqrt(4000)  # of 435 pairs of independent columns
    assert np.ptp(np.bincount(cases.condition)) == 0


def test_values_have_the_scale_of_the_factor():
    cases = dispersed_cases(100, 0.2, 0)
    values = cases.values
    np.testing.assert_allclose(values[:, 0], 1 + cases.changes[:, 0])
    assert 0.0 <= values[:, DELAY].min() < values[:, DELAY].max() <= 0.02
    assert np.abs(values[:, SHIFT]).max() <= 0.04
    dispersion, delay = dispersion_of(values)
    np.testing.assert_array_equal(dispersion.coefficients, values[:, : len(F16_COEFFICIENTS)])
    np.testing.assert_array_equal(dispersion.second_moments[:, 1], values[:, NAMES.index("second_moment_y")])
    np.testing.assert_array_equal(dispersion.cg_shift, values[:, SHIFT])
    np.testing.assert_array_equal(delay, values[:, DELAY])


def test_the_seed_determines_the_samples():
    sample, same_seed, other_seed = (dispersed_cases(10, 0.2, seed).changes for seed in (1, 1, 2))
    np.testing.assert_array_equal(sample, same_seed)
    assert not np.any(sample == other_seed)


def test_a_sweep_scales_the_same_samples():
    cases = spread_cases(6, 3, spreads=(0.1, 0.3))
    np.testing.assert_allclose(cases.changes[6:], 3 * cases.changes[:6])
    np.testing.assert_array_equal(cases.spread, [0.1] * 6 + [0.3] * 6)
    assert not np.any(cases.changes[:6] == dispersed_cases(6, 0.1, 3).changes)


def test_a_single_factor_case_changes_one_factor():
    cases = single_factor_cases()
    assert (np.count_nonzero(cases.changes, axis=1) == 1).all()
    flights = np.arange(len(cases.alone))
    np.testing.assert_array_equal(cases.changes[flights, cases.alone], cases.spread)
    assert set(cases.alone) == set(range(len(FACTORS)))
    assert set(cases.condition) == set(range(len(CONDITIONS)))
    # flown values are physical: factors above 0, delays within the sensors' buffer
    factors = [k for k, factor in enumerate(FACTORS) if factor.nominal == 1.0]
    assert cases.values[:, factors].min() > 0.05
    assert cases.values[:, DELAY].min() == 0.0
    assert cases.values[:, DELAY].max() == pytest.approx(DELAY_MAX_S)


def test_cases_can_be_added():
    cases = dispersed_cases(4, 0.2, 0) + single_factor_cases(1, ("mass",))
    assert len(cases.part) == len(cases.values) == 4 + len(FACTORS[NAMES.index("mass")].alone)
    assert set(cases.part) == {0, 2}
