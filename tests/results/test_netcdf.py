"""A flight read from disk equals the written flight."""

import netCDF4
import numpy as np
import pytest
import xarray as xr

from anser.results import read_netcdf, to_dataset, write_netcdf
from anser.variables import CATALOGUE


@pytest.fixture
def dataset(time_s, history, names, attributes):
    history["clearance"][2, 0] = np.nan
    return to_dataset(time_s, history, names, attributes)


def test_a_round_trip_is_exact(dataset, tmp_path):
    path = tmp_path / "flight.nc"
    write_netcdf(dataset, path)
    read = read_netcdf(path)
    xr.testing.assert_identical(read, dataset)
    for variable in CATALOGUE:
        assert read[variable.name].dtype == np.dtype(variable.dtype)
        assert read[variable.name].values.tobytes() == dataset[variable.name].values.tobytes()
    assert read["aircraft"].dtype == dataset["aircraft"].dtype
    assert [entry.name for entry in tmp_path.iterdir()] == ["flight.nc"]


def test_booleans_are_flags_on_disk(dataset, tmp_path):
    path = tmp_path / "flight.nc"
    write_netcdf(dataset, path)
    with netCDF4.Dataset(path) as file:
        stored = file["outside_tables"]
        assert stored.dtype == np.int8
        assert list(stored.flag_values) == [0, 1]
        assert stored.flag_values.dtype == np.int8
        assert stored.flag_meanings == "inside outside"
        assert "_FillValue" not in file["north_m"].ncattrs()
        assert file["north_m"].filters()["zlib"]


def test_a_flight_is_not_overwritten(dataset, tmp_path):
    path = tmp_path / "flight.nc"
    path.write_text("precious")
    with pytest.raises(FileExistsError, match="not overwritten"):
        write_netcdf(dataset, path)
    assert path.read_text() == "precious"


def test_a_failed_write_leaves_nothing(dataset, tmp_path):
    broken = dataset.assign_attrs(scenario=object())
    with pytest.raises(TypeError):
        write_netcdf(broken, tmp_path / "flight.nc")
    assert list(tmp_path.iterdir()) == []
