"""Linear feedback as a controller: against the sampled linear model, commands, in the simulator, and refusals."""

import functools

import numpy as np
import pytest
from scipy.linalg import expm

import anser

DURATION_S, STEP_S = 10.0, 0.01
Q = {"theta": 20, "Q": 1, "beta": 1, "phi": 5, "P": 0.5, "R": 1, "V": 1e-3, "V_integral": 1e-4, "gamma_integral": 2}
R = {"throttle": 1, "elevator": 20, "aileron": 20, "rudder": 20}
VARIABLES = {
    "V": "airspeed_m_s",
    "alpha": "alpha_deg",
    "beta": "beta_deg",
    "phi": "roll_deg",
    "theta": "pitch_deg",
    "psi": "yaw_deg",
    "P": "roll_rate_deg_s",
    "Q": "pitch_rate_deg_s",
    "R": "yaw_rate_deg_s",
}


@functools.cache
def f16():
    return anser.aircraft("f16")


@functools.cache
def level():
    return f16().trim(speed_m_s=150.0, altitude_m=1000.0)


@functools.cache
def linear():
    return f16().linearize(level())


@functools.cache
def regulator():
    return anser.LinearFeedback.from_weights(linear(), Q, R)


def commands(step_deg):
    return {"course_deg": anser.step_input(step_deg), "path_angle_deg": anser.step_input(step_deg)}


def linear_response(step_deg):
    """States of the linear model under the sampled feedback: exact over each step by the matrix exponential."""
    model, law = f16().linearize(level(), actuators=True).model, regulator()
    A, B, C, K = (np.asarray(matrix) for matrix in (model.A, model.B, model.C, law.gain))
    count, inputs = B.shape
    transition = expm(np.block([[A, B], [np.zeros((inputs, count + inputs))]]) * STEP_S)
    fed_back = [model.states.index(name) for name in law.states[:-2]]
    gamma, chi = (C[model.outputs.index(name)] for name in ("gamma", "chi"))
    x, integral = np.zeros((round(DURATION_S / STEP_S) + 1, count)), np.zeros(2)
    for k in range(len(x) - 1):
        command = np.radians(step_deg) * (k >= round(1.0 / STEP_S))
        deviation = x[k, fed_back]
        deviation[law.states.index("phi")] -= 150.0 / 9.80665 * 0.25 * (command - chi @ x[k])
        deviation[law.states.index("theta")] -= command
        x[k + 1] = transition[:count] @ np.append(x[k], -K @ np.append(deviation, integral))
        integral = integral + STEP_S * np.array([x[k, model.states.index("V")], gamma @ x[k] - command])
    return dict(zip(model.states, (x + np.asarray(model.x)).T, strict=True))


@pytest.mark.long
def test_small_steps_approach_the_linear_model_with_the_square_of_the_step():
    errors = {}
    for step_deg in (0.01, 0.02):
        flown = anser.simulate(
            f16(), level(), controller=regulator(), command=commands(step_deg), duration_s=DURATION_S
        ).dataset
        expected = linear_response(step_deg)
        for state, name in VARIABLES.items():
            values = flown[name].values * (1.0 if state == "V" else np.pi / 180.0)
            errors[state, step_deg] = np.abs(values - expected[state]).max()
            # the sideslip of a coordinated turn is itself almost of second order: 1.6 % of it at 0.02 deg, others 0.4 %
            assert errors[state, step_deg] < 0.02 * np.ptp(expected[state]), state
    for state in VARIABLES:
        # what remains of the third order at these steps changes the ratio by 0.5 %
        assert errors[state, 0.02] / errors[state, 0.01] == pytest.approx(4.0, rel=0.02), state


