"""A fleet without a centre, from its agreement to its holds."""

from pathlib import Path

import numpy as np
import pytest

import anser
from anser.missions import read_plan, write_plan
from anser.planning.certified import search
from anser.planning.certified.timed_profiles import MINIMAL
from anser.scenario import load, loads

TEXT = """
format = 2
name = "two"
[timing]
duration_s = 100.0
[fleet]
speed_m_s = 150.0
planner = "decentralised"
[network]
range_m = 40000.0
loss = 0.3
delay_s = 0.2
[separation]
horizontal_m = 150.0
[[aircraft]]
name = "alpha"
goal = "ship"
start = { north_m = 9000.0, east_m = 0.0, altitude_m = 1500.0, speed_m_s = 150.0, course_deg = 180.0 }
rendezvous = { stand_off_up_m = 800.0 }
[[aircraft]]
name = "bravo"
goal = "buoy"
start = { north_m = 0.0, east_m = 9000.0, altitude_m = 1800.0, speed_m_s = 150.0, course_deg = 270.0 }
rendezvous = { stand_off_up_m = 800.0 }
[[goal]]
name = "ship"
kind = "surface"
north_m = 0.0
east_m = 0.0
speed_m_s = 8.0
course_deg = 90.0
[[goal]]
name = "buoy"
kind = "surface"
north_m = -3000.0
east_m = 500.0
"""


@pytest.fixture(scope="module")
def few_candidates():
    """Fewer candidates than a plan has to choose from, in a smaller program; the shipped scenario has all."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search, "STANDARD", MINIMAL)
        yield


@pytest.fixture(scope="module")
def planned(few_candidates):
    return anser.plan(loads(TEXT))


@pytest.fixture(scope="module")
def flown(planned):
    return anser.run(loads(TEXT), planned=planned)


@pytest.mark.long
def test_they_agree_on_one_arrival_and_keep_apart(planned):
    assert planned.problems() == ()
    arrivals = np.asarray(planned.plan.arrival_times)
    assert np.ptp(arrivals) == 0.0
    apart = np.asarray(planned.plan.certificate.clearance_ratio)
    assert apart.min() >= 1.0
    assert np.asarray(planned.holds.clear).all()
    # all that is said takes at least one exchange and its delay
    assert planned.agreed_after_s >= 3 * 0.2
    assert any("agreed without a centre after" in note for note in planned.notes())


@pytest.mark.long
def test_they_arrive_together_by_clocks_that_stay_together(flown):
    assert flown.met, flown.summary["requirements"]
    fleet = flown.summary["fleet"]
    assert fleet["arrival_spread_s"] < 0.02
    assert fleet["separation_min_m"] > 150.0
    lag = flown.dataset["clock_lag_s"].values
    assert np.abs(lag[:, 0] - lag[:, 1]).max() < 0.5


@pytest.mark.long
def test_what_became_of_the_network_is_told(flown):
    network = flown.summary["network"]
    assert network["condition_met"]
    assert network["links_up"] == pytest.approx(0.7, abs=0.06)
    assert 0.0 < network["promised_rate_per_s"] < 0.2
    heard = flown.dataset["heard_from"].values
    # bit k for aircraft k, and nobody hears itself
    assert set(np.unique(heard[:, 0])) == {0, 2}
    assert set(np.unique(heard[:, 1])) == {0, 1}


@pytest.mark.long
def test_a_plan_kept_in_a_file_is_the_same(planned, tmp_path):
    write_plan(planned, tmp_path / "plan.npz")
    again = read_plan(tmp_path / "plan.npz", loads(TEXT))
    np.testing.assert_array_equal(again.plan.paths.air_n, planned.plan.paths.air_n)
    np.testing.assert_array_equal(again.holds.paths.air_n, planned.holds.paths.air_n)
    assert again.agreed_after_s == planned.agreed_after_s


@pytest.mark.long
def test_out_of_range_nobody_agrees_and_it_is_said_why(few_candidates):
    refused = anser.plan(loads(TEXT.replace("range_m = 40000.0", "range_m = 3000.0\nagree_within_s = 5.0")))
    (why,) = refused.problems()
    assert "does not agree within network.agree_within_s = 5 s" in why
    assert '"alpha"' in why
    assert '"bravo"' in why


@pytest.mark.long
def test_with_a_perfect_network_they_arrive_when_a_centre_has_them_arrive():
    text = Path("scenarios/no-centre.toml").read_text(encoding="utf-8")
    perfect = text[: text.index("[turbulence]")] + text[text.index("[[aircraft]]") :]
    network = perfect[perfect.index("[network]") : perfect.index("[separation]")]
    alone = anser.plan(loads(perfect.replace(network, "")))
    centre = anser.plan(
        loads(perfect.replace(network, "").replace('planner = "decentralised"', 'planner = "certified"'))
    )
    np.testing.assert_allclose(alone.plan.arrival_times, centre.plan.arrival_times, atol=0.1)


@pytest.mark.long
def test_the_shipped_scenario_without_a_centre():
    flown = anser.run(load("scenarios/no-centre.toml"))
    assert flown.met, flown.summary["requirements"]
    assert flown.summary["fleet"]["separation_min_m"] >= 200.0


@pytest.mark.long
def test_with_less_thrust_it_goes_on_and_the_others_wait_for_it():
    event = '[[event]]\ntime_s = 15.0\nkind = "thrust-lost"\naircraft = "alpha"\nthrust_left = 0.5\n'
    flown = anser.run(loads(TEXT + event))
    assert flown.met, flown.summary["requirements"]
    (told,) = flown.summary["events"]
    assert told["planned"]
    assert "the others wait for it" in told["message"]
