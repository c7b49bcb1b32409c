"""A record with a number for every key: smooth, bounded and meaningless, for tests of labels and files."""

import numpy as np
import pytest

from anser.variables import CATALOGUE, DERIVED_KEYS

TIMES, AIRCRAFT = 40, ("anna", "bert", "cläre")


@pytest.fixture
def time_s():
    return np.linspace(0.0, 3.9, TIMES)


@pytest.fixture
def history():
    generator = np.random.default_rng(7)
    shape = (TIMES, len(AIRCRAFT))
    record = {}
    for variable in CATALOGUE:
        if variable.key in DERIVED_KEYS:
            continue
        if variable.dtype == "bool":
            record[variable.key] = generator.random(shape) < 0.3
        elif variable.dtype == "int32":
            record[variable.key] = generator.integers(0, 3, shape)
        else:
            record[variable.key] = generator.uniform(-3.0, 3.0, shape)
    return record


@pytest.fixture
def names():
    return AIRCRAFT


@pytest.fixture
def attributes():
    return {
        "scenario": "three",
        "seed": 3,
        "step_s": 0.1,
        "reference_latitude_deg": 47.5,
        "reference_longitude_deg": 179.99,
    }
