"""Tables of turbulence, sensors and events: refusals with key paths and reasons, and the parts built from them."""

import equinox as eqx
import jax
import numpy as np
import pytest

from anser.config import ScenarioError
from anser.config.key_paths import value_at
from anser.environment import DiscreteGust, Turbulence
from anser.environment.gusts import NoGusts, SummedGusts
from anser.missions.runs import needs_single_flight
from anser.scenario import build_flight, loads
from anser.scenario.schema_sensing import PRESETS, Estimator, GoalSensor, Navigation, goal_sensor_presets, goal_sigma_m
from anser.scenario.schema_settings import Timing
from anser.sensing import IdealSensors, NoisySensors, TrackingEstimator
from anser.simulation.start import trimmed_fleet
from anser.steady import solve_trim

TEXT = """
format = 2
name = "two"
[timing]
duration_s = 200.0
[fleet]
speed_m_s = 150.0
[[aircraft]]
name = "alpha"
goal = "ship"
start = { north_m = 9000.0, east_m = 0.0, altitude_m = 1500.0, speed_m_s = 150.0, course_deg = 180.0 }
rendezvous = { stand_off_up_m = 400.0 }
[[aircraft]]
name = "bravo"
goal = "buoy"
start = { north_m = 0.0, east_m = 9000.0, altitude_m = 1800.0, speed_m_s = 150.0, course_deg = 270.0 }
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
north_m = -2000.0
east_m = 500.0
"""
TRIM_ONCE = eqx.filter_jit(solve_trim)
"""The trim does not depend on the tables: it is traced once for all."""
CAMERA = '[goal_sensor]\npreset = "camera"\n'


def event(lines):
    return f"[[event]]\ntime_s = 30.0\n{lines}\n"


def excitation(lines):
    return f"[[excitation]]\namplitude = 2.0\n{lines}\n"


SINES = 'inputs = ["elevator", "rudder"]\nsignal = "multisine"\nduration_s = 10.0\n'


