"""Velocity loop: a demand applied to the aircraft gives the commanded motion (theory section 5, item 3)."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from anser.control import default_limits, published_gains
from anser.control.autopilot import velocity_control
from anser.control.autopilot_state import initial_autopilot_state
from anser.control.velocity_loop import AttitudeDemand, attitude_demand, limit_bank_rate, thrust_demand
from anser.parts import PathCommand
from anser.units import DEG_RAD
from support.control_cases import (
    AIRFRAME,
    DEGREE,
    QUICK,
    believed_motion,
    flights,
    model_of,
    setting_of,
    state_of,
    vectors,
)

modest = settings(deadline=None, max_examples=40)
ENGINE_BANDWIDTH = 5.0
G = 9.80665
LIMITS = default_limits()
MASS = AIRFRAME.mass_properties.mass


@jax.jit
def thrust_case(x, V_dot):
    """Demand, V_dot and missing thrust after the engine has responded, and the engine's response to the throttle."""
    setting = setting_of(x)
    power = setting.state.power
    demand = thrust_demand(model_of(setting.state, x), ENGINE_BANDWIDTH, V_dot)
    data = setting.condition.air_data
    steady = AIRFRAME.engine.power_for_thrust(demand.thrust, data)
    missing_thrust = demand.thrust - AIRFRAME.engine.propulsion(steady, data).force_b[0]
    later = eqx.tree_at(lambda s: s.power, setting.state, steady)
    actual = believed_motion(later, x)[1].path_rates[0]
    return (
        demand,
        actual,
        steady - power,
        AIRFRAME.engine.rate(setting.state.engine, demand.throttle, data).power,
        missing_thrust,
    )


@modest
@given(flights, st.floats(-3.0, 3.0))
def test_thrust_demand_inverts_the_motion(x, V_dot):
    demand, actual, gap, power_rate, missing_thrust = thrust_case(x, V_dot)
    assert 0.0 <= demand.throttle <= 1.0
    if not demand.saturated:
        # V_dot is linear in the thrust and the tables are inverted exactly; the flag's own tolerance is 1 N of 9.3 t
        assert actual == pytest.approx(V_dot, abs=1.1e-4)
    else:
        # the engine gives its utmost: too little at full power, too much at idle
        assert (missing_thrust > 0) == (actual < V_dot)
    # the throttle drives the engine toward the power wanted, never away
    assert gap * power_rate >= -1e-9


@modest
@given(flights, st.floats(50.5, 99.0), st.floats(-9.0, 9.0))
def test_throttle_inverts_the_lag_of_the_lit_engine(x, power, change):
    """Above 50 percent the lag is 5 1/s ([SL] RTAU), the bandwidth asked for: the rate is 5 (P_wanted - P)."""
    x = x.copy()
    x[12] = power
    data = setting_of_jit(x).condition.air_data
    thrust = propulsion(AIRFRAME.engine, np.clip(power + change, 50.5, 100.0), data).force_b[0]
    V_dot = V_dot_for_thrust(x, thrust)
    demand, _, gap, power_rate, _ = thrust_case(x, V_dot)
    assume(not demand.saturated)
    assert power_rate == pytest.approx(
        5.0 * float(gap), abs=2e-2
    )  # the gearing's gap of 0.0012 percent, and thrust to 1 N
    assert gap == pytest.approx(np.clip(power + change, 50.5, 100.0) - power, abs=1e-6)


setting_of_jit = jax.jit(setting_of)
propulsion = jax.jit(lambda engine, power, data: engine.propulsion(power, data))
aerodynamics = jax.jit(lambda airframe, *arguments: airframe.aerodynamics(*arguments))
limit_rate = jax.jit(limit_bank_rate)


@jax.jit
def V_dot_for_thrust(x, thrust):
    """Acceleration along the path for a thrust along body x; the equation of motion is linear in the thrust."""
    setting = setting_of(x)
    thrust_share = jnp.cos(setting.motion.alpha) * jnp.cos(setting.motion.beta)
    return setting.motion.path_rates[0] + (thrust - setting.condition.propulsive.force_b[0]) * thrust_share / MASS


@pytest.mark.parametrize(("V_dot", "throttle"), [(20.0, 1.0), (-20.0, 0.0)])
def test_thrust_beyond_the_engine_is_flagged(V_dot, throttle):
    x = np.array([150, 0.05, 0, 0, 0, 0, 0, 0, 0, -0.04, 0.0, 0.0, 60, 1000, 0, 0, 0])
    demand, actual, *_ = thrust_case(x, V_dot)
    assert demand.saturated
    assert abs(actual) < abs(V_dot)
    assert demand.throttle == pytest.approx(throttle)


