"""Aircraft files: what they make, what of them is refused in which words, how scenarios take them in."""

import math
import re
import tomllib
import types
from importlib import resources
from pathlib import Path
from typing import get_args

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import BaseModel

from anser.aircraft import (
    AirData,
    DerivativeAircraft,
    ElectricPropeller,
    FirstOrderActuators,
    JetEngine,
    NoEngine,
    PistonPropeller,
    SecondOrderActuators,
)
from anser.derivative_names import DERIVATIVES, place_of
from anser.scenario import ScenarioError, load, load_airframe, loads, read_airframe, validate
from anser.scenario.airframe_file import (
    AirframeFile,
    airframe_starter,
    known_types,
    library_file,
    reading,
    validate_airframe,
)
from anser.scenario.airframe_file.build import build_airframe
from anser.scenario.airframe_file.checking import compare
from anser.scenario.airframe_file.linting import lint
from anser.scenario.build import build_flight

AEROSONDE = resources.files("anser.aircraft").joinpath("data/aerosonde.toml").read_text(encoding="utf-8")
FLEET = """
format = 2
name = "one-uav"
timing.duration_s = 120
fleet.speed_m_s = 25.0
limits.climb_rate_max_m_s = 3.0
hold.radius_m = 300
[[goal]]
name = "boat"
kind = "surface"
north_m = 2000
east_m = 300
speed_m_s = 4
course_deg = 60
[[aircraft]]
name = "a"
AIRFRAME
goal = "boat"
start = {north_m = 0, east_m = 0, altitude_m = 200, speed_m_s = 25, course_deg = 0}
"""


def fleet(airframe, **changes):
    text = FLEET.replace("AIRFRAME", airframe)
    for old, new in changes.values():
        assert old in text
        text = text.replace(old, new)
    return text


def changed(*pairs, text=AEROSONDE):
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new, 1)
    return tomllib.loads(text)


def built(*pairs, text=AEROSONDE):
    return build_airframe(validate_airframe(changed(*pairs, text=text), "test"))


AIR = AirData(*(jnp.asarray(x) for x in (25.0, 0.1, 0.06, 1.1, 343.75, 0.07, 1000.0)))


def test_the_library_has_the_aerosonde_and_its_checks_agree():
    found = compare(library_file("aerosonde"))
    assert len(found) == 24
    assert all(one.agrees for one in found)
    assert max(abs(one.expected - one.obtained) for one in found) < 1e-12


def test_check_data_that_disagree_say_where():
    file = validate_airframe(changed(("Cm_q = -38.21", "Cm_q = -38.0")), "test")
    wrong = [one for one in compare(file) if not one.agrees]
    assert {one.place for one in wrong} == {"check.forces[1].moment_Nm[1]", "check.forces[2].moment_Nm[1]"}


def test_every_key_is_shown_in_the_starter_or_the_aerosonde():
    """Both stand in the reference; derivatives are named by a rule."""

    def keys_of(model):
        inner = (keys_of(child) for field in model.model_fields.values() for child in models_in(field.annotation))
        return set(model.model_fields).union(*inner)

    text = airframe_starter() + AEROSONDE
    missing = [key for key in keys_of(AirframeFile) - set(DERIVATIVES) if not re.search(rf"\b{key}\b", text)]
    assert missing == []


def models_in(annotation):
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in models_in(part)]


def test_the_starter_is_valid_flies_and_looks_right():
    file = validate_airframe(tomllib.loads(airframe_starter()), "starter")
    assert isinstance(build_airframe(file).engine, PistonPropeller)
    assert all(one.agrees for one in compare(file))
    assert lint(file) == ()


