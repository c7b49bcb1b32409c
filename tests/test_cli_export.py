"""The command export end to end: files, refusals, nothing overwritten."""

import json

import numpy as np
import pandas as pd
import pytest
from scipy.io import loadmat

from anser.results import write_netcdf
from support.tiny_run import make_run, tiny_dataset


@pytest.fixture
def folder(tmp_path):
    return make_run(tmp_path / "run")


def test_files_are_written_beside_the_flight_or_into_a_new_folder(anser, folder, tmp_path):
    code, printed, _ = anser("export", folder, "--format", "csv,mat", "--format", "kml", "--period-s", "1")
    assert code == 0
    assert printed.count("MB") == 3
    assert len((folder / "flight.csv").read_text().splitlines()) == 1 + 3
    original = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert set(original) == {"flight.nc", "summary.json", "flight.csv", "flight.mat", "flight.kml"}

    code, _, err = anser("export", folder, "--format", "parquet,csv")
    assert code == 2
    assert "flight.csv, which exists" in err
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == original

    out = tmp_path / "new" / "folder"
    code, _, _ = anser("export", folder, "--format", "czml,parquet", "--out", out, "--start", "2024-02-29T06:00+02:00")
    assert code == 0
    assert {path.name for path in out.iterdir()} == {"flight.czml", "flight.parquet"}
    clock = json.loads((out / "flight.czml").read_text())[0]["clock"]
    assert clock["interval"] == "2024-02-29T04:00:00.000000Z/2024-02-29T04:00:02.000000Z"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--format", "xlsx"), ("--format", "'xlsx'", "czml, kml, csv, parquet, mat")),
        (("--format", "csv,"), ("--format", "''", "czml")),
        (("--format", "csv", "--start", "noon"), ("--start", "'noon'", "2000-01-01T12:00:00Z")),
        (("--format", "csv", "--start", "0001-01-01"), ("--start", "1900 to 2200")),
        (("--format", "csv", "--period-s", "0"), ("--period-s", "0", "above 0")),
        (("--format", "csv", "--period-s", "nan"), ("--period-s", "nan", "above 0")),
    ],
)
def test_bad_options_end_with_2_and_write_nothing(anser, folder, options, said):
    code, _, err = anser("export", folder, *options)
    assert code == 2
    for part in said:
        assert part in err
    assert {path.name for path in folder.iterdir()} == {"flight.nc", "summary.json"}


def test_bad_folders_end_with_2(anser, folder, tmp_path):
    def refused(folder):
        code, _, err = anser("export", folder, "--format", "csv")
        assert code == 2
        return err

    assert "no folder" in refused(tmp_path / "none")
    assert "no flight.nc and no summary.json" in refused(tmp_path)
    assert f"which is no folder; expected its folder, {folder}" in refused(folder / "flight.nc")
    summary = (folder / "summary.json").read_text()
    (folder / "summary.json").write_text(summary.replace("one", "two"))
    assert "summary.json of two" in refused(folder)
    (folder / "summary.json").write_text("[1]")
    assert "summary.json: arrived JSON that is a list; expected an object" in refused(folder)
    (folder / "flight.nc").write_text("no flight")
    assert "flight.nc: arrived a file that cannot be read" in refused(folder)


def test_a_flight_of_one_aircraft_is_written_as_tables_and_refused_on_maps(anser, tmp_path):
    dataset = tiny_dataset().isel(aircraft=0, drop=True).assign_attrs(aircraft="f16")
    (tmp_path / "doublet").mkdir()
    write_netcdf(dataset, tmp_path / "doublet" / "flight.nc")
    out = tmp_path / "out"
    code, _, _ = anser("export", tmp_path / "doublet", "--format", "csv,parquet,mat", "--out", out)
    assert code == 0
    table = pd.read_csv(out / "flight.csv")
    assert set(table["aircraft"]) == {"f16"}
    np.testing.assert_array_equal(table["altitude_m"], dataset["altitude_m"])
    np.testing.assert_array_equal(table["time_s"], dataset["time"])
    np.testing.assert_array_equal(pd.read_parquet(out / "flight.parquet")["altitude_m"], dataset["altitude_m"])
    assert loadmat(out / "flight.mat")["altitude_m"].shape == (dataset.sizes["time"], 1)

    code, _, err = anser("export", tmp_path / "doublet", "--format", "csv,kml", "--out", tmp_path / "map")
    assert code == 2
    assert "arrived kml" in err
    assert "csv, parquet, mat" in err
    assert not (tmp_path / "map").exists()


def test_parquet_without_its_library_is_refused_before_reading(anser, tmp_path, monkeypatch):
    monkeypatch.setattr("anser.report.exports.tables.has_parquet", lambda: False)
    code, _, err = anser("export", tmp_path / "none", "--format", "parquet")
    assert code == 2
    assert 'pyarrow is not installed: pip install "anser[parquet]"' in err
    assert "all other formats are written without it" in err


def test_other_formats_are_written_without_the_library_of_one(anser, folder, tmp_path, monkeypatch):
    monkeypatch.setattr("anser.report.exports.tables.has_parquet", lambda: False)
    out = tmp_path / "tables"
    code, printed, err = anser("export", folder, "--format", "czml,kml,csv,parquet,mat", "--out", out, "--json")
    assert code == 1
    assert {path.name for path in out.iterdir()} == {f"flight.{name}" for name in ("czml", "kml", "csv", "mat")}
    assert err.count("\n") == 1
    assert f"{out / 'flight.parquet'}: not written" in err
    assert 'pip install "anser[parquet]"' in err
    document = json.loads(printed)
    assert set(document["files"]) == {"czml", "kml", "csv", "mat"}
    assert set(document["left_out"]) == {"parquet"}


def test_force_replaces_files_of_the_same_names_and_leaves_the_others(anser, folder):
    original = (folder / "flight.nc").read_bytes()
    (folder / "flight.csv").write_text("old")
    (folder / "flight.kml").write_text("mine")
    assert anser("export", folder, "--format", "csv")[0] == 2
    assert (folder / "flight.csv").read_text() == "old"
    assert anser("export", folder, "--format", "csv", "--force")[0] == 0
    assert (folder / "flight.csv").read_text().startswith("time_s,aircraft")
    assert (folder / "flight.kml").read_text() == "mine"
    assert (folder / "flight.nc").read_bytes() == original
    assert len(list(folder.iterdir())) == 4
