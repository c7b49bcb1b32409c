"""The table [atmosphere]: off-standard days, humid air and soundings, in scenarios and in flights of one aircraft."""

import math
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import anser
from anser.config.errors import ScenarioError
from anser.environment.air import (
    STANDARD_LAYERS,
    air_at_geopotential,
    air_in_layers,
    humid_layers,
    measured_layers,
    padded_layers,
)
from anser.environment.atmosphere import LayeredAtmosphere
from anser.scenario.build_environment import build_environment
from anser.scenario.schema import Scenario
from anser.scenario.sounding_file import read_sounding

SINGLE = "scenarios/single-aircraft.toml"
R = 287.05287
G = 9.80665
CSV = """\
# a warm morning
altitude_m,pressure_hpa,temperature_c,dew_point_c,wind_speed_m_s,wind_from_deg
100,1005,24,18,3,180
500,959.5,22,16,6,200
1500,854,16,8,9,230
3000,713,6,-4,12,250
6000,486,-14,-30,18,260
"""
LISTING = """\
72451 DDC Dodge City Observations at 12Z 25 Jun 2019

-----------------------------------------------------------------------------
   PRES   HGHT   TEMP   DWPT   RELH   MIXR   DRCT   SKNT   THTA   THTE   THTV
    hPa     m      C      C      %    g/kg    deg   knot     K      K      K
-----------------------------------------------------------------------------
 1000.0    112
  922.0    790   18.2   17.1     93  13.50    150      8  298.2  338.4  300.7
  850.0   1500   20.0   10.0     52   9.20    200     20  309.5  338.0  311.3
  700.0   3150    8.0   -5.0     39   3.78                311.4  323.8  312.1

Station information and sounding indices
"""


def with_air(**atmosphere) -> Scenario:
    return anser.load(SINGLE).replace("atmosphere", atmosphere)


@pytest.mark.parametrize("offset_k", [30.0, -40.0])
def test_density_on_a_hot_and_a_cold_day_follows_from_the_gas_law(offset_k):
    """Geopotential 3,000 m: standard 268.65 K; pressure by the hydrostatic law from 1013.25 hPa with the lapse rate."""
    layers = with_air(temperature_offset_k=offset_k).atmosphere.layers
    air = air_at_geopotential(layers, 3000.0)
    temperature = 268.65 + offset_k
    pressure = 101_325.0 * (temperature / (288.15 + offset_k)) ** (G / (R * 0.0065))
    assert float(air.temperature) == pytest.approx(temperature)
    assert float(air.pressure) == pytest.approx(pressure, rel=1e-6)
    assert float(air.density) == pytest.approx(pressure / (R * temperature), rel=1e-6)


def test_the_built_atmosphere_is_that_of_the_layers():
    for table in ({"temperature_offset_k": 12.0}, {"sea_level_pressure_hpa": 990.0, "relative_humidity_percent": 70.0}):
        scenario = with_air(**table)
        atmosphere = build_environment(scenario).atmosphere
        altitudes = np.linspace(-100.0, 20_000.0, 60)
        built = jax.jit(jax.vmap(atmosphere.at))(altitudes)
        expected = air_in_layers(scenario.atmosphere.layers, altitudes)
        for name in ("density", "pressure", "temperature", "speed_of_sound"):
            np.testing.assert_allclose(getattr(built, name), getattr(expected, name), rtol=1e-12)


def test_humid_air_is_lighter_by_its_vapour():
    """30 deg C, 100 %: the vapour pressure is 42.4 hPa; partial densities of dry air and vapour (18.015 g/mol)."""
    layers = humid_layers(1.0, temperature_offset=15.0)
    vapour = 611.2 * math.exp(17.67 * 30.0 / (30.0 + 243.5))
    assert vapour == pytest.approx(4243.0, rel=2e-3)  # tables: 42.43 hPa
    expected = (101_325.0 - vapour) / (R * 303.15) + vapour / (461.52 * 303.15)
    assert float(air_at_geopotential(layers, 0.0).density) == pytest.approx(expected, rel=1e-4)
    assert float(air_at_geopotential(layers, 15_000.0).temperature) == pytest.approx(216.65 + 15.0)


def test_humid_layers_are_in_hydrostatic_equilibrium_and_continuous():
    layers = humid_layers(0.8, temperature_offset=10.0)
    h = np.linspace(10.0, 19_990.0, 500)
    pressure = air_at_geopotential(layers, np.stack([h - 0.5, h + 0.5])).pressure
    density = air_at_geopotential(layers, h).density
    np.testing.assert_allclose(pressure[1] - pressure[0], -density * G, rtol=2e-4)  # kinks within a step of 1 m
    bases = layers[1:, 0]
    below, above = (air_at_geopotential(layers, bases + side) for side in (-1e-6, 1e-6))
    np.testing.assert_allclose(below.pressure, above.pressure, rtol=1e-8)
    np.testing.assert_allclose(below.temperature, above.temperature, rtol=1e-8)
    np.testing.assert_allclose(humid_layers(0.0)[:, :2][22:], STANDARD_LAYERS[1:, :2])