@pytest.mark.parametrize(
    ("lines", "path", "expected"),
    [
        ('[turbulence]\nintensity = "rough"', "turbulence.intensity", '"light" or "moderate"'),
        ("[navigation]\nposition_m = -1.0", "navigation.position_m", "from 0 to 1000 m"),
        ('[navigation]\nsensors = "satellite-inertial"\nperiod_s = 0.123', "navigation.period_s", "whole multiple"),
        (CAMERA + "dropout_probability = 1.5", "goal_sensor.dropout_probability", "from 0 to 1"),
        (CAMERA + "outage_share = 1.0", "goal_sensor.outage_share", "from 0 to 0.99"),
        (CAMERA + "range_m = -3.0", "goal_sensor.range_m", "from 0 to 10000 m"),
        (CAMERA + "position_m = 3.0", "goal_sensor.position_m", 'the sensor "camera" does not have'),
        (CAMERA + "latency_s = [2.0, 1.0]", "goal_sensor.latency_s", "the first not above the second"),
        (CAMERA + "period_s = 0.015", "goal_sensor.period_s", "whole multiple"),
        ('[goal_sensor]\npreset = "radar"', "goal_sensor.preset", '"weather-radar"'),
        ("[goal_sensor]\nrange_m = 3.0", "goal_sensor.range_m", 'preset other than "exact"'),
        ('[goal_sensor]\npreset = "ais"\nangle_mrad = 3.0', "goal_sensor.angle_mrad", "does not have"),
        ('[estimator]\nfilter = "kalman"', "estimator.filter", '"ekf" or "ukf"'),
        ("[estimator]\nacceleration_m_s2 = 0.0", "estimator.acceleration_m_s2", "above 0"),
        ('[[gust]]\ntime_s = 3.0\nup_m_s = 5.0\naircraft = "charlie"', "gust[0].aircraft", '"alpha", "bravo"'),
        ("[[gust]]\ntime_s = 3.0", "gust[0].up_m_s", "other than 0"),
        (event('kind = "aircraft-leaves"\naircraft = "charlie"'), "event[0].aircraft", '"alpha", "bravo"'),
        (event('kind = "aircraft-leaves"'), "event[0].aircraft", "needs: aircraft"),
        (event('kind = "explodes"'), "event[0].kind", '"thrust-lost"'),
        (event('kind = "thrust-lost"\naircraft = "alpha"\nthrust_left = 1.5'), "event[0].thrust_left", "from 0 to 1"),
        (event('kind = "thrust-lost"\naircraft = "alpha"'), "event[0].thrust_left", "thrust_left"),
        (event('kind = "aircraft-changes"\naircraft = "alpha"'), "event[0].deviation", "needs: aircraft, deviation"),
        (
            event('kind = "aircraft-changes"\naircraft = "alpha"\ndeviation = { drag = 0.0 }'),
            "event[0].deviation.drag",
            "from 0.1 to 10",
        ),
        (
            event('kind = "aircraft-changes"\naircraft = "alpha"\ndeviation.surface_effectiveness.flap = 0.5'),
            "event[0].deviation.surface_effectiveness.flap",
            "elevator, aileron, rudder",
        ),
        (
            event('kind = "aircraft-changes"\naircraft = "alpha"\ndeviation.coefficients.Cmq = 0.5'),
            "event[0].deviation.coefficients",
            "from the start on",
        ),
        (
            event('kind = "goal-stops"\ngoal = "ship"\ndeviation = { drag = 1.1 }'),
            "event[0].deviation",
            "no deviation",
        ),
        (event('kind = "aircraft-changes"\naircraft = "charlie"\ndeviation.drag = 1.1'), "event[0].aircraft", "bravo"),
        (excitation('inputs = ["flap"]\nsignal = "step"'), "excitation[0].inputs[0]", "elevator, aileron, rudder"),
        (excitation('inputs = ["elevator"]\nsignal = "chirp"'), "excitation[0].signal", '"sweep"'),
        (excitation('inputs = ["elevator"]\nsignal = "sweep"'), "excitation[0].duration_s", "needs: duration_s"),
        (
            excitation('inputs = ["elevator"]\nsignal = "step"\nwidth_s = 1.0'),
            "excitation[0].width_s",
            "amplitude and start_s alone",
        ),
        (
            excitation('inputs = ["aileron", "rudder"]\nsignal = "doublet"').replace("2.0", "[1.0, 2.0, 3.0]"),
            "excitation[0].amplitude",
            "a list of 2",
        ),
        (
            excitation('aircraft = "charlie"\ninputs = ["bank"]\nsignal = "step"'),
            "excitation[0].aircraft",
            '"alpha", "bravo"',
        ),
        (
            excitation('inputs = ["bank"]\nsignal = "step"\nstart_s = 200.0'),
            "excitation[0].start_s",
            "end of the flight",
        ),
        (excitation(SINES + "frequencies_hz = [1.0, 1.05]"), "excitation[0].frequencies_hz", "at least 2 multiples"),
        (excitation(SINES + "frequencies_hz = [2.0, 1.0]"), "excitation[0].frequencies_hz", "not above the second"),
        (excitation(SINES + "frequencies_hz = [1.0, 60.0]"), "excitation[0].frequencies_hz[1]", "at most 50 Hz"),
        (excitation('inputs = []\nsignal = "step"'), "excitation[0].inputs", "a list of surfaces"),
        (event('kind = "goal-stops"\ngoal = "island"'), "event[0].goal", '"ship", "buoy"'),
        (event('kind = "goal-stops"\ngoal = "ship"\nlater_s = 3.0'), "event[0].later_s", "no later_s"),
        (
            event('kind = "arrival-put-off"\nlater_s = 5.0').replace("30.0", "300.0"),
            "event[0].time_s",
            "last step of the flight",
        ),
        (
            event('kind = "arrival-put-off"\nlater_s = 5.0').replace("30.0", "199.994"),
            "event[0].time_s",
            "last step of the flight",
        ),
        (
            event('kind = "aircraft-leaves"\naircraft = "alpha"')
            + event('kind = "aircraft-leaves"\naircraft = "alpha"'),
            "event[1].aircraft",
            "has not left",
        ),
        (
            event('kind = "thrust-lost"\naircraft = "alpha"\nthrust_left = 0.8')
            + event('kind = "thrust-lost"\naircraft = "alpha"\nthrust_left = 0.3'),
            "event[1].aircraft",
            "one loss of thrust for each aircraft",
        ),
        (event('kind = "goal-sensor-lost"\naircraft = "alpha"') * 2, "event[1].aircraft", "one loss of the sensor"),
        (
            event('kind = "aircraft-leaves"\naircraft = "alpha"').replace("30.0", "20.0")
            + event('kind = "thrust-lost"\naircraft = "alpha"\nthrust_left = 0.3'),
            "event[1].aircraft",
            "has not left",
        ),
        (
            event(
                'kind = "keep-out-appears"\nkeep_out = { name = "cell", north_m = 0.0, east_m = 9e4, radius_m = 90.0 }'
            )
            * 2,
            "event[1].keep_out.name",
            "a name of its own",
        ),
    ],
)
def test_problems_are_named_with_their_key_paths(lines, path, expected):
    with pytest.raises(ScenarioError) as refused:
        loads(TEXT + lines)
    problems = [problem for problem in refused.value.problems if problem.path == path]
    assert len(problems) == 1, refused.value
    assert expected in str(problems[0])


