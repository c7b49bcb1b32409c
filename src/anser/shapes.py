"""Array shapes used in signatures, one alias per kind (jaxtyping; checked by beartype in the tests)."""

from typing import TYPE_CHECKING

from jaxtyping import Array, ArrayLike, Bool, Float, Int

Scalar = Float[Array, ""]
if TYPE_CHECKING:
    ScalarLike = Array | float
else:
    ScalarLike = Float[ArrayLike, ""]
Vector3 = Float[Array, "3"]
Vector = Float[Array, " n"]
"""One number for each of something, of a control surface above all."""
Quaternion = Float[Array, "4"]
Matrix33 = Float[Array, "3 3"]
Flag = Bool[Array, ""]
Count = Int[Array, ""]
