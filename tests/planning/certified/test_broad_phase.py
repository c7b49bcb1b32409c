"""Distances within a large fleet: the cylinders give lower bounds, and the nearest pairs are computed exactly."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.compiling.options import compiled_quickly
from anser.planning import Separation
from anser.planning.certified.clearance import (
    CHORD_BOUNDED_PAIRS,
    INTERVALS_PER_CYLINDER,
    Track,
    bounding_cylinders,
    cylinder_clearance_ratio,
    fleet_clearance_ratio,
    pair_clearance_ratio,
)
from support.certified_cases import number, picked

FLEET, INTERVALS = 60, 64
APART = Separation(number(500.0), number(150.0))


def tracks(seed, width):
    """Straight and curved paths of a minute through a square of a width (m)."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 60.0, INTERVALS + 1)[None, :, None]
    start = rng.uniform(-0.5, 0.5, (FLEET, 1, 3)) * np.array([width, width, 1500.0])
    velocity = rng.uniform(-150.0, 150.0, (FLEET, 1, 3)) * np.array([1.0, 1.0, 0.1])
    bend = rng.uniform(-3.0, 3.0, (FLEET, 1, 3)) * np.array([1.0, 1.0, 0.0])
    included = (t[0, :-1, 0][None] < rng.uniform(30.0, 70.0, (FLEET, 1))).astype(float)
    error_bound = rng.uniform(0.0, 3.0, (FLEET, INTERVALS))
    return Track(*(jnp.asarray(x) for x in (start + velocity * t + 0.5 * bend * t**2, error_bound, included)))


def all_ratios(fleet):
    """Ratios of each pair: exact, by cylinders, and as computed in a large fleet."""
    cylinders = bounding_cylinders(fleet)

    def ratios_of(index):
        track, track_cylinders = jax.tree.map(lambda leaf: leaf[index], (fleet, cylinders))
        alone, block = jax.tree.map(lambda leaf: leaf[None], (track, track_cylinders))
        neighbours = jnp.arange(FLEET) != index
        ratios = fleet_clearance_ratio(
            track,
            track_cylinders,
            cylinders,
            lambda indices: jax.tree.map(lambda leaf: leaf[indices], fleet),
            neighbours,
            APART,
        )
        return pair_clearance_ratio(alone, fleet, APART), cylinder_clearance_ratio(block, cylinders, APART), ratios

    return jax.lax.map(ratios_of, jnp.arange(FLEET))


rooms = compiled_quickly(all_ratios)
OTHER = ~np.eye(FLEET, dtype=bool)


@pytest.mark.parametrize("wide", [60e3, 8e3], ids=["sparse", "dense"])
def test_cylinders_bound_the_exact_ratios(wide):
    exact, bound, ratios = (np.asarray(x) for x in rooms(tracks(1, wide)))
    # Each block ends where the next begins, so the distance of its intervals is never less; rounding of 1e4 m / 500 m.
    assert np.all(bound[OTHER] <= np.maximum(exact[OTHER], 0.0) + 1e-9)
    assert np.all(ratios[OTHER] <= np.maximum(exact[OTHER], 0.0) + 1e-9)
    assert np.all(np.isinf(np.diag(ratios)))
    # Bounds are not empty: far pairs are known to be apart by them alone.
    assert np.mean(bound[OTHER] > 1.0) > (0.8 if wide > 2e4 else 0.2)
    assert np.any(exact[OTHER] < 1.0)


def test_the_ratios_of_conflicts_in_a_sparse_fleet_are_exact():
    exact, bound, ratios = (np.asarray(x) for x in rooms(tracks(2, 60e3)))
    assert FLEET > CHORD_BOUNDED_PAIRS
    assert np.max(np.sum((bound < 1.0) & OTHER, axis=1)) <= CHORD_BOUNDED_PAIRS
    # So each pair that is not known to be apart has its own room, not a bound.
    undecided = (bound < 1.0) & OTHER
    assert np.any(exact[undecided] < 1.0)
    np.testing.assert_allclose(ratios[undecided], np.maximum(exact[undecided], bound[undecided]), rtol=1e-12)


def test_the_ratios_of_a_dense_fleet_are_never_too_large():
    exact, _, ratios = (np.asarray(x) for x in rooms(tracks(3, 4e3)))
    separated = ratios[OTHER] >= 1.0
    assert np.all(exact[OTHER][separated] >= 1.0)


def test_gradients_are_finite_for_coincident_paths():
    fleet = tracks(4, 8e3)

    def least(offset):
        track, neighbour = (picked(fleet, 0) for _ in range(2))
        shifted = Track(track.positions_n + offset[None, :], track.error_bound, track.included)
        return cylinder_clearance_ratio(bounding_cylinders(shifted), bounding_cylinders(neighbour), APART)

    assert np.all(np.isfinite(compiled_quickly(jax.grad(least))(jnp.zeros(3))))


def test_a_number_of_intervals_that_makes_no_blocks_is_refused():
    fleet = tracks(5, 8e3)
    short = Track(fleet.positions_n[:, :-1], fleet.error_bound[:, :-1], fleet.included[:, :-1])
    with pytest.raises(
        ValueError, match=f"arrived {INTERVALS - 1} intervals; expected a multiple of {INTERVALS_PER_CYLINDER}"
    ):
        bounding_cylinders(short)


def test_no_pair_that_is_apart_counts_as_too_near():
    """A formation of 60 aircraft 300 m apart, whose cylinders of 500 m and more overlap with those of most others."""
    k, t = np.arange(FLEET), np.linspace(0.0, 250.0, INTERVALS + 1)
    start = 300.0 * np.stack([k // 8, k % 8, 0.0 * k], axis=1)
    positions = start[:, None] + 150.0 * t[None, :, None] * np.array([1.0, 0.0, 0.0])
    formation = Track(jnp.asarray(positions), jnp.zeros((FLEET, INTERVALS)), jnp.ones((FLEET, INTERVALS)))
    exact, bound, ratios = (np.asarray(x) for x in rooms(formation))
    assert np.mean(bound[OTHER] == 0.0) > 0.5
    np.testing.assert_allclose(ratios[OTHER], np.maximum(exact, bound)[OTHER], rtol=1e-12)
    assert ratios.min() == pytest.approx(300.0 / 500.0)
