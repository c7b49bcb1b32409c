"""Output of commands: new folders and files; with --force existing files are replaced, and other files stay."""

import json
import os
import re

import pytest

from anser.cli.console import InputError
from anser.cli.folders import must_be_new_file, open_output_file, open_output_folder
from support.made_flight import make_flight
from support.tiny_run import make_run
from test_cli_everywhere import COMMANDS, THREE

GOES_ON = {"campaign fly", "rare"}
"""They do not replace hours of flying: --resume goes on with it."""


def test_every_writing_command_has_force():
    options = {
        name: {option for parameter in command.params for option in parameter.opts}
        for name, command in COMMANDS.items()
    }
    writing = {name for name, known in options.items() if known & {"--out", "--bode", "--picture"}}
    assert {name for name, known in options.items() if "--force" in known} == writing - GOES_ON
    assert {"run", "plan", "sweep", "figures", "export", "gallery", "envelope", "margins", "robustness"} <= writing
    assert all("--resume" in options[name] for name in GOES_ON)


def _failing(writing, error):
    """Write partially, then fail."""
    with writing as target:
        (target / "flight.nc" if target.is_dir() else target).write_text("half")
        raise error


def test_an_empty_new_folder_is_removed(tmp_path):
    with open_output_folder(tmp_path / "deep" / "new") as into:
        (into / "file").touch()
    assert (tmp_path / "deep" / "new" / "file").exists()
    with pytest.raises(ValueError, match="failed"), open_output_folder(tmp_path / "none"):
        raise ValueError("failed")
    assert not (tmp_path / "none").exists()


def test_an_existing_folder_is_refused_without_force(tmp_path):
    with (
        pytest.raises(InputError, match="which exists; expected a new folder, or --force"),
        open_output_folder(tmp_path),
    ):
        pass
    (tmp_path / "file").touch()
    for force in (False, True):
        with (
            pytest.raises(InputError, match="which exists; expected a folder"),
            open_output_folder(tmp_path / "file", force),
        ):
            pass


def test_with_force_a_failure_leaves_the_existing_files(tmp_path):
    (tmp_path / "flight.nc").write_text("old")
    with pytest.raises(OSError, match="elsewhere"):
        _failing(open_output_folder(tmp_path, True), OSError("elsewhere"))
    assert [path.name for path in tmp_path.iterdir()] == ["flight.nc"]
    assert (tmp_path / "flight.nc").read_text() == "old"
    (tmp_path / "sweep.nc").mkdir()
    with pytest.raises(InputError, match=r"sweep\.nc is a folder"), open_output_folder(tmp_path, True) as into:
        (into / "sweep.nc").touch()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_an_unwritable_folder_is_bad_input(tmp_path):
    tmp_path.chmod(0o500)
    with (
        pytest.raises(InputError, match="a folder in which files can be replaced"),
        open_output_folder(tmp_path, True),
    ):
        pass


def test_a_file_is_replaced_only_with_force(tmp_path):
    picture = tmp_path / "bode.svg"
    picture.write_text("old")
    with pytest.raises(InputError, match=r"--bode: arrived .* which exists; expected a new file, or --force"):
        must_be_new_file("--bode", picture, (".svg",))
    must_be_new_file("--bode", picture, (".svg",), True)
    with pytest.raises(RuntimeError):
        _failing(open_output_file("--bode", picture, True), RuntimeError())
    assert picture.read_text() == "old"
    with open_output_file("--bode", picture, True) as file:
        file.write_text("new")
    assert picture.read_text() == "new"
    with pytest.raises(InputError, match=r"ends with \.svg$"):
        must_be_new_file("--bode", tmp_path / "bode.txt", (".svg",), True)


def test_figures_replace_those_of_the_same_names(anser, tmp_path, monkeypatch):
    def draw(dataset, name, folder, **settings):
        paths = [folder / f"{name}-tracks{suffix}" for suffix in (".pdf", ".svg")]
        for path in paths:
            path.write_text("new")
        return paths

    monkeypatch.setattr("anser.report.flight_figures.draw_flight", draw)
    run, out = make_run(tmp_path / "run"), tmp_path / "figures"
    out.mkdir()
    for name in ("notes.txt", "flight-tracks.svg"):
        (out / name).write_text("old")
    assert anser("figures", run, "--out", out)[0] == 2
    code, printed, _ = anser("figures", run, "--out", out, "--force", "--json")
    assert code == 0
    assert json.loads(printed)["files"] == [str(out / f"flight-tracks{suffix}") for suffix in (".pdf", ".svg")]
    contents = {path.name: path.read_text() for path in out.iterdir()}
    assert contents == {"notes.txt": "old", "flight-tracks.svg": "new", "flight-tracks.pdf": "new"}


@pytest.fixture
def fake(monkeypatch):
    """A simulated flight; the arguments of its calls are recorded."""
    calls = []

    class Flown:
        dataset, summary = make_flight()
        met = True

        class planned:
            notes = problems = staticmethod(tuple)

        def write_into(self, folder):
            for name in ("flight.nc", "summary.json", "report.html"):
                (folder / name).write_text(f"flight {len(calls)}")

    def fly(scenario, *_):
        calls.append(scenario)
        return Flown()

    monkeypatch.setattr("anser.missions.runs.run", fly)
    return calls


def test_a_run_by_force_replaces_the_run_and_leaves_other_files(anser, tmp_path, fake):
    out = tmp_path / "run"
    assert anser("run", THREE, "--out", out)[0] == 0
    (out / "notes.txt").write_text("mine")
    code, _, err = anser("run", THREE, "--out", out)
    assert code == 2
    assert re.search(r"--out: arrived .*run, which exists; expected a new folder, or --force", err)
    assert anser("run", THREE, "--out", out, "--force")[0] == 0
    assert {path.name: path.read_text() for path in out.iterdir()} == {
        "flight.nc": "flight 2",
        "summary.json": "flight 2",
        "report.html": "flight 2",
        "notes.txt": "mine",
    }


def test_a_run_by_force_without_out_replaces_the_first_run(anser, tmp_path, fake, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for force in ((), (), ("--force",)):
        assert anser("run", THREE, *force)[0] == 0
    runs = {path.name: (path / "flight.nc").read_text() for path in (tmp_path / "runs").iterdir()}
    assert runs == {"three-aircraft": "flight 3", "three-aircraft-2": "flight 2"}
