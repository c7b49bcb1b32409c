"""Filters of a goal: consistent on truth drawn from their own models, and equal to Stone Soup's."""

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


def made(models, kind="ekf", points=None, sojourn=40.0):
    return GoalFilter(
        models=models,
        sojourn=jnp.asarray(sojourn),
        nis_max=jnp.asarray(50.0),
        sigma_max=jnp.asarray(1e5),
        kind=kind,
        **({} if points is None else {"points": points}),
    )


def own_at(number):
    t = number * STEP
    angle = 0.02 * t
    place = jnp.stack([3000.0 * jnp.sin(angle), -2000.0 + 3000.0 * jnp.cos(angle), jnp.asarray(-800.0)])
    velocity = jnp.stack([60.0 * jnp.cos(angle), -60.0 * jnp.sin(angle), jnp.asarray(0.0)])
    return VehicleMotion(place, velocity)


def instant_at(number):
    return Instant(ENVIRONMENT, number, jnp.asarray(STEP))


class Run(NamedTuple):
    """Of one run: errors and covariances of the estimate, innovations, and what was measured, by sample."""

    truth: jax.Array
    mean: jax.Array
    covariance: jax.Array
    nis: jax.Array
    values: jax.Array


def simulate(tracker, normals, uniforms, seen=None):
    """Fly one goal drawn from the filter's own models and follow it."""
    models, n = tracker.models, tracker.models[0].size
    begin = jnp.concatenate([START, jnp.zeros(1)])[:n]
    sigmas = jnp.concatenate([START_SIGMAS, jnp.array([0.05])])[:n]
    kept = jnp.exp(-2.0 * STEP / tracker.sojourn)
    stay = 0.5 * (1.0 + kept)

    def step(carry, k):
        state, mode, track = carry
        number = k + 1
        mode = jnp.where(uniforms[k, 0] < stay, mode, 1 - mode) if len(models) > 1 else mode
        moved = jnp.stack([model.predict_state(state, STEP) for model in models])
        roots = jnp.stack([cholesky(model.process_noise(jnp.asarray(STEP))) for model in models])
        state = moved[mode] + jnp.sum(roots[mode] * normals[k, None, :n], axis=1)
        own, instant = own_at(number), instant_at(number)
        empty = GoalReading(jnp.zeros(6), SIGMAS, MEASURED, number, "sight")
        values = predicted_measurement(empty, state[:6], own, instant) + SIGMAS * normals[k, 7:13]
        measured = MEASURED if seen is None else MEASURED & seen[k]
        reading = GoalReading(values, SIGMAS, measured, number, "sight")
        track, found = tracker.step(track, reading, own, instant)
        return (state, mode, track), Run(state[:6], found.mean, found.covariance, found.nis, values)

    first = begin + sigmas * normals[-1, :n]
    track = tracker.init(START, START_SIGMAS)
    mode = jnp.where(uniforms[-1, 0] < 0.5, 0, 1) if len(models) > 1 else jnp.asarray(0)
    _, rows = jax.lax.scan(step, (first, mode, track), jnp.arange(normals.shape[0] - 1, dtype=jnp.int32))
    return rows


def runs(tracker, count, samples=60, seed=1):
    rng = np.random.default_rng(seed)
    normals, uniforms = rng.normal(size=(count, samples + 1, 13)), rng.random((count, samples + 1, 1))
    return jax.jit(jax.vmap(lambda n, u: simulate(tracker, n, u)))(jnp.asarray(normals), jnp.asarray(uniforms))


def nees(rows):
    off = np.asarray(rows.truth - rows.mean)
    return np.einsum("rki,rkij,rkj->rk", off, np.linalg.inv(np.asarray(rows.covariance)), off)


def share_within(values, dimension):
    """Part of the instants at which the mean over all runs lies within the two-sided 95 % bounds of chi-square."""
    count = values.shape[0]
    low, high = stats.chi2.ppf([0.025, 0.975], dimension * count) / count
    mean = values.mean(axis=0)
    return np.mean((mean >= low) & (mean <= high))


