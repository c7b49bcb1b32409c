"""Wind fields from files: values, refusals, and the extent of a field."""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

from anser.config.errors import ScenarioError
from anser.constants import GEOPOTENTIAL_RADIUS_M, STANDARD_GRAVITY_M_S2
from anser.scenario.build_wind_field import build_wind_field
from anser.scenario.schema_environment import Earth, Wind
from anser.scenario.wind_field_file import file_digest, read_wind_field
from anser.single_aircraft.air import read_air
from anser.spatial.wgs84 import flat_from_geodetic
from support.wind_files import LEVELS_HPA, era5_file, metric_file

NORTH, EAST = np.linspace(-6000.0, 6000.0, 25), np.linspace(-5000.0, 5000.0, 21)
ALTITUDE = np.linspace(0.0, 3000.0, 31)


@pytest.mark.parametrize("east_deg", [9.0, 359.75])
def test_values_of_the_era5_layout_are_those_of_xarray_in_the_coordinates_of_the_file(
    tmp_path: Path, east_deg: float
) -> None:
    path = era5_file(tmp_path / "era5.nc", east_deg=east_deg)
    origin_deg = east_deg if east_deg < 180.0 else east_deg - 360.0
    field = build_wind_field(Wind(field=str(path)), Earth(latitude_deg=45.0, longitude_deg=origin_deg))
    rng, count = np.random.default_rng(3), 1000
    low, high = np.array([[0.0, 300.0, -1.0, -1.0], [7200.0, 1000.0, 1.0, 1.0]])
    time, level, north_deg, east_offset_deg = rng.uniform(low[:, None], high[:, None], (4, count))
    with xr.open_dataset(path) as packed:
        data = packed.astype(float).assign_coords(
            valid_time=[0.0, 3600.0, 7200.0],
            latitude=packed.latitude - 45.0,
            longitude=np.arange(-1.0, 1.1, 0.25),
        )
        # omega dz/dp, with which -omega/(rho g) agrees in hydrostatic balance
        log_pressure = np.log(100.0 * np.array(LEVELS_HPA))
        slope = np.gradient(data.z.values / STANDARD_GRAVITY_M_S2, log_pressure, axis=1)
        data["up"] = data.w * slope / (100.0 * data.pressure_level)
        at = {"valid_time": time, "pressure_level": level, "latitude": north_deg, "longitude": east_offset_deg}
        expected = data.interp({name: ("point", values) for name, values in at.items()})
    geopotential_m = expected.z.values / STANDARD_GRAVITY_M_S2
    altitude = GEOPOTENTIAL_RADIUS_M * geopotential_m / (GEOPOTENTIAL_RADIUS_M - geopotential_m)
    origin = jnp.deg2rad(45.0)

    def position(north: Any, east: Any, up: Any) -> Any:
        return flat_from_geodetic(origin + jnp.deg2rad(north), jnp.deg2rad(east), up, origin, 0.0, 0.0)

    positions_n = jax.vmap(position)(north_deg, east_offset_deg, altitude)
    values, slopes = jax.jit(jax.vmap(lambda p, t: (field.at(p, t), jax.jacfwd(field.at)(p, t))))(positions_n, time)
    expected_n = np.stack([expected.v, expected.u, -expected.up], axis=-1)
    # rounding of an angle of 1 rad, 1e-16, is 3e-14 of a cell's width; the wind changes by up to 10 m/s across it
    assert np.max(np.abs(np.asarray(values) - expected_n)) < 1e-12
    assert np.all(np.isfinite(np.asarray(slopes)))
    assert np.max(np.abs(expected_n[:, 2])) > 0.1


