"""Rates, intervals and first breaks against scipy and a study with results by hand."""

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
def test_intervals_equal_wilsons(reached, flown):
    low, high = wilson_interval(reached, flown)
    expected = binomtest(reached, flown).proportion_ci(0.95, method="wilson")
    assert low == pytest.approx(expected.low, abs=1e-12)
    assert high == pytest.approx(expected.high, abs=1e-12)
    assert 0.0 <= low <= reached / flown <= high <= 1.0


def test_a_rate_without_flights_is_undetermined():
    assert wilson_interval(0, 0) == (0.0, 1.0)
    rate = success(STUDY, "model", np.zeros(STUDY.sizes["flight"], dtype=bool))
    assert (rate.drawn, rate.flown, rate.low, rate.high) == (0, 0, 0.0, 1.0)
    assert np.isnan(rate.share)


def test_successes_are_counted_with_reasons():
    rate = success(STUDY, "model", DISPERSED)
    assert (rate.drawn, rate.no_steady_flight, rate.flown, rate.reached) == (10, 0, 10, 8)
    assert rate.share == pytest.approx(0.8)
    assert (rate.low, rate.high) == wilson_interval(8, 10)
    # a failure that no limit explains is named by the channel that was not reached
    assert rate.reasons == {"failed: surfaces": 1, "failed: error_left_in_path_angle": 1}
    assert success(STUDY, "incremental", DISPERSED).reasons == {}


def test_aircraft_without_steady_flight_are_counted_separately():
    rate = success(STUDY, "incremental", STUDY["part"].values == 2)
    assert (rate.drawn, rate.no_steady_flight, rate.flown, rate.reached) == (8, 1, 7, 7)
    assert rate.share == 1.0


def test_first_breaks_match_values_by_hand():
    breaks = {(b.inversion, b.sign): b for b in first_breaks(STUDY)}
    assert len(breaks) == 4
    assert {b.factor for b in breaks.values()} == {"CZ0"}
    up = breaks["model", 1]
    assert (up.change, up.value, up.survived) == (0.2, pytest.approx(1.2), 0.1)
    assert (up.reason, up.condition) == ("surfaces", "150 m/s, 1000 m")
    stands = breaks["incremental", 1]
    assert (stands.change, stands.survived, stands.reason, stands.condition) == (0.2, 0.2, None, None)
    for inversion in ("model", "incremental"):
        down = breaks[inversion, -1]
        assert (down.change, down.survived, down.reason) == (-0.2, -0.1, "no_steady_flight")
        assert down.condition == "200 m/s, 6000 m"


def test_correlations_equal_pearsons_strongest_first():
    """Repeated 20 times, so that the correlation with the artificial factor is significant, unlike that of the other."""
    study = xr.concat([STUDY.isel(flight=DISPERSED)] * 20, "flight", data_vars="minimal")
    study["factor_value"].values[:, 1] = np.cos(np.arange(200.0))
    selection = np.ones(200, dtype=bool)
    (correlation,) = failure_correlations(study, "model", selection)
    failed = study["outcome"].values[0] != REACHED
    values = study["factor_value"].values[:, 0]
    by_kind = {"value": pearsonr(values, failed), "amount": pearsonr(np.abs(values - 1.0), failed)}
    assert (correlation.factor, correlation.measure) == (
        "CZ0",
        max(by_kind, key=lambda kind: abs(by_kind[kind].statistic)),
    )
    assert correlation.correlation == pytest.approx(by_kind[correlation.measure].statistic, abs=1e-12)
    assert failure_correlations(study, "incremental", selection) == []
