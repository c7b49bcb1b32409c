"""What was compiled once for a shape of scenario is not compiled again."""

import os
from pathlib import Path

import jax
import platformdirs

from anser.compiling.program import use_program_store
from anser.compiling.store import FolderStore

VARIABLE = "ANSER_COMPILATION_CACHE"
"""Environment variable: a folder to use instead of the user's cache folder, or "off"."""


def cache_folder() -> Path | None:
    """Folder of the cache: what `ANSER_COMPILATION_CACHE` says, JAX's own `jax_compilation_cache_dir`, or the user's.

    None where that variable is "off", or where the user has no folder.
    """
    wanted = os.environ.get(VARIABLE, "")
    if wanted.lower() == "off":
        return None
    already: str | None = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    folder = Path(wanted or already or platformdirs.user_cache_path("anser") / "compiled")
    return folder if wanted or already or folder.is_absolute() else None


def program_store() -> FolderStore | None:
    """Store of compiled programs in the cache's folder; None without one."""
    folder = cache_folder()
    return None if folder is None else FolderStore(folder / "programs")


def enable_compilation_cache() -> Path | None:
    """Keep programs in `cache_folder`, which is returned; None: they are kept nowhere."""
    use_program_store(program_store())
    return cache_folder()
