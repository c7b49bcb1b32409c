"""McNemar's exact test: by hand where that is short, and no verdict without pairs that fall apart."""

import pytest

from anser.results.sampling_statistics import mcnemar_exact


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [(0, 0, 1.0), (3, 3, 1.0), (0, 5, 2.0 / 32.0), (5, 0, 2.0 / 32.0), (1, 9, 2.0 * 11.0 / 1024.0)],
)
def test_it_is_a_coins_toss_for_each_pair_that_falls_apart(first, second, expected):
    assert mcnemar_exact(first, second) == pytest.approx(expected, rel=1e-12)
