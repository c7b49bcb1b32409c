"""Which software computed a result."""

import platform
from importlib.metadata import version


def versions() -> dict[str, str]:
    """Versions of anser and of all that its numbers depend on, by name."""
    libraries = {name: version(name) for name in ("anser", "jax", "equinox", "numpy")}
    return {**libraries, "python": platform.python_version()}
