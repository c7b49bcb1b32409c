"""A run read back from its folder: as it was saved, or one message that says what is no run."""

import shutil

import pytest
import xarray as xr

import anser
from anser.config import ScenarioError
from anser.results import write_netcdf, write_summary
from support.made_flight import make_flight


@pytest.fixture(scope="module")
def made():
    return make_flight()


@pytest.fixture(scope="module")
def folder(made, tmp_path_factory):
    place = tmp_path_factory.mktemp("run")
    dataset, summary = made[:2]
    write_netcdf(dataset, place / "flight.nc")
    write_summary(summary, place / "summary.json")
    return place


def test_what_is_read_is_what_was_saved(made, folder, tmp_path, monkeypatch):
    read = anser.load_flight(str(folder))
    xr.testing.assert_identical(read.dataset, made[0])
    assert read.summary == made[1]
    assert str(read)
    assert "tracks" in read.plot.names
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    assert read.show().read_text().startswith("<!DOCTYPE html>")
    assert len(opened) == 1


def test_what_is_no_run_is_refused(folder, tmp_path):
    with pytest.raises(ValueError, match="none, which is no folder; expected one that `anser run` wrote"):
        anser.load_flight(tmp_path / "none")
    with pytest.raises(ValueError, match=f"flight.nc, which is no folder; expected its folder, {folder}"):
        anser.load_flight(folder / "flight.nc")
    half = tmp_path / "half"
    half.mkdir()
    shutil.copy(folder / "summary.json", half)
    with pytest.raises(ValueError, match=r"holds no flight\.nc; expected"):
        anser.load_flight(half)
    (half / "flight.nc").write_text("no flight")
    with pytest.raises(ValueError, match=r"flight\.nc: arrived a file that cannot be read"):
        anser.load_flight(half)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: data.drop_vars("time"), r"flight\.nc: arrived without time"),
        (lambda data: data.drop_vars("altitude_m"), "arrived without altitude_m"),
        (lambda data: data.assign(altitude_m=data["altitude_m"] * float("nan")), "altitude_m with values that are not finite"),
        (lambda data: data.isel(time=slice(None, None, -1)), "arrived time that does not increase"),
        (lambda data: data.isel(aircraft=[0, 0, 1]), "expected each name once"),
        (lambda data: data.assign(north_m=data["north_m"].isel(time=0, drop=True)), "arrived north_m over {'aircraft': 3}"),
        (lambda data: data.isel(aircraft=[0, 1]), r"arrived flight\.nc of anna, bert with summary\.json of anna, bert, <b>"),
        (lambda data: data.assign_attrs(scenario_hash="another"), r"arrived flight\.nc of scenario another with summary"),
    ],
)  # fmt: skip
def test_what_is_no_whole_flight_is_refused_by_name(made, folder, tmp_path, change, message):
    shutil.copy(folder / "summary.json", tmp_path)
    write_netcdf(change(made[0]), tmp_path / "flight.nc")
    with pytest.raises(ValueError, match=message):
        anser.load_flight(tmp_path)


def test_a_run_is_no_scenario_and_the_message_says_how_it_is_read(folder):
    with pytest.raises(ScenarioError, match=r"arrived a folder; expected .*; a run is read by anser\.load_flight"):
        anser.load(folder)
