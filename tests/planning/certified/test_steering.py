"""Paths by how they are steered: they begin as told, are where integration says, and are delivered without a jump."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from certified_cases import GRAVITY, LAYERED, STEADY, Dense, blowing, number
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from anser.numerics import compiled_quickly
from anser.planning.certified.certificate import path_bounds
from anser.planning.certified.steering import CELLS, Steering, first_coefficients, fly, steered, steered_path

DURATION, TICKS = 160.0, 128
WINDS = {"steady": STEADY, "layered": LAYERED}


def random_steering(seed, climbing=8.0):
    rng = np.random.default_rng(seed)
    headings = np.cumsum(rng.uniform(-0.15, 0.2, CELLS + 2))
    climbs = np.concatenate([np.zeros(2), rng.uniform(-climbing, climbing, CELLS)])
    speeds = np.concatenate([np.full(2, 150.0), 150.0 + np.cumsum(rng.uniform(-3.0, 3.0, CELLS))])
    return Steering(
        number(DURATION), number(1500.0), jnp.array([300.0, -700.0]), *map(jnp.asarray, (headings, climbs, speeds))
    )


deliver = compiled_quickly(lambda steering, wind: steered_path(3.0, steering, wind, TICKS, TICKS + 9))


def test_splines_begin_with_the_given_value_and_slope():
    steering = random_steering(1)
    begun = first_coefficients(0.4, -0.02, steering.cell)
    steering = eqx.tree_at(lambda s: s.headings, steering, steering.headings.at[:2].set(jnp.stack(begun)))
    now = steered(steering, np.zeros(1))
    assert float(now.heading[0]) == pytest.approx(0.4, abs=1e-12)
    assert float(now.heading_dot[0]) == pytest.approx(-0.02, abs=1e-12)
    assert float(now.climb[0]) == 0.0
    assert float(now.speed_dot[0]) == 0.0


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_splines_stay_between_their_coefficients_and_do_not_jump(seed):
    steering = random_steering(seed)
    now = steered(steering, np.linspace(0.0, 1.0, 21))
    for spline, slope, coefficients in (
        (now.climb, now.climb_dot, steering.climbs),
        (now.speed, now.speed_dot, steering.speeds),
    ):
        assert float(jnp.min(spline)) >= float(jnp.min(coefficients)) - 1e-9
        assert float(jnp.max(spline)) <= float(jnp.max(coefficients)) + 1e-9
        for part in (spline, slope):
            part = np.asarray(part).reshape(CELLS, 21)
            np.testing.assert_allclose(part[1:, 0], part[:-1, -1], atol=1e-9)


@pytest.mark.parametrize("name", WINDS)
def test_leads_where_integration_leads(name):
    wind, steering = WINDS[name], random_steering(5)
    flown = compiled_quickly(lambda s: fly(s, wind, TICKS))(steering)
    cell = float(steering.cell)

    def spline(coefficients, t):
        k = min(int(t / cell), CELLS - 1)
        u = t / cell - k
        c = np.asarray(coefficients)[k : k + 3]
        return c @ [0.5 * (1 - u) ** 2, 0.5 + u * (1 - u), 0.5 * u**2]

    def rates(t, state):
        heading, climb, speed = (spline(c, t) for c in (steering.headings, steering.climbs, steering.speeds))
        gust = blowing(wind, np.array([state[2]]))[0]
        level = np.sqrt(speed**2 - (climb + gust[2]) ** 2)
        return [level * np.cos(heading), level * np.sin(heading), climb, *gust]

    begun = [*np.asarray(steering.start), 1500.0, 0.0, 0.0, 0.0]
    found = solve_ivp(rates, (0.0, DURATION), begun, rtol=1e-10, atol=1e-8, max_step=cell / 8)
    end = found.y[:, -1]
    np.testing.assert_allclose(flown.level_n[-1], end[:2], atol=1e-4)
    np.testing.assert_allclose(flown.altitudes[-1], end[2], atol=1e-6)
    # Where the wind has a corner within an interval, quadrature across it.
    np.testing.assert_allclose(flown.drifts_n[-1], end[3:], atol=1e-6 if name == "steady" else 0.02)


@pytest.mark.parametrize("name", WINDS)
def test_is_delivered_without_a_jump_and_as_steered(name):
    wind, steering = WINDS[name], random_steering(7)
    path, flown = deliver(steering, wind)
    times = np.asarray(path.times)
    assert times[0] == 3.0
    np.testing.assert_allclose(times[TICKS:], 3.0 + DURATION, rtol=1e-15)
    dense = Dense(path, wind, 0.01)
    # Interpolated twice continuously differentiable by construction; what it asks is what was steered.
    through = dense.velocity - dense.blowing
    now = steered(steering, np.arange(50) / 50)
    at = np.linspace(0.0, DURATION, 50 * CELLS + 1)[:-1]
    seen = np.interp(at, dense.time - 3.0, np.linalg.norm(through, axis=1))
    np.testing.assert_allclose(seen, now.speed, atol=0.01 if name == "steady" else 0.05)
    heading = np.interp(at, dense.time - 3.0, np.unwrap(np.arctan2(through[:, 1], through[:, 0])))
    np.testing.assert_allclose(np.cos(heading - np.asarray(now.heading)), 1.0, atol=1e-6)
    np.testing.assert_allclose(dense.position[0], [300.0, -700.0, -1500.0], atol=1e-9)
    place = np.asarray(flown.level_n[-1]) + np.asarray(flown.drifts_n[-1, :2])
    np.testing.assert_allclose(dense.path(times[-1])[:2], place, atol=1e-6)


@pytest.mark.parametrize("name", WINDS)
def test_its_certificate_is_hardly_wider_than_what_is_flown_however_jerky(name):
    wind = WINDS[name]
    for seed in range(4):
        path, _ = deliver(random_steering(seed, climbing=25.0), wind)
        bounds, exact = path_bounds(path, wind, GRAVITY), Dense(path, wind).extremes()
        error = float(bounds.wind_error_max)
        for what in ("bank_max", "load_factor_max", "acceleration_max", "deceleration_max"):
            found = float(getattr(bounds, what))
            assert found >= exact[what] - 1e-9
            # The air's motion is known to the error: as much of g / V, and of the turn, as that is of the speed. Of the
            # acceleration along the path one polynomial's own coefficients are the bound, of the others a ratio's.
            part = 0.04 if what.endswith("celeration_max") else 0.01
            assert found <= exact[what] * (1.0 + part) + 0.02 * error + 1e-3, (what, seed)


def test_one_by_one_as_a_batch_and_derivatives_are_finite():
    steerings = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(random_steering(k) for k in range(3)))
    many = compiled_quickly(jax.vmap(lambda s: fly(s, LAYERED, TICKS)))(steerings)
    for k in range(3):
        one = compiled_quickly(lambda s: fly(s, LAYERED, TICKS))(jax.tree.map(lambda leaf, k=k: leaf[k], steerings))
        np.testing.assert_allclose(many.level_n[k], one.level_n, rtol=1e-12)

    def end(steering):
        path, _ = steered_path(0.0, steering, LAYERED, TICKS, TICKS + 5)
        return jnp.sum(path.position_n(DURATION)) + jnp.sum(path.air_velocity_n(0.4 * DURATION))

    slope = jax.grad(end)(random_steering(2))
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(slope))
    assert np.max(np.abs(slope.headings)) > 100.0
