"""The starter scenario loads, shows every key with its default, and overwrites nothing."""

import re
import tomllib
from pathlib import Path
from typing import get_args

import pytest
from pydantic import BaseModel

from anser.aircraft_files import AirframeFile
from anser.aircraft_files.deviations import F16_FACTORS, CoefficientFactors
from anser.aircraft_files.schema import DaveMlFile
from anser.config import ScenarioError
from anser.scenario import Scenario, load, loads, write_starter
from anser.scenario.files import starter_scenario


def models_in(annotation: object) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in models_in(part)]


def keys_of(model: type[BaseModel]) -> set[str]:
    """Keys of a table and its subtables, except aircraft files, which have their own starter."""
    if model in (AirframeFile, DaveMlFile):
        return set()
    if model is CoefficientFactors:
        return set(F16_FACTORS)
    inner = (keys_of(child) for field in model.model_fields.values() for child in models_in(field.annotation))
    return set(model.model_fields).union(*inner)


def test_starter_loads_and_has_two_aircraft_with_a_goal_each() -> None:
    scenario = loads(starter_scenario())
    assert [aircraft.goal for aircraft in scenario.aircraft] == ["buoy-a", "buoy-b"]
    assert {goal.kind for goal in scenario.goal} == {"surface"}


def test_every_key_is_shown() -> None:
    text = starter_scenario()
    missing = [key for key in keys_of(Scenario) if not re.search(rf"\b{key}\b", text)]
    assert missing == []


def test_the_starter_states_the_true_defaults() -> None:
    """Without the lines marked "default" the scenario is the same, apart from three deliberately different values."""
    text = starter_scenario()
    stated = re.findall(r"^(\w+) = (.*?)\s+# .*default(?:: | )(\S+)$", text, flags=re.MULTILINE)
    assert len(stated) > 40  # the pattern still finds them
    bare = re.sub(r"^\w+ = .*# .*default.*$", "", text, flags=re.MULTILINE)
    scenario, without = loads(text), loads(bare)
    assert without == scenario.replace("description", "", "goal[0].speed_m_s", 0.0, "goal[0].course_deg", 0.0)
    for key, value, default in stated:
        if key in ("description", "speed_m_s", "course_deg") or value.startswith("["):
            continue
        assert value == default, key


def test_the_starter_is_written_and_loads(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    assert write_starter(str(path)) == path
    assert load(path).name == "starter"
    assert tomllib.loads(path.read_text(encoding="utf-8"))["format"] == 2


def test_the_starter_overwrites_nothing(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("precious")
    with pytest.raises(ScenarioError) as caught:
        write_starter(path)
    assert str(path) in str(caught.value)
    assert "a name that is taken" in str(caught.value)
    assert path.read_text() == "precious"


def test_the_starter_needs_an_existing_folder(tmp_path: Path) -> None:
    path = tmp_path / "none" / "mine.toml"
    with pytest.raises(ScenarioError, match="a folder that does not exist"):
        write_starter(path)
    with pytest.raises(ScenarioError, match="a name that is taken"):
        write_starter(tmp_path)
