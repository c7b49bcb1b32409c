"""Programs on disk: complete, under their key, and only from files that belong to the user."""

import logging
import os
import stat
import threading

import pytest

from anser.compiling.store import FolderStore

posix = pytest.mark.skipif(os.name != "posix", reason="owners and modes of files are those of POSIX")


@pytest.fixture
def store(tmp_path):
    filled = FolderStore(tmp_path / "programs")
    filled.save("a", b"code of a")
    filled.save("b", b"code of b")
    return filled


def warnings(caplog):
    return [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]


def test_a_program_moved_to_another_key_is_ignored(store):
    a, b = (store.folder / f"{key}.program" for key in "ab")
    b.write_bytes(a.read_bytes())
    assert store.load("a") == b"code of a"
    assert store.load("b") is None


@posix
def test_new_files_are_private_under_any_umask(tmp_path):
    former_mask = os.umask(0)
    try:
        store = FolderStore(tmp_path / "deep" / "programs")
        store.save("a", b"code")
    finally:
        os.umask(former_mask)
    assert stat.S_IMODE(store.folder.stat().st_mode) == 0o700
    assert stat.S_IMODE(store.files()[0].stat().st_mode) == 0o600
    assert store.load("a") == b"code"


@posix
@pytest.mark.parametrize("mode", [0o770, 0o777, 0o702])
def test_a_folder_writable_by_others_is_not_used_with_one_warning(store, caplog, mode):
    store.folder.chmod(mode)
    reopened = FolderStore(store.folder)
    assert [store.load("a"), store.load("b"), reopened.load("a")] == [None] * 3
    reopened.save("c", b"code of c")
    assert len(store.files()) == 2
    (message,) = warnings(caplog)
    assert str(store.folder) in message
    assert f"mode {mode:o}" in message
    store.folder.chmod(0o755)
    assert store.load("a") == b"code of a"


@posix
def test_a_file_writable_by_others_is_not_used_with_one_warning(store, caplog):
    path = store.folder / "a.program"
    path.chmod(0o666)
    assert [store.load("a"), store.load("a"), store.load("b")] == [None, None, b"code of b"]
    (message,) = warnings(caplog)
    assert str(path) in message
    store.save("a", b"new code")
    assert store.load("a") == b"new code"


@posix
def test_files_and_folders_of_another_user_are_not_used(store, caplog, monkeypatch):
    user_id = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: user_id + 1)
    assert store.load("a") is None
    store.save("c", b"code of c")
    assert not (store.folder / "c.program").exists()
    (message,) = warnings(caplog)
    assert f"another user (number {user_id}; this one is {user_id + 1})" in message


@posix
def test_links_and_special_files_are_not_read(store, tmp_path, caplog):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.write_bytes((store.folder / "a.program").read_bytes())
    (store.folder / "a.program").unlink()
    (store.folder / "a.program").symlink_to(elsewhere)
    (store.folder / "b.program").unlink()
    os.mkfifo(store.folder / "b.program")
    (store.folder / "c.program").mkdir()
    assert [store.load(key) for key in "abc"] == [None] * 3
    assert len(warnings(caplog)) == 3


@posix
def test_a_link_to_the_folder_works(store, tmp_path):
    (tmp_path / "link").symlink_to(store.folder)
    assert FolderStore(tmp_path / "link").load("a") == b"code of a"


def test_a_reserved_key_is_waited_for_and_other_keys_are_not(tmp_path):
    first, second = FolderStore(tmp_path / "programs"), FolderStore(tmp_path / "programs")
    events = []

    def wait_and_load():
        with second.reserve("a"):
            events.append(second.load("a"))

    with first.reserve("a"):
        waiting = threading.Thread(target=wait_and_load)
        waiting.start()
        with second.reserve("b"):
            pass
        waiting.join(0.2)
        assert waiting.is_alive()
        first.save("a", b"compiled")
    waiting.join(10.0)
    assert events == [b"compiled"]
    assert not list((tmp_path / "programs").glob(".lock-*"))


def test_a_reservation_in_an_unwritable_folder_waits_for_nobody(tmp_path):
    (tmp_path / "file").write_text("no folder")
    with FolderStore(tmp_path / "file" / "programs").reserve("a"):
        pass