def test_a_sounding_of_the_standard_atmosphere_is_the_standard_atmosphere():
    h = np.arange(0.0, 12_001.0, 100.0)
    standard = air_at_geopotential(STANDARD_LAYERS, h)
    layers = measured_layers(h, standard.temperature, standard.pressure)
    between = np.linspace(0.0, 15_000.0, 1000)
    air, expected = (air_at_geopotential(table, between) for table in (layers, STANDARD_LAYERS))
    np.testing.assert_allclose(air.temperature, expected.temperature, rtol=1e-12)
    np.testing.assert_allclose(air.pressure, expected.pressure, rtol=6e-6)  # g lapse/(R T^2) (100 m)^2/8


def test_below_a_sounding_the_standard_lapse_continues_not_its_inversion():
    """Station at 500 m with an inversion of 6 K in 30 m: 17.3 deg C at sea level, and the pressure at rest."""
    h, T = np.array([500.0, 530.0, 1500.0]), np.array([287.15, 293.15, 287.0])
    p = 95_000.0 * np.exp(-G / R * np.append(0.0, np.cumsum(np.diff(h) / (0.5 * (T[:-1] + T[1:])))))
    layers = measured_layers(h, T, p)
    for altitudes in (np.array([0.0, 499.0]), np.array([-4000.0, -6000.0])):
        air = air_at_geopotential(layers, altitudes)
        np.testing.assert_allclose(air.temperature, 287.15 + 6.5e-3 * (500.0 - altitudes), rtol=1e-12)
        np.testing.assert_allclose(air.pressure, 95_000.0 * (air.temperature / 287.15) ** (G / (R * 6.5e-3)), rtol=1e-6)
    for altitude, temperature in ((500.0, 287.15), (530.0, 293.15)):
        assert float(air_at_geopotential(layers, altitude).temperature) == pytest.approx(temperature, rel=1e-14)
    np.testing.assert_allclose(air_at_geopotential(layers, 500.0 - 1e-7).pressure, p[0], rtol=1e-10)
    atmosphere = LayeredAtmosphere(jnp.asarray(padded_layers(layers, 8)))
    built = jax.jit(lambda altitude: atmosphere.at(altitude))
    for altitude in (-6000.0, 0.0, 515.0):
        np.testing.assert_allclose(built(altitude).density, air_in_layers(layers, altitude).density, rtol=1e-12)


def test_humidity_that_a_sounding_measures_above_saturation_is_saturation(tmp_path):
    path = tmp_path / "fog.csv"
    rows = "100,1005,4,{0}\n600,945,2,{0}\n3000,700,-8,40\n"
    for measured, humidity in ((99.0, 99.0), (102.0, 100.0)):
        path.write_text("altitude_m,pressure_hpa,temperature_c,relative_humidity_percent\n" + rows.format(measured))
        assert read_sounding(path).levels[0]["relative_humidity_percent"] == humidity
    path.write_text(path.read_text().replace("102", "110"))
    with pytest.raises(ScenarioError, match=r"line 2: arrived relative_humidity_percent = 110\.0; expected"):
        read_sounding(path)


def test_a_sounding_from_csv_gives_air_and_wind(tmp_path):
    (tmp_path / "sounding.csv").write_text(CSV)
    text = Path(SINGLE).read_text().replace("[timing]", '[atmosphere]\nsounding = "sounding.csv"\n\n[timing]')
    text = "\n".join(line for line in text.splitlines())
    (tmp_path / "mine.toml").write_text(text)
    if "[wind]" in text:
        with pytest.raises(ScenarioError, match="either a wind, or a sounding with winds"):
            anser.load(tmp_path / "mine.toml")
    scenario = anser.load(SINGLE).replace("wind", {}, "atmosphere", {"sounding": str(tmp_path / "sounding.csv")})
    level = air_in_layers(scenario.atmosphere.layers, 1500.0)
    vapour = 611.2 * math.exp(17.67 * 8.0 / (8.0 + 243.5))
    dry, moist = (85_400.0 - vapour) / (R * 289.15), vapour / (461.52 * 289.15)
    assert float(level.density) == pytest.approx(dry + moist, rel=1e-4)
    assert float(level.pressure) == pytest.approx(85_400.0)
    assert scenario.wind.velocity_m_s(1000.0)[0] == pytest.approx(
        0.5 * (6.0 * math.cos(math.radians(20.0)) + 9.0 * math.cos(math.radians(50.0)))
    )
    (tmp_path / "sounding.csv").unlink()  # the scenario holds the levels
    assert scenario.replace("wind.layers[0].speed_m_s", 4.0).atmosphere == scenario.atmosphere