@pytest.mark.parametrize(
    "meridians_deg", [np.arange(0.0, 360.0, 5.0), np.arange(-180.0, 180.1, 5.0), np.arange(-190.0, 190.1, 5.0)]
)
@pytest.mark.parametrize("origin_deg", [0.0, 2.5, 179.0, -178.0])
def test_a_field_around_the_globe_has_no_seam(tmp_path: Path, meridians_deg: Any, origin_deg: float) -> None:
    latitudes_deg, altitudes_m = np.array([30.0, 50.0]), np.array([0.0, 20_000.0])
    shape = (altitudes_m.size, latitudes_deg.size, meridians_deg.size)
    coordinates = {
        "altitude": ("altitude", altitudes_m, {"units": "m", "standard_name": "altitude"}),
        "latitude": ("latitude", latitudes_deg, {"units": "degrees_north"}),
        "longitude": ("longitude", meridians_deg, {"units": "degrees_east"}),
    }
    eastward = np.broadcast_to(20.0 * np.cos(np.radians(meridians_deg)), shape)
    winds = {"eastward_wind": eastward, "northward_wind": 0.0 * eastward}
    xr.Dataset(
        {
            name: (tuple(coordinates), values, {"units": "m s-1", "standard_name": name})
            for name, values in winds.items()
        },
        coordinates,
    ).to_netcdf(tmp_path / "globe.nc")
    field = build_wind_field(Wind(field=str(tmp_path / "globe.nc")), Earth(latitude_deg=40.0, longitude_deg=origin_deg))
    origin = jnp.deg2rad(40.0)
    for offset_deg in (-8.0, -3.0, 0.0, 3.0, 8.0):
        position_n = flat_from_geodetic(origin, jnp.deg2rad(offset_deg), 1000.0, origin, 0.0, 0.0)
        # a chord over 5 deg is 1e-3 of the amplitude off
        expected = 20.0 * np.cos(np.radians(origin_deg + offset_deg))
        assert float(field.at(position_n, 0.0)[1]) == pytest.approx(expected, abs=0.03)
        assert not bool(field.is_outside(position_n, 0.0))


def rotation(t: Any, n: Any, e: Any, h: Any) -> tuple[Any, Any, Any]:
    return 1e-3 * n, -1e-3 * e, 0.0 * n


def shear(t: Any, n: Any, e: Any, h: Any) -> tuple[Any, Any, Any]:
    return 0.01 * h, 2.0 + 1e-3 * t - 0.005 * h, 0.0 * h


def thermal(t: Any, n: Any, e: Any, h: Any) -> tuple[Any, Any, Any]:
    return 0.0 * n, 0.0 * n, 4.0 * np.exp(-(n**2 + e**2) / 2000.0**2)


# bound of linear interpolation: sum over the axes of interval^2 / 8 times the greatest second derivative, which is
# 2 * 4 / 2000^2 m/s/m^2 at the middle of the thermal; rotation and shear are linear
@pytest.mark.parametrize(
    ("velocity", "bound"), [(rotation, 1e-11), (shear, 1e-11), (thermal, 2 * 500.0**2 / 8 * 2 * 4.0 / 2000.0**2)]
)
def test_analytic_fields_equal_their_formula_within_the_bound_of_the_interpolation(
    tmp_path: Path, velocity: Any, bound: float
) -> None:
    times_s = np.array([0.0, 100.0, 300.0])
    path = metric_file(tmp_path / "f.nc", velocity, north=NORTH, east=EAST, altitude=ALTITUDE, times_s=times_s)
    field = build_wind_field(Wind(field=str(path)), None)
    rng = np.random.default_rng(4)
    time = rng.uniform(0.0, 300.0, 500)
    positions_n = rng.uniform([-6000.0, -5000.0, -3000.0], [6000.0, 5000.0, 0.0], (500, 3))
    values = np.asarray(jax.jit(jax.vmap(field.at))(jnp.asarray(positions_n), jnp.asarray(time)))
    east, north, up = velocity(time, positions_n[:, 0], positions_n[:, 1], -positions_n[:, 2])
    assert np.max(np.abs(values - np.stack([north, east, -up], axis=-1))) < bound


def change(name: str, **attributes: Any) -> Any:
    def apply(data: xr.Dataset) -> xr.Dataset:
        data[name].attrs.update(attributes)
        return data

    return apply


def with_gap(data: xr.Dataset) -> xr.Dataset:
    data["u"][0, 0, 1, 2] = np.nan
    return data


