"""The earliest time that works, found with few tries."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from anser.planning.certified.arrival_times import RESOLUTION, earlier_times, first_index

ADMISSIBLE = np.arange(40.0, 1200.0, 0.25)


def looked(admissible, known, works):
    """The time found, and those tried."""
    times, tried, answer = earlier_times(admissible, known), [], None
    while True:
        try:
            tried.append(times.send(answer))
        except StopIteration as ended:
            return ended.value, tried
        answer = works(tried[-1])


@example(first=50.375, known=1.05078125, closed=0.0)
@given(first=st.floats(41.0, 900.0), known=st.floats(1.0, 1.3), closed=st.floats(0.0, 0.2))
def test_it_is_found_to_a_fiftieth_where_all_later_ones_work(first, known, closed):
    # Some of the times before it are ruled out.
    admissible = ADMISSIBLE[((0.9 - closed) * first > ADMISSIBLE) | (0.9 * first < ADMISSIBLE)]
    found, tried = looked(admissible, first * known, lambda t: t >= first)
    # Between two times in that ratio there may be none of the grid, a quarter of a second apart.
    assert first <= found <= RESOLUTION * first + 0.26 or found == first * known <= RESOLUTION * first + 1.0
    assert set(tried) <= set(admissible)
    assert len(set(tried)) == len(tried) < 45


@pytest.mark.parametrize("known", [608.0, 450.0])
def test_an_island_before_a_gap_is_found(known):
    found, tried = looked(ADMISSIBLE, known, lambda t: 120.0 <= t <= 150.0 or t >= 400.0)
    assert 120.0 <= found <= 120.0 * RESOLUTION
    assert len(tried) < 20


def test_where_nothing_earlier_works_the_known_time_stands():
    found, tried = looked(ADMISSIBLE, 77.0, lambda t: False)
    assert found == 77.0
    assert tried == sorted(tried)
    assert max(tried) < 77.0


@pytest.mark.parametrize("admissible", [np.zeros(0), np.array([90.0]), np.array([77.0])])
def test_no_time_is_tried_where_none_is_before(admissible):
    assert looked(admissible, 77.0, lambda t: True) == (77.0, [])


def first_open(count, one_by_one, works):
    """The index found, and those tried."""
    indices, tried, answer = first_index(count, one_by_one), [], None
    while True:
        try:
            tried.append(indices.send(answer))
        except StopIteration as ended:
            return ended.value, tried
        answer = works(tried[-1])


@given(first=st.integers(0, 150), count=st.integers(0, 150), one_by_one=st.integers(1, 150))
def test_the_first_index_is_found_where_all_later_ones_work(first, count, one_by_one):
    found, tried = first_open(count, one_by_one, lambda index: index >= first)
    assert found == (first if first < count else None)
    assert len(set(tried)) == len(tried)
    assert len(tried) <= min(first, one_by_one) + 18


def test_one_by_one_even_the_smallest_island_is_found():
    assert first_open(60, 40, lambda index: index == 23 or index > 50)[0] == 23
    assert first_open(60, 1, lambda index: index == 2 or index > 50)[0] == 51
