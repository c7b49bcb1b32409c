"""Output files and folders: complete or absent, however the writing ends."""

import os
import signal
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from anser.files import defer_interrupts, new_file, new_folder, remove_temporary_outputs, staged_folder, write_file
from anser.report.style import new_figure, save_figure
from anser.results import write_netcdf
from anser.results.documents import write_json
from support.full_disk import full_disk


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "deep").mkdir()
    for name in ("flight.nc", "notes.txt", "deep/old.svg"):
        (tmp_path / name).write_text("old")
    return tmp_path


def content(folder):
    return {path.relative_to(folder).as_posix(): path.read_text() for path in folder.rglob("*") if path.is_file()}


def test_files_of_the_same_names_are_replaced_and_all_others_stay(folder):
    with staged_folder(folder) as into:
        (into / "flight.nc").write_text("new")
        (into / "deep").mkdir()
        (into / "deep" / "new.svg").write_text("new")
        assert content(folder)["flight.nc"] == "old"
    expected = {"flight.nc": "new", "notes.txt": "old", "deep/old.svg": "old", "deep/new.svg": "new"}
    assert content(folder) == expected


def test_a_failed_write_changes_nothing(folder):
    original = content(folder)

    def stopped():
        with staged_folder(folder) as into:
            (into / "flight.nc").write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped()
    assert content(folder) == original


def test_a_folder_with_a_file_s_name_is_refused_before_any_replacement(folder):
    original = content(folder)

    def in_the_way():
        with staged_folder(folder) as into:
            (into / "flight.nc").write_text("new")
            (into / "deep").write_text("new")

    with pytest.raises(FileExistsError, match="deep is a folder"):
        in_the_way()
    assert content(folder) == original


def _figure(path):
    figure = new_figure((2.0, 2.0))[1]
    figure.subplots().plot(np.sin(np.arange(300.0)))
    save_figure(figure, [path])


WRITERS = {
    "text.html": lambda path: write_file(path, "x" * 10_000),
    "document.json": lambda path: write_json({"x": [0.0] * 1000}, path),
    "data.nc": lambda path: write_netcdf(xr.Dataset({"x": ("time", np.random.default_rng(1).random(9000))}), path),
    "plan.npy": lambda path: _array(path),
    "figure.png": _figure,
    "figure.svg": _figure,
    "figure.pdf": _figure,
}


def _array(path):
    with new_file(path) as partial:
        partial.write_bytes(bytes(1000))


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_leaves_no_file_and_the_error_names_the_target(tmp_path, name):
    with full_disk(), pytest.raises(OSError, match=name.replace(".", r"\.")) as refused:
        WRITERS[name](tmp_path / name)
    assert refused.value.filename == str(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_replaced_only_on_request_by_a_complete_file(tmp_path):
    path = tmp_path / "file.json"
    write_file(path, "old")
    with pytest.raises(FileExistsError, match="not overwritten"):
        write_file(path, "new")

    def stopped():
        with new_file(path, overwrite=True) as partial:
            partial.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped()
    assert content(tmp_path) == {"file.json": "old"}
    write_file(path, "new", overwrite=True)
    assert content(tmp_path) == {"file.json": "new"}


def test_no_device_is_replaced():
    with pytest.raises(FileExistsError, match="/dev/null is a device"):
        write_file(Path(os.devnull), "x", overwrite=True)


def test_a_new_folder_and_its_parents_stay_only_if_complete(tmp_path):
    def failing(error):
        with new_folder(tmp_path / "deep" / "new") as staging:
            (staging / "file").write_text("half")
            raise error

    for error in (OSError("full"), KeyboardInterrupt()):
        with pytest.raises(type(error)):
            failing(error)
        assert list(tmp_path.iterdir()) == []
    with new_folder(tmp_path / "deep" / "new") as staging:
        (staging / "inner").mkdir()
        (staging / "inner" / "file").write_text("whole")
    assert content(tmp_path) == {"deep/new/inner/file": "whole"}
    with pytest.raises(FileExistsError), new_folder(tmp_path / "deep"):
        pass


def test_an_error_within_a_new_folder_names_the_target(tmp_path):
    def written_on_a_full_disk():
        with full_disk(), new_folder(tmp_path / "new") as staging:
            write_file(staging / "file.json", "x" * 10_000)

    with pytest.raises(OSError, match=r"new/file\.json") as refused:
        written_on_a_full_disk()
    assert refused.value.filename == str(tmp_path / "new" / "file.json")


def test_an_interrupt_waits_for_steps_that_belong_together():
    steps = []

    def interrupted():
        with defer_interrupts():
            os.kill(os.getpid(), signal.SIGINT)
            steps.append("first")
            steps.append("second")
        steps.append("third")

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert steps == ["first", "second"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_unfinished_files_are_removed_at_an_abrupt_exit(tmp_path):
    with new_file(tmp_path / "file") as partial:
        partial.write_text("half")
        remove_temporary_outputs()
        assert list(tmp_path.iterdir()) == []
        partial.write_text("whole")
    assert content(tmp_path) == {"file": "whole"}
