"""Impossible paths and devices: one message, exit code 2, nothing written."""

import os

import pytest

from anser import campaign, load, load_flight
from anser.campaigns.rare_flights import RareStore
from anser.campaigns.store import CampaignStore
from anser.config import ScenarioError
from anser.files import new_folder, write_file
from support.tiny_run import make_run

ODD = {
    "overlong": "x" * 300,
    "overlong folder": "x" * 300 + "/file",
    "within a device": "/dev/null/file",
    "within a file": "{run}/flight.nc/file",
    "absent": "none/file",
    "no UTF-8": "none/\udcff",
    "folder of the system": "/proc/none",
}
WORDS = [
    ("check", "{odd}"),
    ("plan", "{odd}"),
    ("run", "{odd}"),
    ("run", "{scenario}", "--plan", "{odd}"),
    ("run", "--campaign", "{odd}", "--flight", "1"),
    ("sweep", "{odd}", "--set", "wind.speed_m_s=0,1", "--out", "{folder}/out"),
    ("campaign", "{odd}", "--out", "{folder}/out"),
    ("campaign", "report", "{odd}"),
    ("campaign", "compare", "{odd}", "{odd}"),
    ("rare", "{odd}", "--out", "{folder}/out"),
    ("report", "{odd}"),
    ("report", "{run}", "--out", "{odd}"),
    ("figures", "{odd}", "--out", "{folder}/out"),
    ("export", "{odd}", "--format", "csv"),
    ("convert", "{odd}", "{folder}/out.toml"),
    ("convert", "{scenario}", "{odd}"),
    ("aircraft", "check", "{odd}.toml"),
    ("aircraft", "show", "{odd}.toml"),
    ("schema", "--out", "{odd}.json"),
    ("cache", "warm", "--scenario", "{odd}"),
]
REFUSED_BY_THE_FOLDER = [("new", "{odd}"), ("aircraft", "new", "{odd}.toml"), ("figures", "{run}", "--out", "{odd}")]


@pytest.mark.parametrize("kind", ODD)
def test_odd_paths_are_one_message(anser, tmp_path, kind, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {"run": make_run(tmp_path / "run"), "folder": tmp_path, "scenario": tmp_path / "mine.toml"}
    assert anser("new", tmp_path / "mine.toml")[0] == 0
    names["odd"] = ODD[kind].format(**names)
    original = sorted(path for path in tmp_path.rglob("*"))
    makes_parents = kind in ("absent", "no UTF-8")
    for arguments in WORDS if makes_parents else WORDS + REFUSED_BY_THE_FOLDER:
        code, printed, said = anser(*(word.format(**names) for word in arguments))
        assert (code, printed) == (2, ""), arguments
        assert "Traceback" not in said
        assert "internal fault" not in said, arguments
        assert sorted(path for path in tmp_path.rglob("*")) == original, arguments


@pytest.mark.parametrize(
    "use", [load, load_flight, lambda path: CampaignStore.open(path), lambda path: RareStore.open(path)]
)
def test_a_null_character_in_a_path_is_refused_on_reading(use, tmp_path):
    with pytest.raises(ValueError, match="arrived"):
        use(tmp_path / "a\0b")


def test_a_null_character_in_a_path_is_refused_on_writing(tmp_path):
    with pytest.raises(OSError, match="null character"):
        write_file(tmp_path / "a\0b", "x")
    with pytest.raises(OSError, match="null character"), new_folder(tmp_path / "a\0b"):
        pass


def test_a_null_character_in_a_path_within_a_file_is_refused(anser, tmp_path):
    assert anser("new", tmp_path / "mine.toml")[0] == 0
    text = (tmp_path / "mine.toml").read_text()
    with_null = text.replace("[[aircraft]]\n", '[[aircraft]]\nairframe = "a\\u0000b.toml"\n', 1)
    (tmp_path / "named.toml").write_text(with_null)
    with pytest.raises(ScenarioError, match="airframe"):
        load(tmp_path / "named.toml")
    (tmp_path / "study.toml").write_text(
        'format = 1\nname = "odd"\ndescription = "x"\nscenario = "a\\u0000b.toml"\nseed = 1\n'
        '[sampling]\nmethod = "monte-carlo"\nflights = 2\n'
    )
    with pytest.raises(ScenarioError):
        campaign(tmp_path / "study.toml", tmp_path / "out")
    assert not os.path.lexists(tmp_path / "out")
