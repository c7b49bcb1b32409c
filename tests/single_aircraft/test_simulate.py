"""Flight of one aircraft: against the linear model, the textbook's equations in NumPy, and the closed loop's parts."""

import dataclasses
import functools
import gc

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from scipy.linalg import expm

import anser
from anser.aircraft import Controls
from anser.analysis.trim_points import ConditionError
from anser.compiling import program
from anser.config.errors import ScenarioError
from anser.control import InversionAutopilot, LoopCommand, default_limits, published_gains
from anser.environment import SteadyWind, standard_environment
from anser.parts import AbstractController, AbstractGuidance, AbstractSensors
from anser.results.netcdf import read_netcdf
from anser.sensing import IdealSensors
from anser.simulation.open_loop import PrescribedCommand
from anser.simulation.response import ConstantCommand
from anser.single_aircraft import flight as flight_module
from anser.single_aircraft.flight import autopilot
from anser.single_aircraft.starts import named_state, resolve_start
from support import stevens_lewis as textbook

DURATION_S = 10.0
SHORT_S = 6.0  # with as many compiled rows as `DURATION_S`, so that the flights share a program


@functools.cache
def f16():
    return anser.aircraft("f16")


@functools.cache
def level():
    return f16().trim(speed_m_s=150.0, altitude_m=1000.0)


@functools.cache
def doublet_flight(amplitude_deg):
    controls = {"elevator": anser.doublet(amplitude_deg), "aileron": anser.doublet(amplitude_deg, start_s=3.0)}
    return anser.simulate(f16(), level(), controls, duration_s=DURATION_S).dataset


def linear_response(amplitude_deg):
    """States of the linear model under the same commands, constant over each sample: exact by the matrix exponential."""
    model = f16().linearize(level(), actuators=True).model
    A, B = np.asarray(model.A), np.asarray(model.B)
    n, m = B.shape
    step = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * 0.01)
    time = np.arange(round(DURATION_S / 0.01) + 1) * 0.01
    u = np.zeros((time.size, m))
    names = {"elevator_command": 1.0, "aileron_command": 3.0}
    for name, start in names.items():
        u[:, model.inputs.index(name)] = np.radians(anser.doublet(amplitude_deg, start_s=start)(time))
    x = np.zeros((time.size, n))
    for k in range(time.size - 1):
        x[k + 1] = step[:n, :n] @ x[k] + step[:n, n:] @ u[k]
    return dict(zip(model.states, (x + np.asarray(model.x)).T, strict=True))


@pytest.mark.long
def test_small_doublets_approach_the_linear_model_with_the_square_of_the_amplitude():
    quantities = {"alpha": "alpha_deg", "Q": "pitch_rate_deg_s", "theta": "pitch_deg", "phi": "roll_deg"}
    quantities |= {"P": "roll_rate_deg_s"}
    # The amplitudes keep every look-up within one cell of the tables, where the only nonlinearity is smooth.
    errors = {}
    for amplitude in (0.02, 0.04):
        flown, linear = doublet_flight(amplitude), linear_response(amplitude)
        errors[amplitude] = {
            state: np.abs(np.radians(flown[name].values) - linear[state]).max() for state, name in quantities.items()
        }
        moved = {state: np.ptp(linear[state]) for state in quantities}
        for state, error in errors[amplitude].items():
            assert error < 0.02 * moved[state], (state, error / moved[state])
    for state in ("alpha", "Q", "theta"):
        assert errors[0.04][state] / errors[0.02][state] == pytest.approx(4.0, rel=0.25), (state, errors)


