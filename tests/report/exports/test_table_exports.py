"""CSV, Parquet and MATLAB files, read by independent libraries: every number is preserved."""

import csv
import io
import sys

import duckdb
import numpy as np
import pyarrow.parquet as pq
import pymatio
import pytest

from anser.report.exports.tables import PARQUET_MISSING, to_csv, to_mat, to_parquet
from anser.variables import CATALOGUE


def _long(values):
    return values.transpose("aircraft", "time").values.ravel()


def test_csv_preserves_every_number(flown):
    dataset, _ = flown
    header, *records = csv.reader(io.StringIO(to_csv(dataset).decode(), newline=""))
    assert header == ["time_s", "aircraft", *(variable.name for variable in CATALOGUE)]
    assert len(records) == dataset.sizes["time"] * dataset.sizes["aircraft"]
    columns = dict(zip(header, zip(*records, strict=True), strict=True))
    assert list(columns["aircraft"][:: dataset.sizes["time"]]) == list(dataset["aircraft"].values)
    assert [float(text) for text in columns["time_s"]] == [*dataset["time"].values] * 3
    for name in dataset.data_vars:
        assert [float(text) for text in columns[name]] == list(_long(dataset[name]).astype(float)), name


def test_variables_with_further_dimensions_have_a_column_for_each_entry(flown, tmp_path):
    """As the estimates of an adaptive autopilot; a table without time has no place among the rows."""
    dataset = flown[0].isel(time=slice(4), aircraft=0, drop=True).assign_attrs(aircraft="anna")
    increments = np.arange(24.0).reshape(4, 2, 3)
    further = {"increment": (("time", "coefficient", "regressor"), increments), "scale": (("regressor",), np.ones(3))}
    dataset = dataset.assign(further).assign_coords(coefficient=["Cl", "Cm"], regressor=["1", "alpha", "d(a)"])
    header, *records = csv.reader(io.StringIO(to_csv(dataset).decode(), newline=""))
    added = [name for name in header if name.startswith("increment")]
    assert added == [f"increment_{row}_{column}" for row in ("Cl", "Cm") for column in ("1", "alpha", "d_a_")]
    assert "scale" not in header
    values = [[float(record[header.index(name)]) for name in added] for record in records]
    np.testing.assert_array_equal(values, increments.reshape(4, 6))
    assert set(pq.read_table(io.BytesIO(to_parquet(dataset))).column_names) == set(header)
    path = tmp_path / "flight.mat"
    path.write_bytes(to_mat(dataset))
    np.testing.assert_array_equal(pymatio.loadmat(str(path))["increment_Cm_alpha"][:, 0], increments[:, 1, 1])


def test_csv_text_is_never_a_formula_and_numbers_are_unchanged(flown):
    dataset = flown[0].isel(time=slice(2), aircraft=slice(1)).assign_coords(aircraft=["=1+1"])
    dataset = dataset.assign({"-formula": (("time", "aircraft"), np.array([["+x"], ["@x"]]))})
    header, *records = csv.reader(io.StringIO(to_csv(dataset).decode(), newline=""))
    assert (header[1], header[-1]) == ("aircraft", "'-formula")
    assert [(record[1], record[-1]) for record in records] == [("'=1+1", "'+x"), ("'=1+1", "'@x")]
    numbers = {float(cell) for record in records for cell in record[2:-1] if cell}
    assert min(numbers) < 0.0  # which begin with a minus sign


def test_parquet_preserves_every_number_and_unit(flown, tmp_path):
    dataset, _ = flown
    path = tmp_path / "flight.parquet"
    path.write_bytes(to_parquet(dataset))
    columns = duckdb.read_parquet(str(path)).fetchnumpy()
    assert list(columns) == ["time_s", "aircraft", *(variable.name for variable in CATALOGUE)]
    assert list(columns["aircraft"][:: dataset.sizes["time"]]) == list(dataset["aircraft"].values)
    for name in dataset.data_vars:
        assert columns[name].dtype == dataset[name].dtype, name
        np.testing.assert_array_equal(columns[name], _long(dataset[name]), err_msg=name)
    schema = pq.read_schema(path)
    assert schema.metadata[b"title"] == b"made-up"
    for variable in CATALOGUE:
        assert schema.field(variable.name).metadata[b"units"].decode() == variable.unit


def test_parquet_without_pyarrow_names_the_package_to_install(flown, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(ImportError, match=r'pip install "anser\[parquet\]"'):
        to_parquet(flown[0])
    assert 'pip install "anser[parquet]"' in PARQUET_MISSING


def test_mat_preserves_every_number_and_unit(flown, tmp_path):
    dataset, _ = flown
    path = tmp_path / "flight.mat"
    path.write_bytes(to_mat(dataset))
    read = pymatio.loadmat(str(path))
    assert list(read["aircraft"][:, 0]) == list(dataset["aircraft"].values)
    np.testing.assert_array_equal(np.ravel(read["time_s"]), dataset["time"].values)
    for name in dataset.data_vars:
        assert read[name].dtype == dataset[name].dtype, name
        np.testing.assert_array_equal(read[name], dataset[name].values, err_msg=name)
    for variable in CATALOGUE:
        assert read["units"][variable.name] == variable.unit
        assert read["long_name"][variable.name] == variable.long_name
    assert read["attributes"]["reference_longitude_deg"] == 179.95
    assert read["attributes"]["description"] == dataset.attrs["description"]


@pytest.mark.parametrize("name", ["_north", "größe", "a b", "x" * 64])
def test_mat_refuses_names_that_are_invalid_in_matlab(flown, name):
    with pytest.raises(ValueError, match="MATLAB cannot hold"):
        to_mat(flown[0].rename(north_m=name))
