"""Chart of the links in a fleet without a centre: a bar for each pair during contact."""

import json
import re

import numpy as np
import pytest
import xarray as xr

from anser.report.derived_variables import recorded_table
from anser.report.svg_charts import links_strip, pair_links

NAMES = ("anna", "b<e>rt", "cläre with a long name")


@pytest.fixture
def dataset():
    heard = np.zeros((101, 3), dtype=np.int32)
    heard[20:60, 0], heard[20:60, 1] = 0b010, 0b001
    series = {"time_s": [0.0, 1.0, 2.0], "quality_of_service": [0.0, 0.5, 1.0]}
    return xr.Dataset(
        {"heard_from": (("time", "aircraft"), heard)},
        coords={"time": np.linspace(0.0, 10.0, 101), "aircraft": list(NAMES)},
        attrs={"network": json.dumps({"series": series})},
    )


def test_pairs_have_the_records_of_their_links(dataset):
    pairs = pair_links(dataset)
    assert list(pairs) == [(NAMES[0], NAMES[1]), (NAMES[0], NAMES[2]), (NAMES[1], NAMES[2])]
    assert pairs[NAMES[0], NAMES[1]].sum() == 40
    assert not pairs[NAMES[1], NAMES[2]].any()


def test_the_strip_has_a_bar_for_each_link(dataset):
    svg = links_strip(dataset)
    assert "<e>" not in svg
    assert "b&lt;e&gt;rt" in svg
    bars = re.findall(r'd="(M[^"]*H[^"]*)"', svg)
    assert len(bars) == 1
    begin, end = (float(v) for v in re.match(r"M([\d.]+) [\d.]+H([\d.]+)", bars[0]).groups())
    # 2 s and 6 s of 10 s
    assert (end - begin) == pytest.approx(0.4 * 700, abs=0.2)
    assert "quality of service" in svg
    for invalid_number in re.findall(r"nan|inf", svg):
        pytest.fail(invalid_number)


def test_the_strip_of_a_large_fleet_says_that_pairs_are_left_out(dataset):
    assert "pairs" not in links_strip(dataset)
    names = [f"uav-{k}" for k in range(11)]
    time = np.linspace(0.0, 10.0, 3)
    large = xr.Dataset(
        {"heard_from": (("time", "aircraft"), np.zeros((3, 11), dtype=np.int32))},
        coords={"time": time, "aircraft": names},
    )
    assert "first 45 of 55 pairs" in links_strip(large)


def test_a_fleet_with_a_centre_has_no_strip(dataset):
    assert links_strip(dataset.drop_vars("heard_from")) == ""


@pytest.mark.parametrize("text", ["", "[]", "{", "3"])
def test_unreadable_network_data_are_ignored(dataset, text):
    dataset.attrs["network"] = text
    assert recorded_table(dataset, "network") == {}
    assert "quality of service<" not in links_strip(dataset)
