"""Step responses of another airframe: the same autopilot, gains and code fly a light propeller aircraft.

Single channels and the three channels of a loop together overshoot by less than 10 percent and end within 1 percent,
like the published responses of the F-16 (tests/analysis/test_stepping.py).
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.control import default_limits, published_gains
from anser.environment import standard_environment
from anser.simulation import step_response
from anser.simulation.response import LoopCase
from anser.steady import solve_trim, trim_target
from support.light_aircraft import light_aircraft

pytestmark = pytest.mark.long


DEGREE = np.pi / 180
STEP = 0.01
ENVIRONMENT = standard_environment()
CHANNELS = {"attitude": ("mu", "alpha", "beta"), "velocity": ("V", "gamma", "chi")}
# The integral of a transient is worked off with a time constant of 1 / 0.025 = 40 s: the velocity loop is read late.
DURATION_S = {"attitude": 6.0, "velocity": 80.0}
ALONE_AND_TOGETHER = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0], [1.0, 1.0, 1.0]])


class Figures(NamedTuple):
    """Metrics of one channel of a response: 90 percent rise time (s), overshoot and final error (fractions)."""

    rise_s: float
    overshoot: float
    end_error: float


def figures(response, channel, size) -> Figures:
    """Measure a channel; the final error is the mean over the last 0.1 s."""
    measured = response.measured[:, channel]
    share = (measured - measured[0]) / size
    end = share[-round(0.1 / STEP) - 1 :].mean()
    return Figures(STEP * int(np.argmax(share > 0.9)), float(share.max() - 1), float(end - 1))


def respond(airframe, limits, trim, loop, sizes, duration_s):
    """Responses to the rows of step sizes, compiled once."""

    def one(size):
        gains, count = published_gains(), round(duration_s / STEP)
        return step_response(LoopCase(airframe, ENVIRONMENT, gains, limits, trim, STEP), size, count, loop)

    together = jax.jit(jax.vmap(one))(jnp.asarray(sizes))
    return [jax.tree.map(lambda leaf, k=k: np.asarray(leaf[k]), together) for k in range(len(sizes))]


# A tenth of the mass, a propeller, a third of the speed.
SIZES = {
    # 3 deg of alpha and sideslip, 3 m/s, 2 deg of climb and 10 deg of course: about half of what wing and engine have
    "attitude": ALONE_AND_TOGETHER * np.array([30, 3, 3]) * DEGREE,
    "velocity": ALONE_AND_TOGETHER * np.array([3, 2 * DEGREE, 10 * DEGREE]),
}


@pytest.fixture(scope="module")
def light():
    airframe = light_aircraft()
    trim = jax.jit(solve_trim)(airframe, ENVIRONMENT, trim_target(55.0, 1000.0))
    assert trim.converged
    return airframe, trim


@pytest.fixture(scope="module")
def responses(light):
    limits = eqx.tree_at(
        lambda v: (v.speed_min, v.speed_max, v.alpha_min, v.alpha_max),
        default_limits(),
        tuple(jnp.asarray(v) for v in (35.0, 75.0, -8 * DEGREE, 12 * DEGREE)),
    )
    return {loop: respond(light[0], limits, light[1], loop, sizes, DURATION_S[loop]) for loop, sizes in SIZES.items()}


@pytest.mark.parametrize("loop", SIZES)
@pytest.mark.parametrize("case", range(4), ids=["first", "second", "third", "together"])
def test_the_autopilot_flies_another_airframe(responses, loop, case):
    """Same gains, no knowledge of the airframe except its interface."""
    sizes = SIZES[loop]
    measured = {
        CHANNELS[loop][k]: figures(responses[loop][case], k, sizes[case, k]) for k in range(3) if sizes[case, k]
    }
    assert measured
    for name, f in measured.items():
        assert f.rise_s > 0, f"{name} never rose: {measured}"
        assert f.overshoot < 0.10, f"{name} overshoots: {measured}"
        assert abs(f.end_error) < 0.01, f"{name} has a steady-state error: {measured}"


@pytest.mark.parametrize("loop", SIZES)
def test_a_record_starts_in_trim_and_stays_within_the_limits(light, responses, loop):
    airframe, trim = light
    for response in responses[loop]:
        np.testing.assert_allclose(response.time, STEP * np.arange(round(DURATION_S[loop] / STEP)), atol=1e-12)
        np.testing.assert_array_equal(response.surfaces[0], trim.state.surfaces)
        assert response.power[0] == trim.state.power
        assert np.all(response.surfaces <= np.asarray(airframe.actuators.upper) + 1e-12)
        assert np.all(response.surfaces >= np.asarray(airframe.actuators.lower) - 1e-12)
        if loop == "attitude":
            np.testing.assert_array_equal(response.throttle, trim.controls.throttle)
        else:
            assert np.all((response.throttle >= 0) & (response.throttle <= 1))
