"""Files of a flight read by xarray, pandas, SciPy or a parser alone: the same values as in anser, without a warning."""

import csv
import io
import xml.etree.ElementTree as ET
from datetime import UTC, datetime

import numpy as np
import pandas as pd
import pytest
import scipy.io
import xarray as xr

from anser.missions.sweeps import sweep_dataset
from anser.report.exports.geographic import to_czml, to_kml
from anser.report.exports.tables import to_csv, to_mat, to_parquet, write_campaign_tables
from anser.results import plan_dataset, plan_summary, read_summary, write_netcdf, write_summary
from anser.results.checksums import add_checksum
from anser.results.documents import write_json
from anser.results.flight_rows import FlightRow
from anser.results.plan_outputs import write_trajectories
from support.plain_files import parsed, read_alone
from support.plan_case import plan_case
from support.robustness_cases import made_up_study

START = datetime(2000, 1, 1, 12, tzinfo=UTC)
KML = "{http://www.opengis.net/kml/2.2}"
GX = "{http://www.google.com/kml/ext/2.2}"


def column(values):
    return values.transpose("aircraft", "time").values.ravel()


@pytest.fixture
def gaps(flown):
    """The made-up flight, with zeros and missing values."""
    dataset = flown[0].copy(deep=True)
    dataset["clearance_m"].values[3, 1] = np.nan
    dataset["north_m"].values[0] = 0.0
    return dataset


def test_xarray_reads_netcdf(gaps, tmp_path):
    write_netcdf(gaps, tmp_path / "flight.nc")
    xr.testing.assert_identical(read_alone(tmp_path / "flight.nc"), gaps)


@pytest.mark.parametrize(
    "dataset",
    [
        made_up_study(),
        sweep_dataset(
            {"a": [False, True], "b": ["", "right"]},
            ["one"],
            [FlightRow.failed_start("no plan")] * 3
            + [FlightRow([{"arrival_s": 0.0, "miss_m": 0.0, "status": "arrived"}], {}, [], met=True)],
            {"title": "test"},
        ),
    ],
    ids=["robustness", "sweep"],
)
def test_xarray_reads_surveys(dataset, tmp_path):
    write_netcdf(dataset, tmp_path / "survey.nc")
    alone = read_alone(tmp_path / "survey.nc")
    xr.testing.assert_equal(alone, dataset)
    for name, values in dataset.variables.items():
        assert alone[name].dtype.kind == values.dtype.kind or values.dtype.kind == "U", name


def test_pandas_reads_csv(gaps):
    table = pd.read_csv(io.BytesIO(to_csv(gaps)))
    assert table["aircraft"].tolist() == np.repeat(gaps["aircraft"].values, gaps.sizes["time"]).tolist()
    np.testing.assert_allclose(table["time_s"], np.tile(gaps["time"].values, gaps.sizes["aircraft"]), rtol=4e-16)
    for name, values in gaps.items():
        # older versions of pandas round the last digit
        np.testing.assert_allclose(table[name].to_numpy(), column(values), rtol=4e-16, err_msg=name)


def test_pandas_reads_parquet(gaps):
    table = pd.read_parquet(io.BytesIO(to_parquet(gaps)))
    assert table["aircraft"].tolist() == np.repeat(gaps["aircraft"].values, gaps.sizes["time"]).tolist()
    for name, values in gaps.items():
        assert table[name].dtype == values.dtype, name
        np.testing.assert_array_equal(table[name].to_numpy(), column(values), err_msg=name)


def test_scipy_reads_mat(gaps):
    read = scipy.io.loadmat(io.BytesIO(to_mat(gaps)))
    np.testing.assert_array_equal(read["time_s"][:, 0], gaps["time"].values)
    assert [name.item() for name in read["aircraft"][:, 0]] == gaps["aircraft"].values.tolist()
    for name, values in gaps.items():
        np.testing.assert_array_equal(read[name], values.values, err_msg=name)
        assert read["units"][name].item().item() == values.attrs["units"], name


def test_an_xml_parser_reads_kml(flown):
    dataset, summary = flown
    root = ET.fromstring(to_kml(dataset, summary, START))
    tracks = [
        mark for mark in root.iter(f"{KML}Placemark") if mark.findtext(f"{KML}name") in dataset["aircraft"].values
    ]
    assert len(tracks) == dataset.sizes["aircraft"]
    for k, track in enumerate(tracks):
        coordinates = np.array([entry.text.split() for entry in track.iter(f"{GX}coord")], dtype=float)
        expected = [dataset[name].values[:, k] for name in ("longitude_deg", "latitude_deg", "altitude_m")]
        np.testing.assert_allclose(coordinates, np.transpose(expected), rtol=0, atol=1e-4)


