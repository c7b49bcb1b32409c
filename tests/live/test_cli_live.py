"""The command `anser live` as a user meets it: the address, Ctrl-C, and wrong input."""

import signal
import subprocess
import sys
import urllib.request

import pytest

from anser.config.shipped_files import shipped_files
from anser.live.notebook import live
from anser.scenario.files import load
from anser.scenario.user_parts import UserParts, attach_parts


def test_the_address_serves_until_ctrl_c(tmp_path):
    command = [sys.executable, "-m", "anser", "live", "--no-open", "--folder", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            address = process.stdout.readline().split()[-1]
            assert address.startswith("http://127.0.0.1:")
            with urllib.request.urlopen(address, timeout=20) as answer:
                assert b"anser live" in answer.read()
            process.send_signal(signal.SIGINT)
            assert process.wait(20) == 130
        finally:
            process.kill()
    assert not list(tmp_path.iterdir())


def test_wrong_input_is_refused_before_anything_is_served(anser, tmp_path):
    code, _, err = anser("live", "--folder", tmp_path / "none", "--no-open")
    assert code == 2
    assert "expected an existing folder" in err
    code, _, err = anser("live", tmp_path / "none.toml", "--no-open")
    assert code == 2
    assert "no file of this name" in err
    broken = tmp_path / "broken.toml"
    for text in ("format = 2\n", "format = 2\nwind = 5\n"):
        broken.write_text(text)
        code, _, err = anser("live", broken, "--no-open")
        assert code == 2
        assert "problems" in err


def test_parts_attached_as_objects_are_refused():
    """A file that the page saves could not name them."""
    scenario = attach_parts(load(shipped_files()["single-aircraft"]), UserParts(controller=object()))
    with pytest.raises(ValueError, match=r"parts attached as objects \(controller\).*table \[parts\]"):
        live(scenario)


def test_a_notebook_shows_the_page(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_bytes(shipped_files()["single-aircraft"].read_bytes())
    page = live(file)
    try:
        assert f'src="{page.url}"' in page._repr_html_()
        with urllib.request.urlopen(page.url, timeout=20) as answer:
            assert "localhost" in answer.headers["content-security-policy"]
    finally:
        page.close()
    with pytest.raises(OSError):  # noqa: PT011
        urllib.request.urlopen(page.url, timeout=5)
