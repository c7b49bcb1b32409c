"""The command cache."""

import json
from pathlib import Path

import pytest

from anser.compiling.options import program_store as store_of_the_suite
from anser.compiling.program import forget_programs, use_program_store
from anser.compiling.store import FolderStore

IN_USE = store_of_the_suite()


@pytest.fixture
def store(tmp_path, monkeypatch):
    """Program store of this test, with two programs."""
    monkeypatch.setenv("ANSER_COMPILATION_CACHE", str(tmp_path))
    store = FolderStore(tmp_path / "programs")
    store.save("a", bytes(1000))
    store.save("b", bytes(2000))
    yield store
    use_program_store(IN_USE)


def test_the_folder_and_size_are_printed(anser, store):
    code, out, _ = anser("cache")
    assert code == 0
    assert "2 programs" in out
    assert str(store.folder) in out.replace("\n", "")
    code, out, err = anser("cache", "--json")
    document = json.loads(out)
    assert (code, err) == (0, "")
    assert document["programs"] == 2
    assert document["size_bytes"] == sum(path.stat().st_size for path in store.files())
    assert document["folder"] == str(store.folder)


def test_the_programs_are_deleted(anser, store):
    code, out, err = anser("cache", "clear")
    assert code == 0
    assert "2 programs deleted" in err
    assert "0 programs" in out
    assert store.files() == []


def test_off_and_wrong_input(anser, store, monkeypatch, tmp_path):
    code, _, err = anser("cache", "show", "--scenario", "mine.toml")
    assert code == 2
    assert "--scenario: arrived with show; expected only with warm or measure" in err.replace("\n", " ")
    code, _, err = anser("cache", "warm", "--scenario", tmp_path / "none.toml")
    assert code == 2
    assert "none.toml" in err
    monkeypatch.setenv("ANSER_COMPILATION_CACHE", "off")
    for action in ("show", "warm", "clear"):
        code, out, _ = anser("cache", action)
        assert code == 0
        assert "nothing is kept" in out
    assert len(store.files()) == 2


@pytest.mark.long
def test_warm_programs_are_loaded(anser, store, tmp_path):
    store.clear()
    forget_programs()
    assert anser("new", tmp_path / "mine.toml")[0] == 0
    code, out, _ = anser("cache", "warm")
    assert code == 0
    warm_programs = {path.name for path in store.files()}
    assert f"{len(warm_programs)} programs" in out
    assert len(warm_programs) >= 5
    forget_programs()
    assert anser("run", tmp_path / "mine.toml", "--out", tmp_path / "run")[0] == 0
    new_programs = [path.name for path in store.files() if path.name not in warm_programs]
    assert len(new_programs) <= 3  # limits, places on the Earth: small


@pytest.mark.long
def test_a_measurement_prints_what_programs_cost(anser, store):
    scenario = Path(__file__).parents[1] / "scenarios" / "climb-and-turn.toml"
    code, out, err = anser("cache", "measure", "--scenario", scenario, "--json")
    assert code == 0, err
    (budget,) = json.loads(out)["scenarios"]
    assert budget["equations"] == sum(program["equations"] for program in budget["programs"])
    assert "flight" in {program["title"] for program in budget["programs"]}
    assert budget["second_cpu_s"] < budget["first_cpu_s"]
    assert len(store.files()) == 2  # the user's own store is untouched
