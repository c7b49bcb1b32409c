"""The rooms of the kernels are imported with their stated shapes checked: see `conftest`."""

import jax.numpy as jnp
import pytest
from jaxtyping import TypeCheckError

from anser.spatial.rotations import rotate


def test_a_wrong_shape_is_refused():
    with pytest.raises(TypeCheckError, match="rotate"):
        rotate(jnp.eye(3), jnp.zeros(4))
