"""A file of another kind is refused in one sentence, with the right command."""

from pathlib import Path

import pytest

from anser.aircraft_files import read_airframe
from anser.aircraft_files.sources import write_airframe_starter
from anser.campaigns import load_study
from anser.config import ScenarioError
from anser.scenario import load, write_starter

ROOT = Path(__file__).parents[2]
STUDY, RARE = ROOT / "studies" / "how-surely.toml", ROOT / "studies" / "how-rarely.toml"


def _refused(read, path) -> str:
    with pytest.raises(ScenarioError) as refused:
        read(path)
    (problem,) = refused.value.problems
    return str(problem)


@pytest.mark.parametrize(
    ("path", "message"),
    [
        (STUDY, f"arrived a study file, by its tables; expected a scenario file; for this one: anser campaign {STUDY}"),
        (RARE, f"a scenario file; for this one: anser rare {RARE} --out FOLDER"),
    ],
)
def test_a_study_is_no_scenario(path, message):
    assert message in _refused(load, path)


def test_an_aircraft_is_no_scenario_and_a_scenario_neither_a_study_nor_an_aircraft(tmp_path):
    aircraft, scenario = tmp_path / "my-uav.toml", tmp_path / "mine.toml"
    write_airframe_starter(aircraft)
    write_starter(scenario)
    assert f"a scenario file; for this one: anser aircraft check {aircraft}" in _refused(load, aircraft)
    assert f"a study file; for this one: anser check {scenario}" in _refused(load_study, scenario)
    assert f"an aircraft file; for this one: anser check {scenario}" in _refused(read_airframe, scenario)


def test_a_bare_name_suggests_a_shipped_scenario(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    for name in ("three-aircraft", "three-aircraft.toml"):
        assert 'perhaps "scenarios/three-aircraft.toml"' in _refused(load, name)
    monkeypatch.chdir(tmp_path)
    elsewhere = _refused(load, "three-aircraft")
    assert "perhaps" not in elsewhere
    assert "anser new three-aircraft.toml --from three-aircraft" in elsewhere
