"""The earliest feasible time, found in few attempts."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from anser.planning.certified.arrival_times import RESOLUTION, earlier_times, first_index

ADMISSIBLE = np.arange(40.0, 1200.0, 0.25)


def search_time(admissible, known_time, is_feasible):
    """The time found, and the attempts."""
    times, tried, answer = earlier_times(admissible, known_time), [], None
    while True:
        try:
            tried.append(times.send(answer))
        except StopIteration as ended:
            return ended.value, tried
        answer = is_feasible(tried[-1])


@example(first_feasible=50.375, known_ratio=1.05078125, closed=0.0)
@given(first_feasible=st.floats(41.0, 900.0), known_ratio=st.floats(1.0, 1.3), closed=st.floats(0.0, 0.2))
def test_the_earliest_time_is_found_within_the_resolution(first_feasible, known_ratio, closed):
    # Some of the times before it are ruled out.
    admissible = ADMISSIBLE[((0.9 - closed) * first_feasible > ADMISSIBLE) | (0.9 * first_feasible < ADMISSIBLE)]
    earliest, tried = search_time(admissible, first_feasible * known_ratio, lambda t: t >= first_feasible)
    # Between two times in that ratio there may be none of the grid, a quarter of a second apart.
    assert (
        first_feasible <= earliest <= RESOLUTION * first_feasible + 0.26
        or earliest == first_feasible * known_ratio <= RESOLUTION * first_feasible + 1.0
    )
    assert set(tried) <= set(admissible)
    assert len(set(tried)) == len(tried) < 45


@pytest.mark.parametrize("known_time", [608.0, 450.0])
def test_an_island_before_a_gap_is_found(known_time):
    earliest, tried = search_time(ADMISSIBLE, known_time, lambda t: 120.0 <= t <= 150.0 or t >= 400.0)
    assert 120.0 <= earliest <= 120.0 * RESOLUTION
    assert len(tried) < 20


def test_the_known_time_is_returned_without_an_earlier_one():
    earliest, tried = search_time(ADMISSIBLE, 77.0, lambda t: False)
    assert earliest == 77.0
    assert tried == sorted(tried)
    assert max(tried) < 77.0


@pytest.mark.parametrize("admissible", [np.zeros(0), np.array([90.0]), np.array([77.0])])
def test_no_time_is_tried_without_an_earlier_admissible_one(admissible):
    assert search_time(admissible, 77.0, lambda t: True) == (77.0, [])


def search_index(count, one_by_one, is_feasible):
    """The index found, and the attempts."""
    indices, tried, answer = first_index(count, one_by_one), [], None
    while True:
        try:
            tried.append(indices.send(answer))
        except StopIteration as ended:
            return ended.value, tried
        answer = is_feasible(tried[-1])


@given(first_feasible=st.integers(0, 150), count=st.integers(0, 150), one_by_one=st.integers(1, 150))
def test_the_first_feasible_index_is_found(first_feasible, count, one_by_one):
    found_index, tried = search_index(count, one_by_one, lambda index: index >= first_feasible)
    assert found_index == (first_feasible if first_feasible < count else None)
    assert len(set(tried)) == len(tried)
    assert len(tried) <= min(first_feasible, one_by_one) + 18


def test_a_step_by_step_search_finds_the_smallest_island():
    assert search_index(60, 40, lambda index: index == 23 or index > 50)[0] == 23
    assert search_index(60, 1, lambda index: index == 2 or index > 50)[0] == 51
