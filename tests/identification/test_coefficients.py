"""Coefficients along a record: those of the airframe itself on a flight without noise, and what enters them."""

import dataclasses

import jax
import numpy as np
import pytest

import anser
from anser.compiling.options import compiled_quickly
from anser.identification.coefficients import (
    _air_of_row,
    _air_rows,
    airframe_derivatives,
    compute_coefficients,
    model_coefficients,
    reference_lengths,
)
from anser.identification.kinematics import RATES, SPECIFIC_FORCE, with_specific_force
from anser.identification.records import flight_record
from anser.identification.smoothing import smooth
from support.manoeuvres import clean_record, f16, flight

AXES = ("CL", "CD", "CY", "Cl", "Cm", "Cn")


@compiled_quickly
def _own_coefficients(airframe, rows):
    return jax.vmap(lambda row: model_coefficients(airframe, row[6:], _air_of_row(row[:6])))(rows)


def own_coefficients(airframe, history):
    """CL, CD, CY, Cl, Cm, Cn of an airframe's own aerodynamics along a record of all its surfaces."""
    rows = np.vstack([_air_rows(history.record), *history.arguments.values()]).T
    return np.asarray(_own_coefficients(airframe, rows)).T


# Angular accelerations have kinks where an input steps (the F-16's actuators have a lag of 0.05 s): 50 Hz resolve them
# to 2.5 per cent, and the smooth acceleration under multisines to half a thousandth.
@pytest.mark.parametrize(("manoeuvre", "tolerance"), [("doublet", 0.025), ("lateral", 0.025), ("multisine", 0.0005)])
def test_coefficients_are_those_of_the_airframe(manoeuvre, tolerance):
    airframe = f16().airframe
    history = compute_coefficients(clean_record(manoeuvre), airframe)
    own = own_coefficients(airframe, history)
    inner = slice(25, -25)  # half a second at the ends, where the derivatives are less exact
    for name, values in zip(AXES, own, strict=True):
        error = np.std((history.coefficients[name] - values)[inner])
        assert error < tolerance * np.std(values[inner]) + 3e-6, name


@pytest.mark.long
def test_an_aircraft_by_a_file_with_a_propeller_has_its_own_coefficients_too():
    model = anser.aircraft("aerosonde")
    trim = model.trim(speed_m_s=30.0, altitude_m=300.0)
    controls = {
        "elevator": anser.doublet(1.0),
        "aileron": anser.doublet(1.0, start_s=3.0),
        "rudder": anser.doublet(2.0),
    }
    flown = anser.simulate(model, trim, controls, duration_s=8.0)
    history = compute_coefficients(flight_record(flown), model.airframe)
    own = own_coefficients(model.airframe, history)
    inner = slice(50, -50)
    for name, values in zip(AXES, own, strict=True):
        error = np.std((history.coefficients[name] - values)[inner])
        assert error < 0.025 * np.std(values[inner]), name  # as for the F-16: the inputs step


def test_thrust_and_accelerometer_position_are_accounted_for():
    airframe, record = f16().airframe, clean_record("multisine")
    expected = compute_coefficients(record, airframe).coefficients
    without_power = {key: values for key, values in record.channels.items() if key != "power"}
    by_thrust = compute_coefficients(dataclasses.replace(record, channels=without_power), airframe)
    np.testing.assert_allclose(by_thrust.coefficients["CD"], expected["CD"], rtol=0.0, atol=1e-12)
    # a measured thrust replaces that of the engine model, also beside the power
    stronger = {"thrust": record["thrust"] + 1000.0}
    beside_power = compute_coefficients(record.with_channels(**stronger), airframe).coefficients
    alone = compute_coefficients(dataclasses.replace(record, channels=without_power | stronger), airframe).coefficients
    np.testing.assert_allclose(beside_power["CD"], alone["CD"], rtol=0.0, atol=1e-12)
    assert np.min(beside_power["CD"] - expected["CD"]) > 0.001
    # accelerometers 3 m ahead of the centre of gravity and 0.5 m above measure its rotation too
    position = np.array([3.0, 0.2, -0.5])
    rates = smooth(record.stack(*RATES), record.step_s)
    lever = np.cross(rates.rate, position[:, None], axis=0)
    lever += np.cross(rates.values, np.cross(rates.values, position[:, None], axis=0), axis=0)
    elsewhere = record.with_channels(**dict(zip(SPECIFIC_FORCE, record.stack(*SPECIFIC_FORCE) + lever, strict=True)))
    corrected = compute_coefficients(elsewhere, airframe, accelerometer_m=tuple(position)).coefficients
    uncorrected = compute_coefficients(elsewhere, airframe).coefficients
    np.testing.assert_allclose(corrected["CL"], expected["CL"], rtol=0.0, atol=1e-9)
    assert np.abs(uncorrected["CL"] - expected["CL"]).max() > 0.005


