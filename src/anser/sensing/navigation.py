"""Own navigation: a Kalman filter of satellite fixes and inertial measurements, and a filter of the air's motion."""

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

_FIRST_SPEED_SIGMA = 1.0  # m/s, per axis, before the first fix


class NavigationState(eqx.Module):
    """What the navigation filter carries along.

    Attributes
    ----------
    position_n, velocity_n
        NED, m in the Earth's chart and m/s over the ground.
    error_n
        Slow error of the satellite fixes, as far as it can be told, m.
    acceleration_n
        Of the last sample, m/s^2.
    covariance
        Of (position, velocity, slow error) in each axis; as of the last fix.
    """

    position_n: Vector3
    velocity_n: Vector3
    error_n: Vector3
    acceleration_n: Vector3
    covariance: Float[Array, "3 3 3"]

    @property
    def position_covariance(self) -> Matrix33:
        """Of the position, NED, m^2."""
        return self.covariance[:, 0, 0][:, None] * np.eye(3, dtype=self.covariance.dtype)


class NavigationFilter(eqx.Module):
    """Satellite navigation aids inertial dead reckoning, axis by axis (NED): a linear Kalman filter of three states.

    Between fixes position and velocity follow the accelerometers and the attitude; each fix corrects them. The slow
    error of satellite navigation is a state of its own (first-order Gauss-Markov), which a fix hardly tells from the
    position: so the covariance of the position does not fall below it. Source: P. D. Groves, *Principles of GNSS,
    Inertial, and Multisensor Integrated Navigation Systems*, 2nd ed., 14.2 and 14.3 (loosely coupled integration).

    Attributes
    ----------
    slow_sigma, slow_time
        Standard deviation (NED, m) and correlation time (s) of the slow error.
    noise_sigma, velocity_sigma
        Of what each fix has anew: NED, m and m/s.
    acceleration_density
        Spectral density of the errors of the acceleration, m^2/s^3.
    period
        Between two fixes, s.
    """

    slow_sigma: Vector3
    slow_time: Scalar
    noise_sigma: Vector3
    velocity_sigma: Vector3
    acceleration_density: Scalar
    period: Scalar

    def init(self, fix: Fix, acceleration_n: Vector3) -> NavigationState:
        """After the first fix."""
        slow, noise = self.slow_sigma**2, self.noise_sigma**2
        speed, zero = self.velocity_sigma**2, jnp.zeros(3)
        rows = [[slow + noise, zero, -slow], [zero, speed, zero], [-slow, zero, slow]]
        covariance = jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)
        return NavigationState(fix.position_n, fix.velocity_n, zero, acceleration_n, covariance)

    def step(
        self, filter_state: NavigationState, fix: Fix, acceleration_n: Vector3, chart_scale: Vector3, step: ScalarLike
    ) -> NavigationState:
        """One sampling period (s) further, with the acceleration (NED, m/s^2) and the fix at its end."""
        gained_n = 0.5 * step * (filter_state.acceleration_n + acceleration_n)
        velocity_n = filter_state.velocity_n + gained_n
        position_n = filter_state.position_n + chart_scale * step * (filter_state.velocity_n + 0.5 * gained_n)
        ahead = NavigationState(position_n, velocity_n, filter_state.error_n, acceleration_n, filter_state.covariance)

        return select_if_any(fix.is_new, lambda: self._corrected(ahead, fix), ahead)

    def _corrected(self, filter_state: NavigationState, fix: Fix) -> NavigationState:
        def axis(state: Vector3, covariance: Matrix33, fixed: Float[Array, "2"], own: Vector3) -> Any:
            """One axis: `fixed` is the fix's position and velocity, `own` the three standard deviations."""
            kept, span = jnp.exp(-self.period / self.slow_time), self.period
            slow, noise, rate = own**2
            zero = jnp.zeros_like(span)
            density, fresh = self.acceleration_density, -jnp.expm1(-2 * span / self.slow_time) * slow
            both = density * span**2 / 2
            added = jnp.stack([density * span**3 / 3, both, zero, both, density * span, zero, zero, zero, fresh])
            added = added.reshape(3, 3)
            mean = jnp.stack([state[0], state[1], kept * state[2]])
            covariance = _moved(_moved(covariance, span, kept).T, span, kept) + added
            # position with the slow error, then velocity
            mean, covariance = _measured(mean, covariance, jnp.array([1.0, 0.0, 1.0], mean.dtype), fixed[0], noise)
            return _measured(mean, covariance, jnp.array([0.0, 1.0, 0.0], mean.dtype), fixed[1], rate)

        fixed = jnp.stack([fix.position_n, fix.velocity_n], axis=1)
        sigmas = jnp.stack([self.slow_sigma, self.noise_sigma, self.velocity_sigma], axis=1)
        states = jnp.stack([filter_state.position_n, filter_state.velocity_n, filter_state.error_n], axis=1)
        mean, covariance = jax.vmap(axis)(states, filter_state.covariance, fixed, sigmas)
        return NavigationState(mean[:, 0], mean[:, 1], mean[:, 2], filter_state.acceleration_n, covariance)


