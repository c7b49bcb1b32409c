"""Kalman updates for nonlinear measurements: extended (with the derivative) and unscented (with sigma points)."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from anser.shapes import Integer, Scalar

_LOG_2PI = float(np.log(2.0 * np.pi))


class Measurement(NamedTuple):
    """Simultaneous measurement of m components with independent errors, the input of a Kalman update."""

    # function of a state (n,): measured minus expected values (m,), angles wrapped to -pi..pi
    innovation: Callable[[Float[Array, " n"]], Float[Array, " m"]]
    variances: Float[Array, " m"]  # variances of the errors
    measured: Bool[Array, " m"]  # whether each component is measured; other components have no effect


class KalmanUpdate(NamedTuple):
    """Result of a Kalman update."""

    mean: Float[Array, " n"]
    covariance: Float[Array, "n n"]
    nis: Scalar  # normalised innovation squared, not divided by the number of components
    log_likelihood: Scalar  # log likelihood of the measurement


def extended_update(
    mean: Float[Array, " n"], covariance: Float[Array, "n n"], measurement: Measurement
) -> KalmanUpdate:
    """Return the extended Kalman update of the predicted mean and covariance, in Joseph form."""
    # Component by component: the result is the simultaneous update, for all derivatives are at the predicted mean.
    innovations, slopes = measurement.innovation(mean), -jax.jacfwd(measurement.innovation)(mean)
    predicted_mean, zero = mean, jnp.zeros_like(innovations[0])
    nis, log_likelihood = zero, zero
    for k in range(innovations.shape[0]):
        slope, is_measured = slopes[k], measurement.measured[k]
        cross_covariance = jnp.sum(covariance * slope[None, :], axis=1)
        innovation_variance = jnp.sum(slope * cross_covariance) + measurement.variances[k]
        # zero variance: measurement and state are both exact and equal
        safe_variance = jnp.where(is_measured & (innovation_variance > 0.0), innovation_variance, 1.0)
        remaining_innovation = innovations[k] - jnp.sum(slope * (mean - predicted_mean))
        gain = jnp.where(is_measured, cross_covariance / safe_variance, 0.0)
        mean = mean + gain * remaining_innovation
        covariance = (
            covariance
            - gain[:, None] * cross_covariance[None, :]
            - cross_covariance[:, None] * gain[None, :]
            + safe_variance * gain[:, None] * gain[None, :]
        )
        nis = nis + jnp.where(is_measured, remaining_innovation**2 / safe_variance, 0.0)
        log_likelihood = log_likelihood - 0.5 * jnp.where(
            is_measured, remaining_innovation**2 / safe_variance + jnp.log(safe_variance) + _LOG_2PI, 0.0
        )
    return KalmanUpdate(mean, covariance, nis, log_likelihood)


class SigmaPoints(NamedTuple):
    """Parameters alpha, beta and kappa of the scaled unscented transform (Wan, van der Merwe, Proc. AS-SPCC 2000)."""

    alpha: float = 0.5
    beta: float = 2.0
    kappa: float = 0.0

    def weights(self, count: int) -> tuple[float, np.ndarray, np.ndarray]:
        """Return scale, weights for the mean, and weights for the covariance; `count` is the number of states n.

        The sigma points are the mean, and the mean plus and minus each column of the Cholesky root of scale *
        covariance. The weights have shape (2 n + 1,); index 0 belongs to the mean.
        """
        scale = self.alpha**2 * (count + self.kappa)
        mean_weights = np.full(2 * count + 1, 0.5 / scale)
        mean_weights[0] = 1.0 - count / scale
        covariance_weights = mean_weights.copy()
        covariance_weights[0] += 1.0 - self.alpha**2 + self.beta
        return scale, mean_weights, covariance_weights

    def generate(self, mean: Float[Array, " n"], covariance: Float[Array, "n n"]) -> Float[Array, "points n"]:
        """Return the sigma points: the mean, then mean plus and mean minus the columns of the covariance root."""
        count = mean.shape[0]
        root = cholesky(self.weights(count)[0] * covariance)
        return jnp.concatenate([mean[None], mean[None] + root.T, mean[None] - root.T])


def unscented_prediction(
    moved: Callable[[Float[Array, " n"]], Float[Array, " n"]],
    mean: Float[Array, " n"],
    covariance: Float[Array, "n n"],
    noise: Float[Array, "n n"],
    points: SigmaPoints,
) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
    """Return predicted mean and covariance of a state by the unscented transform.

    `moved` maps a state to the later state; `noise` is the covariance of the process noise.
    """
    mean_weights, covariance_weights = (weights.astype(mean.dtype) for weights in points.weights(mean.shape[0])[1:])
    images = jax.vmap(moved)(points.generate(mean, covariance))
    predicted_mean = jnp.sum(mean_weights[:, None] * images, axis=0)
    deviations = images - predicted_mean[None]
    return predicted_mean, jnp.sum(
        covariance_weights[:, None, None] * deviations[:, :, None] * deviations[:, None, :], axis=0
    ) + noise


def unscented_update(
    mean: Float[Array, " n"], covariance: Float[Array, "n n"], measurement: Measurement, points: SigmaPoints
) -> KalmanUpdate:
    """Return the unscented Kalman update of the predicted mean and covariance by all measured components together."""
    mean_weights, covariance_weights = (weights.astype(mean.dtype) for weights in points.weights(mean.shape[0])[1:])
    sigma_points = points.generate(mean, covariance)
    innovations, measured = jax.vmap(measurement.innovation)(sigma_points), measurement.measured
    innovations = jnp.where(measured[None], innovations, 0.0)
    mean_innovation = jnp.sum(mean_weights[:, None] * innovations, axis=0)
    measurement_deviations, state_deviations = mean_innovation[None] - innovations, sigma_points - mean[None]
    innovation_covariance = jnp.sum(
        covariance_weights[:, None, None] * measurement_deviations[:, :, None] * measurement_deviations[:, None, :],
        axis=0,
    )
    innovation_covariance = innovation_covariance + jnp.where(measured, measurement.variances, 1.0)[:, None] * np.eye(
        mean_innovation.shape[0], dtype=mean_innovation.dtype
    )
    cross_covariance = jnp.sum(
        covariance_weights[:, None, None] * state_deviations[:, :, None] * measurement_deviations[:, None, :], axis=0
    )
    root = cholesky(innovation_covariance)
    whitened = _solve_lower(root, mean_innovation[:, None])[:, 0]
    whitened_cross_covariance = _solve_lower(root, cross_covariance.T)
    # K S K^T of the gain K = (cross covariance) S^-1
    covariance = covariance - jnp.sum(
        whitened_cross_covariance[:, :, None] * whitened_cross_covariance[:, None, :], axis=0
    )
    mean = mean + jnp.sum(whitened_cross_covariance * whitened[:, None], axis=0)
    nis = jnp.sum(whitened**2)
    pivots = jnp.stack([root[k, k] for k in range(mean_innovation.shape[0])])
    logs = jnp.where(measured, 2.0 * jnp.log(pivots) + _LOG_2PI, 0.0)
    return KalmanUpdate(mean, covariance, nis, -0.5 * (nis + jnp.sum(logs)))


def cholesky(matrix: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """Return the lower Cholesky factor of a small positive semidefinite matrix. A zero pivot gives a zero column."""
    count = matrix.shape[0]
    indices = jnp.arange(count)

    def column(k: Integer, root: Float[Array, "n n"]) -> Float[Array, "n n"]:
        reduced_column = matrix[:, k] - jnp.sum(root * root[k][None, :], axis=1)
        pivot = jnp.maximum(reduced_column[k], 0.0)
        safe = jnp.where(pivot > 0.0, pivot, 1.0)
        new_column = jnp.where((indices >= k) & (pivot > 0.0), reduced_column / jnp.sqrt(safe), 0.0)
        return jnp.where(indices[None, :] == k, new_column[:, None], root)

    return jax.lax.fori_loop(0, count, column, jnp.zeros_like(matrix))


def _solve_lower(root: Float[Array, "m m"], right_hand_side: Float[Array, "m k"]) -> Float[Array, "m k"]:
    """Return the solution X of `root` X = `right_hand_side`; `root` must be lower triangular."""
    indices = jnp.arange(right_hand_side.shape[0])

    def row(k: Integer, solution: Float[Array, "m k"]) -> Float[Array, "m k"]:
        reduced_row = right_hand_side[k] - jnp.sum(root[k][:, None] * solution, axis=0)
        return jnp.where(indices[:, None] == k, (reduced_row / root[k, k])[None], solution)

    return jax.lax.fori_loop(0, right_hand_side.shape[0], row, jnp.zeros_like(right_hand_side))
