"""Autopilot loops broken at a trim point: identities, the meaning of margins, and flights of the nonlinear loop."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft.changes import AirframeChange, changed_airframe
from anser.aircraft_files import load_airframe
from anser.analysis.loop_margins import (
    NEUTRAL_POLE_TOLERANCE,
    breakpoints,
    excited_loop,
    frequencies,
    largest_pole,
    loop_margins,
    loop_response,
    loop_state_fields,
)
from anser.analysis.trim_points import gains_for
from anser.control import default_limits, published_gains
from anser.environment import standard_environment
from anser.simulation.response import LoopCase
from support.broken_loop import break_loop
from support.excited_flight import excited_flight
from support.trims import target_deg, trim

pytestmark = pytest.mark.long


STEP = 0.01
F16, ENVIRONMENT, LIMITS, GAINS = load_airframe(), standard_environment(), default_limits(), published_gains()
MEMORY, BREAKPOINTS = loop_state_fields(GAINS, F16), breakpoints(F16)


@pytest.fixture(scope="module")
def level():
    return trim(F16, ENVIRONMENT, target_deg(150.0, 1000.0))


@pytest.fixture(scope="module")
def loop(level):
    return eqx.filter_jit(excited_loop)(LoopCase(F16, ENVIRONMENT, GAINS, LIMITS, level, STEP), MEMORY)


@pytest.fixture(scope="module")
def response(loop):
    return eqx.filter_jit(loop_response)(loop, STEP, frequencies(STEP))


@pytest.fixture(scope="module")
def margins(loop, response):
    return eqx.filter_jit(loop_margins)(loop, STEP, response)


def test_no_command_depends_on_its_own_test_input_in_the_same_sample(loop):
    np.testing.assert_array_equal(np.diagonal(loop.D), 0.0)
    assert not np.asarray(loop.limited).any()
    assert np.isfinite(loop.A).all()
    # a test input at the bank command reaches the roll-rate command within the sample
    assert abs(loop.D[BREAKPOINTS.index("P"), BREAKPOINTS.index("mu")]) > 1.0


def test_a_trim_that_the_autopilot_does_not_hold_is_limited():
    """Level flight of TP-1538's F-16 has a sideslip; to remove it, the autopilot uses the full rate of the rudder."""
    airframe = load_airframe("f16", "tp1538")
    point = trim(airframe, ENVIRONMENT, target_deg(150.0, 1000.0))
    case = LoopCase(airframe, ENVIRONMENT, GAINS, LIMITS, point, STEP)
    loop = eqx.filter_jit(excited_loop)(case, loop_state_fields(GAINS, airframe))
    assert not loop.B[:, 2].any()
    np.testing.assert_array_equal(loop.limited, [False, False, False, False, True])


def test_state_fields_follow_from_the_gains():
    incremental = eqx.tree_at(lambda g: g.sensor_bandwidth, GAINS, jnp.asarray(20.0))
    assert set(loop_state_fields(incremental, F16)) - set(MEMORY) == {"residual"}
    integral = eqx.tree_at(lambda g: g.attitude.integral, GAINS, jnp.full(3, 0.1))
    assert set(loop_state_fields(integral, F16)) - set(MEMORY) == {"attitude_integral"}


def test_the_closed_loop_is_stable_except_for_the_uncontrolled_altitude(loop):
    poles = np.linalg.eigvals(np.asarray(loop.A))
    on_the_circle = np.abs(np.abs(poles) - 1) < NEUTRAL_POLE_TOLERANCE
    assert on_the_circle.sum() == 1
    assert np.abs(poles[~on_the_circle]).max() < 1
    assert abs(largest_pole(np.asarray(loop.A)) - 1) < NEUTRAL_POLE_TOLERANCE


