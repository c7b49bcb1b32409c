"""Aircraft files that refer to DAVE-ML files: airframes, hash, and refusals."""

import tomllib
from importlib import resources
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft import DaveMlAircraft, JetEngine
from anser.aircraft.air_data import air_data
from anser.aircraft.dave_ml_aircraft import DaveMlEngine
from anser.aircraft_files import build_airframe, load_airframe, load_f16, read_airframe
from anser.aircraft_files.build import disperse_airframe
from anser.aircraft_files.check_data import compare_check_data
from anser.aircraft_files.findings import collect_findings
from anser.aircraft_files.schema import DaveMlFile
from anser.aircraft_files.sources import library_file, validate_airframe
from anser.config import ScenarioError
from anser.environment import StandardAtmosphere
from anser.scenario import build_flight, load, loads, validate

NASA = resources.files("anser.dave_ml").joinpath("nasa")
TRAINER = Path(__file__).parents[2] / "scenarios" / "own-aircraft" / "trainer.toml"
FILES = ("F16_aero.dml", "F16_inertia.dml", "F16_prop.dml")
TEXT = NASA.joinpath("nasa-f16.toml").read_text(encoding="utf-8")
FLEET = """
format = 2
name = "one-f16"
timing.duration_s = 90
fleet.speed_m_s = 150.0
[[goal]]
name = "ship"
kind = "surface"
north_m = 8000
east_m = 500
speed_m_s = 8
course_deg = 60
[[aircraft]]
name = "a"
airframe = "my-f16.toml"
goal = "ship"
start = { north_m = 0, east_m = 0, altitude_m = 1000, speed_m_s = 150, course_deg = 10 }
"""


@pytest.fixture
def folder(tmp_path):
    for name in FILES:
        (tmp_path / name).write_bytes(NASA.joinpath(name).read_bytes())
    (tmp_path / "my-f16.toml").write_text(TEXT, encoding="utf-8")
    (tmp_path / "one.toml").write_text(FLEET, encoding="utf-8")
    return tmp_path


def changed(folder, *pairs):
    text = TEXT
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    path = folder / "changed.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_nasa_files_equal_the_built_in_variant_and_pass_their_shots():
    """The suspect point, Cnr at 40 deg, is printed with this value in the textbook, too."""
    file = library_file("nasa-f16")
    airframe, built_in = load_airframe("nasa-f16"), load_f16("s119")
    assert isinstance(airframe, DaveMlAircraft)
    assert isinstance(airframe.engine, DaveMlEngine)
    for name in ("span", "wing_area", "mean_chord"):
        np.testing.assert_allclose(getattr(airframe, name), getattr(built_in, name), rtol=1e-12)
    for x, y in zip(jax.tree.leaves(airframe.mass_properties), jax.tree.leaves(built_in.mass_properties), strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-12, atol=1e-9)
    compared = compare_check_data(file)
    assert len(compared) > 1000
    assert all(x.passed for x in compared)
    assert ["Cnr_table_def" in x.location for x in collect_findings(file)] == [True]


def test_a_scenario_contains_the_texts_and_hashes_them(folder):
    scenario = load(folder / "one.toml")
    file = scenario.aircraft[0].airframe
    assert isinstance(file, DaveMlFile)
    reread = validate(scenario.model_dump(mode="json", exclude_unset=True), "again")
    assert reread.hash == scenario.hash
    assert build_airframe(reread.aircraft[0].airframe) is build_airframe(file)
    inertia = folder / "F16_inertia.dml"
    inertia.write_text(inertia.read_text(encoding="utf-8").replace("637.1595", "637.2"), encoding="utf-8")
    heavier = load(folder / "one.toml")
    assert heavier.hash != scenario.hash
    mass = [float(build_airframe(s.aircraft[0].airframe).mass_properties.mass) for s in (scenario, heavier)]
    assert mass[1] > mass[0]


