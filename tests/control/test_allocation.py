"""Allocation: surface deflections for a target moment (theory section 5, item 1)."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given, settings

from anser.control.allocation import allocate, surface_moments
from support.control_cases import AIRFRAME, DEGREE, QUICK, setting_of, vectors

modest = settings(deadline=None, max_examples=60)
LOWER, UPPER = np.asarray(AIRFRAME.actuators.lower), np.asarray(AIRFRAME.actuators.upper)

# V, alpha, beta, mu, gamma, chi; rates; surfaces; power, altitude; no wind
conditions = vectors(
    (90.0, 240.0),
    (-8 * DEGREE, 30 * DEGREE),
    (-10 * DEGREE, 10 * DEGREE),
    *((-1.0, 1.0),) * 3,
    *((-0.8, 0.8),) * 3,
    *((-24 * DEGREE, 24 * DEGREE), (-20 * DEGREE, 20 * DEGREE), (-28 * DEGREE, 28 * DEGREE)),
    (0.0, 100.0),
    (100.0, 9000.0),
    *((0.0, 0.0),) * 3,
)
inside = vectors((-23.9 * DEGREE, 23.9 * DEGREE), (-21 * DEGREE, 21 * DEGREE), (-29 * DEGREE, 29 * DEGREE))


def _moment(setting, surfaces):
    forces = AIRFRAME.aerodynamics(setting.condition.air_data, setting.state.rates_b, surfaces)
    return forces.moment_b + setting.condition.propulsive.moment_b


def _scale(setting):
    size = jnp.stack([AIRFRAME.span, AIRFRAME.mean_chord, AIRFRAME.span])
    return setting.condition.air_data.qbar * AIRFRAME.wing_area * size


def _allocate(condition, rates_b, surfaces, moment_b):
    return allocate(AIRFRAME, condition, rates_b, surface_moments(AIRFRAME, condition, rates_b, surfaces), moment_b)


@jax.jit
def allocated(x, target):
    """Allocation of the moment of the `target` deflections, twice in a row; moment errors as coefficients."""
    setting = setting_of(x)
    rates_b = setting.state.rates_b
    target_b = _moment(setting, target)
    first_demand = _allocate(setting.condition, rates_b, setting.state.surfaces, target_b)
    second_demand = _allocate(setting.condition, rates_b, first_demand.surfaces, target_b)
    errors = [
        (_moment(setting, demand.surfaces) - target_b) / _scale(setting) for demand in (first_demand, second_demand)
    ]
    return first_demand, second_demand, errors


def _piece(elevator_rad):
    """Index of the deflection's piece of the elevator table (-24, -12, 0, 12, 24 deg; [SL] appendix A).

    Counted from the first breakpoint, as in the table, so that -1e-79 deg rounds to the piece above 0 in both.
    """
    return np.floor((elevator_rad / DEGREE + 24) / 12)


@modest
@example(np.array([90.0, *[0.0] * 8, -5e-79, 0.0, 0.0, 0.0, 100.0, 0.0, 0.0, 0.0]), np.array([-0.2, 0.0, 0.0]))
@given(conditions, inside)
def test_the_target_moment_is_reached_from_any_deflection(x, target):
    first_demand, second_demand, (error, second_error) = allocated(x, target)
    # the moments are linear in aileron and rudder, and in the elevator within a piece of its table: rounding only
    assert np.abs(error[jnp.array([0, 2])]).max() < 1e-13
    if _piece(x[9]) == _piece(target[0]):
        assert np.abs(error).max() < 1e-13
        np.testing.assert_allclose(first_demand.surfaces, target, atol=1e-11)
    # across breakpoints (measured on 20,000 cases): at most 0.051 of pitching moment is left at first, none at the next
    assert np.abs(error).max() < 0.06
    assert np.abs(second_error).max() < 1e-13
    within = (np.asarray(second_demand.surfaces) >= LOWER) & (np.asarray(second_demand.surfaces) <= UPPER)
    np.testing.assert_array_equal(np.asarray(second_demand.saturated), ~within)


LEVEL = np.array([150, 0.05, 0, 0, 0, 0, 0, 0, 0, -0.04, 0.0, 0.0, 20, 1000, 0, 0, 0])


MOMENT_B = np.array([500.0, -1000.0, 200.0])


def _demand(x, moment_b, push_b):
    setting = setting_of(x)
    condition = eqx.tree_at(lambda c: c.propulsive.moment_b, setting.condition, push_b)
    return _allocate(condition, setting.state.rates_b, setting.state.surfaces, moment_b)


demand_of = jax.jit(_demand)


def _surfaces(x, moment_b):
    return _demand(x, moment_b, jnp.zeros(3)).surfaces


slopes_of = jax.jit(jax.jacrev(_surfaces, argnums=(0, 1)), compiler_options=QUICK)


@pytest.mark.parametrize(("channel", "roll_pitch_yaw"), [(0, (0, 1, 0)), (1, (1, 0, 0)), (2, (0, 0, 1))])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_moments_beyond_the_stops_are_flagged_and_stay_bounded(channel, roll_pitch_yaw, sign):
    """A coefficient of 1 is ten times the moment of full deflection; the iterate stays within the slack of 0.2 rad."""
    qbar = 0.5 * 1.1117 * 150.0**2  # 1000 m, [USSA76]
    demand = demand_of(LEVEL, sign * qbar * 27.87 * 9.144 * np.array(roll_pitch_yaw, dtype=float), np.zeros(3))
    assert demand.saturated[channel]
    assert np.all(np.abs(demand.surfaces) <= UPPER + 0.2 + 1e-12)
    # positive deflections give negative moments in all three axes of this airframe ([SL] section 3.5)
    assert sign * demand.surfaces[channel] < 0


def test_engine_moments_are_not_demanded_from_the_surfaces():
    push_b = np.array([100.0, 2000.0, -300.0])
    relieved = demand_of(LEVEL, MOMENT_B, push_b).surfaces
    np.testing.assert_allclose(relieved, demand_of(LEVEL, MOMENT_B - push_b, np.zeros(3)).surfaces, atol=1e-13)
    assert np.abs(relieved - demand_of(LEVEL, MOMENT_B, np.zeros(3)).surfaces).max() > 1e-3


@pytest.mark.long
def test_gradient_is_the_inverse_of_the_effectiveness():
    """d(surfaces)/d(moment) times d(moment)/d(surfaces) is the identity."""
    slope = slopes_of(LEVEL, MOMENT_B)[1]
    effectiveness = jax.jit(jax.jacfwd(lambda s: _moment(setting_of(LEVEL), s)), compiler_options=QUICK)(LEVEL[9:12])
    # within one piece of the elevator table and at fixed alpha, beta the moments are linear in the surfaces
    np.testing.assert_allclose(slope @ effectiveness, np.eye(3), atol=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("V", [1.0, 150.0])
def test_gradient_with_respect_to_the_condition_is_finite(V):
    x = LEVEL.copy()
    x[0] = V
    assert np.isfinite(slopes_of(x, MOMENT_B)[0]).all()


def test_zero_dynamic_pressure_keeps_the_deflections_finite():
    x = LEVEL.copy()
    x[0] = 0.0
    np.testing.assert_array_equal(demand_of(x, MOMENT_B, np.zeros(3)).surfaces, x[9:12])


@pytest.mark.long
def test_a_batch_equals_single_demands():
    batch, nothing = np.stack([LEVEL, LEVEL * 1.1]), np.zeros(3)
    together = jax.jit(jax.vmap(lambda x: _demand(x, MOMENT_B, nothing).surfaces), compiler_options=QUICK)(batch)
    for x, surfaces in zip(batch, together, strict=True):
        np.testing.assert_allclose(surfaces, demand_of(x, MOMENT_B, nothing).surfaces, atol=1e-13)
