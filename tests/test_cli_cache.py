"""The command cache: what it says and does, whatever the folder is."""

import json

import pytest

from anser.compiling.options import program_store as store_of_the_suite
from anser.compiling.program import forget_programs, use_program_store
from anser.compiling.store import FolderStore

IN_USE = store_of_the_suite()


@pytest.fixture
def store(tmp_path, monkeypatch):
    """The store of this test alone, with two programs."""
    monkeypatch.setenv("ANSER_COMPILATION_CACHE", str(tmp_path))
    found = FolderStore(tmp_path / "programs")
    found.save("a", bytes(1000))
    found.save("b", bytes(2000))
    yield found
    use_program_store(IN_USE)


def test_it_says_where_and_how_large(anser, store):
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


def test_it_clears(anser, store):
    code, out, err = anser("cache", "clear")
    assert code == 0
    assert "2 programs deleted" in err
    assert "0 programs" in out
    assert store.files() == []


def test_off_and_wrong_input(anser, store, monkeypatch, tmp_path):
    code, _, err = anser("cache", "show", "--scenario", "mine.toml")
    assert code == 2
    assert "--scenario: arrived with show; expected only with warm" in err.replace("\n", " ")
    code, _, err = anser("cache", "warm", "--scenario", tmp_path / "none.toml")
    assert code == 2
    assert "none.toml" in err
    monkeypatch.setenv("ANSER_COMPILATION_CACHE", "off")
    for what in ("show", "warm", "clear"):
        code, out, _ = anser("cache", what)
        assert code == 0
        assert "nothing is kept" in out
    assert len(store.files()) == 2


@pytest.mark.long
def test_what_is_warm_is_loaded(anser, store, tmp_path):
    store.clear()
    forget_programs()
    assert anser("new", tmp_path / "mine.toml")[0] == 0
    code, out, _ = anser("cache", "warm")
    assert code == 0
    kept = {path.name for path in store.files()}
    assert f"{len(kept)} programs" in out
    assert len(kept) >= 5
    forget_programs()
    assert anser("run", tmp_path / "mine.toml", "--out", tmp_path / "run")[0] == 0
    made = [path.name for path in store.files() if path.name not in kept]
    assert len(made) <= 3  # limits, places on the Earth: small
