"""Survey driver: batches, progress, and common parts of surveyed flights."""

import jax.numpy as jnp
import numpy as np
import pytest

from anser.analysis.surveys import Survey, SurveyResult, sample_count, select_rows
from anser.compiling.options import compiled


class _SquareProgram:
    """Program that records its batches."""

    def __init__(self):
        self.batches = []

    def ready(self, factor, numbers, offset):
        self.batches.append(numbers.tolist())
        return lambda: {"square": factor * numbers**2 + offset, "omitted": numbers}


def test_batches_are_padded_and_trimmed():
    reports, program = [], _SquareProgram()
    survey = Survey(progress=lambda description, part: reports.append((description, part)))
    result = survey.evaluate(
        "squaring", program, 2, np.arange(5), 1, batch_size=3, span=(0.5, 0.9), select=lambda tree: tree["square"]
    )
    np.testing.assert_array_equal(result, 2 * np.arange(5) ** 2 + 1)
    assert program.batches == [[0, 1, 2], [3, 4, 0]]
    assert [description for description, _ in reports] == ["squaring"] * 3
    assert [part for _, part in reports] == pytest.approx([0.5, 0.74, 0.9])


def test_a_compiled_program_is_evaluated_for_every_row():
    double = compiled(lambda fixed, rows, power: (fixed["factor"] * rows[0]) ** power + rows[1])
    survey = Survey()
    rows = (jnp.arange(4.0), jnp.ones(4))
    result = survey.evaluate("", double, {"factor": jnp.asarray(2.0)}, rows, jnp.asarray(2.0), batch_size=2)
    np.testing.assert_allclose(result, (2.0 * np.arange(4.0)) ** 2 + 1.0)
    assert survey.compile_s > 0.0
    assert survey.run_s > 0.0


def test_a_result_has_attributes_versions_and_times():
    survey = Survey()
    result = survey.result(SurveyResult, {"x": ("row", np.arange(3))}, {}, {"aircraft": "f16"})
    assert result.dataset.attrs["aircraft"] == "f16"
    assert result.dataset.attrs["version_anser"]
    assert (result.compile_s, result.run_s) == (survey.compile_s, survey.run_s)


def test_rows_are_selected_in_every_leaf():
    selected = select_rows({"a": np.arange(4), "b": np.arange(8).reshape(4, 2)}, np.array([2, 0]))
    np.testing.assert_array_equal(selected["a"], [2, 0])
    np.testing.assert_array_equal(selected["b"], [[4, 5], [0, 1]])


def test_a_flight_of_fewer_than_100_samples_is_refused():
    assert sample_count(1.0, 0.01) == 100
    with pytest.raises(ValueError, match="expected 100 samples or more"):
        sample_count(0.99, 0.01)
