"""Data compatibility: known errors of sensors recovered within their intervals, and what a record does not tell."""

import dataclasses

import numpy as np
import pytest

import anser
from anser.identification.compatibility import check_compatibility
from support.manoeuvres import clean_record, noisy_record

TRUTH = {
    "bias(pitch_rate)": 0.005,
    "bias(specific_force_x)": -0.05,
    "bias(specific_force_z)": 0.15,
    "scale(alpha)": 0.08,
    "scale(beta)": -0.05,
}


def with_errors(record):
    """Record as sensors with the errors of `TRUTH` would have measured it."""
    channels = {}
    for name, value in TRUTH.items():
        kind, key = name.removesuffix(")").split("(")
        channels[key] = record[key] * (1.0 + value) if kind == "scale" else record[key] + value
    return record.with_channels(**channels)


def test_errors_of_sensors_are_recovered_and_removed():
    result = check_compatibility(with_errors(noisy_record("multisine")))
    estimate = result.estimate
    for name, value, error in zip(estimate.names, estimate.values, estimate.standard_errors, strict=True):
        if "(0)" not in name:
            # 3.5 standard errors: 1 of 2,000 normal errors, 8 parameters
            assert abs(value - TRUTH.get(name, 0.0)) < 3.5 * error, name
            assert error < 0.01, name
    clean = clean_record("multisine")
    # 0.05 deg of noise, and the scale factor to 0.3 per cent of 3 deg
    assert np.std(result.record["alpha"] - clean["alpha"]) < np.radians(0.06)
    assert np.mean(result.record["pitch_rate"] - clean["pitch_rate"]) == pytest.approx(0.0, abs=2e-4)


@pytest.mark.long
def test_intervals_hold_the_noise_of_the_inertial_sensors_that_adds_up_in_the_motion():
    errors, sigma = [], []
    for seed in range(20):
        estimate = check_compatibility(with_errors(noisy_record("multisine", seed))).estimate
        kept = [k for k, name in enumerate(estimate.names) if "(0)" not in name]
        errors.append([estimate.values[k] - TRUTH.get(estimate.names[k], 0.0) for k in kept])
        sigma.append(estimate.standard_errors[kept])
    # 160 numbers: without that noise in the covariance half of them were outside
    assert 0.90 <= np.mean(np.abs(errors) < 1.96 * np.array(sigma)) <= 0.99
    np.testing.assert_allclose(np.median(sigma, axis=0) / np.std(errors, axis=0, ddof=1), 1.0, atol=0.45)


@pytest.mark.long
def test_a_correct_record_has_no_errors_and_derivatives_need_the_correction():
    names = ("bias(pitch_rate)", "scale(alpha)")
    result = check_compatibility(noisy_record("multisine", 9), names)
    assert result.estimate["scale(alpha)"] == pytest.approx(0.0, abs=0.015)
    assert "Errors of sensors are removed" in result.record.notes[-1]
    wrong = with_errors(noisy_record("multisine"))
    slope = anser.identify(clean_record("multisine"))["CL_alpha"]
    corrected = anser.identify(check_compatibility(wrong).record)["CL_alpha"]
    assert corrected == pytest.approx(slope, rel=0.02)
    assert abs(anser.identify(wrong)["CL_alpha"] / slope - 1.0) > 0.05


@pytest.mark.long
def test_the_kinematic_filter_agrees_with_the_regression():
    estimate = check_compatibility(with_errors(noisy_record("multisine")), method="filter-error").estimate
    for name, (low, high) in zip(estimate.names, estimate.interval(0.99), strict=True):
        if name in TRUTH:
            assert low < TRUTH[name] < high, name


def test_refusals():
    record = noisy_record("multisine")
    channels = {key: values for key, values in record.channels.items() if not key.startswith("specific")}
    with pytest.raises(ValueError, match="without specific_force_x_m_s2"):
        check_compatibility(dataclasses.replace(record, channels=channels))
    with pytest.raises(ValueError, match=r"errors: arrived \['bias\(AOA\)'\]"):
        check_compatibility(record, ["bias(AOA)"])
    with pytest.raises(ValueError, match=r"yaw.* are collinear"):  # no kinematics knows the north
        check_compatibility(record, ["bias(yaw)"])