def test_a_doublet_follows_the_textbook_equations_in_numpy():
    aircraft = textbook.exact_constants(0.30)
    foot = textbook.FOOT_M
    start, trimmed = textbook.trim(aircraft, 150.0 / foot, 1000.0 / foot)
    time = np.arange(round(DURATION_S / 0.01)) * 0.01
    history = [
        trimmed._replace(elevator=trimmed.elevator + e, aileron=trimmed.aileron + a)
        for e, a in zip(anser.doublet(2.0)(time), anser.doublet(2.0, start_s=3.0)(time), strict=True)
    ]
    expected = textbook.fly(aircraft, start, history, 0.01)
    named_start = {
        "airspeed_m_s": start[0] * foot,
        "altitude_m": start[11] * foot,
        "alpha_deg": np.degrees(start[1]),
        "beta_deg": np.degrees(start[2]),
        "pitch_deg": np.degrees(start[4]),
        "elevator_deg": trimmed.elevator,
        "aileron_deg": trimmed.aileron,
        "rudder_deg": trimmed.rudder,
        "throttle": trimmed.throttle,
    }
    controls = {"elevator": anser.doublet(2.0), "aileron": anser.doublet(2.0, start_s=3.0)}
    flown = anser.simulate(f16(), named_start, controls, duration_s=DURATION_S).dataset
    columns = {
        "airspeed_m_s": (0, foot),
        "alpha_deg": (1, np.degrees(1.0)),
        "beta_deg": (2, np.degrees(1.0)),
        "roll_deg": (3, np.degrees(1.0)),
        "pitch_deg": (4, np.degrees(1.0)),
        "roll_rate_deg_s": (6, np.degrees(1.0)),
        "pitch_rate_deg_s": (7, np.degrees(1.0)),
        "yaw_rate_deg_s": (8, np.degrees(1.0)),
        "altitude_m": (11, foot),
        "elevator_deg": (13, 1.0),
    }
    for name, (column, factor) in columns.items():
        reference = expected[:, column] * factor
        departure = np.abs(flown[name].values[: reference.size] - reference).max()
        # issue: 1e-6 of scale; rounding of the start's power by the gearing is 1e-12
        assert departure < 1e-6 * max(np.ptp(reference), 1e-3), (name, departure / np.ptp(reference))


@pytest.mark.long
def test_a_function_of_time_and_state_flies_like_the_same_numbers_in_a_table():
    by_function = anser.simulate(
        f16(),
        level(),
        lambda time_s, state: {"elevator": state["pitch_deg"] * 0.0 - 2.0 + 0.1 * (time_s > 1.0)},
        duration_s=SHORT_S,
    ).dataset
    time = np.arange(601) * 0.01
    by_table = anser.simulate(f16(), level(), {"elevator": -2.0 + 0.1 * (time > 1.0)}, duration_s=SHORT_S).dataset
    np.testing.assert_allclose(by_function.alpha_deg, by_table.alpha_deg, rtol=0, atol=1e-9)


def test_a_feedback_law_damps_the_pitch_motion():
    start = f16().start(level()) | {"pitch_rate_deg_s": 10.0}
    elevator = start["elevator_deg"]
    controls = ({"elevator": elevator}, lambda t, x: {"elevator": elevator + 0.5 * x["pitch_rate_deg_s"]})
    free, damped = (anser.simulate(f16(), start, inputs, duration_s=SHORT_S).dataset for inputs in controls)
    late = slice(0.5, 2.0)
    assert abs(damped.pitch_rate_deg_s.sel(time=late)).max() < 0.5 * abs(free.pitch_rate_deg_s.sel(time=late)).max()


def program_count():
    return sum(len(list(compiled)) for compiled in program._programs)


def test_a_changed_law_flies_as_changed():
    """A notebook changes a gain to which the law refers, and flies again."""
    gains = {"elevator": 1.0}

    def law(time_s, state):
        return {"elevator": -gains["elevator"] + 0.0 * state["alpha_deg"]}

    commands, programs = [], []
    for gain in (1.0, 2.0):
        gains["elevator"] = gain
        flown = anser.simulate(f16(), level(), law, duration_s=0.05).dataset
        commands.append(float(flown["elevator_command_deg"][-1]))
        gc.collect()
        programs.append(program_count())
    assert commands == [-1.0, -2.0]
    assert programs[0] == programs[1]  # the program of a law ends with its flight


def test_the_state_of_a_law_is_that_of_the_dataset_in_turbulence():
    def law(time_s, state):
        return {"elevator": 0.5 * state["alpha_deg"], "rudder": 0.5 * state["beta_deg"]}

    flown = anser.simulate(f16(), level(), law, duration_s=1.0, turbulence="severe", seed=1).dataset
    assert np.ptp(flown["alpha_deg"].values) > 1.0
    np.testing.assert_allclose(flown["elevator_command_deg"], 0.5 * flown["alpha_deg"], atol=1e-9)
    np.testing.assert_allclose(flown["rudder_command_deg"], 0.5 * flown["beta_deg"], atol=1e-9)


