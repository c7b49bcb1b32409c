"""Objects stacked for `vmap`: `map` and `loop` give what each object gives alone."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from anser.numerics.arrays import map_rows, stack_objects


class Spring(eqx.Module):
    stiffness: jax.Array
    table: jax.Array

    def force(self, extension, scale):
        return {"force": self.stiffness * jnp.interp(extension, self.table[0], self.table[1]) * scale}


def test_map_and_loop_equal_each_object_alone():
    table = jnp.array([[0.0, 1.0, 2.0], [0.0, 0.5, 2.0]])
    springs = [Spring(jnp.asarray(k), table) for k in (1.0, 2.5, 4.0)]
    stacked, extensions, scales = stack_objects(springs), jnp.array([0.3, 1.2, 1.9]), jnp.array([1.0, 2.0, 3.0])
    assert stacked.batched.table is None  # equal tables are shared
    each = [
        spring.force(extension, scale)["force"]
        for spring, extension, scale in zip(springs, extensions, scales, strict=True)
    ]
    for over_objects in (stacked.map, stacked.loop):
        computed = jax.jit(lambda e, s, over_objects=over_objects: over_objects(Spring.force, e, s))(extensions, scales)
        np.testing.assert_allclose(computed["force"], each, rtol=1e-15)
    slopes = [
        jax.grad(lambda e, f=f: jnp.sum(f(Spring.force, e, scales)["force"]))(extensions)
        for f in (stacked.map, stacked.loop)
    ]
    np.testing.assert_allclose(slopes[0], slopes[1], rtol=1e-15)


def test_rows_are_mapped_with_and_without_a_batch():
    def function(x, pair):
        return {"sum": x + pair["a"], "constant": 1.0}

    rows = jnp.array([1.0, 2.0, 3.0]), {"a": jnp.array([[0.5, 1.0], [2.0, 3.0], [4.0, 5.0]])}
    mapped = map_rows(function, *rows)
    single = [map_rows(function, *jax.tree.map(lambda leaf, k=k: leaf[k : k + 1], rows)) for k in range(3)]
    for key, values in mapped.items():
        np.testing.assert_array_equal(np.concatenate([result[key] for result in single]), values)
