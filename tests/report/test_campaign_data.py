"""Data of a campaign's page, from made-up flights: every number is recomputed independently."""

import json

import numpy as np
import pytest
import xarray as xr

from anser.report import campaign_data
from anser.report.campaign_data import CampaignReport
from anser.report.campaign_data import campaign_data as collected
from anser.report.svg_charts import influence_strip
from anser.results.sampling_statistics import order_statistic_interval, quantile, wilson_interval

FLIGHTS = 300
ESTIMATES = {
    "confidence": 0.9,
    "quantiles": [
        {
            "name": name,
            "words": name,
            "unit": "m",
            "share": share,
            "upper": upper,
            "value": 1.0,
            "low": None,
            "high": 2.0,
        }
        for name, upper in (("miss_m", True), ("separation_min_m", False))
        for share in (0.5, 0.9)
    ],
}


def campaign_report(failed=()):
    rng = np.random.default_rng(1)
    miss = rng.exponential(1.0, (FLIGHTS, 2))
    miss[list(failed)] = np.nan
    succeeded = np.isfinite(miss[:, 0]) & (miss.max(axis=1) < 4.0)
    separation = np.where(np.isfinite(miss[:, 0]), 500.0 - miss[:, 0], np.nan)
    data = {
        "miss_m": (("flight", "aircraft"), miss),
        "separation_min_m": ("flight", separation),
        "met": ("flight", succeeded),
        "a": ("flight", rng.uniform(0.0, 9.0, FLIGHTS)),
        "b": ("flight", np.where(rng.uniform(size=FLIGHTS) < 0.5, "x", "y")),
    }
    data = xr.Dataset(data, coords={"flight": np.arange(FLIGHTS)}, attrs={"varied": json.dumps(["a", "b"])})
    independent = np.ones(FLIGHTS, dtype=bool)
    return CampaignReport(data, ESTIMATES, {}, {}, "out", independent, (), levels={"b": ["y", "x"]})


def test_page_data_match_the_flights():
    report = campaign_report(failed=(3, 4))
    page_data, data = collected(report), report.dataset
    succeeded = data["met"].values
    low, high = wilson_interval(int(succeeded.sum()), FLIGHTS, 0.9)
    last_values = [page_data["met"][key][-1] for key in ("n", "value", "low", "high")]
    assert last_values == pytest.approx([FLIGHTS, 100.0 * succeeded.mean(), 100.0 * low, 100.0 * high], rel=1e-5)
    miss, separation = page_data["quantities"]
    assert (miss["share"], separation["share"]) == (0.9, 0.9)
    worst = data["miss_m"].max("aircraft").fillna(np.inf).values
    low, high = order_statistic_interval(worst, 0.9, 0.9)
    last_values = [miss["converging"][key][-1] for key in ("n", "value", "low", "high")]
    assert last_values == pytest.approx([FLIGHTS, quantile(worst, 0.9), low, high], rel=1e-5)
    assert len(miss["kept"]) == FLIGHTS - 2
    assert miss["part"][-1] == pytest.approx(100.0 * (FLIGHTS - 2) / FLIGHTS, rel=1e-5)
    assert all(np.diff(miss["part"]) > 0.0)
    # what is the better the more: all keep the least, few the greatest
    assert all(np.diff(separation["kept"]) >= 0.0)
    assert separation["part"][0] == pytest.approx(100.0 * (FLIGHTS - 2) / FLIGHTS, rel=1e-5)
    assert separation["part"][-1] == pytest.approx(100.0 / FLIGHTS, rel=1e-5)
    assert page_data["outputs"]["miss_m"][3] is None
    assert page_data["inputs"][1]["values"] == [float(level == "x") for level in data["b"].values]
    assert page_data["drawn"] == [FLIGHTS, FLIGHTS]
    json.dumps(page_data, allow_nan=False)


def test_a_thinned_campaign_keeps_half_failed_flights(monkeypatch):
    monkeypatch.setattr(campaign_data, "_SCATTER_POINTS_MAX", 40)
    page_data = collected(campaign_report(failed=range(0, 200, 2)))
    assert page_data["drawn"] == [40, FLIGHTS]
    assert sum(page_data["failed"]) == 20
    assert page_data["numbers"] == sorted(set(page_data["numbers"]))


def test_an_influence_has_a_bar_and_an_interval_and_names_are_escaped():
    influences = [
        {"output": "met", "path": "<b>", "measure": measure, "value": value, "low": value - 0.1, "high": value + 0.1}
        for measure, value in (("first", 0.25), ("total", 0.5))
    ]
    svg = influence_strip(influences, "met")
    assert svg.count("<rect") == 2
    assert "&lt;b&gt;: first 0.250 (0.150 to 0.350); total 0.500 (0.400 to 0.600)" in svg
    assert "<b>" not in svg
    assert influence_strip(influences, "miss_m") == ""