# coordinated flight: no sideslip, roll, yaw, aileron or rudder, hence no side force
straight = vectors(
    (110.0, 240.0),
    (0.0, 12 * DEGREE),
    (0.0, 0.0),
    (-1.0, 1.0),
    (-0.6, 0.6),
    (-3.1, 3.1),
    (0.0, 0.0),
    (-0.2, 0.2),
    (0.0, 0.0),
    (-10 * DEGREE, 10 * DEGREE),
    *((0.0, 0.0),) * 2,
    (0.0, 60.0),
    (100.0, 6000.0),
    *((-20.0, 20.0),) * 3,
)


def _attitude(state, x, gamma_dot, chi_dot):
    return attitude_demand(model_of(state, x), gamma_dot, chi_dot)


@jax.jit
def attitude_case(x, gamma_dot, chi_dot):
    """Demand; demand at the demanded bank; path rates with the demanded alpha only, and with both angles."""
    demand = _attitude(state_of(x), x, gamma_dot, chi_dot)
    banked = x.at[3].set(demand.angles[0])
    at_bank = _attitude(state_of(banked), x, gamma_dot, chi_dot)
    actual = believed_motion(state_of(banked.at[1].set(at_bank.angles[1])), x)[1].path_rates
    at_present_bank = believed_motion(state_of(x.at[1].set(demand.angles[1])), x)[1].path_rates
    return demand, at_bank, at_present_bank, actual


@modest
@given(straight, st.floats(-0.03, 0.1), st.floats(-0.12, 0.12))
def test_attitude_demand_inverts_the_motion(x, gamma_dot, chi_dot):
    """Both path rates come true with both angles; gamma_dot comes true at the present bank already."""
    demand, at_bank, at_present_bank, actual = attitude_case(jnp.asarray(x), gamma_dot, chi_dot)
    assert demand.angles[2] == 0.0
    for values in (demand, at_bank):
        assert LIMITS.alpha_min <= values.angles[1] <= LIMITS.alpha_max
        assert abs(values.angles[0]) <= LIMITS.bank_max
    # lift is piecewise nearly linear in alpha: of 20,000 generic cases two Newton steps leave less than 1e-4 rad/s in 99
    # percent, 6e-4 in the worst; hypothesis finds 1e-3 when alpha has 20 deg to go
    if not demand.alpha_saturated:
        assert at_present_bank[1] == pytest.approx(gamma_dot, abs=3e-3)
    if not (demand.alpha_saturated or demand.bank_saturated or at_bank.alpha_saturated):
        assert actual[1:] == pytest.approx(np.array([gamma_dot, chi_dot]), abs=3e-3)


LEVEL = np.array([150, 0.05, 0, 0, 0, 0, 0, 0, 0, -0.04, 0.0, 0.0, 10, 1000, 0, 0, 0])


def _demand_at(gamma_dot, chi_dot, bank=0.0, V=150.0):
    x = LEVEL.copy()
    x[0], x[3] = V, bank
    return attitude_case(jnp.asarray(x), gamma_dot, chi_dot)[0]


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_bank_limit_is_respected_and_flagged(side):
    demand = _demand_at(0.0, side * 0.5)
    assert demand.angles[0] == pytest.approx(side * 60 * DEG_RAD)
    assert demand.bank_saturated
    assert not demand.alpha_saturated


def test_load_factor_limit_is_flagged_and_gives_five_g():
    """2 rad/s at 150 m/s would be 31 g."""
    x = LEVEL.copy()
    x[0] = 230.0  # fast enough for 5 g below 25 deg of alpha
    demand, _, at_present_bank, _ = attitude_case(jnp.asarray(x), 2.0, 0.0)
    assert demand.alpha_saturated
    # V gamma_dot + g = n g; two Newton steps over a distance of 15 deg of alpha leave 1 percent
    assert (230.0 * at_present_bank[1] + G) / G == pytest.approx(5.0, rel=1e-2)


def test_alpha_limits_are_respected_and_flagged_at_low_speed():
    pull, push = _demand_at(0.5, 0.0, V=90.0), _demand_at(-0.5, 0.0, V=90.0)
    assert pull.angles[1] == pytest.approx(25 * DEG_RAD)
    assert push.angles[1] == pytest.approx(-5 * DEG_RAD)
    assert pull.alpha_saturated
    assert push.alpha_saturated


