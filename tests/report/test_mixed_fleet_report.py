"""Aircraft with different control surfaces in one flight: record, dataset, report and exports."""

import io
import json
from datetime import UTC, datetime

import numpy as np
import pytest

from anser.report import write_report
from anser.report.exports.tables import FORMATS, has_parquet
from anser.results import read_netcdf, write_netcdf
from anser.results.dataset import surface_names
from anser.variables import OPTIONAL_KEYS, STANDARD_SURFACES, recorded_keys
from support.chromium import NAMES, Chromium, find_chromium
from support.mixed_flight import fly_mixed
from support.other_surfaces import ELEVONS

pytestmark = pytest.mark.long

LIGHT, FIGHTER = 0, 1
SURFACES = (*ELEVONS, *STANDARD_SURFACES)
LIGHT_KEYS = [f"{name}{suffix}" for name in ELEVONS for suffix in ("", "_command")]
FIGHTER_KEYS = [f"{name}{suffix}" for name in STANDARD_SURFACES for suffix in ("", "_command")]


@pytest.fixture(scope="module")
def mixed():
    return fly_mixed()


def test_aircraft_groups_have_individual_surfaces(mixed):
    flight, *_ = mixed
    assert flight.surfaces == (ELEVONS, STANDARD_SURFACES)


def test_the_record_has_the_surfaces_of_both_groups_and_is_finite_elsewhere(mixed):
    *_, history, _, _ = mixed
    assert set(history) == set(recorded_keys(SURFACES))
    assert not set(history) & OPTIONAL_KEYS
    for keys, owner, other_group in ((LIGHT_KEYS, LIGHT, FIGHTER), (FIGHTER_KEYS, FIGHTER, LIGHT)):
        for key in keys:
            assert np.all(np.isfinite(history[key][:, owner])), key
            assert np.all(np.isnan(history[key][:, other_group])), key
            assert history[key].dtype == np.float64
    never = {"lateral_bend", "planned_length"}  # of straight lines
    for key in set(history) - set(LIGHT_KEYS) - set(FIGHTER_KEYS) - never:
        assert np.all(np.isfinite(history[key])), key


def test_the_elevons_move_with_the_aircraft(mixed):
    """Symmetric motion as an elevator for the pull, antisymmetric motion as ailerons for the turn to the goal."""
    *_, history, _, _ = mixed
    left_elevon, right_elevon = (history[name][:, LIGHT] for name in ELEVONS)
    assert np.ptp(left_elevon + right_elevon) > 1e-3
    assert np.ptp(left_elevon - right_elevon) > 1e-3
    np.testing.assert_array_equal(history["status"], 0)


def test_the_dataset_labels_surfaces_and_comments_on_missing_ones(mixed, tmp_path):
    *_, history, dataset, _ = mixed
    write_netcdf(dataset, tmp_path / "flight.nc")
    read = read_netcdf(tmp_path / "flight.nc")
    assert surface_names(read) == SURFACES
    labels = read["left_elevon_command_deg"].attrs
    assert (labels["long_name"], labels["units"]) == ("Left elevon command", "degree")
    assert all("without this surface" in read[f"{name}_deg"].attrs["comment"] for name in SURFACES)
    assert "comment" not in read["throttle"].attrs
    recorded = np.degrees(history["right_elevon"][:, LIGHT])
    np.testing.assert_allclose(read["right_elevon_deg"].isel(aircraft=LIGHT), recorded, rtol=1e-12)
    assert bool(read["right_elevon_deg"].isel(aircraft=FIGHTER).isnull().all())


@pytest.mark.parametrize("name", FORMATS)
def test_a_mixed_fleet_is_exported(mixed, name):
    if name == "parquet" and not has_parquet():
        pytest.skip("no pyarrow here: nothing is written as Parquet")
    *_, dataset, summary = mixed
    content = FORMATS[name](dataset, summary, datetime(2026, 1, 1, tzinfo=UTC))
    if name == "csv":
        head, *records = content.decode().splitlines()
        columns = head.split(",")
        first_record = dict(zip(columns, records[0].split(","), strict=True))
        assert first_record["aircraft"] == "light"
        assert first_record["rudder_deg"] in ("", "nan")
        assert float(first_record["left_elevon_deg"]) == pytest.approx(
            float(dataset["left_elevon_deg"][0, LIGHT]), rel=1e-12
        )
    elif name == "parquet":
        import pyarrow.parquet

        table = pyarrow.parquet.read_table(io.BytesIO(content))
        assert {f"{surface}_deg" for surface in SURFACES} <= set(table.column_names)
    elif name == "czml":
        assert any("light" in str(packet.get("name", packet["id"])) for packet in json.loads(content))
    else:
        assert len(content) > 1000


@pytest.fixture(scope="module")
def page(mixed, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "report.html"
    write_report(*mixed[-2:], path)
    return path


def test_the_report_has_a_panel_for_each_surface(page):
    text = page.read_text(encoding="utf-8")
    for name in SURFACES:
        assert f'"response":"{name}_deg","command":"{name}_command_deg"' in text
    assert "Right elevon" in text


@pytest.mark.skipif(find_chromium() is None, reason=f"no Chromium here (none of {', '.join(NAMES)})")
def test_the_browser_draws_the_surfaces_without_errors(page, mixed, tmp_path):
    dataset = mixed[-2]
    with Chromium(tmp_path, 1010, 600, software=True) as browser:
        browser.open(page)
        browser.settle()
        browser.run("document.getElementById('controls').scrollIntoView()")
        browser.settle()
        titles = browser.run(
            "Array.from(document.querySelectorAll('#controls .title')).map((one) => one.textContent.trim())"
        )
        canvas_count = browser.run("document.querySelectorAll('#controls canvas').length")
        read = browser.run("anser.runs[0].at('left_elevon_deg', 0, 2.0)")
        missing = browser.run("Number.isNaN(anser.runs[0].at('left_elevon_deg', 1, 2.0))")
        for name in ("light", "fighter"):
            browser.run(f"anser.state.setFocus('{name}'); anser.state.setTime(1.5)")
            browser.settle()
        assert browser.faults == []
    assert [title.split(" δ")[0] for title in titles[:5]] == [
        "Left elevon",
        "Right elevon",
        "Elevator",
        "Aileron",
        "Rudder",
    ]
    assert canvas_count > 0
    assert missing is True
    assert read == pytest.approx(float(dataset["left_elevon_deg"].isel(aircraft=LIGHT).sel(time=2.0)), abs=0.0051)
