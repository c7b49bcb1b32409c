"""Delays between channels and wrong units, found by the kinematics of flight."""

import dataclasses

import numpy as np
import pytest

from anser.identification.alignment import align_record, match_channel
from anser.identification.kinematics import RATES, SPECIFIC_FORCE, with_specific_force
from anser.units import DEG_RAD, KNOT_M_S
from support.manoeuvres import clean_record, noisy_record


def shifted(record, **delays):
    """Record whose channels lag by the given delays, s."""
    time = record.time_s
    return record.with_channels(**{k: np.interp(time - delay, time, record[k]) for k, delay in delays.items()})


def test_a_known_delay_and_factor_are_recovered():
    time = np.arange(0.0, 20.0, 0.02)
    rng = np.random.default_rng(0)
    integral = np.sin(1.5 * time) + 0.4 * np.sin(4.0 * time)
    delays = []
    for _ in range(50):
        noise = 0.02 * rng.standard_normal(time.size)
        lagged = np.sin(1.5 * (time - 0.07)) + 0.4 * np.sin(4.0 * (time - 0.07))
        match = match_channel(2.0 * lagged + 3.0 + 0.1 * time + noise, integral, 0.02)
        delays.append((match.delay_s, match.delay_error_s))
        assert match.factor == pytest.approx(0.5, rel=0.01)
    delay, error = np.array(delays).T
    # the parabola through samples 0.02 s apart is biased by less than a hundredth of a sample
    assert np.mean(delay) == pytest.approx(0.07, abs=2e-4 + 3.0 * np.std(delay) / np.sqrt(50.0))
    assert np.mean(error) == pytest.approx(np.std(delay), rel=0.3)  # 50 draws: 10 % standard error


@pytest.mark.parametrize("manoeuvre", ["doublet", "3211", "lateral", "multisine"])
def test_aligned_records_are_left_alone(manoeuvre):
    assert align_record(clean_record(manoeuvre)).notes == clean_record(manoeuvre).notes
    for seed in range(5):
        noisy = noisy_record(manoeuvre, seed)
        assert align_record(noisy).notes == noisy.notes


def test_accelerometers_away_from_the_centre_of_gravity_are_no_delay():
    """4 m ahead: without their position, alpha and beta seem to lead by some 4 m / 150 m/s."""
    record, ahead = clean_record("multisine"), (4.0, 0.0, 0.0)
    rates = record.stack(*RATES)
    turning = np.gradient(rates, record.step_s, axis=1, edge_order=2)
    arm = np.array(ahead)[:, None]
    added = np.cross(turning, arm, axis=0) + np.cross(rates, np.cross(rates, arm, axis=0), axis=0)
    force = with_specific_force(record).stack(*SPECIFIC_FORCE) + added
    displaced = record.with_channels(**dict(zip(SPECIFIC_FORCE, force, strict=True)))
    assert align_record(displaced).notes != displaced.notes
    assert align_record(displaced, accelerometer_m=ahead).notes == displaced.notes


@pytest.mark.parametrize("seed", range(3))
def test_delays_of_flow_angles_attitude_and_surfaces_are_removed(seed):
    delays = {"alpha": 0.06, "pitch": -0.04, "elevator": 0.05, "aileron": -0.07, "beta": 0.1}
    record = noisy_record("multisine", seed)
    aligned = align_record(shifted(record, **delays))
    notes = aligned.notes[len(record.notes) :]
    measured = {note.split()[0].removesuffix("_deg"): note.split() for note in notes}
    assert set(measured) == set(delays)
    for key, delay in delays.items():
        _, sense, _, amount, *_ = measured[key]
        assert sense == ("lags" if delay > 0.0 else "leads")
        # the smoothed angular acceleration locates a surface within a quarter of a sample, kinematics a flow angle too
        assert float(amount) == pytest.approx(abs(delay), abs=0.005)
    clean = clean_record("multisine")
    alpha = np.interp(aligned.time_s, clean.time_s, clean["alpha"])
    # noise of 0.05 deg, and linear interpolation
    assert np.std(aligned["alpha"] - alpha) < 0.055 * DEG_RAD


@pytest.mark.parametrize(
    ("channel", "factor", "text"),
    [
        ("alpha", DEG_RAD, "alpha_deg with values that kinematics multiplies by 5.*radians that are declared as deg"),
        ("pitch", 1.0 / DEG_RAD, "pitch_deg .*degrees that are declared as radians"),
        ("beta", -1.0, "beta_deg .*the opposite sign"),
        ("airspeed", 0.3048, "altitude_m or airspeed_m_s .*m/s that are declared as ft/s"),
        ("airspeed", 3.6, "altitude_m or airspeed_m_s .*: km/h that are declared as m/s"),
        ("airspeed", 1.0 / KNOT_M_S, "altitude_m or airspeed_m_s .*: knots that are declared as m/s"),
        ("airspeed", KNOT_M_S, "altitude_m or airspeed_m_s .*: m/s that are declared as knots"),
    ],
)
def test_wrong_units_and_signs_are_refused(channel, factor, text):
    record = noisy_record("multisine")
    with pytest.raises(ValueError, match=text):
        align_record(record.with_channels(**{channel: record[channel] * factor}))


@pytest.mark.parametrize(
    ("factor", "text"),
    [(1.0 / 3.6, r"0\.279: km/h that are declared as m/s"), (1.94, r"1\.95: m/s that are declared as knots")],
)
def test_a_wrong_unit_of_the_airspeed_is_named_without_an_altitude(factor, text):
    record = noisy_record("multisine")
    channels = {key: values for key, values in record.channels.items() if key != "altitude"}
    channels["airspeed"] = record["airspeed"] / factor
    with pytest.raises(ValueError, match=f"arrived airspeed_m_s with values that kinematics multiplies by {text}"):
        align_record(dataclasses.replace(record, channels=channels))


def test_a_delay_beyond_the_search_is_refused():
    with pytest.raises(ValueError, match=r"alpha_deg with a delay of 0\.2 s or more"):
        align_record(shifted(noisy_record("doublet"), alpha=0.24), delay_max_s=0.2)
