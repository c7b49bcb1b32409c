"""The autopilot flying the F-16 to and beyond its limits: one compiled batch of flights, examined one by one."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft import AircraftState
from anser.control import default_limits, published_gains
from anser.control.autopilot_state import AutopilotState, initial_autopilot_state
from anser.spatial.rotations import quaternion_from_rotation
from anser.spatial.wind_axes import attitude_from_path
from support.autopilot_cases import ALTITUDE, Case, arrays, fly, memory_of
from support.control_cases import AIRFRAME, DEGREE

pytestmark = pytest.mark.long


STEPS = 4000
SAMPLING = (0.005, 0.01, 0.02, 0.03, 0.05)


def _banked(trim, mu):
    R_bn = attitude_from_path(mu, 0.0, 0.0, trim.alpha, trim.beta)
    state = eqx.tree_at(lambda s: s.quaternion, trim.state, quaternion_from_rotation(R_bn))
    return state, initial_autopilot_state(
        jnp.stack([jnp.asarray(mu), trim.alpha, trim.beta]), state.rates_b, state.surfaces
    )


def _cases(trims) -> dict[str, Case]:
    north, south = trims
    start = (north.state, memory_of(north))
    at_rest = eqx.tree_at(lambda s: s.velocity_b, north.state, jnp.zeros(3))
    cases = {
        "trimmed": (*start, 150, 0, 0, 0.005),
        "right": (*start, 150, 0, 20, 0.01),
        "left": (*start, 150, 0, -20, 0.01),
        "across south": (south.state, memory_of(south), 150, 0, -170, 0.01),
        "about": (*start, 150, 0, 170, 0.01),
        "climb": (*start, 150, 20, 0, 0.01),
        "dive and turn": (*start, 150, -20, 20, 0.01),
        "too fast": (*start, 300, 0, 0, 0.02),
        "too slow": (*start, 60, 0, 0, 0.02),
        "inverted": (*_banked(north, np.pi), 150, 0, 0, 0.01),
        "knife edge": (*_banked(north, -np.pi / 2), 150, 0, 0, 0.01),
        "at rest": (at_rest, start[1], 150, 0, 0, 0.02),
        **{f"sampled at {step} s": (*start, 150, 2, 10, step) for step in SAMPLING},
    }
    return {
        name: Case(state, memory, float(V), gamma * DEGREE, chi * DEGREE, step)
        for name, (state, memory, V, gamma, chi, step) in cases.items()
    }


class Flown(eqx.Module):
    """History of one flight as NumPy arrays."""

    state: AircraftState
    motion: dict
    surfaces: np.ndarray
    throttle: np.ndarray
    signals: object
    memory: AutopilotState
    load: np.ndarray
    step: float


@pytest.fixture(scope="module")
def flights(trims):
    """The flights as one compiled batch."""
    cases = _cases(trims)
    batch = jax.jit(jax.vmap(lambda case: fly(case, published_gains(), default_limits(), STEPS)))
    _, batch_rows = batch(jax.tree.map(lambda *leaves: jnp.stack(leaves), *map(arrays, cases.values())))
    history = {}
    for k, (name, case) in enumerate(cases.items()):
        state, controls, signals, memory, load = jax.tree.map(lambda leaf, k=k: np.asarray(leaf[k]), batch_rows)
        motion = {n: getattr(signals.motion, n) for n in ("V", "gamma", "chi", "mu", "alpha", "beta")}
        history[name] = Flown(state, motion, controls.surfaces, controls.throttle, signals, memory, load, case.step)
    return history


def test_trimmed_flight_is_a_fixed_point(flights, trims):
    """20 s; only the trim's residual (1e-8 g, integrated) and rounding remain."""
    flown, trim = flights["trimmed"], trims[0]
    assert STEPS * flown.step == 20.0
    np.testing.assert_allclose(flown.surfaces, np.tile(trim.controls.surfaces, (STEPS, 1)), atol=1e-6)
    np.testing.assert_allclose(flown.throttle, trim.controls.throttle, atol=1e-6)
    np.testing.assert_allclose(flown.motion["V"], 150.0, atol=1e-5)
    for name in ("gamma", "chi", "mu", "beta"):
        np.testing.assert_allclose(flown.motion[name], 0.0, atol=1e-6)
    np.testing.assert_allclose(
        flown.state.position_n[-1], [150.0 * (STEPS - 1) * flown.step, 0.0, -ALTITUDE], atol=1e-3
    )


def test_every_flight_stays_finite(flights):
    """Also in air at rest: no division by a zero airspeed, for any motion of the aircraft."""
    for name, flown in flights.items():
        for leaf in jax.tree.leaves((flown.state, flown.memory, flown.surfaces, flown.throttle)):
            assert np.isfinite(leaf).all(), name
        assert np.all((flown.throttle >= 0) & (flown.throttle <= 1)), name
        assert np.all(np.abs(flown.surfaces) <= np.asarray(AIRFRAME.actuators.upper) + 1e-12), name


def test_a_turn_may_cross_south(flights):
    """A turn from 170 to -170 deg equals a turn from 0 to 20 deg, up to rounding that the loops amplify a little."""
    north, south = flights["right"], flights["across south"]
    np.testing.assert_allclose(south.motion["mu"], north.motion["mu"], atol=1e-9)
    course_change = np.unwrap(south.motion["chi"]) - 170 * DEGREE
    np.testing.assert_allclose(course_change, north.motion["chi"], atol=1e-9)
    assert np.ptp(south.motion["chi"]) > 6.0


def test_left_and_right_turns_differ_by_the_engine_only(flights):
    """The airframe is symmetric; the spinning engine (216.9 kg m^2/s) is not: a fraction of a degree of bank."""
    right_turn, left_turn = flights["right"].motion, flights["left"].motion
    assert 0.0 < np.abs(right_turn["mu"] + left_turn["mu"]).max() < 1.0 * DEGREE
    np.testing.assert_allclose(right_turn["chi"], -left_turn["chi"], atol=0.2 * DEGREE)