IRREGULARITIES = {
    "units of a velocity": (change("u", units="knots"), "u in 'knots'; expected units 'm s-1'"),
    "no units": (change("v", units=""), "v without units; expected units 'm s-1'"),
    "units of omega": (change("w", units="hPa s-1"), "w in 'hPa s-1'; expected units m s-1 or Pa s-1"),
    "levels that are no pressures": (change("pressure_level", units="1"), "pressure_level in '1'"),
    "a gap": (with_gap, "1 missing values of u, first at valid_time 0, latitude 1, longitude 2, pressure_level 0"),
    "no altitudes": (lambda data: data.drop_vars("z"), "pressure levels (pressure_level) alone"),
    "no wind": (lambda data: data.drop_vars("u"), "the variables v, w, z; expected one of standard_name eastward_wind"),
    "one latitude": (lambda data: data.isel(latitude=[0]), "one latitude"),
    "one level": (lambda data: data.isel(pressure_level=[0]), "one level"),
    "shuffled times": (lambda data: data.isel(valid_time=[0, 2, 1]), "a coordinate time that neither rises nor falls"),
    "another dimension": (lambda data: data.expand_dims(expver=2).transpose(..., "expver"), "the dimension expver"),
}


@pytest.mark.parametrize("name", IRREGULARITIES)
def test_irregular_files_are_refused_with_a_sentence(tmp_path: Path, name: str) -> None:
    modify, message = IRREGULARITIES[name]
    with xr.open_dataset(era5_file(tmp_path / "era5.nc", packed=False)) as data:
        modified = modify(data.load().drop_vars("expver"))
    modified.to_netcdf(tmp_path / "changed.nc", engine="netcdf4")
    with pytest.raises(ScenarioError) as caught:
        build_wind_field(Wind(field=str(tmp_path / "changed.nc")), Earth())
    assert message in str(caught.value)
    assert len(str(caught.value).splitlines()) == 2


def test_members_start_times_and_bad_keys(tmp_path: Path) -> None:
    path = str(era5_file(tmp_path / "era5.nc", members=3))
    earth, position_n = Earth(latitude_deg=45.0, longitude_deg=9.0), jnp.array([100.0, 200.0, -2000.0])
    first, second, later = (
        build_wind_field(Wind(field=path, **keys), earth)
        for keys in ({}, {"member": 1}, {"start_time": "2025-01-01T00:30Z"})
    )
    assert first.columns is second.columns  # one copy for all members
    assert not np.allclose(first.at(position_n, 0.0), second.at(position_n, 0.0))
    np.testing.assert_allclose(later.at(position_n, 0.0), first.at(position_n, 1800.0), rtol=1e-12)
    for keys, message in (
        ({"member": 3}, "expected from 0 to 2, the file's members"),
        ({"start_time": "2024-01-01"}, "from 2025-01-01T00:00:00 to 2025-01-01T02:00:00"),
        ({"start_time": 5.0}, "expected a date and time"),
        ({"start_time": "noon"}, "expected a date and time"),
    ):
        with pytest.raises(ScenarioError, match=message):
            build_wind_field(Wind(field=path, **keys), earth)
    assert read_air(wind={"field": Path(path)}).wind == read_air(wind={"field": path}).wind
    for values, message in (
        ({"field": tmp_path / "none.nc"}, "none.nc"),
        ({"field": path, "speed_m_s": 3.0}, "3 beside field"),
        ({"member": 1}, "member without field"),
    ):
        with pytest.raises(ScenarioError, match=message):
            read_air(wind=values)


def calm_file(path: Path, modify: Any) -> Path:
    """Write still air on axes in metres, changed by `modify`, a function of the dataset."""
    north = np.array([-1000.0, 1000.0])
    source = metric_file(path / "calm.nc", thermal, north=north, east=north, altitude=np.array([0.0, 500.0]))
    with xr.open_dataset(source) as data:
        modify(data.load()).to_netcdf(path / "changed.nc", engine="netcdf4")
    return path / "changed.nc"