def test_the_lift_demand_grows_with_bank_and_vanishes_in_an_upset():
    """L cos(mu) = m g in a turn: alpha increases with bank. Far from the commanded bank the lift is unloaded."""
    turns = [(b * DEGREE, G * np.tan(b * DEGREE) / 150.0) for b in (0, 30, 60, 75)]
    alpha = [float(_demand_at(0.0, chi_dot, bank=bank).angles[1]) for bank, chi_dot in turns]
    assert np.all(np.diff(alpha) > 0)
    for bank in (90, 130, 170, -170):
        upset = _demand_at(0.0, 0.0, bank=bank * DEGREE)
        # no lift at all: zero-lift alpha of this airframe lies between -3 and 1 deg
        assert -3 * DEGREE < upset.angles[1] < 1 * DEGREE
        assert upset.alpha_saturated
    # at 60 deg from the wanted bank all of the lift is asked for still, at 75 deg about half
    assert not _demand_at(0.0, 0.0, bank=59 * DEGREE).alpha_saturated
    assert _demand_at(0.0, 0.0, bank=75 * DEGREE).angles[1] < alpha[3]


def _up(up_g, chi_dot):
    """Demand for an upward acceleration, gravity included, given in g."""
    return _demand_at((up_g - 1.0) * G / 150.0, chi_dot)


def test_the_bank_fades_out_with_the_demanded_lift():
    """Downward lift turns the wrong way: no bank is demanded, and the integral of the course is frozen.

    A slight turn: a share r = side / 0.5 g of the acceleration up to 0.5 g is reserved for it.
    """
    side_g = 150 * 0.002 / G
    r = side_g / 0.5
    bank = [_up(up_g, 0.002) for up_g in (1.0, 0.3, 0.1, 0.0, -0.5)]
    assert bank[0].angles[0] == pytest.approx(np.arctan2(side_g, 1.0))
    assert not bank[0].bank_saturated
    assert bank[1].angles[0] == pytest.approx(np.arctan2(side_g, 0.3 + 0.2 * r))
    assert 0.0 < bank[3].angles[0] < bank[2].angles[0] < bank[1].angles[0]
    assert bank[4].angles[0] == pytest.approx(0.0, abs=1e-12)
    for demand in bank[2:]:
        assert demand.bank_saturated


@pytest.mark.parametrize("up_g", [0.3, 0.0, -1.0, -5.0])
def test_a_push_over_in_a_turn_leaves_half_a_g(up_g):
    chi_dot = np.deg2rad(3.0)
    demand = _up(up_g, chi_dot)
    assert demand.angles[0] == pytest.approx(np.arctan2(150 * chi_dot, 0.5 * G))
    assert demand.alpha_saturated
    assert demand.angles[1] == pytest.approx(float(_up(0.5, chi_dot).angles[1]))


@modest
@given(st.floats(75.0, 130.0), st.floats(0.05, 0.6), st.floats(-0.05, 0.15), st.sampled_from([1.0, -1.0]))
@example(75.0, 0.25, -0.03125, 1.0)  # a path bent down leaves lift for more bank than level flight does
def test_the_bank_demand_stays_within_the_available_lift(V, chi_dot, gamma_dot, side):
    """At the demanded bank, 0.9 of the lift at alpha_max keeps the path level, or bends it down as commanded.

    The limit of alpha is then not reached. A push-over leaves half a g upward for the turn.
    """
    x = LEVEL.copy()
    x[0] = V
    demand = attitude_case(jnp.asarray(x), gamma_dot, side * chi_dot)[0]
    x[3] = demand.angles[0]
    down = np.clip(gamma_dot, -0.499 * G / V, 0.0)
    level_demand = attitude_case(jnp.asarray(x), down, side * chi_dot)[0]
    assume(float(level_demand.angles[0]) != 0.0)  # slower than the stall at 0.9 of the lift: no bank at all
    assert not level_demand.alpha_saturated
    assert level_demand.angles[1] < LIMITS.alpha_max
    if demand.bank_saturated and abs(demand.angles[0]) < LIMITS.bank_max - 1e-9:
        # what is there is used: (g + s V gamma_dot, s V chi_dot) is as long as 0.9 of the lift at alpha_max over mass
        acceleration_max = 0.9 * _greatest_lift(x) / float(MASS)
        share = np.tan(abs(demand.angles[0])) * G / (V * chi_dot - np.tan(abs(demand.angles[0])) * V * gamma_dot)
        assert np.hypot(G + share * V * gamma_dot, share * V * chi_dot) == pytest.approx(acceleration_max, rel=1e-6)


def _greatest_lift(x):
    """Lift at the limit of alpha in the same condition, including the component of thrust."""
    setting = setting_of_jit(x)
    data = eqx.tree_at(lambda d: d.alpha, setting.condition.air_data, LIMITS.alpha_max)
    force_b = np.asarray(aerodynamics(AIRFRAME, data, setting.state.rates_b, setting.state.surfaces).force_b)
    force_b = force_b + np.asarray(setting.condition.propulsive.force_b)
    return float(force_b[0] * np.sin(LIMITS.alpha_max) - force_b[2] * np.cos(LIMITS.alpha_max))