@pytest.mark.parametrize("kind", ["ekf", pytest.param("ukf", marks=pytest.mark.long)])
@pytest.mark.parametrize("count", [200, pytest.param(1000, marks=pytest.mark.long)], ids=["200 runs", "1000 runs"])
def test_the_errors_are_as_large_as_the_filter_says(kind, count):
    rows = runs(made((STEADY,), kind), count, samples=200 if count == 1000 else 60)
    # 60 instants: fewer than 48 within the bounds would happen by chance less than once in 10^8
    assert share_within(nees(rows), 6) >= 0.9
    assert share_within(3.0 * np.asarray(rows.nis), 3) >= 0.9


@pytest.mark.parametrize("kind", ["ekf", "ukf"])
@pytest.mark.long
def test_a_turning_goal(kind):
    rows = runs(made((TURN,), kind), 1000, samples=200)
    assert share_within(nees(rows), 6) >= 0.9
    assert share_within(3.0 * np.asarray(rows.nis), 3) >= 0.9


@pytest.mark.parametrize("kind", ["ekf", "ukf"])
@pytest.mark.long
def test_interacting_models_are_consistent_in_the_mean(kind):
    rows = runs(made((STEADY_7, TURN), kind), 1000, samples=200)
    np.testing.assert_allclose(nees(rows).mean(), 6.0, rtol=0.1)


@pytest.mark.parametrize("kind", ["ekf", pytest.param("ukf", marks=pytest.mark.long)])
def test_the_error_is_close_to_the_cramer_rao_bound(kind):
    """Of a goal without noise the posterior bound is the information of all measurements at the truth."""
    still = SteadyMotion(jnp.asarray(1e-12), jnp.asarray(1e-12))
    rows = runs(made((still,), kind), 400)
    information = np.diag(1.0 / np.asarray(START_SIGMAS) ** 2)
    moved = np.eye(6)
    moved[:3, 3:] = STEP * np.eye(3)
    bounds = []
    truth = np.asarray(rows.truth)

    def slopes(state, number):
        empty = GoalReading(jnp.zeros(6), SIGMAS, MEASURED, number, "sight")
        return jax.jacfwd(lambda s: predicted_measurement(empty, s, own_at(number), instant_at(number)))(state)[:3]

    all_slopes = jax.jit(jax.vmap(jax.vmap(slopes, in_axes=(0, 0)), in_axes=(0, None)))(
        rows.truth, jnp.arange(1, truth.shape[1] + 1)
    )
    weights = np.diag(1.0 / np.asarray(SIGMAS[:3]) ** 2)
    back = np.linalg.inv(moved)
    for k in range(truth.shape[1]):
        information = back.T @ information @ back
        rows_k = np.asarray(all_slopes[:, k])
        information = information + np.mean(np.einsum("rji,jk,rkl->ril", rows_k, weights, rows_k), axis=0)
        bounds.append(np.trace(np.linalg.inv(information)[:3, :3]))
    errors = np.mean(np.sum(np.asarray(rows.truth - rows.mean)[:, :, :3] ** 2, axis=2), axis=0)
    ratio = np.sqrt(errors / np.array(bounds))
    assert np.max(ratio[5:]) < 1.1
    assert np.min(ratio) > 0.9  # no filter is better than the bound, but for the scatter of 400 runs


