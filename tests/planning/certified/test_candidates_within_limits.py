"""Candidates of large sets: only the profiles within limits are generated, and none of their candidates is lost."""

import jax.numpy as jnp
import numpy as np
import pytest

from anser.compiling.options import compiled_quickly
from anser.planning.certified.candidates import ABSENT, routed_candidates
from anser.planning.certified.timed_profiles import FASTEST, PREFERRED, SLOWEST, make_candidate_set
from support.aircraft_tasks import aircraft_task, airspace
from support.certified_cases import STEADY

pytestmark = pytest.mark.long

INTERVALS = 64
EVERY_PROFILE = make_candidate_set((FASTEST, PREFERRED, SLOWEST), (0.0, 600.0), (0,), (0, 1))
WITHIN_LIMITS = EVERY_PROFILE._replace(max_candidates=EVERY_PROFILE.size)


@compiled_quickly
def _both(task, surroundings, duration_s):
    sets = EVERY_PROFILE, WITHIN_LIMITS
    return [routed_candidates(task, surroundings, duration_s, INTERVALS, kind)[0] for kind in sets]


@pytest.mark.parametrize("duration_s", [61.0, 75.0, 120.0])
def test_the_candidates_of_profiles_within_limits_are_those_of_every_profile(duration_s):
    task = aircraft_task((9000.0, 0.0, -1700.0))
    every, within = _both(task, airspace(STEADY), jnp.asarray(duration_s))
    for field in ("cost", "total_turn", "speed"):
        values, selected = np.asarray(getattr(every, field)), np.asarray(getattr(within, field))
        np.testing.assert_allclose(selected[within.valid], values[every.valid], rtol=1e-9)
    np.testing.assert_array_equal(within.valid, every.valid)
    assert np.all(within.cost[~within.valid] >= np.min(every.cost[~every.valid], initial=ABSENT))
    profiles = np.unique(every.routes.profile[every.valid])
    # The duration decides which profiles are within limits: some, but not all.
    assert 0 < profiles.size < len(EVERY_PROFILE.speeds)
    np.testing.assert_array_equal(np.unique(within.routes.profile[within.valid]), profiles)
