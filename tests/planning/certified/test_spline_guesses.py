"""Initial splines of the search: many kinds of paths of the required length."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.compiling.options import compiled_quickly
from anser.planning.certified.spline_search import make_guesses, spline_start
from anser.planning.certified.splines import Spline, SplineProblem, states_at
from support.certified_cases import number, picked
from trials.cases import random_case
from trials.task import planner_task

CELLS, STARTS = 64, 40


@compiled_quickly
def _start_search(task, airspace, duration):
    problem = SplineProblem(task, airspace, duration)
    begin = jax.vmap(lambda guess: spline_start(problem, CELLS, guess))(make_guesses(STARTS))
    times = duration * jnp.linspace(0.0, 1.0, 801)
    return begin, jax.vmap(lambda c: states_at(Spline(duration, c), times))(begin.coefficients)


@pytest.fixture(scope="module", params=[(90, 0, 230.0), (34, 1, 380.0), (674, 2, 620.0)])
def searched(request):
    seed, index, duration = request.param
    tasks, airspace, _ = planner_task(random_case(seed))
    return picked(tasks, index), duration, *_start_search(picked(tasks, index), airspace, number(duration))


def test_guesses_have_lengths_within_the_airspeed_range(searched):
    task, duration, _, spline = searched
    lengths = np.sum(np.linalg.norm(np.diff(spline[:, :, 0, :2], axis=1), axis=2), axis=1)
    low, high = float(task.limits.speed_min), float(task.limits.speed_max)
    means = lengths / duration
    # Corners are cut, and the wind carries along; most are within the range, none anywhere near half or twice.
    assert np.mean((means > 0.85 * low) & (means < 1.15 * high)) > 0.7
    assert np.all((means > 0.5 * low) & (means < 2.0 * high))


def test_guesses_stay_within_the_altitude_limits(searched):
    task, _, _, spline = searched
    altitudes = -np.asarray(spline)[:, :, 0, 2]
    assert np.min(altitudes) >= float(task.limits.altitude_min) - 50.0
    assert np.max(altitudes) <= float(task.limits.altitude_max) + 50.0


def test_guesses_have_many_shapes(searched):
    *_, spline = searched
    north, east = np.asarray(spline)[:, ::8, 1, 0], np.asarray(spline)[:, ::8, 1, 1]
    headings = np.unwrap(np.arctan2(east, north), axis=1)
    whole = np.ptp(headings, axis=1) / (2.0 * np.pi)
    assert np.sum(whole > 0.9) >= 5
    assert np.sum(whole < 0.7) >= 5
    aside = np.asarray(spline)[:, 400, 0, :2] - np.asarray(spline)[:, 0, 0, :2]
    bearings = np.arctan2(aside[:, 1], aside[:, 0])
    assert np.unique(np.round(bearings, 1)).size > STARTS / 4


def test_guesses_are_reproducible_and_finite(searched):
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(searched[2].coefficients))
    for values, repeated in zip(make_guesses(7), make_guesses(7), strict=True):
        np.testing.assert_array_equal(values, repeated)
    # Fewer are the first of more.
    np.testing.assert_array_equal(make_guesses(3).across_detour, make_guesses(7).across_detour[:3])
    assert not np.array_equal(make_guesses(3, seed=1).across_detour, make_guesses(3).across_detour)
