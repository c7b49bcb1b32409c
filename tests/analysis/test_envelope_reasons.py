"""Classification of surveyed flights: synthetic summaries, with a single cause each."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.analysis.surveys import OUTCOMES, REASONS, classify_flights
from anser.simulation.survey_flight import AUTOPILOT_LIMITS, TABLE_AXES, SurveySummary

TOLERANCE = np.array([0.5, 0.005, 0.005])
DURATION = 30.0


def _flight(*, error=(0.0, 0.0, 0.0), beta=0.0, at=(), late=(), before_slip=(), left=(), finite=True):
    """Summary of a flight; times are pairs of a name and seconds."""

    def times(pairs, names, default):
        return jnp.asarray([dict(pairs).get(name, default) for name in names])

    zeros, zero = jnp.zeros(3), jnp.zeros(())
    return SurveySummary(
        final_error=zeros,
        final_error_max=jnp.asarray(error),
        settling_time=zeros,
        overshoot=zeros,
        coupling=zeros,
        beta_max=jnp.asarray(beta),
        alpha_min=zero,
        alpha_max=zero,
        load_factor_min=zero,
        load_factor_max=zero,
        surface_share=zeros,
        surface_rate_share=zeros,
        body_rate_share=zeros,
        limited_time=times(at, AUTOPILOT_LIMITS, 0.0),
        limited_late=times(late, AUTOPILOT_LIMITS, 0.0),
        limited_before_slip=times(before_slip, AUTOPILOT_LIMITS, 0.0),
        left_time=times(left, TABLE_AXES, np.inf),
        finite=jnp.asarray(finite),
    )


SLOW, SUNK, ASTRAY = (5.0, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.1)
CASES = {
    "on command": (_flight(at=[("thrust_max", 9.0)]), "reached", "none"),
    "no thrust": (_flight(error=SLOW, at=[("thrust_max", 30.0)]), "limited", "thrust_max"),
    "no brake": (_flight(error=SLOW, at=[("thrust_idle", 2.0)], late=[("thrust_idle", 2.0)]), "limited", "thrust_idle"),
    "too short a time": (_flight(error=SLOW, at=[("thrust_max", 2.0)]), "failed", "unexplained"),
    "a limit that does not bear": (_flight(error=ASTRAY, at=[("thrust_max", 30.0)]), "failed", "unexplained"),
    "the longer one": (_flight(error=SUNK, at=[("alpha", 20.0), ("bank", 5.0)]), "limited", "alpha"),
    "inner loops": (_flight(error=SUNK, at=[("surfaces", 20.0)]), "failed", "surfaces"),
    "slip": (
        _flight(error=SLOW, beta=0.05, at=[("thrust_max", 30.0)], before_slip=[("body_rates", 0.5)]),
        "failed",
        "body_rates",
    ),
    "slip without a cause": (_flight(beta=0.05, at=[("surfaces", 30.0)]), "failed", "unexplained"),
    "ground": (_flight(left=[("altitude", 12.0)]), "limited", "tables_altitude"),
    "departure": (_flight(left=[("altitude", 12.0), ("alpha", 20.0)], beta=1.0), "failed", "tables_alpha"),
    "slip before the ground": (
        _flight(left=[("altitude", 12.0)], beta=0.05, before_slip=[("surface_rates", 0.4)]),
        "failed",
        "surface_rates",
    ),
    "no number": (_flight(error=(np.nan,) * 3, beta=np.nan, finite=False), "failed", "unexplained"),
}


@pytest.fixture(scope="module")
def verdicts():
    flights = [flight for flight, _, _ in CASES.values()]
    batch = jax.tree.map(lambda *leaves: np.stack(leaves), *flights)
    return classify_flights(batch, np.tile(TOLERANCE, (len(flights), 1)), DURATION)


@pytest.mark.parametrize(("k", "name"), list(enumerate(CASES)))
def test_a_flight_has_the_outcome_and_reason_of_its_cause(verdicts, k, name):
    _, outcome, reason = CASES[name]
    assert (OUTCOMES[verdicts.outcome[k]], REASONS[verdicts.reason[k]]) == (outcome, reason)


@pytest.mark.parametrize(
    ("flight", "outcome", "reason"),
    [
        (_flight(error=SUNK), "limited", "start_beyond_limits"),
        (_flight(error=SLOW, at=[("thrust_max", 30.0)]), "limited", "start_beyond_limits"),
        # loss of control is a failure for any reason
        (_flight(left=[("alpha", 3.0)]), "failed", "start_beyond_limits"),
        (_flight(beta=0.05, at=[("surfaces", 30.0)]), "failed", "start_beyond_limits"),
        (_flight(error=SUNK, finite=False), "failed", "unexplained"),
        (_flight(), "reached", "none"),
    ],
)
def test_a_start_beyond_the_limits_explains_a_miss_and_excuses_no_departure(flight, outcome, reason):
    batch = jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], flight)
    outcomes = classify_flights(batch, TOLERANCE[None], DURATION, np.array([True]))
    assert (OUTCOMES[outcomes.outcome[0]], REASONS[outcomes.reason[0]]) == (outcome, reason)
