"""Sensors of the aircraft's own motion.

Errors of satellite navigation, inertial sensors and air data, and the dropout and error processes that all sensors
share.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.numerics.arrays import select_if_any
from anser.numerics.randomness import SATELLITES, VEHICLE_SENSORS
from anser.parts.perception import Fix, Instant, Truth, velocity_over_ground_n
from anser.shapes import Flag, Quaternion, Scalar, ScalarLike, Vector3
from anser.spatial.rotations import normalize, quaternion_multiply

_SHORTEST_S = 1e-9


class Dropouts(eqx.Module):
    """When measurements fail: each by itself, and all of them during outages that come and go (Gilbert-Elliott).

    The chain of Gilbert (Bell System Technical Journal 39, 1960) and Elliott (42, 1963) in continuous time: outages
    last, and stay away, for exponentially distributed times.

    Attributes
    ----------
    probability
        With which a measurement is lost by itself, 0..1.
    outage_share
        Part of the time that is spent in outages, 0..1.
    outage_mean
        Mean duration of an outage, s.
    """

    probability: Scalar
    outage_share: Scalar
    outage_mean: Scalar

    def initial_outage(self, uniform: ScalarLike) -> Flag:
        """Whether an outage is on at the start, from a number between 0 and 1."""
        return jnp.asarray(uniform) < self.outage_share

    def next_outage(self, outage: Flag, elapsed: ScalarLike, uniform: ScalarLike) -> Flag:
        """Whether one is on some time (s) later: the exact transition of the chain."""
        # share = mean_bad / (mean_bad + mean_good): the chain forgets with the sum of both rates
        mean = jnp.maximum(self.outage_mean, _SHORTEST_S)
        good_share = jnp.maximum(1.0 - self.outage_share, 1e-12)
        kept = jnp.exp(-jnp.asarray(elapsed) / (mean * good_share))
        probability = self.outage_share + jnp.where(outage, 1.0 - self.outage_share, -self.outage_share) * kept
        return jnp.asarray(uniform) < probability

    def is_lost(self, outage: Flag, uniform: ScalarLike) -> Flag:
        """Whether a measurement is lost."""
        return outage | (jnp.asarray(uniform) < self.probability)


def gauss_markov(
    error: Float[Array, "..."], sigma: ScalarLike, time_constant: ScalarLike, elapsed: ScalarLike, normals: Array
) -> Float[Array, "..."]:
    """A first-order Gauss-Markov error some time (s) later, from standard normals of its shape: exact, stationary.

    `sigma` is its standard deviation, `time_constant` (s) that of its exponential autocorrelation.
    """
    kept = jnp.exp(-jnp.asarray(elapsed) / time_constant)
    fresh = jnp.sqrt(-jnp.expm1(-2.0 * jnp.asarray(elapsed) / time_constant))
    return kept * error + sigma * fresh * normals


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


class VehicleSensorErrors(eqx.Module):
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


class VehicleReading(eqx.Module):
    """What the own sensors give at one sample; see `Reading`."""

    quaternion: Quaternion
    rates_b: Vector3
    specific_force_b: Vector3
    velocity_air_b: Vector3
    fix: Fix


class VehicleSensors(eqx.Module):
    """Satellite navigation, inertial sensors and air data of one aircraft."""

    satellite: SatelliteNavigation
    inertial: InertialSensors
    air_data: AirDataSensors

    def init(self, truth: Truth, instant: Instant) -> VehicleSensorErrors:
        """Errors before the first sample: stationary, and the biases of this flight."""
        drawn = instant.normals(VEHICLE_SENSORS, _NORMALS, once=True)
        satellite, inertial, air = self.satellite, self.inertial, self.air_data
        velocity_n = velocity_over_ground_n(truth.condition, truth.state)
        return VehicleSensorErrors(
            position_n=satellite.position_sigma * instant.normals(SATELLITES, _FIX_NORMALS, once=True)[0:3],
            attitude_b=inertial.attitude_sigma * drawn[0:3],
            rates_b=inertial.rates_bias * drawn[3:6],
            force_b=inertial.force_bias * drawn[6:9],
            air=jnp.stack([air.airspeed_bias, air.vane_bias, air.vane_bias]) * drawn[9:12],
            fix=Fix(truth.state.position_n, velocity_n, jnp.asarray(False)),
        )

    def read(
        self, sensor_state: VehicleSensorErrors, truth: Truth, instant: Instant
    ) -> tuple[VehicleReading, VehicleSensorErrors]:
        """Reading of a sample, and the errors after it."""
        drawn, inertial, air = instant.normals(VEHICLE_SENSORS, _NORMALS), self.inertial, self.air_data
        # what is drawn before the first sample holds for it
        attitude_b = gauss_markov(
            sensor_state.attitude_b, inertial.attitude_sigma, inertial.attitude_time, instant.step, drawn[0:3]
        )
        attitude_b = jnp.where(instant.number > 0, attitude_b, sensor_state.attitude_b)
        due, last = is_due(instant, self.satellite.period), sensor_state.fix
        position_n, fixed_n, fixed_velocity_n = select_if_any(
            due,
            lambda: self._fixed(sensor_state.position_n, truth, instant),
            (sensor_state.position_n, last.position_n, last.velocity_n),
        )
        fix = Fix(fixed_n, fixed_velocity_n, due)
        state, data = truth.state, truth.condition.air_data
        measured = jnp.stack([data.V, data.alpha, data.beta]) + sensor_state.air
        measured = measured + jnp.stack([air.airspeed_noise, air.vane_noise, air.vane_noise]) * drawn[9:12]
        force_b = truth.condition.wrench.force_b / truth.airframe.mass_properties.mass
        reading = VehicleReading(
            quaternion=tilt_attitude(state.quaternion, attitude_b),
            rates_b=state.rates_b + sensor_state.rates_b + inertial.rates_noise * drawn[3:6],
            specific_force_b=force_b + sensor_state.force_b + inertial.force_noise * drawn[6:9],
            velocity_air_b=_through_air_b(*measured),
            fix=fix,
        )
        after = VehicleSensorErrors(
            position_n, attitude_b, sensor_state.rates_b, sensor_state.force_b, sensor_state.air, fix
        )
        return reading, after

    def _fixed(self, slow_n: Vector3, truth: Truth, instant: Instant) -> tuple[Vector3, Vector3, Vector3]:
        """Slow error, position and velocity of a fix, from the slow error of the last one, a period ago."""
        satellite, drawn = self.satellite, instant.normals(SATELLITES, _FIX_NORMALS)
        moved_n = gauss_markov(
            slow_n, satellite.position_sigma, satellite.correlation_time, satellite.period, drawn[0:3]
        )
        slow_n = jnp.where(instant.number > 0, moved_n, slow_n)
        position_n = truth.state.position_n + slow_n + satellite.noise_sigma * drawn[3:6]
        velocity_n = velocity_over_ground_n(truth.condition, truth.state) + satellite.velocity_sigma * drawn[6:9]
        return slow_n, position_n, velocity_n


def is_due(instant: Instant, period: Scalar) -> Array:
    """Whether a sample falls on a multiple of a period (s), which is a multiple of the sampling period."""
    every = jnp.maximum(jnp.round(period / instant.step).astype(instant.number.dtype), 1)
    return instant.number % every == 0


def tilt_attitude(quaternion: Quaternion, angles_b: Vector3) -> Quaternion:
    """An attitude turned about its body axes by small angles (roll, pitch, yaw; rad).

    It is a turn by 2 arctan(|angles| / 2) about their vector, within 1e-6 of it up to 0.2 deg and 1e-4 up to 2 deg.
    """
    half_b = 0.5 * angles_b
    return quaternion_multiply(quaternion, normalize(jnp.concatenate([jnp.ones_like(half_b[:1]), half_b])))


def _through_air_b(V: Scalar, alpha: Scalar, beta: Scalar) -> Vector3:
    """Velocity through the air in body axes of airspeed, angle of attack and sideslip."""
    level = V * jnp.cos(beta)
    return jnp.stack([level * jnp.cos(alpha), V * jnp.sin(beta), level * jnp.sin(alpha)])
