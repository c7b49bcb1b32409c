"""Figure of a campaign, also with failed flights or without varied inputs."""

import json

import numpy as np
import pytest
import xarray as xr

from anser.report import draw_campaign


def made_up_campaign(flights, varied=("wind.speed_m_s",), failed=()):
    rng = np.random.default_rng(1)
    miss = rng.exponential(1.0, (flights, 2))
    miss[list(failed)] = np.nan
    data = {
        "miss_m": (("flight", "aircraft"), miss),
        "arrival_spread_s": ("flight", miss[:, 0] / 10.0),
        "met": ("flight", miss.max(axis=1) < 2.0),
        **{path: ("flight", rng.uniform(0.0, 9.0, flights)) for path in varied},
    }
    return xr.Dataset(data, attrs={"title": "test", "varied": json.dumps(list(varied)), "confidence": 0.95})


@pytest.mark.parametrize(
    ("flights", "varied", "failed"),
    [
        (2, (), ()),
        (300, ("a", "b", "c", "d"), (3, 5)),
        pytest.param(20, ("a",), range(20), marks=pytest.mark.long),
    ],
)
def test_a_campaign_figure_is_drawn_and_replaced(tmp_path, flights, varied, failed):
    paths = draw_campaign(made_up_campaign(flights, varied, failed), tmp_path)
    assert {path.name for path in paths} == {"campaign.svg", "campaign.png"}
    assert all(path.stat().st_size > 10_000 for path in paths)
    assert draw_campaign(made_up_campaign(flights, varied, failed), tmp_path) == paths


def test_a_single_flight_gets_no_figure(tmp_path):
    assert draw_campaign(made_up_campaign(1), tmp_path) == ()


def test_a_short_spread_is_in_milliseconds_and_an_open_interval_is_labelled(tmp_path):
    small_campaign = made_up_campaign(20)
    small_campaign["arrival_spread_s"] = small_campaign["arrival_spread_s"] * 1e-4
    svg = draw_campaign(small_campaign, tmp_path)[0].read_text()
    assert "arrival spread (ms)" in svg
    assert "too few flights met all for an upper end" in svg
    svg = draw_campaign(made_up_campaign(300), tmp_path)[0].read_text()
    assert "arrival spread (s)" in svg
    assert "interval of the 95 % point" in svg
