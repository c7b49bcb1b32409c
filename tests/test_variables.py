"""The catalogue of recorded variables: unambiguous, complete, and consistent in unit, suffix and factor."""

import math
from dataclasses import FrozenInstanceError, fields

import pytest

from anser.aircraft import FirstOrderActuators
from anser.variables import (
    CATALOGUE,
    DERIVED_KEYS,
    OPTIONAL_KEYS,
    RECORDED_KEYS,
    STANDARD_SURFACES,
    Variable,
    all_surface_names,
    catalogue,
    recorded_keys,
    surface_variables,
)

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
        "fault",
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


def test_the_standard_surfaces_have_their_own_entries():
    assert surface_variables(STANDARD_SURFACES) == tuple(
        variable for variable in CATALOGUE if variable.key.removesuffix("_command") in STANDARD_SURFACES
    )
    assert catalogue() == CATALOGUE
    default = next(field.default for field in fields(FirstOrderActuators) if field.name == "names")
    assert default == STANDARD_SURFACES


def test_a_surface_of_another_name_has_a_similar_entry():
    position, command = surface_variables(["left_elevon"])
    assert position == Variable(
        "left_elevon_deg", "left_elevon", "degree", 180.0 / math.pi, "body FRD", "δ_le", "Left elevon"
    )
    assert (command.name, command.key) == ("left_elevon_command_deg", "left_elevon_command")
    assert (command.symbol, command.long_name) == ("δ_le,c", "Left elevon command")


def test_symbols_of_surfaces_differ():
    symbols = [
        variable.symbol
        for variable in surface_variables(["elevator", "flap", "left_elevon", "leading_edge", "lower_e"])
    ]
    assert symbols[:5] == ["δ_e", "δ_flap", "δ_left,elevon", "δ_leading,edge", "δ_lower,e"]
    assert len(set(symbols)) == 10


def test_the_catalogue_of_other_surfaces_keeps_all_other_variables():
    names = ("left_elevon", "right_elevon")
    variables = catalogue(names)
    of_surfaces = surface_variables(names)
    assert [v for v in variables if v not in of_surfaces] == [
        v for v in CATALOGUE if v not in surface_variables(STANDARD_SURFACES)
    ]
    at = variables.index(of_surfaces[0])
    assert variables[at : at + 4] == of_surfaces
    assert CATALOGUE[at].key == "elevator"
    keys = recorded_keys(names)
    assert set(RECORDED_KEYS) - set(keys) == {v.key for v in surface_variables(STANDARD_SURFACES)}
    assert set(keys) - set(RECORDED_KEYS) == {v.key for v in of_surfaces}


def test_surfaces_of_a_fleet_come_in_the_order_in_which_they_occur():
    assert all_surface_names([("b", "a"), ("a", "c"), ("b",)]) == ("b", "a", "c")


@pytest.mark.parametrize("name", ["bank", "roll_rate", "flap_command"])
def test_a_surface_cannot_have_the_name_of_another_variable(name):
    with pytest.raises(ValueError, match="another variable"):
        surface_variables(["flap", name])


@pytest.mark.parametrize("name", ["Flap", "left flap", "flap_", "2flap", ""])
def test_a_surface_needs_a_plain_name(name):
    with pytest.raises(ValueError, match="lower-case words"):
        surface_variables([name])


def test_a_surface_cannot_occur_twice():
    with pytest.raises(ValueError, match="'flap'"):
        surface_variables(["flap", "flap"])
