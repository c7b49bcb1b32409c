"""Adaptive estimator: recursive least squares, derivatives of the model, estimates in flight."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import anser
from anser.aircraft.corrected_airframe import reference_lengths, without_aerodynamics
from anser.aircraft.motion import air_data_and_forces
from anser.aircraft_files.library import load_airframe
from anser.analysis.step_flights import step_case
from anser.control.inversion_autopilot import InversionAutopilot
from anser.control.probing import probing_controller
from anser.environment.environment import standard_environment
from anser.sensing.adaptation import adaptive_estimator, least_squares_step, model_derivatives
from anser.sensing.estimators import TrackingEstimator
from anser.single_aircraft.starts import resolve_start


@jax.jit
def _recursion(phi, y, prior, forgetting, weight):
    theta, P = jnp.zeros((1, phi.shape[1])), jnp.diag(prior**2)[None]

    def step(state, row):
        phi_k, y_k = row
        theta, P = state
        error = y_k - jnp.sum(theta[0] * phi_k)
        return least_squares_step(theta, P, phi_k[None], error[None], weight, forgetting), None

    return jax.lax.scan(step, (theta, P), (phi, y))[0]


def regressions(phi, y, prior, forgetting=0.0, weight=1.0):
    """Coefficients and covariance after all rows of one regression."""
    theta, P = _recursion(phi, y, np.asarray(prior, dtype=float), forgetting, weight)
    return np.asarray(theta[0]), np.asarray(P[0])


@given(seed=st.integers(0, 2**31), size=st.integers(1, 5))
@settings(max_examples=15, deadline=None)
def test_without_forgetting_the_recursion_is_the_batch_solution(seed, size):
    rng = np.random.default_rng(seed)
    phi, noise, prior = rng.normal(size=(40, size)), rng.normal(size=40), rng.uniform(0.5, 3.0, size)
    y = phi @ rng.normal(size=size) + noise
    theta, P = regressions(phi, y, prior)
    information = phi.T @ phi + np.diag(1.0 / prior**2)
    np.testing.assert_allclose(theta, np.linalg.solve(information, phi.T @ y), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(P, np.linalg.inv(information), rtol=1e-9, atol=1e-12)


@given(seed=st.integers(0, 2**31), forgetting=st.floats(0.001, 0.2))
@settings(max_examples=15, deadline=None)
def test_forgetting_keeps_the_covariance_positive_and_below_the_prior(seed, forgetting):
    rng = np.random.default_rng(seed)
    # long pauses: nothing is forgotten without excitation
    phi = rng.normal(size=(200, 3)) * rng.choice([0.0, 1e-6, 1.0], (200, 1))
    _, P = regressions(phi, rng.normal(size=200), np.ones(3), forgetting)
    eigenvalues = np.linalg.eigvalsh(0.5 * (P + P.T))
    assert np.all(eigenvalues > 0.0)
    assert np.all(eigenvalues <= 1.0 + 1e-9)


def test_forgetting_follows_a_change():
    rng = np.random.default_rng(1)
    phi = rng.normal(size=(600, 2))
    truth = np.where(np.arange(600)[:, None] < 300, [1.0, -2.0], [2.0, -1.0])
    y = np.sum(phi * truth, axis=1) + rng.normal(0.0, 0.1, 600)
    theta, _ = regressions(phi, y, [3.0, 3.0], forgetting=0.05, weight=100.0)
    np.testing.assert_allclose(theta, [2.0, -1.0], atol=0.1)
    slow, _ = regressions(phi, y, [3.0, 3.0], weight=100.0)
    assert np.all(np.abs(slow - [2.0, -1.0]) > 0.3)


def test_derivatives_of_the_model_are_differences_of_its_coefficients():
    airframe, environment = load_airframe("f16"), standard_environment()
    trim = anser.aircraft("f16").trim(speed_m_s=150.0, altitude_m=1000.0)
    state = resolve_start(airframe, environment, trim).state
    lengths = reference_lengths(airframe)
    data = jax.jit(air_data_and_forces)(airframe, environment, 0.0, state).air_data
    derivatives = np.asarray(jax.jit(model_derivatives)(airframe, lengths, data, state.rates_b, state.surfaces))
    assert derivatives.shape == (6, 7)
    assert not np.any(derivatives[:, 0])

    @jax.jit
    def compiled(rates_b, surfaces):
        return lengths.coefficients(data.qbar, airframe.aerodynamics(data, rates_b, surfaces))

    def coefficients(rates_b, surfaces):
        return np.asarray(compiled(rates_b, surfaces))

    small = 1e-4
    for k in range(3):
        moved = [state.surfaces.at[k].add(sign * small) for sign in (1.0, -1.0)]
        slope = (coefficients(state.rates_b, moved[0]) - coefficients(state.rates_b, moved[1])) / (2.0 * small)
        np.testing.assert_allclose(derivatives[:, 4 + k], slope, atol=1e-6)
    hat = 2.0 * float(data.V) / np.array([lengths.span, lengths.mean_chord, lengths.span])
    for axis, column, rows in ((0, 2, (1, 3, 5)), (1, 2, (0, 2, 4)), (2, 3, (1, 3, 5))):
        moved = [state.rates_b.at[axis].add(sign * small) for sign in (1.0, -1.0)]
        slope = (coefficients(moved[0], state.surfaces) - coefficients(moved[1], state.surfaces)) / (2.0 * small)
        np.testing.assert_allclose(derivatives[list(rows), column], slope[list(rows)] * hat[axis], rtol=1e-5, atol=1e-8)


TIME_S = np.arange(0.0, 25.001, 0.01)


def manoeuvre(time_s, start_s):
    """Course and path angle, deg: to one side and up for 3 s, then to the other side and down."""
    pulse = np.where((time_s > start_s) & (time_s < start_s + 3.0), 1.0, 0.0)
    pulse -= np.where((time_s >= start_s + 3.0) & (time_s < start_s + 6.0), 1.0, 0.0)
    return {"course_deg": 8.0 * pulse, "path_angle_deg": 2.0 * pulse}


def fly(change=(), controller="adaptive", manoeuvre_s=10.0, duration_s=25.0, *, turn=True):
    f16 = anser.aircraft("f16")
    trim = f16.trim(speed_m_s=150.0, altitude_m=1000.0)
    command = manoeuvre(np.arange(0.0, duration_s + 0.001, 0.01), manoeuvre_s)
    command["course_deg"] = command["course_deg"] * turn
    options = {"duration_s": duration_s, "change": change, "record_period_s": 0.1}
    return anser.simulate(f16, trim, controller=controller, command=command, **options).dataset


@pytest.mark.long
@pytest.mark.parametrize(
    ("surface", "axis", "code"), [("elevator", "pitch", 4), ("aileron", "roll", 5), ("rudder", "yaw", 6)]
)
def test_half_an_effective_surface_is_estimated_and_named(surface, axis, code):
    """Within 10 % of the truth 5 s after the manoeuvre, within three standard deviations."""
    flight = fly({"time_s": 20.0, "surface_effectiveness": {surface: 0.5}}, manoeuvre_s=25.0, duration_s=40.0)
    row = flight.sel(time=36.0, method="nearest")
    estimate, sigma = float(row[f"{axis}_effectiveness_estimate"]), float(row[f"{axis}_effectiveness_sigma"])
    assert abs(estimate - 0.5) < 0.05
    assert abs(estimate - 0.5) < 3.0 * sigma
    assert int(row["fault"]) == code
    assert abs(float(row["fault_size"]) - 0.5) < 0.05


@pytest.mark.long
@pytest.mark.parametrize(("fault_s", "manoeuvre_s"), [(3.0, 10.0), (8.0, 15.0), (15.0, 20.0)])
def test_a_fault_in_straight_flight_is_not_taken_for_turbulence(fault_s, manoeuvre_s):
    """The fault lasts some seconds unlearnt in straight flight; the next vertical manoeuvre tells it all the same."""
    change = {"time_s": fault_s, "surface_effectiveness": {"elevator": 0.5}}
    flight = fly(change, manoeuvre_s=manoeuvre_s, duration_s=40.0, turn=False)
    row = flight.sel(time=manoeuvre_s + 11.0, method="nearest")
    assert abs(float(row["pitch_effectiveness_estimate"]) - 0.5) < 0.05
    assert float(row["pitch_effectiveness_sigma"]) < 0.1
    assert int(row["fault"]) == 4


@pytest.mark.long
@pytest.mark.parametrize(
    ("change", "code", "size"),
    [({"cg_shift": 0.05}, 1, 0.05), ({"drag": 1.2, "lift_slope": 0.9}, 2, 1.0), ({"thrust": 0.8}, 3, 0.2)],
    ids=["centre of gravity", "ice", "engine"],
)
def test_faults_of_the_aircraft_are_named_with_their_size(change, code, size):
    row = fly({"time_s": 5.0, **change}).isel(time=-1)
    assert int(row["fault"]) == code
    # the window of 8 s still holds the time in which the loops answered the fault
    assert abs(float(row["fault_size"]) / size - 1.0) < 0.25


@pytest.mark.long
def test_in_straight_flight_a_shift_forward_is_not_taken_for_the_elevator():
    """Shift and half an elevator ask for the same moment there: neither explains clearly more than the other."""
    flight = fly({"time_s": 4.0, "cg_shift": -0.05}, manoeuvre_s=40.0, duration_s=40.0)
    assert not np.any(flight["fault"])


@pytest.mark.long
def test_with_the_true_model_nothing_is_learnt_and_nothing_changes():
    adaptive = fly()
    nominal = fly(controller="incremental")
    for name in ("alpha_deg", "bank_deg", "elevator_deg", "altitude_m"):
        # what a linear increment takes up of the tables' curvature in the manoeuvre
        np.testing.assert_allclose(adaptive[name], nominal[name], atol=0.01)
    assert not np.any(adaptive["fault"])
    for axis in ("roll", "pitch", "yaw"):
        np.testing.assert_allclose(adaptive[f"{axis}_effectiveness_estimate"], 1.0, atol=0.02)


@pytest.mark.long
def test_an_aircraft_that_knows_no_aerodynamics_learns_and_turns():
    f16 = anser.aircraft("f16")
    blank = without_aerodynamics(f16.airframe)
    case = step_case(f16.airframe, 150.0, 1000.0, "incremental")
    flight = anser.simulate(
        f16,
        f16.trim(speed_m_s=150.0, altitude_m=1000.0),
        controller=probing_controller(
            InversionAutopilot(case.gains, case.limits), 3, np.radians(1.0), learning_time=6.0
        ),
        estimator=adaptive_estimator(TrackingEstimator(model=blank), blank, aerodynamics_known=False),
        command={"course_deg": np.where(TIME_S > 10.0, 20.0, 0.0)},
        duration_s=25.0,
        record_period_s=0.1,
    ).dataset
    learning = flight.sel(time=slice(0.0, 6.0))
    # test inputs of 1 deg move the aircraft by a few degrees of bank and 0.2 in load factor
    assert float(np.abs(learning["bank_deg"]).max()) < 5.0
    assert float(np.abs(learning["load_factor"] - 1.0).max()) < 0.3
    last = flight.isel(time=-1)
    assert abs(float(last["course_deg"]) - 20.0) < 0.3
    assert abs(float(last["airspeed_m_s"]) - 150.0) < 0.5
    # the estimates are those of the aircraft's tables: CZ_alpha -3.62, Cm_alpha -0.14
    assert abs(float(last["cz_alpha_estimate"]) + 3.62) < 0.2
    assert abs(float(last["cm_alpha_estimate"]) + 0.14) < 0.05


@pytest.mark.long
def test_gradient_steps_follow_the_effectiveness():
    """Slower than least squares, and the derivatives of the motion keep the model's values."""
    f16 = anser.aircraft("f16")
    case = step_case(f16.airframe, 150.0, 1000.0, "incremental")
    time_s = np.arange(0.0, 60.001, 0.01)
    command = {"path_angle_deg": np.where(time_s > 25.0, 2.0 * np.sign(np.sin(2.0 * np.pi * time_s / 6.0)), 0.0)}
    flight = anser.simulate(
        f16,
        f16.trim(speed_m_s=150.0, altitude_m=1000.0),
        controller=InversionAutopilot(case.gains, case.limits),
        estimator=adaptive_estimator(TrackingEstimator(model=f16.airframe), f16.airframe, method="gradient"),
        command=command,
        duration_s=60.0,
        change={"time_s": 20.0, "surface_effectiveness": {"elevator": 0.5}},
        record_period_s=0.1,
    ).dataset
    last = flight.isel(time=-1)
    settled = flight["pitch_effectiveness_estimate"].sel(time=slice(45.0, None))
    assert float(np.abs(settled - 0.5).max()) < 0.1
    assert float(last["cm_alpha_estimate"]) == float(flight["cm_alpha_estimate"][0])
    assert abs(float(last["roll_effectiveness_estimate"]) - 1.0) < 0.05
