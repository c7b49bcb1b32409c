"""Goal filters: consistency with truth drawn from the filter's models, and agreement with Stone Soup."""

import warnings
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from anser.environment import standard_environment
from anser.parts import GoalReading, Instant
from anser.parts.perception import GOAL_DIVERGED
from anser.sensing import GoalFilter
from anser.sensing.goal_filters import VehicleMotion, predicted_measurement
from anser.sensing.kalman import SigmaPoints, cholesky
from anser.sensing.motion_models import CoordinatedTurn, SteadyMotion

STEP = 1.0
ENVIRONMENT = standard_environment()
SIGMAS = jnp.array([10.0, 3e-3, 3e-3, 1.0, 1.0, 1.0])
MEASURED = jnp.array([True, True, True, False, False, False])
START = jnp.array([4000.0, 3000.0, 0.0, 20.0, -8.0, 0.0])
START_SIGMAS = jnp.array([30.0, 30.0, 3.0, 2.0, 2.0, 0.2])
# so much noise that the filter forgets within a few samples: instants then tell independently of each other
STEADY = SteadyMotion(jnp.asarray(1.0), jnp.asarray(0.3))
STEADY_7 = SteadyMotion(jnp.asarray(0.3), jnp.asarray(0.1), jnp.asarray(1e-5))
TURN = CoordinatedTurn(jnp.asarray(0.3), jnp.asarray(0.1), jnp.asarray(1e-5))


def make_filter(models, kind="ekf", points=None, sojourn=40.0):
    return GoalFilter(
        models=models,
        sojourn=jnp.asarray(sojourn),
        nis_max=jnp.asarray(50.0),
        sigma_max=jnp.asarray(1e5),
        kind=kind,
        **({} if points is None else {"points": points}),
    )


def vehicle_motion_at(number):
    t = number * STEP
    angle = 0.02 * t
    position_n = jnp.stack([3000.0 * jnp.sin(angle), -2000.0 + 3000.0 * jnp.cos(angle), jnp.asarray(-800.0)])
    velocity = jnp.stack([60.0 * jnp.cos(angle), -60.0 * jnp.sin(angle), jnp.asarray(0.0)])
    return VehicleMotion(position_n, velocity)


def instant_at(number):
    return Instant(ENVIRONMENT, number, jnp.asarray(STEP))


class Run(NamedTuple):
    """Results of one run by sample: truth, estimate, covariance, normalised innovation, and measured values."""

    truth: jax.Array
    mean: jax.Array
    covariance: jax.Array
    nis: jax.Array
    values: jax.Array


def simulate(tracker, normals, uniforms, measured_flags=None):
    """Simulate a goal drawn from the filter's models, and track it."""
    models, n = tracker.models, tracker.models[0].size
    mean = jnp.concatenate([START, jnp.zeros(1)])[:n]
    sigmas = jnp.concatenate([START_SIGMAS, jnp.array([0.05])])[:n]
    decay = jnp.exp(-2.0 * STEP / tracker.sojourn)
    stay = 0.5 * (1.0 + decay)

    def step(carry, k):
        state, mode, track = carry
        number = k + 1
        mode = jnp.where(uniforms[k, 0] < stay, mode, 1 - mode) if len(models) > 1 else mode
        moved = jnp.stack([model.predict_state(state, STEP) for model in models])
        roots = jnp.stack([cholesky(model.process_noise(jnp.asarray(STEP))) for model in models])
        state = moved[mode] + jnp.sum(roots[mode] * normals[k, None, :n], axis=1)
        vehicle_motion, instant = vehicle_motion_at(number), instant_at(number)
        empty = GoalReading(jnp.zeros(6), SIGMAS, MEASURED, number, "sight")
        values = predicted_measurement(empty, state[:6], vehicle_motion, instant) + SIGMAS * normals[k, 7:13]
        measured = MEASURED if measured_flags is None else MEASURED & measured_flags[k]
        reading = GoalReading(values, SIGMAS, measured, number, "sight")
        track, estimate = tracker.step(track, reading, vehicle_motion, instant)
        return (state, mode, track), Run(state[:6], estimate.mean, estimate.covariance, estimate.nis, values)

    initial_state = mean + sigmas * normals[-1, :n]
    track = tracker.init(START, START_SIGMAS)
    mode = jnp.where(uniforms[-1, 0] < 0.5, 0, 1) if len(models) > 1 else jnp.asarray(0)
    _, results = jax.lax.scan(step, (initial_state, mode, track), jnp.arange(normals.shape[0] - 1, dtype=jnp.int32))
    return results


