"""Reading a saved flight: equality with the original, and messages for folders without a complete run."""

import shutil

import pytest
import xarray as xr

import anser
from anser.config import ScenarioError
from anser.results import write_netcdf, write_summary
from support.made_flight import make_flight


@pytest.fixture(scope="module")
def flight():
    return make_flight()


@pytest.fixture(scope="module")
def folder(flight, tmp_path_factory):
    path = tmp_path_factory.mktemp("run")
    dataset, summary = flight[:2]
    write_netcdf(dataset, path / "flight.nc")
    write_summary(summary, path / "summary.json")
    return path


def test_a_restored_flight_equals_the_saved_flight(flight, folder, tmp_path, monkeypatch):
    restored = anser.load_flight(str(folder))
    xr.testing.assert_identical(restored.dataset, flight[0])
    assert restored.summary == flight[1]
    assert str(restored)
    assert "tracks" in restored.plot.names
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    assert restored.show().read_text().startswith("<!DOCTYPE html>")
    assert len(opened) == 1


def test_a_folder_without_a_run_is_refused(folder, tmp_path):
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
def test_an_incomplete_flight_is_refused_with_the_defect(flight, folder, tmp_path, change, message):
    shutil.copy(folder / "summary.json", tmp_path)
    write_netcdf(change(flight[0]), tmp_path / "flight.nc")
    with pytest.raises(ValueError, match=message):
        anser.load_flight(tmp_path)


def test_a_run_folder_given_as_a_scenario_is_refused_with_advice(folder):
    with pytest.raises(ScenarioError, match=r"arrived a folder; expected .*; a run is read by anser\.load_flight"):
        anser.load(folder)
