"""The published DAVE-ML files that come with the package."""

import functools
from importlib import resources

from anser.dave_ml import Model, read_dave_ml


@functools.cache
def published_model(name: str) -> Model:
    """A file of NASA's F-16 by its name without ending, `F16_aero`; the README beside them says whence."""
    content = resources.files("anser.dave_ml").joinpath(f"nasa/{name}.dml").read_bytes()
    return read_dave_ml(content, f"{name}.dml")
