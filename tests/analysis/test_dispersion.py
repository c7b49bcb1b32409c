"""What a robustness study disperses."""

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


def test_draws_fill_the_spread_evenly():
    """Uniform: of 4000 draws the mean is within 4 deviations, 4 * 0.2 / sqrt(3 * 4000), of the middle."""
    cases = dispersed_cases(4000, 0.2, 7)
    noise = 4 * 0.2 / np.sqrt(3 * 4000)
    both = np.delete(cases.changes, DELAY, axis=1)
    assert np.abs(both).max() <= 0.2
    assert np.abs(both).max(axis=0).min() > 0.199
    np.testing.assert_allclose(both.mean(axis=0), 0.0, atol=noise)
    delay = cases.changes[:, DELAY]
    assert delay.min() >= 0.0
    assert delay.mean() == pytest.approx(0.1, abs=noise)
    correlation = np.corrcoef(cases.changes.T) - np.eye(len(FACTORS))
    assert np.abs(correlation).max() < 5 / np.sqrt(4000)  # of 435 pairs of independent columns
    assert np.ptp(np.bincount(cases.condition)) == 0


def test_values_have_their_own_scales():
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


def test_the_seed_decides():
    first, again, other = (dispersed_cases(10, 0.2, seed).changes for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.any(first == other)


def test_a_sweep_scales_the_same_draws():
    cases = spread_cases(6, 3, spreads=(0.1, 0.3))
    np.testing.assert_allclose(cases.changes[6:], 3 * cases.changes[:6])
    np.testing.assert_array_equal(cases.spread, [0.1] * 6 + [0.3] * 6)
    assert not np.any(cases.changes[:6] == dispersed_cases(6, 0.1, 3).changes)


def test_alone_is_alone():
    cases = single_factor_cases()
    assert (np.count_nonzero(cases.changes, axis=1) == 1).all()
    rows = np.arange(len(cases.alone))
    np.testing.assert_array_equal(cases.changes[rows, cases.alone], cases.spread)
    assert set(cases.alone) == set(range(len(FACTORS)))
    assert set(cases.condition) == set(range(len(CONDITIONS)))
    # what is flown is physical: no factor of 0 or less, no delay beyond the memory of the sensors
    factors = [k for k, factor in enumerate(FACTORS) if factor.nominal == 1.0]
    assert cases.values[:, factors].min() > 0.05
    assert cases.values[:, DELAY].min() == 0.0
    assert cases.values[:, DELAY].max() == pytest.approx(DELAY_MAX_S)


def test_cases_add_up():
    both = dispersed_cases(4, 0.2, 0) + single_factor_cases(1, ("mass",))
    assert len(both.part) == len(both.values) == 4 + len(FACTORS[NAMES.index("mass")].alone)
    assert set(both.part) == {0, 2}
