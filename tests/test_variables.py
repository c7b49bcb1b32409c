"""The catalogue of recorded variables: unambiguous, complete, and consistent in unit, suffix and factor."""

import math
from dataclasses import FrozenInstanceError

import pytest

from anser.variables import CATALOGUE, DERIVED_KEYS, OPTIONAL_KEYS, RECORDED_KEYS

# What a name must end with for each unit; written out here, apart from the catalogue's own table.
SUFFIX_OF_UNIT = {
    "m": "_m",
    "m s-1": "_m_s",
    "degree": "_deg",
    "degree s-1": "_deg_s",
    "s": "_s",
    "Pa": "_pa",
    "N": "_n",
    "percent": "_percent",
    "1": "",
}


def test_names_keys_and_labels_are_unique():
    for field in ("name", "key", "symbol", "long_name"):
        values = [getattr(variable, field) for variable in CATALOGUE]
        assert len(set(values)) == len(values), field


@pytest.mark.parametrize("variable", CATALOGUE, ids=lambda variable: variable.key)
def test_name_is_the_key_with_the_suffix_of_its_unit(variable):
    assert variable.name == variable.key + SUFFIX_OF_UNIT[variable.unit]
    assert variable.name.isidentifier()
    assert variable.frame
    assert variable.symbol
    assert variable.long_name[0].isupper()


@pytest.mark.parametrize("variable", CATALOGUE, ids=lambda variable: variable.key)
def test_only_angles_are_converted(variable):
    # A half turn is pi in a history and 180 in a dataset; one rounding of the product, hence exact to 1 ulp.
    if variable.unit.startswith("degree"):
        assert math.isclose(math.pi * variable.factor, 180.0, rel_tol=2e-16)
    else:
        assert variable.factor == 1.0


def test_every_command_has_a_response_in_the_same_unit():
    by_key = {variable.key: variable for variable in CATALOGUE}
    commands = [key for key in by_key if key.endswith("_command")]
    assert len(commands) == 13
    for key in commands:
        assert by_key[key].unit == by_key[key.removesuffix("_command")].unit


def test_recorded_and_derived_keys_share_the_catalogue():
    assert set(RECORDED_KEYS) | DERIVED_KEYS | OPTIONAL_KEYS == {variable.key for variable in CATALOGUE}
    assert len(RECORDED_KEYS) + len(DERIVED_KEYS) + len(OPTIONAL_KEYS) == len(CATALOGUE)


def test_discrete_variables_name_their_values():
    by_key = {variable.key: variable for variable in CATALOGUE}
    assert by_key["phase"].flags == ("approach", "frozen", "hold")
    assert by_key["outside_tables"].dtype == "bool"
    assert {variable.key for variable in CATALOGUE if variable.dtype != "float64"} == {
        "phase",
        "renewal",
        "speed_limited",
        "thrust_limited",
        "lift_limited",
        "bank_limited",
        "rates_limited",
        "surfaces_limited",
        "outside_tables",
        "status",
        "goal_known",
        "goal_seen",
        "heard_from",
        "path_offered",
    }
    # CF separates the meanings by blanks.
    assert all(" " not in word for variable in CATALOGUE for word in variable.flags)


def test_a_variable_cannot_be_changed():
    with pytest.raises(FrozenInstanceError):
        CATALOGUE[0].factor = 2.0  # pyright: ignore[reportAttributeAccessIssue]
