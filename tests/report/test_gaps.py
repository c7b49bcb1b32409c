"""Gaps of lines at wrapped angles."""

import numpy as np

from anser.report.flight_histories import insert_gaps


def test_a_wrapped_angle_leaves_a_gap_and_all_samples():
    x, y = insert_gaps(np.arange(5.0), np.array([170.0, 179.0, -178.0, np.nan, -170.0]), 180.0)
    np.testing.assert_array_equal(x, [0.0, 1.0, 2.0, 2.0, 3.0, 4.0])
    np.testing.assert_array_equal(y, [170.0, 179.0, np.nan, -178.0, np.nan, -170.0])
