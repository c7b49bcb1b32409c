"""Goals in a coordinated turn: the same measurements through filterpy's filters, with a model written out in NumPy."""

import copy

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter

from anser.environment import standard_environment
from anser.parts import GoalReading, Instant
from anser.sensing import GoalFilter
from anser.sensing.goal_filters import VehicleMotion
from anser.sensing.kalman import SigmaPoints
from anser.sensing.motion_models import CoordinatedTurn

STEP, SAMPLES = 1.0, 60
SIGMAS = np.array([10.0, 3e-3, 3e-3])
START = np.array([-4000.0, 150.0, 0.0, 15.0, -12.0, 0.0])
START_SIGMAS = np.array([30.0, 30.0, 3.0, 2.0, 2.0, 0.2])
TURN_RATE_SIGMA = 0.05
DENSITY, DENSITY_UP, TURN_DENSITY = 0.3, 0.1, 1e-4
OWN_VELOCITY = np.array([20.0, 30.0, 0.0])
POINTS = {"alpha": 0.5, "beta": 2.0, "kappa": 0.0}


def own_position(number):
    return np.array([0.0, -900.0, -800.0]) + number * STEP * OWN_VELOCITY


def turned(x, span):
    """Position, velocity and turn rate after a time."""
    angle, rate = x[6] * span, x[6]
    if rate == 0.0:
        return np.array([*(x[:3] + span * x[3:6]), *x[3:]])
    s, c = np.sin(angle), np.cos(angle)
    return np.array(
        [
            x[0] + (s * x[3] - (1 - c) * x[4]) / rate,
            x[1] + ((1 - c) * x[3] + s * x[4]) / rate,
            x[2] + span * x[5],
            c * x[3] - s * x[4],
            s * x[3] + c * x[4],
            x[5],
            rate,
        ]
    )


def turn_slopes(x, span):
    """Derivative of `turned`: Bar-Shalom, Li, Kirubarajan, 2001, 11.7.2; with the limit for a turn rate of 0."""
    rate, (north, east) = x[6], x[3:5]
    angle = rate * span
    s, c = np.sin(angle), np.cos(angle)
    along, aside = (s / rate, (1 - c) / rate) if rate else (span, 0.0)
    F = np.eye(7)
    F[0, 3:5], F[1, 3:5], F[2, 5] = (along, -aside), (aside, along), span
    F[3, 3:5], F[4, 3:5] = (c, -s), (s, c)
    if rate:
        d_along, d_aside = (span * c - along) / rate, (span * s - aside) / rate
    else:
        d_along, d_aside = 0.0, 0.5 * span**2
    F[0, 6], F[1, 6] = d_along * north - d_aside * east, d_aside * north + d_along * east
    F[3, 6], F[4, 6] = -span * (s * north + c * east), span * (c * north - s * east)
    return F


def noise(span):
    block = np.array([[span**3 / 3, span**2 / 2], [span**2 / 2, span]])
    Q = np.zeros((7, 7))
    Q[:6, :6] = np.kron(block, np.diag([DENSITY, DENSITY, DENSITY_UP]))
    Q[6, 6] = TURN_DENSITY * span
    return Q


def sight(x, vehicle_position, azimuth_reference=0.0):
    """Range, azimuth and elevation from an aircraft; the azimuth is within pi of a reference azimuth."""
    north, east, down = x[:3] - vehicle_position
    azimuth = np.arctan2(east, north)
    azimuth -= 2 * np.pi * np.round((azimuth - azimuth_reference) / (2 * np.pi))
    return np.array([np.sqrt(north**2 + east**2 + down**2), azimuth, np.arctan2(-down, np.hypot(north, east))])


def sight_slopes(x, vehicle_position):
    north, east, down = x[:3] - vehicle_position
    level, distance = np.hypot(north, east), np.sqrt(north**2 + east**2 + down**2)
    H = np.zeros((3, 7))
    H[0, :3] = np.array([north, east, down]) / distance
    H[1, :2] = -east / level**2, north / level**2
    H[2, :3] = np.array([north * down / level, east * down / level, -level]) / distance**2
    return H


class TurningExtended(ExtendedKalmanFilter):
    """The extended filter of filterpy with the coordinated turn as motion model."""

    def predict_x(self, u=0):
        self.x = turned(self.x, self.span)