def test_the_regulator_follows_commands_and_gives_a_report(tmp_path):
    command = {"course_deg": anser.step_input(30), "airspeed_m_s": anser.step_input(10, 15)}
    # with four times the step, the flight has the rows of the others and shares their program
    options = {"command": command, "duration_s": 4 * DURATION_S, "step_s": 4 * STEP_S}
    flight = anser.simulate(f16(), level(), controller=regulator(), **options)
    assert float(flight.dataset.course_deg[-1]) == pytest.approx(30.0, abs=0.1)
    assert float(flight.dataset.airspeed_m_s[-1]) == pytest.approx(160.0, abs=0.3)
    assert float(flight.dataset.roll_deg.max()) < 42.0  # the limit of the reference is 40 deg
    assert flight.report(tmp_path / "steps.html").stat().st_size > 10_000


def test_a_gain_matrix_is_the_regulator_by_its_own_gain():
    law = regulator()
    order = [*linear().model.inputs]
    same = anser.LinearFeedback.from_gain(linear(), np.asarray(law.gain), law.states, order)
    np.testing.assert_array_equal(same.gain, law.gain)
    damped = {"alpha": -0.3, "Q": -0.5}  # with the states of the regulator, the flight shares its program
    gain = [[damped.get(name, 0.0) for name in law.states]]
    elevator = anser.LinearFeedback.from_gain(linear(), gain, law.states, ["elevator"])
    upset = {**f16().start(level()), "pitch_rate_deg_s": 8.0}
    flight = anser.simulate(f16(), upset, controller=elevator, duration_s=DURATION_S).dataset
    pitch_rate, alpha = (np.radians(flight[name].values) for name in ("pitch_rate_deg_s", "alpha_deg"))
    expected = float(linear().model.u[1]) + 0.3 * (alpha - alpha[0]) + 0.5 * pitch_rate
    np.testing.assert_allclose(np.radians(flight.elevator_command_deg), expected, rtol=0, atol=1e-9)
    assert float(np.ptp(flight.throttle.values)) == 0.0


@pytest.mark.long
def test_the_regulator_leads_one_and_many_simulated_aircraft_back_to_the_trim():
    upset = {**f16().start(level()), "pitch_rate_deg_s": 5.0, "roll_deg": 10.0}
    for start in (upset, [upset] * 4):
        simulator = anser.Simulator(f16(), start)
        for _ in range(500):
            simulator.step(regulator().controls(simulator.state))
        assert np.max(np.abs(simulator.state["roll_deg"])) < 0.5
        assert np.max(np.abs(simulator.state["pitch_rate_deg_s"])) < 0.05
    flight = anser.simulate(f16(), upset, lambda time_s, state: regulator().controls(state), duration_s=5.0).dataset
    for name in ("roll_deg", "pitch_rate_deg_s", "altitude_m"):
        assert float(flight[name][-1]) == pytest.approx(simulator.state[name][0], abs=1e-9), name


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: anser.LinearFeedback.from_weights(linear(), {"alfa": 1}, R), "Q: arrived 'alfa'; expected names"),
        (lambda: anser.LinearFeedback.from_weights(linear(), Q, {"elevater": 1}), "R: arrived 'elevater'"),
        (lambda: anser.LinearFeedback.from_weights(linear(), {"Q": -1}, R), "arrived a negative weight"),
        (lambda: anser.LinearFeedback.from_weights(linear(), Q, {}), r"R: arrived \[\]"),
        (lambda: anser.LinearFeedback.from_gain(linear(), [[1.0]], ["Q", "V"], ["elevator"]), r"gain: arrived shape"),
        (
            lambda: anser.LinearFeedback.from_gain(linear(), [[1.0, 1.0]], ["V_integral", "V"], ["elevator"]),
            "the columns in the order V, V_integral",
        ),
        (
            lambda: anser.LinearFeedback.from_weights(f16().linearize(level(), actuators=True), Q, R),
            "linear: arrived a model of a loop or with actuators",
        ),
        (
            lambda: anser.simulate(
                anser.aircraft("f16", "tp1538"), f16().start(level()), controller=regulator(), duration_s=1
            ),
            "expected the surfaces elevator, aileron, rudder",
        ),
    ],
)
def test_wrong_arguments_are_refused_by_name(make, message):
    with pytest.raises(ValueError, match=message):
        make()