def test_late_and_disordered_measurements_are_as_good_as_those_in_order():
    """Of a goal that moves steadily, whatever the order in which they arrive."""
    tracker = eqx.tree_at(
        lambda t: t.models, made((SteadyMotion(jnp.asarray(1e-14), jnp.asarray(1e-14)),)), replace_fn=lambda m: m
    )
    late = GoalFilter(tracker.models, tracker.sojourn, tracker.nis_max, tracker.sigma_max, slots=16)
    rng = np.random.default_rng(4)
    truth = np.asarray(START) + np.asarray(START_SIGMAS) * rng.normal(size=6)
    readings = []
    for k in range(1, 11):
        state = jnp.asarray(np.concatenate([truth[:3] + k * STEP * truth[3:], truth[3:]]))
        number = jnp.asarray(k, dtype=jnp.int32)
        empty = GoalReading(jnp.zeros(6), SIGMAS, MEASURED, number, "sight")
        values = predicted_measurement(empty, state, own_at(number), instant_at(number)) + SIGMAS * rng.normal(size=6)
        readings.append(GoalReading(values, SIGMAS, MEASURED, number, "sight"))

    def fly(filter_, arrivals):
        track = filter_.init(START, START_SIGMAS)
        for now in range(1, 16):
            number = jnp.asarray(now, dtype=jnp.int32)
            reading = (
                readings[arrivals[now]]
                if now in arrivals
                else eqx.tree_at(lambda r: r.measured, readings[0], jnp.zeros(6, dtype=bool))
            )
            track, found = step(filter_, track, reading, own_at(number), instant_at(number))
        return found

    step = jax.jit(lambda f, *of: f.step(*of))
    in_order = fly(tracker, {k + 1: k for k in range(10)})
    shuffled = fly(late, dict(zip(range(4, 14), [1, 0, 3, 2, 5, 4, 7, 6, 9, 8], strict=True)))
    sigma = np.sqrt(np.diag(np.asarray(in_order.covariance)))
    np.testing.assert_allclose(shuffled.covariance, in_order.covariance, rtol=2e-2, atol=1e-9)
    assert np.max(np.abs(np.asarray(shuffled.mean - in_order.mean)) / sigma) < 0.05  # of linearisation


def test_dropouts_leave_what_is_predicted():
    tracker = made((STEADY,))
    track = tracker.init(START, START_SIGMAS)
    nothing = GoalReading(jnp.full(6, 1e9), SIGMAS, jnp.zeros(6, dtype=bool), jnp.asarray(5, dtype=jnp.int32), "sight")
    after, found = tracker.step(track, nothing, own_at(5), instant_at(jnp.asarray(5, dtype=jnp.int32)))
    assert not found.is_measured
    assert found.status == 1  # never seen
    np.testing.assert_array_equal(after.means, track.means)
    np.testing.assert_allclose(found.mean[:3], START[:3] + 5 * STEP * START[3:], rtol=1e-12)
    np.testing.assert_allclose(
        found.covariance,
        STEADY.predict_covariance(START, jnp.diag(START_SIGMAS**2), jnp.asarray(5.0 * STEP)),
        rtol=1e-12,
    )


def test_one_wild_measurement_is_no_divergence_and_a_goal_that_goes_elsewhere_is():
    """A filter that takes its goal to be all but steady, one measurement 15 sigma off, or all from the tenth on 60."""
    exact = SteadyMotion(jnp.asarray(1e-6), jnp.asarray(1e-6))
    tracker = eqx.tree_at(lambda f: f.nis_max, made((exact,)), jnp.asarray(10.0))

    @jax.jit
    def statuses(wild, off):
        def step(track, k):
            own, instant = own_at(k), instant_at(k)
            truth = START.at[:3].add(k * STEP * START[3:])
            empty = GoalReading(jnp.zeros(6), SIGMAS, MEASURED, k, "sight")
            values = predicted_measurement(empty, truth, own, instant) + jnp.where(wild[k], off * SIGMAS, 0.0)
            track, found = tracker.step(track, GoalReading(values, SIGMAS, MEASURED, k, "sight"), own, instant)
            return track, found.status

        return jax.lax.scan(step, tracker.init(START, START_SIGMAS), jnp.arange(1, 40, dtype=jnp.int32))[1]

    samples = np.arange(40)
    assert not np.any(statuses(samples == 10, 15.0))
    jumped = np.asarray(statuses(samples >= 10, 60.0))
    assert not np.any(jumped[:9])
    assert np.any(jumped[9:20] == GOAL_DIVERGED)


@pytest.mark.long
def test_gradients_are_finite_and_batches_are_single_runs():
    tracker = made((STEADY_7, TURN))
    normals = jnp.asarray(np.random.default_rng(2).normal(size=(3, 5, 13)))
    uniforms = jnp.asarray(np.random.default_rng(3).random((3, 5, 1)))

    def means(n, u):
        found = simulate(tracker, n, u).mean
        return jnp.sum(found), found

    (_, alone), slope = jax.jit(jax.value_and_grad(means, has_aux=True))(normals[1], uniforms[1])
    batch = jax.jit(jax.vmap(lambda n, u: simulate(tracker, n, u)))(normals, uniforms)
    np.testing.assert_allclose(batch.mean[1], alone, rtol=1e-11)
    assert np.all(np.isfinite(slope))


