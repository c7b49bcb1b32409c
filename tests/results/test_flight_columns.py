"""The worst of a fleet: who has none makes a flight infinitely bad, unless the flight is good without it."""

import numpy as np

from anser.results.flight_columns import worst_of_fleet

NONE = np.nan
VALUES = np.array([[1.0, 3.0], [2.0, NONE], [2.0, NONE]])
MET = np.array([True, True, False])


def test_who_has_left_a_flight_that_is_good_does_not_count():
    np.testing.assert_array_equal(worst_of_fleet(VALUES, MET), [3.0, 2.0, np.inf])
    np.testing.assert_array_equal(worst_of_fleet(VALUES, MET, upper=False), [1.0, 2.0, -np.inf])


def test_of_a_fleet_there_is_one_value():
    np.testing.assert_array_equal(worst_of_fleet(np.array([1.0, 2.0, NONE]), MET), [1.0, 2.0, np.inf])
