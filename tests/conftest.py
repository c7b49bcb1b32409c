"""Strict tests: float64, no silent rank promotion, warnings are errors, shapes checked by beartype."""

import os

from hypothesis import settings
from jaxtyping import install_import_hook

with install_import_hook("anser", "beartype.beartype"):
    import anser  # noqa: F401

import jax

jax.config.update("jax_numpy_rank_promotion", "raise")

# On a CI machine the same examples every time: what is found at random is found by people, and kept as an example.
settings.register_profile("ci", derandomize=True)
if os.environ.get("CI"):
    settings.load_profile("ci")