@pytest.mark.parametrize("name", BREAKPOINTS)
def test_the_broken_loop_equals_the_closed_loop_opened(loop, response, name):
    """1 + L = det(zeta I - A) / det(zeta I - A_broken): zero at the closed loop's poles; and L from both sides."""
    k = BREAKPOINTS.index(name)
    A, B, C = (np.asarray(matrix) for matrix in break_loop(loop, k))
    unit = np.eye(len(A))
    for zeta in (1.3 + 0.2j, 0.7 - 0.6j, np.exp(0.04j)):
        L = (C @ np.linalg.solve(zeta * unit - A, B))[0, 0]
        ratio = np.linalg.det(zeta * unit - np.asarray(loop.A)) / np.linalg.det(zeta * unit - A)
        assert abs(1 + L - ratio) < 1e-9 * max(abs(1 + L), 1.0)
    # the kernel computes L from the closed loop; for large L, 1 + T_zw = 1/(1 + L) loses digits in proportion
    omega = np.asarray(response.omega)
    for n in range(0, omega.size, 24):
        L = (C @ np.linalg.solve(np.exp(1j * omega[n] * STEP) * unit - A, B))[0, 0]
        assert abs(response.open[n, k] - L) < 1e-9 * max(abs(L) ** 2, 1.0)


def radius_without_altitude(loop, k, factor):
    """Spectral radius with a factor, real or complex, at a breakpoint, without the altitude's pole at 1."""
    poles = np.linalg.eigvals(loop.A + (factor - 1) * np.outer(loop.B[:, k], loop.C[k]))
    return np.abs(np.delete(poles, np.abs(poles - 1).argmin())).max()


def radius_with_delay(loop, k, samples):
    """Spectral radius with the command at a breakpoint delayed by several samples, without the altitude's pole."""
    A, B, C = np.asarray(loop.A), np.asarray(loop.B)[:, k], np.asarray(loop.C)[k]
    n = len(A)
    delayed = np.zeros((n + samples, n + samples))
    delayed[:n, :n] = A - np.outer(B, C)
    delayed[:n, -1] = B
    delayed[n, :n] = C
    delayed[n + 1 :, n:-1] = np.eye(samples - 1)
    poles = np.linalg.eigvals(delayed)
    return np.abs(np.delete(poles, np.abs(poles - 1).argmin())).max()


@pytest.mark.parametrize("name", BREAKPOINTS)
def test_at_every_margin_the_spectral_radius_is_1(loop, margins, name):
    """Inside 1 up to each stated gain, phase, delay and disk, outside beyond; else inside up to the search bound."""
    loop, k = jax.tree.map(np.asarray, loop), BREAKPOINTS.index(name)
    figures = {key: float(values[k]) for key, values in vars(margins[0]).items()}
    for direction, overshoot_factor in (("up", 1.01), ("down", 0.99)):
        gain, searched = figures[f"gain_{direction}"], figures[f"gain_{direction}_searched"]
        stated = np.isfinite(gain) and gain > 0
        # unlimited search: up to factors at which rounding of the poles stays small
        last_factor = gain if stated else np.clip(searched, 1e-4, 1e4)
        for factor in np.geomspace(1.0, last_factor, 40)[1:-1]:
            assert radius_without_altitude(loop, k, factor) < 1
        if stated:
            assert radius_without_altitude(loop, k, gain) == pytest.approx(1.0, abs=1e-5)
            assert radius_without_altitude(loop, k, gain * overshoot_factor) > 1
    for share, is_outside in ((0.99, False), (1.01, True)):
        radii_by_phase = [
            radius_without_altitude(loop, k, np.exp(1j * sign * share * figures["phase"])) for sign in (1, -1)
        ]
        assert (max(radii_by_phase) > 1) == is_outside
        # every factor of the disk of this radius (skew 0)
        alpha = min(share * figures["disk"], 1.9999)
        if is_outside and alpha == 1.9999:
            continue
        edge = alpha * np.exp(1j * np.linspace(0, 2 * np.pi, 721)) / 2
        radii = [radius_without_altitude(loop, k, factor) for factor in (1 + edge) / (1 - edge)]
        assert (max(radii) > 1) == is_outside
    whole_samples = int(figures["delay"] / STEP)
    assert radius_with_delay(loop, k, whole_samples + 1) > 1
    assert whole_samples == 0 or radius_with_delay(loop, k, whole_samples) < 1


def test_the_simultaneous_disk_margin_is_below_each_actuator_margin(margins):
    single, simultaneous = margins
    assert 0.5 * float(single.disk[:3].min()) < float(simultaneous) <= float(single.disk[:3].min())


