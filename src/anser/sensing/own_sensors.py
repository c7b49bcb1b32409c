"""What an aircraft measures of itself: satellite navigation, inertial sensors, air data; errors only, no receivers."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from anser.numerics.randomness import OWN_SENSORS
from anser.sensing.dropouts import gauss_markov
from anser.sensing.interface import Fix, Instant, Truth, velocity_over_ground_n
from anser.shapes import Quaternion, Scalar, Vector3
from anser.spatial import quaternion_from_euler, quaternion_multiply

_NORMALS = 21  # position 3, white position 3, velocity 3, attitude 3, gyro 3, accelerometer 3, airspeed and vanes 3


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
        Gauss-Markov, m and rad.
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
            position_n=satellite.position_sigma * drawn[0:3],
            attitude_b=inertial.attitude_sigma * drawn[9:12],
            rates_b=inertial.rates_bias * drawn[12:15],
            force_b=inertial.force_bias * drawn[15:18],
            air=jnp.stack([air.airspeed_bias, air.vane_bias, air.vane_bias]) * drawn[18:21],
            fix=Fix(truth.state.position_n, velocity_n, jnp.asarray(False)),
        )

    def read(self, memory: OwnErrors, truth: Truth, instant: Instant) -> tuple[OwnReading, OwnErrors]:
        """Reading of a sample, and the errors after it."""
        drawn, step = instant.normals(OWN_SENSORS, _NORMALS), instant.step
        satellite, inertial, air = self.satellite, self.inertial, self.air_data
        started = instant.number > 0  # what is drawn before the first sample holds for it
        position_n = gauss_markov(
            memory.position_n, satellite.position_sigma, satellite.correlation_time, step, drawn[0:3]
        )
        position_n = jnp.where(started, position_n, memory.position_n)
        attitude_b = gauss_markov(memory.attitude_b, inertial.attitude_sigma, inertial.attitude_time, step, drawn[9:12])
        attitude_b = jnp.where(started, attitude_b, memory.attitude_b)
        state, data = truth.state, truth.now.air_data
        fixed = is_due(instant, satellite.period)
        fix = Fix(
            state.position_n + position_n + satellite.noise_sigma * drawn[3:6],
            velocity_over_ground_n(truth.now, state) + satellite.velocity_sigma * drawn[6:9],
            fixed,
        )
        fix = Fix(
            jnp.where(fixed, fix.position_n, memory.fix.position_n),
            jnp.where(fixed, fix.velocity_n, memory.fix.velocity_n),
            fixed,
        )
        measured = jnp.stack([data.V, data.alpha, data.beta]) + memory.air
        measured = measured + jnp.stack([air.airspeed_noise, air.vane_noise, air.vane_noise]) * drawn[18:21]
        force_b = truth.now.wrench.force_b / truth.airframe.mass_properties.mass
        reading = OwnReading(
            quaternion=tilted(state.quaternion, attitude_b),
            rates_b=state.rates_b + memory.rates_b + inertial.rates_noise * drawn[12:15],
            specific_force_b=force_b + memory.force_b + inertial.force_noise * drawn[15:18],
            velocity_air_b=_through_air_b(*measured),
            fix=fix,
        )
        after = OwnErrors(position_n, attitude_b, memory.rates_b, memory.force_b, memory.air, fix)
        return reading, after


def is_due(instant: Instant, period: Scalar) -> Array:
    """Whether a sample falls on a multiple of a period (s), which is a multiple of the sampling period."""
    every = jnp.maximum(jnp.round(period / instant.step).astype(instant.number.dtype), 1)
    return instant.number % every == 0


def tilted(quaternion: Quaternion, angles_b: Vector3) -> Quaternion:
    """An attitude turned about its body axes by small angles (roll, pitch, yaw; rad)."""
    return quaternion_multiply(quaternion, quaternion_from_euler(*angles_b))


def _through_air_b(V: Scalar, alpha: Scalar, beta: Scalar) -> Vector3:
    """Velocity through the air in body axes of airspeed, angle of attack and sideslip."""
    level = V * jnp.cos(beta)
    return jnp.stack([level * jnp.cos(alpha), V * jnp.sin(beta), level * jnp.sin(alpha)])
