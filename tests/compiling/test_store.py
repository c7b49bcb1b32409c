"""Programs on disk: whole, of their own key, and from nobody but the user."""

import logging
import os
import stat

import pytest

from anser.compiling.store import FolderStore

posix = pytest.mark.skipif(os.name != "posix", reason="owners and modes of files are those of POSIX")


@pytest.fixture
def store(tmp_path):
    made = FolderStore(tmp_path / "programs")
    made.save("a", b"code of a")
    made.save("b", b"code of b")
    return made


def told(caplog):
    return [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]


def test_a_program_moved_to_another_key_is_none(store):
    a, b = (store.folder / f"{key}.program" for key in "ab")
    b.write_bytes(a.read_bytes())
    assert store.load("a") == b"code of a"
    assert store.load("b") is None


@posix
def test_what_it_makes_is_the_users_alone_under_any_umask(tmp_path):
    before = os.umask(0)
    try:
        store = FolderStore(tmp_path / "deep" / "programs")
        store.save("a", b"code")
    finally:
        os.umask(before)
    assert stat.S_IMODE(store.folder.stat().st_mode) == 0o700
    assert stat.S_IMODE(store.files()[0].stat().st_mode) == 0o600
    assert store.load("a") == b"code"


@posix
@pytest.mark.parametrize("mode", [0o770, 0o777, 0o702])
def test_a_folder_that_others_may_write_is_not_used_which_is_said_once(store, caplog, mode):
    store.folder.chmod(mode)
    again = FolderStore(store.folder)
    assert [store.load("a"), store.load("b"), again.load("a")] == [None] * 3
    again.save("c", b"code of c")
    assert len(store.files()) == 2
    (message,) = told(caplog)
    assert str(store.folder) in message
    assert f"mode {mode:o}" in message
    store.folder.chmod(0o755)
    assert store.load("a") == b"code of a"


@posix
def test_a_file_that_others_may_write_is_not_used_which_is_said_once(store, caplog):
    path = store.folder / "a.program"
    path.chmod(0o666)
    assert [store.load("a"), store.load("a"), store.load("b")] == [None, None, b"code of b"]
    (message,) = told(caplog)
    assert str(path) in message
    store.save("a", b"new code")
    assert store.load("a") == b"new code"


@posix
def test_files_and_folders_of_another_user_are_not_used(store, caplog, monkeypatch):
    own = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: own + 1)
    assert store.load("a") is None
    store.save("c", b"code of c")
    assert not (store.folder / "c.program").exists()
    (message,) = told(caplog)
    assert f"another user (number {own}; this one is {own + 1})" in message


@posix
def test_links_and_what_is_no_file_are_not_read(store, tmp_path, caplog):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.write_bytes((store.folder / "a.program").read_bytes())
    (store.folder / "a.program").unlink()
    (store.folder / "a.program").symlink_to(elsewhere)
    (store.folder / "b.program").unlink()
    os.mkfifo(store.folder / "b.program")
    (store.folder / "c.program").mkdir()
    assert [store.load(key) for key in "abc"] == [None] * 3
    assert len(told(caplog)) == 3


@posix
def test_a_folder_reached_by_a_link_is_its_target(store, tmp_path):
    (tmp_path / "link").symlink_to(store.folder)
    assert FolderStore(tmp_path / "link").load("a") == b"code of a"
