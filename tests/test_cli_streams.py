"""Closed, full or unread standard output: files are written, and the exit code reports the failure."""

import os
import subprocess
import sys

import pytest

from anser.cli.process import GuardedStream, guarded_streams

FULL = "/dev/full"
needs_full = pytest.mark.skipif(not os.path.exists(FULL), reason="no device that is always full")


def _new(folder, out):
    command = [sys.executable, "-m", "anser", "aircraft", "new", folder / "mine.toml", "--json", "--quiet"]
    completed = subprocess.run([*map(str, command)], stdout=out, stderr=subprocess.PIPE, text=True, check=False)
    assert (folder / "mine.toml").stat().st_size > 1000
    return completed.returncode, completed.stderr


def test_a_closed_pipe_ends_printing_only(tmp_path):
    reading, writing = os.pipe()
    os.close(reading)
    assert _new(tmp_path, writing) == (0, "")
    os.close(writing)


@needs_full
def test_a_full_standard_output_is_reported_once_and_files_are_written(tmp_path):
    with open(FULL, "w") as full:
        code, said = _new(tmp_path, full)
    assert code == 2
    assert said == (
        "standard output: arrived a stream that cannot be written (No space left on device); expected one that can\n"
    )


@needs_full
def test_a_stream_goes_silent_at_its_first_failure():
    with open(FULL, "w") as full:
        stream = GuardedStream(full)
        stream.write("lost")
        stream.flush()
        assert stream.failure is not None
        stream.write("nothing")
        stream.flush()
        assert (stream.encoding, stream.isatty()) == ("UTF-8", False)


def test_characters_outside_the_encoding_are_escaped(monkeypatch, tmp_path):
    with (tmp_path / "out").open("w", encoding="ascii") as out:
        monkeypatch.setattr(sys, "stdout", out)
        with guarded_streams() as unwritten:
            print("\u00fc \udcff")  # noqa: T201
            assert unwritten() is None
        assert sys.stdout is out
    assert (tmp_path / "out").read_text() == "\\xfc \\udcff\n"


def test_commands_run_without_a_standard_output(tmp_path):
    program = "import os, sys; os.close(1); sys.stdout = None; sys.argv = sys.argv[1:]; import anser.cli as c; c.main()"
    arguments = ["anser", "new", str(tmp_path / "mine.toml"), "--json", "--quiet"]
    completed = subprocess.run([sys.executable, "-c", program, *arguments], capture_output=True, text=True, check=False)
    assert (completed.returncode, completed.stderr) == (0, "")
    assert (tmp_path / "mine.toml").stat().st_size > 1000
