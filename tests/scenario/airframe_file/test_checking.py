"""The check data of an aircraft file against what the file makes."""

import tomllib

from anser.aircraft import PistonPropeller
from anser.scenario.airframe_file import airframe_starter, library_file, validate_airframe
from anser.scenario.airframe_file.build import build_airframe
from anser.scenario.airframe_file.checking import compare
from anser.scenario.airframe_file.linting import lint
from scenario.airframe_file.aerosonde_file import changed


def test_the_library_has_the_aerosonde_and_its_checks_agree():
    found = compare(library_file("aerosonde"))
    assert len(found) == 24
    assert all(one.agrees for one in found)
    assert max(abs(one.expected - one.obtained) for one in found) < 1e-12


def test_check_data_that_disagree_say_where():
    file = validate_airframe(changed(("Cm_q = -38.21", "Cm_q = -38.0")), "test")
    wrong = [one for one in compare(file) if not one.agrees]
    assert {one.place for one in wrong} == {"check.forces[1].moment_Nm[1]", "check.forces[2].moment_Nm[1]"}


def test_the_starter_is_valid_flies_and_looks_right():
    file = validate_airframe(tomllib.loads(airframe_starter()), "starter")
    assert isinstance(build_airframe(file).engine, PistonPropeller)
    assert all(one.agrees for one in compare(file))
    assert lint(file) == ()
