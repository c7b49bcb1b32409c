"""Strict tests: float64, no silent rank promotion, warnings are errors, shapes checked by beartype."""

from jaxtyping import install_import_hook

with install_import_hook("anser", "beartype.beartype"):
    import anser  # noqa: F401

import jax

jax.config.update("jax_numpy_rank_promotion", "raise")