def test_events_need_the_certified_planner():
    with pytest.raises(ScenarioError, match="only that planner plans on"):
        loads(TEXT.replace("[fleet]", '[fleet]\nplanner = "published"') + event('kind = "goal-stops"\ngoal = "ship"'))


def parts(text):
    flight = build_flight(loads(text))
    return flight.groups[0].vehicles.at(0)


def test_a_perfect_world_is_the_default():
    vehicle = parts(TEXT)
    assert isinstance(vehicle.sensors, IdealSensors)
    assert vehicle.estimator == TrackingEstimator()
    assert isinstance(vehicle.gusts, NoGusts)
    assert np.isinf(vehicle.faults.leaving_time)


def test_each_table_builds_its_part():
    gust = '[[gust]]\ntime_s = 9.0\nup_m_s = 5.0\naircraft = "bravo"\n'
    gusty = parts(TEXT + '[turbulence]\nintensity = "severe"\nspectrum = "von-karman"\n' + gust)
    assert isinstance(gusty.gusts, SummedGusts)
    turbulence, single = gusty.gusts.parts
    assert isinstance(turbulence, Turbulence)
    assert turbulence.family == "von-karman"
    np.testing.assert_allclose(turbulence.wind_20ft, 45 * 1852.0 / 3600.0, rtol=1e-6)
    assert isinstance(single, DiscreteGust)
    np.testing.assert_array_equal(single.amplitudes, np.zeros(3))  # bravo alone meets it
    assert isinstance(gusty.estimator, TrackingEstimator)
    assert gusty.estimator.goal is None
    for preset in PRESETS:
        sensing = parts(
            TEXT + f'[goal_sensor]\npreset = "{preset}"\n[estimator]\nmotion = "changing"\nmargin_sigma = 0.0\n'
        )
        assert isinstance(sensing.sensors, NoisySensors)
        assert sensing.sensors.goal.kind == goal_sensor_presets()[preset]["kind"]
        assert len(sensing.estimator.goal.models) == 2
    lost = parts(TEXT + event('kind = "thrust-lost"\naircraft = "alpha"\nthrust_left = 0.4'))
    assert float(lost.faults.thrust_ratio_at(29.99)) == 1.0
    assert float(lost.faults.thrust_ratio_at(30.0)) == pytest.approx(0.4)


CHANGE = event('kind = "aircraft-changes"\naircraft = "alpha"\ndeviation.cg_shift = 0.05')


def test_a_change_of_an_aircraft_is_unknown_to_its_model_and_to_the_planner():
    changed = parts(TEXT + CHANGE)
    assert float(changed.changes.at(29.99).cg_shift) == 0.0
    assert float(changed.changes.at(30.0).cg_shift) == 0.05
    assert changed.estimator.model is not None
    assert parts(TEXT).changes is None
    assert parts(TEXT).estimator.model is None
    healthy = build_flight(loads(TEXT + CHANGE)).aircraft(1)[0]
    assert healthy.changes is None
    scenario = loads(TEXT + CHANGE)
    assert scenario.planned_events == ()
    assert not needs_single_flight(scenario)
    for planner in ("published", "decentralised"):
        loads(TEXT.replace("[fleet]", f'[fleet]\nplanner = "{planner}"') + CHANGE)
    assert loads(TEXT).hash == loads(TEXT + "\n").hash != scenario.hash
    for dump in (loads(TEXT).model_dump_json(), loads(TEXT).hash):
        assert "surface_effectiveness" not in dump  # earlier scenarios keep their hash
    assert value_at(scenario, "aircraft[alpha].deviation.surface_effectiveness.rudder") == 1.0
    sampled = scenario.replace("event[0].deviation.surface_effectiveness.elevator", 0.5, "event[0].time_s", 40.0)
    assert sampled.event[0].deviation.surface_effectiveness.elevator == 0.5
    assert sampled.event[0].deviation.cg_shift == 0.05


