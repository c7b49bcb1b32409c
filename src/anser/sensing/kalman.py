"""Kalman updates by a nonlinear measurement: extended, with a derivative, and unscented, with sigma points."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from anser.shapes import Count, Scalar

_LOG_2PI = float(np.log(2.0 * np.pi))


class Measurement(NamedTuple):
    """Independent measurements of a state.

    Attributes
    ----------
    off
        Innovation of what is expected of a state: from a state (n,) to measured minus expected (m,), angles the short
        way round.
    variances
        Of their errors.
    measured
        Which there are.
    """

    innovation: Callable[[Float[Array, " n"]], Float[Array, " m"]]
    variances: Float[Array, " m"]
    measured: Bool[Array, " m"]


class KalmanUpdate(NamedTuple):
    """Mean and covariance after measurements, the normalised innovation squared, the logarithm of the likelihood."""

    mean: Float[Array, " n"]
    covariance: Float[Array, "n n"]
    nis: Scalar
    log_likelihood: Scalar


def extended_update(
    mean: Float[Array, " n"], covariance: Float[Array, "n n"], measurement: Measurement
) -> KalmanUpdate:
    """Extended Kalman filter's update: one independent measurement after the other, the same as all at once.

    The derivatives are those at the predicted mean for all. The covariance is in the form of Joseph, multiplied out.
    """
    off, slopes = measurement.innovation(mean), -jax.jacfwd(measurement.innovation)(mean)
    begin, zero = mean, jnp.zeros_like(off[0])
    nis, log_likelihood = zero, zero
    for k in range(off.shape[0]):
        row, on = slopes[k], measurement.measured[k]
        across = jnp.sum(covariance * row[None, :], axis=1)
        spread = jnp.sum(row * across) + measurement.variances[k]
        # without any spread the measurement and the state are both exact, and agree
        safe = jnp.where(on & (spread > 0.0), spread, 1.0)
        left = off[k] - jnp.sum(row * (mean - begin))
        gain = jnp.where(on, across / safe, 0.0)
        mean = mean + gain * left
        covariance = (
            covariance
            - gain[:, None] * across[None, :]
            - across[:, None] * gain[None, :]
            + safe * gain[:, None] * gain[None, :]
        )
        nis = nis + jnp.where(on, left**2 / safe, 0.0)
        log_likelihood = log_likelihood - 0.5 * jnp.where(on, left**2 / safe + jnp.log(safe) + _LOG_2PI, 0.0)
    return KalmanUpdate(mean, covariance, nis, log_likelihood)


class SigmaPoints(NamedTuple):
    """Numbers of the scaled unscented transform: E. A. Wan, R. van der Merwe, Proc. AS-SPCC 2000."""

    alpha: float = 0.5
    beta: float = 2.0
    kappa: float = 0.0

    def weights(self, count: int) -> tuple[float, np.ndarray, np.ndarray]:
        """Scale of the points' distance squared, and weights for means and covariances, of so many states."""
        scale = self.alpha**2 * (count + self.kappa)
        mean = np.full(2 * count + 1, 0.5 / scale)
        mean[0] = 1.0 - count / scale
        covariance = mean.copy()
        covariance[0] += 1.0 - self.alpha**2 + self.beta
        return scale, mean, covariance

    def generate(self, mean: Float[Array, " n"], covariance: Float[Array, "n n"]) -> Float[Array, "points n"]:
        """The points: the mean, then along each column of the covariance's root, then against them."""
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
    """Mean and covariance of what a function makes of a state, with noise added."""
    of_mean, of_covariance = (one.astype(mean.dtype) for one in points.weights(mean.shape[0])[1:])
    images = jax.vmap(moved)(points.generate(mean, covariance))
    after = jnp.sum(of_mean[:, None] * images, axis=0)
    apart = images - after[None]
    return after, jnp.sum(of_covariance[:, None, None] * apart[:, :, None] * apart[:, None, :], axis=0) + noise


def unscented_update(
    mean: Float[Array, " n"], covariance: Float[Array, "n n"], measurement: Measurement, points: SigmaPoints
) -> KalmanUpdate:
    """Unscented Kalman filter's update by all measurements at once."""
    of_mean, of_covariance = (one.astype(mean.dtype) for one in points.weights(mean.shape[0])[1:])
    around = points.generate(mean, covariance)
    offs, on = jax.vmap(measurement.innovation)(around), measurement.measured
    offs = jnp.where(on[None], offs, 0.0)
    off = jnp.sum(of_mean[:, None] * offs, axis=0)
    expected_apart, apart = off[None] - offs, around - mean[None]
    spread = jnp.sum(of_covariance[:, None, None] * expected_apart[:, :, None] * expected_apart[:, None, :], axis=0)
    spread = spread + jnp.where(on, measurement.variances, 1.0)[:, None] * np.eye(off.shape[0], dtype=off.dtype)
    both = jnp.sum(of_covariance[:, None, None] * apart[:, :, None] * expected_apart[:, None, :], axis=0)
    root = cholesky(spread)
    whitened, across = _forward(root, off[:, None])[:, 0], _forward(root, both.T)
    # K S K^T of the gain K = (cross covariance) S^-1
    covariance = covariance - jnp.sum(across[:, :, None] * across[:, None, :], axis=0)
    mean = mean + jnp.sum(across * whitened[:, None], axis=0)
    nis = jnp.sum(whitened**2)
    pivots = jnp.stack([root[k, k] for k in range(off.shape[0])])
    logs = jnp.where(on, 2.0 * jnp.log(pivots) + _LOG_2PI, 0.0)
    return KalmanUpdate(mean, covariance, nis, -0.5 * (nis + jnp.sum(logs)))


def cholesky(matrix: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """Lower root of a small positive definite matrix, column by column, without a library; zero pivots stay zero."""
    count = matrix.shape[0]
    places = jnp.arange(count)

    def column(k: Count, root: Float[Array, "n n"]) -> Float[Array, "n n"]:
        left = matrix[:, k] - jnp.sum(root * root[k][None, :], axis=1)
        pivot = jnp.maximum(left[k], 0.0)
        safe = jnp.where(pivot > 0.0, pivot, 1.0)
        own = jnp.where((places >= k) & (pivot > 0.0), left / jnp.sqrt(safe), 0.0)
        return jnp.where(places[None, :] == k, own[:, None], root)

    return jax.lax.fori_loop(0, count, column, jnp.zeros_like(matrix))


def _forward(root: Float[Array, "m m"], rows: Float[Array, "m k"]) -> Float[Array, "m k"]:
    """Solution X of L X = B for a lower L."""
    places = jnp.arange(rows.shape[0])

    def row(k: Count, found: Float[Array, "m k"]) -> Float[Array, "m k"]:
        left = rows[k] - jnp.sum(root[k][:, None] * found, axis=0)
        return jnp.where(places[:, None] == k, (left / root[k, k])[None], found)

    return jax.lax.fori_loop(0, rows.shape[0], row, jnp.zeros_like(rows))