def test_controls_are_a_data_frame_too():
    table = {"time_s": np.array([0.0, 1.0]), "elevator": np.array([-2.0, -2.5])}
    by_frame = anser.simulate(f16(), level(), pd.DataFrame(table), duration_s=0.1).dataset
    np.testing.assert_allclose(by_frame["elevator_command_deg"], -2.0 - 0.5 * by_frame["time"], atol=1e-9)


def test_a_flight_without_a_lag_says_so():
    flown = anser.simulate(f16(), level(), duration_s=0.05, actuator_lag=False).dataset
    assert flown.attrs["actuator_lag"] == "no"
    assert "engine_lag" not in flown.attrs


@pytest.mark.long
def test_the_autopilot_follows_a_course_command():
    flight = anser.simulate(
        f16(), level(), controller="inversion", command={"course_deg": anser.step_input(20.0)}, duration_s=20.0
    ).dataset
    assert float(flight.course_deg[-1]) == pytest.approx(20.0, abs=0.2)
    assert float(flight.airspeed_m_s[-1]) == pytest.approx(150.0, abs=0.2)
    assert flight.attrs["controller"] == "inversion"


@pytest.mark.long
@pytest.mark.parametrize("lag", ["actuator_lag", "engine_lag"])
def test_the_autopilot_moves_parts_without_lag(lag):
    command = {"path_angle_deg": anser.step_input(5.0), "airspeed_m_s": anser.step_input(5.0)}
    flight = anser.simulate(
        f16(), level(), controller="inversion", command=command, duration_s=20.0, **{lag: False}
    ).dataset
    assert float(flight.path_angle_deg[-1]) == pytest.approx(5.0, abs=0.2)
    assert float(flight.airspeed_m_s[-1]) == pytest.approx(155.0, abs=0.2)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "controller"), [("f16", "incremental"), ("f16", "adaptive"), ("aerosonde", "inversion")]
)
def test_the_autopilot_without_lag_settles_at_the_longest_step(name, controller):
    aircraft = anser.aircraft(name)
    start = level() if name == "f16" else aircraft.trim(25.0, 500.0)
    command = {"path_angle_deg": anser.step_input(3.0)}
    options = {"controller": controller, "command": command, "duration_s": 30.0, "step_s": 0.05}
    flight = anser.simulate(aircraft, start, actuator_lag=False, **options).dataset
    late = flight.isel(time=slice(-200, None))
    assert float(abs(late.elevator_deg.diff("time")).max()) < 0.05  # a limit cycle: 28 deg
    np.testing.assert_allclose(late.path_angle_deg, 3.0, atol=1.5)  # a growing oscillation: 18 deg


@pytest.mark.long
def test_a_command_to_the_attitude_loop_is_flown_and_recorded():
    autopilot = InversionAutopilot(published_gains(), default_limits(), loop="attitude")
    point = level().point
    attitude = jnp.stack([0.3, point.alpha, 0.0])
    guidance = ConstantCommand(LoopCommand(attitude, jnp.zeros(3), point.controls.throttle))
    flight = anser.simulate(f16(), level(), controller=autopilot, command=guidance, duration_s=SHORT_S).dataset
    assert float(flight.bank_deg[-1]) == pytest.approx(np.degrees(0.3), abs=0.1)
    assert np.all(np.isnan(flight.airspeed_command_m_s))
    assert np.all(np.isfinite(flight.roll_rate_command_deg_s))


@pytest.mark.long
def test_the_autopilot_by_name_is_that_of_the_airspeed_and_the_step():
    aerosonde, still = anser.aircraft("aerosonde"), standard_environment()
    windy = dataclasses.replace(still, wind=SteadyWind(jnp.array([-12.0, 0.0, 0.0])))
    trim = aerosonde.trim(25.0, 500.0)

    def bandwidth(environment, step_s):
        point = resolve_start(aerosonde.airframe, environment, trim)
        gains = autopilot(aerosonde.airframe, environment, point, "inversion", step_s).gains
        return np.asarray(gains.rates.proportional)

    np.testing.assert_allclose(bandwidth(windy, 0.01), bandwidth(still, 0.01), rtol=1e-9)
    assert np.all(bandwidth(still, 0.05) < bandwidth(still, 0.01))