def test_a_listing_of_a_radiosonde_is_read(tmp_path):
    path = tmp_path / "sounding.txt"
    path.write_text(LISTING)
    measured = read_sounding(path)
    assert [level["pressure_hpa"] for level in measured.levels] == [922.0, 850.0, 700.0]
    assert measured.levels[1]["altitude_m"] == pytest.approx(1500.0 * 6_356_766.0 / (6_356_766.0 - 1500.0))
    assert measured.levels[0]["relative_humidity_percent"] == 93.0
    assert [wind["speed_m_s"] for wind in measured.winds] == pytest.approx([8 * 1852 / 3600, 20 * 1852 / 3600])


@pytest.mark.parametrize(
    ("columns", "row"),
    [
        ("altitude_m,pressure_hpa,density_kg_m3", "{h},{p},{rho}"),
        ("altitude_m,temperature_k,density_kg_m3", "{h},{T},{rho}"),
        ("altitude_m,pressure_pa,temperature_k", "{h},{Pa},{T}"),
    ],
)
def test_two_of_temperature_pressure_and_density_define_the_air(tmp_path, columns, row):
    lines = [columns]
    for h in (0.0, 1000.0, 2000.0):
        air = air_in_layers(STANDARD_LAYERS, h)
        values = {"h": h, "p": air.pressure / 100, "Pa": air.pressure, "T": air.temperature, "rho": air.density}
        lines.append(row.format(**{key: repr(float(value)) for key, value in values.items()}))
    (tmp_path / "air.csv").write_text("\n".join(lines))
    for level in read_sounding(tmp_path / "air.csv").levels:
        air = air_in_layers(STANDARD_LAYERS, level["altitude_m"])
        assert level["pressure_hpa"] == pytest.approx(float(air.pressure) / 100)
        assert level["temperature_c"] == pytest.approx(float(air.temperature) - 273.15)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("altitude_m,pressure_hpa\n0,1000\n", "line 1: arrived columns of"),
        ("altitude_m,pressure_hpa,temperature_f\n", "a column 'temperature_f'"),
        (CSV.replace("500,959.5", "500,x"), "line 4: arrived 'x' as pressure_hpa"),
        (CSV.replace("1500,854", "400,854"), "line 5: arrived altitude 400 m after 500 m"),
        (CSV.replace("854,16", "nan,16"), "'nan' as pressure_hpa"),
        (CSV.replace("9,230", "9,"), "a wind without direction"),
        (
            CSV.replace("3000,713,6", "3000,613,6"),
            r"level\[3\].pressure_hpa: arrived 613 hPa at 3000 m; expected about 71",
        ),
        (CSV.replace("500,959.5,22", "500,959.5,290"), "line 4: arrived temperature_c = 290"),
        (CSV.replace("6,200", "6,400"), "line 4: arrived from_deg = 400"),
        (CSV.replace("hpa", "pa"), "line 3: arrived 10.05 hPa at 100 m; expected 501 to 2003 hPa"),
        (CSV.replace("24,18", "24,291"), "line 3: arrived a dew point of 291 deg C at 24 deg C"),
        (CSV.replace("24,18", "24,-400"), "line 3: arrived a dew point of -400 deg C"),
        (
            "altitude_m,pressure_hpa,temperature_c,wind_up_m_s\n\n100,1005,24,3\n3000,713,6,3\n",
            "line 3: arrived a vertical wind without a wind speed",
        ),
        (CSV.replace("500,959.5", '"500,959.5'), "line 7: arrived text that is no CSV"),
        ("altitude_m,pressure_hpa,temperature_c\n100,1000,15\n", "1 levels"),
        ("", "0 levels"),
    ],
)
def test_wrong_soundings_are_refused_with_the_place(tmp_path, text, message):
    path = tmp_path / "sounding.csv"
    path.write_text(text)
    with pytest.raises(ScenarioError, match=message):
        anser.load(SINGLE).replace("wind", {}, "atmosphere", {"sounding": str(path)})


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"sounding": "missing.csv"}, r'\n  atmosphere.sounding: arrived "missing.csv", no file of this name'),
        ({"sounding": {"level": []}}, "at least two"),
        ({"temperature_offset_k": 61.0}, "temperature_offset_k: arrived 61"),
        ({"sea_level_pressure_hpa": 29.92}, "sea_level_pressure_hpa: arrived 29.92"),
        ({"humidity": 3}, "humidity"),
    ],
)
def test_wrong_tables_are_refused(table, message):
    with pytest.raises(ScenarioError, match=message):
        with_air(**table)