def pressure_level_file(path: Path, standard_name: str) -> Path:
    """Write still air on two pressure levels, whose heights of 0 and 500 m are the variable zg."""

    def on_pressures(data: xr.Dataset) -> xr.Dataset:
        attributes = {"units": "m", "standard_name": standard_name}
        pressures = ("level", [1000.0, 950.0], {"units": "hPa"})
        data = data.assign(zg=("altitude", data.altitude.values, attributes)).rename(altitude="level")
        return data.assign_coords(level=pressures)

    return calm_file(path, on_pressures)


def test_members_without_times_are_members(tmp_path: Path) -> None:
    path = calm_file(tmp_path, lambda data: data.isel(time=0).expand_dims(realization=[0, 1]))
    field = build_wind_field(Wind(field=str(path), member=1), None)
    assert bool(jnp.all(field.at(jnp.array([0.0, 0.0, -100.0]), 0.0)[:2] == 0.0))
    with pytest.raises(ScenarioError, match="member: arrived 2; expected from 0 to 1, the file's members"):
        build_wind_field(Wind(field=str(path), member=2), None)


@pytest.mark.parametrize("standard_name", ["altitude", "height_above_mean_sea_level"])
@pytest.mark.parametrize("name", ["level", "height", "z"])
def test_the_standard_name_of_levels_counts_before_their_name(tmp_path: Path, name: str, standard_name: str) -> None:
    renamed = calm_file(tmp_path, lambda data: change(name, standard_name=standard_name)(data.rename(altitude=name)))
    assert float(build_wind_field(Wind(field=str(renamed)), None).altitude_max) == 500.0


def test_latitudes_beyond_the_poles_are_refused(tmp_path: Path) -> None:
    with xr.open_dataset(era5_file(tmp_path / "era5.nc")) as data:
        latitude = data.latitude + 60.0
        far = data.load().assign_coords(latitude=latitude.assign_attrs(units="degrees_north"))
    far.to_netcdf(tmp_path / "far.nc", engine="netcdf4")
    with pytest.raises(ScenarioError, match=r"latitudes from .* deg; expected latitudes within -90 to 90 deg"):
        build_wind_field(Wind(field=str(tmp_path / "far.nc")), None)


def test_levels_named_geopotential_height_need_no_standard_name(tmp_path: Path) -> None:
    name = "geopotential_height"
    path = calm_file(tmp_path, lambda data: change(name, standard_name="")(data.rename(altitude=name)))
    assert read_wind_field(str(path), file_digest(path)).is_geopotential


@pytest.mark.parametrize(("name", "attributes"), [("height", {}), ("z", {"standard_name": "height"})])
def test_heights_above_the_ground_are_refused(tmp_path: Path, name: str, attributes: dict[str, str]) -> None:
    path = calm_file(tmp_path, lambda data: change(name, **attributes)(data.rename(altitude=name)))
    with pytest.raises(ScenarioError, match=f"the levels {name}, read as heights above the ground; expected altitudes"):
        build_wind_field(Wind(field=str(path)), None)


@pytest.mark.parametrize(
    ("standard_name", "is_geopotential"),
    [("geopotential_height", True), ("altitude", False), ("height_above_mean_sea_level", False)],
)
def test_heights_of_pressure_levels_are_geopotential_or_altitudes_by_their_standard_name(
    tmp_path: Path, standard_name: str, is_geopotential: bool
) -> None:
    path = pressure_level_file(tmp_path, standard_name)
    field = read_wind_field(str(path), file_digest(path))
    assert field.is_geopotential == is_geopotential
    np.testing.assert_array_equal(field.altitude_bounds, [[0.0, 500.0], [0.0, 500.0]])


@pytest.mark.parametrize("standard_name", ["height", "height_above_ground"])
def test_pressure_levels_with_heights_above_the_ground_are_refused(tmp_path: Path, standard_name: str) -> None:
    message = r"pressure levels \(level\) with zg, read as heights above the ground; expected a variable geopotential"
    with pytest.raises(ScenarioError, match=message):
        build_wind_field(Wind(field=str(pressure_level_file(tmp_path, standard_name))), None)
