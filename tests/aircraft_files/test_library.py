"""Airframes of the library."""

import jax
import numpy as np
import pytest

from anser.aircraft import AbstractAirframe
from anser.aircraft_files import AIRFRAMES, build, library, load_airframe
from anser.aircraft_files.sources import VARIANTS, airframe_range, library_file

every_airframe = pytest.mark.parametrize(
    ("name", "variant"), [(name, variant) for name in AIRFRAMES for variant in VARIANTS.get(name, ("textbook",))]
)


@every_airframe
def test_every_listed_variant_loads_twice_alike(name, variant):
    first_airframe, second_airframe = load_airframe(name, variant), load_airframe(name, variant)
    assert isinstance(first_airframe, AbstractAirframe)
    assert jax.tree.structure(first_airframe) == jax.tree.structure(second_airframe)
    for a, b in zip(jax.tree.leaves(first_airframe), jax.tree.leaves(second_airframe), strict=True):
        np.testing.assert_array_equal(a, b)


@every_airframe
def test_an_airframe_that_is_first_loaded_by_a_traced_function_has_concrete_arrays(name, variant):
    # A cached tracer ends every later use of the airframe with an error about a leaked tracer.
    for loader in (build._build_cached, library.load_f16, library.load_tp1538, library.load_global_f16, library_file):
        loader.cache_clear()
    loaded = []
    jax.eval_shape(lambda: loaded.append(load_airframe(name, variant)))
    build._build_cached.cache_clear()
    if name != "f16":
        jax.eval_shape(lambda: loaded.append(build.build_airframe(library_file(name))))
    assert not any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(loaded))


def test_every_number_of_an_airframe_is_a_float64_array():
    # A Python float would be static and recompile for each value.
    for leaf in jax.tree.leaves(load_airframe()):
        assert isinstance(leaf, jax.Array)
        assert leaf.dtype == np.float64
        assert not leaf.weak_type


def test_variants_differ():
    leaves = [np.concatenate([np.ravel(x) for x in jax.tree.leaves(load_airframe("f16", v))]) for v in VARIANTS["f16"]]
    for k, numbers in enumerate(leaves):
        for other_numbers in leaves[k + 1 :]:
            assert not np.array_equal(numbers, other_numbers)


@pytest.mark.parametrize("variant", VARIANTS["f16"])
def test_the_angles_of_attack_of_a_variant_are_those_of_its_data(variant):
    stated = airframe_range("f16", None, variant).alpha_deg
    np.testing.assert_allclose(np.degrees(load_airframe("f16", variant).alpha_range), stated, rtol=1e-12)


def test_the_centre_of_gravity_can_be_set():
    assert float(load_airframe("f16", "textbook", 0.38).x_cg) == 0.38


def test_unknown_names_are_refused_with_the_known_ones():
    with pytest.raises(ValueError, match=r"aircraft type 'f61': perhaps \"f16\"; one of f16, aerosonde"):
        load_airframe("f61")
    with pytest.raises(ValueError, match=r"variant 's191': known are textbook, s119, founding, tp1538, global"):
        load_airframe("f16", "s191")
    with pytest.raises(ValueError, match=r"variant: arrived 's119' with 'aerosonde'"):
        load_airframe("aerosonde", "s119")