def test_a_sounding_may_have_the_line_ends_of_any_computer(tmp_path):
    for name, line_end in (("unix", "\n"), ("dos", "\r\n"), ("mac", "\r")):
        (tmp_path / name).write_text(CSV.replace("\n", line_end), newline="")
    assert read_sounding(tmp_path / "mac") == read_sounding(tmp_path / "dos") == read_sounding(tmp_path / "unix")


def test_keys_that_a_sounding_excludes_and_starts_outside_it_are_refused(tmp_path):
    (tmp_path / "air.csv").write_text(CSV)
    scenario, path = anser.load(SINGLE).replace("wind", {}), str(tmp_path / "air.csv")
    with pytest.raises(ScenarioError, match="sea_level_pressure_hpa: arrived 1000; expected no such key"):
        scenario.replace("atmosphere", {"sounding": path, "sea_level_pressure_hpa": 1000})
    with pytest.raises(
        ScenarioError, match=r"start.altitude_m \(aircraft .*\): arrived 7000; expected an altitude within the sounding"
    ):
        scenario.replace("atmosphere", {"sounding": path}, "aircraft[0].start.altitude_m", 7000)


def test_an_airborne_goal_must_stay_within_the_sounding(tmp_path):
    (tmp_path / "air.csv").write_text(CSV)
    scenario = anser.load(SINGLE).replace("wind", {}, "atmosphere", {"sounding": str(tmp_path / "air.csv")})
    goal = {"name": scenario.goal[0].name, "kind": "airborne"}
    position = {"north_m": 0.0, "east_m": 0.0}

    def with_goal(**keys):
        return scenario.replace("goal", [{**goal, **keys}])

    with_goal(waypoints=[{"time_s": 0.0, **position, "altitude_m": 2000.0}])
    with pytest.raises(ScenarioError, match=r"goal\[0\].waypoints\[0\].altitude_m .*arrived 7000; expected .* 6000 m"):
        with_goal(waypoints=[{"time_s": 0.0, **position, "altitude_m": 7000.0}])
    with pytest.raises(ScenarioError, match=r"goal\[0\].climb_rate_m_s .*arrived 60, which brings it to"):
        with_goal(**position, altitude_m=2000.0, climb_rate_m_s=60.0)
    with pytest.raises(ScenarioError, match=r"goal\[0\].altitude_m .*arrived 6500; expected") as caught:
        with_goal(**position, altitude_m=6500.0, climb_rate_m_s=1.0)
    assert len(caught.value.problems) == 1


def test_airspeeds_of_other_forms_are_converted_in_the_air_of_the_scenario():
    scenario = anser.load(SINGLE).replace("aircraft[0].start.speed_m_s", None, "aircraft[0].start.mach", 0.45)
    hot = scenario.replace("atmosphere", {"temperature_offset_k": 30.0})
    ratio = hot.aircraft[0].start.airspeed_m_s / scenario.aircraft[0].start.airspeed_m_s
    temperature = 288.15 - 0.0065 * 1000.0 * 6_356_766.0 / 6_357_766.0
    assert ratio == pytest.approx(math.sqrt((temperature + 30.0) / temperature), rel=1e-9)


def test_a_scenario_without_the_table_keeps_its_hash():
    scenario = anser.load(SINGLE)
    assert (
        scenario.replace("atmosphere", {"temperature_offset_k": 5.0}).replace("atmosphere", None).hash == scenario.hash
    )


@pytest.mark.long
def test_a_flight_in_hot_air_has_the_altitudes_of_that_air():
    flight = anser.run(with_air(temperature_offset_k=20.0, sea_level_pressure_hpa=1000.0))
    row = flight.dataset.isel(time=0, aircraft=0)
    assert flight.dataset.attrs["qnh_hpa"] == pytest.approx(1000.0)
    air = air_in_layers(with_air(temperature_offset_k=20.0, sea_level_pressure_hpa=1000.0).atmosphere.layers, 1000.0)
    assert float(row.mach) == pytest.approx(float(row.airspeed_m_s) / float(air.speed_of_sound), rel=1e-9)
    standard = air_at_geopotential(STANDARD_LAYERS, float(row.density_altitude_m))
    assert float(standard.density) == pytest.approx(float(air.density), rel=1e-9)
    assert flight.summary["aircraft"][0]["miss_m"] < 1.0
