"""Filters that estimate the aircraft's motion, and wind and gusts."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.environment.earth import LocalEarth
from anser.numerics.arrays import select_if_any
from anser.numerics.linear import times3
from anser.parts.perception import Fix
from anser.shapes import Matrix33, Scalar, ScalarLike, Vector3
from anser.spatial.rotations import rotate, rotate_back


class NavigationState(eqx.Module):
    """State of the `NavigationFilter`, NED."""

    position_n: Vector3  # estimated position in the Earth's chart, m
    velocity_n: Vector3  # estimated velocity over the ground, m/s
    error_n: Vector3  # estimated slow error of the satellite fixes, m
    acceleration_n: Vector3  # acceleration at the last sample, m/s^2
    covariance: Float[Array, "3 3 3"]  # covariance of (position, velocity, slow error) per axis, at the last fix

    @property
    def position_covariance(self) -> Matrix33:
        """Covariance of the position at the last fix, NED, m^2; diagonal."""
        return self.covariance[:, 0, 0][:, None] * np.eye(3, dtype=self.covariance.dtype)


class NavigationFilter(eqx.Module):
    """Inertial dead reckoning aided by satellite fixes: a linear Kalman filter of three states per axis (NED).

    The states are position, velocity, and the slow error of satellite navigation (first-order Gauss-Markov). Source:
    P. D. Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems*, 2nd ed., 14.2 and 14.3
    (loosely coupled integration).
    """

    slow_sigma: Vector3  # standard deviation of the slow error, NED, m
    slow_time: Scalar  # correlation time of the slow error, s
    noise_sigma: Vector3  # standard deviation of the white position noise of a fix, NED, m
    velocity_sigma: Vector3  # standard deviation of the white velocity noise of a fix, NED, m/s
    acceleration_density: Scalar  # spectral density of the acceleration errors, m^2/s^3
    period: Scalar  # time between two fixes, s

    def init(self, fix: Fix, acceleration_n: Vector3) -> NavigationState:
        """Return the filter state after the first fix; `acceleration_n` is the measured acceleration, m/s^2."""
        slow, noise = self.slow_sigma**2, self.noise_sigma**2
        speed, zero = self.velocity_sigma**2, jnp.zeros(3)
        blocks = [[slow + noise, zero, -slow], [zero, speed, zero], [-slow, zero, slow]]
        covariance = jnp.stack([jnp.stack(block_row, axis=-1) for block_row in blocks], axis=-2)
        return NavigationState(fix.position_n, fix.velocity_n, zero, acceleration_n, covariance)

    def step(
        self, filter_state: NavigationState, fix: Fix, acceleration_n: Vector3, chart_scale: Vector3, step: ScalarLike
    ) -> NavigationState:
        """Return the state one sampling period `step` (s) later, corrected if `fix` is new.

        `acceleration_n` is the measured acceleration at the new sample, m/s^2; for `chart_scale` see `LocalEarth`.
        """
        velocity_change_n = 0.5 * step * (filter_state.acceleration_n + acceleration_n)
        velocity_n = filter_state.velocity_n + velocity_change_n
        position_n = filter_state.position_n + chart_scale * step * (filter_state.velocity_n + 0.5 * velocity_change_n)
        predicted = NavigationState(
            position_n, velocity_n, filter_state.error_n, acceleration_n, filter_state.covariance
        )

        return select_if_any(fix.is_new, lambda: self._correct(predicted, fix), predicted)

    def _correct(self, filter_state: NavigationState, fix: Fix) -> NavigationState:
        def axis(state: Vector3, covariance: Matrix33, fixed: Float[Array, "2"], sigmas: Vector3) -> Any:
            """Return mean and covariance of one axis after a fix.

            `fixed` is position and velocity of the fix; `sigmas` are the deviations of slow error, position, velocity.
            """
            decay, span = jnp.exp(-self.period / self.slow_time), self.period
            error_variance, position_variance, velocity_variance = sigmas**2
            zero = jnp.zeros_like(span)
            density, error_noise = self.acceleration_density, -jnp.expm1(-2 * span / self.slow_time) * error_variance
            cross_noise = density * span**2 / 2
            process_noise = jnp.stack(
                [density * span**3 / 3, cross_noise, zero, cross_noise, density * span, zero, zero, zero, error_noise]
            )
            process_noise = process_noise.reshape(3, 3)
            mean = jnp.stack([state[0], state[1], decay * state[2]])
            covariance = _apply_transition(_apply_transition(covariance, span, decay).T, span, decay) + process_noise
            # measured position = position + slow error + noise, then velocity
            mean, covariance = _update_scalar(
                mean, covariance, jnp.array([1.0, 0.0, 1.0], mean.dtype), fixed[0], position_variance
            )
            return _update_scalar(mean, covariance, jnp.array([0.0, 1.0, 0.0], mean.dtype), fixed[1], velocity_variance)

        fixed = jnp.stack([fix.position_n, fix.velocity_n], axis=1)
        sigmas = jnp.stack([self.slow_sigma, self.noise_sigma, self.velocity_sigma], axis=1)
        states = jnp.stack([filter_state.position_n, filter_state.velocity_n, filter_state.error_n], axis=1)
        mean, covariance = jax.vmap(axis)(states, filter_state.covariance, fixed, sigmas)
        return NavigationState(mean[:, 0], mean[:, 1], mean[:, 2], filter_state.acceleration_n, covariance)


def _update_scalar(
    mean: Vector3, covariance: Matrix33, observation: Vector3, value: Scalar, variance: Scalar
) -> tuple[Vector3, Matrix33]:
    """Return mean and covariance after the measurement `value` = `observation` . state + error (Joseph form).

    `variance` is the variance of the error.
    """
    cross_covariance = times3(covariance, observation)
    innovation_variance = jnp.sum(cross_covariance * observation) + variance
    # zero variance: measurement and state are both exact and equal
    gain = cross_covariance / jnp.where(innovation_variance > 0.0, innovation_variance, 1.0)
    covariance = (
        covariance
        - gain[:, None] * cross_covariance[None, :]
        - cross_covariance[:, None] * gain[None, :]
        + innovation_variance * gain[:, None] * gain[None, :]
    )
    return mean + gain * (value - jnp.sum(mean * observation)), covariance


def _apply_transition(matrix: Matrix33, span: ScalarLike, decay: ScalarLike) -> Matrix33:
    """Return F @ `matrix`; F is the transition matrix of (position, velocity, slow error) over `span` seconds."""
    return jnp.stack([matrix[0] + span * matrix[1], matrix[1], decay * matrix[2]])


def acceleration_n(R_bn: Matrix33, specific_force_b: Vector3, earth: LocalEarth) -> Vector3:
    """Return the rate of the velocity over the ground (NED, m/s^2) from the specific force (body axes, m/s^2)."""
    return rotate_back(R_bn, specific_force_b) + earth.apparent_gravity_n


class AirMotion(eqx.Module):
    """Estimated motion of the air: mean wind (NED, m/s) and gust (body axes, m/s)."""

    wind_n: Vector3
    gust_b: Vector3


class AirFilter(eqx.Module):
    """Filter of mean wind and gusts from the difference between ground velocity and air velocity.

    The mean wind is the difference after a slow low-pass filter. The gust is the remaining difference after a fast
    low-pass filter, without the component along the air velocity.
    """

    wind_time: Scalar  #: Time constant of the mean wind, s.
    gust_time: Scalar  #: Time constant of the gusts, s.

    def init(self, wind_n: Vector3) -> AirMotion:
        """Return the initial state: the forecast mean wind (NED, m/s) and no gust."""
        return AirMotion(wind_n, jnp.zeros(3))

    def step(
        self,
        filter_state: AirMotion,  # state before the period
        R_bn: Matrix33,  # rotation NED to body
        velocity_n: Vector3,  # velocity over the ground, NED, m/s
        velocity_air_b: Vector3,  # measured velocity through the air, body axes, m/s
        step: ScalarLike,  # sampling period, s
    ) -> AirMotion:
        """Return the estimated mean wind and gust one sampling period later."""
        difference_b = rotate(R_bn, velocity_n - filter_state.wind_n) - velocity_air_b
        wind_n = filter_state.wind_n - jnp.expm1(-step / self.wind_time) * rotate_back(R_bn, difference_b)
        square = jnp.maximum(jnp.sum(velocity_air_b**2), 1.0)
        # without longitudinal gusts, which would disturb the throttle
        across_b = difference_b - (jnp.sum(difference_b * velocity_air_b) / square) * velocity_air_b
        gust_b = filter_state.gust_b - jnp.expm1(-step / self.gust_time) * (across_b - filter_state.gust_b)
        return AirMotion(wind_n, gust_b)
