"""The Python interface: names, types, and scenarios by path."""

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
    "LinearFeedback",
    "Simulator",
    "aircraft",
    "campaign",
    "compare_campaigns",
    "doublet",
    "identify",
    "linearize",
    "live",
    "load",
    "load_campaign",
    "load_flight",
    "loads",
    "multisine",
    "plan",
    "progress_bar",
    "rare",
    "run",
    "simulate",
    "sine_sweep",
    "step_input",
    "sweep",
    "three_two_one_one",
    "trim",
]


def test_dir_lists_documented_names():
    assert dir(anser) == ENTRIES
    assert all(getattr(anser, name).__doc__ for name in ENTRIES)


def test_no_module_has_the_name_of_a_public_object_of_its_package():
    """Importing the module would replace the object: `anser.campaigns.answers` would be a module, not the function."""
    for stub in files("anser").rglob("__init__.pyi"):
        exports = stub.read_text().partition("__all__")[2]
        offered = set(re.findall(r'"(\w+)"', exports))
        assert offered
        assert not offered & {path.stem for path in stub.parent.glob("*.py")}, stub


def test_types_are_for_users_too():
    assert files("anser").joinpath("py.typed").is_file()


@pytest.mark.long
def test_a_type_checker_sees_every_signature(tmp_path):
    """Unknown types would pass. Each call has a wrong argument, and the checker must report each."""
    lines = ["import anser", *(f"anser.{name}(no_such_argument=1)" for name in ENTRIES)]
    lines += ['reveal_type(anser.run("x.toml"))', 'reveal_type(anser.run("x.toml").plot.tracks())']
    program = tmp_path / "mine.py"
    program.write_text("\n".join(lines))
    checker = Path(sys.executable).parent / "basedpyright"
    command = [str(checker), "--outputjson", "--pythonpath", sys.executable, str(program)]
    report = json.loads(subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False).stdout)
    diagnostics = report["generalDiagnostics"]
    for number in range(1, 1 + len(ENTRIES)):
        rules = {d.get("rule") for d in diagnostics if d["range"]["start"]["line"] == number}
        assert "reportCallIssue" in rules, lines[number]
    revealed = [d["message"] for d in diagnostics if d["severity"] == "information"]
    assert [d.split('is "')[1].rstrip('"') for d in revealed] == ["FlightResult", "Figure"]


@pytest.mark.parametrize("entry", [anser.plan, anser.run, lambda given: anser.sweep(given, {"seed": [1]})])
def test_a_path_is_read_and_other_types_are_refused(entry, tmp_path):
    with pytest.raises(ScenarioError, match="arrived no file of this name"):
        entry(tmp_path / "none.toml")
    with pytest.raises(ScenarioError, match="arrived no file of this name"):
        entry(str(tmp_path / "none.toml"))
    with pytest.raises(TypeError, match="scenario: arrived int; expected a scenario, or the path of its file"):
        entry(3)
