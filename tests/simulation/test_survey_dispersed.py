"""A flight with model errors in the autopilot and delayed sensors."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft.dispersions import dispersed_f16, no_dispersion
from anser.aircraft_files import load_airframe
from anser.control import default_limits, published_gains
from anser.environment import standard_environment
from anser.sensing import DelayedSensors, TrackingEstimator
from anser.simulation.survey_flight import survey_flight
from anser.steady import solve_trim, trim_target

pytestmark = pytest.mark.long


DEGREE = np.pi / 180
NOMINAL, ENVIRONMENT, LIMITS = load_airframe("f16", "textbook"), standard_environment(), default_limits()
QUICK = {"xla_backend_optimization_level": 0}  # a few short flights do not earn back what faster code costs to compile
STEP, COUNT, DELAY_MAX = 0.01, 600, 0.1
SIZE = jnp.array([10.0, 3.0, 20.0]) * jnp.array([1.0, DEGREE, DEGREE])
TOLERANCE = jnp.array([0.5, 0.3, 1.0]) * jnp.array([1.0, DEGREE, DEGREE])
TARGET = trim_target(150.0, 1000.0)
CASES = {
    # incremental, factor on CZ0, delay in periods
    "model": (False, 1.0, 0.0),
    "incremental": (True, 1.0, 0.0),
    "less lift, model": (False, 0.8, 0.0),
    "less lift, incremental": (True, 0.8, 0.0),
    "late": (False, 1.0, 1.5),
    "too late": (False, 1.0, 8.0),
}


def gains(incremental):
    bandwidth = jnp.asarray(20.0 if incremental else 0.0)
    return eqx.tree_at(lambda g: g.sensor_bandwidth, published_gains(), bandwidth)


@pytest.fixture(scope="module")
def flown():
    """Summaries by case name, and of the survey flights of the nominal aircraft with both inversions."""

    def truth(lift):
        coefficients = no_dispersion().coefficients.at[0].set(lift)
        return dispersed_f16(NOMINAL, eqx.tree_at(lambda d: d.coefficients, no_dispersion(), coefficients))

    def one(gains, lift, delay, trim):
        return survey_flight(
            truth(lift),
            ENVIRONMENT,
            gains,
            LIMITS,
            trim,
            TARGET,
            SIZE,
            TOLERANCE,
            STEP,
            COUNT,
            DelayedSensors(delay, DELAY_MAX, STEP),
            TrackingEstimator(model=NOMINAL),
        )

    def surveyed(gains, trim):
        step = jnp.asarray(STEP)
        return survey_flight(NOMINAL, ENVIRONMENT, gains, LIMITS, trim, TARGET, SIZE, TOLERANCE, step, COUNT)

    def stacked(inversions):
        return jax.tree.map(lambda *leaves: jnp.stack(leaves), *map(gains, inversions))

    cases = list(CASES.values())
    lift, delay = (jnp.asarray([case[k] for case in cases]) for k in (1, 2))
    trims = jax.jit(jax.vmap(lambda lift: solve_trim(truth(lift), ENVIRONMENT, TARGET)))(lift)
    dispersed = jax.jit(jax.vmap(one), compiler_options=QUICK)(
        stacked(case[0] for case in cases), lift, delay * STEP, trims
    )
    nominal = jax.tree.map(lambda leaf: leaf[:2], trims)
    reference = jax.jit(jax.vmap(surveyed), compiler_options=QUICK)(stacked([False, True]), nominal)
    by_name = {name: jax.tree.map(lambda leaf, k=k: np.asarray(leaf[k]), dispersed) for k, name in enumerate(CASES)}
    return by_name, [jax.tree.map(lambda leaf, k=k: np.asarray(leaf[k]), reference) for k in range(2)]


@pytest.mark.parametrize(("k", "name"), [(0, "model"), (1, "incremental")])
def test_a_nominal_aircraft_equals_the_survey_flight(flown, k, name):
    """Two programs with the same equations: rounding, which 600 steps of the loops amplify to at most 1e-9."""
    ours, survey = flown[0][name], flown[1][k]
    for a, b in zip(jax.tree.leaves(ours), jax.tree.leaves(survey), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-8)


def test_the_incremental_law_is_insensitive_to_a_lift_error(flown):
    """By design of the laws: the missing lift is measured, or left to a slow integral."""
    nominal, model, incremental = (
        abs(flown[0][name].final_error[1]) for name in ("model", "less lift, model", "less lift, incremental")
    )
    # a fifth of the weight is g / V / 5 = 0.75 deg/s of path angle, held off by gains of 1 and 2 per second and by the
    # attitude loop, which errs the other way: some tenths of a degree
    assert model > 0.1 * DEGREE
    assert nominal < 0.05 * DEGREE  # 6 s after the step the loops are still at the last hundredths
    assert incremental < 0.05 * DEGREE


def test_delayed_sensors_cause_surface_activity(flown):
    """With 15 ms delay, the aircraft still flies; with 80 ms, the rate loop is in a limit cycle at the rate limit."""
    prompt, late, too_late = (flown[0][name] for name in ("model", "late", "too late"))
    rates = -1  # of AUTOPILOT_LIMITS
    assert late.finite
    assert np.all(late.final_error_max < 5 * TOLERANCE)
    assert too_late.limited_time[rates] > 1.0 > prompt.limited_time[rates]
    assert not np.array_equal(late.final_error, prompt.final_error)
