"""Refusals of aircraft files, and keys of the documented examples."""

import re
from typing import get_args

import pytest
from pydantic import BaseModel

from anser.aircraft_files import AirframeFile
from anser.aircraft_files.sources import airframe_starter, validate_airframe
from anser.airframe_data import DERIVATIVES
from anser.config import ScenarioError
from support.aerosonde_file import AEROSONDE, TABLE, built, changed


def test_every_key_occurs_in_the_starter_or_the_aerosonde():
    """Both files are in the reference; derivative names follow a rule."""

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


@pytest.mark.parametrize(
    ("pair", "path", "arrived", "expected"),
    [
        (("CL_alpha = 5.61", "CL_alpa = 5.61"), "aerodynamics.CL_alpa", "the unknown key", 'perhaps "CL_alpha"'),
        (("CL_q = 7.95", "Cm_alphadot = 7.95"), "aerodynamics.Cm_alphadot", "the unknown key", "added to Cm_q"),
        (("mass_kg = 11.0", 'mass_kg = "11"'), "mass.mass_kg", '"11"', "a number above 0"),
        (("mass_kg = 11.0", "mass_kg = nan"), "mass.mass_kg", "nan", "a number above 0"),
        (("Jxz_kg_m2 = 0.1204", "Jxz_kg_m2 = 1.5"), "mass.Jxz_kg_m2", "1.5", "positive definite"),
        (("Jzz_kg_m2 = 1.759", "Jzz_kg_m2 = 2.759"), "mass.Jzz_kg_m2", "2.759", "at most Jxx + Jyy, 1.9594 kg m^2"),
        (("Jxz_kg_m2 = 0.1204", "Jxz_kg_m2 = 0.7"), "mass.Jxz_kg_m2", "0.7", "exceeds the sum of the other two"),
        (("mass_kg = 11.0", "mass_kg = 0.0"), "mass.mass_kg", "0.0", "a number above 0"),
        (("span_m = 2.8956", "span_m = -2.8956"), "geometry.span_m", "-2.8956", "a number above 0"),
        (("limit_deg = 30.0\n", ""), "surface[0].limit_deg", "nothing", "either limit_deg, or lower_deg and upper_deg"),
        (("lag_s = 0.05\n", ""), "surface[0].lag_s", "nothing", "either lag_s, or frequency_rad_s and damping"),
        (('name = "aileron"', 'name = "elevator"'), "surface[1].name", "already the name of surface[0]", "its own"),
        (('name = "aileron"', 'name = "alpha"'), "surface[1].name", '"alpha"', "another name than"),
        (('name = "aileron"', 'name = "throttle"'), "surface[1].name", '"throttle"', "a variable of flights has this"),
        (('name = "aileron"', 'name = "bank"'), "surface[1].name", '"bank"', "or this name with _command"),
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
def test_a_problem_is_reported_with_its_key(pair, path, arrived, expected):
    with pytest.raises(ScenarioError) as caught:
        validate_airframe(changed(pair), "uav.toml")
    problem = next(p for p in caught.value.problems if p.path == path)
    assert arrived in problem.arrived
    assert expected in problem.expected
    assert str(caught.value).startswith("uav.toml: ")


def test_a_derivative_beside_the_table_that_replaces_it_is_refused():
    with pytest.raises(ScenarioError) as caught:
        built(text=AEROSONDE + TABLE)
    assert {p.path for p in caught.value.problems} == {
        "aerodynamics.Cm0", "aerodynamics.Cm_alpha", "surface[0].Cm"
    }  # fmt: skip


def test_a_check_of_a_derivative_that_a_table_replaces_is_refused():
    table = TABLE.replace('"Cm"', '"Cm_q"')
    pairs = ("Cm_q = -38.21\n", ""), ("{ CD0 = 0.0 }", "{ Cm_q = 0.0 }")
    with pytest.raises(ScenarioError, match=r"instead.Cm_q: arrived 0; expected nothing: table\[0\] of Cm_q takes"):
        validate_airframe(changed(*pairs, text=AEROSONDE + table), "test")


JET = "[engine.jet]\nlag_s = 1.0\nidle_N = {}\nfull_N = {}\n"
ELECTRIC = AEROSONDE[AEROSONDE.index("[engine.electric_propeller]") : AEROSONDE.index("[validity]")]
AXES = "altitude_m = [0, 9000]\nmach = [0, 1]\n"


@pytest.mark.parametrize(
    ("jet", "arrived"),
    [
        (JET.format(500, 700), None),
        (JET.format(500, -100), "-600 N more than idle_N"),
        (JET.format(500, 500), "0 N more than idle_N"),
        (JET.format("[[1, 2], [0, 0]]", "[[9, 1], [0, 0]]") + AXES, None),
        (JET.format(0, "[[9, 1], [0, 0]]") + AXES, None),  # idle_N left out
        (JET.format("[[1, 2], [0, 0]]", 2) + AXES, None),
        (JET.format("[[1, 2], [1, 1]]", 1) + AXES, "0 N more than idle_N"),
        (JET.format("[[1, 2], [0, 0]]", "[[0, 1], [-1, -1]]") + AXES, "-1 N more than idle_N"),
    ],
)
def test_full_thrust_is_above_idle_thrust(jet, arrived):
    values = changed((ELECTRIC, jet))
    if arrived is None:
        assert validate_airframe(values, "test").engine.jet is not None
        return
    with pytest.raises(ScenarioError, match=f"engine.jet.full_N: arrived {arrived}; expected more thrust than idle_N"):
        validate_airframe(values, "test")


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
def test_a_problem_of_a_table_is_reported_with_its_key(pair, path):
    bare = changed(("Cm0 = 0.0135\nCm_alpha = -2.74\n", ""), ("Cm = -0.99\n", ""), pair, text=AEROSONDE + TABLE)
    with pytest.raises(ScenarioError) as caught:
        validate_airframe(bare, "test")
    assert path in [p.path for p in caught.value.problems]


def test_contradictions_of_a_file_within_stored_results_are_accepted():
    """The version that stored the results has checked the file, by its own rules."""
    values = changed(("Jzz_kg_m2 = 1.759", "Jzz_kg_m2 = 2.759"))
    assert validate_airframe(values, "test", is_stored=True).mass.Jzz_kg_m2 == 2.759
