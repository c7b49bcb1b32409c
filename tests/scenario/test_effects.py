"""Keys and varied paths without effect are refused with a remedy; the test covers every key of the schema."""

import functools

import pytest

from anser.config import ScenarioError
from anser.missions.sweeps import swept_scenarios
from anser.scenario import loads
from anser.scenario.cautions import find_cautions
from anser.scenario.flight_checks import refuse_unused_keys
from support.flipped_keys import NONE, answers

PLAIN = """
format = 2
name = "plain"
[timing]
duration_s = 100.0
[fleet]
speed_m_s = 150.0
planner = "published"
[[aircraft]]
name = "alpha"
goal = "buoy"
start = { north_m = -9000.0, east_m = 60.0, altitude_m = 1000.0, speed_m_s = 150.0, course_deg = 10.0 }
[[goal]]
name = "buoy"
kind = "surface"
north_m = 0.0
east_m = 0.0
"""
TWO = (
    PLAIN.replace('"published"', '"certified"')
    + """
[[aircraft]]
name = "bravo"
goal = "buoy"
start = { north_m = -9000.0, east_m = 3000.0, altitude_m = 1000.0, speed_m_s = 150.0, course_deg = 10.0 }
rendezvous = { stand_off_east_m = 1000.0 }
"""
)
CERTIFIED = (
    TWO
    + """
[separation]
horizontal_m = 300.0
[wind]
speed_m_s = 5.0
[[keep_out]]
name = "area"
north_m = 50000.0
east_m = 0.0
radius_m = 100.0
speed_m_s = 1.0
"""
)
UNCERTAIN = (
    CERTIFIED.replace("rendezvous = {", 'gains = { inversion = "incremental" }\nrendezvous = {').replace(
        "course_deg = 10.0 }\n[[goal]]", 'course_deg = 10.0 }\ngains = { inversion = "incremental" }\n[[goal]]'
    )
    + """
[turbulence]
intensity = "light"
[navigation]
sensors = "satellite-inertial"
[goal_sensor]
preset = "camera"
outage_share = 0.1
[estimator]
motion = "changing"
[[gust]]
time_s = 3.0
up_m_s = 3.0
[[event]]
time_s = 5.0
kind = "goal-turns"
goal = "buoy"
course_deg = 20.0
speed_m_s = 5.0
"""
).replace("east_m = 0.0\n\n[[aircraft]]", "east_m = 0.0\nspeed_m_s = 1.0\n\n[[aircraft]]")
REPORTED = UNCERTAIN.replace('"camera"', '"ais"').replace('"changing"', '"turning"')
WITHOUT_A_CENTRE = CERTIFIED.replace('"certified"', '"decentralised"') + "[network]\noutage_share = 0.1\n"
SCENARIOS = {
    "plain": PLAIN,
    "certified": CERTIFIED,
    "uncertain": UNCERTAIN,
    "reported": REPORTED,
    "without a centre": WITHOUT_A_CENTRE,
}
OF_FILES = {
    "format": "how the file is read",
    "timing.record_period_s": "how often the record has a row",
    "earth.longitude_deg": "where the record and the exports lie",
    "estimator.margin_sigma": "which stand-offs the check allows",
}
"""Keys that flight and verdict do not depend on, and what they are for."""

IDLE = {
    "navigation.position_m": (PLAIN + "[navigation]\nposition_m = 50.0", "satellite-inertial"),
    "navigation.gust_time_s": (PLAIN + "[navigation]\ngust_time_s = 1.0", "satellite-inertial"),
    "estimator.turn_rate_deg_s": (PLAIN + "[estimator]\nturn_rate_deg_s = 5.0", "goal_sensor.preset other than"),
    "estimator.motion": (PLAIN + '[estimator]\nmotion = "turning"', "goal_sensor.preset other than"),
    "estimator.sojourn_s": (REPORTED.replace("[estimator]", "[estimator]\nsojourn_s = 9.0"), '"changing"'),
    "turbulence.spectrum": (PLAIN + '[turbulence]\nspectrum = "von-karman"', '"light", "moderate" or "severe"'),
    "gust[0].time_s": (PLAIN + "[[gust]]\ntime_s = 100.0\nup_m_s = 3.0", "timing.duration_s = 100 s"),
    "goal_sensor.outage_mean_s": (PLAIN + '[goal_sensor]\npreset = "ais"\noutage_mean_s = 3.0', "outage_share above 0"),
    "goal_sensor.range_bias_m": (PLAIN + '[goal_sensor]\npreset = "ais"\nrange_bias_m = 3.0', "no range_bias_m"),
    "network.outage_mean_s": (
        CERTIFIED.replace('"certified"', '"decentralised"') + "[network]\noutage_mean_s = 3.0",
        "outage_share above 0",
    ),
    "timing.freeze_s": (
        PLAIN.replace("duration_s = 100.0", "duration_s = 100.0\nreplan_period_s = 0.0\nfreeze_s = 9.0"),
        "replan_period_s above 0",
    ),
    "separation.reserve_m": (TWO + "[separation]\nreserve_m = 5.0", "horizontal_m above 0"),
    "separation.horizontal_m": (
        PLAIN.replace('"published"', '"certified"') + "[separation]\nhorizontal_m = 300.0",
        "a second [[aircraft]]",
    ),
    "requirements.separation_min_m": (PLAIN + "[requirements]\nseparation_min_m = 9.0", "a second [[aircraft]]"),
    "requirements.arrival_spread_max_s": (
        TWO + '[arrival]\nrule = "sequence"\nspacing_s = 5.0\n[requirements]\narrival_spread_max_s = 0.1',
        "a rule by which all arrive at one time",
    ),
    "aircraft[0].gains.sensor_bandwidth_rad_s": (
        PLAIN.replace("course_deg = 10.0 }", "course_deg = 10.0 }\ngains = { sensor_bandwidth_rad_s = 9.0 }"),
        '"incremental"',
    ),
    "event[0].thrust_left": (
        CERTIFIED + '[[event]]\ntime_s = 5.0\nkind = "thrust-lost"\naircraft = "alpha"\nthrust_left = 1.0',
        "less than 1",
    ),
    "event[0].deviation": (
        PLAIN + '[[event]]\ntime_s = 5.0\nkind = "aircraft-changes"\naircraft = "alpha"\ndeviation = {}',
        "a key that deviates",
    ),
    "event[0].gaps": (
        CERTIFIED + '[[event]]\ntime_s = 5.0\nkind = "aircraft-leaves"\naircraft = "alpha"\ngaps = "keep"',
        '"sequence"',
    ),
}