def runs(tracker, count, samples=60, seed=1):
    rng = np.random.default_rng(seed)
    normals, uniforms = rng.normal(size=(count, samples + 1, 13)), rng.random((count, samples + 1, 1))
    return jax.jit(jax.vmap(lambda n, u: simulate(tracker, n, u)))(jnp.asarray(normals), jnp.asarray(uniforms))


def normalised_errors(results):
    errors = np.asarray(results.truth - results.mean)
    return np.einsum("rki,rkij,rkj->rk", errors, np.linalg.inv(np.asarray(results.covariance)), errors)


def share_within(values, dimension):
    """Fraction of the samples at which the mean over all runs is within the two-sided 95 % bounds of chi-square."""
    count = values.shape[0]
    low, high = stats.chi2.ppf([0.025, 0.975], dimension * count) / count
    mean = values.mean(axis=0)
    return np.mean((mean >= low) & (mean <= high))


@pytest.mark.parametrize("kind", ["ekf", pytest.param("ukf", marks=pytest.mark.long)])
@pytest.mark.parametrize("count", [200, pytest.param(1000, marks=pytest.mark.long)], ids=["200 runs", "1000 runs"])
def test_the_errors_match_the_covariances_of_the_filter(kind, count):
    results = runs(make_filter((STEADY,), kind), count, samples=200 if count == 1000 else 60)
    # 60 instants: fewer than 48 within the bounds would happen by chance less than once in 10^8
    assert share_within(normalised_errors(results), 6) >= 0.9
    assert share_within(3.0 * np.asarray(results.nis), 3) >= 0.9


@pytest.mark.parametrize("kind", ["ekf", "ukf"])
@pytest.mark.long
def test_the_filter_is_consistent_for_a_turning_goal(kind):
    results = runs(make_filter((TURN,), kind), 1000, samples=200)
    assert share_within(normalised_errors(results), 6) >= 0.9
    assert share_within(3.0 * np.asarray(results.nis), 3) >= 0.9


@pytest.mark.parametrize("kind", ["ekf", "ukf"])
@pytest.mark.long
def test_interacting_models_are_consistent_in_the_mean(kind):
    results = runs(make_filter((STEADY_7, TURN), kind), 1000, samples=200)
    np.testing.assert_allclose(normalised_errors(results).mean(), 6.0, rtol=0.1)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["ekf", "ukf"])
def test_the_error_is_close_to_the_cramer_rao_bound(kind):
    """For a goal without noise the posterior bound is the information of all measurements at the truth."""
    still = SteadyMotion(jnp.asarray(1e-12), jnp.asarray(1e-12))
    results = runs(make_filter((still,), kind), 400)
    information = np.diag(1.0 / np.asarray(START_SIGMAS) ** 2)
    moved = np.eye(6)
    moved[:3, 3:] = STEP * np.eye(3)
    bounds = []
    truth = np.asarray(results.truth)

    def slopes(state, number):
        empty = GoalReading(jnp.zeros(6), SIGMAS, MEASURED, number, "sight")
        return jax.jacfwd(lambda s: predicted_measurement(empty, s, vehicle_motion_at(number), instant_at(number)))(
            state
        )[:3]

    all_slopes = jax.jit(jax.vmap(jax.vmap(slopes, in_axes=(0, 0)), in_axes=(0, None)))(
        results.truth, jnp.arange(1, truth.shape[1] + 1)
    )
    weights = np.diag(1.0 / np.asarray(SIGMAS[:3]) ** 2)
    back = np.linalg.inv(moved)
    for k in range(truth.shape[1]):
        information = back.T @ information @ back
        slopes_k = np.asarray(all_slopes[:, k])
        information = information + np.mean(np.einsum("rji,jk,rkl->ril", slopes_k, weights, slopes_k), axis=0)
        bounds.append(np.trace(np.linalg.inv(information)[:3, :3]))
    errors = np.mean(np.sum(np.asarray(results.truth - results.mean)[:, :, :3] ** 2, axis=2), axis=0)
    ratio = np.sqrt(errors / np.array(bounds))
    assert np.max(ratio[5:]) < 1.1
    assert np.min(ratio) > 0.9  # no filter is better than the bound, but for the scatter of 400 runs


