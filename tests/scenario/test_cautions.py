"""Gains by bandwidth and damping in a scenario, and cautions about what is valid and unwise."""

from pathlib import Path

import numpy as np
import pytest

from anser.scenario import ScenarioError, build_flight, cautions, loads

TEXT = (Path(__file__).parents[2] / "scenarios" / "single-aircraft.toml").read_text()


def _with(gains):
    return TEXT.replace("[[goal]]", f"{gains}\n\n[[goal]]", 1)


def test_bandwidth_and_damping_become_gains():
    design = _with("[aircraft.gains.attitude]\nbandwidth_rad_s = [2.0, 2.5, 3.0]\ndamping = 2.5\nderivative = 0.5")
    attitude = build_flight(loads(design)).fleet.gains.attitude
    np.testing.assert_allclose(attitude.proportional[0], [3.0, 3.75, 4.5])
    np.testing.assert_allclose(attitude.integral[0], 1.5 * (np.array([2.0, 2.5, 3.0]) / 5.0) ** 2)
    without = build_flight(loads(_with("[aircraft.gains.velocity]\nbandwidth_rad_s = 1"))).fleet.gains.velocity
    np.testing.assert_array_equal(without.integral[0], np.zeros(3))


@pytest.mark.parametrize(
    ("gains", "message"),
    [
        (
            "[aircraft.gains.rates]\nbandwidth_rad_s = 5\nproportional = 10",
            'gains.rates.proportional (aircraft "aircraft-1"): arrived 10 beside',
        ),
        (
            "[aircraft.gains.rates]\nbandwidth_rad_s = 5\nintegral = 1",
            "arrived 1 beside bandwidth_rad_s; expected either",
        ),
        (
            "[aircraft.gains.rates]\ndamping = 1",
            'gains.rates.damping (aircraft "aircraft-1"): arrived 1 without bandwidth',
        ),
        (
            "[aircraft.gains.rates]\nbandwidth_rad_s = 5\ndamping = [1, 1, 0.05]",
            "arrived 0.05; expected a number from 0.1",
        ),
        ("[aircraft.gains.rates]\nbandwith_rad_s = 5", 'perhaps "bandwidth_rad_s"'),
        ('[aircraft.gains]\ninversion = "incremantal"', 'expected "model" or "incremental"'),
    ],
)
def test_what_is_refused_says_what_would_be_right(gains, message):
    with pytest.raises(ScenarioError) as refused:
        loads(_with(gains))
    assert message in str(refused.value)


def test_loops_too_close_in_time_are_named_and_the_defaults_are_not():
    assert cautions(loads(TEXT)) == ()
    (said,) = cautions(loads(_with("[aircraft.gains.velocity]\nproportional = [1.0, 1.6, 1.0]")))
    assert said == (
        'aircraft[0].gains (aircraft "aircraft-1"): the loop of gamma has a bandwidth of 1.6 1/s and rests on alpha with '
        "2 1/s, a ratio of 1.25; below 2 the two swing against each other (damping 0.56)"
    )