def test_moments_refer_to_the_reference_point():
    airframe, record = f16().airframe, clean_record("multisine")
    about_cg = compute_coefficients(record, airframe).coefficients
    about_point = compute_coefficients(record, airframe, reference_m=(0.5, 0.0, 0.0)).coefficients
    # the moment about a point ahead of the centre of gravity: less x CZ, that is, up force behind it lowers the nose
    lengths = reference_lengths(airframe)
    chord, span = float(lengths.mean_chord), float(lengths.span)
    np.testing.assert_allclose(about_point["Cm"], about_cg["Cm"] + 0.5 / chord * about_cg["CZ"], atol=1e-12)
    np.testing.assert_allclose(about_point["Cn"], about_cg["Cn"] - 0.5 / span * about_cg["CY"], atol=1e-12)


def test_velocities_over_ground_in_either_axes_give_the_specific_force():
    body = with_specific_force(flight_record(flight("multisine")))
    dataset = flight("multisine").dataset.drop_vars(["velocity_u_m_s", "velocity_v_m_s", "velocity_w_m_s"])
    ned = with_specific_force(flight_record(dataset.drop_vars("roll_deg")))
    inner = slice(25, -25)
    difference = (body.stack(*SPECIFIC_FORCE) - ned.stack(*SPECIFIC_FORCE))[:, inner]
    assert np.abs(difference).max() < 0.01  # m/s^2; both differentiate a velocity


def test_derivatives_of_the_airframe_are_those_of_its_coefficients():
    airframe = f16().airframe
    history = compute_coefficients(clean_record("doublet"), airframe)
    derivatives = airframe_derivatives(airframe, history.record)
    # the textbook: CY per degree of sideslip is -0.02
    assert derivatives["CY_beta"] == pytest.approx(np.degrees(-0.02), rel=1e-12)
    means = {name: np.mean(values) for name, values in history.arguments.items()}
    at_means = derivatives["Cm0"] + sum(derivatives[f"Cm_{name}"] * mean for name, mean in means.items())
    # the pitching moment is that of steady flight on average
    assert at_means == pytest.approx(np.mean(history.coefficients["Cm"]), abs=2e-4)


def test_missing_channels_are_named():
    record, airframe = clean_record("doublet"), f16().airframe

    def without(*keys):
        channels = {key: values for key, values in record.channels.items() if key not in keys}
        return dataclasses.replace(record, channels=channels)

    velocity = [key for key in record.channels if key.startswith("velocity")]
    for keys, text in {
        ("alpha",): "without alpha_deg",
        ("pitch_rate",): "without pitch_rate_deg_s",
        ("power", "thrust"): "without power_percent and thrust_n",
        ("altitude", "mach"): "without altitude_m",
        (*SPECIFIC_FORCE, *velocity): "without specific_force_x_m_s2",
    }.items():
        with pytest.raises(ValueError, match=text):
            compute_coefficients(without(*keys), airframe)
    with pytest.raises(ValueError, match="airspeed_m_s down to 0"):
        compute_coefficients(record.with_channels(airspeed=0.0 * record["airspeed"]), airframe)
    assert np.isfinite(compute_coefficients(without("beta"), airframe).coefficients["CY"]).all()
