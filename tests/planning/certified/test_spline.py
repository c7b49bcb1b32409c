"""Spline trajectories: prescribed end states, smoothness, and exact delivery through any wind."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.interpolate import BSpline

from anser.compiling.options import compiled_quickly
from anser.environment import LayeredWind
from anser.planning.certified.path_bounds import path_bounds
from anser.planning.certified.splines import (
    Spline,
    knot_coefficients,
    mean_squares,
    spline_path,
    spline_states,
    states_at,
)
from support.certified_cases import GRAVITY, LAYERED, STEADY, blowing, number

pytestmark = pytest.mark.long


CELLS, DURATION, INTERVALS, MORE = 16, 120.0, 64, 21
WINDS = {"steady": STEADY, "layered": LAYERED}


def random_spline(seed, climbing=900.0):
    """Nearly straight at 150 m/s, up and down through the layers of the wind."""
    rng = np.random.default_rng(seed)
    t = DURATION / CELLS * np.arange(-1, CELLS + 2)
    bow = np.cumsum(rng.normal(0.0, 120.0, CELLS + 3))
    height = 1500.0 + climbing * np.sin(2.0 * np.pi * t / DURATION + rng.uniform(0.0, 6.0))
    return Spline(number(DURATION), jnp.stack([jnp.asarray(150.0 * t), jnp.asarray(bow), -jnp.asarray(height)], 1))


bounds_of = compiled_quickly(lambda path, wind: path_bounds(path, wind, GRAVITY))
deliver = compiled_quickly(lambda spline, wind: spline_path(3.0, spline, wind, INTERVALS, INTERVALS + MORE))


def test_a_spline_is_the_b_spline_of_its_coefficients():
    spline = random_spline(1)
    cell = DURATION / CELLS
    oracle = BSpline(cell * np.arange(-3, CELLS + 4), np.asarray(spline.coefficients), 3)
    times = np.linspace(0.0, DURATION, 200)[:-1]
    states = states_at(spline, jnp.asarray(times))
    for order in range(3):
        np.testing.assert_allclose(states[:, order], oracle.derivative(order)(times), rtol=1e-9, atol=1e-8)


def test_states_by_interval_equal_states_by_time():
    spline, fractions = random_spline(2), np.array([0.0, 0.3, 1.0])
    times = DURATION / CELLS * (np.arange(CELLS)[:, None] + fractions[None, :])
    by_time = states_at(spline, jnp.asarray(times.ravel())).reshape(CELLS, 3, 3, 3)
    np.testing.assert_allclose(spline_states(spline, fractions), by_time, rtol=1e-9, atol=1e-8)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.5, 30.0))
def test_a_spline_has_the_prescribed_end_states(seed, cell):
    rng = np.random.default_rng(seed)
    end_states = rng.normal(0.0, 1.0, (2, 3, 3)) * np.array([1e4, 150.0, 5.0])[None, :, None]
    first_coefficients, last_coefficients = (knot_coefficients(cell) @ jnp.asarray(end) for end in end_states)
    spline = Spline(number(8 * cell), jnp.concatenate([first_coefficients, jnp.zeros((5, 3)), last_coefficients]))
    scale = np.array([1e4, 1e4 / cell, 1e4 / cell**2])[:, None]
    for time, end in zip((0.0, 8 * cell), end_states, strict=True):
        state = states_at(spline, number(time)[None])[0]
        np.testing.assert_allclose(state / scale, end / scale, atol=1e-12)


@pytest.mark.parametrize("name", WINDS)
def test_a_delivered_path_is_the_spline_in_its_wind(name):
    wind, spline = WINDS[name], random_spline(5)
    path = deliver(spline, wind)
    times = np.asarray(path.times)
    assert times[0] == 3.0
    assert times.size == INTERVALS + MORE
    assert np.all(np.diff(times) >= 0.0)
    np.testing.assert_allclose(times[-1], 3.0 + DURATION, rtol=1e-15)
    elapsed = np.linspace(0.0, DURATION, 777)
    states = states_at(spline, jnp.asarray(elapsed))
    np.testing.assert_allclose(jax.vmap(path.position_n)(3.0 + elapsed), states[:, 0], atol=1e-7)
    np.testing.assert_allclose(jax.vmap(path.velocity_n)(3.0 + elapsed), states[:, 1], atol=1e-7)
    through = np.asarray(states[:, 1]) - blowing(wind, -np.asarray(states[:, 0, 2]))
    np.testing.assert_allclose(jax.vmap(path.air_velocity_n)(3.0 + elapsed), through, atol=1e-6)


def test_the_drift_is_the_integral_of_the_wind():
    spline = random_spline(6)
    path = deliver(spline, LAYERED)

    def rates(t, _):
        return blowing(LAYERED, -np.asarray(states_at(spline, number(t)[None]))[0, :1, 2])[0]

    integral = solve_ivp(rates, (0.0, DURATION), np.zeros(3), rtol=1e-9, atol=1e-7, max_step=0.5)
    np.testing.assert_allclose(path.drift_n[-1, 0], integral.y[:, -1], atol=1e-3)


def test_jumps_of_the_winds_rate_have_two_knots_and_no_error():
    spline = random_spline(7)
    path = deliver(spline, LAYERED)
    edges = np.asarray(LAYERED.altitudes)
    over = -np.asarray(states_at(spline, jnp.linspace(0.0, DURATION, 20_001)))[:, :1, 2] > edges
    crossed = np.sum(over[1:] != over[:-1])
    assert crossed >= 2
    times = np.asarray(path.times)
    twins = np.flatnonzero((np.diff(times) == 0.0) & (times[1:] < 3.0 + DURATION))
    assert twins.size == crossed
    for k in twins:
        np.testing.assert_allclose(path.drift_n[k, :2], path.drift_n[k + 1, :2], atol=1e-7)
        assert np.max(np.abs(path.drift_n[k, 2] - path.drift_n[k + 1, 2])) > 1e-3
        edge = -float(path.air_n[k, 0, 2] + path.drift_n[k, 0, 2])
        assert np.min(np.abs(edge - edges)) < 1e-6
    assert float(path_bounds(path, LAYERED, GRAVITY).wind_error_max) < 1e-6


@pytest.mark.parametrize(("first_m", "last_m"), [(1000.0, 1800.0), (1800.0, 1000.0), (1000.0, 600.0), (600.0, 1000.0)])
def test_a_path_that_begins_or_ends_at_the_edge_of_a_layer_has_the_bounds_of_one_beside_it(first_m, last_m):
    """Climbs and descents from and to 1,000 m, where the rate of the wind jumps."""
    wind = LayeredWind(
        jnp.array([0.0, 1000.0, 3000.0]), jnp.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [20.0, 5.0, 0.0]])
    )
    cell, climb = DURATION / CELLS, np.sign(last_m - first_m) * 3.0
    t = cell * np.arange(-1, CELLS + 2)

    def bounds(shift_m):
        height = first_m + shift_m + (last_m - first_m) * np.clip(t / DURATION, 0.0, 1.0)
        coefficients = jnp.stack([jnp.asarray(150.0 * t), jnp.zeros(t.size), -jnp.asarray(height)], 1)
        for end, rows, time in ((first_m, slice(0, 3), 0.0), (last_m, slice(-3, None), DURATION)):
            state = jnp.array([[150.0 * time, 0.0, -end - shift_m], [150.0, 0.0, -climb], [0.0, 0.0, 0.0]])
            coefficients = coefficients.at[rows].set(knot_coefficients(cell) @ state)
        path = deliver(Spline(number(DURATION), coefficients), wind)
        return jax.tree.map(np.asarray, (path.times, bounds_of(path, wind)))

    (times, at_edge), (_, beside) = bounds(0.0), bounds(1.0)
    spans = np.diff(times)
    assert np.all((spans == 0.0) | (spans > 1e-4))
    for name in ("speed_min", "speed_max", "acceleration_max", "deceleration_max", "load_factor_max", "bank_max"):
        np.testing.assert_allclose(getattr(at_edge, name), getattr(beside, name), atol=0.02, err_msg=name)
    assert at_edge.wind_error_max < 0.01


def test_more_edges_than_knots_give_a_larger_bound():
    spline = random_spline(7)
    path = compiled_quickly(lambda m: spline_path(0.0, m, LAYERED, INTERVALS, INTERVALS + 2))(spline)
    assert float(path_bounds(path, LAYERED, GRAVITY).wind_error_max) > 0.01
    assert np.all(np.isfinite(path.drift_n))


def test_mean_squares_are_those_of_the_motion():
    spline = random_spline(8)
    squares = np.asarray(mean_squares())
    # In the mean over an interval, of place, velocity and acceleration.
    fine = np.asarray(spline_states(spline, (np.arange(2000) + 0.5) / 2000))[4]
    coefficients = np.asarray(spline.coefficients)[4:8]
    for order in range(3):
        mean_square = np.einsum("kl,ka,la->", squares[order], coefficients, coefficients) / (DURATION / CELLS) ** (
            2 * order
        )
        np.testing.assert_allclose(mean_square, np.mean(np.sum(fine[:, order] ** 2, axis=1)), rtol=1e-5)


def test_batches_equal_single_splines_with_finite_derivatives():
    splines = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(random_spline(k) for k in range(3)))
    batch = compiled_quickly(jax.vmap(lambda m: spline_path(3.0, m, LAYERED, INTERVALS, INTERVALS + MORE)))(splines)
    for k in range(3):
        single = deliver(jax.tree.map(lambda leaf, k=k: leaf[k], splines), LAYERED)
        np.testing.assert_allclose(batch.air_n[k], single.air_n, rtol=1e-9, atol=1e-9)

    def end(spline):
        path = spline_path(0.0, spline, LAYERED, INTERVALS, INTERVALS + MORE)
        return jnp.sum(path.position_n(0.7 * DURATION)) + jnp.sum(path.air_velocity_n(0.4 * DURATION))

    slope = compiled_quickly(jax.grad(end))(random_spline(2))
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(slope))
    assert np.max(np.abs(slope.coefficients)) > 0.1
