"""Rates, intervals and first breaks against scipy and a study whose answers are known by hand."""

import numpy as np
import pytest
import xarray as xr
from scipy.stats import binomtest, pearsonr

from anser.results.robustness_statistics import failure_correlations, first_breaks, success
from anser.results.sampling_statistics import wilson_interval
from support.robustness_cases import REACHED, made_up_study

STUDY = made_up_study()
DISPERSED = STUDY["part"].values == 0


@pytest.mark.parametrize(
    ("reached", "flown"), [(0, 1), (1, 1), (0, 200), (200, 200), (949, 1000), (17, 40), (999, 1000)]
)
def test_intervals_are_wilsons(reached, flown):
    low, high = wilson_interval(reached, flown)
    expected = binomtest(reached, flown).proportion_ci(0.95, method="wilson")
    assert low == pytest.approx(expected.low, abs=1e-12)
    assert high == pytest.approx(expected.high, abs=1e-12)
    assert 0.0 <= low <= reached / flown <= high <= 1.0


def test_of_no_flights_nothing_is_known():
    assert wilson_interval(0, 0) == (0.0, 1.0)
    found = success(STUDY, "model", np.zeros(STUDY.sizes["flight"], dtype=bool))
    assert (found.drawn, found.flown, found.low, found.high) == (0, 0, 0.0, 1.0)
    assert np.isnan(found.share)


def test_success_counts_and_names():
    found = success(STUDY, "model", DISPERSED)
    assert (found.drawn, found.no_steady_flight, found.flown, found.reached) == (10, 0, 10, 8)
    assert found.share == pytest.approx(0.8)
    assert (found.low, found.high) == wilson_interval(8, 10)
    # a failure that no limit explains is named by the channel that was not reached
    assert found.reasons == {"failed: surfaces": 1, "failed: error_left_in_path_angle": 1}
    assert success(STUDY, "incremental", DISPERSED).reasons == {}


def test_aircraft_without_steady_flight_are_counted_apart():
    found = success(STUDY, "incremental", STUDY["part"].values == 2)
    assert (found.drawn, found.no_steady_flight, found.flown, found.reached) == (8, 1, 7, 7)
    assert found.share == 1.0


def test_first_breaks():
    found = {(b.inversion, b.sign): b for b in first_breaks(STUDY)}
    assert len(found) == 4
    assert {b.factor for b in found.values()} == {"CZ0"}
    up = found["model", 1]
    assert (up.change, up.value, up.survived) == (0.2, pytest.approx(1.2), 0.1)
    assert (up.reason, up.condition) == ("surfaces", "150 m/s, 1000 m")
    stands = found["incremental", 1]
    assert (stands.change, stands.survived, stands.reason, stands.condition) == (0.2, 0.2, None, None)
    for inversion in ("model", "incremental"):
        down = found[inversion, -1]
        assert (down.change, down.survived, down.reason) == (-0.2, -0.1, "no_steady_flight")
        assert down.condition == "200 m/s, 6000 m"


def test_correlations_are_pearsons_strongest_first():
    """Repeated 20 times, so that the made-up factor stands out of chance; the cosines of the other do not."""
    study = xr.concat([STUDY.isel(flight=DISPERSED)] * 20, "flight", data_vars="minimal")
    study["factor_value"].values[:, 1] = np.cos(np.arange(200.0))
    every = np.ones(200, dtype=bool)
    (found,) = failure_correlations(study, "model", every)
    failed = study["outcome"].values[0] != REACHED
    values = study["factor_value"].values[:, 0]
    by_kind = {"value": pearsonr(values, failed), "amount": pearsonr(np.abs(values - 1.0), failed)}
    assert (found.factor, found.measure) == ("CZ0", max(by_kind, key=lambda kind: abs(by_kind[kind].statistic)))
    assert found.correlation == pytest.approx(by_kind[found.measure].statistic, abs=1e-12)
    assert failure_correlations(study, "incremental", every) == []
