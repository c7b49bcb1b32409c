"""Blended random numbers: standard normal after any number of blends, equal on host and in flight, and reproducible."""

import jax.numpy as jnp
import numpy as np
from scipy import stats

from anser.campaigns import subset_simulation
from anser.campaigns.rare_flights import GaussianSpace
from anser.campaigns.subset import SubsetPlan, estimate
from anser.numerics import flight_randomness
from anser.numerics.randomness import AIR, DISPERSIONS

SPACE = GaussianSpace(5, 20)


def mixed_often(count, moves, keep):
    points = SPACE.sample(np.arange(count))
    for move in range(moves):
        points = SPACE.propose(points, np.full(count, keep), count * (move + 1) + np.arange(count))
    return points


def test_a_new_point_is_the_flight_of_its_number():
    (point,) = SPACE.sample(np.array([7]))
    ours, theirs = (
        SPACE.randomness_at(point).for_aircraft(jnp.asarray(1)),
        flight_randomness(5, 7).for_aircraft(jnp.asarray(1)),
    )
    # compiled in a loop, which may round otherwise
    np.testing.assert_allclose(ours.normals(AIR, 3, 6), theirs.normals(AIR, 3, 6), rtol=1e-14)
    np.testing.assert_allclose(ours.uniforms(AIR, 3, 6), theirs.uniforms(AIR, 3, 6), rtol=1e-12)


def test_a_blended_point_is_the_weighted_sum():
    points = SPACE.propose(SPACE.sample(np.array([7])), np.array([0.8]), np.array([9]))
    np.testing.assert_allclose(
        SPACE.randomness_at(points[0]).normals(AIR, 3, 6),
        0.8 * flight_randomness(5, 7).normals(AIR, 3, 6) + 0.6 * flight_randomness(5, 9).normals(AIR, 3, 6),
        rtol=1e-12,
    )
    # on the host the same numbers, for what the study disperses
    np.testing.assert_allclose(
        SPACE.dispersions(points, 4)[0], SPACE.randomness_at(points[0]).normals(DISPERSIONS, 0, 4), rtol=1e-9
    )


def test_a_point_with_zero_weight_is_dropped():
    points = SPACE.propose(SPACE.sample(np.arange(2)), np.array([0.0, 0.6]), np.array([8, 9]))
    assert points["count"].tolist() == [1, 2]
    assert points["flights"][0, 0] == 8
    assert points["weights"][0, 0] == 1.0
    np.testing.assert_allclose(np.sum(points["weights"] ** 2, axis=1), 1.0)


def test_blends_stay_standard_normal_and_independent():
    numbers = SPACE.dispersions(mixed_often(4000, 5, 0.7), 3)
    for column in numbers.T:
        assert stats.kstest(column, "norm").pvalue > 1e-3
    correlation = np.corrcoef(numbers.T) - np.eye(3)
    assert np.max(np.abs(correlation)) < 4.0 / np.sqrt(4000)


def test_a_point_is_rebuilt_from_its_flights_and_weights():
    point = mixed_often(3, 4, 0.9)[1]
    count = int(point["count"])
    rebuilt = SPACE.point(point["flights"][:count].tolist(), point["weights"][:count].tolist())
    assert rebuilt == point


def test_a_known_probability_is_estimated_in_the_space_of_blends():
    space, threshold = GaussianSpace(3, 28), float(stats.norm.isf(1e-3))

    def linear(points, numbers):
        return space.dispersions(points, 4).sum(axis=1) / 2.0

    walked = subset_simulation(space, linear, threshold, SubsetPlan(200, 0.1, 4, 5), 3)
    ours = estimate(walked, threshold, 0.95)
    assert ours.low < 1e-3 < ours.high
