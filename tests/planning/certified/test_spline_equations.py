"""Violations of splines: normal equations against automatic derivatives, violations against the independent checker."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.planning.certified.spline_search import make_guesses, spline_start
from anser.planning.certified.splines import (
    _SAMPLE_POINTS,
    Spline,
    SplineProblem,
    _limit_violations,
    _violations,
    arrives_forward,
    initial_limits,
    initial_state_n,
    normal_equations,
    spline_states,
    states_at,
    step_metric,
    tighten_limits,
    update_coefficients,
)
from anser.planning.certified.timed_profiles import speed_rates
from anser.planning.limits import CERTIFIED_LIMITS
from support.certified_cases import number, picked
from trials.cases import random_case
from trials.motion import path_demands
from trials.task import planner_task

CELLS = 16
GROUPS = CELLS // 4


def problem_of(seed, index, duration=230.0):
    tasks, airspace, _ = planner_task(random_case(seed))
    return SplineProblem(picked(tasks, index), airspace, number(duration))


_start = eqx.filter_jit(lambda problem, guess: spline_start(problem, CELLS, guess))
GUESSES = jax.jit(lambda: make_guesses(6))()


def start_of(problem, k=0):
    return _start(problem, picked(GUESSES, k))


def changes(seed, size=300.0):
    return jnp.asarray(np.random.default_rng(seed).normal(0.0, size, (GROUPS, 12)))


def dense(form):
    full = np.zeros((GROUPS, 12, GROUPS, 12))
    for k in range(GROUPS):
        full[k, :, k] = form.diagonal[k]
        if k:
            full[k, :, k - 1], full[k - 1, :, k] = form.subdiagonal[k], np.asarray(form.subdiagonal[k]).T
    return full.reshape(12 * GROUPS, 12 * GROUPS)


# Course and path angle prescribed; course alone; neither, with keep-outs.
TASKS = ((34, 1), (90, 3), (104, 0))


@pytest.mark.long
@pytest.mark.parametrize(("seed", "index"), TASKS)
def test_normal_equations_are_those_of_automatic_derivatives(seed, index):
    problem = problem_of(seed, index)
    start = start_of(problem, 2)

    def rows(x):
        spline = Spline(problem.duration, update_coefficients(start, problem.duration / CELLS, x))
        times = spline.cell * (jnp.arange(CELLS)[:, None] + jnp.asarray(_SAMPLE_POINTS)[None, :])
        violations_at = functools.partial(_violations, problem, start.allowed)
        return jax.vmap(jax.vmap(violations_at))(times, spline_states(spline, _SAMPLE_POINTS)).ravel()

    x = changes(seed)
    equations = jax.jit(functools.partial(normal_equations, problem))(start, x)
    violations = rows(x)
    jacobian = jax.jit(jax.jacfwd(rows))(x).reshape(violations.size, -1)
    assert np.sum(np.asarray(violations) > 0.0) > 20
    np.testing.assert_allclose(equations.cost, 0.5 * np.sum(np.asarray(violations) ** 2), rtol=1e-12)
    expected = np.asarray(jacobian.T @ jacobian)
    np.testing.assert_allclose(dense(equations.form), expected, atol=1e-12 * np.max(expected))
    gradient = np.asarray(jacobian.T @ violations)
    np.testing.assert_allclose(equations.gradient.ravel(), gradient, atol=1e-11 * np.max(np.abs(gradient)))


@pytest.mark.long
@pytest.mark.parametrize(("seed", "index"), TASKS)
def test_the_size_of_a_step_is_its_mean_motion(seed, index):
    problem = problem_of(seed, index)
    start = start_of(problem)
    cell = problem.duration / CELLS
    x = changes(seed + 1)
    # Of the last group, what changes nothing counts by itself.
    form = dense(step_metric(problem, start))
    inactive = np.flatnonzero(
        np.all(np.asarray(jax.jacfwd(lambda y: update_coefficients(start, cell, y))(x)) == 0.0, axis=(0, 1)).ravel()
    )
    assert inactive.size in (3, 4, 5)
    flat = np.array(x).ravel()
    flat[inactive] = 0.0
    step = update_coefficients(start, cell, jnp.asarray(flat).reshape(GROUPS, 12)) - start.coefficients
    fine = np.asarray(spline_states(Spline(problem.duration, step), (np.arange(400) + 0.5) / 400))
    sizes = np.mean(np.sum(fine**2, axis=3), axis=(0, 1)) / np.array([3000.0, 30.0, 3.0]) ** 2
    np.testing.assert_allclose(flat @ form @ flat, np.sum(sizes), rtol=1e-4)
    assert np.min(np.linalg.eigvalsh(form)) > 0.0


@eqx.filter_jit
def ends_of_a_change(problem, start, change):
    """States at both ends of a changed spline, and the prescribed ones."""
    coefficients = update_coefficients(start, problem.duration / CELLS, change)
    ends = states_at(Spline(problem.duration, coefficients), jnp.stack([number(0.0), problem.duration]))
    return *ends, initial_state_n(problem), problem.task.meeting_n(problem.duration)


limit_violations = eqx.filter_jit(_limit_violations)


@pytest.mark.parametrize(("seed", "index"), TASKS)
def test_changed_splines_keep_their_end_conditions(seed, index):
    problem = problem_of(seed, index)
    rendezvous = problem.task.rendezvous
    for k in range(6):
        start = start_of(problem, k)
        initial, final, given_initial, meeting_n = ends_of_a_change(problem, start, changes(k, 50.0))
        np.testing.assert_allclose(initial, given_initial, rtol=1e-9, atol=1e-8)
        np.testing.assert_allclose(final[0], meeting_n, rtol=1e-9)
        north, east, down = np.asarray(final[1])
        if rendezvous.course_prescribed:
            assert np.cos(np.arctan2(east, north) - float(rendezvous.course)) == pytest.approx(1.0, abs=1e-12)
        if rendezvous.path_angle_prescribed:
            assert np.arctan2(-down, np.hypot(north, east)) == pytest.approx(float(rendezvous.path_angle), abs=1e-9)


def test_a_backward_arrival_is_rejected():
    bound_start, free_start = start_of(problem_of(34, 1)), start_of(problem_of(104, 0))
    onward = bound_start.frame[:, 0]
    assert bool(arrives_forward(bound_start, 150.0 * onward))
    assert not bool(arrives_forward(bound_start, -150.0 * onward))
    assert bool(arrives_forward(free_start, -150.0 * onward))


def test_a_negative_limit_of_acceleration_is_tightened_by_lowering():
    """Of an aircraft that can only descend or decelerate."""
    problem = eqx.tree_at(lambda p: p.task.limits.acceleration_max, problem_of(1, 0), number(-0.5))
    allowed = initial_limits(problem, number(0.98))
    assert float(allowed.acceleration) == pytest.approx(-0.51)
    tightened = tighten_limits(problem, allowed, jnp.full(len(CERTIFIED_LIMITS), 0.1))
    assert float(tightened.acceleration) == pytest.approx(-0.51 * 1.13)
    gain, _ = speed_rates(problem.task)
    assert 0.0 < float(gain) < 0.1


def test_violations_agree_with_the_independent_checker():
    case = random_case(104)
    problem = problem_of(104, 0)
    allowed = initial_limits(problem, number(1.0))
    rng = np.random.default_rng(3)
    for _ in range(40):
        altitude = rng.uniform(200.0, 5000.0)
        velocity = rng.normal(0.0, 1.0, 3) * np.array([130.0, 130.0, 25.0])
        if np.hypot(*velocity[:2]) < 40.0:
            continue
        acceleration = rng.normal(0.0, 5.0, 3)
        violations = np.asarray(
            limit_violations(problem, allowed, number(altitude), jnp.asarray(velocity), jnp.asarray(acceleration))
        )
        wind = case.wind.at(np.array([altitude]))[:, 0]
        demands = path_demands(velocity[:, None], acceleration[:, None], wind[:, None], float(problem.airspace.gravity))
        side, normal, along = float(demands.side[0]), float(demands.normal[0]), float(demands.along[0])
        gravity = float(problem.airspace.gravity)
        expected = [
            max(float(allowed.speed_min) - demands.speed[0], demands.speed[0] - float(allowed.speed_max)) / 5.0,
            abs(side) - float(allowed.bank) * normal,
            np.hypot(side, normal) - float(allowed.load_factor) * gravity,
            max(along - float(allowed.acceleration), -along - float(allowed.deceleration)) / 0.3,
            (abs(demands.climb_rate[0]) - float(allowed.climb_rate)) / 2.0,
        ]
        # One in the root of the speed keeps derivatives finite.
        np.testing.assert_allclose(violations[:5], np.maximum(expected, 0.0), atol=0.02)


def test_limits_are_tightened_by_violations_and_never_empty():
    problem = problem_of(90, 3)
    problem = eqx.tree_at(lambda p: p.task.limits.load_factor_min, problem, number(0.5))
    limits = problem.task.limits
    allowed = initial_limits(problem, number(0.99))
    unchanged = tighten_limits(problem, allowed, jnp.full(len(CERTIFIED_LIMITS), -0.1))
    for value, reference in zip(unchanged, allowed, strict=True):
        np.testing.assert_allclose(value, reference, rtol=1e-15)
    over = np.zeros(len(CERTIFIED_LIMITS))
    fields = [limit.field for limit in CERTIFIED_LIMITS]
    over[fields.index("bank_max")] = 0.02
    over[fields.index("speed_min")] = 0.001
    over[fields.index("load_factor_min")] = 0.1
    tightened = tighten_limits(problem, allowed, jnp.asarray(over))
    assert float(tightened.bank) == pytest.approx(float(allowed.bank) * (1.0 - 0.026))
    assert float(tightened.speed_min) == pytest.approx(float(allowed.speed_min + 0.0013 * limits.speed_min))
    assert float(tightened.load_factor) == float(allowed.load_factor)
    assert float(tightened.load_factor_min) == pytest.approx(1.0 - 0.99 * 0.5 + 0.13)
    tightest = tighten_limits(problem, allowed, jnp.full(len(CERTIFIED_LIMITS), 50.0))
    assert float(tightest.speed_min) <= float(tightest.speed_max)
    assert float(tightest.bank) > 0.0
    assert float(tightest.load_factor_min) < 1.0
