"""Structures of results as JSON: exact round trip, and rejection of foreign classes."""

import dataclasses
import json
from typing import NamedTuple

import jax
import numpy as np
import pytest

from anser.aircraft import AircraftState
from anser.aircraft_files import load_airframe
from anser.compiling.executables import decode_structure, encode_structure
from anser.compiling.keys import NotCacheableError
from anser.environment import standard_environment
from anser.steady import solve_trim, trim_target


def test_decoded_results_have_equal_classes_shapes_and_weak_types():
    shapes = jax.eval_shape(
        lambda: solve_trim(load_airframe("f16"), standard_environment(), trim_target(150.0, 1000.0))
    )
    result = {"trim": shapes, "rest": (1, -2.5, float("inf"), "text", None, True, [jax.ShapeDtypeStruct((), bool)])}
    result["weak"] = jax.ShapeDtypeStruct((2, 0), np.dtype("int32"), weak_type=True)
    decoded = decode_structure(json.loads(json.dumps(encode_structure(result))))
    assert jax.tree.structure(decoded) == jax.tree.structure(result)
    assert jax.tree.leaves(decoded) == jax.tree.leaves(result)
    assert decoded["weak"].weak_type


class Outside(NamedTuple):
    x: int


@pytest.mark.parametrize("value", [Outside(1), object(), np.zeros(2), {1: 2}, lambda x: x, int, jax.random.key(0)])
def test_values_from_outside_the_package_are_not_encoded(value):
    with pytest.raises(NotCacheableError):
        encode_structure((value,))


@pytest.mark.parametrize(
    "text",
    [
        '{"class": ["os:system", {}]}',
        '{"class": ["anser.compiling.store:os.system", {}]}',
        '{"class": ["anser.compiling.store:os", {}]}',
        '{"class": ["anser.compiling.store:Path", {}]}',
        '{"class": ["anser.__main__:main", {}]}',
        '{"class": ["anser.nothing:Nothing", {}]}',
        '{"class": ["anser.compiling.store:FolderStore", {}]}',
        '{"class": ["anser..aircraft:AircraftState", {}]}',
        '{"class": [3, {}]}',
        '{"class": ["anser.aircraft.interface:AircraftState", {"__class__": 1}]}',
        '{"enum": ["anser.aircraft.interface:AircraftState", "x"]}',
        '{"array": ["object", [3], false]}',
        '{"array": ["float64", [-3], false]}',
        '{"array": ["float64", [3.0], false]}',
        '{"array": ["float64", [3], 1]}',
        '{"array": ["nothing", [3], false]}',
        '{"tuple": 3}',
        '{"tuple": [], "list": []}',
        '{"eval": "1"}',
        "[1]",
        "{}",
    ],
)
def test_foreign_documents_are_not_decoded(text):
    with pytest.raises(NotCacheableError):
        decode_structure(json.loads(text))


def test_missing_or_additional_fields_are_refused():
    name = f"{AircraftState.__module__}:{AircraftState.__qualname__}"
    fields = {field.name: {"array": ["float64", [3], False]} for field in dataclasses.fields(AircraftState)}
    assert isinstance(decode_structure({"class": [name, fields]}), AircraftState)
    for changed in ({**fields, "more": 1}, dict(list(fields.items())[1:]), dict(reversed(fields.items()))):
        with pytest.raises(NotCacheableError):
            decode_structure({"class": [name, changed]})
