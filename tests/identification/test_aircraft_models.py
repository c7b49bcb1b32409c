"""Models of aircraft: equal to the equations of motion, and to the derivatives of aircraft that were flown."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import anser
from anser.aircraft.global_model import GLOBAL_TERMS
from anser.airframe_data import derivative_index
from anser.identification.aircraft_models import aircraft_model, short_period_model
from anser.identification.kinematics import with_specific_force
from anser.identification.output_error import estimate_output_error
from anser.identification.records import flight_record
from anser.spatial.wind_axes import flow_angles
from support.manoeuvres import NOISE, STEP_S, f16, noisy_record, record_manoeuvre


@pytest.mark.parametrize("name", [pytest.param("f16", marks=pytest.mark.long), "aerosonde"])
def test_nonlinear_model_equals_the_equations_of_motion(name):
    aircraft = anser.aircraft(name)
    model = aircraft_model(aircraft.airframe, ())
    surfaces = 0.05 * np.arange(1, len(aircraft.inputs))
    velocity, roll, pitch, rates = np.array([80.0, 4.0, 7.0]), 0.4, 0.1, np.array([0.2, -0.1, 0.05])
    state = np.array([0.0, 0.0, 500.0, *velocity, roll, pitch, 1.0, *rates])
    controls = np.array([*surfaces, 0.3])
    rate = aircraft.derivatives(state, controls, lag=False)
    percent = float(aircraft.airframe.engine.steady_power(jnp.asarray(0.3)))
    angles_and_rates = jax.jit(lambda v, a: jax.jvp(lambda v: jnp.stack(flow_angles(v)), (v,), (a,)))
    flow, flow_rates = angles_and_rates(velocity, np.asarray(rate[3:6]))
    x_dot, y = jax.jit(lambda x, u: model.equations(x, u, {}))(
        np.array([*flow, roll, pitch, *rates]), np.array([*surfaces, percent, 500.0])
    )
    np.testing.assert_allclose(x_dot, [*flow_rates, rate[6], rate[7], *rate[9:12]], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(y[:8], [*flow, roll, pitch, *rates])


def test_increments_act_as_changed_derivatives_of_an_aircraft_file():
    airframe = anser.aircraft("aerosonde").airframe
    surfaces = airframe.actuators.names
    x = jnp.array([25.0, 0.08, 0.05, 0.1, 0.1, 0.2, -0.1, 0.1])
    u = jnp.array([*(0.1 * np.arange(1, len(surfaces) + 1)), 50.0, 100.0])
    for name in ("CL_alpha", "CY_beta", "Cl_p", "Cm_q", f"Cn_{surfaces[0]}"):
        model = aircraft_model(airframe, (name, f"d{name}"))
        published = float(airframe.derivatives[derivative_index(name, surfaces)])
        changed = model.equations(x, u, {name: jnp.asarray(published + 0.1)})
        increment = model.equations(x, u, {f"d{name}": jnp.asarray(0.1)})
        assert np.max(np.abs(np.asarray(changed[0] - model.equations(x, u, {})[0]))) > 1e-4
        if name == "CL_alpha":  # the drag of the file is induced by its own lift
            continue
        np.testing.assert_allclose(increment[0], changed[0], rtol=1e-9, atol=1e-12)


GLOBAL_NAMES = [f"{coefficient}[{term}]" for coefficient, terms in GLOBAL_TERMS.items() for term in terms]
AEROSONDE_NOISE = {
    **{name: sigma for name, sigma in NOISE.items() if name != "yaw_deg"},
    "specific_force_z_m_s2": 0.1,
}


@pytest.fixture(scope="module")
def aerosonde_record():
    """3-2-1-1 of the elevator, then doublets of aileron and rudder, of an aircraft given by derivatives."""
    aircraft = anser.aircraft("aerosonde")
    controls = {
        "elevator": anser.three_two_one_one(2.0, 1.0, 0.3),
        "aileron": anser.doublet(3.0, 4.0, 0.5),
        "rudder": anser.doublet(4.0, 6.0, 0.5),
    }
    trim = aircraft.trim(speed_m_s=25.0, altitude_m=300.0)
    flight = anser.simulate(aircraft, trim, controls, duration_s=10.0, step_s=0.01, record_period_s=STEP_S)
    return aircraft.airframe, with_specific_force(flight_record(flight))


@pytest.mark.long
def test_derivatives_of_an_aircraft_file_are_found_from_its_flight(aerosonde_record):
    airframe, record = aerosonde_record
    names = ("CL_alpha", "CL_elevator", "Cm_alpha", "Cm_q", "Cm_elevator", "CY_beta", "Cl_beta", "Cl_p", "Cl_aileron")
    names += ("Cn_beta", "Cn_r", "Cn_rudder")
    truth = {name: float(airframe.derivatives[derivative_index(name, airframe.actuators.names)]) for name in names}
    model = aircraft_model(airframe, names)
    start = {name: 0.7 * value for name, value in truth.items()}
    estimate = estimate_output_error(
        model, record_manoeuvre(model, record.with_noise(AEROSONDE_NOISE)), start, initial_states=model.states
    )
    error = (estimate.values[: len(names)] - list(truth.values())) / estimate.standard_errors[: len(names)]
    assert np.all(np.abs(error) < 3.5)  # 12 parameters: chance exceeds 3.5 in 1 of 180 cases
    relative = estimate.standard_errors[: len(names)] / np.abs(list(truth.values()))
    assert np.max(relative[[0, 2, 3, 4, 7, 8, 9, 11]]) < 0.05


@pytest.mark.long
def test_increments_of_an_aircraft_with_tables_are_zero_when_it_flies_as_its_model():
    airframe = f16().airframe
    names = ("dCm0", "dCm_alpha", "dCm_q", "dCm_elevator", "dCL0", "dCL_alpha", "dCD0")
    model = aircraft_model(airframe, names, ("airspeed", "alpha", "pitch", "pitch_rate", "specific_force_z"))
    manoeuvre = record_manoeuvre(model, noisy_record("3211"))
    estimate = estimate_output_error(
        model, manoeuvre, dict.fromkeys(names, 0.0), initial_states=("airspeed", "alpha", "pitch", "pitch_rate")
    )
    error = estimate.values[: len(names)] / estimate.standard_errors[: len(names)]
    assert np.all(np.abs(error) < 3.5)
    # 5 % of the slope of lift, 4.4 per rad; the F-16 is nearly neutral in pitch
    assert estimate.standard_errors[5] < 0.2
    assert estimate.standard_errors[1] < 0.05


@pytest.mark.long
def test_terms_of_the_global_model_are_found_from_its_flight():
    aircraft = anser.aircraft("f16", variant="global")
    controls = {
        "elevator": anser.multisine(2.0, (0.1, 1.2), 20.0, channel=0, channels=3),
        "aileron": anser.multisine(2.0, (0.1, 1.2), 20.0, channel=1, channels=3),
        "rudder": anser.multisine(3.0, (0.1, 1.2), 20.0, channel=2, channels=3),
    }
    trim = aircraft.trim(speed_m_s=150.0, altitude_m=1000.0)
    flight = anser.simulate(aircraft, trim, controls, duration_s=22.0, step_s=0.01, record_period_s=STEP_S)
    record = with_specific_force(flight_record(flight)).with_noise(NOISE)
    names = ("CL[alpha]", "Cm[alpha]", "Cm[q]", "Cm[elevator]", "CY[beta]", "Cl[beta]", "Cl[p]", "Cl[aileron]")
    names += ("Cn[beta]", "Cn[r]", "Cn[rudder]")
    values = dict(zip(GLOBAL_NAMES, np.asarray(aircraft.airframe.parameters), strict=True))
    truth = np.array([values[name] for name in names])
    model = aircraft_model(aircraft.airframe, names)
    start = dict(zip(names, 0.8 * truth, strict=True))
    estimate = estimate_output_error(model, record_manoeuvre(model, record), start, initial_states=model.states)
    error = (estimate.values[: len(names)] - truth) / estimate.standard_errors[: len(names)]
    assert np.all(np.abs(error) < 3.5)
    assert np.max(estimate.standard_errors[: len(names)] / np.abs(truth)) < 0.1


@pytest.mark.long
def test_short_period_equals_the_linear_model_of_the_aircraft():
    linear = f16().linearize(f16().trim(speed_m_s=150.0, altitude_m=1000.0)).model
    A, B = np.asarray(linear.A), np.asarray(linear.B)
    alpha, q = linear.states.index("alpha"), linear.states.index("Q")
    elevator = linear.inputs.index("elevator")
    truth = {
        "Z_alpha": A[alpha, alpha],
        "Z_q": A[alpha, q],
        "Z_elevator": B[alpha, elevator],
        "M_alpha": A[q, alpha],
        "M_q": A[q, q],
        "M_elevator": B[q, elevator],
    }
    model = short_period_model(150.0)
    start = {**truth, "M_q": 0.7 * truth["M_q"], "M_elevator": 1.3 * truth["M_elevator"], "Z0": 0.0, "M0": 0.0}
    record = noisy_record("doublet").window(0.0, 5.0)
    estimate = estimate_output_error(model, record_manoeuvre(model, record), start, initial_states=model.states)
    # airspeed changes by some percent, and the tables' slopes by alpha: 10 % of the great derivatives
    for name in ("Z_alpha", "M_q", "M_elevator"):
        assert estimate[name] == pytest.approx(truth[name], rel=0.1)
    assert estimate["M_alpha"] == pytest.approx(truth["M_alpha"], abs=0.1 * abs(truth["M_q"]))


@pytest.mark.parametrize(
    ("names", "options", "message"),
    [
        (("dCm_alfa",), {}, "names: arrived 'dCm_alfa' for F16; expected an increment such as dCm_alpha"),
        (("Cm_alpha",), {}, "names: arrived 'Cm_alpha' for F16; expected an increment such as dCm_alpha"),
        (("dCm_alpha",), {"outputs": ("Q",)}, "outputs: arrived .*expected some of airspeed, alpha"),
    ],
)
def test_parameters_that_are_no_derivatives_are_refused(names, options, message):
    with pytest.raises(ValueError, match=message):
        aircraft_model(f16().airframe, names, **options)
