"""Step responses of the three loops: the published gallery (theory section 5), and another airframe.

F-16 (textbook), 150 m/s, 1000 m, published gains: each channel alone and all three of a loop together overshoot by less
than 10 percent and end within 1 percent. The same autopilot, gains and code fly a light propeller aircraft.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.control import default_limits, published_gains
from anser.environment import standard_environment
from anser.scenario.library import load_airframe
from anser.simulation.response import step_response
from anser.simulation.trim import solve_trim, trim_target
from support.light_aircraft import light_aircraft

DEGREE = np.pi / 180
STEP = 0.01
ENVIRONMENT = standard_environment()
CHANNELS = {"rates": ("P", "Q", "R"), "attitude": ("mu", "alpha", "beta"), "velocity": ("V", "gamma", "chi")}
UNITS = {
    "rates": np.full(3, DEGREE),
    "attitude": np.full(3, DEGREE),
    "velocity": np.array([1.0, DEGREE, DEGREE]),
}
# The integral of a transient is worked off with a time constant of 1 / 0.025 = 40 s: the velocity loop is read late.
DURATION_S = {"rates": 3.0, "attitude": 6.0, "velocity": 60.0}
LIGHT_DURATION_S = {"attitude": 6.0, "velocity": 80.0}
ALONE_AND_TOGETHER = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0], [1.0, 1.0, 1.0]])


class Figures(NamedTuple):
    """What one channel of one response measures: 90 percent rise time (s), overshoot and end error (fractions)."""

    rise_s: float
    overshoot: float
    end_error: float


def figures(response, channel, size, read_at_s=None) -> Figures:
    """Measure a channel up to the reading (default: the end); the end error is the mean over the last 0.1 s."""
    count = len(response.time) if read_at_s is None else round(read_at_s / STEP) + 1
    measured = response.measured[:count, channel]
    share = (measured - measured[0]) / size
    end = share[-round(0.1 / STEP) - 1 :].mean()
    return Figures(STEP * int(np.argmax(share > 0.9)), float(share.max() - 1), float(end - 1))


def respond(airframe, limits, trim, loop, sizes, duration_s):
    """Responses to each row of sizes, compiled once."""

    def one(size):
        gains, count = published_gains(), round(duration_s / STEP)
        return step_response(airframe, ENVIRONMENT, gains, limits, trim, size, STEP, count, loop)

    together = jax.jit(jax.vmap(one))(jnp.asarray(sizes))
    return [jax.tree.map(lambda leaf, k=k: np.asarray(leaf[k]), together) for k in range(len(sizes))]


def check(response, loop, row, sizes, read_at_s=None, overshoot_max=0.10, error_max=0.01):
    """Every commanded channel of a row of sizes against the requirement; the message tells what was measured."""
    found = {CHANNELS[loop][k]: figures(response, k, sizes[row, k], read_at_s) for k in range(3) if sizes[row, k]}
    assert found
    for name, f in found.items():
        assert f.rise_s > 0, f"{name} never rose: {found}"
        assert f.overshoot < overshoot_max, f"{name} overshoots: {found}"
        assert abs(f.end_error) < error_max, f"{name} has a steady-state error: {found}"


def deviation(response, channel):
    """Largest departure of a channel from where it began."""
    return np.abs(response.measured[:, channel] - response.measured[0, channel]).max()


# --- F-16

F16_SIZES = {
    "rates": ALONE_AND_TOGETHER * 10 * DEGREE,
    "attitude": ALONE_AND_TOGETHER * np.array([30, 5, 5]) * DEGREE,
    "velocity": ALONE_AND_TOGETHER * np.array([10, 3 * DEGREE, 20 * DEGREE]),
}
# A held yaw rate builds sideslip at 10 deg/s until the rudder stands at its stop, 1.3 to 1.4 s after the step, and no
# autopilot can hold it longer: steady state is read before that, where R takes part.
READ_YAW_AT_S = 1.05


@pytest.fixture(scope="module")
def f16():
    airframe = load_airframe()
    return airframe, jax.jit(solve_trim)(airframe, ENVIRONMENT, trim_target(150.0, 1000.0))


@pytest.fixture(scope="module")
def f16_responses(f16):
    """The gallery: loop by loop, four responses each."""
    airframe, trim = f16
    return {
        loop: respond(airframe, default_limits(), trim, loop, sizes, DURATION_S[loop])
        for loop, sizes in F16_SIZES.items()
    }


ROWS = pytest.mark.parametrize("row", range(4), ids=["first", "second", "third", "together"])


@pytest.mark.parametrize("loop", CHANNELS)
@ROWS
def test_published_steps_of_the_f16(f16_responses, loop, row):
    read_at_s = READ_YAW_AT_S if loop == "rates" and row >= 2 else None
    check(f16_responses[loop][row], loop, row, F16_SIZES[loop], read_at_s)


@pytest.mark.parametrize("row", [2, 3])
def test_a_held_yaw_rate_ends_at_the_rudders_stop(f16_responses, row):
    """Why R is read early: up to the reading the rudder is free, half a second later it stands at its stop."""
    stop = 30 * DEGREE  # theory section 4
    rudder = np.abs(f16_responses["rates"][row].surfaces[:, 2])
    reading, soon = round(READ_YAW_AT_S / STEP), round(1.5 / STEP)
    assert rudder[: reading + 1].max() < stop - 3 * DEGREE
    assert rudder[soon : soon + round(0.5 / STEP)].min() > stop - 0.1 * DEGREE


@pytest.mark.parametrize("row", [0, 1])
def test_rates_do_not_disturb_each_other(f16_responses, row):
    """Inversion decouples: 10 deg/s of P or Q leave the others below 0.01 deg/s (measured: 0.0094 of R from P)."""
    response = f16_responses["rates"][row]
    for other in {0, 1, 2} - {row}:
        assert deviation(response, other) < 0.02 * DEGREE


# (row commanded, other channel): largest departure allowed, in deg or m/s, with a third to spare over what was measured
# (0.06, 0, 0, 0.90 and 0.01, 0.11, 0, 0.22, 0.42): the loops are not infinitely faster than each other
COUPLING = {
    "attitude": {(0, 2): 0.1, (1, 0): 1e-3, (1, 2): 1e-3, (2, 0): 1.5},
    "velocity": {(0, 1): 0.05, (1, 0): 0.2, (1, 2): 1e-3, (2, 0): 0.4, (2, 1): 0.6},
}


@pytest.mark.parametrize("loop", COUPLING)
def test_outer_loops_disturb_each_other_little(f16_responses, loop):
    for (row, other), bound in COUPLING[loop].items():
        measured = deviation(f16_responses[loop][row], other) / UNITS[loop][other]
        assert measured < bound, (CHANNELS[loop][row], CHANNELS[loop][other], measured)


@pytest.mark.parametrize("loop", CHANNELS)
def test_record_begins_in_trim_and_keeps_to_the_limits(f16, f16_responses, loop):
    airframe, trim = f16
    for response in f16_responses[loop]:
        np.testing.assert_allclose(response.time, STEP * np.arange(round(DURATION_S[loop] / STEP)), atol=1e-12)
        np.testing.assert_array_equal(response.surfaces[0], trim.state.surfaces)
        assert response.power[0] == trim.state.power
        assert np.all(np.abs(response.surfaces) <= np.asarray(airframe.actuators.upper) + 1e-12)
        if loop != "velocity":
            np.testing.assert_array_equal(response.throttle, trim.controls.throttle)
        else:
            assert np.all((response.throttle >= 0) & (response.throttle <= 1))


# --- another airframe: a tenth of the mass, a propeller, a third of the speed

LIGHT_SIZES = {
    # 3 deg of alpha and sideslip, 3 m/s, 2 deg of climb and 10 deg of course: about half of what wing and engine have
    "attitude": ALONE_AND_TOGETHER * np.array([30, 3, 3]) * DEGREE,
    "velocity": ALONE_AND_TOGETHER * np.array([3, 2 * DEGREE, 10 * DEGREE]),
}


@pytest.fixture(scope="module")
def light_responses():
    airframe = light_aircraft()
    trim = jax.jit(solve_trim)(airframe, ENVIRONMENT, trim_target(55.0, 1000.0))
    assert trim.converged
    limits = eqx.tree_at(
        lambda v: (v.speed_min, v.speed_max, v.alpha_min, v.alpha_max),
        default_limits(),
        tuple(jnp.asarray(v) for v in (35.0, 75.0, -8 * DEGREE, 12 * DEGREE)),
    )
    return {
        loop: respond(airframe, limits, trim, loop, sizes, LIGHT_DURATION_S[loop])
        for loop, sizes in LIGHT_SIZES.items()
    }


@pytest.mark.parametrize("loop", LIGHT_SIZES)
@ROWS
def test_the_autopilot_flies_any_airframe(light_responses, loop, row):
    """Same gains, no knowledge of the airframe but its interface."""
    check(light_responses[loop][row], loop, row, LIGHT_SIZES[loop])
