"""Numerical building blocks: tables, integration, quadrature, roots, small algebra."""

from anser.numerics.compiling import compiled_by_older_generator, compiled_quickly
from anser.numerics.integrate import rk4_step
from anser.numerics.linear import inverse3, solve3, times3
from anser.numerics.stacking import Stacked, any_in_batch, stacked, structure_of
from anser.numerics.tables import Axis, Curves, Surfaces, make_axis, make_curves, make_surfaces

__all__ = [
    "Axis",
    "Curves",
    "Stacked",
    "Surfaces",
    "any_in_batch",
    "compiled_by_older_generator",
    "compiled_quickly",
    "inverse3",
    "make_axis",
    "make_curves",
    "make_surfaces",
    "rk4_step",
    "solve3",
    "stacked",
    "structure_of",
    "times3",
]