def test_without_lag_the_surfaces_follow_from_one_sample_to_the_next():
    controls = {"elevator": anser.step_input(1.0, start_s=0.5), "throttle": anser.step_input(0.3, start_s=0.5)}
    flight = anser.simulate(f16(), level(), controls, duration_s=1.0, actuator_lag=False, engine_lag=False).dataset
    np.testing.assert_allclose(flight.elevator_deg[1:], flight.elevator_command_deg[:-1], rtol=0, atol=1e-12)
    power = flight.power_percent.values
    assert power[50] == pytest.approx(power[0], abs=1e-6)
    assert power[52] == pytest.approx(64.94 * float(flight.throttle[51]), rel=1e-9)  # gearing of [SL], below 0.77


def test_wind_moves_the_aircraft_and_keeps_the_motion_through_the_air():
    calm = doublet_flight(0.02)
    controls = {"elevator": anser.doublet(0.02), "aileron": anser.doublet(0.02, start_s=3.0)}
    windy = anser.simulate(
        f16(), level(), controls, duration_s=DURATION_S, wind={"speed_m_s": 20.0, "from_deg": 270.0}
    ).dataset
    np.testing.assert_allclose(windy.alpha_deg, calm.alpha_deg, rtol=0, atol=1e-8)
    assert float(windy.east_m[-1] - calm.east_m[-1]) == pytest.approx(200.0, abs=1e-6)


def test_turbulence_depends_on_the_seed_alone():
    fly = functools.partial(anser.simulate, f16(), level(), duration_s=1.0, turbulence="moderate")
    first, again, other = fly(seed=1).dataset, fly(seed=1).dataset, fly(seed=2).dataset
    assert first.identical(again)
    assert float(abs(first.gust_w_m_s - other.gust_w_m_s).max()) > 0.1


def test_a_flight_ends_at_the_ground_and_tells_so():
    low = f16().start(level()) | {"altitude_m": 40.0, "pitch_deg": -20.0}
    flight = anser.simulate(f16(), low, duration_s=DURATION_S)
    assert "the ground was reached" in flight.dataset.attrs["end"]
    assert float(flight.dataset.altitude_m.min()) > 0.0
    assert float(flight.dataset.time[-1]) < 3.0
    assert "the ground was reached" in repr(flight)