def test_late_and_disordered_measurements_are_as_good_as_those_in_order():
    """The order of arrival does not matter for a goal in steady motion."""
    tracker = eqx.tree_at(
        lambda t: t.models, make_filter((SteadyMotion(jnp.asarray(1e-14), jnp.asarray(1e-14)),)), replace_fn=lambda m: m
    )
    late = GoalFilter(tracker.models, tracker.sojourn, tracker.nis_max, tracker.sigma_max, slots=16)
    rng = np.random.default_rng(4)
    truth = np.asarray(START) + np.asarray(START_SIGMAS) * rng.normal(size=6)
    measured_values = jax.jit(lambda r, s, k: predicted_measurement(r, s, vehicle_motion_at(k), instant_at(k)))
    motion_at = jax.jit(vehicle_motion_at)
    readings = []
    for k in range(1, 11):
        state = jnp.asarray(np.concatenate([truth[:3] + k * STEP * truth[3:], truth[3:]]))
        number = jnp.asarray(k, dtype=jnp.int32)
        empty = GoalReading(jnp.zeros(6), SIGMAS, MEASURED, number, "sight")
        values = measured_values(empty, state, number) + np.asarray(SIGMAS) * rng.normal(size=6)
        readings.append(GoalReading(values, SIGMAS, MEASURED, number, "sight"))

    def fly(filter_, arrivals):
        track = filter_.init(START, START_SIGMAS)
        for sample in range(1, 16):
            number = jnp.asarray(sample, dtype=jnp.int32)
            reading = (
                readings[arrivals[sample]]
                if sample in arrivals
                else eqx.tree_at(lambda r: r.measured, readings[0], jnp.zeros(6, dtype=bool))
            )
            track, estimate = filter_step(filter_, track, reading, motion_at(number), instant_at(number))
        return estimate

    in_order = fly(tracker, {k + 1: k for k in range(10)})
    shuffled = fly(late, dict(zip(range(4, 14), [1, 0, 3, 2, 5, 4, 7, 6, 9, 8], strict=True)))
    sigma = np.sqrt(np.diag(np.asarray(in_order.covariance)))
    np.testing.assert_allclose(shuffled.covariance, in_order.covariance, rtol=2e-2, atol=1e-9)
    assert np.max(np.abs(np.asarray(shuffled.mean - in_order.mean)) / sigma) < 0.05  # of linearisation


filter_step = eqx.filter_jit(lambda tracker, *arguments: tracker.step(*arguments))
turned = jax.jit(lambda state, span: TURN.predict_state(state, span))
turn_slopes = jax.jit(jax.jacfwd(lambda state, span: TURN.predict_state(state, span)))


def test_dropouts_leave_the_prediction():
    tracker = make_filter((STEADY,))
    track = tracker.init(START, START_SIGMAS)
    empty_reading = GoalReading(
        jnp.full(6, 1e9), SIGMAS, jnp.zeros(6, dtype=bool), jnp.asarray(5, dtype=jnp.int32), "sight"
    )
    updated, estimate = filter_step(
        tracker, track, empty_reading, vehicle_motion_at(5), instant_at(jnp.asarray(5, dtype=jnp.int32))
    )
    assert not estimate.is_measured
    assert estimate.status == 1  # never seen
    np.testing.assert_array_equal(updated.means, track.means)
    np.testing.assert_allclose(estimate.mean[:3], START[:3] + 5 * STEP * START[3:], rtol=1e-12)
    np.testing.assert_allclose(
        estimate.covariance,
        STEADY.predict_covariance(START, jnp.diag(START_SIGMAS**2), jnp.asarray(5.0 * STEP)),
        rtol=1e-12,
    )


