"""Step tests of any aircraft: sizes, durations, gains and limits derived from the aircraft."""

import numpy as np
import pytest

from anser.analysis import climb_and_turn, fly_steps, step_test
from anser.analysis.step_flights import default_flight_point, derive_autopilot, gallery_steps, step_case
from anser.analysis.step_tests import PUBLISHED_STEPS, STEP_S, LoopTimeScale, scaled_step_tests
from anser.analysis.trim_points import resolve_airframe
from anser.control import default_limits


def test_the_published_tests_have_the_published_time_scale():
    assert scaled_step_tests(LoopTimeScale(), (30.0, 5.0, 5.0), (10.0, 3.0, 20.0)) == PUBLISHED_STEPS
    assert gallery_steps("f16") == (PUBLISHED_STEPS, (150.0, 1000.0))


def test_limits_of_the_f16_are_within_the_data_of_its_variant():
    textbook, smooth = (resolve_airframe("f16", variant)[0] for variant in ("textbook", "global"))
    limits = [derive_autopilot(airframe, 150.0, 1000.0, "model", STEP_S)[1] for airframe in (textbook, smooth)]
    assert float(limits[0].alpha_min) == float(default_limits().alpha_min)
    assert float(limits[1].alpha_min) == float(smooth.alpha_range[0])
    assert float(limits[1].alpha_max) == float(default_limits().alpha_max)


def test_slower_loops_have_longer_steps_and_smaller_rates():
    tests = {
        test.key: test for test in scaled_step_tests(LoopTimeScale(2.0, 3.0, 4.0), (30.0, 2.0, 0.0), (1.0, 1.0, 20.0))
    }
    assert tests["rates-p"].size == (5.0, 0.0, 0.0)
    assert tests["rates-p"].duration_s == 6.0
    assert tests["rates-r"].read_at_s == pytest.approx(2.1)
    assert tests["attitude-mu"].duration_s == 18.0
    assert tests["velocity-v"].duration_s == 240.0
    assert "attitude-beta" not in tests
    assert tests["attitude-together"].size == (30.0, 2.0, 0.0)
    assert step_test("rates", {"q": 5.0}, time_scale=LoopTimeScale(2.0, 1.0, 1.0)).duration_s == 6.0
    assert all(test.duration_s == pytest.approx(round(test.duration_s / STEP_S) * STEP_S) for test in tests.values())


@pytest.mark.long
def test_a_small_aircraft_follows_steps_within_its_capability():
    """Rise times of the attitude loop as of the F-16, with derived gains for the same bandwidths."""
    airframe, _ = resolve_airframe("aerosonde")
    speed_m_s, altitude_m = default_flight_point(airframe)
    case = step_case(airframe, speed_m_s, altitude_m, "model")
    assert case.derived_defaults is not None
    assert case.derived_defaults.capability.speed_min < speed_m_s < case.derived_defaults.capability.speed_max
    tests, flight_point = gallery_steps("aerosonde")
    assert flight_point == (speed_m_s, altitude_m)
    speed_step = next(test for test in tests if test.key == "velocity-v").size[0]
    assert 0.0 < speed_step < float(case.limits.speed_max) - speed_m_s
    bank = next(test for test in tests if test.key == "attitude-mu")
    (flown,) = fly_steps([bank], aircraft="aerosonde", speed_m_s=speed_m_s, altitude_m=altitude_m)
    assert flown.shortfalls == ()
    assert 0.4 < flown.metrics.rise_time[0] < 1.5
    assert np.all(flown.metrics.surface_utilization < 1.0)


@pytest.mark.long
def test_the_climb_and_turn_of_a_small_aircraft_is_scaled():
    scaled, published = climb_and_turn(aircraft="aerosonde"), climb_and_turn()
    assert scaled.aircraft[0].type == "aerosonde"
    scale = scaled.goal[0].north_m / published.goal[0].north_m
    assert 0.05 < scale < 0.5
    assert scaled.requirements.miss_max_m == pytest.approx(scale * published.requirements.miss_max_m)
    assert scaled.aircraft[0].start.speed_m_s == scaled.fleet.speed_m_s