def test_a_saved_flight_is_read_again_with_its_picture_and_page(tmp_path):
    # rows and stride of the flights for identification, so that the program is theirs
    flight = anser.simulate(f16(), level(), duration_s=1.0, record_period_s=0.02)
    assert flight.dataset.sizes["time"] == 51
    folder = flight.save(tmp_path / "flight")
    assert read_netcdf(folder / "flight.nc").equals(flight.dataset)
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "<svg" in page
    assert "Angle of attack" in page
    assert (folder / "flight.png").stat().st_size > 10_000
    with pytest.raises(FileExistsError, match="not overwritten"):
        flight.save(folder)
    flight.save(folder, force=True)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"aircraft": "f17"}, "f17"),
        ({"aircraft": 3}, "aircraft: arrived int"),
        ({"start": {"airspeed_m_s": 150.0}}, "altitude_m is missing"),
        ({"start": {"airspeed_m_s": 150.0, "altitude_m": 10.0, "alfa_deg": 3.0}}, "arrived 'alfa_deg'"),
        ({"start": {"airspeed_m_s": -1.0, "altitude_m": 10.0}}, "a positive airspeed"),
        ({"start": {"airspeed_m_s": 150.0, "altitude_m": -10.0}}, "above the ground"),
        ({"start": 7}, "start: arrived int; expected a trim"),
        ({"record_period_s": 0.015}, "a multiple of the step"),
        ({"record_period_s": float("nan")}, "record_period_s: arrived nan"),
        (
            {"controls": {"elevator": 1.0, "elevator_deg": 2.0}},
            "'elevator' and 'elevator_deg'; expected each input once",
        ),
        (
            {"controls": {"elevator": anser.doublet(1.0, width_s=0.002)}},
            "a pulse of 0.002 s; expected at least the step",
        ),
        (
            {"controls": lambda t, x: {"elevator": 1.0}, "increments": True},
            "increments: arrived True beside a function",
        ),
        (
            {"gust": [{"up_m_s": 5.0, "length_m": 100.0, "time_s": 1.0, "aircraft": "north"}]},
            r'gust\[0\]\.aircraft: arrived "north"',
        ),
        ({"gust": [{"up_m_s": 5.0, "length_m": 100.0, "time_s": 50.0}]}, r"gust\[0\]\.time_s: arrived 50"),
        ({"controller": "pid"}, "controller: arrived 'pid'"),
        ({"controller": "inversion", "controls": {"elevator": 1.0}}, "expected one of the two"),
        ({"command": {"course_deg": 1.0}}, "command: arrived without a controller"),
        ({"command": PrescribedCommand(jnp.zeros((1, 3)))}, "command: arrived without a controller"),
        ({"controls": lambda t, x: {"elevater": 1.0}}, "arrived 'elevater' from the function"),
        ({"controls": lambda t, x: None}, "the function raised TypeError"),
        ({"controls": lambda t, x: {"elevator": 1.0 if t > 1.0 else 0.0}}, "jnp.where in place of if"),
        ({"controls": {"throttle": 50.0}}, r"expected 0 to 1 \(not percent\)"),
        ({"start": {"airspeed_m_s": 150.0, "altitude_m": 1000.0, "elevator_deg": 90.0}}, "-25 to 25, the stops"),
        ({"start": {"airspeed_m_s": 150.0, "altitude_m": 1000.0, "alpha_deg": float("nan")}}, "nan as alpha_deg"),
        ({"duration_s": "1"}, "duration_s: arrived '1'"),
        ({"duration_s": 1.0, "step_s": 0.03}, "duration_s: arrived 1 s; expected a multiple of the step, 0.03 s"),
        ({"step_s": 0.25}, r"step_s: arrived 0.25; expected a number from 0.001 to 0.05 s.* record_period_s"),
    ],
)
def test_wrong_arguments_are_refused_in_one_sentence(change, message):
    arguments = {"aircraft": f16(), "start": level(), "duration_s": SHORT_S} | change
    with pytest.raises(ValueError, match=message):
        anser.simulate(arguments.pop("aircraft"), arguments.pop("start"), **arguments)


def test_a_trim_of_another_aircraft_is_no_start():
    with pytest.raises(ValueError, match=r"arrived a trim of an aircraft of 9295\.44 kg; expected one of this"):
        anser.simulate("aerosonde", level(), duration_s=1.0)
    with pytest.raises(ValueError, match=r"arrived a trim of another aircraft of the same mass"):
        anser.simulate(anser.aircraft("f16", x_cg_over_c=0.25), level(), duration_s=1.0)


def test_a_trim_in_wind_starts_at_its_airspeed():
    still = standard_environment()
    windy = dataclasses.replace(still, wind=SteadyWind(jnp.array([20.0, 5.0, 0.0])))
    trim = anser.trim("f16", 150.0, 1000.0, environment=windy)
    for environment in (still, windy):
        point = resolve_start(f16().airframe, environment, trim)
        assert named_state(f16().airframe, environment, point)["airspeed_m_s"] == pytest.approx(150.0, abs=1e-9)


def test_a_start_by_name_has_the_scheduled_flap_of_the_trim():
    aircraft = anser.aircraft("f16", variant="tp1538")
    trim = aircraft.trim(speed_m_s=150.0, altitude_m=1000.0)
    point = resolve_start(aircraft.airframe, standard_environment(), aircraft.start(trim))
    np.testing.assert_allclose(point.state.actuators.alpha_lag, trim.point.state.actuators.alpha_lag, atol=1e-9)
    np.testing.assert_allclose(point.state.surfaces, trim.point.state.surfaces, atol=1e-9)


def test_rows_far_apart_cost_few_further_steps(monkeypatch):
    counts, fly = [], flight_module._fly
    monkeypatch.setattr(flight_module, "_fly", lambda *arguments: counts.append(arguments[-1]) or fly(*arguments))
    flown = anser.simulate(f16(), level(), duration_s=SHORT_S, record_period_s=2.0).dataset
    assert counts[0] <= 2 * SHORT_S / 0.01
    whole = anser.simulate(f16(), level(), duration_s=SHORT_S).dataset
    np.testing.assert_array_equal(flown.altitude_m, whole.altitude_m[::200])


