"""Closest approach against lines with a closed-form nearest point."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.results.arrival import closest_approach, least_distance

TIME = np.arange(0.0, 60.25, 0.5)


def line(at, miss, along, closing_m_s):
    """Offset of a straight pass: nearest at time `at`, by the vector `miss`, normal to the unit vector `along`."""
    return miss + np.multiply.outer((TIME - at) * closing_m_s, along)


@settings(deadline=None, max_examples=30)
@given(
    at=st.floats(0.1, 59.9),
    speed=st.floats(20.0, 400.0),
    miss=st.floats(0.5, 500.0),
    heading=st.floats(-3.1, 3.1),
    climb=st.floats(-1.2, 1.2),
)
def test_a_straight_pass_is_located_between_samples(at, speed, miss, heading, climb):
    along = np.array([np.cos(climb) * np.cos(heading), np.cos(climb) * np.sin(heading), np.sin(climb)])
    across = np.array([-np.sin(heading), np.cos(heading), 0.0])
    pass_time, distance = closest_approach(TIME, line(at, miss * across, along, speed), None)
    # Linear interpolation of a line is the line. Offsets reach 24 km, whose last digit is 4e-12 m; the step of time is
    # a ratio of squares of 200 m at most, which leaves some 1e-10 s.
    assert pass_time == pytest.approx(at, abs=1e-8)
    assert distance == pytest.approx(miss, abs=1e-8)


def test_the_first_pass_counts():
    along, across = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    first_pass, second_pass = line(20.2, 8.0 * across, along, 150.0), line(45.0, 1.0 * across, along, 150.0)
    offset = np.where(TIME[:, None] < 32.0, first_pass, second_pass)
    assert closest_approach(TIME, offset, 20.0) == pytest.approx((20.2, 8.0))
    assert closest_approach(TIME, offset, None) == pytest.approx((45.0, 1.0))
    # A wider window lets the second pass in.
    assert closest_approach(TIME, offset, 20.0, margin_s=30.0) == pytest.approx((45.0, 1.0))


def test_the_window_ends_between_samples():
    # Still closing at the end of the window, 10.3 s, which lies inside a step: there the offset is 9.7 s of flight.
    offset = line(20.0, np.zeros(3), np.array([0.6, 0.8, 0.0]), 100.0)
    assert closest_approach(TIME, offset, 0.3) == pytest.approx((10.3, 970.0))


def test_a_constant_offset_gives_the_first_sample():
    assert closest_approach(TIME, np.full((TIME.size, 3), 2.0), None) == pytest.approx((0.0, np.sqrt(12.0)))


def test_non_finite_samples_are_ignored():
    offset = line(30.0, np.array([0.0, 0.0, 4.0]), np.array([1.0, 0.0, 0.0]), 100.0)
    offset[TIME > 20.0] = np.nan
    offset[0] = np.inf
    assert closest_approach(TIME, offset, None) == pytest.approx((20.0, np.hypot(1000.0, 4.0)))
    assert np.all(np.isnan(closest_approach(TIME, np.full((TIME.size, 3), np.nan), None)))


def test_a_window_before_the_record_gives_nan():
    assert np.all(np.isnan(closest_approach(TIME + 100.0, np.ones((TIME.size, 3)), 50.0)))


def test_shapes_are_checked():
    with pytest.raises(ValueError, match="offset"):
        closest_approach(TIME, np.ones((3, TIME.size)), None)


def test_the_least_distance_of_pairs_is_exact():
    pairs = np.stack(
        [line(20.1, np.array([0.0, 0.0, 4.0]), np.array([0.6, 0.8, 0.0]), 300.0), np.full((TIME.size, 3), np.nan)],
        axis=1,
    )
    distances = least_distance(pairs)
    assert distances[0] == pytest.approx(4.0)
    assert np.isnan(distances[1])
