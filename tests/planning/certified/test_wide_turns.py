"""Wider turns: paths with the same ends and lengths at a smaller bank angle."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.compiling.options import compiled_quickly
from anser.planning import PathLimits
from anser.planning.certified.certified_plan import plan_at
from anser.planning.certified.detours import (
    DETOUR_KINDS,
    WIDTHS,
    WORDS,
    direct_path,
    greatest_bank_rate,
    greatest_curvature,
    solve_detour,
    solve_racetrack,
    widen_detour,
    widen_direct,
    widen_directs,
    widen_racetrack,
)
from anser.planning.certified.profile import make_profile
from anser.planning.certified.routes import route
from anser.planning.certified.timed_profiles import MINIMAL, curvature_limits
from support.aircraft_tasks import aircraft_task
from support.certified_cases import detours_of, random_ends
from trials.cases import random_case
from trials.task import planner_task

CASES = 24
LONGER = 1.1
ENDS = random_ends(21, CASES, 15.0, 40.0)
DETOURS = detours_of(np.arange(DETOUR_KINDS), np.ones(DETOUR_KINDS))


@compiled_quickly
@jax.vmap
def _solve_wide(endpoints):
    """Tight and wide direct paths, detours and a racetrack: solutions, routes and curvatures."""
    directs = jax.vmap(lambda word: direct_path(endpoints, word))(jnp.asarray(WORDS))
    base = jax.tree.map(lambda leaf: leaf[jnp.argmin(directs.length)], directs)
    wide = widen_directs(endpoints, base)

    def solve_pair(tight, wider):
        return [
            (solution, route(endpoints, solution), greatest_curvature(endpoints, solution))
            for solution in (tight, wider)
        ]

    def detoured(shape):
        tight = solve_detour(endpoints, base, shape, LONGER * base.length)
        return solve_pair(tight, widen_detour(endpoints, wide, shape, LONGER * base.length, tight))

    longer = base.length + 4.0 * np.pi / endpoints.curvature_max
    lap = solve_racetrack(endpoints, base, jnp.ones(()), longer)
    return (
        base,
        wide,
        widen_direct(endpoints, base, 0.0),
        jax.vmap(detoured)(DETOURS),
        (longer, solve_pair(lap, widen_racetrack(endpoints, wide, jnp.ones(()), longer, lap))),
    )


@pytest.fixture(scope="module")
def solutions():
    return jax.tree.map(np.asarray, _solve_wide(ENDS))


def lead_to_their_ends(shape, solved, endpoints=ENDS):
    """Check that the valid routes have the prescribed end position and heading."""
    exists = np.asarray(solved.exists)
    end, heading = np.asarray(endpoints.end), np.asarray(endpoints.end_heading)
    end, heading = (x.reshape(-1, *[1] * (exists.ndim - 1)) for x in (end, heading))
    end_error = np.abs(shape.positions[..., -1] - end)
    heading_error = np.abs(np.exp(1j * (shape.headings[..., -1] - heading)) - 1.0)
    assert np.all(end_error[exists] <= 1e-6 * shape.marks[..., -1][exists])
    assert np.all(heading_error[exists] < 1e-9)


@pytest.mark.long
def test_zero_width_leaves_the_path_unchanged(solutions):
    base, _, same, _, _ = solutions
    np.testing.assert_allclose(same.length, base.length, rtol=1e-9)
    np.testing.assert_array_equal(same.scales, 1.0)


@pytest.mark.long
def test_direct_paths_of_wide_turns_are_longer_the_wider_they_are(solutions):
    base, wide, _, _, _ = solutions
    assert np.mean(wide.exists) > 0.8
    lengths = np.where(wide.exists, wide.length, np.nan)
    assert np.all(np.isnan(lengths) | (lengths >= base.length[:, None] * (1.0 - 1e-9)))
    wider = wide.scales[:, :-1] > wide.scales[:, 1:]
    assert np.all(wider.any(axis=2)[wide.exists[:, 0]])
    assert len(WIDTHS) == wide.length.shape[1]
    exists = wide.exists[:, 0] & wide.exists[:, -1]
    assert np.all(wide.length[exists, 0] >= wide.length[exists, -1] * (1.0 - 1e-9))


@pytest.mark.long
def test_detours_of_wide_turns_are_as_long_and_bank_less(solutions):
    base, _, _, ((tight, _, sharp), (wider, shape, gentle)), _ = solutions
    assert np.array_equal(wider.exists | tight.exists, wider.exists)
    lead_to_their_ends(shape, wider)
    length = np.broadcast_to(LONGER * base.length[:, None], wider.exists.shape)
    np.testing.assert_allclose(shape.marks[..., -1][wider.exists], length[wider.exists], rtol=2e-6)
    exists = tight.exists & wider.exists
    assert np.all(gentle[exists] <= sharp[exists] * (1.0 + 1e-9))
    assert np.median(gentle[exists] / sharp[exists]) < 0.6  # most have room


@pytest.mark.long
def test_racetracks_of_wide_turns_are_as_long_and_bank_less(solutions):
    _, _, _, _, (longer, ((tight, _, sharp), (wider, shape, gentle))) = solutions
    assert np.all(wider.exists == (wider.exists | tight.exists))
    lead_to_their_ends(shape, wider)
    np.testing.assert_allclose(shape.marks[:, -1][wider.exists], longer[wider.exists], rtol=1e-6)
    assert np.all(gentle <= sharp * (1.0 + 1e-9))


BANK_RATE = np.radians(4.0)
LIMITED = PathLimits(*(jnp.asarray(x) for x in (100.0, 200.0, 0.5, 40.0, 200.0)), bank_rate_max=jnp.asarray(BANK_RATE))


def test_ramps_keep_the_limit_of_the_bank_rate():
    """The bank rate is greatest with level wings: sharpness V^3 / g."""
    task = aircraft_task((30_000.0, 0.0, 0.0))
    level = make_profile(200.0, (2000.0, 2000.0), (0.0, 0.0), 0.0, 0.0, (150.0, 150.0, 150.0), 0.0)
    curvature, free_sharpness = curvature_limits(task, 9.81, level)
    limited_curvature, limited_sharpness = curvature_limits(eqx.tree_at(lambda t: t.limits, task, LIMITED), 9.81, level)
    assert free_sharpness * 150.0**3 / 9.81 > 0.5 > BANK_RATE  # the task rolls with 0.5 rad/s on the mean
    assert limited_curvature < curvature  # of 0.5 rad of bank instead of 0.9
    np.testing.assert_allclose(limited_sharpness * 150.0**3 / 9.81, BANK_RATE, rtol=1e-12)


@pytest.mark.long
def test_plans_of_random_tasks_keep_the_limit_of_the_bank_rate():
    plan_count = 0
    for seed in (2, 9, 12, 63):
        tasks, airspace, _ = planner_task(random_case(seed))
        bank_rates = jnp.full(tasks.active.shape, BANK_RATE)
        tasks = eqx.tree_at(lambda t: t.limits.bank_rate_max, tasks, bank_rates, is_leaf=lambda leaf: leaf is None)
        plan = plan_at(0.0, tasks, airspace, jnp.full(tasks.active.shape, 280.0), 256, MINIMAL)
        rates = jax.vmap(greatest_bank_rate, in_axes=(0, None))(plan.paths, airspace.gravity)
        flyable = np.asarray(plan.feasible) & (np.asarray(tasks.active) > 0.0)
        plan_count += flyable.sum()
        # Layered wind turns the lift a little besides, and a quintic is no clothoid.
        assert np.all(np.asarray(rates)[flyable] <= 1.05 * BANK_RATE)
    assert plan_count >= 5
