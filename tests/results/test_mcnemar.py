"""McNemar's exact test: against values by hand, and without discordant pairs."""

import pytest

from anser.results.sampling_statistics import mcnemar_exact


@pytest.mark.parametrize(
    ("first_only", "second_only", "expected"),
    [(0, 0, 1.0), (3, 3, 1.0), (0, 5, 2.0 / 32.0), (5, 0, 2.0 / 32.0), (1, 9, 2.0 * 11.0 / 1024.0)],
)
def test_the_p_value_is_that_of_a_coin_toss_per_discordant_pair(first_only, second_only, expected):
    assert mcnemar_exact(first_only, second_only) == pytest.approx(expected, rel=1e-12)