def test_increments_are_added_to_the_motion_of_the_start_too():
    flown = anser.simulate(
        f16(), level(), controller="inversion", command={"airspeed_m_s": 10.0}, increments=True, duration_s=SHORT_S
    ).dataset
    assert float(flown.airspeed_command_m_s[-1]) == pytest.approx(160.0)


class Pitot(AbstractSensors):
    """Sensors whose airspeed is the true one times a factor."""

    factor: float

    def read(self, state, truth, instant):
        reading, state = IdealSensors().read(state, truth, instant)
        measured_b = self.factor * truth.state.velocity_b  # in still air
        return eqx.tree_at(lambda r: r.velocity_air_b, reading, measured_b, is_leaf=lambda leaf: leaf is None), state


def test_an_airspeed_that_is_measured_too_low_is_flown_too_fast():
    flown = anser.simulate(f16(), level(), controller="inversion", sensors=Pitot(0.95), duration_s=40.0).dataset
    assert float(flown.airspeed_m_s[-1]) == pytest.approx(150.0 / 0.95, abs=0.1)


class CountedInWholeNumbers(AbstractController):
    def init(self, state, attitude):
        return jnp.zeros((), int)

    def control(self, state, belief, command, step):
        return Controls(belief.state.surfaces, 0.1 * state), None, state + step


class CommandAlone(AbstractGuidance):
    def command(self, guidance_state, belief, plan, instant):
        return belief.state.position_n


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        (
            {"command": CommandAlone()},
            r"CommandAlone.command: arrived an array .*; expected \(command, reference_n, state\)",
        ),
        ({"controller": CountedInWholeNumbers()}, r"control: arrived the state .* float64.*; expected .* int64"),
        ({"sensors": Pitot}, "sensors: arrived the class Pitot; expected an object of a subclass"),
        ({"sensors": "nowhere:Ideal"}, "sensors: arrived \"nowhere:Ideal\" \\(No module named 'nowhere'\\)"),
        ({"estimator": IdealSensors()}, "estimator: arrived an object of IdealSensors"),
    ],
)
def test_wrong_parts_are_refused_as_in_a_scenario(parts, message):
    with pytest.raises(ScenarioError, match=message):
        anser.simulate(f16(), level(), duration_s=1.0, **({"controller": "inversion"} | parts))


def test_an_input_excited_under_two_names_is_refused():
    twice = {"elevator": anser.doublet(1.0), "elevator_deg": anser.doublet(1.0)}
    with pytest.raises(ValueError, match="arrived 'elevator_deg' beside another name"):
        anser.simulate(f16(), level(), controller="inversion", excitation=twice, duration_s=3.0)


def test_wrong_air_is_refused_as_in_a_scenario():
    with pytest.raises(ScenarioError, match=r"wind.speed_m_s: arrived 300"):
        anser.simulate(f16(), level(), duration_s=1.0, wind={"speed_m_s": 300.0})
    with pytest.raises(ScenarioError, match=r"turbulence\.intensity"):
        anser.simulate(f16(), level(), duration_s=1.0, turbulence="wild")


@pytest.mark.long
def test_a_trim_without_steady_flight_is_no_start():
    with pytest.raises(ConditionError, match="no steady flight"):
        anser.simulate(f16(), f16().trim(20.0, 1000.0), duration_s=1.0)


def test_own_controller_in_the_loop_of_one_aircraft():
    class Hold(anser.parts.AbstractController):
        def init(self, state, attitude):
            return state.surfaces

        def control(self, held, belief, command, step):
            pitch_rate = belief.state.rates_b[1]
            surfaces = held + jnp.stack([0.5 * pitch_rate, 0.0 * pitch_rate, 0.0 * pitch_rate])
            return anser.aircraft.Controls(surfaces, jnp.asarray(0.15)), None, held

    flight = anser.simulate(f16(), level(), controller=Hold(), duration_s=1.0).dataset
    assert flight.attrs["controller"].endswith("Hold")
    assert float(abs(flight.throttle - 0.15).max()) == 0.0


