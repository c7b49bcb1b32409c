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
