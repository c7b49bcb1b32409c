"""The check data of an aircraft file against what the file makes."""

import tomllib

from anser.aircraft import PistonPropeller
from anser.aircraft_files import build_airframe
from anser.aircraft_files.check_data import compare_check_data
from anser.aircraft_files.findings import collect_findings
from anser.aircraft_files.sources import airframe_starter, library_file, validate_airframe
from support.aerosonde_file import changed


def test_the_library_has_the_aerosonde_and_its_checks_agree():
    found = compare_check_data(library_file("aerosonde"))
    assert len(found) == 24
    assert all(one.passed for one in found)
    assert max(abs(one.expected - one.obtained) for one in found) < 1e-12


def test_check_data_that_disagree_say_where():
    file = validate_airframe(changed(("Cm_q = -38.21", "Cm_q = -38.0")), "test")
    wrong = [one for one in compare_check_data(file) if not one.passed]
    assert {one.location for one in wrong} == {"check.forces[1].moment_Nm[1]", "check.forces[2].moment_Nm[1]"}


def test_the_starter_is_valid_flies_and_looks_right():
    file = validate_airframe(tomllib.loads(airframe_starter()), "starter")
    assert isinstance(build_airframe(file).engine, PistonPropeller)
    assert all(one.passed for one in compare_check_data(file))
    assert collect_findings(file) == ()
