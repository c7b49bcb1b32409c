"""What Python offers: its names, their types, and scenarios by the path of their file."""

import json
import re
import subprocess
import sys
from importlib.resources import files
from pathlib import Path

import pytest

import anser
from anser.config import ScenarioError

ENTRIES = [
    "campaign",
    "compare_campaigns",
    "linearize",
    "load",
    "load_flight",
    "loads",
    "plan",
    "rare",
    "run",
    "sweep",
    "trim",
]


def test_dir_names_what_there_is_and_each_is_documented():
    assert dir(anser) == ENTRIES
    assert all(getattr(anser, name).__doc__ for name in ENTRIES)


def test_no_file_has_the_name_of_what_its_room_offers():
    """Once it is imported it would stand in the room instead: `anser.campaigns.answers` a module, not the function."""
    for stub in files("anser").rglob("__init__.pyi"):
        words = stub.read_text().partition("__all__")[2]
        offered = set(re.findall(r'"(\w+)"', words))
        assert offered
        assert not offered & {path.stem for path in stub.parent.glob("*.py")}, stub


def test_types_are_for_users_too():
    assert files("anser").joinpath("py.typed").is_file()


@pytest.mark.long
def test_a_type_checker_sees_every_signature(tmp_path):
    """What is unknown to it would pass; so each call has a wrong argument, and the checker must object to each."""
    lines = ["import anser", *(f"anser.{name}(no_such_argument=1)" for name in ENTRIES)]
    lines += ['reveal_type(anser.run("x.toml"))', 'reveal_type(anser.run("x.toml").plot.tracks())']
    program = tmp_path / "mine.py"
    program.write_text("\n".join(lines))
    checker = Path(sys.executable).parent / "basedpyright"
    command = [str(checker), "--outputjson", "--pythonpath", sys.executable, str(program)]
    told = json.loads(subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False).stdout)
    found = told["generalDiagnostics"]
    for number in range(1, 1 + len(ENTRIES)):
        rules = {one.get("rule") for one in found if one["range"]["start"]["line"] == number}
        assert "reportCallIssue" in rules, lines[number]
    revealed = [one["message"] for one in found if one["severity"] == "information"]
    assert [one.split('is "')[1].rstrip('"') for one in revealed] == ["Flown", "Figure"]


@pytest.mark.parametrize("entry", [anser.plan, anser.run, lambda given: anser.sweep(given, {"seed": [1]})])
def test_a_path_is_read_and_what_is_neither_is_refused(entry, tmp_path):
    with pytest.raises(ScenarioError, match="arrived no file of this name"):
        entry(tmp_path / "none.toml")
    with pytest.raises(ScenarioError, match="arrived no file of this name"):
        entry(str(tmp_path / "none.toml"))
    with pytest.raises(TypeError, match="scenario: arrived int; expected a scenario, or the path of its file"):
        entry(3)
