"""Commands on a full disk and with paths that the system refuses: one message, exit code 2, no partial files."""

import contextlib

import pytest

from anser.campaigns import flights
from anser.campaigns.store import CampaignStore
from anser.results import write_netcdf, write_summary
from campaigns.study_cases import STUDIES, made_up, text_of
from support.full_disk import full_disk
from support.made_flight import make_flight

SCENARIOS = STUDIES.parent / "scenarios"
ONE = SCENARIOS / "single-aircraft.toml"
OVERLONG = "x" * 300


def files(folder):
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*")}


@pytest.fixture
def run(tmp_path):
    dataset, summary = make_flight()
    (tmp_path / "run").mkdir()
    write_netcdf(dataset, tmp_path / "run" / "flight.nc")
    write_summary(summary, tmp_path / "run" / "summary.json")
    return tmp_path / "run"


WORDS = {
    "new": ("new", "{out}.toml"),
    "aircraft new": ("aircraft", "new", "{out}.toml"),
    "convert": ("convert", ONE, "{out}.toml", "--format", 1),
    "schema": ("schema", "--out", "{out}.json"),
    "report": ("report", "{run}", "--out", "{out}.html"),
    "export": ("export", "{run}", "--format", "csv,kml,czml,mat", "--period-s", 50, "--out", "{out}"),
    "export beside": ("export", "{run}", "--format", "kml", "--period-s", 50),
    "figures": ("figures", "{run}", "--out", "{out}", "--only", "tracks"),
    "trim map": ("aircraft", "show", "aerosonde", "--out", "{out}.png"),
    "plan": ("plan", ONE, "--out", "{out}"),
    "run": ("run", ONE, "--out", "{out}"),
}
HEAVY = {"figures", "trim map", "run", "plan"}


# JAX warns that it cannot keep a compiled operation, and goes on.
@pytest.mark.filterwarnings("ignore:Error writing persistent compilation cache entry")
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.long] if name in HEAVY else []) for name in WORDS]
)
def test_a_full_disk_is_one_message_and_leaves_nothing(anser, run, tmp_path, name):
    arguments = [str(word).format(run=run, out=tmp_path / "out") for word in WORDS[name]]
    original = files(tmp_path)
    with full_disk():
        code, _, said = anser(*arguments, "--quiet")
    assert code == 2, said
    assert "File too large" in said or "NetCDF" in said
    assert "Traceback" not in said
    assert "internal fault" not in said
    assert files(tmp_path) == original
    code, _, said = anser(*arguments)
    assert code in (0, 1), said  # nothing stands in the way of a second try


def _study(folder, text):
    (folder / "three.toml").write_text((SCENARIOS / "three-aircraft.toml").read_text())
    (folder / "study.toml").write_text(text)
    return folder / "study.toml"


RARE = """format = 1
name = "event"
description = "Rare"
scenario = "three.toml"

[rare]
statistic = "miss_m"
threshold = 9.0
flights = 60
level_share = 0.5
levels_max = 2
repetitions = 3

[[vary]]
path = "wind.speed_m_s"
distribution = "uniform"
low = 0.0
high = 1.0
"""


@pytest.mark.parametrize("command", ["campaign", "rare"])
@pytest.mark.parametrize("target", ["{study}/out", OVERLONG, "/dev/full/out", "/proc/none/out"])
def test_an_impossible_folder_is_refused_before_any_flight(anser, tmp_path, monkeypatch, command, target):
    monkeypatch.chdir(tmp_path)
    study = _study(tmp_path, text_of(flights=20) if command == "campaign" else RARE)
    monkeypatch.setattr(flights, "fly_many", lambda *_, **__: pytest.fail("flown"))
    original = files(tmp_path)
    code, _, said = anser(command, study, "--out", target.format(study=study), "--processes", 1)
    assert code == 2, said
    assert "Traceback" not in said
    assert files(tmp_path) == original


def test_a_campaign_on_a_full_disk_can_be_resumed(anser, tmp_path, monkeypatch):
    study, out = _study(tmp_path, text_of(flights=20)), tmp_path / "out"
    with contextlib.ExitStack() as disk:

        def flown_until_the_disk_is_full(cases, **_):
            disk.enter_context(full_disk(16))
            return made_up(cases)

        monkeypatch.setattr(flights, "fly_many", flown_until_the_disk_is_full)
        code, _, said = anser("campaign", study, "--out", out, "--processes", 1)
    assert code == 2, said
    assert "File too large" in said
    assert "0 of 20 flights; --resume flies the others" in said
    assert "Traceback" not in said
    monkeypatch.setattr(flights, "fly_many", made_up)
    assert anser("campaign", study, "--out", out, "--processes", 1, "--resume")[0] == 1
    assert CampaignStore.open(out).flown.size == 20


def test_a_campaign_that_does_not_fit_on_the_disk_leaves_no_folder(anser, tmp_path):
    study = _study(tmp_path, text_of(flights=20))
    with full_disk(16):
        code, _, said = anser("campaign", study, "--out", tmp_path / "out", "--processes", 1)
    assert code == 2, said
    assert not (tmp_path / "out").exists(), said
