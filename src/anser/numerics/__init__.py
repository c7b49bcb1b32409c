"""Numerical building blocks: tables, integration, quadrature, roots, small algebra."""

from anser.numerics.arrays import (
    as_array,
    each_of,
    few_sizes,
    filled_up,
    in_precision,
    leading,
    namespace,
    rows_at,
    typed_as,
    zeros_as,
)
from anser.numerics.integrate import rk4_step
from anser.numerics.linear import cross, inverse3, product3, solve3, times3
from anser.numerics.randomness import AbstractRandomness, Blended, Given, Seeded, seeded
from anser.numerics.stacking import Stacked, any_in_batch, rows_of, stacked, structure_of, where_any
from anser.numerics.tables import Axes, Tables, make_axes, make_tables

__all__ = [
    "AbstractRandomness",
    "Axes",
    "Blended",
    "Given",
    "Seeded",
    "Stacked",
    "Tables",
    "any_in_batch",
    "as_array",
    "cross",
    "each_of",
    "few_sizes",
    "filled_up",
    "in_precision",
    "inverse3",
    "leading",
    "make_axes",
    "make_tables",
    "namespace",
    "product3",
    "rk4_step",
    "rows_at",
    "rows_of",
    "seeded",
    "solve3",
    "stacked",
    "structure_of",
    "times3",
    "typed_as",
    "where_any",
    "zeros_as",
]
