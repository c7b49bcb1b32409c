"""Dynamic limits on a whole path (theory section 6)."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from planning_cases import published_path, velocity

from anser.planning import LIMIT_MESSAGES, PathLimits, check_limits, fit_trajectory
from anser.planning.limits import (
    CLIMB_TOO_STEEP,
    NO_LEVEL_OFF,
    TOO_FAST,
    TOO_LOW,
    TOO_SLOW,
    TURN_TOO_TIGHT,
    WITHIN_LIMITS,
)

GRAVITY = 9.80665
WIDE = {"speed_min": 80.0, "speed_max": 250.0, "bank_max": 1.2, "climb_rate_max": 120.0, "altitude_min": -1e3}


def limits(**changes):
    return PathLimits(**{name: jnp.asarray(value) for name, value in (WIDE | changes).items()})


compare = jax.jit(check_limits)


def check(path, **changes):
    return compare(path, limits(**changes), GRAVITY)


@pytest.mark.parametrize(
    ("changes", "flag", "code"),
    [
        ({}, None, WITHIN_LIMITS),
        ({"speed_min": 155.0}, "speed_min_ok", TOO_SLOW),
        ({"speed_max": 160.0}, "speed_max_ok", TOO_FAST),
        ({"bank_max": 0.1}, "turn_ok", TURN_TOO_TIGHT),
        ({"climb_rate_max": 50.0}, "climb_ok", CLIMB_TOO_STEEP),
        ({"altitude_min": 100.0}, "altitude_ok", TOO_LOW),
        # it ends at altitude 0, in a descent
        ({"altitude_min": -1.0}, "level_off_ok", NO_LEVEL_OFF),
    ],
)
def test_each_limit_is_seen(changes, flag, code):
    report = check(published_path(-30.0, 0.005), **changes)
    assert report.status == code
    flags = ("speed_min_ok", "speed_max_ok", "turn_ok", "climb_ok", "altitude_ok", "level_off_ok")
    broken = {name for name in flags if not getattr(report, name)}
    # a path that is too low ends too low
    assert broken == ({flag} - {None}) | ({"level_off_ok"} if code == TOO_LOW else set())
    assert len(LIMIT_MESSAGES) == 7


def test_extremes_against_dense_sampling():
    path = published_path(-30.0, 0.005)
    report = check(path)
    t = np.linspace(0.0, 36.0, 20001)
    v, a = (np.asarray(jax.vmap(f)(t)) for f in (path.velocity_n, path.acceleration_n))
    speed = np.linalg.norm(v, axis=1)
    turn = np.abs(v[:, 0] * a[:, 1] - v[:, 1] * a[:, 0]) / (v[:, 0] ** 2 + v[:, 1] ** 2)
    # 129 samples miss a smooth extreme by a ten-thousandth part of its range.
    np.testing.assert_allclose([report.speed_min, report.speed_max], [speed.min(), speed.max()], rtol=1e-3)
    np.testing.assert_allclose(report.turn_rate_max, turn.max(), rtol=1e-3)
    np.testing.assert_allclose(report.turn_use_max, (turn * speed).max() / (GRAVITY * np.tan(1.2)), rtol=1e-3)
    np.testing.assert_allclose(report.climb_rate_max, np.abs(v[:, 2]).max(), rtol=1e-3)
    np.testing.assert_allclose(report.altitude_min, -np.asarray(jax.vmap(path.position_n)(t))[:, 2].max(), atol=0.1)


def test_wind_moves_the_ground_track_only():
    args = (
        0.0,
        36.0,
        jnp.array([0.0, 0.0, -800.0]),
        velocity(150.0, 0.0),
        jnp.array([5e3, 0.0, -800.0]),
        velocity(150.0, 0.3),
    )
    still, windy = fit_trajectory(*args), fit_trajectory(*args, wind_n=jnp.array([20.0, -30.0, 2.0]))
    a, b = check(still), check(windy)
    for name in ("speed_min", "speed_max", "turn_rate_max", "climb_rate_max"):
        assert getattr(a, name) == getattr(b, name)
    np.testing.assert_allclose(b.altitude_min, a.altitude_min - 72.0, atol=1e-9)


def test_gradient_jit_and_vmap_also_at_rest():
    path = published_path(-30.0, 0.005)

    def use(coefficients):
        return check(eqx.tree_at(lambda p: p.coefficients_n, path, coefficients)).turn_use_max

    slopes = jax.jit(jax.grad(use))
    for coefficients in (path.coefficients_n, jnp.zeros((3, 5))):
        assert jnp.all(jnp.isfinite(slopes(coefficients)))
    bends = jnp.array([0.0, 0.0025, 0.01])
    many = jax.vmap(lambda b_4: check(published_path(-30.0, b_4)).turn_use_max)(bends)
    np.testing.assert_allclose(many, [check(published_path(-30.0, b_4)).turn_use_max for b_4 in bends], rtol=1e-12)


def _descending(gamma_deg, height):
    gamma = np.radians(gamma_deg)
    end_n = jnp.array([6000.0, 0.0, -height])
    velocity_n = 150.0 * jnp.array([np.cos(gamma), 0.0, np.sin(gamma)])
    start_n = end_n - 40.0 * velocity_n
    return fit_trajectory(0.0, 40.0, start_n, velocity_n, end_n, velocity_n)


def test_the_end_state_is_what_a_hold_can_catch():
    """A straight descent of 43 m/s at 150 m/s: in 1 s 43 m, then the arc of 1 g; before, it was within all limits."""
    low, high = (check(_descending(16.66, height), altitude_min=100.0) for height in (220.0, 276.0))
    sink = 150.0 * np.sin(np.radians(16.66))
    # the arc, V^2 (1 - cos) / g, with the 7 percent that V^2 gains on the way
    lost = sink + (150.0**2 * (1 - np.cos(np.radians(16.66))) / 9.80665)
    np.testing.assert_allclose(276.0 - high.level_off_altitude, lost, rtol=0.05)
    assert bool(high.level_off_ok)
    assert int(high.status) == WITHIN_LIMITS
    assert not bool(low.level_off_ok)
    assert int(low.status) == NO_LEVEL_OFF
    assert "hold cannot level off" in LIMIT_MESSAGES[NO_LEVEL_OFF]
    # a load factor of 1.5 leaves 0.375 g
    assert float(check(_descending(16.66, 276.0), load_factor_max=1.5).level_off_altitude) < 50.0
