"""The room `environment` is imported with its stated shapes checked: see `conftest`."""

import jax.numpy as jnp
import pytest
from jaxtyping import TypeCheckError

from anser.environment.earth import FlatEarth


def test_a_wrong_shape_is_refused():
    with pytest.raises(TypeCheckError, match="local_earth"):
        FlatEarth(jnp.asarray(9.8)).local_earth(jnp.zeros(3), jnp.zeros(4))