def _measured(
    mean: Vector3, covariance: Matrix33, row: Vector3, value: Scalar, variance: Scalar
) -> tuple[Vector3, Matrix33]:
    """A scalar measurement, `value` = `row` . state + error; in the form of Joseph, multiplied out."""
    across = times3(covariance, row)
    spread = jnp.sum(across * row) + variance
    # without any spread the measurement and the state are both exact, and agree
    gain = across / jnp.where(spread > 0.0, spread, 1.0)
    covariance = (
        covariance
        - gain[:, None] * across[None, :]
        - across[:, None] * gain[None, :]
        + spread * gain[:, None] * gain[None, :]
    )
    return mean + gain * (value - jnp.sum(mean * row)), covariance


def _moved(matrix: Matrix33, span: ScalarLike, kept: ScalarLike) -> Matrix33:
    """Rows of a matrix by the transition: position and velocity over a time (s), and what is kept of the slow error."""
    return jnp.stack([matrix[0] + span * matrix[1], matrix[1], kept * matrix[2]])


def acceleration_n(R_bn: Matrix33, specific_force_b: Vector3, earth: LocalEarth) -> Vector3:
    """Rate of the velocity over the ground in the local NED axes, from what accelerometers measure, m/s^2."""
    return rotate_back(R_bn, specific_force_b) + earth.apparent_gravity_n


class AirMotion(eqx.Module):
    """What an aircraft takes the air's motion to be: mean wind (NED, m/s) and gust (body axes, m/s)."""

    wind_n: Vector3
    gust_b: Vector3


class AirFilter(eqx.Module):
    """Mean wind and gusts from the difference of the velocities over the ground and through the air.

    Both are low-passed: the mean wind slowly; the gust quickly, and across the flight alone: it changes the angles of
    attack and sideslip that the autopilot reckons with. The airspeed that it flies by is that through the mean wind, as
    inertially smoothed airspeed indication has it; a gust along the flight would drive the throttle.

    Attributes
    ----------
    wind_time, gust_time
        Time constants, s.
    """

    wind_time: Scalar
    gust_time: Scalar

    def init(self, wind_n: Vector3) -> AirMotion:
        """The mean wind as it was forecast at the start."""
        return AirMotion(wind_n, jnp.zeros(3))

    def step(
        self,
        filter_state: AirMotion,
        R_bn: Matrix33,
        velocity_n: Vector3,
        velocity_air_b: Vector3,
        step: ScalarLike,
    ) -> AirMotion:
        """After one more sampling period (s).

        Parameters
        ----------
        filter_state
            Before it.
        R_bn
            Rotation NED to body.
        velocity_n
            Over the ground, NED, m/s.
        velocity_air_b
            Through the air as measured, body axes, m/s.
        step
            s.
        """
        off_b = rotate(R_bn, velocity_n - filter_state.wind_n) - velocity_air_b
        wind_n = filter_state.wind_n - jnp.expm1(-step / self.wind_time) * rotate_back(R_bn, off_b)
        square = jnp.maximum(jnp.sum(velocity_air_b**2), 1.0)
        across_b = off_b - (jnp.sum(off_b * velocity_air_b) / square) * velocity_air_b
        gust_b = filter_state.gust_b - jnp.expm1(-step / self.gust_time) * (across_b - filter_state.gust_b)
        return AirMotion(wind_n, gust_b)
