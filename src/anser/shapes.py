"""Array shapes for signatures, one alias per shape (jaxtyping; checked by beartype in the tests)."""

from typing import TYPE_CHECKING

from jaxtyping import Array, ArrayLike, Bool, Float, Int

Scalar = Float[Array, ""]
if TYPE_CHECKING:
    ScalarLike = Array | float
else:
    ScalarLike = Float[ArrayLike, ""]
Vector3 = Float[Array, "3"]
Vector = Float[Array, " n"]
"""Vector of any length n, often with one entry for each control surface."""
Quaternion = Float[Array, "4"]
Matrix33 = Float[Array, "3 3"]
Flag = Bool[Array, ""]
Integer = Int[Array, ""]
"""Integer scalar: a count, an index or a status code."""
