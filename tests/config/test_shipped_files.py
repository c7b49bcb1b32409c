"""Scenarios, studies and aircraft that come with anser: their names, and copies that stand by themselves."""

from pathlib import Path

import pytest

from anser.aircraft_files.sources import read_airframe
from anser.campaigns.study import load_study
from anser.config.errors import ScenarioError
from anser.config.shipped_files import copy_shipped_file, shipped_files
from anser.scenario import load

ROOT = Path(__file__).parents[2]


def test_every_shipped_file_has_its_name():
    files = [path for folder in ("scenarios", "studies") for path in (ROOT / folder).rglob("*.toml")]
    files.append(ROOT / "src" / "anser" / "aircraft" / "data" / "aerosonde.toml")
    assert sorted(shipped_files().values()) == sorted(files)
    assert len(shipped_files()) == len(files)  # no name twice


@pytest.mark.parametrize("name", shipped_files())
def test_a_copy_is_read_without_the_original(name, tmp_path):
    target = tmp_path / "mine.toml"
    copy_shipped_file(name, target)
    source = shipped_files()[name]
    if source.parent.name in ("own-aircraft", "data"):
        read_airframe(target)
    elif "[[aircraft]]" in target.read_text():
        assert load(target).hash == load(source).hash
    else:
        assert load_study(target)[1].hash == load_study(source)[1].hash


def test_files_of_the_user_stay(tmp_path):
    (tmp_path / "uncertain-world.toml").write_text("my own")
    (companion,) = copy_shipped_file("how-surely", tmp_path / "study.toml")
    assert companion.read_text() == "my own"
    with pytest.raises(ScenarioError, match="a name that is taken"):
        copy_shipped_file("how-surely", tmp_path / "study.toml")
