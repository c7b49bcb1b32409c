"""Keys of the certified planner, its limits, and the arrival rules: refusals and accepted cases."""

import pytest

from anser.config import ScenarioError
from anser.scenario import loads
from support.certified_scenario import (
    ALONE,
    ALPHA,
    AT,
    BRAVO,
    FAST_SHIP,
    PUBLISHED,
    SAME_GOAL,
    SEQUENCE,
    TIMES,
    TOGETHER,
    WHO_A,
    WHO_B,
    WINDOWS,
    and_cell,
    changed,
    check_allowed,
    check_refusal,
)

# changes of the good scenario, then: path, whom, what arrived (a part), what would be right (a part)
CASES = {
    "other planner": (
        [('"certified"\n[limits]', '"proven"\n[limits]')],
        ("fleet.planner", "", '"proven"', '"published" or "certified"'),
    ),
    "published speeds with certified": (
        [("speed_m_s = 150\nplanner", 'speed_m_s = 150\nspeed_profile = "published"\nplanner')],
        ("fleet.speed_profile", "", '"published" with fleet.planner "certified"', '"even"'),
    ),
    "reserve without planner": (
        [*PUBLISHED, ("speed_m_s = 150\n", "speed_m_s = 150\nreserve = 0.1\n")],
        ("fleet.reserve", "", '0.1 with fleet.planner "published"', ALONE),
    ),
    "reserve with the other planner": (
        [*PUBLISHED, ("speed_m_s = 150\n", 'speed_m_s = 150\nplanner = "published"\nreserve = 0.2\n')],
        ("fleet.reserve", "", "0.2 with", ALONE),
    ),
    "roll rate without planner": (
        [*PUBLISHED, ("altitude_min_m = 100", "roll_rate_max_deg_s = 30")],
        ("limits.roll_rate_max_deg_s", "", "30", ALONE),
    ),
    "ceiling without planner": (
        [*PUBLISHED, ("altitude_min_m = 100", "altitude_max_m = 9000")],
        ("limits.altitude_max_m", "", "9000", ALONE),
    ),
    "acceleration without planner": (
        [*PUBLISHED, ("altitude_min_m = 100", "acceleration_max_m_s2 = 2")],
        ("limits.acceleration_max_m_s2", "", "2", ALONE),
    ),
    "deceleration without planner": (
        [*PUBLISHED, ("altitude_min_m = 100", "deceleration_max_m_s2 = 2")],
        ("limits.deceleration_max_m_s2", "", "2", ALONE),
    ),
    "arrival rule without planner": (
        [*PUBLISHED, ("[limits]", '[arrival]\nrule = "earliest"\n[limits]')],
        ("arrival.rule", "", '"earliest" with', ALONE),
    ),
    "separation without planner": (
        [*PUBLISHED, ("[limits]", "[separation]\nhorizontal_m = 500\n[limits]")],
        ("separation.horizontal_m", "", "500 with", ALONE),
    ),
    "time of an aircraft without planner": (
        [*PUBLISHED, (BRAVO, f"{BRAVO}\narrive_s = 90")],
        ("aircraft[1].arrive_s", WHO_B, "90 with", ALONE),
    ),
    "keep-out without planner": ([*PUBLISHED, *and_cell()], ("keep_out", "", "a list of 1 with", ALONE)),
    "too much reserve": (
        [('planner = "certified"', 'planner = "certified"\nreserve = 0.6')],
        ("fleet.reserve", "", "0.6", "a number from 0 to 0.5"),
    ),
    "slow roll": (
        [("altitude_min_m = 100", "roll_rate_max_deg_s = 0.5")],
        ("limits.roll_rate_max_deg_s", "", "0.5", "a number from 1 to 90 deg/s"),
    ),
    "no deceleration": (
        [("altitude_min_m = 100", "deceleration_max_m_s2 = 0")],
        ("limits.deceleration_max_m_s2", "", "0", "above 0 and at most 50 m/s^2"),
    ),
    "altitude limits crossed": (
        [("altitude_min_m = 100", "altitude_min_m = 3000\naltitude_max_m = 2000")],
        ("limits.altitude_min_m", "", "3000", "less than altitude_max_m, which is 2000 m"),
    ),
    "start above the ceiling": (
        [("altitude_min_m = 100", "altitude_max_m = 1400")],
        ("aircraft[1].start.altitude_m", WHO_B, "1500", "at most limits.altitude_max_m, which is 1400 m"),
    ),
    "rendezvous above the ceiling": (
        [("altitude_min_m = 100", "altitude_max_m = 1600"), (BRAVO, f"{BRAVO}\nrendezvous.stand_off_up_m = 1700")],
        ("aircraft[1].rendezvous.stand_off_up_m", WHO_B, "1700.0 m altitude", "limits.altitude_max_m (1600 m)"),
    ),
    "other rule": (
        [(TOGETHER, 'rule = "late"')],
        ("arrival.rule", "", '"late"', '"together" or "earliest" or "at" or "sequence" or "times" or "windows"'),
    ),
    "no time": ([(TOGETHER, 'rule = "at"')], ("arrival.time_s", "", "nothing", 'a number (s), which rule "at" needs')),
    "time of no use": (
        [(TOGETHER, "time_s = 90")],
        ("arrival.time_s", "", '90 with rule "together"', 'rule = "at", or no time_s'),
    ),
    "no spacing": (
        [(TOGETHER, 'rule = "sequence"')],
        ("arrival.spacing_s", "", "nothing", 'a number (s), which rule "sequence" needs'),
    ),
    "spacing of no use": (
        [(TOGETHER, f"{TOGETHER}\nspacing_s = 5")],
        ("arrival.spacing_s", "", '5 with rule "together"', 'rule = "sequence", or no spacing_s'),
    ),
    "order of no use": (
        [(TOGETHER, 'order = ["alpha", "bravo"]')],
        ("arrival.order", "", 'a list of 2 with rule "together"', 'rule = "sequence", or no order'),
    ),
    "spacing out of range": (
        [*SEQUENCE, ("spacing_s = 20", "spacing_s = 3601")],
        ("arrival.spacing_s", "", "3601", "a number from 0 to 3600 s"),
    ),
    "spacing too long for the flight": (
        [*SEQUENCE, ("spacing_s = 20", "spacing_s = 120")],
        ("arrival.spacing_s", "", "120 s from the first arrival to the last", "timing.duration_s, which is 120 s"),
    ),
    "order with a stranger": (
        [*SEQUENCE, ('["bravo", "alpha"]', '["bravo", "ship"]')],
        ("arrival.order[1]", "", '"ship"', "the name of an aircraft of this scenario"),
    ),
    "order with one twice": (
        [*SEQUENCE, ('["bravo", "alpha"]', '["bravo", "alpha", "bravo"]')],
        ("arrival.order[2]", "", '"bravo", already arrival.order[0]', "every aircraft once"),
    ),
    "order that leaves one out": (
        [*SEQUENCE, ('["bravo", "alpha"]', '["alpha"]')],
        ("arrival.order", "", 'a list without "bravo"', "every aircraft once"),
    ),
    "order of numbers": (
        [*SEQUENCE, ('["bravo", "alpha"]', '["bravo", 1]')],
        ("arrival.order[1]", "", "1", "a list of the names of all aircraft"),
    ),
    "order that is no list": (
        [*SEQUENCE, ('["bravo", "alpha"]', '"bravo"')],
        ("arrival.order", "", '"bravo"', "a list of the names of all aircraft"),
    ),
    "arrival after the flight": (
        [*AT, ("time_s = 90", "time_s = 120")],
        ("arrival.time_s", "", "120", "less than timing.duration_s, which is 120 s"),
    ),
    "time of one missing": (
        [*TIMES, ("arrive_s = 80\n", "")],
        ("aircraft[0].arrive_s", WHO_A, "nothing", 'arrival.rule "times" needs of every aircraft'),
    ),
    "time of one of no use": (
        [*AT, (ALPHA, f"{ALPHA}\narrive_s = 90")],
        ("aircraft[0].arrive_s", WHO_A, '90 with arrival.rule "at"', 'arrival.rule = "times", or no arrive_s'),
    ),
    "one arrival after the flight": (
        [*TIMES, ("arrive_s = 80", "arrive_s = 120.5")],
        ("aircraft[0].arrive_s", WHO_A, "120.5", "less than timing.duration_s, which is 120 s"),
    ),
    "window without an end": (
        [*WINDOWS, ("arrive_to_s = 100\n", "")],
        ("aircraft[1].arrive_to_s", WHO_B, "nothing", 'arrival.rule "windows" needs of every aircraft'),
    ),
    "window of no use": (
        [*TIMES, (ALPHA, f"{ALPHA}\narrive_from_s = 0")],
        ("aircraft[0].arrive_from_s", WHO_A, '0 with arrival.rule "times"', 'arrival.rule = "windows", or'),
    ),
    "window the wrong way round": (
        [*WINDOWS, ("arrive_to_s = 90", "arrive_to_s = 80")],
        ("aircraft[0].arrive_from_s", WHO_A, "80", "less than arrive_to_s, which is 80 s"),
    ),
    "window that ends after the flight": (
        [*WINDOWS, ("arrive_to_s = 90", "arrive_to_s = 120")],
        ("aircraft[0].arrive_to_s", WHO_A, "120", "less than timing.duration_s, which is 120 s"),
    ),
    "one point at one time": (
        SAME_GOAL,
        ("aircraft[1].rendezvous", WHO_B, 'the rendezvous point of aircraft[0] "alpha"', "at least 10 m apart"),
    ),
    "one point at one time each": (
        [*SAME_GOAL, *TIMES, ("arrive_s = 90.5", "arrive_s = 80")],
        ("aircraft[1].rendezvous", WHO_B, 'the rendezvous point of aircraft[0] "alpha"', "at least 10 m apart"),
    ),
    "goal that outruns all at the mean speed": (
        [FAST_SHIP],
        ("aircraft[0].goal", WHO_A, "155.0 m/s through the air and gets away", "at fleet.speed_m_s = 150 m/s"),
    ),
    "goal that outruns all at the highest speed": (
        [(TOGETHER, 'rule = "earliest"'), (FAST_SHIP[0], FAST_SHIP[1].replace("155", "240"))],
        ("aircraft[0].goal", WHO_A, "240.0 m/s through the air", "at limits.speed_max_m_s = 240 m/s"),
    ),
    "flight too short at the highest speed": (
        # sqrt(9000^2 + 700^2)/240 s, by the ship's 8 m/s away: 4 m/s of it along the way, then the quadratic
        [(TOGETHER, 'rule = "earliest"'), ("duration_s = 120", "duration_s = 37")],
        ("timing.duration_s", "", "37", 'the shortest flight from "alpha" to goal "ship"'),
    ),
    "time before the fastest flight of the farthest": (
        # after 37.01 s the ship is 8852 m south of the start and 256 m east, the rendezvous 700 m lower: 8883 m at 240 m/s
        [*AT, ("time_s = 90", "time_s = 36")],
        ("arrival.time_s", WHO_A, "36", 'at least 37.1 s: "alpha" gets to goal "ship" no sooner'),
    ),
    "own time before the fastest flight": (
        [*TIMES, ("arrive_s = 90.5", "arrive_s = 30")],
        ("aircraft[1].arrive_s", WHO_B, "30", "at limits.speed_max_m_s, which is 240 m/s, in this wind"),
    ),
    "window that ends before the fastest flight": (
        [*WINDOWS, ("arrive_from_s = 80\narrive_to_s = 90", "arrive_from_s = 20\narrive_to_s = 30")],
        ("aircraft[0].arrive_to_s", WHO_A, "30", '"alpha" gets to goal "ship" no sooner'),
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_a_refusal_names_the_key_its_value_and_the_expected_value(case: str) -> None:
    changes, problem = CASES[case]
    check_refusal(changes, *problem)


ALLOWED = {
    "as it stands": [],
    "earliest": [(TOGETHER, 'rule = "earliest"')],
    "at": AT,
    "sequence": SEQUENCE,
    "sequence as in the file": [*SEQUENCE, ('order = ["bravo", "alpha"]', "")],
    "times": TIMES,
    "windows": WINDOWS,
    "window open from the start": [*WINDOWS, ("arrive_from_s = 80", "arrive_from_s = 0")],
    "even speed": [('planner = "certified"', 'planner = "certified"\nspeed_profile = "even"')],
    "side of the detour": [(ALPHA, f'{ALPHA}\nbend = "left"')],
    "one point at different times": [*SAME_GOAL, *TIMES],
    "one point, one after another": [*SAME_GOAL, *SEQUENCE],
    "faster than the mean, slower than the highest": [
        (TOGETHER, 'rule = "earliest"'),
        FAST_SHIP,
        ("duration_s = 120", "duration_s = 200"),
    ],
    "defaults written out for the planner that does not read them": [
        *PUBLISHED,
        ("speed_m_s = 150\n", 'speed_m_s = 150\nplanner = "published"\nreserve = 0.1\n'),
        ("altitude_min_m = 100", "altitude_max_m = 15240"),
        ("[limits]", '[arrival]\nrule = "together"\n[limits]'),
    ],
    "empty tables": [*PUBLISHED, ("[limits]", "[arrival]\n[separation]\n[limits]")],
}


@pytest.mark.parametrize("case", ALLOWED)
def test_an_accepted_scenario_loads_again_from_its_record(case: str) -> None:
    check_allowed(ALLOWED[case])


LAYERED = "[wind]\nlayers = [{ altitude_m = 0, speed_m_s = 0, from_deg = 0 }, { altitude_m = 3000, speed_m_s = 40, from_deg = 0 }]\n[fleet]"
STEERED = (
    "north_m = 0\neast_m = 0\nspeed_m_s = 8\ncourse_deg = 60",
    "waypoints = [{ time_s = 0, north_m = 0, east_m = 0, altitude_m = 0 },"
    " { time_s = 50, north_m = 200, east_m = 346.41016, altitude_m = 0 }]",
)


def _earliest_s(changes) -> float:
    """Earliest arrival time in the refusal of an arrival of alpha at 5 s."""
    with pytest.raises(ScenarioError) as refused:
        loads(changed([*TIMES, ("arrive_s = 80", "arrive_s = 5"), *changes]))
    (problem,) = refused.value.problems
    return float(problem.expected.split()[2])


def test_the_earliest_time_is_the_same_along_waypoints_and_less_in_a_tail_wind() -> None:
    still_s = _earliest_s([])
    assert _earliest_s([STEERED]) == still_s
    blown_s = _earliest_s([("[fleet]", "[wind]\nspeed_m_s = 40\nfrom_deg = 0\n[fleet]")])
    assert blown_s == pytest.approx(still_s * 240.0 / 280.0, abs=2.0)
    # nobody knows at which altitude it flies: the most wind of any layer counts
    assert _earliest_s([("[fleet]", LAYERED)]) <= still_s * 240.0 / 266.0
    check_allowed([*TIMES, ("arrive_s = 80", f"arrive_s = {still_s}")])


def test_the_hash_depends_on_every_setting_of_arrival_and_airspace() -> None:
    variants = [
        [],
        [('planner = "certified"', 'planner = "certified"\nreserve = 0.2')],
        *(
            [("altitude_min_m = 100", f"altitude_min_m = 100\n{line}")]
            for line in (
                "altitude_max_m = 9000",
                "roll_rate_max_deg_s = 21",
                "acceleration_max_m_s2 = 2",
                "deceleration_max_m_s2 = 2",
            )
        ),
        [(TOGETHER, 'rule = "earliest"')],
        AT,
        [*AT, ("time_s = 90", "time_s = 91")],
        SEQUENCE,
        [*SEQUENCE, ('order = ["bravo", "alpha"]', "")],
        [*SEQUENCE, ("spacing_s = 20", "spacing_s = 21")],
        TIMES,
        [*TIMES, ("arrive_s = 80", "arrive_s = 81")],
        WINDOWS,
        [*WINDOWS, ("arrive_from_s = 80", "arrive_from_s = 81")],
        [*WINDOWS, ("arrive_to_s = 90", "arrive_to_s = 91")],
        [("horizontal_m = 500", "horizontal_m = 501")],
        [("vertical_m = 150", "vertical_m = 151")],
        [("vertical_m = 150", "vertical_m = 150\nreserve_m = 11")],
        and_cell(),
        *(
            and_cell("radius_m = 1000", f"radius_m = 1000\n{line}")
            for line in ("bottom_m = 1", "top_m = 9000", "speed_m_s = 1", "course_deg = 1")
        ),
    ]
    hashes = [loads(changed(changes)).hash for changes in variants]
    assert len(set(hashes)) == len(variants)


def test_several_unsupported_keys_are_reported_together() -> None:
    text = changed([('planner = "certified"\n', ""), *and_cell()])
    with pytest.raises(ScenarioError) as refused:
        loads(text)
    paths = [problem.path for problem in refused.value.problems]
    assert paths == ["arrival.rule", "separation.horizontal_m", "separation.vertical_m", "keep_out"]


@pytest.mark.parametrize(("rule", "together"), [("together", True), ("earliest", True), ("windows", False)])
def test_the_rule_decides_whether_two_aircraft_arrive_together(rule: str, together: bool) -> None:
    changes = WINDOWS if rule == "windows" else [(TOGETHER, f'rule = "{rule}"')]
    scenario = loads(changed(changes))
    assert scenario.arrival.is_common is together
    assert scenario.arrival.arrive_together(*scenario.aircraft) is together