def test_an_excitation_is_built_for_its_aircraft():
    lines = f'aircraft = "alpha"\n{SINES}frequencies_hz = [0.2, 2.0]'
    text = TEXT + excitation(lines).replace("amplitude = 2.0", "amplitude = [1.0, 3.0]")
    excited = parts(text).excitation
    assert excited.targets == ("elevator", "rudder")
    greatest = [np.abs([float(signal.at(t)) for t in 1.0 + np.arange(1000) * 0.01]).max() for signal in excited.signals]
    np.testing.assert_allclose(np.degrees(greatest), [1.0, 3.0], rtol=2e-3)
    assert build_flight(loads(text)).aircraft(1)[0].excitation is None
    assert parts(TEXT).excitation is None
    louder = loads(text).replace("excitation[0].amplitude", 2.0)
    assert louder.excitation[0].amplitude_of(1) == 2.0
    for lines in ('signal = "doublet"', 'signal = "3-2-1-1"\nwidth_s = 0.5', 'signal = "step"'):
        assert parts(TEXT + excitation(f'inputs = ["airspeed"]\n{lines}')).excitation.targets == ("airspeed",)
    sweep = 'inputs = ["bank"]\nsignal = "sweep"\nduration_s = 9.0\nfrequencies_hz = [0.1, 1.0]'
    assert len(parts(TEXT + excitation(sweep)).excitation.signals) == 1


def test_every_number_of_a_preset_has_its_source():
    for preset in PRESETS:
        assert len(goal_sensor_presets()[preset]["source"]) > 60


def test_a_goal_that_turns_turns():
    motion = parts(TEXT + event('kind = "goal-turns"\ngoal = "ship"\ncourse_deg = 0.0\nspeed_m_s = 4.0')).mission.goal
    np.testing.assert_allclose(motion.position_n(30.0), [0.0, 240.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(motion.position_n(40.0), [40.0, 240.0, 0.0], atol=1e-9)
    still = parts(TEXT + event('kind = "goal-stops"\ngoal = "ship"')).mission.goal
    np.testing.assert_allclose(still.position_n(90.0), [0.0, 240.0, 0.0], atol=1e-9)


def test_a_stand_off_has_a_margin_for_goal_uncertainty():
    close_text = TEXT.replace("stand_off_up_m = 400.0", "stand_off_up_m = 160.0")
    loads(close_text)
    with pytest.raises(ScenarioError, match="standard deviations of the goal's place"):
        loads(close_text + CAMERA + "angle_bias_mrad = 10.0\n")
    unmargined = loads(close_text + CAMERA + "angle_bias_mrad = 10.0\n[estimator]\nmargin_sigma = 0.0\n")
    # a faster aircraft is farther off in the middle of the freeze time
    sensor, timing = unmargined.goal_sensor, unmargined.timing
    sigma_m = goal_sigma_m(sensor, unmargined.estimator, unmargined.navigation, timing, 200.0, 160.0)
    with pytest.raises(ScenarioError, match=f"aircraft\\[0\\].*leaves at {sigma_m:.1f} m"):
        unmargined.replace("estimator.margin_sigma", 3.0, "aircraft[0].speed_m_s", 200.0)


def test_the_margin_follows_from_the_filter():
    """For a goal at rest the filter averages: the error of one measurement over the root of their number."""
    sensor = GoalSensor(preset="ais", position_m=10.0, velocity_m_s=5.0, period_s=1.0)
    estimator = Estimator(acceleration_m_s2=1e-9, briefed_position_m=1e5, briefed_velocity_m_s=1e-9)
    timing = Timing(duration_s=100.0, freeze_s=0.0)
    np.testing.assert_allclose(
        goal_sigma_m(sensor, estimator, Navigation(), timing, 150.0, 300.0), 10.0 / np.sqrt(100.0), rtol=1e-3
    )


@pytest.mark.parametrize(
    "tables",
    [
        '[turbulence]\nintensity = "light"',
        pytest.param('[navigation]\nsensors = "satellite-inertial"', marks=pytest.mark.long),
        pytest.param(CAMERA, marks=pytest.mark.long),
        pytest.param(
            '[turbulence]\nintensity = "light"\n[navigation]\nsensors = "satellite-inertial"', marks=pytest.mark.long
        ),
        pytest.param('[turbulence]\nintensity = "light"\n' + CAMERA, marks=pytest.mark.long),
    ],
)
def test_each_table_alone_builds_a_flight_with_goal_reports(tables, monkeypatch):
    monkeypatch.setattr("anser.simulation.start.solve_trim", TRIM_ONCE)
    flight = build_flight(loads(TEXT + tables))
    fleet = jax.eval_shape(trimmed_fleet, flight)
    assert fleet.reports.goal_position_n.shape == (2, 3)
