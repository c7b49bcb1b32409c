"""Which software computed a result."""

import platform
from importlib.metadata import version

import anser

__all__ = ["versions"]


def versions() -> dict[str, str]:
    """Versions of anser and of all that its numbers depend on, by name."""
    libraries = {name: version(name) for name in ("jax", "equinox", "numpy")}
    return {"anser": anser.__version__, **libraries, "python": platform.python_version()}
