"""Running summary of a flight: the distances from keep-outs, against a record."""

import jax
import jax.numpy as jnp
import numpy as np

from anser.planning.certified.task import KeepOuts
from anser.simulation.fleet_summary import SummaryRecorder
from support.aircraft_tasks import no_keep_outs

STEP_S = 0.5


def summarize(positions_n, keep_outs):
    """Running summary of aircraft at positions (time, aircraft, 3), m, with a sample every half second."""
    samples, aircraft, _ = positions_n.shape
    zero = jnp.zeros((samples, aircraft))
    inputs = {
        "position_n": jnp.asarray(positions_n),
        "offset_n": jnp.asarray(positions_n) + 1.0,
        **dict.fromkeys(("airspeed", "clearance", "position_error", "arrival_time"), zero),
        "outside_tables": zero > 0.0,
        "status": zero.astype(jnp.int32),
    }
    recorder = SummaryRecorder(keep_outs=keep_outs)

    def add(state, numbered):
        number, sample = numbered
        return recorder.include(state, sample, number, jnp.asarray(STEP_S)), None

    (summary, _), _ = jax.jit(lambda: jax.lax.scan(add, recorder.init(aircraft), (jnp.arange(samples), inputs)))()
    return np.asarray(summary.keep_out_room_min)


def test_the_least_distance_outside_moving_keep_outs_is_that_of_the_record():
    source = np.random.default_rng(4)
    positions_n = np.cumsum(source.normal(0.0, 60.0, (40, 3, 3)), axis=0)
    centres, velocities = source.normal(0.0, 400.0, (5, 2)), source.normal(0.0, 20.0, (5, 2))
    radii, bottoms = source.uniform(100.0, 300.0, 5), source.uniform(-400.0, 0.0, 5)
    tops = bottoms + 500.0
    least = np.full(3, np.inf)
    for k in range(40):
        for aircraft in range(3):
            north, east, down = positions_n[k, aircraft]
            for volume in range(5):
                axis = centres[volume] + k * STEP_S * velocities[volume]
                outside = np.hypot(north - axis[0], east - axis[1]) - radii[volume]
                room = max(outside, bottoms[volume] + down, -down - tops[volume])
                least[aircraft] = min(least[aircraft], room)
    volumes = KeepOuts(*map(jnp.asarray, (centres, velocities, radii, bottoms, tops)))
    np.testing.assert_allclose(summarize(positions_n, volumes), least, rtol=1e-12)
    assert np.any(least < 0.0)  # the example enters a volume
    assert np.any(least > 0.0)  # and keeps clear of others


def test_without_keep_outs_the_distance_is_infinite():
    positions_n = np.zeros((3, 2, 3))
    for keep_outs in (None, no_keep_outs()):
        assert np.all(np.isinf(summarize(positions_n, keep_outs)))
