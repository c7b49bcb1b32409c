"""The cache of compiled programs: where it lies, how it is turned off, that it serves a second process, silently."""

import os
import subprocess
import sys

import jax
import platformdirs
import pytest

from anser.compiling import cache_folder
from anser.compiling.options import program_store
from anser.compiling.store import FolderStore

_KEPT = """
import jax.numpy as jnp
from anser.compiling.options import cache_folder, compiled, enable_compilation_cache
from anser.numerics.linear import solve3
enable_compilation_cache()
print(cache_folder(), compiled(solve3)(jnp.eye(3), jnp.arange(3.0)).tolist())
"""


def _run(program, setting, **environment):
    """What a process prints, on standard output and standard error."""
    inherited = {key: value for key, value in os.environ.items() if not key.startswith(("JAX_COMPILATION", "TF_CPP"))}
    inherited |= {"ANSER_COMPILATION_CACHE": setting, **environment}
    command = [sys.executable, "-W", "error", "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, env=inherited, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip(), done.stderr


def test_a_folder_of_the_users_choice_serves_any_order_of_imports_without_a_word(tmp_path):
    folder = tmp_path / "cache"
    expected = (f"{folder} [0.0, 1.0, 2.0]", "")
    assert _run(f"import anser{_KEPT}", str(folder)) == expected
    (kept,) = FolderStore(folder / "programs").files()
    used_ns = kept.stat().st_mtime_ns
    for first in ("import jax, anser", "import anser, jax"):
        assert _run(first + _KEPT, str(folder)) == expected
        assert FolderStore(folder / "programs").files() == [kept]  # the same program was found again
        assert kept.stat().st_mtime_ns > used_ns
        used_ns = kept.stat().st_mtime_ns
    assert [path.name for path in folder.iterdir()] == ["programs"]


def test_off_is_off(monkeypatch):
    monkeypatch.setenv("ANSER_COMPILATION_CACHE", "off")
    assert (cache_folder(), program_store()) == (None, None)


def test_the_default_lies_in_the_users_cache(monkeypatch):
    monkeypatch.setenv("ANSER_COMPILATION_CACHE", "")
    found = jax.config.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", None)
    try:
        assert cache_folder() == platformdirs.user_cache_path("anser") / "compiled"
    finally:
        jax.config.update("jax_compilation_cache_dir", found)


@pytest.mark.skipif(os.name != "posix", reason="modes of files are those of POSIX")
def test_a_folder_that_others_may_write_is_said_once_and_everything_is_computed(tmp_path):
    folder = tmp_path / "cache"
    (folder / "programs").mkdir(parents=True)
    (folder / "programs").chmod(0o777)
    printed, told = _run(f"import anser{_KEPT}{_KEPT}", str(folder))
    assert printed.count("[0.0, 1.0, 2.0]") == 2
    assert told.startswith(
        f"caution: {folder / 'programs'}: compiled programs there are not used: other users may write"
    )
    assert told.count("\n") == 1
    assert list((folder / "programs").iterdir()) == []


def test_without_a_home_folder_everything_is_computed_all_the_same():
    """The home is a place below a file, where no folder can be made."""
    environment = {"HOME": "/dev/null/nobody", "XDG_CACHE_HOME": ""}
    printed, told = _run(f"import anser{_KEPT}", "", **environment)
    assert (printed.endswith("[0.0, 1.0, 2.0]"), told) == (True, "")
