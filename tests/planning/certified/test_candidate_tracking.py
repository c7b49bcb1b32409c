"""Candidates at a fleet's instants: those that count as valid keep what the certificate asks."""

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
def _judged(tasks, airspace, durations):
    """Validity as placed and as first found, and by how much the delivered path passes its limits."""
    options = fleet_candidates(tasks, airspace, durations, INTERVALS, INTERVALS, CANDIDATES)

    def one(task, duration, shapes, profiles):
        first, _ = routed_candidates(task, airspace, duration, INTERVALS, CANDIDATES)

        def passed(shape):
            profile = jax.tree.map(lambda leaf: leaf[shape.profile], profiles)
            path = deliver(0.0, profile, route(shape.endpoints, shape.turns_and_legs))
            return jnp.max(excess(path_bounds(path, airspace.wind, airspace.gravity), task.limits))

        return first.valid, jax.lax.map(passed, shapes)

    first, over = jax.vmap(one)(tasks, durations, options.routes, options.profiles)
    return options.valid, first, over


@pytest.fixture(scope="module")
def judged():
    rows = []
    for seed, duration in ((2, 260.0), (9, 420.0), (12, 240.0), (63, 200.0)):
        tasks, airspace, _ = planner_task(random_case(seed))
        rows.append([np.asarray(x) for x in _judged(tasks, airspace, jnp.full(8, duration))])
    return [np.concatenate(column) for column in zip(*rows, strict=True)]


def test_what_is_valid_keeps_its_limits(judged):
    valid, _, over = judged
    assert valid.sum() > 100
    # Between the instants, and by how much bounds are wider than what they bound, a little may be lost.
    assert np.mean(over[valid] > 1e-7) < 0.08
    assert np.max(over[valid]) < 0.02


def test_what_is_turned_down_here_would_not_have_kept_them(judged):
    valid, first, over = judged
    lost = first & ~valid
    assert lost.any()
    assert np.all(over[lost] > -0.006)
