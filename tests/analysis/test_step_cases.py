"""Step tests of any aircraft: sizes and durations that suit it, and gains and limits of its own."""

import numpy as np
import pytest

from anser.analysis import climb_and_turn, fly_steps, step_test
from anser.analysis.step_flights import default_flight_point, gallery_steps, step_case
from anser.analysis.step_tests import PUBLISHED_STEPS, STEP_S, LoopTimeScale, scaled_step_tests
from anser.analysis.trim_points import resolve_airframe


def test_the_published_tests_are_those_of_the_published_pace():
    assert scaled_step_tests(LoopTimeScale(), (30.0, 5.0, 5.0), (10.0, 3.0, 20.0)) == PUBLISHED_STEPS
    assert gallery_steps("f16") == (PUBLISHED_STEPS, (150.0, 1000.0))


def test_slower_loops_are_stepped_longer_and_their_rates_less():
    tests = {
        one.key: one for one in scaled_step_tests(LoopTimeScale(2.0, 3.0, 4.0), (30.0, 2.0, 0.0), (1.0, 1.0, 20.0))
    }
    assert tests["rates-p"].size == (5.0, 0.0, 0.0)
    assert tests["rates-p"].duration_s == 6.0
    assert tests["rates-r"].read_at_s == pytest.approx(2.1)
    assert tests["attitude-mu"].duration_s == 18.0
    assert tests["velocity-v"].duration_s == 240.0
    assert "attitude-beta" not in tests
    assert tests["attitude-together"].size == (30.0, 2.0, 0.0)
    assert step_test("rates", {"q": 5.0}, time_scale=LoopTimeScale(2.0, 1.0, 1.0)).duration_s == 6.0
    assert all(one.duration_s == pytest.approx(round(one.duration_s / STEP_S) * STEP_S) for one in tests.values())


@pytest.mark.long
def test_a_small_aircraft_is_stepped_within_what_it_can_do_and_follows():
    """Rise times of the attitude loop as of the F-16, whose bandwidths it bears; no gain is given."""
    airframe, _ = resolve_airframe("aerosonde")
    speed_m_s, altitude_m = default_flight_point(airframe)
    case = step_case(airframe, speed_m_s, altitude_m, "model")
    assert case.derived_defaults is not None
    assert case.derived_defaults.capability.speed_min < speed_m_s < case.derived_defaults.capability.speed_max
    tests, place = gallery_steps("aerosonde")
    assert place == (speed_m_s, altitude_m)
    faster = next(one for one in tests if one.key == "velocity-v").size[0]
    assert 0.0 < faster < float(case.limits.speed_max) - speed_m_s
    bank = next(one for one in tests if one.key == "attitude-mu")
    (flown,) = fly_steps([bank], aircraft="aerosonde", speed_m_s=speed_m_s, altitude_m=altitude_m)
    assert flown.shortfalls == ()
    assert 0.4 < flown.metrics.rise_time[0] < 1.5
    assert np.all(flown.metrics.surface_utilization < 1.0)


@pytest.mark.long
def test_its_climb_and_turn_is_as_much_smaller():
    of, published = climb_and_turn(aircraft="aerosonde"), climb_and_turn()
    assert of.aircraft[0].type == "aerosonde"
    scale = of.goal[0].north_m / published.goal[0].north_m
    assert 0.05 < scale < 0.5
    assert of.requirements.miss_max_m == pytest.approx(scale * published.requirements.miss_max_m)
    assert of.aircraft[0].start.speed_m_s == of.fleet.speed_m_s