@pytest.mark.parametrize("path", IDLE)
def test_a_key_without_effect_is_refused_with_a_remedy(path):
    text, remedy = IDLE[path]
    with pytest.raises(ScenarioError) as refusal:
        loads(text)
    (problem,) = refusal.value.problems
    assert problem.path == path
    assert remedy in problem.expected
    assert problem.line is not None


@pytest.mark.parametrize(
    ("path", "lines"),
    [
        ("wind.from_deg", "[wind]\nfrom_deg = 90.0"),
        ("goal[0].course_deg", "course_deg = 90.0"),
        ("goal[1].name", '[[goal]]\nname = "spare"\nkind = "surface"\nnorth_m = 0.0\neast_m = 9.0'),
    ],
)
def test_a_direction_of_rest_and_a_goal_of_no_aircraft_are_a_caution(path, lines):
    (caution,) = find_cautions(loads(PLAIN + lines))
    assert caution.startswith(f"{path}: ")


def test_a_default_that_is_written_out_asks_for_nothing():
    loads(PLAIN + '[navigation]\nposition_m = 2.0\n[estimator]\nmotion = "steady"\n[turbulence]\nspectrum = "dryden"')


@functools.cache
def answers_of(name):
    return answers(loads(SCENARIOS[name]))


def test_no_key_of_a_plain_scenario_is_accepted_without_effect():
    assert {key for key, answer in answers_of("plain").items() if answer == NONE} <= set(OF_FILES)


@pytest.mark.long
@pytest.mark.parametrize("name", SCENARIOS)
def test_no_key_is_accepted_without_effect(name):
    assert {key for key, answer in answers_of(name).items() if answer == NONE} <= set(OF_FILES)


def vary(path, values, text=PLAIN):
    scenario = loads(text)
    refuse_unused_keys("study", [(scenario.replace(path, value), {path: value}) for value in values])


@pytest.mark.parametrize(
    ("path", "values", "remedy"),
    [
        ("navigation.position_m", (1.0, 50.0), "satellite-inertial"),
        ("estimator.turn_rate_deg_s", (1.0, 5.0), "goal_sensor.preset"),
        ("turbulence.spectrum", ("dryden", "von-karman"), "intensity"),
        ("goal[buoy].course_deg", (1.0, 5.0), "speed_m_s above 0"),
        ("earth.longitude_deg", (1.0, 5.0), "changes something in the flight as built"),
    ],
)
def test_a_varied_path_that_changes_nothing_is_refused(path, values, remedy):
    with pytest.raises(ScenarioError) as refusal:
        vary(path, values)
    (problem,) = refusal.value.problems
    assert (problem.path, remedy in problem.expected) == (path, True)


@pytest.mark.parametrize(
    ("path", "values"),
    [
        ("wind.speed_m_s", (0.0, 5.0)),
        ("requirements.miss_max_m", (1.0, 2.0)),
        ("aircraft[alpha].deviation.mass", (1.0, 1.1)),
        ("timing.duration_s", (100.0, 110.0)),
        ("earth.latitude_deg", (45.0, 50.0)),
        ("navigation.position_m", (2.0, 2.0)),  # of one value nothing can be said
    ],
)
def test_a_varied_path_with_an_effect_is_flown(path, values):
    vary(path, values)


def test_an_effect_in_some_flights_is_enough_for_a_varied_path():
    swept = {"turbulence.intensity": ["none", "light"], "turbulence.spectrum": ["dryden", "von-karman"]}
    assert len(swept_scenarios(loads(PLAIN), swept)) == 4
    with pytest.raises(ScenarioError, match=r"sweep of plain(.|\n)*turbulence\.spectrum"):
        swept_scenarios(loads(PLAIN), {"turbulence.spectrum": ["dryden", "von-karman"]})
