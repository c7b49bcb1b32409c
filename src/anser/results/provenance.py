"""Which software computed a result."""

import platform
from importlib.metadata import version


def versions() -> dict[str, str]:
    """Versions of anser and of all that its numbers depend on, by name."""
    libraries = {name: version(name) for name in ("anser", "jax", "equinox", "numpy")}
    return {**libraries, "python": platform.python_version()}


def version_attributes() -> dict[str, str]:
    """Attributes of a dataset that tell the versions: `version_jax` and so on."""
    return {f"version_{name}": version for name, version in versions().items()}