def test_the_bank_limit_holds_in_a_long_turn(flights):
    """In many seconds of saturation, the bank does not overshoot 60 deg, nor the course afterwards."""
    flown = flights["about"]
    assert flown.signals.attitude.bank_saturated.mean() > 0.3
    assert flown.motion["mu"].max() < 60.5 * DEGREE
    # integral gain: 0.025 times an integral that stood still meanwhile
    assert flown.motion["chi"].max() < 170.5 * DEGREE
    assert flown.motion["chi"][-1] == pytest.approx(170 * DEGREE, abs=0.2 * DEGREE)
    np.testing.assert_allclose(flown.motion["V"], 150.0, atol=1.0)


def test_a_batched_flight_equals_a_single_flight(flights, trims, turn_outputs):
    """The first second of a flight of the batch; vectorized code sums in another order."""
    single = turn_outputs(arrays(_cases(trims)["right"]), published_gains(), default_limits())
    batched = flights["right"]
    assert float(single[0]) == pytest.approx(batched.state.position_n[100, 1], abs=1e-9)
    for value, name in zip(single[1:], ("V", "gamma", "chi"), strict=True):
        assert float(value) == pytest.approx(batched.motion[name][99], abs=1e-10)


@pytest.mark.parametrize(("name", "limit"), [("too fast", 240.0), ("too slow", 90.0)])
def test_speed_commands_are_kept_within_the_limits(flights, name, limit):
    """The commands are 300 and 60 m/s. Full throttle and idle on the way do not wind up the integral."""
    V = flights[name].motion["V"]
    assert flights[name].signals.speed_limited.all()
    assert not flights["right"].signals.speed_limited.any()
    assert V[-1] == pytest.approx(limit, abs=0.3)
    assert np.all((V >= 89.5) & (V <= 241.0))
    np.testing.assert_allclose(flights[name].motion["gamma"], 0.0, atol=0.2 * DEGREE)


def test_load_factor_and_alpha_are_limited_in_a_pull_up(flights):
    """A path-angle step of 20 deg demands 6.3 g; 5 g and 25 deg of alpha are allowed, exceeded by at most 5 %.

    When the elevator has increased alpha, the path angle demands less.
    """
    flown = flights["climb"]
    assert flown.signals.attitude.alpha_saturated.any()
    assert 3.5 < flown.load.max() < 5.25
    assert flown.motion["alpha"].max() < 26 * DEGREE
    assert flown.motion["gamma"].max() < 20 * DEGREE * 1.05
    assert flown.motion["gamma"][-1] == pytest.approx(20 * DEGREE, abs=0.3 * DEGREE)


def test_a_push_over_does_not_turn_the_wrong_way(flights):
    """With downward lift, a right bank would turn left: the bank waits, then turns right."""
    flown = flights["dive and turn"]
    assert flown.load.min() < -0.3
    assert flown.motion["chi"].min() > -0.2 * DEGREE
    assert flown.motion["chi"][-1] == pytest.approx(20 * DEGREE, abs=0.3 * DEGREE)
    assert flown.motion["gamma"][-1] == pytest.approx(-20 * DEGREE, abs=0.3 * DEGREE)


@pytest.mark.parametrize("name", ["inverted", "knife edge"])
def test_unusual_attitudes_are_recovered(flights, name):
    """From 150 m/s upside down or on the side back to level flight, losing less than 100 m and 30 m/s."""
    flown = flights[name]
    assert abs(flown.motion["mu"][0]) > 1.5
    height = -flown.state.position_n[:, 2]
    assert height.min() > ALTITUDE - 100.0
    assert flown.motion["V"].min() > 120.0
    for angle in ("mu", "gamma", "chi"):
        assert abs(flown.motion[angle][-1]) < 0.5 * DEGREE


@pytest.mark.parametrize("step", SAMPLING)
def test_the_surfaces_are_quiet_at_every_sampling_period(flights, step):
    """The derivative gain of the rate loop forms a sampled loop, unstable beyond 0.026 s without reduction.

    In the last 5 s, the transients except the integral's (40 s) are over; the surfaces move by hundredths of a degree.
    The integral still holds 2 percent of the step.
    """
    flown = flights[f"sampled at {step} s"]
    final_part = slice(STEPS - int(5 / step), STEPS)
    assert np.ptp(flown.surfaces[final_part], axis=0).max() < 0.05 * DEGREE
    assert flown.motion["chi"][-1] == pytest.approx(10 * DEGREE, abs=0.2 * DEGREE)


def test_saturated_channels_do_not_integrate(flights):
    """The integral grows by exactly error times period without saturation, and not at all with saturation."""
    saturated_channels = set()
    for name, target in (
        ("too fast", (240.0, 0, 0)),
        ("climb", (150.0, 20 * DEGREE, 0)),
        ("about", (150, 0, 170 * DEGREE)),
    ):
        flown = flights[name]
        integral = flown.memory.velocity_integral
        measured = np.stack([flown.motion[n] for n in ("V", "gamma", "chi")], axis=1)
        signals = flown.signals
        saturated = np.stack(
            [signals.thrust.saturated, signals.attitude.alpha_saturated, signals.attitude.bank_saturated], axis=1
        ).astype(bool)
        expected = np.where(saturated, 0.0, (np.array(target) - measured) * flown.step)
        np.testing.assert_allclose(np.diff(integral, axis=0), expected[:-1], atol=1e-12)
        saturated_channels |= {k for k in range(3) if saturated[:, k].any()}
    assert saturated_channels == {0, 1, 2}