def filterpy_estimates(kind, values, measured_flags):
    start, spread = np.append(START, 0.0), np.diag(np.append(START_SIGMAS, TURN_RATE_SIGMA) ** 2)
    if kind == "ekf":
        tracker = TurningExtended(dim_x=7, dim_z=3)
    else:
        points = MerweScaledSigmaPoints(7, **POINTS)
        tracker = UnscentedKalmanFilter(7, 3, STEP, hx=sight, fx=turned, points=points)
    tracker.x, tracker.P, tracker.R = start, spread, np.diag(SIGMAS**2)
    latest, estimates = 0, []
    for k, measurement in enumerate(values, start=1):
        span = (k - latest) * STEP
        predicted = copy.deepcopy(tracker)
        if kind == "ekf":
            predicted.span, predicted.F, predicted.Q = span, turn_slopes(predicted.x, span), noise(span)
            predicted.predict()
        else:
            predicted.Q = noise(span)
            predicted.predict(dt=span)
        if measured_flags[k - 1]:
            vehicle_position = own_position(k)
            if kind == "ekf":
                predicted.update(
                    measurement,
                    sight_slopes,
                    sight,
                    args=(vehicle_position,),
                    hx_args=(vehicle_position, measurement[1]),
                )
            else:
                predicted.update(measurement, vehicle_position=vehicle_position, azimuth_reference=measurement[1])
            tracker, latest = predicted, k
        estimates.append((predicted.x[:6].copy(), predicted.P[:6, :6].copy()))
    return np.array([mean for mean, _ in estimates]), np.array([matrix for _, matrix in estimates])


def measurements():
    """Measurements of a goal with a left and a right turn, behind the aircraft: the azimuth passes 180 deg."""
    rng = np.random.default_rng(41)
    x, sights = np.append(START + START_SIGMAS * rng.normal(size=6), 0.06), []
    for k in range(1, SAMPLES + 1):
        x[6] = 0.06 if k < 35 else -0.08
        x = turned(x, STEP)
        sights.append(sight(x, own_position(k)) + SIGMAS * rng.normal(size=3))
    values = np.array(sights)
    values[:, 1] -= 2 * np.pi * np.round(values[:, 1] / (2 * np.pi))
    return values, rng.random(SAMPLES) > 0.2


def anser_estimates(kind, values, measured_flags):
    tracker = GoalFilter(
        models=(CoordinatedTurn(jnp.asarray(DENSITY), jnp.asarray(DENSITY_UP), jnp.asarray(TURN_DENSITY)),),
        sojourn=jnp.asarray(40.0),
        nis_max=jnp.asarray(50.0),
        sigma_max=jnp.asarray(1e5),
        kind=kind,
        points=SigmaPoints(**POINTS),
    )
    environment, unmeasured = standard_environment(), jnp.zeros(3)

    def step(track, sample):
        number, measurement, measured, vehicle_position = sample
        flags = jnp.concatenate([jnp.full(3, measured), jnp.zeros(3, bool)])
        reading = GoalReading(
            jnp.concatenate([measurement, unmeasured]),
            jnp.concatenate([jnp.asarray(SIGMAS), jnp.ones(3)]),
            flags,
            number,
            "sight",
        )
        instant = Instant(environment, number, jnp.asarray(STEP))
        track, estimate = tracker.step(
            track, reading, VehicleMotion(vehicle_position, jnp.asarray(OWN_VELOCITY)), instant
        )
        return track, (estimate.mean, estimate.covariance)

    numbers = np.arange(1, SAMPLES + 1, dtype=np.int32)
    samples = (numbers, values, measured_flags, np.array([own_position(k) for k in numbers]))
    track = tracker.init(jnp.asarray(START), jnp.asarray(START_SIGMAS))
    return jax.jit(lambda t, s: jax.lax.scan(step, t, s))(track, jax.tree.map(jnp.asarray, samples))[1]


@pytest.mark.parametrize("kind", ["ekf", pytest.param("ukf", marks=pytest.mark.long)])
def test_estimates_of_a_turning_goal_equal_filterpy_s(kind):
    values, measured_flags = measurements()
    assert np.ptp(values[:, 1]) > 6.0
    expected, expected_covariance = filterpy_estimates(kind, values, measured_flags)
    means, covariances = (np.asarray(array) for array in anser_estimates(kind, values, measured_flags))
    sigmas = np.sqrt(np.diagonal(expected_covariance, axis1=1, axis2=2))
    # rounding, measured: 3e-12 and 4e-11
    assert np.max(np.abs(means - expected) / sigmas) < 1e-9
    assert np.max(np.abs(covariances - expected_covariance) / (sigmas[:, :, None] * sigmas[:, None, :])) < 1e-9
