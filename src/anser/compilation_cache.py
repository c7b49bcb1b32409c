"""JAX's persistent compilation cache: what was compiled once for a shape of scenario is not compiled again."""

import os
from pathlib import Path

import jax
import platformdirs

VARIABLE = "ANSER_COMPILATION_CACHE"
"""Environment variable: a folder to use instead of the user's cache folder, or "off"."""


def enable_compilation_cache() -> Path | None:
    """Turn the cache on, in the user's cache folder or where `ANSER_COMPILATION_CACHE` says; returns the folder.

    Does nothing where that variable is "off", or where the user has set JAX's own `jax_compilation_cache_dir`.
    """
    wanted = os.environ.get(VARIABLE, "")
    if wanted.lower() == "off":
        return None
    already: str | None = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    if already:
        return Path(already)
    folder = Path(wanted) if wanted else platformdirs.user_cache_path("anser") / "compiled"
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    return folder