def _all_demands(x):
    model = model_of(state_of(x), x)
    thrust, attitude = thrust_demand(model, ENGINE_BANDWIDTH, 0.5), attitude_demand(model, 0.01, 0.02)
    return jnp.concatenate([thrust.throttle[None], thrust.thrust[None], attitude.angles])


_demands_jit = jax.jit(_all_demands)
_slopes = jax.jit(jax.jacrev(_all_demands), compiler_options=QUICK)


@pytest.mark.long
@pytest.mark.parametrize("change", [{}, {0: 1.0}, {4: np.pi / 2}, {3: np.pi}, {3: np.pi / 2}, {1: 1.5}, {2: np.pi / 2}])
def test_values_and_gradients_are_finite(change):
    x = LEVEL.copy()
    for k, value in change.items():
        x[k] = value
    assert np.isfinite(_demands_jit(x)).all()
    assert np.isfinite(_slopes(x)).all()


@pytest.mark.long
def test_a_batch_equals_single_demands():
    batch = np.stack([LEVEL, LEVEL * 1.1])
    for x, batch_row in zip(batch, jax.jit(jax.vmap(_all_demands), compiler_options=QUICK)(batch), strict=True):
        np.testing.assert_allclose(batch_row, _demands_jit(x), rtol=1e-12)


def _demand(bank):
    """Demand of a bank angle (rad) without saturation."""
    false = jnp.asarray(False)
    return AttitudeDemand(jnp.array([bank, 0.1, 0.0]), false, false, false, false)


SLOW = eqx.tree_at(lambda v: v.bank_rate_max, LIMITS, jnp.asarray(5.0 * DEGREE), is_leaf=lambda leaf: leaf is None)
STEP = 0.01


@modest
@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_the_commanded_bank_changes_within_the_rate_limit(previous_bank, target_bank):
    limited, bank = limit_rate(_demand(target_bank), jnp.asarray(previous_bank), SLOW, STEP)
    assert limited.angles[0] == bank
    assert abs(bank - previous_bank) <= 5.0 * DEGREE * STEP * (1 + 1e-12)
    assert min(previous_bank, target_bank) - 1e-15 <= bank <= max(previous_bank, target_bank) + 1e-15  # rounding
    assert limited.bank_saturated == (bank != target_bank)
    np.testing.assert_array_equal(limited.angles[1:], _demand(target_bank).angles[1:])


def test_the_commanded_bank_reaches_the_target():
    bank = jnp.zeros(())
    for _ in range(200):
        limited, bank = limit_rate(_demand(0.15), bank, SLOW, STEP)
    assert bank == 0.15
    assert not limited.bank_saturated


@pytest.mark.parametrize("previous_bank", [3.0, -2.0])
def test_the_bank_command_after_an_upset_is_within_the_limit_at_once(previous_bank):
    _, bank = limit_rate(_demand(0.0), jnp.asarray(previous_bank), SLOW, STEP)
    assert abs(abs(bank) - (LIMITS.bank_max - 5.0 * DEGREE * STEP)) < 1e-12
    assert bank * previous_bank > 0.0


def test_the_bank_command_without_a_rate_limit_is_unchanged():
    demand = _demand(0.9)
    limited, bank = limit_bank_rate(demand, None, LIMITS, STEP)
    assert limited is demand
    assert bank is None


@pytest.mark.long
@pytest.mark.parametrize(("side", "bound"), [(1.0, LIMITS.speed_max), (-1.0, LIMITS.speed_min)])
def test_a_command_beyond_the_range_of_airspeeds_does_not_go_on(side, bound):
    x = np.array([float(bound), 0.05, 0, 0, 0, 0, 0, 0, 0, -0.04, 0.0, 0.0, 60, 1000, 0, 0, 0])
    setting, zero = setting_of(x), jnp.zeros(())
    model = model_of(setting.state, x)
    memory = initial_autopilot_state(jnp.zeros(3), setting.state.rates_b, setting.state.surfaces)

    def throttle(V, V_dot):
        command = PathCommand(jnp.asarray(V), zero, zero, jnp.asarray(V_dot), zero, zero)
        return float(velocity_control(model, published_gains(), memory, command)[0].throttle)

    beyond = float(bound) + side * 5.0
    at_rest = throttle(beyond, 0.0)
    assert 0.0 < at_rest < 1.0
    assert throttle(beyond, 2.0 * side) == at_rest
    # back into the range, and on to the bound, as commanded
    assert (throttle(beyond, -2.0 * side) - at_rest) * side < 0.0
    assert (throttle(float(bound) - side * 5.0, 2.0 * side) - throttle(float(bound) - side * 5.0, 0.0)) * side > 0.0
