"""Formats of scenario files: the default planner of each format, and conversion between formats."""

import tomllib
from pathlib import Path

import pytest

from anser.config import ScenarioError
from anser.scenario import convert, load, loads
from anser.scenario.cautions import find_cautions
from anser.scenario.files import starter_scenario

SCENARIOS = sorted((Path(__file__).resolve().parents[2] / "scenarios").glob("*.toml"))
TWENTY = next(path for path in SCENARIOS if path.stem == "twenty-aircraft")
BARE = """
format = 1  # of before
name = "bare"

[timing]
duration_s = 90.0

[fleet]  # common
speed_m_s = 150.0

[[aircraft]]
name = "one"
goal = "boat"
start = { north_m = 0.0, east_m = 0.0, altitude_m = 1000.0, speed_m_s = 150.0, course_deg = 0.0 }

[[goal]]
name = "boat"
kind = "surface"
north_m = 5000.0
east_m = 0.0
"""


def test_a_file_of_format_1_keeps_its_planner_with_a_caution():
    old, new = loads(BARE), loads(BARE.replace("format = 1", "format = 2"))
    assert (old.fleet.planner, new.fleet.planner) == ("published", "certified")
    (said,) = find_cautions(old)
    assert 'means "published"' in said
    assert 'the default of format 2 is "certified"' in said
    assert "anser convert" in said
    assert find_cautions(new) == ()
    assert find_cautions(loads(BARE.replace("150.0\n\n[[air", '150.0\nplanner = "published"\n\n[[air'))) == ()


def test_the_hash_of_a_file_of_format_1_is_unchanged():
    """Existing results refer to hashes of format 1, with the published planner explicit or by default."""
    explicit = BARE.replace("speed_m_s = 150.0\n\n[[", 'speed_m_s = 150.0\nplanner = "published"\n\n[[')
    assert loads(BARE).hash == loads(explicit).hash


def test_a_converted_file_is_equivalent_and_keeps_its_comments():
    text = convert(BARE)
    assert "format = 2  # of before" in text
    assert "[fleet]  # common\nplanner = " in text
    values = tomllib.loads(text)
    assert (values["format"], values["fleet"]["planner"]) == (2, "published")
    assert convert(text) == text
    back = convert(text, target_format=1)
    assert loads(back).hash == loads(BARE).hash


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_every_scenario_converts_back_and_forth(path):
    text, scenario = path.read_text(), load(path)
    converted = convert(text, target_format=1)
    assert loads(converted).model_dump(exclude={"format"}) == scenario.model_dump(exclude={"format"})
    assert loads(convert(converted)).hash == scenario.hash


def test_the_starter_is_of_the_newest_format_with_its_default():
    starter = loads(starter_scenario())
    assert (starter.format, starter.fleet.planner) == (2, "certified")


@pytest.mark.parametrize(
    "text",
    [
        BARE.replace("[fleet]  # common\nspeed_m_s = 150.0", "fleet = { speed_m_s = 150.0 }")
        .replace("[timing]\nduration_s = 90.0\n\nfleet", "fleet")
        .replace('name = "bare"\n', 'name = "bare"\ntiming.duration_s = 90.0\n')
    ],
    ids=["fleet in one line"],
)
def test_a_text_without_editable_lines_is_refused(text):
    with pytest.raises(ScenarioError, match="both written out"):
        convert(text, "mine.toml")


def test_an_invalid_scenario_is_not_converted():
    with pytest.raises(ScenarioError, match="format: arrived 3"):
        convert(BARE.replace("format = 1", "format = 3"))