CHANGE = {"time_s": 2.0, "surface_effectiveness": {"elevator": 0.5}, "thrust": 0.8, "mass": 1.1}


def test_a_change_during_the_flight_is_flown_from_its_time_on():
    """Until its time the flight is the unchanged one; afterwards open loop equals a start in the changed aircraft."""
    flown = anser.simulate(f16(), level(), duration_s=SHORT_S, change=CHANGE).dataset
    plain = anser.simulate(f16(), level(), duration_s=SHORT_S).dataset
    before = slice(0.0, 1.995)
    for name in ("alpha_deg", "pitch_rate_deg_s", "airspeed_m_s", "load_factor"):
        np.testing.assert_allclose(flown[name].sel(time=before), plain[name].sel(time=before), rtol=1e-9, atol=1e-9)
    after = flown.sel(time=2.0)
    np.testing.assert_allclose(after["thrust_n"], 0.8 * plain["thrust_n"].sel(time=2.0), rtol=1e-6)
    # less download of the elevator on the trimmed aircraft changes the pitching moment at once
    elevator_rad = np.radians(float(plain["elevator_deg"][0]))
    linear = f16().linearize(level())
    M_elevator = float(np.asarray(linear.model.B)[linear.model.states.index("Q"), 1])
    slope = float(np.diff(flown["pitch_rate_deg_s"].sel(time=slice(2.0, 2.015)))[0]) / 0.01
    assert slope == pytest.approx(np.degrees(-0.5 * M_elevator * elevator_rad), rel=0.1)
    assert '"thrust": 0.8' in flown.attrs["change"]


@pytest.mark.long
def test_the_controller_does_not_know_of_a_change():
    """At the sample of the change the trimmed command stays; two samples later the elevator moves."""
    held = anser.simulate(f16(), level(), controller="inversion", duration_s=2.5, change=CHANGE).dataset
    command = np.abs(held["elevator_command_deg"].values - float(held["elevator_command_deg"][0]))
    assert command[200] < 1e-6
    assert command[202] > 1e-2
    assert '"thrust": 0.8' in held.attrs["change"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"drag": 1.2}, "time_s"),
        ({"time_s": 1.0, "drag": "1.2"}, "drag"),
        ({"time_s": 0.5, "surface_effectiveness": {"flap": 0.5}}, "elevator, aileron, rudder"),
        ([{"time_s": 1.0, "coefficients": {"Cmq": 0.5}}], "do not change during the flight"),
        ({"time_s": 5.0, "drag": 1.2}, r"change\[0\].time_s: arrived 5; expected a time before the end of the flight"),
    ],
)
def test_a_change_that_is_not_valid_is_refused(change, message):
    with pytest.raises(ScenarioError, match=message):
        anser.simulate(f16(), level(), duration_s=1.0, change=change)


@pytest.mark.long
def test_a_trim_in_hot_air_is_steady_there_and_refused_elsewhere():
    f16, hot = anser.aircraft("f16"), {"temperature_offset_k": 20.0}
    trim = f16.trim(150, 1000, atmosphere=hot)
    flight = anser.simulate(f16, trim, duration_s=2, atmosphere=hot)
    assert float(np.abs(flight.dataset.altitude_m - 1000.0).max()) < 1e-6
    assert "+20 K" in flight.dataset.attrs["air"]
    assert float(flight.dataset.density_altitude_m[0]) > 1500.0
    with pytest.raises(ValueError, match=r"start: arrived a trim in another atmosphere"):
        anser.simulate(f16, trim, duration_s=2)


@pytest.mark.long
def test_an_airspeed_command_that_the_braking_propeller_cannot_follow_is_not_overshot():
    """The least thrust of a windmilling propeller lies inside the range of powers: there the integral stops too."""
    aerosonde = anser.aircraft("aerosonde")
    trim = aerosonde.trim(speed_m_s=30.0, altitude_m=500.0)
    command = {"airspeed_m_s": anser.step_input(-10.0, start_s=2.0)}
    flight = anser.simulate(aerosonde, trim, controller="inversion", command=command, duration_s=40.0)
    airspeed_m_s = flight.dataset["airspeed_m_s"].values
    assert airspeed_m_s.min() > 19.9
    np.testing.assert_allclose(airspeed_m_s[-100:], 20.0, atol=0.05)
