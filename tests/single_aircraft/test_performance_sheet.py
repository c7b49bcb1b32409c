"""Performance sheets: a parabolic polar against the textbook's formulas, the F-16 against trims and by hand."""

import functools
import json
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

import anser
from anser.constants import STANDARD_GRAVITY_M_S2
from anser.single_aircraft import performance
from anser.steady.trim import TRIM_OBSTACLES


@functools.cache
def sheet():
    return anser.aircraft("f16").performance(1000.0)


@pytest.mark.long
def test_the_command_prints_the_limits_of_a_coarse_sheet(anser, monkeypatch):
    """With grids of a quarter of the size: the stall, the level flight and the turn end at the limits of the F-16."""
    for name, value in (("_SPEEDS", 11), ("_ALTITUDES", 3), ("_TURN_PASSES", 2), ("_CHUNK", 16)):
        monkeypatch.setattr(performance, name, value)
    code, printed, _ = anser("aircraft", "show", "f16", "--performance", "--altitude-m", 3000, "--json")
    assert code == 0
    figures = {figure["name"]: figure for figure in json.loads(printed)["figures"]}
    least, greatest = (figures[f"{end} level airspeed"]["value"] for end in ("least", "greatest"))
    assert 40.0 < least < 70.0 < 250.0 < greatest < 400.0
    assert figures["least level airspeed"]["limit"] == "angle of attack: end of the data"
    heavy = figures["least level airspeed, mass 120%"]["value"]
    assert 1.05 < heavy / least < np.sqrt(1.2) + 0.02
    assert figures["greatest sustained turn rate"]["limit"].endswith("full power")


@pytest.mark.long
def test_the_f16_excess_power_is_that_of_its_trim_by_hand():
    f16 = anser.aircraft("f16")
    data = sheet().dataset
    row, column = 1, 24
    V, h = float(data.airspeed[column]), float(data.altitude[row])
    trim = f16.trim(V, h)
    quantities = {name: value for name, value, _ in trim.quantities}
    thrust_needed, alpha = 1000.0 * quantities["thrust"], np.radians(quantities["angle of attack"])
    mach = quantities["Mach number"]
    tables = _thrust_at_full_power(h, mach)
    mass = 9295.44
    by_hand = V * (tables - thrust_needed) * np.cos(alpha) / (mass * STANDARD_GRAVITY_M_S2)
    assert float(data.specific_excess_power_m_s[row, column]) == pytest.approx(by_hand, rel=1e-6)


def _thrust_at_full_power(altitude_m, mach):
    """Thrust at full power, N: bilinear in the textbook's table (lbf over ft and Mach number)."""
    from support import stevens_lewis as textbook

    return textbook.thrust(100.0, altitude_m / textbook.FOOT_M, mach) * 4.4482216152605


@pytest.mark.long
def test_the_f16_level_speeds_are_the_ends_of_its_trims():
    f16 = anser.aircraft("f16")
    least, greatest = sheet()["least level airspeed"], sheet()["greatest level airspeed"]
    assert f16.trim(least.value * 1.002, 1000.0).diagnosis is None
    below = f16.trim(least.value * 0.995, 1000.0).diagnosis
    assert below is not None
    assert "angle of attack" in below
    assert least.limit == "angle of attack: end of the data"
    assert f16.trim(greatest.value * 0.999, 1000.0).diagnosis is None
    assert f16.trim(greatest.value * 1.005, 1000.0).diagnosis is not None
    heavy = sheet()["least level airspeed, mass 120%"].value
    assert 1.05 < heavy / least.value < np.sqrt(1.2) + 0.01


@pytest.mark.long
def test_the_sustained_turn_is_at_the_end_of_the_power():
    f16 = anser.aircraft("f16")
    turn = sheet()["greatest sustained turn rate"]
    speed = float(turn.limit.split()[1])
    assert f16.trim(speed, 1000.0, 0.0, 0.995 * turn.value).diagnosis is None
    tighter = f16.trim(speed, 1000.0, 0.0, 1.01 * turn.value).diagnosis
    assert tighter is not None
    assert "engine power" in tighter
    assert turn.limit.endswith("full power")


def test_a_jump_of_the_trim_is_the_stall_and_a_passed_limit_is_named():
    """Beyond the greatest lift the balance jumps to one far behind the stall, which is beyond limits of its own."""
    obstacles = np.zeros((4, 7), bool)
    obstacles[0, [TRIM_OBSTACLES.index(name) for name in ("thrust_max", "surfaces", "alpha")]] = True
    obstacles[3, TRIM_OBSTACLES.index("thrust_max")] = True
    trim = SimpleNamespace(alpha=np.radians([42.4, 12.6, 11.7, 2.0]))
    flights = SimpleNamespace(trims=SimpleNamespace(trim=trim, obstacles=obstacles))
    assert performance._limit_beyond(flights, 1, 0) == "greatest lift (stall)"
    trim.alpha[0] = np.radians(14.1)
    assert performance._limit_beyond(flights, 1, 0).startswith("full power; stop of a surface; angle of attack")
    trim.alpha[3] = trim.alpha[2]
    assert performance._limit_beyond(flights, 2, 3) == "full power"


