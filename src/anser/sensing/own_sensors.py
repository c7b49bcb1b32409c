"""What an aircraft measures of itself: satellite navigation, inertial sensors, air data; errors only, no receivers."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from anser.numerics import where_any
from anser.numerics.randomness import OWN_SENSORS, SATELLITES
from anser.sensing.dropouts import gauss_markov
from anser.sensing.interface import Fix, Instant, Truth, velocity_over_ground_n
from anser.shapes import Quaternion, Scalar, Vector3
from anser.spatial import normalize, quaternion_multiply

_NORMALS = 12  # at each sample: attitude 3, gyro 3, accelerometer 3, airspeed and vanes 3
_FIX_NORMALS = 9  # at each fix: slow error 3, position 3, velocity 3


class SatelliteNavigation(eqx.Module):
    """Errors of position and velocity by satellite navigation.

    Attributes
    ----------
    position_sigma
        Standard deviation of the slow error (Gauss-Markov) per axis, NED, m.
    correlation_time
        Of the slow error, s.
    noise_sigma
        Of what is drawn anew at each fix, per axis, NED, m.
    velocity_sigma
        Per axis, NED, drawn anew at each fix, m/s.
    period
        Between two fixes, s; a multiple of the sampling period.
    """

    position_sigma: Vector3
    correlation_time: Scalar
    noise_sigma: Vector3
    velocity_sigma: Vector3
    period: Scalar


class InertialSensors(eqx.Module):
    """Errors of attitude, rates and specific force.

    Attributes
    ----------
    attitude_sigma, attitude_time
        Of the error of the attitude about the body axes (Gauss-Markov), rad, and its correlation time, s.
    rates_bias, rates_noise
        Standard deviations of gyro bias, drawn once, and of noise at each sample, rad/s.
    force_bias, force_noise
        The same of the accelerometers, m/s^2.
    """

    attitude_sigma: Vector3
    attitude_time: Scalar
    rates_bias: Scalar
    rates_noise: Scalar
    force_bias: Scalar
    force_noise: Scalar


class AirDataSensors(eqx.Module):
    """Errors of pitot tube and vanes.

    Attributes
    ----------
    airspeed_bias, airspeed_noise
        Standard deviations of a bias drawn once and of noise at each sample, m/s.
    vane_bias, vane_noise
        The same of the vanes of angle of attack and of sideslip, rad.
    """

    airspeed_bias: Scalar
    airspeed_noise: Scalar
    vane_bias: Scalar
    vane_noise: Scalar


class OwnErrors(eqx.Module):
    """Errors of one aircraft's own sensors between two samples.

    Attributes
    ----------
    position_n, attitude_b
        Gauss-Markov, m (as of the last fix) and rad.
    rates_b, force_b, air
        Biases: rad/s, m/s^2, and (m/s, rad, rad) of airspeed, angle of attack and sideslip.
    fix
        The last.
    """

    position_n: Vector3
    attitude_b: Vector3
    rates_b: Vector3
    force_b: Vector3
    air: Vector3
    fix: Fix


class OwnReading(eqx.Module):
    """What the own sensors give at one sample; see `Reading`."""

    quaternion: Quaternion
    rates_b: Vector3
    specific_force_b: Vector3
    velocity_air_b: Vector3
    fix: Fix


class OwnSensors(eqx.Module):
    """Satellite navigation, inertial sensors and air data of one aircraft."""

    satellite: SatelliteNavigation
    inertial: InertialSensors
    air_data: AirDataSensors

    def init(self, truth: Truth, instant: Instant) -> OwnErrors:
        """Errors before the first sample: stationary, and the biases of this flight."""
        drawn = instant.normals(OWN_SENSORS, _NORMALS, once=True)
        satellite, inertial, air = self.satellite, self.inertial, self.air_data
        velocity_n = velocity_over_ground_n(truth.now, truth.state)
        return OwnErrors(
            position_n=satellite.position_sigma * instant.normals(SATELLITES, _FIX_NORMALS, once=True)[0:3],
            attitude_b=inertial.attitude_sigma * drawn[0:3],
            rates_b=inertial.rates_bias * drawn[3:6],
            force_b=inertial.force_bias * drawn[6:9],
            air=jnp.stack([air.airspeed_bias, air.vane_bias, air.vane_bias]) * drawn[9:12],
            fix=Fix(truth.state.position_n, velocity_n, jnp.asarray(False)),
        )

    def read(self, memory: OwnErrors, truth: Truth, instant: Instant) -> tuple[OwnReading, OwnErrors]:
        """Reading of a sample, and the errors after it."""
        drawn, inertial, air = instant.normals(OWN_SENSORS, _NORMALS), self.inertial, self.air_data
        # what is drawn before the first sample holds for it
        attitude_b = gauss_markov(
            memory.attitude_b, inertial.attitude_sigma, inertial.attitude_time, instant.step, drawn[0:3]
        )
        attitude_b = jnp.where(instant.number > 0, attitude_b, memory.attitude_b)
        due, last = is_due(instant, self.satellite.period), memory.fix
        position_n, fixed_n, fixed_velocity_n = where_any(
            due,
            lambda: self._fixed(memory.position_n, truth, instant),
            (memory.position_n, last.position_n, last.velocity_n),
        )
        fix = Fix(fixed_n, fixed_velocity_n, due)
        state, data = truth.state, truth.now.air_data
        measured = jnp.stack([data.V, data.alpha, data.beta]) + memory.air
        measured = measured + jnp.stack([air.airspeed_noise, air.vane_noise, air.vane_noise]) * drawn[9:12]
        force_b = truth.now.wrench.force_b / truth.airframe.mass_properties.mass
        reading = OwnReading(
            quaternion=tilted(state.quaternion, attitude_b),
            rates_b=state.rates_b + memory.rates_b + inertial.rates_noise * drawn[3:6],
            specific_force_b=force_b + memory.force_b + inertial.force_noise * drawn[6:9],
            velocity_air_b=_through_air_b(*measured),
            fix=fix,
        )
        after = OwnErrors(position_n, attitude_b, memory.rates_b, memory.force_b, memory.air, fix)
        return reading, after

    def _fixed(self, slow_n: Vector3, truth: Truth, instant: Instant) -> tuple[Vector3, Vector3, Vector3]:
        """Slow error, position and velocity of a fix, from the slow error of the last one, a period ago."""
        satellite, drawn = self.satellite, instant.normals(SATELLITES, _FIX_NORMALS)
        moved_n = gauss_markov(
            slow_n, satellite.position_sigma, satellite.correlation_time, satellite.period, drawn[0:3]
        )
        slow_n = jnp.where(instant.number > 0, moved_n, slow_n)
        position_n = truth.state.position_n + slow_n + satellite.noise_sigma * drawn[3:6]
        velocity_n = velocity_over_ground_n(truth.now, truth.state) + satellite.velocity_sigma * drawn[6:9]
        return slow_n, position_n, velocity_n


def is_due(instant: Instant, period: Scalar) -> Array:
    """Whether a sample falls on a multiple of a period (s), which is a multiple of the sampling period."""
    every = jnp.maximum(jnp.round(period / instant.step).astype(instant.number.dtype), 1)
    return instant.number % every == 0


def tilted(quaternion: Quaternion, angles_b: Vector3) -> Quaternion:
    """An attitude turned about its body axes by small angles (roll, pitch, yaw; rad).

    It is a turn by 2 arctan(|angles| / 2) about their vector, within 1e-6 of it up to 0.2 deg and 1e-4 up to 2 deg.
    """
    half_b = 0.5 * angles_b
    return quaternion_multiply(quaternion, normalize(jnp.concatenate([jnp.ones_like(half_b[:1]), half_b])))


def _through_air_b(V: Scalar, alpha: Scalar, beta: Scalar) -> Vector3:
    """Velocity through the air in body axes of airspeed, angle of attack and sideslip."""
    level = V * jnp.cos(beta)
    return jnp.stack([level * jnp.cos(alpha), V * jnp.sin(beta), level * jnp.sin(alpha)])
