"""A fleet chooses again without the candidates rejected by a certificate; the best of its plans is returned."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import pytest

from anser.compiling.options import compiled_quickly
from anser.planning.certified.certified_plan import _choose_best_placement


class Seen(NamedTuple):
    satisfied_individually: object


class FirstPlan(NamedTuple):
    """The fields of a plan used by the choice."""

    chosen: object
    valid: object
    feasible: object
    certificate: Seen


class Chosen(NamedTuple):
    chosen: object


def placing(good, separated=True):
    """Choose the first remaining candidate of each aircraft; `good` is the certificate's verdict on each candidate."""
    fleet = jnp.arange(good.shape[0])

    def placed_of(valid):
        chosen = jnp.argmax(valid, axis=1)
        any_left = jnp.any(valid, axis=1)
        alone = good[fleet, chosen]
        return FirstPlan(chosen, any_left, any_left & alone & separated, Seen(alone)), Chosen(chosen)

    return placed_of


def choose(good, rounds, valid=None, active=None, separated=True, withdrawn=None):
    good = jnp.asarray(good)
    withdrawn = jnp.zeros_like(good) if withdrawn is None else jnp.asarray(withdrawn)
    valid = jnp.ones_like(good) if valid is None else jnp.asarray(valid)
    active = jnp.ones(good.shape[0], dtype=bool) if active is None else jnp.asarray(active)
    return compiled_quickly(
        lambda: _choose_best_placement(placing(good, separated), valid, withdrawn, active, rounds)
    )()


GOOD = np.array([[False, False, True, True], [True, True, True, True], [False, True, True, True]])


def test_rejected_candidates_are_not_chosen_again():
    plan = choose(GOOD, 8)
    np.testing.assert_array_equal(plan.chosen, [2, 0, 1])
    assert np.all(plan.feasible)


def test_the_best_plan_within_the_rounds_is_returned():
    plan = choose(GOOD, 2)
    np.testing.assert_array_equal(plan.chosen, [1, 0, 1])
    np.testing.assert_array_equal(plan.feasible, [False, True, True])


def test_the_best_plan_is_returned_if_the_last_is_worse():
    """Without its only candidate, an aircraft has none: the previous plan was no worse."""
    valid = np.array([[True, False, False, False], [True, True, True, True], [True, True, True, True]])
    plan = choose(GOOD, 8, valid)
    np.testing.assert_array_equal(plan.chosen[1:], [0, 1])
    np.testing.assert_array_equal(plan.feasible, [False, True, True])


def test_the_first_rejection_removes_the_withdrawn_candidates():
    mask = np.zeros((3, 4), dtype=bool)
    mask[0, :3] = mask[1, :3] = True
    plan = choose(GOOD, 2, withdrawn=mask)
    np.testing.assert_array_equal(plan.chosen, [3, 0, 1])
    assert np.all(plan.feasible)


def test_padding_aircraft_do_not_matter():
    plan = choose(GOOD, 8, active=[False, True, True])
    np.testing.assert_array_equal(plan.chosen[1:], [0, 1])


@pytest.mark.parametrize("rounds", [1, 8])
def test_conflicts_reject_no_candidate(rounds):
    plan = choose(np.ones((3, 4), dtype=bool), rounds, separated=False)
    np.testing.assert_array_equal(plan.chosen, [0, 0, 0])
    assert not np.any(plan.feasible)
