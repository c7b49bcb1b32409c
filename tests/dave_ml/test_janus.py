"""Comparison with Janus, the DAVE-ML interpreter of the Australian Defence Science and Technology Group.

`record_janus.py` wrote `janus.json` with python-janus 0.3.0: every variable of every file, at 20 random inputs of
NASA's files and 150 of features.dml. At 1,000 inputs per file the greatest difference, relative to max(1, |value|), was
1.0e-13 (T_IDLE of F16_prop).
"""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from files import ALL, HERE, NASA, model

RECORDED = json.loads((HERE / "janus.json").read_text())
UNSUPPORTED = {"sinh_of_x", "cosh_of_x", "tanh_of_x", "arcsinh_of_x", "arccosh_above_one", "arctanh_of_third", "simple"}
"""Unsupported in Janus: hyperbolic functions, and functions with inline points."""


def compared(name):
    """Values by anser and by Janus, by variable."""
    recorded = RECORDED[f"{name}.dml"]
    variables = tuple(recorded["values"])
    inputs = {key: jnp.array(recorded["values"][key]) for key in recorded["inputs"]}

    def evaluate(x):
        return model(name).evaluate(x, variables)

    ours = jax.jit(jax.vmap(evaluate))(inputs) if inputs else evaluate({})
    theirs = {key: np.array(values, dtype=float) for key, values in recorded["values"].items()}
    return {key: np.broadcast_to(ours[key], theirs[key].shape) for key in variables}, theirs


@pytest.mark.parametrize("name", NASA)
def test_every_variable_of_nasas_files(name):
    ours, theirs = compared(name)
    assert set(ours) == set(model(name).definition.variables)
    for key, values in theirs.items():
        np.testing.assert_allclose(
            ours[key] / np.maximum(1, abs(values)), values / np.maximum(1, abs(values)), atol=2e-13
        )


def test_operations_and_tables():
    ours, theirs = compared("features")
    x = theirs["x"]
    outside = {
        # Janus holds the floor of the last interval beyond the last breakpoint, and the ceiling of the first before the
        # first; the reference (section 6.3) has the value of a breakpoint that is reached, and of the next higher one.
        "line_floor": x >= 2.0,
        "line_ceiling": x <= -1.5,
    }
    assert set(ours) >= set(model("features").definition.variables) - UNSUPPORTED
    for key in set(theirs) - UNSUPPORTED:
        # No number where points are neither extrapolated nor around: DAVE-ML says held.
        compared_points = np.isfinite(theirs[key]) & ~outside.get(key, np.zeros(len(x), bool))
        assert compared_points.sum() >= (1 if key == "scattered" else 5), key
        np.testing.assert_allclose(
            ours[key][compared_points], theirs[key][compared_points], rtol=1e-12, atol=1e-12, err_msg=key
        )


def test_all_files_are_recorded():
    assert {f"{name}.dml" for name in ALL} == set(RECORDED)