def test_a_json_parser_reads_czml(flown, tmp_path):
    dataset, summary = flown
    (tmp_path / "flight.czml").write_bytes(to_czml(dataset, summary, START))
    packets = {packet["id"]: packet for packet in parsed(tmp_path / "flight.czml")}
    for k in range(dataset.sizes["aircraft"]):
        samples = np.reshape(packets[f"aircraft-{k}"]["position"]["cartographicDegrees"], (-1, 4))
        expected = [dataset[name].values[:, k] for name in ("longitude_deg", "latitude_deg", "altitude_m")]
        np.testing.assert_allclose(samples, np.transpose([dataset["time"].values, *expected]), rtol=0, atol=1e-4)


def test_a_json_parser_reads_summary_and_plan(tmp_path):
    aircraft = {
        "name": "ä",
        "goal": "b",
        "status": "arrived",
        "planned_arrival_s": 0.0,
        "arrival_s": None,
        "miss_m": 0.0,
    }
    fleet = {"separation_min_m": None, "simulated_s": 0.0}
    summary = {
        "format_version": 1,
        "scenario": {"name": ""},
        "aircraft": [aircraft],
        "fleet": fleet,
        "requirements": [],
    }
    write_summary(summary, tmp_path / "summary.json")
    assert parsed(tmp_path / "summary.json") == add_checksum(summary)
    assert read_summary(tmp_path / "summary.json") == summary
    plan = plan_dataset(*plan_case(separation_m=(500.0, 150.0)))
    write_summary(plan_summary(plan), tmp_path / "plan.json")
    assert parsed(tmp_path / "plan.json") == add_checksum(plan_summary(plan))
    write_json(plan_summary(plan), tmp_path / "document.json")
    assert parsed(tmp_path / "document.json") == plan_summary(plan)


def test_pandas_and_csv_read_the_trajectories_of_a_plan(tmp_path):
    plan = plan_dataset(*plan_case())
    write_trajectories(plan, tmp_path / "trajectories.csv")
    table = pd.read_csv(tmp_path / "trajectories.csv")
    with (tmp_path / "trajectories.csv").open(newline="", encoding="utf-8") as file:
        header, *records = csv.reader(file)
    assert list(table.columns) == header
    np.testing.assert_allclose(table["time_s"], [float(record[0]) for record in records], rtol=4e-16)
    for name in plan["aircraft"].values:
        of_one = table[table["aircraft"] == name]
        expected = plan["north_m"].sel(aircraft=name, time=of_one["time_s"].to_numpy())
        np.testing.assert_allclose(of_one["north_m"], expected, rtol=0, atol=1e-6)


def test_pandas_reads_the_tables_of_a_campaign(tmp_path):
    pairs = ("flight", "aircraft")
    dataset = xr.Dataset(
        {
            "met": ("flight", [True, False]),
            "reason": ("flight", ["", "made up"]),
            "miss_m": (pairs, [[0.0], [np.nan]]),
            "arrival_s": (pairs, [[60.0], [np.nan]]),
            "status": (pairs, [["arrived"], ["no flight"]]),
        },
        {"flight": [0, 1], "aircraft": ["one"]},
    )
    quantile = {"name": "miss_m", "words": "greatest miss", "unit": "m", "share": 0.5, "upper": True}
    answers = {"probability": 0.5, "low": 0.0, "high": 1.0, "flights": 2, "flown": 2, "met": 1, "independent": 2}
    answers |= {"confidence": 0.95, "causes": {}, "quantiles": [quantile | {"value": 0.0, "low": None, "high": None}]}
    index = {"output": "met", "path": "a", "measure": "first", "value": 0.0, "low": None, "high": 1.0}
    write_campaign_tables(dataset, answers, {"entries": [index], "not_computed": {}}, tmp_path)
    flights = pd.read_parquet(tmp_path / "flights.parquet")
    assert flights["met"].tolist() == [True, False]
    assert flights["reason"].tolist() == ["", "made up"]
    assert flights["worst_miss_m"].tolist() == [0.0, np.inf]
    aircraft = pd.read_parquet(tmp_path / "aircraft.parquet")
    np.testing.assert_array_equal(aircraft["miss_m"], [0.0, np.nan])
    assert aircraft["flight"].tolist() == [0, 1]
    estimates = pd.read_parquet(tmp_path / "answers.parquet")
    np.testing.assert_array_equal(estimates["low"].to_numpy(dtype=float), [0.0, np.nan])
    indices = pd.read_parquet(tmp_path / "indices.parquet")
    np.testing.assert_array_equal(indices["value"].to_numpy(dtype=float), [0.0])