def test_a_single_outlier_is_no_divergence_and_a_jump_of_the_goal_is():
    """A filter for nearly steady goals, with one measurement 15 sigma off, or all from the tenth on 60 sigma off."""
    exact = SteadyMotion(jnp.asarray(1e-6), jnp.asarray(1e-6))
    tracker = eqx.tree_at(lambda f: f.nis_max, make_filter((exact,)), jnp.asarray(10.0))

    @jax.jit
    def statuses(is_outlier, error_sigmas):
        def step(track, k):
            vehicle_motion, instant = vehicle_motion_at(k), instant_at(k)
            truth = START.at[:3].add(k * STEP * START[3:])
            empty = GoalReading(jnp.zeros(6), SIGMAS, MEASURED, k, "sight")
            values = predicted_measurement(empty, truth, vehicle_motion, instant) + jnp.where(
                is_outlier[k], error_sigmas * SIGMAS, 0.0
            )
            track, estimate = tracker.step(
                track, GoalReading(values, SIGMAS, MEASURED, k, "sight"), vehicle_motion, instant
            )
            return track, estimate.status

        return jax.lax.scan(step, tracker.init(START, START_SIGMAS), jnp.arange(1, 40, dtype=jnp.int32))[1]

    samples = np.arange(40)
    assert not np.any(statuses(samples == 10, 15.0))
    jumped = np.asarray(statuses(samples >= 10, 60.0))
    assert not np.any(jumped[:9])
    assert np.any(jumped[9:20] == GOAL_DIVERGED)


@pytest.mark.long
def test_gradients_are_finite_and_batches_are_single_runs():
    tracker = make_filter((STEADY_7, TURN))
    normals = jnp.asarray(np.random.default_rng(2).normal(size=(3, 5, 13)))
    uniforms = jnp.asarray(np.random.default_rng(3).random((3, 5, 1)))

    def means(n, u):
        mean = simulate(tracker, n, u).mean
        return jnp.sum(mean), mean

    (_, alone), slope = jax.jit(jax.value_and_grad(means, has_aux=True))(normals[1], uniforms[1])
    batch = jax.jit(jax.vmap(lambda n, u: simulate(tracker, n, u)))(normals, uniforms)
    np.testing.assert_allclose(batch.mean[1], alone, rtol=1e-11)
    assert np.all(np.isfinite(slope))


@pytest.mark.parametrize("rate", [0.0, 1e-9, 2e-3, 0.3, -0.3])
def test_turns_are_circles(rate):
    state = jnp.array([10.0, -20.0, 5.0, 12.0, 5.0, -1.0, rate])
    whole = np.asarray(turned(state, 7.0))
    halves = turned(turned(state, 3.5), 3.5)
    np.testing.assert_allclose(whole, halves, rtol=1e-10, atol=1e-9)
    np.testing.assert_allclose(np.sum(whole[3:5] ** 2), 169.0, rtol=1e-12)
    course = np.arctan2(whole[4], whole[3]) - np.arctan2(5.0, 12.0)
    np.testing.assert_allclose(course, 7.0 * rate, atol=1e-9)
    assert np.all(np.isfinite(turn_slopes(state, 7.0)))


