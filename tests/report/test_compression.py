"""Packed records are accurate to the step, gaps included; unpacked here as on the page."""

import base64
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.report.flight_data import pack, quantization_step


def unpack(text, shapes_and_steps):
    """Inverse of `pack`, written from the format's description alone."""
    data = np.frombuffer(zlib.decompress(base64.b64decode(text)), dtype=np.uint8)
    arrays, start = [], 0
    for (times, count), step in shapes_and_steps:
        planes = data[start : start + 4 * times * count].reshape(4, count * times).astype(np.int64)
        zigzag = (planes * np.array([1, 1 << 8, 1 << 16, 1 << 24])[:, None]).sum(axis=0).reshape(count, times)
        twice = np.where(zigzag % 2 == 1, -(zigzag + 1) // 2, zigzag // 2)
        arrays.append(np.cumsum(np.cumsum(twice, axis=1), axis=1).T * step)
        start += 4 * times * count
    assert start == data.size
    return arrays


@settings(deadline=None, max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1),
    times=st.integers(1, 60),
    count=st.integers(1, 4),
    scale=st.sampled_from([1e-5, 1.0, 3e4, 1e12]),
)
def test_unpacked_numbers_are_within_half_a_step(seed, times, count, scale):
    random = np.random.default_rng(seed)
    first_values, second_values = scale * random.normal(size=(times, count)), random.normal(size=(times, 1))
    steps = [quantization_step(first_values, "m"), quantization_step(second_values, "1")]
    text, gaps = pack([(first_values, steps[0]), (second_values, steps[1])])
    assert gaps == [[], []]
    for values, step, back in zip(
        (first_values, second_values),
        steps,
        unpack(text, [((times, count), steps[0]), ((times, 1), steps[1])]),
        strict=True,
    ):
        # half a step of rounding, and the rounding of the product
        np.testing.assert_allclose(back, values, rtol=1e-12, atol=0.5001 * step)


def test_the_step_is_finer_than_a_pixel():
    """At most a hundred-thousandth of the range: finer than a pixel, also after zooming to a tenth of the range."""
    for spread in (1e-3, 0.3, 7.0, 4e4):
        values = np.linspace(0.0, spread, 50)[:, None]
        assert quantization_step(values, "m") <= 1e-5 * spread


def test_gaps_are_listed_by_aircraft_and_record():
    values = np.arange(10.0)[:, None] * np.ones(3)
    values[2:4, 1] = np.nan
    values[9, 1] = np.inf
    values[:, 2] = np.nan
    text, (gaps,) = pack([(values, 0.5)])
    assert gaps == [[1, 2, 3], [1, 9, 9], [2, 0, 9]]
    (back,) = unpack(text, [((10, 3), 0.5)])
    np.testing.assert_array_equal(back[:, 0], values[:, 0])
    np.testing.assert_array_equal(back[[2, 3, 9], 1], [1.0, 1.0, 8.0])


@pytest.mark.parametrize("unit", ["m", "degree", "N"])
def test_constant_or_missing_values_have_a_step(unit):
    assert quantization_step(np.full((4, 2), np.nan), unit) > 0.0
    assert quantization_step(np.zeros((4, 2)), unit) > 0.0
