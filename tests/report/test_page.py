"""The page is whole, needs no network, and shows foreign names as text."""

import copy
import re

import numpy as np
import pytest
from plotly.offline import get_plotlyjs

from anser.report import write_report


@pytest.fixture(scope="module")
def page(flight, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(*flight, path)
    return path.read_text(encoding="utf-8")


def own(page):
    """The page without plotly's own script, which holds markup of all kinds, and without packed numbers."""
    assert page.count(get_plotlyjs()) == 1
    return re.sub(r'"bdata":"[^"]*"', "", page.replace(get_plotlyjs(), ""))


def test_the_page_is_self_contained(page):
    ours = own(page)
    assert not re.search(r"""(src|href)\s*=\s*["']?(https?:)?//""", ours)
    assert "@import" not in ours
    assert "cdn" not in ours.lower()


def test_every_figure_and_table_is_there(page):
    ours = own(page)
    for name in ("ground-tracks", "altitude", "range", "responses", "controls"):
        assert ours.count(f'id="{name}"') == 1
    assert "<title>Three &lt;aircraft&gt; · anser flight report</title>" in ours
    assert "3f9a1c0b7e42d6585a90" in ours
    for requirement in ("miss_max_m", "arrival_spread_max_s", "separation_min_m", "clearance_surface_min_m"):
        assert requirement in ours
    assert "All aircraft arrived, all requirements met" in ours
    assert ours.count("data-aircraft=") == 3


def test_labels_come_from_the_dataset_alone(flight, tmp_path):
    dataset, summary = flight
    renamed = dataset.copy()
    renamed["bank_deg"] = renamed["bank_deg"].assign_attrs(long_name="Schräglage")
    path = tmp_path / "report.html"
    write_report(renamed, summary, path)
    ours = own(path.read_text(encoding="utf-8"))
    # JSON writes what is not ASCII as an escape.
    assert "Schr\\u00e4glage" in ours
    assert "Bank angle about the velocity <i>" not in ours.replace("\\u003c", "<")


def test_names_are_text(flight, tmp_path):
    dataset, summary = flight
    evil = "</script><script>alert(1)</script>"
    summary = copy.deepcopy(summary)
    summary["aircraft"][0] |= {"name": evil, "goal": evil, "status": evil}
    summary["scenario"] = {"name": evil, "hash": evil}
    summary["requirements"][0]["name"] = evil
    names = [evil, *dataset["aircraft"].values[1:]]
    path = tmp_path / "report.html"
    write_report(dataset.assign_coords(aircraft=names), summary, path)
    ours = own(path.read_text(encoding="utf-8"))
    assert "<script>alert" not in ours
    assert "<b>cläre" not in ours
    assert "&lt;script&gt;alert(1)" in ours


def test_an_aircraft_that_failed_is_still_reported(flight, tmp_path):
    dataset, summary = flight
    broken = dataset.copy(deep=True)
    for name in broken.data_vars:
        if broken[name].dtype.kind == "f":
            broken[name].values[2000:, 1] = np.nan
    summary = copy.deepcopy(summary)
    summary["aircraft"][1] |= {"arrival_s": None, "miss_m": None, "status": "out of thrust"}
    summary["requirements"][0] |= {"value": None, "met": False}
    path = tmp_path / "report.html"
    write_report(broken, summary, path)
    ours = own(path.read_text(encoding="utf-8"))
    assert "Not arrived as planned: bert. Requirements not met: miss_max_m" in ours
    assert "out of thrust" in ours
    assert "<td>–</td>" in ours
    assert "NaN" not in ours


def test_a_page_is_replaced_only_on_request(flight, tmp_path):
    path = tmp_path / "report.html"
    path.write_text("mine")
    with pytest.raises(FileExistsError, match="not overwritten"):
        write_report(*flight, path)
    assert path.read_text() == "mine"
    write_report(*flight, path, overwrite=True)
    assert "</html>" in path.read_text(encoding="utf-8")


def test_dataset_and_summary_must_belong_together(flight, tmp_path):
    dataset, summary = flight
    with pytest.raises(ValueError, match="the summary"):
        write_report(dataset.isel(aircraft=slice(2)), summary, tmp_path / "report.html")
    with pytest.raises(ValueError, match="lacks throttle"):
        write_report(dataset.drop_vars("throttle"), summary, tmp_path / "report.html")
    assert list(tmp_path.iterdir()) == []
