"""Worst value of a fleet: a missing arrival makes a flight infinitely bad, unless the flight meets its requirements."""

import numpy as np
import pytest

from anser.results.flight_rows import worst_of_fleet
from anser.results.sampling_statistics import order_statistic_interval, quantile

NONE = np.nan
FLIGHTS = {
    "miss_m": np.array([[1.0, 3.0], [2.0, NONE], [2.0, NONE]]),
    "clearance_min_m": np.array([[150.0, 160.0], [170.0, 180.0], [190.0, 2400.0]]),
    "separation_min_m": np.array([500.0, 600.0, 700.0]),
    "arrival_spread_s": np.array([0.1, NONE, NONE]),
    "met": np.array([True, True, False]),
}


def test_a_departed_aircraft_of_a_good_flight_does_not_count():
    np.testing.assert_array_equal(worst_of_fleet(FLIGHTS, "miss_m"), [3.0, 2.0, np.inf])
    np.testing.assert_array_equal(worst_of_fleet(FLIGHTS, "miss_m", upper=False), [1.0, 2.0, -np.inf])
    np.testing.assert_array_equal(worst_of_fleet(FLIGHTS, "arrival_spread_s"), [0.1, -np.inf, np.inf])


@pytest.mark.parametrize(
    ("name", "expected"), [("clearance_min_m", [150.0, 170.0]), ("separation_min_m", [500.0, 600.0])]
)
def test_a_flight_with_a_crash_does_not_improve_a_least_distance(name, expected):
    np.testing.assert_array_equal(worst_of_fleet(FLIGHTS, name, upper=False), [*expected, -np.inf])


def test_an_output_without_a_value_is_infinitely_bad_in_a_good_flight_too():
    flights = FLIGHTS | {"depth": np.array([2.0, NONE, 3.0])}
    np.testing.assert_array_equal(worst_of_fleet(flights, "depth"), [2.0, np.inf, np.inf])
    np.testing.assert_array_equal(worst_of_fleet(flights, "depth", upper=False), [2.0, -np.inf, -np.inf])


@pytest.mark.parametrize("share", [0.01, 0.5, 0.95, 1.0])
@pytest.mark.parametrize("failed", [0, 1, 5, 10])
def test_quantiles_of_flights_without_arrival_are_infinite(share, failed):
    misses = np.arange(1.0, 11.0)[:, None]
    misses[10 - failed :] = NONE
    worst = worst_of_fleet({"miss_m": misses, "met": np.isfinite(misses[:, 0])}, "miss_m")
    value, bounds = quantile(worst, share), order_statistic_interval(worst, share)
    assert value == (max(np.ceil(10 * share), 1.0) if max(np.ceil(10 * share), 1.0) <= 10 - failed else np.inf)
    assert not np.isnan(bounds).any()
