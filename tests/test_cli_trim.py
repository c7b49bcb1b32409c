"""The command trim with a centre of gravity and a pitch rate: results and refusals."""

import json

import numpy as np
import pytest

AT = ("trim", "--speed-m-s", "153.0096", "--altitude-m", "0")
PULL_UP = (*AT, "--pitch-rate-deg-s")


def test_trim_of_a_pull_up_about_another_centre_of_gravity(anser):
    code, as_json, _ = anser(*PULL_UP, "10", "--cg", "0.35", "--json")
    assert code == 0
    document = json.loads(as_json)
    assert (document["x_cg_over_c"], document["pitch_rate_deg_s"], document["turn_rate_deg_s"]) == (0.35, 10.0, 0.0)
    aft = {quantity["name"]: quantity["value"] for quantity in document["quantities"]}
    assert [aft[f"{axis} rate"] for axis in ("roll", "yaw")] == [0.0, 0.0]
    assert aft["pitch rate"] == pytest.approx(10.0, rel=1e-14)
    assert aft["roll"] == pytest.approx(0.0, abs=1e-10)
    code, printed, _ = anser(*PULL_UP, "10", "--cg", "0.35")
    assert code == 0
    lines = [" ".join(line.split()) for line in printed.splitlines()]
    assert {"centre of gravity 0.3500 of chord", "roll rate 0.0000 deg/s", "pitch rate 10.0000 deg/s"} <= set(lines)
    # without the option the variant's own, 0.30: further forward, more elevator up
    code, as_json, _ = anser(*PULL_UP, "10", "--json")
    document = json.loads(as_json)
    assert (code, document["x_cg_over_c"]) == (0, 0.3)
    forward = {quantity["name"]: quantity["value"] for quantity in document["quantities"]}
    assert forward["elevator"] < aft["elevator"] - 3


@pytest.mark.parametrize(("cg", "alpha_rad", "elevator_deg"), [("0.35", 0.03691, -0.7588), ("0.30", 0.03936, -1.931)])
def test_trim_at_a_centre_of_gravity_agrees_with_the_textbook(anser, cg, alpha_rad, elevator_deg):
    """[SL] table 3.6-3, 502 ft/s at sea level; mass, gravity and air differ by up to 1e-3 from the textbook's constants."""
    code, as_json, _ = anser(*AT, "--cg", cg, "--json")
    assert code == 0
    quantities = {quantity["name"]: quantity["value"] for quantity in json.loads(as_json)["quantities"]}
    assert np.deg2rad(quantities["angle of attack"]) == pytest.approx(alpha_rad, rel=2e-3)
    assert quantities["elevator"] == pytest.approx(elevator_deg, rel=2e-3)


@pytest.mark.long
def test_the_pull_up_of_the_textbook_exceeds_the_engine(anser):
    code, printed, err = anser(*PULL_UP, "17.188734", "--cg", "0.30")
    assert (code, printed) == (1, "")
    assert "pitch rate 17.2 deg/s" in err
    assert "engine power: 105.1 percent; available 0 to 100" in err
    assert "the fastest pull-up is 16." in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((*PULL_UP, "inf"), "--pitch-rate-deg-s: arrived inf; expected a number from -60 to 60"),
        ((*PULL_UP, "90"), "--pitch-rate-deg-s: arrived 90; expected a number from -60 to 60"),
        ((*PULL_UP, "up"), "--pitch-rate-deg-s: arrived 'up'; expected a number, in deg/s"),
        ((*PULL_UP, "5", "--cg", "30"), "--cg: arrived 30; expected a number from 0.1 to 0.5"),
        ((*PULL_UP, "5", "--cg", "nan"), "--cg: arrived nan; expected a number from 0.1 to 0.5"),
        (
            (*PULL_UP, "5", "--turn-rate-deg-s", "-3"),
            "--pitch-rate-deg-s: arrived 5 with --turn-rate-deg-s -3; expected one of them 0",
        ),
    ],
)
def test_bad_input_ends_with_2(anser, arguments, message):
    code, printed, err = anser(*arguments)
    assert (code, printed) == (2, "")
    assert message in err


@pytest.mark.parametrize("command", [("trim", "--aircraft"), ("linearize", "--aircraft"), ("simulate",)])
def test_a_centre_of_gravity_of_another_aircraft_than_the_f16_ends_with_2(anser, command):
    condition = ("--speed-m-s", "25", "--altitude-m", "100", "--cg", "0.3")
    said = "--cg: arrived 0.3 with aerosonde; expected none: the F-16 alone has it\n"
    assert anser(*command, "aerosonde", *condition) == (2, "", said)
