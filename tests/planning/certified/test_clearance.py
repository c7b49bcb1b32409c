"""Distances between moving aircraft and from keep-outs: tight lower bounds of the true values."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.compiling.options import compiled_quickly
from anser.planning import Separation
from anser.planning.certified.clearance import (
    Track,
    chord_error_bound,
    clearance_from_keep_outs,
    continue_straight,
    pair_clearance_ratio,
)
from anser.planning.certified.task import KeepOuts
from support.aircraft_tasks import no_keep_outs
from support.certified_cases import number, picked

CASES = 40
STEP_S, INTERVALS, FINE = 1.0, 60, 200
TIMES = STEP_S * np.arange(INTERVALS + 1)
DENSE = np.linspace(0.0, TIMES[-1], INTERVALS * FINE + 1)
APART = Separation(number(900.0), number(150.0))
RATIO = compiled_quickly(jax.vmap(pair_clearance_ratio, in_axes=(0, 0, None)))
KEEP_OUT_CLEARANCE = compiled_quickly(jax.vmap(clearance_from_keep_outs, in_axes=(0, None, None)))


class Weaving:
    """Steady flight with a sinusoidal weave on each axis: positions anywhere, acceleration bounded in closed form."""

    def __init__(self, rng):
        # All cross near the origin in the middle of the time.
        course = rng.uniform(-np.pi, np.pi)
        self.velocity = np.array([150.0 * np.cos(course), 150.0 * np.sin(course), rng.uniform(-10.0, 10.0)])
        middle = np.append(rng.uniform(-1500.0, 1500.0, 2), rng.uniform(-1300.0, -700.0))
        self.begin = middle - 30.0 * self.velocity
        self.rate = rng.uniform(0.05, 0.4, 3)
        self.phase = rng.uniform(-np.pi, np.pi, 3)
        # Up to 15 m/s^2 level and 3 m/s^2 vertically.
        self.size = rng.uniform(0.0, 1.0, 3) * [10.0, 10.0, 3.0] / self.rate**2

    def at(self, times):
        return self.begin + times[:, None] * self.velocity + self.size * np.sin(times[:, None] * self.rate + self.phase)

    def acceleration(self):
        return float(np.linalg.norm(self.size * self.rate**2))


def track_of(weave, included=None):
    error_bound = chord_error_bound(jnp.full(INTERVALS, weave.acceleration()), number(STEP_S))
    counts = np.ones(INTERVALS) if included is None else included
    return Track(jnp.asarray(weave.at(TIMES)), error_bound, jnp.asarray(counts))


def stacked(tracks):
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *tracks)


_RNG = np.random.default_rng(9)
ONES, OTHERS = ([Weaving(_RNG) for _ in range(CASES)] for _ in range(2))
FIRST, SECOND = (stacked([track_of(w) for w in ws]) for ws in (ONES, OTHERS))


def ratios(subject, neighbour, separation, times=DENSE):
    offset = subject.at(times) - neighbour.at(times)
    flat = np.hypot(offset[:, 0], offset[:, 1]) / float(separation.horizontal)
    if float(separation.vertical) == 0.0:
        return flat
    return np.maximum(flat, np.abs(offset[:, 2]) / float(separation.vertical))


@pytest.mark.parametrize("vertical", [150.0, 0.0])
def test_ratios_are_tight_lower_bounds(vertical):
    separation = Separation(number(900.0), number(vertical))
    bounds = np.asarray(RATIO(FIRST, SECOND, separation))
    broken = 0
    for k in range(CASES):
        exact = np.min(ratios(ONES[k], OTHERS[k], separation))
        # 3e-5 m keep a root's derivative finite.
        assert bounds[k] <= exact + 1e-6
        # Straight lines are within the two slacks of the paths, either way; the fine grid within 5 ms x 400 m/s / 2.
        error_bound = (ONES[k].acceleration() + OTHERS[k].acceleration()) * STEP_S**2 / 8
        # Horizontally and vertically the least ratios of one interval are not at the same instant.
        change = STEP_S * (20.0 + 2 * 3.0 / 0.05) if vertical else 0.0
        assert bounds[k] >= exact - (2 * error_bound + 1.0 + change) / (vertical or 900.0)
        broken += exact < 1.0
    assert 5 <= broken <= CASES - 5 or not vertical  # both kinds are there


def test_straight_crossings_are_exact():
    # At right angles at 150 m/s, the second behind by a distance: sqrt(1/2) of it at the closest, between instants.
    distances = np.array([100.0, 1000.0, 2345.6])
    positions = np.stack([150.0 * (TIMES - 30.3), 0 * TIMES, 0 * TIMES], axis=1)
    tracks = [
        Track(
            jnp.asarray(np.stack([0 * TIMES, 150.0 * (TIMES - 30.3) - b, 0 * TIMES], axis=1)),
            jnp.zeros(INTERVALS),
            jnp.ones(INTERVALS),
        )
        for b in distances
    ]
    base = stacked([Track(jnp.asarray(positions), jnp.zeros(INTERVALS), jnp.ones(INTERVALS))] * 3)
    np.testing.assert_allclose(RATIO(base, stacked(tracks), APART), np.sqrt(0.5) * distances / 900.0, rtol=1e-12)


def test_a_collision_between_two_samples_is_detected():
    # Head on, each instant 75 m away on either side.
    x = 150.0 * (TIMES - 30.5)
    subject, neighbour = (
        Track(
            jnp.asarray(np.stack([sign * x, 0 * x, 0 * x], axis=1))[None],
            jnp.zeros((1, INTERVALS)),
            jnp.ones((1, INTERVALS)),
        )
        for sign in (1.0, -1.0)
    )
    np.testing.assert_allclose(RATIO(subject, neighbour, APART), 0.0, atol=1e-7)


def test_only_the_common_flight_counts_and_only_with_a_required_separation():
    no_separation = Separation(number(0.0), number(0.0))
    assert np.all(np.isinf(RATIO(FIRST, SECOND, no_separation)))
    excluded = jax.tree.map(jnp.zeros_like, SECOND.included)
    assert np.all(np.isinf(RATIO(FIRST, Track(SECOND.positions_n, SECOND.error_bound, excluded), APART)))
    # One arrives after 20 s: the crossing in the middle is no longer its.
    early = np.where(TIMES[:-1] < 20.0, 1.0, 0.0)
    early_ratios = np.asarray(RATIO(stacked([track_of(w, early) for w in ONES]), SECOND, APART))
    whole = np.asarray(RATIO(FIRST, SECOND, APART))
    assert np.all(early_ratios >= whole)
    assert np.sum(early_ratios > whole + 0.1) > CASES / 2
    for k in range(CASES):
        assert early_ratios[k] <= np.min(ratios(ONES[k], OTHERS[k], APART, DENSE[DENSE <= 20.0])) + 1e-6


def test_the_order_of_a_pair_and_batches_make_no_difference():
    together = RATIO(FIRST, SECOND, APART)
    np.testing.assert_allclose(RATIO(SECOND, FIRST, APART), together, rtol=1e-12)
    single_ratio = jax.jit(pair_clearance_ratio)
    np.testing.assert_allclose(single_ratio(FIRST, SECOND, APART), together, rtol=1e-12)  # its own batch axis
    alone = [single_ratio(picked(FIRST, k), picked(SECOND, k), APART) for k in range(3)]
    np.testing.assert_allclose(alone, together[:3], rtol=1e-12)


def volumes():
    rng = np.random.default_rng(2)
    count = 12
    return KeepOuts(
        jnp.asarray(rng.uniform(-2500.0, 2500.0, (count, 2))),
        jnp.asarray(np.where(np.arange(count)[:, None] < 4, 0.0, rng.uniform(-25.0, 25.0, (count, 2)))),
        jnp.asarray(rng.uniform(300.0, 1500.0, count)),
        jnp.asarray(rng.uniform(0.0, 1000.0, count)),
        jnp.asarray(rng.uniform(1000.0, 1500.0, count)),
    )


def test_keep_out_clearances_are_tight_lower_bounds():
    closed = volumes()
    bounds = np.asarray(KEEP_OUT_CLEARANCE(FIRST, jnp.asarray(TIMES), closed))
    position, velocity, radius, bottom, top = (np.asarray(x) for x in jax.tree.leaves(closed))
    inside = 0
    for k, weave in enumerate(ONES):
        path = weave.at(DENSE)
        for n in range(radius.size):
            offset = path[:, :2] - position[n] - DENSE[:, None] * velocity[n]
            radial = np.hypot(offset[:, 0], offset[:, 1]) - radius[n]
            exact = np.min(np.maximum.reduce([radial, bottom[n] + path[:, 2], -path[:, 2] - top[n]]))
            error_bound = weave.acceleration() * STEP_S**2 / 8
            assert bounds[k, n] <= exact + 1e-4  # 3e-5 m keep a root's derivative finite
            # Two slacks; and beside and above are looked at over an interval each, not at the same instant: vertical
            # speeds of 10 + 3/0.05 m/s.
            assert bounds[k, n] >= exact - 2 * error_bound - 1.0 - 70.0 * STEP_S
            inside += exact < 0.0
    assert 20 <= inside <= bounds.size - 20  # both kinds are there


def test_above_below_and_beside_are_exact_for_straight_flight():
    x = 150.0 * (TIMES - 30.4)
    track = Track(jnp.asarray(np.stack([x, 0 * x, 0 * x - 1000.0], axis=1)), jnp.zeros(INTERVALS), jnp.ones(INTERVALS))
    closed = KeepOuts(
        jnp.array([[0.0, 0.0], [0.0, 0.0], [0.0, 800.0], [0.0, 0.0], [0.0, 600.0]]),
        jnp.array([[0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [150.0, 0.0]]),
        jnp.array([500.0, 500.0, 500.0, 500.0, 700.0]),
        jnp.array([0.0, 1100.0, 0.0, 0.0, 0.0]),
        jnp.array([750.0, 2000.0, 2000.0, 1010.0, 2000.0]),
    )
    clearances = compiled_quickly(clearance_from_keep_outs)(track, jnp.asarray(TIMES), closed)
    # Above, below, beside; inside, 10 m under the top; beside one that flies along, 100 m inside, but for 4560 m.
    lateral = np.hypot(600.0, 150.0 * 30.4) - 700.0
    np.testing.assert_allclose(clearances, [250.0, 100.0, 300.0, -10.0, lateral], rtol=1e-9)
    # After the arrival nothing counts.
    after_arrival = Track(track.positions_n, track.error_bound, jnp.zeros(INTERVALS))
    assert np.all(np.isinf(compiled_quickly(clearance_from_keep_outs)(after_arrival, jnp.asarray(TIMES), closed)))


def test_an_airspace_without_volumes_has_no_clearances():
    of_none = jax.jit(clearance_from_keep_outs)(picked(FIRST, 0), jnp.asarray(TIMES), no_keep_outs())
    assert of_none.shape == (0,)


def test_the_chord_error_is_the_sagitta_of_the_acceleration():
    # A parabola's distance from its chord, a h^2 / 8, in the middle.
    np.testing.assert_allclose(chord_error_bound(jnp.array([8.0, 2.0]), number(0.5)), [0.25, 0.0625], rtol=1e-15)


@pytest.mark.long
def test_gradients_are_finite_in_a_collision_and_at_rest():
    positions = jnp.zeros((INTERVALS + 1, 3))
    track = Track(positions, jnp.zeros(INTERVALS), jnp.ones(INTERVALS))

    def ratio(moved):
        return pair_clearance_ratio(Track(moved, track.error_bound, track.included), track, APART)

    def clearance(moved):
        closed = KeepOuts(jnp.zeros((1, 2)), jnp.zeros((1, 2)), jnp.ones(1), jnp.zeros(1), jnp.ones(1))
        return clearance_from_keep_outs(Track(moved, track.error_bound, track.included), jnp.asarray(TIMES), closed)[0]

    assert np.all(np.isfinite(compiled_quickly(jax.grad(ratio))(positions)))
    assert np.all(np.isfinite(compiled_quickly(jax.grad(clearance))(positions)))


def test_tracks_continue_straight_after_the_arrivals():
    """Two aircraft arrive 8 s apart on parallel lines and fly on; a third has a fixed path, which does not continue."""
    times, arrivals, seconds = np.linspace(0.0, 40.0, 81), np.array([32.0, 40.0, 32.0]), 6.0
    velocities = np.array([[100.0, 10.0, 0.0], [-80.0, 0.0, 5.0], [0.0, 90.0, 0.0]])
    positions = times[:, None] * velocities[:, None, None]
    included = np.where(times[:-1] < arrivals[:, None, None] - 1e-6, 1.0, 0.0)
    tracks = Track(jnp.asarray(positions), jnp.ones((3, 1, 80)), jnp.asarray(included))
    continue_by = jax.jit(continue_straight)
    continued = continue_by(tracks, jnp.asarray(arrivals), seconds, jnp.array([True, True, False]))
    later = 40.0 + 1.5 * np.arange(5)
    np.testing.assert_allclose(continued.positions_n[:, 0, 80:], later[:, None] * velocities[:, None], atol=1e-9)
    begins = np.concatenate([times[:-1], later[:-1]])
    ends = np.array([38.0, 46.0, 32.0])[:, None]
    np.testing.assert_array_equal(continued.included[:, 0], begins < ends - 1e-6)
    np.testing.assert_array_equal(continued.error_bound[:, 0, 80:], 0.0)
    unchanged = continue_by(tracks, jnp.asarray(arrivals), 0.0, jnp.ones(3, dtype=bool))
    np.testing.assert_array_equal(unchanged.included[..., :80], included)
    np.testing.assert_array_equal(unchanged.included[..., 80:], 0.0)


def test_a_meeting_after_the_arrivals_counts_in_the_look_ahead_only():
    """Head-on, 900 m apart at the arrivals, closing at 300 m/s: the aircraft pass each other 3 s later."""
    times = np.linspace(0.0, 60.0, 121)
    along = np.stack([150.0 * (times - 60.0), 900.0 - 150.0 * (times - 60.0)])[:, None, :, None]
    tracks = Track(jnp.asarray(along * np.array([1.0, 0.0, 0.0])), jnp.zeros((2, 1, 120)), jnp.ones((2, 1, 120)))

    @jax.jit
    def ratio(seconds):
        continued = continue_straight(tracks, jnp.full(2, 60.0), seconds, jnp.ones(2, dtype=bool))
        one, other = (jax.tree.map(lambda leaf, k=k: leaf[k, 0], continued) for k in range(2))
        return pair_clearance_ratio(one, other, Separation(number(180.0), number(0.0)))

    np.testing.assert_allclose([ratio(0.0), ratio(2.0)], [5.0, 300.0 / 180.0], atol=1e-6)
    assert ratio(5.0) < 1e-3
