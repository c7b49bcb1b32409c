"""Manoeuvres of the F-16 for identification, flown once per process in still air, and the noise of its sensors."""

import functools

import numpy as np

import anser
from anser.identification.dynamic_models import make_manoeuvre
from anser.identification.kinematics import with_specific_force
from anser.identification.records import FlightRecord, flight_record

NOISE = {
    "alpha_deg": 0.05,
    "beta_deg": 0.05,
    "airspeed_m_s": 0.1,
    "roll_deg": 0.05,
    "pitch_deg": 0.05,
    "yaw_deg": 0.05,
    "roll_rate_deg_s": 0.05,
    "pitch_rate_deg_s": 0.05,
    "yaw_rate_deg_s": 0.05,
    "specific_force_x_m_s2": 0.02,
    "specific_force_y_m_s2": 0.02,
    "specific_force_z_m_s2": 0.05,
}
"""Standard deviations of white noise of flight-test instruments."""
STEP_S = 0.02


@functools.cache
def f16():
    return anser.aircraft("f16")


@functools.cache
def flight(manoeuvre, speed_m_s=150.0, altitude_m=1000.0):
    """Flight of a manoeuvre by name: elevator doublet or 3-2-1-1, lateral doublets, or multisines on all surfaces."""

    def sines(channel, amplitude):
        return anser.multisine(amplitude, (0.1, 1.5), 20.0, channel=channel, channels=3)

    controls, duration_s = {
        "doublet": ({"elevator": anser.doublet(1.0)}, 10.0),
        "3211": ({"elevator": anser.three_two_one_one(0.7, width_s=0.5)}, 10.0),
        "lateral": ({"aileron": anser.doublet(1.0), "rudder": anser.doublet(2.0, start_s=4.0)}, 10.0),
        "multisine": ({"elevator": sines(0, 0.8), "aileron": sines(1, 1.5), "rudder": sines(2, 1.5)}, 22.0),
    }[manoeuvre]
    trim = f16().trim(speed_m_s=speed_m_s, altitude_m=altitude_m)
    return anser.simulate(f16(), trim, controls, duration_s=duration_s, step_s=0.01, record_period_s=STEP_S)


def clean_record(manoeuvre, **condition) -> FlightRecord:
    return with_specific_force(flight_record(flight(manoeuvre, **condition)))


def noisy_record(manoeuvre, seed=0, **condition) -> FlightRecord:
    return clean_record(manoeuvre, **condition).with_noise(NOISE, seed)


def record_manoeuvre(model, record):
    """Manoeuvre of a record for a model whose names are keys of the catalogue; the initial state is measured."""
    inputs, outputs = (record.stack(*keys).T for keys in (model.inputs, model.outputs))
    start = np.array([record[key][0] for key in model.states])
    return make_manoeuvre(model, record.time_s, inputs, outputs, start, held=False)
