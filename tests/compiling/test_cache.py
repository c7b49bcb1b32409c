"""The compilation cache: where it lies, how it is turned off, that it serves a second process."""

import os
import subprocess
import sys

_PROGRAM = """
import jax, jax.numpy as jnp
import anser
from anser.compiling import enable_compilation_cache
print(enable_compilation_cache())
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
jax.jit(lambda x: jnp.sin(x) * 2.0)(1.0)
"""


def _run(setting):
    environment = {**os.environ, "ANSER_COMPILATION_CACHE": setting}
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)
    done = subprocess.run([sys.executable, "-c", _PROGRAM], capture_output=True, text=True, env=environment, check=True)
    return done.stdout.strip()


def test_a_folder_of_the_users_choice_is_filled_and_off_is_off(tmp_path):
    folder = tmp_path / "cache"
    assert _run(str(folder)) == str(folder)
    assert any(folder.iterdir())
    assert _run("off") == "None"


def test_the_default_lies_in_the_users_cache(monkeypatch):
    import platformdirs

    assert _run("") == str(platformdirs.user_cache_path("anser") / "compiled")


_KEPT = """
import jax.numpy as jnp
from anser.compiling import compiled, enable_compilation_cache
from anser.numerics import solve3
enable_compilation_cache()
print(compiled(solve3)(jnp.eye(3), jnp.arange(3.0)).tolist())
"""


def test_without_a_home_folder_everything_is_computed_all_the_same():
    """The home is a place below a file, where no folder can be made."""
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("XDG_", "JAX_COMPILATION"))}
    environment |= {"HOME": "/dev/null/nobody", "ANSER_COMPILATION_CACHE": ""}
    command = [sys.executable, "-W", "error", "-c", _KEPT]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert (done.returncode, done.stdout.strip()) == (0, "[0.0, 1.0, 2.0]"), done.stderr