def test_level_flight_without_a_turn_has_no_turn_figures():
    """A few metres below the absolute ceiling, straight flight alone remains at one airspeed."""

    def fly(speed, turn_rate=0.0):
        straight = (np.asarray(turn_rate) == 0.0) & (np.asarray(speed) == 30.0)
        obstacles = np.repeat(~straight.ravel()[:, None], len(TRIM_OBSTACLES), axis=1)
        return SimpleNamespace(trims=SimpleNamespace(obstacles=obstacles))

    (turn,) = performance._turn_figures(fly, np.array([20.0, 30.0, 40.0]), STANDARD_GRAVITY_M_S2)
    assert np.isnan(turn.value)
    assert turn.limit == "no level turn"


@pytest.mark.parametrize(("slow_is_flyable", "ratio"), [(False, 20.0), (True, np.nan)])
def test_glides_count_that_can_be_flown(slow_is_flyable, ratio):
    """At the least airspeed the idle thrust exceeds the drag; the best glide is at 40 m/s."""
    obstacles = np.zeros((4, len(TRIM_OBSTACLES)), dtype=bool)
    obstacles[0, TRIM_OBSTACLES.index("alpha")] = not slow_is_flyable
    angles = -np.arctan([-0.05, 0.06, 0.05, 0.06])
    flights = SimpleNamespace(trims=SimpleNamespace(obstacles=obstacles), path_angle=angles)
    speeds = np.array([20.0, 30.0, 40.0, 50.0])
    glide, *_ = performance._path_figures(lambda **_: flights, speeds, 0.0, "best glide ratio", "1")
    np.testing.assert_allclose(glide.value, ratio, rtol=1e-12)


def test_the_ceiling_is_searched_from_the_lowest_altitude_with_data():
    rows = np.array([np.nan, np.nan, 4.0, 2.0, -2.0])[:, None]
    data = xr.Dataset(
        {"specific_excess_power_m_s": (("altitude", "airspeed"), rows)}, {"altitude": 1000.0 * np.arange(5)}
    )
    assert performance._ceiling(data, 0.0) == (3500.0, "m", "full power")
    assert performance._ceiling(data, 5.0)[2] == "no climb at 2000 m"
    assert performance._ceiling(data.isel(altitude=slice(2, None)), 5.0)[2] == "no climb at sea level"


@pytest.mark.long
def test_a_parabolic_polar_has_the_glide_and_the_speeds_of_the_textbook(tmp_path):
    """Best glide 1 / (2 sqrt(CD0 k)) at CL = sqrt(CD0 / k); [Anderson, Aircraft Performance and Design, section 5.4]."""
    model, numbers = _glider(tmp_path)
    glider_sheet = model.performance(0.0)
    best = 1.0 / (2.0 * np.sqrt(numbers["CD0"] * numbers["k"]))
    CL = np.sqrt(numbers["CD0"] / numbers["k"])
    # In a glide the lift carries the cosine of the path angle.
    weight = numbers["mass"] * STANDARD_GRAVITY_M_S2 * np.cos(np.arctan(1.0 / best))
    speed = np.sqrt(2.0 * weight / (1.225 * numbers["S"] * CL))
    assert glider_sheet["best glide ratio"].value == pytest.approx(best, rel=2e-3)
    assert glider_sheet["airspeed of the best glide"].value == pytest.approx(speed, rel=2e-2)  # a flat optimum
    assert np.isnan(glider_sheet["best climb rate"].value) or glider_sheet["best climb rate"].value < 0.0


def _glider(folder):
    numbers = {"mass": 300.0, "S": 11.0, "b": 15.0, "CD0": 0.012, "oswald": 0.9}
    numbers["k"] = numbers["S"] / (np.pi * numbers["oswald"] * numbers["b"] ** 2)
    text = f"""
format = 1
name = "polar"
description = "Glider with a parabolic polar"
source = "formulas of the textbook"
[mass]
mass_kg = {numbers["mass"]}
Jxx_kg_m2 = 1000.0
Jyy_kg_m2 = 800.0
Jzz_kg_m2 = 1700.0
[geometry]
span_m = {numbers["b"]}
wing_area_m2 = {numbers["S"]}
mean_chord_m = 0.75
[aerodynamics]
CL0 = 0.2
CL_alpha = 5.5
CD0 = {numbers["CD0"]}
oswald = {numbers["oswald"]}
Cm_alpha = -0.8
Cm_q = -12.0
CY_beta = -0.3
Cl_beta = -0.05
Cl_p = -0.5
Cn_beta = 0.05
Cn_r = -0.1
[[surface]]
name = "elevator"
limit_deg = 25.0
rate_limit_deg_s = 60.0
lag_s = 0.1
Cm = -1.2
[[surface]]
name = "aileron"
limit_deg = 20.0
rate_limit_deg_s = 60.0
lag_s = 0.1
Cl = 0.2
[[surface]]
name = "rudder"
limit_deg = 20.0
rate_limit_deg_s = 60.0
lag_s = 0.1
Cn = -0.05
[validity]
airspeed_m_s = [18.0, 60.0]
alpha_deg = [-8.0, 12.0]
beta_deg = [-15.0, 15.0]
"""
    path = folder / "polar.toml"
    path.write_text(text, encoding="utf-8")
    return anser.aircraft(path), numbers


@pytest.mark.long
def test_an_airspeed_at_the_end_of_the_data_is_named_so():
    """At 1,500 m and nine tenths of its mass the trainer would stall below the least airspeed of its data."""
    sheet = anser.aircraft("scenarios/own-aircraft/trainer.toml").performance(altitude_m=1500.0)
    (figure,) = (figure for figure in sheet.figures if figure.name == "least level airspeed, mass 90%")
    assert (figure.value, figure.limit) == (pytest.approx(31.0, rel=1e-6), "end of the data (airspeed)")