def test_defaults_mass_and_engine_of_the_aircraft_file_are_used(folder):
    forward = read_airframe(changed(folder, ("vrsPositionOfCM = 25.0", "vrsPositionOfCM = 30.0")))
    shift = load_airframe("nasa-f16").centre_b[0] - build_airframe(forward).centre_b[0]
    np.testing.assert_allclose(shift, 0.05 * 11.32 * 0.3048, rtol=1e-9)
    body = """[mass]
mass_kg = 9000
Jxx_kg_m2 = 13000
Jyy_kg_m2 = 75000
Jzz_kg_m2 = 85000
[engine.jet]
full_N = 60000
lag_s = 2.0
[[surface]]
name = "elevator\""""
    file = read_airframe(
        changed(
            folder,
            ('inertia = "F16_inertia.dml"\n', "cg_offset_m = [1.0, 0.0, 0.0]\n"),
            ('propulsion = "F16_prop.dml"\npropulsion_lag_s = 1.0\n', ""),
            ("given = { vrsPositionOfCM = 25.0 }", ""),
            ('[[surface]]\nname = "elevator"', body),
        )
    )
    airframe = build_airframe(file)
    assert isinstance(airframe.engine, JetEngine)
    assert float(airframe.mass_properties.mass) == 9000
    assert airframe.centre_b.tolist() == [1.0, 0.0, 0.0]


def test_names_in_the_aircraft_file_replace_standard_names(folder):
    aero = folder / "F16_aero.dml"
    text = aero.read_text(encoding="utf-8")
    aero.write_text(
        text.replace('name="aeroBodyForceCoefficient_X"', 'name="axial"')
        .replace('name="elevatorDeflection"', 'name="tail"')
        .replace(">elevatorDeflection<", ">tail<")
        .replace(">aeroBodyForceCoefficient_X<", ">axial<"),
        encoding="utf-8",
    )
    with pytest.raises(
        ScenarioError, match="has no aeroBodyForceCoefficient_X; expected variables of these standard names"
    ):
        read_airframe(folder / "my-f16.toml")
    file = read_airframe(
        changed(
            folder,
            ("[dave_ml]", '[dave_ml]\nnames = { aeroBodyForceCoefficient_X = "axial" }'),
            ('name = "elevator"', 'name = "elevator"\ninput = "tail"'),
        )
    )
    assert all(renamed.passed for renamed in compare_check_data(file))
    renamed, standard = build_airframe(file), load_airframe("nasa-f16")
    assert renamed.inputs[0] == "tail"
    assert standard.inputs[0] == "elevatorDeflection"


@pytest.mark.parametrize(
    ("pair", "message"),
    [
        (("F16_prop.dml", "none.dml"), r"dave_ml.propulsion: arrived .*, which cannot be read \(No such file"),
        (('"F16_aero.dml"', '"F16_prop.dml"'), 'dave_ml.aerodynamics: arrived "F16_prop.dml", which has no aeroBody'),
        (('name = "elevator"', 'name = "flap"'), r'surface\[0\].input: arrived "flapDeflection"; expected an input of'),
        (('name = "elevator"', 'name = "elevator"\ninput = "mach"'), r'surface\[0\].input: arrived "mach"'),
        (
            ('name = "elevator"', 'name = "elevator"\ninput = "rdr"'),
            r'surface\[2\].input: arrived "rudderDeflection"; expected an input of its own',
        ),
        (
            ('name = "elevator"', 'name = "elevator"\ninput = "angleOfAttack"'),
            r'surface\[0\].input: arrived "angleOfAttack"; expected an input of its own',
        ),
        (("propulsion_lag_s = 1.0", ""), "dave_ml.propulsion_lag_s: arrived nothing; expected a time constant"),
        (("vrsPositionOfCM", "vrsPos"), 'dave_ml.given.vrsPos: arrived "vrsPos"; expected the varID or the name'),
        (('inertia = "F16_inertia.dml"', ""), "dave_ml.inertia: arrived nothing; expected either a file of inertia"),
        (('"F16_inertia.dml"', "3"), "dave_ml.inertia: arrived 3; expected the path of a DAVE-ML file"),
        (("[dave_ml]", '[dave_ml]\nnames = { mach = "machine" }'), 'dave_ml.names.mach: arrived "machine"'),
        (("[dave_ml]", "[dave_ml]\ncg_offset_m = [0, 0, 0]"), "dave_ml.cg_offset_m: arrived .* expected nothing"),
    ],
)
def test_a_refusal_names_the_key(folder, pair, message):
    with pytest.raises(ScenarioError, match=message):
        read_airframe(changed(folder, pair))


