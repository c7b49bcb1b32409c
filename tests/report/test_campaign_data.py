"""What the page of a campaign draws, from made-up flights: every number again by hand."""

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
ANSWERS = {
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


def shown(failed=()):
    rng = np.random.default_rng(1)
    miss = rng.exponential(1.0, (FLIGHTS, 2))
    miss[list(failed)] = np.nan
    met = np.isfinite(miss[:, 0]) & (miss.max(axis=1) < 4.0)
    separation = np.where(np.isfinite(miss[:, 0]), 500.0 - miss[:, 0], np.nan)
    data = {
        "miss_m": (("flight", "aircraft"), miss),
        "separation_min_m": ("flight", separation),
        "met": ("flight", met),
        "a": ("flight", rng.uniform(0.0, 9.0, FLIGHTS)),
        "b": ("flight", np.where(rng.uniform(size=FLIGHTS) < 0.5, "x", "y")),
    }
    data = xr.Dataset(data, coords={"flight": np.arange(FLIGHTS)}, attrs={"varied": json.dumps(["a", "b"])})
    everyone = np.ones(FLIGHTS, dtype=bool)
    return CampaignReport(data, ANSWERS, {}, {}, "out", everyone, (), levels={"b": ["y", "x"]})


def test_what_is_drawn_is_what_was_flown():
    of = shown(failed=(3, 4))
    found, data = collected(of), of.dataset
    met = data["met"].values
    low, high = wilson_interval(int(met.sum()), FLIGHTS, 0.9)
    ends = [found["met"][key][-1] for key in ("n", "value", "low", "high")]
    assert ends == pytest.approx([FLIGHTS, 100.0 * met.mean(), 100.0 * low, 100.0 * high], rel=1e-5)
    miss, separation = found["quantities"]
    assert (miss["share"], separation["share"]) == (0.9, 0.9)
    worst = data["miss_m"].max("aircraft").fillna(np.inf).values
    low, high = order_statistic_interval(worst, 0.9, 0.9)
    ends = [miss["converging"][key][-1] for key in ("n", "value", "low", "high")]
    assert ends == pytest.approx([FLIGHTS, quantile(worst, 0.9), low, high], rel=1e-5)
    assert len(miss["kept"]) == FLIGHTS - 2
    assert miss["part"][-1] == pytest.approx(100.0 * (FLIGHTS - 2) / FLIGHTS, rel=1e-5)
    assert all(np.diff(miss["part"]) > 0.0)
    # what is the better the more: all keep the least, few the greatest
    assert all(np.diff(separation["kept"]) >= 0.0)
    assert separation["part"][0] == pytest.approx(100.0 * (FLIGHTS - 2) / FLIGHTS, rel=1e-5)
    assert separation["part"][-1] == pytest.approx(100.0 / FLIGHTS, rel=1e-5)
    assert found["outputs"]["miss_m"][3] is None
    assert found["inputs"][1]["values"] == [float(one == "x") for one in data["b"].values]
    assert found["drawn"] == [FLIGHTS, FLIGHTS]
    json.dumps(found, allow_nan=False)


def test_of_many_flights_half_of_those_drawn_failed(monkeypatch):
    monkeypatch.setattr(campaign_data, "_SCATTER_POINTS_MAX", 40)
    found = collected(shown(failed=range(0, 200, 2)))
    assert found["drawn"] == [40, FLIGHTS]
    assert sum(found["failed"]) == 20
    assert found["numbers"] == sorted(set(found["numbers"]))


def test_an_influence_has_a_bar_and_an_interval_and_foreign_names_are_text():
    made = [
        {"output": "met", "path": "<b>", "measure": measure, "value": value, "low": value - 0.1, "high": value + 0.1}
        for measure, value in (("first", 0.25), ("total", 0.5))
    ]
    drawn = influence_strip(made, "met")
    assert drawn.count("<rect") == 2
    assert "&lt;b&gt;: first 0.250 (0.150 to 0.350); total 0.500 (0.400 to 0.600)" in drawn
    assert "<b>" not in drawn
    assert influence_strip(made, "miss_m") == ""
