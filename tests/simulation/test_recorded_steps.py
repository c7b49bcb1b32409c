"""Loops over a number of steps that is known only at run time, with and without recorded rows."""

from types import SimpleNamespace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.simulation.recorders import AbstractRecorder, PackedRows, scan_steps

COUNT = 20


class Sums(AbstractRecorder):
    """Recorder of a sum; it stores a row of each `stride`-th sample, or none."""

    stride: int = eqx.field(static=True)
    has_rows: bool = eqx.field(static=True)

    def init(self, aircraft):
        return jnp.zeros(aircraft)

    def update(self, recorder_state, sample, instant):
        return recorder_state + sample

    def output(self, sample, instant):
        return {"sample": sample} if self.has_rows else None


def steps(recorder, first, active):
    """Each step adds the number of its sample to the state; a batch of two starts with different states."""

    def advance(state, number):
        return state + number, state, SimpleNamespace(number=number)

    def run(start, recorded):
        return scan_steps(advance, start, jnp.asarray(first), COUNT, recorder, recorded, active)

    return jax.jit(jax.vmap(run))(jnp.array([[0.0], [100.0]]), jnp.zeros((2, 1)))


@pytest.mark.parametrize(("stride", "has_rows"), [(1, True), (5, True), (1, False)])
@pytest.mark.parametrize("active", [None, 20, 13, 1])
def test_the_given_number_of_steps_is_flown_and_recorded(stride, has_rows, active):
    first, flown = 7, COUNT if active is None else active
    states = np.cumsum([0, *range(first, first + flown)])
    dynamic = None if active is None else jnp.asarray(active)
    final, recorded, rows = steps(Sums(stride, has_rows), first, dynamic)
    np.testing.assert_array_equal(final[:, 0], states[-1] + np.array([0.0, 100.0]))
    np.testing.assert_array_equal(recorded[:, 0], np.sum(states[:-1]) + flown * np.array([0.0, 100.0]))
    if has_rows:
        valid = -(-flown // stride)
        assert rows["sample"].shape == (2, COUNT // stride, 1)
        np.testing.assert_array_equal(rows["sample"][0, :valid, 0], states[:-1][::stride])
    else:
        assert rows is None


class Signals(AbstractRecorder):
    """Recorder of a row of a number, a flag and a vector of integers."""

    stride: int = eqx.field(static=True, default=1)

    def output(self, sample, instant):
        numbers = jnp.arange(3, dtype=jnp.int32) + instant.number
        return {"speed": 0.5 * sample, "is_even": instant.number % 2 == 0, "numbers": numbers}


def test_packed_rows_are_the_same_rows_with_their_types():
    def advance(state, number):
        return state + 0.1, state, SimpleNamespace(number=number)

    def run(packed_rows):
        arguments = jnp.zeros(2), jnp.asarray(7, dtype=jnp.int32), COUNT, Signals(), None, jnp.asarray(13)
        return jax.jit(lambda: scan_steps(advance, *arguments, packed_rows)[2])()

    packed, rows = run(True), run(False)
    assert isinstance(packed, PackedRows)
    assert packed.values.shape == (COUNT, 6)
    unpacked = packed.unpacked()
    assert list(unpacked) == sorted(rows)
    for key, values in unpacked.items():
        assert isinstance(values, np.ndarray)
        assert values.dtype == rows[key].dtype
        np.testing.assert_array_equal(values, rows[key])
    start = jnp.zeros(2), jnp.asarray(7, dtype=jnp.int32), COUNT, Signals(), None
    with pytest.raises(ValueError, match="packed_rows"):
        scan_steps(advance, *start, None, packed_rows=True)


def test_steps_end_after_a_final_state():
    def advance(state, number):
        return state + number, state, SimpleNamespace(number=number)

    def run(active):
        arguments = jnp.zeros(2), jnp.asarray(7, dtype=jnp.int32), COUNT, Signals(), None, jnp.asarray(active)
        # the state is 30 or more after four steps: 7 + 8 + 9 + 10
        return jax.jit(lambda: scan_steps(advance, *arguments, True, lambda state: jnp.any(state >= 30.0)))()

    final, _, packed = run(13)
    np.testing.assert_array_equal(final, [34.0, 34.0])
    np.testing.assert_array_equal(packed.unpacked()["speed"][:4, 0], [0.0, 3.5, 7.5, 12.0])
    np.testing.assert_array_equal(run(3)[0], [24.0, 24.0])
    arguments = advance, jnp.zeros(2), jnp.asarray(7, dtype=jnp.int32), COUNT, Signals(), None, jnp.asarray(13)
    with pytest.raises(ValueError, match="is_final"):
        scan_steps(*arguments, is_final=lambda state: state[0] > 0.0)