def test_an_invalid_dave_ml_file_is_refused_with_its_line(folder):
    (folder / "F16_aero.dml").write_text("<DAVEfunc>\n<variableDef>", encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"dave_ml.aerodynamics \(F16_aero.dml, line 2, column \d+\): arrived"):
        read_airframe(folder / "my-f16.toml")


def test_an_invalid_dave_ml_file_of_a_name_used_twice_is_refused_with_its_key(folder):
    (folder / "inertia").mkdir()
    (folder / "inertia" / "F16_aero.dml").write_text("<DAVEfunc>", encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"dave_ml.inertia \(F16_aero.dml, line 1"):
        read_airframe(changed(folder, ('"F16_inertia.dml"', '"inertia/F16_aero.dml"')))


def test_a_dave_ml_file_alone_is_refused_with_the_way_out(folder):
    with pytest.raises(ScenarioError, match=r"expected an aircraft file \(.toml\) that names it under \[dave_ml\]"):
        load_airframe(str(folder / "F16_aero.dml"))
    scenario = FLEET.replace("my-f16.toml", "F16_aero.dml")
    with pytest.raises(ScenarioError, match="a DAVE-ML file has no actuators"):
        loads(scenario, str(folder / "one.toml"))


DEVIATION = """[aircraft.deviation]
mass = 1.1
thrust = 0.9
second_moment_z = 1.21
cg_shift = 0.05
coefficients = { CZ = 0.8, Cm = 1.5 }
"""


def test_a_side_force_at_rest_is_found(folder):
    """In the trainer's file, at one angle of attack only, and nowhere."""
    text = TRAINER.with_suffix(".dml").read_text(encoding="utf-8")
    side_force_term = "<apply><plus/><apply><times/><cn>-0.393</cn><ci>BR</ci></apply>"
    assert side_force_term in text
    for addition in ("", "<cn>0.001</cn>", "<apply><times/><cn>0.001</cn><ci>AR</ci></apply>"):
        (folder / "trainer.dml").write_text(
            text.replace(side_force_term, side_force_term.replace("<plus/>", "<plus/>" + addition)), encoding="utf-8"
        )
        (folder / "trainer.toml").write_text(TRAINER.read_text(encoding="utf-8"), encoding="utf-8")
        assert load_airframe(str(folder / "trainer.toml")).symmetric == (not addition)


@pytest.mark.long
def test_a_deviation_reaches_the_flown_aircraft(folder):
    vehicle = build_flight(loads(FLEET + DEVIATION, str(folder / "one.toml"))).aircraft(0)[0]
    nominal = load_airframe(str(folder / "my-f16.toml"))
    np.testing.assert_allclose(vehicle.airframe.mass_properties.mass, 1.1 * nominal.mass_properties.mass)