class TestStoneSoup:
    """The same measurements through Stone Soup's filters, with the same derivatives, discretisation and points."""

    POINTS = SigmaPoints(0.5, 2.0, 0.0)

    @pytest.mark.parametrize("kind", ["ekf", pytest.param("ukf", marks=pytest.mark.long)])
    def test_states_equal_stone_soup(self, kind):
        tracker = make_filter((STEADY,), kind, self.POINTS)
        normals = jnp.asarray(np.random.default_rng(11).normal(size=(41, 13)))
        measured_flags = jnp.asarray(np.random.default_rng(12).random(40) > 0.2)
        ours = jax.jit(lambda n: simulate(tracker, n, jnp.ones((41, 1)), measured_flags))(normals)
        theirs = self.follow(kind, np.asarray(ours.values), np.asarray(measured_flags))
        scale = np.array([5000.0] * 3 + [10.0] * 3)
        differences = np.abs(np.asarray(ours.mean) - np.array([state for state, _ in theirs])) / scale
        assert np.max(differences) < 1e-9
        spread = np.abs(np.asarray(ours.covariance) - np.array([matrix for _, matrix in theirs]))
        assert np.max(spread / np.outer(scale, scale)) < 1e-9

    def follow(self, kind, values, measured_flags):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import datetime

            from stonesoup.models.measurement.nonlinear import CartesianToElevationBearingRange
            from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
            from stonesoup.predictor.kalman import ExtendedKalmanPredictor, UnscentedKalmanPredictor
            from stonesoup.types.array import CovarianceMatrix, StateVector
            from stonesoup.types.detection import Detection
            from stonesoup.types.hypothesis import SingleHypothesis
            from stonesoup.types.state import GaussianState
            from stonesoup.updater.kalman import ExtendedKalmanUpdater, UnscentedKalmanUpdater

            class SameDerivatives(CartesianToElevationBearingRange):
                """Exact derivatives instead of differences, and angles averaged as numbers."""

                def function(self, state, noise=False, **kwargs):
                    return super().function(state, noise=noise, **kwargs).astype(float)

                def jacobian(self, state, **kwargs):
                    north, east, up = (
                        np.asarray(state.state_vector, dtype=float).ravel()[:3]
                        - np.asarray(self.translation_offset, dtype=float).ravel()
                    )
                    level = np.hypot(north, east)
                    square = level**2 + up**2
                    matrix = np.zeros((3, 6))
                    matrix[0, :3] = -north * up / (square * level), -east * up / (square * level), level / square
                    matrix[1, :2] = -east / level**2, north / level**2
                    matrix[2, :3] = np.array([north, east, up]) / np.sqrt(square)
                    return matrix

            # its axes x, y, z are ours north, east, up; the order of the states is ours: the points depend on it
            flip = np.array([1.0, 1.0, -1.0, 1.0, 1.0, -1.0])
            moved, noise = np.eye(6), np.asarray(STEADY.process_noise(jnp.asarray(STEP)))
            moved[:3, 3:] = STEP * np.eye(3)
            motion = LinearGaussianTimeInvariantTransitionModel(transition_matrix=moved, covariance_matrix=noise)
            points = {"alpha": 0.5, "beta": 2.0, "kappa": 0.0}
            if kind == "ekf":
                predictor, updater = (
                    ExtendedKalmanPredictor(motion),
                    ExtendedKalmanUpdater(force_symmetric_covariance=True),
                )
            else:
                predictor, updater = UnscentedKalmanPredictor(motion, **points), UnscentedKalmanUpdater(**points)
            motion_at = jax.jit(vehicle_motion_at)
            begin = datetime.datetime(2026, 1, 1)
            mean, spread = np.asarray(START) * flip, np.diag(np.asarray(START_SIGMAS) ** 2)
            state = GaussianState(mean[:, None], CovarianceMatrix(spread), begin)
            estimates = []
            for k, measurement in enumerate(values):
                time = begin + datetime.timedelta(seconds=(k + 1) * STEP)
                vehicle_position = np.asarray(motion_at(jnp.asarray(k + 1)).position_n)
                prediction = predictor.predict(state, timestamp=time)
                if measured_flags[k]:
                    model = SameDerivatives(
                        ndim_state=6,
                        mapping=(0, 1, 2),
                        noise_covar=np.diag([9e-6, 9e-6, 100.0]),
                        translation_offset=np.array(
                            [[vehicle_position[0]], [vehicle_position[1]], [-vehicle_position[2]]]
                        ),
                    )
                    from stonesoup.types.angle import Bearing, Elevation

                    vector = StateVector([Elevation(measurement[2]), Bearing(measurement[1]), measurement[0]])
                    detection = Detection(vector, timestamp=time, measurement_model=model)
                    state = updater.update(SingleHypothesis(prediction, detection))
                else:
                    state = prediction
                vector = np.asarray(state.state_vector, dtype=float).ravel() * flip
                matrix = np.asarray(state.covar, dtype=float) * np.outer(flip, flip)
                estimates.append((vector, matrix))
            return estimates