def flights_at_the_margins(margin):
    """Factors and delays of each surface's command just inside and outside its margins, and which diverge."""
    factors, delays, unstable = [], [], []
    for surface in range(3):
        for share in (0.9, 1.1):
            factors.append(np.where(np.arange(3) == surface, share * float(margin.gain_up[surface]), 1.0))
            delays.append(np.zeros(3, dtype=int))
            unstable.append(share > 1)
        whole_samples = int(float(margin.delay[surface]) / STEP)
        for delay_samples in (whole_samples, whole_samples + 1):
            factors.append(np.ones(3))
            delays.append(np.where(np.arange(3) == surface, delay_samples, 0))
            unstable.append(delay_samples > whole_samples)
    return jnp.asarray(np.array(factors)), jnp.asarray(np.array(delays)), np.array(unstable)


def growth_of(commands):
    """Divergence is at 10 Hz and more: second differences of the command separate it from slow settling."""
    shaking = np.abs(np.diff(np.asarray(commands), 2, axis=1)).max(axis=2)
    return shaking[:, -20:].max(axis=1) / shaking[:, :20].max(axis=1)


def test_the_nonlinear_loop_diverges_beyond_the_margins(level, margins):
    """Command of a surface scaled by 0.9 and 1.1 of the gain margin, or delayed by the samples around the delay margin."""
    factors, delays, unstable = flights_at_the_margins(margins[0])
    commands = excited_flight(F16, ENVIRONMENT, GAINS, LIMITS, level, STEP, factors, delays, 400)
    growth = growth_of(commands)
    assert np.isfinite(growth).all()
    np.testing.assert_array_equal(growth > 1.0, unstable)
    assert growth[unstable].min() > 2.0
    assert growth[~unstable].max() < 0.1


def test_the_margins_of_an_onboard_model_that_errs_hold_in_the_nonlinear_loop():
    """Half an elevator and 10 % of lift less, of which the model knows half: the residual holds the steady flight."""
    gains = gains_for("incremental")
    effects = {"drag": 1.0, "thrust": 1.0, "mass": 1.0, "actuator_bandwidth": 1.0, "cg_shift": 0.02, "lift_slope": 0.9}
    changes = [
        AirframeChange(
            jnp.asarray([elevator, 1.0, 1.0]), second_moments=jnp.ones(3), **jax.tree.map(jnp.asarray, values)
        )
        for elevator, values in ((0.5, effects), (0.75, {**effects, "cg_shift": 0.01, "lift_slope": 0.95}))
    ]
    aircraft, onboard = (changed_airframe(F16, change) for change in changes)
    point = trim(aircraft, ENVIRONMENT, target_deg(150.0, 1000.0))
    case = LoopCase(aircraft, ENVIRONMENT, gains, LIMITS, point, STEP, onboard)
    loop = eqx.filter_jit(excited_loop)(case, loop_state_fields(gains, aircraft))
    assert abs(largest_pole(np.asarray(loop.A))) <= 1 + NEUTRAL_POLE_TOLERANCE
    assert not np.asarray(loop.limited).any()
    margin = eqx.filter_jit(loop_margins)(loop, STEP, eqx.filter_jit(loop_response)(loop, STEP, frequencies(STEP)))[0]
    factors, delays, unstable = flights_at_the_margins(margin)
    commands = excited_flight(aircraft, ENVIRONMENT, gains, LIMITS, point, STEP, factors, delays, 400, onboard)
    np.testing.assert_array_equal(growth_of(commands) > 1.0, unstable)
    # at the trim nothing moves: the kick of 1e-9 rad/s stays small where the loop is stable
    assert np.abs(np.asarray(commands)[~unstable]).max() < 1e-7


def test_an_onboard_model_without_errors_changes_nothing(level):
    gains = gains_for("incremental")
    fields = loop_state_fields(gains, F16)
    alone, modelled = (
        eqx.filter_jit(excited_loop)(LoopCase(F16, ENVIRONMENT, gains, LIMITS, level, STEP, model), fields)
        for model in (None, F16)
    )
    np.testing.assert_allclose(modelled.A, alone.A, atol=1e-9)
    np.testing.assert_allclose(modelled.B, alone.B, atol=1e-9)