@pytest.mark.parametrize("rate", [0.0, 1e-9, 2e-3, 0.3, -0.3])
def test_turns_are_circles(rate):
    state = jnp.array([10.0, -20.0, 5.0, 12.0, 5.0, -1.0, rate])
    whole = TURN.predict_state(state, jnp.asarray(7.0))
    halves = TURN.predict_state(TURN.predict_state(state, jnp.asarray(3.5)), jnp.asarray(3.5))
    np.testing.assert_allclose(whole, halves, rtol=1e-10, atol=1e-9)
    np.testing.assert_allclose(jnp.sum(whole[3:5] ** 2), 169.0, rtol=1e-12)
    course = jnp.arctan2(whole[4], whole[3]) - jnp.arctan2(state[4], state[3])
    np.testing.assert_allclose(course, 7.0 * rate, atol=1e-9)
    assert np.all(np.isfinite(jax.jacfwd(lambda s: TURN.predict_state(s, jnp.asarray(7.0)))(state)))


class TestStoneSoup:
    """The same measurements through Stone Soup's filters, with the same derivatives, discretisation and points."""

    POINTS = SigmaPoints(0.5, 2.0, 0.0)

    @pytest.mark.parametrize("kind", ["ekf", "ukf"])
    def test_same_states(self, kind):
        tracker = made((STEADY,), kind, self.POINTS)
        normals = jnp.asarray(np.random.default_rng(11).normal(size=(41, 13)))
        seen = jnp.asarray(np.random.default_rng(12).random(40) > 0.2)
        ours = jax.jit(lambda n: simulate(tracker, n, jnp.ones((41, 1)), seen))(normals)
        theirs = self.follow(kind, np.asarray(ours.values), np.asarray(seen))
        scale = np.array([5000.0] * 3 + [10.0] * 3)
        off = np.abs(np.asarray(ours.mean) - np.array([state for state, _ in theirs])) / scale
        assert np.max(off) < 1e-9
        spread = np.abs(np.asarray(ours.covariance) - np.array([matrix for _, matrix in theirs]))
        assert np.max(spread / np.outer(scale, scale)) < 1e-9

    def follow(self, kind, values, seen):
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
                    rows = np.zeros((3, 6))
                    rows[0, :3] = -north * up / (square * level), -east * up / (square * level), level / square
                    rows[1, :2] = -east / level**2, north / level**2
                    rows[2, :3] = np.array([north, east, up]) / np.sqrt(square)
                    return rows

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
            begin = datetime.datetime(2026, 1, 1)
            mean, spread = np.asarray(START) * flip, np.diag(np.asarray(START_SIGMAS) ** 2)
            state = GaussianState(mean[:, None], CovarianceMatrix(spread), begin)
            found = []
            for k, row in enumerate(values):
                time = begin + datetime.timedelta(seconds=(k + 1) * STEP)
                own = np.asarray(own_at(jnp.asarray(k + 1)).position_n)
                prediction = predictor.predict(state, timestamp=time)
                if seen[k]:
                    model = SameDerivatives(
                        ndim_state=6,
                        mapping=(0, 1, 2),
                        noise_covar=np.diag([9e-6, 9e-6, 100.0]),
                        translation_offset=np.array([[own[0]], [own[1]], [-own[2]]]),
                    )
                    from stonesoup.types.angle import Bearing, Elevation

                    vector = StateVector([Elevation(row[2]), Bearing(row[1]), row[0]])
                    detection = Detection(vector, timestamp=time, measurement_model=model)
                    state = updater.update(SingleHypothesis(prediction, detection))
                else:
                    state = prediction
                vector = np.asarray(state.state_vector, dtype=float).ravel() * flip
                matrix = np.asarray(state.covar, dtype=float) * np.outer(flip, flip)
                found.append((vector, matrix))
            return found