@pytest.mark.parametrize(
    ("pair", "path", "arrived", "expected"),
    [
        (("CL_alpha = 5.61", "CL_alpa = 5.61"), "aerodynamics.CL_alpa", "the unknown key", 'perhaps "CL_alpha"'),
        (("CL_q = 7.95", "Cm_alphadot = 7.95"), "aerodynamics.Cm_alphadot", "the unknown key", "added to Cm_q"),
        (("mass_kg = 11.0", 'mass_kg = "11"'), "mass.mass_kg", '"11"', "a number above 0"),
        (("mass_kg = 11.0", "mass_kg = nan"), "mass.mass_kg", "nan", "a number above 0"),
        (("Jxz_kg_m2 = 0.1204", "Jxz_kg_m2 = 1.5"), "mass.Jxz_kg_m2", "1.5", "positive definite"),
        (("limit_deg = 30.0\n", ""), "surface[0].limit_deg", "nothing", "either limit_deg, or lower_deg and upper_deg"),
        (("lag_s = 0.05\n", ""), "surface[0].lag_s", "nothing", "either lag_s, or frequency_rad_s and damping"),
        (('name = "aileron"', 'name = "elevator"'), "surface[1].name", "already the name of surface[0]", "its own"),
        (('name = "aileron"', 'name = "alpha"'), "surface[1].name", '"alpha"', "another name than"),
        (("alpha_deg = [-15.0, 25.0]", "alpha_deg = [25.0, -15.0]"), "validity.alpha_deg", "[25, -15]", "lesser"),
        (("airspeed_m_s = [13.0, 40.0]", "airspeed_m_s = 13.0"), "validity.airspeed_m_s", "13.0", "a list of two"),
        (("[engine.electric_propeller]", "[engine.electric_propellor]"), "engine.electric_propellor", "unknown", "elec"),
        (("= [0.09357,", "= [0.0,"), "engine.electric_propeller.thrust_coefficients", "0", "at rest"),
        (("{ CD0 = 0.0 }", "{ CDO = 0.0 }"), "check.forces[0].instead.CDO", "the unknown key", "a derivative"),
        (("{ elevator =", "{ elevater ="), "check.forces[0].surfaces_rad", '"elevater"', "elevator, aileron, rudder"),
        (("format = 1", "format = 7"), "format", "7", "1, the format"),
        (("source = ", "sauce = "), "sauce", "the unknown key", 'perhaps "source"'),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_with_its_place(pair, path, arrived, expected):
    with pytest.raises(ScenarioError) as caught:
        validate_airframe(changed(pair), "uav.toml")
    first = next(one for one in caught.value.problems if one.path == path)
    assert arrived in first.arrived
    assert expected in first.expected
    assert str(caught.value).startswith("uav.toml: ")


TABLE = """
[[table]]
replaces = "Cm"
over = ["alpha", "elevator"]
breakpoints_deg = [[-10, 0, 10, 30], [-30, 0, 30]]
values = [[1, 0.5, 0], [0.5, 0, -0.5], [0, -0.5, -1], [-1, -1.5, -2]]
"""


def test_a_table_takes_the_place_of_a_coefficient():
    airframe = built(("Cm0 = 0.0135\nCm_alpha = -2.74\n", ""), ("Cm = -0.99\n", ""), text=AEROSONDE + TABLE)
    for alpha, elevator, expected in ((0.0, 0.0, 0.0), (5.0, 0.0, -0.25), (10.0, 15.0, -0.75), (40.0, -40.0, -1.0)):
        air = AirData(*(getattr(AIR, name) for name in ("V",)), jnp.deg2rad(alpha), *(jnp.zeros(()),), AIR.density,
                      AIR.qbar, AIR.mach, AIR.altitude)  # fmt: skip
        surfaces = jnp.array([jnp.deg2rad(elevator), 0.0, 0.0])
        assert float(airframe.coefficients(air, jnp.zeros(3), surfaces)[4]) == pytest.approx(expected, abs=1e-12)


def test_a_derivative_beside_the_table_that_replaces_it_is_refused():
    with pytest.raises(ScenarioError) as caught:
        built(text=AEROSONDE + TABLE)
    assert {one.path for one in caught.value.problems} == {
        "aerodynamics.Cm0", "aerodynamics.Cm_alpha", "surface[0].Cm"
    }  # fmt: skip


@pytest.mark.parametrize(
    ("pair", "path"),
    [
        (('"Cm"', '"Cx"'), "table[0].replaces"),
        (('"elevator"]', '"flap"]'), "table[0].over[1]"),
        (("[0, -0.5, -1]", "[0, -0.5]"), "table[0].values[2]"),
        (("[0, -0.5, -1]", '[0, -0.5, "x"]'), "table[0].values[2][2]"),
        (("[-10, 0, 10, 30]", "[-10, 10, 0, 30]"), "table[0].breakpoints_deg[0][2]"),
    ],
)
def test_what_is_wrong_with_a_table(pair, path):
    bare = changed(("Cm0 = 0.0135\nCm_alpha = -2.74\n", ""), ("Cm = -0.99\n", ""), pair, text=AEROSONDE + TABLE)
    with pytest.raises(ScenarioError) as caught:
        validate_airframe(bare, "test")
    assert path in [one.path for one in caught.value.problems]


def test_derivatives_per_degree_are_those_per_rad():
    text = AEROSONDE
    for name, value in (
        ("CL_alpha", 5.61),
        ("Cm_alpha", -2.74),
        ("CY_beta", -0.98),
        ("Cl_beta", -0.13),
        ("Cn_beta", 0.073),
    ):
        text = text.replace(f"{name} = {value}\n", f"{name} = {math.radians(value)!r}\n")
    surfaces = {"CL = 0.13": 0.13, "CD = 0.0135": 0.0135, "Cm = -0.99": -0.99, "CY = 0.075": 0.075, "Cl = 0.17": 0.17,
                "Cn = -0.011": -0.011, "CY = 0.19": 0.19, "Cl = 0.0024": 0.0024, "Cn = -0.069": -0.069}  # fmt: skip
    for line, value in surfaces.items():
        text = text.replace(f"\n{line}\n", f"\n{line[:2]} = {math.radians(value)!r}\n")
    degrees = built(("[aerodynamics]\n", '[aerodynamics]\nper = "deg"\n'), text=text)
    np.testing.assert_allclose(degrees.derivatives, built().derivatives, rtol=1e-14)


def test_kinds_of_actuators_and_engines():
    assert isinstance(built().actuators, FirstOrderActuators)
    second = built(*[("lag_s = 0.05", "frequency_rad_s = 40.0\ndamping = 0.7")] * 3)
    assert isinstance(second.actuators, SecondOrderActuators)
    with pytest.raises(ScenarioError, match="all actuators are of one order"):
        built(("lag_s = 0.05", "frequency_rad_s = 40.0\ndamping = 0.7"))
    assert isinstance(built().engine, ElectricPropeller)
    head, _, rest = AEROSONDE.partition("[engine.electric_propeller]")
    rest = rest[rest.index("[validity]") : rest.index("[[check.forces]]")]
    assert isinstance(built(text=head + rest).engine, NoEngine)
    jet = "[engine.jet]\nidle_N = [[0, 0], [0, 0]]\nfull_N = [[90, 80], [70, 60]]\naltitude_m = [0, 1000]\nmach = [0, 0.2]\n"
    engine = built(text=head + jet + "lag_s = 1.0\n" + rest).engine
    assert isinstance(engine, JetEngine)
    assert float(engine.propulsion(100.0, AIR).force_b[0]) == pytest.approx(66.5)
    constant = built(text=head + "[engine.jet]\nfull_N = 50\nlag_s = 1\n" + rest).engine
    assert float(constant.propulsion(50.0, AIR).force_b[0]) == pytest.approx(25.0)


ELEVONS = """
[[surface]]
name = "SIDE_elevon"
lower_deg = -25.0
upper_deg = 20.0
rate_limit_deg_s = 200.0
lag_s = 0.05
CL = 0.07
Cm = -0.5
Cl = SIGN0.1
"""


def test_elevons_are_as_good_as_any_surfaces():
    head, tail = AEROSONDE.index("[[surface]]"), AEROSONDE.index("[engine.electric")
    pair = ELEVONS.replace("SIDE", "left").replace("SIGN", "") + ELEVONS.replace("SIDE", "right").replace("SIGN", "-")
    text = AEROSONDE[:head] + pair + AEROSONDE[tail:].partition("# The source's own checks")[0]
    airframe = built(text=text)
    assert airframe.actuators.names == ("left_elevon", "right_elevon")
    assert not airframe.actuators.controls_yaw
    assert float(airframe.derivatives[place_of("Cl_right_elevon", airframe.actuators.names)]) == -0.1
    np.testing.assert_allclose(airframe.actuators.lower, np.radians(-25.0))
    roll, _, _ = (
        airframe.aerodynamics(AIR, jnp.zeros(3), jnp.array([0.1, -0.1])).moment_b
        - airframe.aerodynamics(AIR, jnp.zeros(3), jnp.zeros(2)).moment_b
    )
    assert float(roll) > 0.0


def test_files_of_one_content_are_one_airframe():
    """So that aircraft of a fleet that share a file are of one kind, compiled once."""
    assert built() is load_airframe("aerosonde")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "my-uav.toml").write_text(AEROSONDE, encoding="utf-8")
    (tmp_path / "fleet.toml").write_text(fleet('airframe = "my-uav.toml"'), encoding="utf-8")
    return tmp_path


def test_a_scenario_names_a_file_seen_from_itself(folder, monkeypatch):
    monkeypatch.chdir("/")
    scenario = load(folder / "fleet.toml")
    assert scenario.aircraft[0].airframe == read_airframe(folder / "my-uav.toml")
    kind = build_flight(scenario).kinds[0]
    assert isinstance(kind.vehicles.at(0).airframe, DerivativeAircraft)


def test_the_hash_knows_the_content_of_the_file(folder):
    before = load(folder / "fleet.toml")
    (folder / "my-uav.toml").write_text(AEROSONDE.replace("mass_kg = 11.0", "mass_kg = 11.5"), encoding="utf-8")
    after = load(folder / "fleet.toml")
    assert before.hash != after.hash
    assert validate(before.model_dump(mode="json")).hash == before.hash  # a record flies without the file
    assert before.replace("fleet.speed_m_s", 24.0).aircraft[0].airframe == before.aircraft[0].airframe
    heavier = before.replace("aircraft[0].airframe.mass.mass_kg", 11.5)  # what a study varies
    assert heavier.hash == after.hash


def test_what_is_wrong_in_the_file_is_told_of_the_file(folder):
    (folder / "my-uav.toml").write_text(AEROSONDE.replace("CL_alpha", "CL_alfa"), encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"my-uav\.toml: 1 problem\n  line 24, aerodynamics\.CL_alfa"):
        load(folder / "fleet.toml")
    (folder / "my-uav.toml").unlink()
    (folder / "my-uaf.toml").touch()
    with pytest.raises(ScenarioError, match=r"expected the path of an aircraft file, perhaps .*my-uaf"):
        load(folder / "fleet.toml")


@pytest.mark.parametrize(
    ("airframe", "path", "words"),
    [
        (
            'airframe = "my-uav.toml"\ntype = "f16"',
            "aircraft[0].airframe",
            "either airframe, the path of a file, or type",
        ),
        ('airframe = "my-uav.txt"', "", "a name that ends with"),
        ('type = "aerosond"', "aircraft[0].type", 'perhaps "aerosonde"'),
        ('type = "aerosonde"\nvariant = "s119"', "aircraft[0].variant", "F-16 alone"),
        ('type = "aerosonde"\nx_cg_over_c = 0.3', "aircraft[0].x_cg_over_c", "F-16 alone"),
        ('type = "aerosonde"\ndeviation.coefficients.CZ0 = 1.1', "aircraft[0].deviation.coefficients.CZ0", "CL_alpha"),
        ('type = "f16"\ndeviation.coefficients.CL_alpha = 1.1', "aircraft[0].deviation.coefficients.CL_alpha", "CZ0"),
    ],
)
def test_what_a_scenario_refuses(airframe, path, words):
    with pytest.raises(ScenarioError) as caught:
        loads(fleet(airframe))
    told = "\n".join(map(str, caught.value.problems))
    assert words in told or words in str(caught.value.problems[0].arrived)
    assert path in [one.path for one in caught.value.problems]


@pytest.mark.parametrize(("speed", "refused"), [(12.0, True), (13.0, False), (40.0, False), (41.0, True)])
def test_a_start_outside_the_aircraft_s_airspeeds_names_them(speed, refused):
    text = fleet('type = "aerosonde"', start=("speed_m_s = 25, c", f"speed_m_s = {speed}, c"))
    if not refused:
        assert loads(text).aircraft[0].start.speed_m_s == speed
        return
    with pytest.raises(ScenarioError, match="from 13 to 40 m/s, where the data of aerosonde hold"):
        loads(text)


def test_an_f16_still_starts_at_30_m_s_or_faster():
    text = fleet('type = "f16"', start=("speed_m_s = 25, c", "speed_m_s = 29, c"))
    with pytest.raises(ScenarioError, match="from 30 to 340 m/s, where the data of f16 hold"):
        loads(text)


def test_limits_that_are_left_out_are_the_aircraft_s():
    scenario = loads(fleet('type = "aerosonde"'))
    assert (scenario.limits.speed_min_m_s, scenario.limits.speed_max_m_s) == (13.0, 40.0)
    assert (scenario.limits.alpha_min_deg, scenario.limits.alpha_max_deg) == (-5.0, 25.0)
    assert "speed_min_m_s" not in scenario.limits.model_fields_set
    with pytest.raises(ScenarioError, match=r"limits.speed_max_m_s: arrived 60; expected at most 40 m/s"):
        loads(fleet('type = "aerosonde"', limits=("limits.climb", "limits.speed_max_m_s = 60\nlimits.climb")))


def test_a_deviation_flies_another_aircraft_than_its_autopilot_knows():
    more = 'type = "aerosonde"\ndeviation = {mass = 1.1, thrust = 0.9, cg_shift = 0.05, coefficients = {Cm_alpha = 0.8, Cm_elevator = 0.7}}'
    airframe = build_flight(loads(fleet(more))).kinds[0].vehicles.at(0).airframe
    assert float(airframe.mass_properties.mass) == pytest.approx(12.1)
    assert float(airframe.engine.thrust_factor) == pytest.approx(0.9)
    places = [place_of(name, airframe.actuators.names) for name in ("Cm_alpha", "Cm_elevator", "Cm_q")]
    assert [float(airframe.derivatives[place]) for place in places] == pytest.approx([-2.74 * 0.8, -0.99 * 0.7, -38.21])


class _Point:
    """An entry point as an installed package would declare it."""

    name, value = "glider", "my_package:glider"

    def __init__(self, made=None, version=None):
        self.made = made
        self.dist = None if version is None else types.SimpleNamespace(name="my-package", version=version)

    def load(self):
        return lambda: self.made


@pytest.fixture
def offering(monkeypatch):
    """Let the installed packages be those that offer these entry points."""

    def offer(*points):
        monkeypatch.setattr(reading.importlib.metadata, "entry_points", lambda group: points)
        reading.entry_points.cache_clear()

    yield offer
    monkeypatch.undo()
    reading.entry_points.cache_clear()


_GLIDER_LIMITS = ("limits.climb", "limits.speed_min_m_s = 14\nlimits.speed_max_m_s = 39\nlimits.climb")


def test_an_airframe_by_entry_point(offering):
    mine = built()
    offering(_Point(mine))
    assert "glider" in known_types()
    assert load_airframe("glider") is mine
    scenario = loads(fleet('type = "glider"', limits=_GLIDER_LIMITS))
    assert scenario.aircraft[0].type == "glider"
    with pytest.raises(ScenarioError, match="anser knows no coefficients to vary"):
        loads(fleet('type = "glider"\ndeviation.mass = 1.1'))


def test_the_hash_knows_which_code_an_entry_point_is(offering):
    """Of another version of the package, or of another place in it, the same text is another scenario."""
    text, hashes = fleet('type = "glider"', limits=_GLIDER_LIMITS), []
    for version, value in (("1.0", "my_package:glider"), ("1.1", "my_package:glider"), ("1.0", "my_package:kite")):
        point = _Point(version=version)
        point.value = value
        offering(point)
        hashes.append(loads(text).hash)
        assert loads(text + "\n# a comment\n").hash == hashes[-1]
    assert len(set(hashes)) == 3
    offering(_Point(version="1.0"))
    assert loads(text).hash == hashes[0]


def test_the_hash_of_the_library_s_own_does_not_depend_on_what_is_installed(offering):
    text = fleet('type = "aerosonde"')
    offering()
    before = loads(text).hash
    offering(_Point(version="1.0"))
    assert loads(text).hash == before


@pytest.mark.parametrize(
    ("pair", "place", "words"),
    [
        (("Cm_q = -38.21", "Cm_q = 38.21"), "aerodynamics.Cm_q", "damping is negative"),
        (("Cl_p = -0.51", "Cl_p = 0.51"), "aerodynamics.Cl_p", "damping is negative"),
        (("Cm_alpha = -2.74", "Cm_alpha = 2.74"), "aerodynamics.Cm_alpha", "unstable in pitch"),
        (("Cn_beta = 0.073", "Cn_beta = -0.073"), "aerodynamics.Cn_beta", "turns away from the flow"),
        (("Cl_r = 0.25\n", "Cl_r = 0.25\nCm_beta = 0.1\n"), "aerodynamics.Cm_beta", "mirror image"),
        (("CL_alpha = 5.61", "CL_alpha = 0.098"), "aerodynamics.CL_alpha", "is it given per deg, not per rad?"),
        (("limit_deg = 30.0", "limit_deg = 0.52"), "surface[0].limit_deg", "is it in rad?"),
        (("rate_limit_deg_s = 200.0", "rate_limit_deg_s = 3.5"), "surface[0].rate_limit_deg_s", "is it in rad/s?"),
        (("beta_deg = [-25.0, 25.0]", "beta_deg = [-0.4, 0.4]"), "validity.beta_deg", "are these rad?"),
        (("Jzz_kg_m2 = 1.759", "Jzz_kg_m2 = 2.759"), "mass.Jzz_kg_m2", "which no body has"),
        (("mass_kg = 11.0", "mass_kg = 1100.0"), "validity.airspeed_m_s", "at none of these airspeeds"),
        (("airspeed_m_s = [13.0, 40.0]", "airspeed_m_s = [8.0, 40.0]"), "validity.airspeed_m_s[0]", "only from about"),
        (("voltage_V = 44.4", "voltage_V = 11.1"), "engine", "at no valid airspeed"),
        (("mean_chord_m = 0.18994", "mean_chord_m = 0.6"), "geometry.mean_chord_m", "area over span"),
    ],
)  # fmt: skip
def test_the_linter_finds_what_was_put_there(pair, place, words):
    assert lint(library_file("aerosonde")) == ()
    found = lint(validate_airframe(changed(pair), "test"))
    assert [words for one in found if one.place == place and words in one.text] == [words]


def table_of(values, points=tuple(range(-30, 31, 5)), over="beta", name="Cl"):
    return f'\n[[table]]\nreplaces = "{name}"\nover = ["{over}"]\nbreakpoints_deg = [{list(points)}]\nvalues = {list(values)}\n'


def with_rolling(values, **more):
    pairs = [("Cl_beta = -0.13\n", "")]
    return validate_airframe(changed(*pairs, text=AEROSONDE + table_of(values, **more)), "test")


@given(where=st.integers(1, 11), size=st.floats(0.02, 0.2), sign=st.sampled_from([-1, 1]))
@settings(max_examples=10, deadline=None)
@pytest.mark.long
def test_the_linter_finds_a_point_out_of_line(where, size, sign):
    points = np.arange(-30, 31, 5)
    smooth = -0.13 * np.radians(points) + 0.02 * np.radians(points) ** 3
    assert not [one for one in lint(with_rolling(smooth.tolist())) if one.place.startswith("table")]
    wrong = smooth.copy()
    wrong[where] += sign * size
    found = {one.place for one in lint(with_rolling(wrong.tolist())) if one.place.startswith("table[0].values")}
    assert f"table[0].values[{where}] (Cl)" in found
    assert found <= {f"table[0].values[{k}] (Cl)" for k in (where, 12 - where)}


def test_the_linter_finds_gaps_and_ends_inside_the_limits():
    points = (-20, -15, -10, -5, 0, 5, 10, 40)
    values = (-0.002 * np.array(points)).tolist()
    texts = [one.text for one in lint(with_rolling(values, points=points)) if one.place.startswith("table")]
    assert any("a gap in beta from 10 to 40 deg" in text for text in texts)
    assert any("beta begins at -20 deg, but the data are said to hold from -25 deg" in text for text in texts)
    assert not any("beta ends" in text for text in texts)
