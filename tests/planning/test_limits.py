"""Dynamic limits along a path (theory section 6)."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.planning import PathLimits
from anser.planning.limits import CERTIFIED_LIMITS, LIMIT_MESSAGES, LIMITS, RELAXED_TOGETHER
from anser.planning.published.planner import check_limits
from anser.scenario.schema_settings import Limits
from anser.variables import CATALOGUE, PLAN_VARIABLES
from support.planning_cases import fit, published_path, velocity

GRAVITY = 9.80665
WIDE = {"speed_min": 80.0, "speed_max": 250.0, "bank_max": 1.2, "climb_rate_max": 120.0, "altitude_min": -1e3}


def limits(**changes):
    return PathLimits(**{name: jnp.asarray(value) for name, value in (WIDE | changes).items()})


compare = jax.jit(check_limits)


def check(path, **changes):
    return compare(path, limits(**changes), GRAVITY)


CHECKED = [limit for limit in LIMITS if limit.violation]


@pytest.mark.parametrize(
    ("changes", "key", "message"),
    [
        ({}, None, "within all limits"),
        ({"speed_min": 155.0}, "airspeed_min", "less than the least airspeed"),
        ({"speed_max": 160.0}, "airspeed_max", "more than the greatest airspeed"),
        ({"bank_max": 0.1}, "bank_max", "turns faster"),
        ({"climb_rate_max": 50.0}, "climb_rate_max", "climbs or descends faster"),
        ({"altitude_min": 100.0}, "altitude_min", "below the least altitude"),
        # it ends at altitude 0, in a descent
        ({"altitude_min": -1.0}, "level_off_min", "hold cannot level off"),
    ],
)
def test_each_limit_is_checked(changes, key, message):
    report = check(published_path(-30.0, 0.005), **changes)
    assert message in LIMIT_MESSAGES[int(report.status)]
    broken = {limit.key for limit, is_satisfied in zip(CHECKED, report.is_satisfied, strict=True) if not is_satisfied}
    # a path that is too low ends too low
    assert broken == ({key} - {None}) | ({"level_off_min"} if key == "altitude_min" else set())


def test_every_limit_names_a_setting_of_a_scenario_and_a_variable():
    variables = {variable.key for variable in (*CATALOGUE, *PLAN_VARIABLES)}
    for limit in LIMITS:
        assert limit.scenario_key in Limits.model_fields
        assert limit.variable in variables
    # the rate of the bank angle shapes the turns, and is looked at in splines; no certificate holds it
    assert {limit.field for limit in CERTIFIED_LIMITS} == set(PathLimits.__dataclass_fields__) - {
        "idle",
        "bank_rate_max",
    }
    relaxed_fields = {item.field for group in RELAXED_TOGETHER.values() for item in group}
    assert relaxed_fields == {limit.field for limit in CERTIFIED_LIMITS}


def test_a_relaxed_limit_is_less_strict():
    tight = limits(
        altitude_max=3e3, load_factor_max=4.0, load_factor_min=0.5, acceleration_max=2.0, deceleration_max=2.0
    )
    for limit in CERTIFIED_LIMITS:
        value = getattr(tight, limit.field)
        assert limit.excess(limit.relaxed(value, 1.5), value) > 0.0
        assert limit.excess(value, limit.relaxed(value, 1.5)) < 0.0
        # 1 changes nothing but the last digit of an arc tangent
        np.testing.assert_allclose(limit.relaxed(value, 1.0), value, rtol=1e-15)


def test_extremes_equal_dense_sampling():
    path = published_path(-30.0, 0.005)
    report = check(path)
    t = np.linspace(0.0, 36.0, 20001)
    p, v, a = (np.asarray(jax.jit(jax.vmap(f))(t)) for f in (path.position_n, path.velocity_n, path.acceleration_n))
    speed = np.linalg.norm(v, axis=1)
    turn = np.abs(v[:, 0] * a[:, 1] - v[:, 1] * a[:, 0]) / (v[:, 0] ** 2 + v[:, 1] ** 2)
    # 129 samples miss a smooth extreme by a ten-thousandth part of its range.
    np.testing.assert_allclose([report.speed_min, report.speed_max], [speed.min(), speed.max()], rtol=1e-3)
    np.testing.assert_allclose(report.turn_rate_max, turn.max(), rtol=1e-3)
    np.testing.assert_allclose(report.turn_utilization_max, (turn * speed).max() / (GRAVITY * np.tan(1.2)), rtol=1e-3)
    np.testing.assert_allclose(report.climb_rate_max, np.abs(v[:, 2]).max(), rtol=1e-3)
    np.testing.assert_allclose(report.altitude_min, -p[:, 2].max(), atol=0.1)


def test_wind_moves_the_ground_track_only():
    args = (
        0.0,
        36.0,
        jnp.array([0.0, 0.0, -800.0]),
        velocity(150.0, 0.0),
        jnp.array([5e3, 0.0, -800.0]),
        velocity(150.0, 0.3),
    )
    still, windy = fit(*args), fit(*args, wind_n=jnp.array([20.0, -30.0, 2.0]))
    a, b = check(still), check(windy)
    for name in ("speed_min", "speed_max", "turn_rate_max", "climb_rate_max"):
        assert getattr(a, name) == getattr(b, name)
    np.testing.assert_allclose(b.altitude_min, a.altitude_min - 72.0, atol=1e-9)


@pytest.mark.long
def test_gradients_and_batches_are_finite_at_rest():
    path = published_path(-30.0, 0.005)

    def use(coefficients):
        return check(eqx.tree_at(lambda p: p.coefficients_n, path, coefficients)).turn_utilization_max

    slopes = jax.jit(jax.grad(use))
    for coefficients in (path.coefficients_n, jnp.zeros((3, 5))):
        assert jnp.all(jnp.isfinite(slopes(coefficients)))
    bends = jnp.array([0.0, 0.0025, 0.01])
    batch = jax.jit(jax.vmap(lambda b_4: check(published_path(-30.0, b_4)).turn_utilization_max))(bends)
    np.testing.assert_allclose(
        batch, [check(published_path(-30.0, b_4)).turn_utilization_max for b_4 in bends], rtol=1e-12
    )


def _descending(gamma_deg, height):
    gamma = np.radians(gamma_deg)
    end_n = jnp.array([6000.0, 0.0, -height])
    velocity_n = 150.0 * jnp.array([np.cos(gamma), 0.0, np.sin(gamma)])
    start_n = end_n - 40.0 * velocity_n
    return fit(0.0, 40.0, start_n, velocity_n, end_n, velocity_n)


def test_the_end_state_can_be_levelled_off_by_the_hold():
    """A straight descent of 43 m/s at 150 m/s: 43 m in 1 s, then the arc with 1 g; the path is within the limits."""
    low, high = (check(_descending(16.66, height), altitude_min=100.0) for height in (220.0, 276.0))
    sink = 150.0 * np.sin(np.radians(16.66))
    # the arc, V^2 (1 - cos) / g, with the 7 percent that V^2 gains on the way
    lost = sink + (150.0**2 * (1 - np.cos(np.radians(16.66))) / 9.80665)
    np.testing.assert_allclose(276.0 - high.level_off_altitude, lost, rtol=0.05)
    assert bool(high.is_satisfied[-1])
    assert int(high.status) == 0
    assert not bool(low.is_satisfied[-1])
    assert "hold cannot level off" in LIMIT_MESSAGES[int(low.status)]
    # a load factor of 1.5 leaves 0.375 g
    assert float(check(_descending(16.66, 276.0), load_factor_max=1.5).level_off_altitude) < 50.0
