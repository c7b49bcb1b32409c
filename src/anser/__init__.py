"""Fleets of fixed-wing aircraft that must be at moving places at the same time."""

import jax

jax.config.update("jax_enable_x64", True)

__version__ = "0.1.0"
