"""A fleet chooses again without the candidates that a certificate turns down, and the best of its plans is returned."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import pytest

from anser.compiling.options import compiled_quickly
from anser.planning.certified.certified_plan import _choose_best_placement


class Seen(NamedTuple):
    satisfied_individually: object


class FirstPlan(NamedTuple):
    """As much of a plan as the choice looks at."""

    chosen: object
    valid: object
    feasible: object
    certificate: Seen


class Chosen(NamedTuple):
    chosen: object


def placing(good, apart=True):
    """The first candidate left to each; `good`: what a certificate would say of each."""
    fleet = jnp.arange(good.shape[0])

    def placed_of(valid):
        chosen = jnp.argmax(valid, axis=1)
        any_left = jnp.any(valid, axis=1)
        alone = good[fleet, chosen]
        return FirstPlan(chosen, any_left, any_left & alone & apart, Seen(alone)), Chosen(chosen)

    return placed_of


def choose(good, rounds, valid=None, active=None, apart=True, given_up=None):
    good = jnp.asarray(good)
    given_up = jnp.zeros_like(good) if given_up is None else jnp.asarray(given_up)
    valid = jnp.ones_like(good) if valid is None else jnp.asarray(valid)
    active = jnp.ones(good.shape[0], dtype=bool) if active is None else jnp.asarray(active)
    return compiled_quickly(lambda: _choose_best_placement(placing(good, apart), valid, given_up, active, rounds))()


GOOD = np.array([[False, False, True, True], [True, True, True, True], [False, True, True, True]])


def test_turned_down_candidates_are_not_chosen_again():
    plan = choose(GOOD, 8)
    np.testing.assert_array_equal(plan.chosen, [2, 0, 1])
    assert np.all(plan.feasible)


def test_no_oftener_than_asked_and_the_best_so_far_counts():
    plan = choose(GOOD, 2)
    np.testing.assert_array_equal(plan.chosen, [1, 0, 1])
    np.testing.assert_array_equal(plan.feasible, [False, True, True])


def test_the_best_is_returned_where_the_last_is_worse():
    """Its only candidate gone, an aircraft has none: the plan before was no worse."""
    valid = np.array([[True, False, False, False], [True, True, True, True], [True, True, True, True]])
    plan = choose(GOOD, 8, valid)
    np.testing.assert_array_equal(plan.chosen[1:], [0, 1])
    np.testing.assert_array_equal(plan.feasible, [False, True, True])


def test_with_the_first_that_is_turned_down_those_given_up_go_too():
    given_up = np.zeros((3, 4), dtype=bool)
    given_up[0, :3] = given_up[1, :3] = True
    plan = choose(GOOD, 2, given_up=given_up)
    np.testing.assert_array_equal(plan.chosen, [3, 0, 1])
    assert np.all(plan.feasible)


def test_aircraft_that_fill_up_the_fleet_do_not_matter():
    plan = choose(GOOD, 8, active=[False, True, True])
    np.testing.assert_array_equal(plan.chosen[1:], [0, 1])


@pytest.mark.parametrize("rounds", [1, 8])
def test_conflicts_with_others_turn_nothing_down(rounds):
    plan = choose(np.ones((3, 4), dtype=bool), rounds, apart=False)
    np.testing.assert_array_equal(plan.chosen, [0, 0, 0])
    assert not np.any(plan.feasible)
