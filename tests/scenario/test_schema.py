"""Keys, types and ranges refused by the schema: each refusal gives the path, the value and the expected value."""

import copy
import tomllib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from anser.aircraft_files.sources import ALTITUDE_MAX_M
from anser.config import ScenarioError
from anser.scenario import loads, scenario_hash, validate
from anser.scenario.build import build_flight
from anser.scenario.files import starter_scenario
from support.two_aircraft import GOOD, WAYPOINT_GOAL, assert_told, changed, refusal

# one change of the good scenario, then: path, whom, what arrived (a part), what would be right (a part)
CASES = {
    "unknown key": (
        [("stand_off_up_m", "stand_of_up_m")],
        ("aircraft[1].rendezvous.stand_of_up_m", 'aircraft "bravo"', '"stand_of_up_m"', 'perhaps "stand_off_up_m"'),
    ),
    "misspelt required key": (
        [("duration_s", "duratoin_s")],
        ("timing.duratoin_s", "", '"duratoin_s"', 'perhaps "duration_s"'),
    ),
    "unknown table": ([("[wind]", "[winds]")], ("winds", "", '"winds"', 'perhaps "wind"')),
    "key with odd letters": (
        [("seed = 0", '"a\\n b" = 0')],
        ('"a\\n b"', "", "'a\\n b'", "one of the keys"),
    ),
    "key like no other": ([("seed", "qqq")], ("qqq", "", '"qqq"', "one of the keys format, name")),
    "missing key": (
        [("course_deg = 180.0\n", "")],
        ("aircraft[0].start.course_deg", 'aircraft "alpha"', "nothing", "a number from -360 to 360 deg"),
    ),
    "missing format": ([("format = 1\n", "")], ("format", "", "nothing", "2 or 1, the formats")),
    "other format": ([("format = 1", "format = 3")], ("format", "", "3", "2 or 1, the formats")),
    "format as a boolean": ([("format = 1", "format = true")], ("format", "", "true", "2 or 1, the formats")),
    "format with a point": ([("format = 1", "format = 1.0")], ("format", "", "1.0", "2 or 1, the formats")),
    "string for a number": (
        [("speed_m_s = 151.0", 'speed_m_s = "fast"')],
        ("aircraft[1].start.speed_m_s", 'aircraft "bravo"', '"fast"', "a number from 1 to 340 m/s"),
    ),
    "boolean for a number": ([("seed = 0", "seed = false")], ("seed", "", "false", "a whole number from 0")),
    "fraction for a whole number": ([("seed = 0", "seed = 1.5")], ("seed", "", "1.5", "a whole number")),
    "boolean for a float": (
        [("from_deg = 0.0", "from_deg = true")],
        ("wind.from_deg", "", "true", "a number from -360"),
    ),
    "number for a string": ([('"ship"', "3")], ("aircraft[0].goal", 'aircraft "alpha"', "3", "a name of 1 to 64")),
    "date for a string": ([('"A base case"', "2020-01-01")], ("description", "", "2020-01-01", "a text in quotes")),
    "NaN": ([("freeze_s = 4.0", "freeze_s = nan")], ("timing.freeze_s", "", "nan", "a number from 0 to 600 s")),
    "infinity": ([("freeze_s = 4.0", "freeze_s = inf")], ("timing.freeze_s", "", "inf", "a number from 0 to 600 s")),
    "endless number": (
        [("freeze_s = 4.0", "freeze_s = 0x1" + "0" * 5000)],
        ("timing.freeze_s", "", "a whole number of 20001 bits", "a number from 0 to 600 s"),
    ),
    "out of range": (
        [("step_s = 0.01", "step_s = 0.2")],
        ("timing.step_s", "", "0.2", "a number from 0.001 to 0.05 s"),
    ),
    "no slug": ([('"two-aircraft"', '"Two Aircraft"')], ("name", "", '"Two Aircraft"', "small letters")),
    "wrong word": (
        [('"surface"', '"floating"')],
        ("goal[0].kind", 'goal "ship"', '"floating"', '"surface" or "airborne"'),
    ),
    "gain below zero": (
        [("proportional = 10", "proportional = -1")],
        ("aircraft[0].gains.rates.proportional", 'aircraft "alpha"', "-1", "a list of three such numbers"),
    ),
    "gains for two axes": (
        [("proportional = 10", "proportional = [1, 2]")],
        ("aircraft[0].gains.rates.proportional", 'aircraft "alpha"', "a list of 2", "a list of three such numbers"),
    ),
    "one wrong gain of three": (
        [("proportional = 10", 'proportional = [1, "2", 3]')],
        ("aircraft[0].gains.rates.proportional[1]", 'aircraft "alpha"', '"2"', "a number from 0 to 1000"),
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_a_refusal_names_the_key_its_value_and_the_expected_value(case: str) -> None:
    assert_told(*CASES[case])


def test_the_reference_scenario_loads() -> None:
    scenario = loads(GOOD)
    assert scenario.aircraft[0].gains.rates.proportional == (10.0, 10.0, 10.0)
    assert scenario.goal_of(scenario.aircraft[1]).name == "balloon"


def test_a_scenario_without_aircraft_is_refused() -> None:
    start, end = GOOD.index("[[aircraft]]"), GOOD.index("[[goal]]")
    (problem,) = refusal(GOOD[:start] + GOOD[end:]).problems
    assert (problem.path, problem.arrived) == ("aircraft", "nothing")
    assert "[[aircraft]]" in problem.expected
    (problem,) = refusal("aircraft = []\n" + GOOD[:start] + GOOD[end:]).problems
    assert (problem.path, problem.arrived) == ("aircraft", "a list of 0")


def test_single_brackets_for_a_list_of_tables_are_refused() -> None:
    start, end = GOOD.index("[[goal]]"), len(GOOD)
    text = GOOD[:start] + '[goal]\nname = "ship"\nkind = "surface"\n' + GOOD[end:]
    (problem,) = refusal(text).problems
    assert (problem.path, problem.arrived) == ("goal", "a table")
    assert "double brackets" in problem.expected


def test_a_value_in_place_of_a_table_is_refused() -> None:
    text = GOOD.replace("[hold]\nradius_m = 4000.0\n", "").replace("seed = 0", "hold = 3")
    (problem,) = refusal(text).problems
    assert (problem.path, problem.arrived, problem.expected) == ("hold", "3", "a table [hold]")


def test_all_problems_are_reported_together() -> None:
    text = changed(("speed_m_s = 151.0", "speed_m_s = nan"), ('"surface"', '"sea"'), ("step_s = 0.01", "step = 0.01"))
    error = refusal(text)
    assert [problem.path for problem in error.problems] == [
        "timing.step",
        "aircraft[1].start.speed_m_s",
        "goal[0].kind",
    ]
    assert str(error).startswith("case.toml: 3 problems\n")
    # between tables too
    error = refusal(changed(("speed_m_s = 151.0", "speed_m_s = 80"), ("stand_off_up_m = 120.0", "stand_off_up_m = 99")))
    assert [problem.path for problem in error.problems] == ["aircraft[1].start.speed_m_s", "aircraft[1].rendezvous"]


def test_a_scenario_is_frozen() -> None:
    scenario = loads(GOOD)
    with pytest.raises(ValidationError):
        scenario.wind.speed_m_s = 3.0  # type: ignore[misc]


def leaves(value: object, path: tuple = ()) -> list[tuple]:
    """Paths of all values and tables."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *(leaf for key, child in items for leaf in leaves(child, (*path, key)))]


VALUES = tomllib.loads(starter_scenario())
junk = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=20),
    st.lists(st.floats(), max_size=4),
    st.dictionaries(st.text(max_size=5), st.integers(), max_size=2),
    st.sampled_from([[{}], [[[]]], {"name": {}}, [{"name": 3}], 10**400]),
)


@given(st.sampled_from(leaves(VALUES)[1:]), junk)
@settings(deadline=None, max_examples=150)
def test_any_value_anywhere_is_loaded_or_refused_with_a_plain_message(path: tuple, value: object) -> None:
    values = copy.deepcopy(VALUES)
    table = values
    for key in path[:-1]:
        table = table[key]
    table[path[-1]] = value
    message = ""
    try:
        validate(values)
    except ScenarioError as error:
        message = str(error)
    for line in message.splitlines()[1:]:
        assert ": arrived " in line
        assert "; expected " in line


def test_hash_ignores_the_way_of_writing() -> None:
    reference = scenario_hash(loads(GOOD))
    assert len(reference) == 64
    assert loads(GOOD).hash == reference
    equivalent_texts = [
        "# a comment\n" + GOOD,
        changed(("seed = 0\n", "")),  # the default, left out
        changed(("freeze_s = 4.0", "freeze_s = 4")),
        changed(("proportional = 10", "proportional = [10.0, 10.0, 10.0]")),
        changed(("north_m = 9000.0\neast_m = 0.0", "east_m = 0.0\nnorth_m = 9000.0")),
        changed(('name = "ship"\nkind = "surface"', 'kind = "surface"\nname = "ship"')),
    ]
    assert {scenario_hash(loads(text)) for text in equivalent_texts} == {reference}


UAV = """format = 2
name = "uav"
[timing]
duration_s = 200.0
[fleet]
speed_m_s = 25.0
[hold]
radius_m = 200.0
[[aircraft]]
name = "a"
type = "aerosonde"
goal = "g"
start = { north_m = 0.0, east_m = 0.0, altitude_m = 300.0, speed_m_s = 25.0, course_deg = 0.0 }
[[goal]]
name = "g"
kind = "surface"
north_m = 2000.0
east_m = 500.0
"""
WRITTEN = ("", "[limits]\nbank_max_deg = 60.0\n", "[aircraft.gains.rates]\nproportional = 10.0\n")
"""Defaults of the F-16. Of other aircraft, limits and gains follow from the aircraft where they are left out."""


def uav(written):
    end = "[[goal]]"
    return loads(UAV.replace(end, written + end))


def test_hash_tells_written_limits_and_gains_from_derived_ones():
    assert len({scenario_hash(uav(written)) for written in WRITTEN}) == 3
    scenarios = [uav(written) for written in WRITTEN]
    assert [[a == b for a in scenarios] for b in scenarios] == np.eye(3, dtype=bool).tolist()
    assert len(set(scenarios)) == 3
    assert uav(WRITTEN[1]) == uav(WRITTEN[1])
    assert scenario_hash(uav(f"[limits]\naltitude_max_m = {ALTITUDE_MAX_M}\n")) == scenario_hash(uav(""))


def test_kept_flights_are_those_of_the_written_keys():
    """A flight kept for another goal is not that of a scenario with a default written in place of a derived limit."""
    derived, written = (build_flight(uav(text), pad_fleet=True) for text in WRITTEN[:2])
    bank_max = [
        float(np.max(flight.groups[0].vehicles.batched.controller.limits.bank_max)) for flight in (derived, written)
    ]
    assert bank_max[1] == pytest.approx(np.deg2rad(60.0))
    assert bank_max[0] < np.deg2rad(59.0)


@pytest.mark.parametrize(
    "change",
    [
        ("seed = 0", "seed = 1"),
        ('"A base case"', '"The base case"'),
        ('"two-aircraft"', '"other"'),
        ("freeze_s = 4.0", "freeze_s = 4.000001"),
        ("from_deg = 0.0", "from_deg = 0.1"),
        ("[fleet]\nspeed_m_s = 150", "[fleet]\nspeed_m_s = 151"),
        ("radius_m = 4000", "radius_m = 4001"),
        ("proportional = 10", "proportional = [10, 10, 11]"),
        ("proportional = 10", "derivative = 2"),
        ("north_m = -8000.0", "north_m = -8001.0"),
        ("stand_off_up_m = 120", "stand_off_north_m = 0"),
        ("course_deg = 90", "course_deg = 91"),
        ("[hold]", "[guidance]\nposition_gain_per_s = 0\n[hold]"),
        ("[hold]", '[hold]\ndirection = "left"'),
        ("[hold]", "[earth]\nlatitude_deg = 46\n[hold]"),
        ("[hold]", "[requirements]\nmiss_max_m = 4\n[hold]"),
        ('goal = "ship"', 'goal = "ship"\nvariant = "s119"'),
        ('goal = "ship"', 'goal = "ship"\nx_cg_over_c = 0.3'),
        ('goal = "ship"', 'goal = "ship"\nbend = "left"'),
        WAYPOINT_GOAL,
    ],
)
def test_hash_changes_with_any_value(change: tuple[str, str]) -> None:
    assert loads(changed(change)).hash != loads(GOOD).hash
