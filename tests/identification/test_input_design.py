"""Planned manoeuvres: predicted errors against the scatter of estimates, comparison of inputs, refusals."""

import numpy as np
import pytest

import anser
from anser.identification.dynamic_models import make_manoeuvre
from anser.identification.input_design import plan_manoeuvre
from anser.identification.output_error import estimate_output_error, validate
from support.identification_models import SHORT_PERIOD, SHORT_PERIOD_NAMES

TRUTH = dict(zip(SHORT_PERIOD_NAMES, (-0.6, 0.95, -0.115, -4.3, -1.2, -5.157), strict=True))
NOISE = {"alpha": 0.1, "q": 0.1}
TIME_S = np.arange(301) * 0.02


def plan(signal, **options):
    return plan_manoeuvre(SHORT_PERIOD, TRUTH, TIME_S, {"elevator": signal}, NOISE, **options)


def test_predicted_errors_are_those_of_the_estimates_from_the_flight():
    planned = plan(anser.doublet(2.0))
    inputs, rng, values = anser.doublet(2.0)(TIME_S), np.random.default_rng(0), []
    for _ in range(60):
        measured = planned.outputs + 0.1 * rng.normal(size=planned.outputs.shape)
        manoeuvre = make_manoeuvre(SHORT_PERIOD, TIME_S, inputs, measured)
        estimate = estimate_output_error(SHORT_PERIOD, manoeuvre, TRUTH)
        values.append(estimate.values)
    # the standard error of a scatter over 60 seeds is 9 %
    np.testing.assert_allclose(np.std(values, axis=0) / planned.standard_errors, 1.0, atol=0.3)
    np.testing.assert_allclose(estimate.correlation, planned.correlation, atol=0.35)
    # the plain bound of one flight, with its estimated noise (4 %)
    bounds = np.sqrt(np.diag(estimate.white_covariance))
    np.testing.assert_allclose(bounds / planned.standard_errors, 1.0, atol=0.15)


def test_errors_fall_with_the_amplitude_and_the_root_of_the_number_of_samples():
    single, double = plan(anser.doublet(1.0)), plan(anser.doublet(2.0))
    np.testing.assert_allclose(single.standard_errors, 2.0 * double.standard_errors, rtol=1e-9)
    finer = plan_manoeuvre(
        SHORT_PERIOD, TRUTH, np.arange(1201) * 0.005, {"elevator": anser.doublet(1.0)}, NOISE
    ).standard_errors
    np.testing.assert_allclose(finer, 0.5 * single.standard_errors, rtol=0.02)


def test_the_table_tells_errors_and_ranges_of_the_outputs():
    text = str(plan(anser.three_two_one_one(2.0)))
    assert "planned manoeuvre of 6 s" in text
    assert all(name in text for name in (*SHORT_PERIOD_NAMES, "standard error", "outputs: alpha -"))
    dataset = plan(anser.doublet(2.0)).dataset
    assert float(dataset["standard_error"].sel(parameter="M_q")) == plan(anser.doublet(2.0)).standard_errors[4]


@pytest.mark.parametrize(
    ("inputs", "noise", "message"),
    [
        ({"elevator": anser.doublet(0.0)}, NOISE, "planned manoeuvre: no excitation of Z_alpha"),
        ({"elevator": np.full(301, np.nan)}, NOISE, "inputs: arrived 301 numbers of 301 that are not finite"),
        ({"rudder": anser.doublet(1.0)}, NOISE, r"inputs: arrived \['rudder'\]; expected some of elevator"),
        ({"elevator": np.ones(4)}, NOISE, r"inputs: arrived elevator of shape \(4,\)"),
        ({"elevator": anser.doublet(1.0)}, {"q": 0.1}, "noise: arrived .*expected positive numbers for alpha, q"),
    ],
)
def test_plans_without_information_are_refused(inputs, noise, message):
    with pytest.raises(ValueError, match=message):
        plan_manoeuvre(SHORT_PERIOD, TRUTH, TIME_S, inputs, noise)


def test_feedback_without_excitation_is_refused_as_collinear():
    # elevator = 0.3 alpha + 0.2 q: after the start nothing but the feedback moves the surface
    A = np.array([[-0.6, 0.95], [-4.3, -1.2]]) + np.outer([-0.115, -5.157], [0.3, 0.2])
    eigenvalues, vectors = np.linalg.eig(A)
    amplitudes = np.linalg.solve(vectors, [5.0, 0.0])
    x = np.real((np.exp(np.outer(TIME_S, eigenvalues)) * amplitudes) @ vectors.T)
    with pytest.raises(ValueError, match=r"M_q, M_alpha, M_elevator.* are collinear \(condition number 4\.\d+e\+04\)"):
        plan_manoeuvre(
            *(SHORT_PERIOD, TRUTH, TIME_S, {"elevator": x @ [0.3, 0.2]}, NOISE), initial_state=[5.0, 0.0], held=False
        )
    assert plan(anser.doublet(2.0)).condition_number < 10.0


def test_validation_on_another_manoeuvre():
    rng = np.random.default_rng(1)
    doublet, other = anser.doublet(2.0)(TIME_S), anser.three_two_one_one(1.5, 0.5, 0.5)(TIME_S)
    measured = [plan(u).outputs + 0.1 * rng.normal(size=(301, 2)) for u in (doublet, other)]
    first, second = (
        make_manoeuvre(SHORT_PERIOD, TIME_S, u, y) for u, y in zip((doublet, other), measured, strict=True)
    )
    estimate = estimate_output_error(SHORT_PERIOD, first, TRUTH, initial_states=["alpha"])
    validated = validate(estimate, SHORT_PERIOD, second, initial_states=["alpha"])
    assert np.min(validated.r_squared) > 0.95
    np.testing.assert_allclose(validated.rms, 0.1, rtol=0.15)
    np.testing.assert_array_equal(validated.values, estimate.values)


def test_the_confidence_ellipse_of_two_parameters_has_the_extremes_of_their_joint_interval():
    planned = plan(anser.doublet(2.0))
    manoeuvre = make_manoeuvre(
        *(SHORT_PERIOD, TIME_S, anser.doublet(2.0)(TIME_S)),
        planned.outputs + 0.1 * np.random.default_rng(2).normal(size=(301, 2)),
    )
    estimate = estimate_output_error(SHORT_PERIOD, manoeuvre, TRUTH)
    points = estimate.ellipse("M_alpha", "M_q")
    with pytest.raises(ValueError, match=r"level: arrived 1\.5; expected a probability"):
        estimate.ellipse("M_alpha", "M_q", level=1.5)
    with pytest.raises(ValueError, match=r"ellipse: arrived 'M_u'; expected names among .*M_alpha"):
        estimate.ellipse("M_alpha", "M_u")
    # the projection on an axis is sqrt(2 F) standard errors, F(2, 3 samples / lags) at 95 %: 3.26 at 45 degrees of freedom
    reach = np.max(np.abs(points[:, 0] - estimate["M_alpha"])) / estimate.standard_errors[3]
    assert reach == pytest.approx(np.sqrt(2.0 * 3.26), rel=0.1)
