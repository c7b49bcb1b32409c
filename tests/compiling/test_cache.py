"""The cache of compiled programs: folder, disabling, and reuse by a second process without messages."""

import os
import subprocess
import sys

import jax
import platformdirs
import pytest

from anser.compiling import cache_folder
from anser.compiling.options import program_store
from anser.compiling.store import FolderStore

_PROGRAM = """
import jax.numpy as jnp
from anser.compiling.options import cache_folder, compiled, enable_compilation_cache
from anser.numerics.linear import solve3
enable_compilation_cache()
print(cache_folder(), compiled(solve3)(jnp.eye(3), jnp.arange(3.0)).tolist())
"""


def _run(program, setting, **environment):
    """Return a process's standard output and standard error."""
    inherited = {key: value for key, value in os.environ.items() if not key.startswith(("JAX_COMPILATION", "TF_CPP"))}
    inherited |= {"ANSER_COMPILATION_CACHE": setting, **environment}
    command = [sys.executable, "-W", "error", "-c", program]
    process = subprocess.run(command, capture_output=True, text=True, env=inherited, check=False)
    assert process.returncode == 0, process.stderr
    return process.stdout.strip(), process.stderr


@pytest.mark.long
def test_a_chosen_folder_works_with_any_order_of_imports_silently(tmp_path):
    folder = tmp_path / "cache"
    expected = (f"{folder} [0.0, 1.0, 2.0]", "")
    assert _run(f"import anser{_PROGRAM}", str(folder)) == expected
    (stored,) = FolderStore(folder / "programs").files()
    used_ns = stored.stat().st_mtime_ns
    assert _run(f"import jax, anser{_PROGRAM}", str(folder)) == expected
    assert FolderStore(folder / "programs").files() == [stored]  # the same program was found again
    assert stored.stat().st_mtime_ns > used_ns
    assert [path.name for path in folder.iterdir()] == ["programs"]


def test_the_setting_off_disables_the_cache(monkeypatch):
    monkeypatch.setenv("ANSER_COMPILATION_CACHE", "off")
    assert (cache_folder(), program_store()) == (None, None)


def test_the_default_folder_is_in_the_users_cache(monkeypatch):
    monkeypatch.setenv("ANSER_COMPILATION_CACHE", "")
    former_folder = jax.config.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", None)
    try:
        assert cache_folder() == platformdirs.user_cache_path("anser") / "compiled"
    finally:
        jax.config.update("jax_compilation_cache_dir", former_folder)


@pytest.mark.long
@pytest.mark.skipif(os.name != "posix", reason="modes of files are those of POSIX")
def test_a_folder_writable_by_others_gives_one_warning_and_is_not_used(tmp_path):
    folder = tmp_path / "cache"
    (folder / "programs").mkdir(parents=True)
    (folder / "programs").chmod(0o777)
    printed, warning = _run(f"import anser{_PROGRAM}{_PROGRAM}", str(folder))
    assert printed.count("[0.0, 1.0, 2.0]") == 2
    assert warning.startswith(
        f"caution: {folder / 'programs'}: compiled programs there are not used: other users may write"
    )
    assert warning.count("\n") == 1
    assert list((folder / "programs").iterdir()) == []


@pytest.mark.long
def test_programs_are_computed_without_a_home_folder():
    """The home is a path below a file, where no folder can be created."""
    environment = {"HOME": "/dev/null/nobody", "XDG_CACHE_HOME": ""}
    printed, warning = _run(f"import anser{_PROGRAM}", "", **environment)
    assert (printed.endswith("[0.0, 1.0, 2.0]"), warning) == (True, "")
