"""Candidates on a fleet's time grid: valid candidates satisfy the certificate's limits."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.compiling.options import compiled_quickly
from anser.planning.certified.candidates import deliver, fleet_candidates, routed_candidates
from anser.planning.certified.path_bounds import excess, path_bounds
from anser.planning.certified.routes import route
from anser.planning.certified.timed_profiles import LATE_FAST, PREFERRED, SLOW_FAST, make_candidate_set
from trials.cases import random_case
from trials.task import planner_task

pytestmark = pytest.mark.long


INTERVALS = 128
CANDIDATES = make_candidate_set((PREFERRED, SLOW_FAST, LATE_FAST), (0.0,), (0,), (0, 1, 3), turn_leg_starts=8)


@compiled_quickly
def _compare(tasks, airspace, durations):
    """Validity with and without the track's check, and the excess of the delivered path over its limits."""
    options = fleet_candidates(tasks, airspace, durations, INTERVALS, CANDIDATES)

    def compare_task(task, duration, shapes, profiles):
        initially_valid, _ = routed_candidates(task, airspace, duration, INTERVALS, CANDIDATES)

        def excess_of(shape):
            profile = jax.tree.map(lambda leaf: leaf[shape.profile], profiles)
            path = deliver(0.0, profile, route(shape.endpoints, shape.turns_and_legs))
            return jnp.max(excess(path_bounds(path, airspace.wind, airspace.gravity), task.limits))

        return initially_valid.valid, jax.lax.map(excess_of, shapes)

    initially_valid, over = jax.vmap(compare_task)(tasks, durations, options.routes, options.profiles)
    return options.valid, initially_valid, over


@pytest.fixture(scope="module")
def judged():
    comparisons = []
    for seed, duration in ((2, 260.0), (9, 420.0), (12, 240.0), (63, 200.0)):
        tasks, airspace, _ = planner_task(random_case(seed))
        comparisons.append([np.asarray(x) for x in _compare(tasks, airspace, jnp.full(8, duration))])
    return [np.concatenate(column) for column in zip(*comparisons, strict=True)]


def test_valid_candidates_satisfy_their_limits(judged):
    valid, _, over = judged
    assert valid.sum() > 100
    # Between the instants, and by how much bounds are wider than what they bound, a little may be lost.
    assert np.mean(over[valid] > 1e-7) < 0.08
    assert np.max(over[valid]) < 0.02


def test_rejected_candidates_are_close_to_a_violation(judged):
    valid, initially_valid, over = judged
    lost = initially_valid & ~valid
    assert lost.any()
    assert np.all(over[lost] > -0.006)
