"""Flights under NASA's control laws: sampling rate, inputs, and start."""

import dataclasses
import json
from importlib import resources

import numpy as np
import pytest

from anser.verification.nesc_cases import LAW_FLIGHTS
from anser.verification.nesc_flight import LAW_STEPS, fly_laws

CHECKPOINTS = json.loads(resources.files("anser.verification").joinpath("data/nesc_checkpoints.json").read_text())


@pytest.mark.long
def test_half_the_sampling_rate_changes_little():
    """A sample's delay grows by 1.4 ms: at most a quarter of a tolerance, a second after the heading command."""
    (case,) = (case for case in LAW_FLIGHTS if case.number == "13.3")
    published = CHECKPOINTS["cases"]["13p3"]
    fine, coarse = fly_laws([case], LAW_STEPS)["13.3"], fly_laws([case], LAW_STEPS // 2)["13.3"]
    shares = {
        (name, time_s): abs(fine[name][round(10 * time_s)] - coarse[name][round(10 * time_s)]) / column["tolerance"]
        for name, column in published["columns"].items()
        if "tolerance" in column
        for time_s in published["times_s"]
    }
    assert max(shares.values()) < 0.5
    assert max(share for (_, time_s), share in shares.items() if time_s not in published["not_judged_s"]) < 0.35
    assert max(share for (_, time_s), share in shares.items() if time_s >= 20.0) < 0.2


@pytest.fixture(scope="module")
def side_step_and_airspeed():
    return fly_laws([case for case in LAW_FLIGHTS if case.number in ("13.2-5kt", "13.4")])


@pytest.mark.long
def test_the_law_measures_rates_relative_to_the_rotating_earth(side_step_and_airspeed):
    """Participant 05 settled, case 13.2. Inertial rates: yaw off by 1.5e-4, roll by 3.3e-4 deg, force by 0.12 lbf."""
    log, k = side_step_and_airspeed["13.2-5kt"], 220
    assert log["eulerAngle_deg_Yaw"][k] == pytest.approx(45.00995389795123, abs=1e-6)
    assert log["eulerAngle_deg_Roll"][k] == pytest.approx(-0.09905947789840713, abs=5e-6)
    assert log["aero_bodyForce_lbf_Y"][k] == pytest.approx(0.041562206742255456, abs=1e-5)


@pytest.mark.long
def test_the_law_holds_the_start(side_step_and_airspeed):
    """Before the first command, 4 s: 1.5e-5 ft here, 0.28 ft with the bare trim; settled as participant 05."""
    for log in side_step_and_airspeed.values():
        np.testing.assert_allclose(log["altitudeMsl_ft"][:41], 10013.0, atol=1e-4)
    assert side_step_and_airspeed["13.2-5kt"]["altitudeMsl_ft"][220] == pytest.approx(10009.979006319307, abs=2e-3)


@pytest.mark.long
def test_the_deviation_from_the_line_begins_with_its_command(side_step_and_airspeed):
    """Participant 05 at 20 s, case 13.4: with a line through the start, yaw would be off by 0.013 deg."""
    log = side_step_and_airspeed["13.4"]
    assert log["eulerAngle_deg_Yaw"][200] == pytest.approx(45.01015076143056, abs=1e-6)
    assert log["eulerAngle_deg_Roll"][200] == pytest.approx(-0.10102139352019232, abs=5e-6)


@pytest.mark.long
def test_the_side_force_in_the_settled_turn_is_that_of_the_participants():
    """Participant 05 at 103 s, case 16: 3.6e-4 lbf off; with inertial rates 2.6e-3."""
    (case,) = (case for case in LAW_FLIGHTS if case.number == "16")
    log = fly_laws([dataclasses.replace(case, times_s=(0.0, 103.0))])["16"]
    assert log["aero_bodyForce_lbf_Y"][1030] == pytest.approx(83.21263650270564, abs=1e-3)
    assert log["eulerAngle_deg_Yaw"][1030] == pytest.approx(-179.76433340640395, abs=2e-4)
