"""Check data of aircraft files compared with computed values."""

import tomllib

import pytest

from anser.aircraft import PistonPropeller
from anser.aircraft_files import build_airframe
from anser.aircraft_files.check_data import compare_check_data
from anser.aircraft_files.findings import collect_findings
from anser.aircraft_files.sources import airframe_starter, library_file, validate_airframe
from support.aerosonde_file import changed


def test_the_library_has_the_aerosonde_and_its_checks_agree():
    checked_values = compare_check_data(library_file("aerosonde"))
    assert len(checked_values) == 24
    assert all(v.passed for v in checked_values)
    assert max(abs(v.expected - v.obtained) for v in checked_values) < 1e-12


def test_disagreeing_check_data_are_located():
    file = validate_airframe(changed(("Cm_q = -38.21", "Cm_q = -38.0")), "test")
    wrong = [v for v in compare_check_data(file) if not v.passed]
    assert {v.location for v in wrong} == {"check.forces[1].moment_Nm[1]", "check.forces[2].moment_Nm[1]"}


@pytest.mark.long
def test_the_starter_is_valid_and_without_findings():
    file = validate_airframe(tomllib.loads(airframe_starter()), "starter")
    assert isinstance(build_airframe(file).engine, PistonPropeller)
    assert all(v.passed for v in compare_check_data(file))
    assert collect_findings(file) == ()
