"""Delays of a fleet's arrivals in flight: equal for every aircraft, none beyond the end of the flight."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.planning.certified.replanning import arrival_delays

delays_of = jax.jit(arrival_delays)
FREE = jnp.array([True, True, True])
YES, NO = jnp.asarray(True), jnp.asarray(False)
IN_SEQUENCE = jnp.array([200.0, 210.0, 220.0])


def test_common_arrivals_are_delayed_by_a_fraction_of_the_time_to_go():
    delays, tries = delays_of(jnp.full(3, 200.0), 100.0, FREE, YES, jnp.inf)
    assert tries == 4
    assert np.allclose(delays, [0.0, 3.0, 8.0, 15.0], rtol=0, atol=1e-12)


def test_the_spacing_of_a_sequence_stays():
    delays, tries = delays_of(IN_SEQUENCE, 100.0, FREE, YES, jnp.inf)
    assert tries == 4
    put_off = np.asarray(IN_SEQUENCE)[None] + np.asarray(delays)[:, None]
    assert np.allclose(np.diff(put_off, axis=1), 10.0, rtol=0, atol=1e-12)
    assert np.all(np.diff(put_off[:, 0]) > 0.0)


@pytest.mark.parametrize(
    ("replannable", "arrival_is_free"), [(FREE.at[0].set(False), YES), (FREE, NO)], ids=["committed", "fixed"]
)
def test_a_fleet_with_a_committed_aircraft_or_fixed_times_is_not_delayed(replannable, arrival_is_free):
    delays, tries = delays_of(IN_SEQUENCE, 190.0, replannable, arrival_is_free, jnp.inf)
    assert (tries, float(delays[0])) == (1, 0.0)


@pytest.mark.parametrize(("latest", "tries"), [(219.0, 1), (220.0, 1), (224.0, 2), (230.0, 3), (238.0, 4)])
def test_arrivals_are_not_delayed_beyond_the_end(latest, tries):
    assert delays_of(IN_SEQUENCE, 100.0, FREE, YES, latest)[1] == tries


def test_batches_equal_single_fleets():
    times = jnp.stack([IN_SEQUENCE, jnp.full(3, 180.0)])
    batch = jax.jit(jax.vmap(lambda t: delays_of(t, 100.0, FREE, YES, 215.0)))(times)
    for k in range(2):
        delays, tries = delays_of(times[k], 100.0, FREE, YES, 215.0)
        assert np.array_equal(batch[0][k], delays)
        assert batch[1][k] == tries