def test_a_deviation_makes_another_aircraft(folder):
    deviation = loads(FLEET + DEVIATION, str(folder / "one.toml")).aircraft[0].deviation
    nominal = load_airframe(str(folder / "my-f16.toml"))
    flown = disperse_airframe(nominal, deviation)
    np.testing.assert_allclose(flown.mass_properties.mass, 1.1 * nominal.mass_properties.mass)
    Jxx, Jyy, Jzz = np.diag(nominal.mass_properties.inertia_b)
    higher = 0.21 * 0.5 * (Jxx + Jyy - Jzz)
    expected = np.array(nominal.mass_properties.inertia_b) + np.diag([higher, higher, 0.0])
    expected[0, 2] = expected[2, 0] = 1.1 * expected[0, 2]
    np.testing.assert_allclose(flown.mass_properties.inertia_b, expected, rtol=1e-12)
    air = air_data(jnp.array([150.0, 4.0, 12.0]), 1000.0, StandardAtmosphere().at(1000.0))
    surfaces = jnp.array([-0.03, 0.02, -0.01])
    nominal_wrench, dispersed_wrench = (one.aerodynamics(air, jnp.zeros(3), surfaces) for one in (nominal, flown))
    scale = np.array([1.0, 1.0, 0.8])
    np.testing.assert_allclose(dispersed_wrench.force_b, np.asarray(nominal_wrench.force_b) * scale, rtol=1e-12)
    # Moments about the reference: those of the known one put back from its own centre of mass to it.
    reference_moments = [
        np.asarray(w.moment_b) + np.cross(a.centre_b, w.force_b)
        for w, a in ((nominal_wrench, nominal), (dispersed_wrench, flown))
    ]
    np.testing.assert_allclose(reference_moments[1], reference_moments[0] * [1.0, 1.5, 1.0], rtol=1e-10)
    aft = np.asarray(nominal.centre_b - flown.centre_b)
    np.testing.assert_allclose(aft, [0.05 * float(nominal.mean_chord), 0.0, 0.0], rtol=1e-12)
    thrust, less = (one.engine.propulsion(60.0, air) for one in (nominal, flown))
    np.testing.assert_allclose(less.force_b, 0.9 * thrust.force_b, rtol=1e-12)
    np.testing.assert_allclose(
        less.moment_b, 0.9 * np.asarray(thrust.moment_b) + np.cross(aft, less.force_b), atol=1e-6
    )


@pytest.mark.parametrize(
    ("text", "location", "message"),
    [
        (
            "coefficients = { Cm_alpha = 0.8 }",
            "deviation.coefficients.Cm_alpha",
            "a coefficient of nasa-f16: CX, CY, CZ",
        ),
        ("coefficients = { CX0 = 0.8 }", "deviation.coefficients.CX0", "a coefficient of nasa-f16: CX, CY, CZ"),
    ],
)
def test_a_deviation_of_a_missing_coefficient_is_refused(folder, text, location, message):
    with pytest.raises(ScenarioError, match=message) as refused:
        loads(f"{FLEET}[aircraft.deviation]\n{text}\n", str(folder / "one.toml"))
    assert location in str(refused.value)


def test_a_deviation_of_the_thrust_needs_an_engine(folder):
    glider = (('propulsion = "F16_prop.dml"\npropulsion_lag_s = 1.0\n', ""),)
    text = FLEET.replace("my-f16.toml", changed(folder, *glider).name) + "[aircraft.deviation]\nthrust = 0.9\n"
    with pytest.raises(ScenarioError, match=r"deviation.thrust .* expected 1: nasa-f16 has no engine"):
        loads(text, str(folder / "one.toml"))


def test_values_without_texts_are_refused():
    values = tomllib.loads(TEXT)
    with pytest.raises(ScenarioError, match=r"dave_ml.aerodynamics: arrived .* expected the path of a DAVE-ML file"):
        validate_airframe(values, "test")


@pytest.mark.long
def test_the_shipped_trainer_agrees_with_its_check_data():
    """The search for the second trim returns from beyond full power."""
    file = read_airframe(TRAINER)
    compared = compare_check_data(file)
    assert {v.location.partition("[")[0] for v in compared} >= {"dave_ml.aerodynamics.CX", "check.trim"}
    assert all(v.passed for v in compared)
    assert collect_findings(file) == ()
