"""Linear part of the loops: theory section 5 and section 9 no. 4."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anser.control.feedback import Differentiator, advance_integral, limit_to_braking, virtual_control, wrap_angle
from anser.control.gains import LoopGains
from support.control_cases import vectors

triples = vectors(*((-5.0, 5.0),) * 3)
modest = settings(deadline=None, max_examples=30)


# Compiled once each, not operation by operation.
advance_integral, limit_to_braking, virtual_control, wrap_angle = map(
    jax.jit, (advance_integral, limit_to_braking, virtual_control, wrap_angle)
)
advanced_state = jax.jit(lambda start, *arguments: Differentiator(start).advance(*arguments).state)
rate_of = jax.jit(lambda start, *arguments: Differentiator(start).rate(*arguments))
limited_rate_of = jax.jit(lambda start, *arguments: Differentiator(start).limited_rate(*arguments))
wrap_slope = jax.jit(jax.grad(wrap_angle))


@jax.jit
def ramp_rates(slope, offset, bandwidth, step, times):
    def one(state, t):
        reference = offset + slope * t
        return state.advance(reference, bandwidth, step), state.rate(reference, bandwidth, step)

    return jax.lax.scan(one, Differentiator(offset), times)[1]


@modest
@given(triples, triples, st.floats(2.0, 40.0), st.sampled_from([0.005, 0.01, 0.05]))
def test_rate_of_a_ramp_is_exact_once_the_filter_has_settled(slope, offset, bandwidth, step):
    """A sampled ramp has the same rate for every period: the mean of x_dot over a step, not the initial value."""
    rates = ramp_rates(slope, offset, bandwidth, step, step * np.arange(6000))
    # settled: at least 6000 * 0.005 s * 2 / s = 60 time constants; then rounding of the ramp (up to 1500) over the step
    np.testing.assert_allclose(rates[-1], slope, rtol=0, atol=1500 * 1e-15 / step * 40)


@modest
@given(triples, triples, st.floats(2.0, 40.0))
def test_the_filter_is_exact_for_a_constant_reference_at_any_step(start, reference, bandwidth):
    """x(t) = r + (x_0 - r) exp(-N t), for any division of the time into steps."""
    single_step, three_steps = advanced_state(start, reference, bandwidth, 0.06), start
    for _ in range(3):
        three_steps = advanced_state(three_steps, reference, bandwidth, 0.02)
    exact = reference + (start - reference) * np.exp(-bandwidth * 0.06)
    np.testing.assert_allclose(single_step, exact, rtol=0, atol=1e-13)
    np.testing.assert_allclose(three_steps, exact, rtol=0, atol=1e-13)


def test_rate_tends_to_the_filter_equation_for_short_steps():
    """r_dot = N (r - x) in the limit; the first correction is N step / 2 = 2e-5."""
    rate = rate_of(jnp.array([1.0, 2.0, 3.0]), jnp.array([2.0, 2.0, 1.0]), 4.0, 1e-5)
    np.testing.assert_allclose(rate, [4.0, 0.0, -8.0], rtol=3e-5)


@modest
@given(*[triples] * 8)
def test_virtual_control_is_the_published_law(kp, ki, kd, kf, error, integral, r_dot, y_dot):
    nu = virtual_control(LoopGains(kp, ki, kd, kf), error, integral, r_dot, y_dot)
    np.testing.assert_allclose(nu, kf * r_dot + kp * error + ki * integral + kd * (r_dot - y_dot), atol=1e-12)


def test_virtual_control_closes_an_integrator_onto_a_ramp():
    """With y_dot = nu the error dynamics are e_dot = -K_P e - K_I int e: the printed minus sign would diverge."""
    gains = LoopGains(*(jnp.full(3, g) for g in (2.0, 0.5, 0.0, 1.0)))
    step, slope = 0.01, jnp.array([0.3, -0.2, 1.0])

    def one(carry, t):
        y, integral = carry
        error = slope * t + 1.0 - y
        nu = virtual_control(gains, error, integral, slope, jnp.zeros(3))
        return (y + step * nu, advance_integral(integral, error, jnp.asarray(False), step)), error

    _, errors = jax.lax.scan(one, (jnp.zeros(3), jnp.zeros(3)), step * jnp.arange(4000.0))
    # slowest pole 1 - sqrt(0.5) = 0.29 1/s: exp(-0.29 * 40) = 9e-6
    assert np.abs(errors[-1]).max() < 2e-5
    assert np.abs(errors[0]).max() == pytest.approx(1.0)


@modest
@given(vectors(*((-50.0, 50.0),) * 3))
def test_a_wrapped_angle_is_the_same_angle_within_half_a_turn(angle):
    result = np.asarray(wrap_angle(angle))
    assert np.all(np.abs(result) <= np.pi)
    turns = (angle - result) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-13)


@pytest.mark.parametrize("angle", [0.0, 1.0, -2.5, 6.5, 3.0 - 2 * np.pi])
def test_a_wrapped_angle_has_unit_slope(angle):
    assert wrap_slope(angle) == pytest.approx(1.0, abs=1e-14)


@modest
@given(triples, triples, st.tuples(*[st.booleans()] * 3))
def test_only_saturated_channels_stop_integrating(integral, error, saturated):
    advanced = advance_integral(integral, error, np.array(saturated), 0.01)
    # Exact, but for products below the least normal number: XLA makes them zero.
    tiny = np.finfo(float).tiny
    np.testing.assert_allclose(advanced, np.where(saturated, integral, integral + 0.01 * error), rtol=0.0, atol=tiny)


def test_one_flag_stops_all_channels():
    integral = jnp.array([0.1, 0.2, 0.3])
    np.testing.assert_array_equal(advance_integral(integral, jnp.ones(3), jnp.asarray(True), 0.01), integral)


def test_batched_equals_single():
    batch = np.arange(12.0).reshape(4, 3)
    together = jax.jit(jax.vmap(lambda r: Differentiator(jnp.zeros(3)).rate(r, 4.0, 0.01)))(batch)
    for reference, rate in zip(batch, together, strict=True):
        # the same sums; vectorized code may round the product differently
        np.testing.assert_allclose(rate, rate_of(np.zeros(3), reference, 4.0, 0.01), rtol=1e-15)


GAINS = LoopGains(jnp.array([10.0, 2.0, 4.0]), jnp.zeros(3), jnp.array([1.0, 0.0, 0.0]), jnp.ones(3))
BANDWIDTH = np.array([5.0, 2.0, 4.0])
"""K_P / (1 + K_D)."""
LIMIT = jnp.array([3.0, 0.5, 1.0])


@modest
@given(triples)
def test_the_limited_error_is_linear_near_zero_and_follows_the_stopping_law_beyond(error):
    limited = np.asarray(limit_to_braking(GAINS, error, LIMIT))
    edge = np.asarray(LIMIT) / BANDWIDTH**2
    is_linear = np.abs(error) <= edge
    np.testing.assert_array_equal(limited[is_linear], error[is_linear])
    # v = K e' with v^2 / 2 L = |e| - edge / 2: the way to a stop from v, up to where the linear law takes over
    speed = BANDWIDTH * np.abs(limited)
    np.testing.assert_allclose((speed**2 / (2 * np.asarray(LIMIT)))[~is_linear], (np.abs(error) - edge / 2)[~is_linear])
    assert np.all(np.sign(limited) == np.sign(error))
    assert np.all(np.abs(limited) <= np.abs(error))


def test_the_limited_error_never_demands_more_acceleration():
    """e_dot = -K e': |e_ddot| stays at L on the way, and the error still converges to zero."""
    step = 1e-3

    def one(error, _):
        rate = -BANDWIDTH * limit_to_braking(GAINS, error, LIMIT)
        return error + step * rate, (error, rate)

    _, (errors, rates) = jax.lax.scan(one, jnp.array([4.0, -5.0, 3.0]), None, length=20_000)
    acceleration = np.abs(np.diff(np.asarray(rates), axis=0)) / step
    # explicit steps of 1 ms overtake the exact law by K step = 0.5 percent
    assert np.all(acceleration <= np.asarray(LIMIT) * 1.006)
    assert np.abs(np.asarray(errors)[-1]).max() < 1e-3


def test_the_limited_error_has_a_continuous_finite_slope():
    slope = jax.jit(jax.vmap(jax.grad(lambda e: limit_to_braking(GAINS, jnp.full(3, e), LIMIT)[0])))
    edge = 3.0 / 25
    values = slope(jnp.array([-2.0, 0.0, edge - 1e-9, edge + 1e-9, 5.0]))
    assert np.isfinite(values).all()
    np.testing.assert_allclose(values[1:4], 1.0, atol=1e-6)
    none = LoopGains(jnp.zeros(3), jnp.zeros(3), jnp.zeros(3), jnp.zeros(3))
    assert np.isfinite(jax.jit(jax.jacfwd(lambda e: limit_to_braking(none, e, LIMIT)))(jnp.ones(3))).all()


def test_the_feed_forward_is_limited_to_the_rate_of_the_filter():
    start, reference = np.zeros(3), np.array([1e-3, 1.0, -1.0])
    unlimited_rate = rate_of(start, reference, 4.0, 0.01)
    limited_rate = limited_rate_of(start, reference, 4.0, 0.01, np.array([0.5, 0.5, 0.2]))
    np.testing.assert_allclose(limited_rate, [unlimited_rate[0], 0.5 / 4, -0.2 / 4])
