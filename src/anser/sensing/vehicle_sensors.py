"""Sensors with errors that measure the aircraft's motion; models of correlated errors and dropouts."""

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
    """Losses of measurements: single random losses, and outages with random start and duration (Gilbert-Elliott).

    The durations of outages, and of the intervals between outages, are exponentially distributed. Sources: Gilbert,
    Bell System Technical Journal 39, 1960; Elliott, the same journal 42, 1963.
    """

    probability: Scalar  # probability of a single loss, 0..1
    outage_share: Scalar  # fraction of the time in outages, 0..1
    outage_mean: Scalar  # mean duration of an outage, s

    def initial_outage(self, uniform: ScalarLike) -> Flag:
        """Whether the sensor is in an outage at the start; `uniform` is a random number in 0..1."""
        return jnp.asarray(uniform) < self.outage_share

    def next_outage(self, outage: Flag, elapsed: ScalarLike, uniform: ScalarLike) -> Flag:
        """Whether the sensor is in an outage `elapsed` seconds later; `outage` is the present flag.

        `uniform` is a random number in 0..1.
        """
        # share = mean_bad / (mean_bad + mean_good): the chain's memory decays with the sum of both rates
        mean = jnp.maximum(self.outage_mean, _SHORTEST_S)
        good_share = jnp.maximum(1.0 - self.outage_share, 1e-12)
        memory = jnp.exp(-jnp.asarray(elapsed) / (mean * good_share))
        probability = self.outage_share + jnp.where(outage, 1.0 - self.outage_share, -self.outage_share) * memory
        return jnp.asarray(uniform) < probability

    def is_lost(self, outage: Flag, uniform: ScalarLike) -> Flag:
        """Whether a measurement is lost; `outage` is true in an outage, `uniform` is a random number in 0..1."""
        return outage | (jnp.asarray(uniform) < self.probability)


def gauss_markov(
    error: Float[Array, "..."], sigma: ScalarLike, time_constant: ScalarLike, elapsed: ScalarLike, normals: Array
) -> Float[Array, "..."]:
    """Return a first-order Gauss-Markov error `elapsed` seconds later, driven by standard normal numbers `normals`.

    `sigma` is the standard deviation, in the unit of the error; `time_constant` is the correlation time, s.
    """
    decay = jnp.exp(-jnp.asarray(elapsed) / time_constant)
    noise_scale = jnp.sqrt(-jnp.expm1(-2.0 * jnp.asarray(elapsed) / time_constant))
    return decay * error + sigma * noise_scale * normals


_NORMALS = 12  # at each sample: attitude 3, gyro 3, accelerometer 3, airspeed and vanes 3
_FIX_NORMALS = 9  # at each fix: slow error 3, position 3, velocity 3


class SatelliteNavigation(eqx.Module):
    """Error parameters of satellite navigation, which measures position and velocity."""

    position_sigma: Vector3  # standard deviation of the slow error (Gauss-Markov) per axis, NED, m
    correlation_time: Scalar  # correlation time of the slow error, s
    noise_sigma: Vector3  # standard deviation of the white position noise of a fix, per axis, NED, m
    velocity_sigma: Vector3  # standard deviation of the white velocity noise of a fix, per axis, NED, m/s
    period: Scalar  # time between two fixes, s; a multiple of the sampling period


class InertialSensors(eqx.Module):
    """Error parameters of the inertial sensors, which measure attitude, body rates and specific force.

    Biases are drawn once per flight, noise at each sample.
    """

    attitude_sigma: Vector3  # standard deviation of the attitude error about the body axes (Gauss-Markov), rad
    attitude_time: Scalar  # correlation time of the attitude error, s
    rates_bias: Scalar  # standard deviation of the gyro bias, rad/s
    rates_noise: Scalar  # standard deviation of the gyro noise, rad/s
    force_bias: Scalar  # standard deviation of the accelerometer bias, m/s^2
    force_noise: Scalar  # standard deviation of the accelerometer noise, m/s^2


class AirDataSensors(eqx.Module):
    """Error parameters of pitot tube (airspeed) and vanes (angle of attack, sideslip).

    Biases are drawn once per flight, noise at each sample.
    """

    airspeed_bias: Scalar  # standard deviation of the airspeed bias, m/s
    airspeed_noise: Scalar  # standard deviation of the airspeed noise, m/s
    vane_bias: Scalar  # standard deviation of the bias of each vane, rad
    vane_noise: Scalar  # standard deviation of the noise of each vane, rad


class VehicleSensorState(eqx.Module):
    """State of `VehicleSensors` between two samples: the present errors, and the last fix."""

    position_n: Vector3  # Gauss-Markov error of the position at the last fix, NED, m
    attitude_b: Vector3  # Gauss-Markov error of the attitude, body axes, rad
    rates_b: Vector3  # gyro biases, rad/s
    force_b: Vector3  # accelerometer biases, m/s^2
    air: Vector3  # biases of airspeed (m/s), angle of attack and sideslip (rad)
    fix: Fix  # last fix


class VehicleReading(eqx.Module):
    """Measurements of `VehicleSensors` at one sample."""

    quaternion: Quaternion  # attitude, NED to body
    rates_b: Vector3  # body rates, rad/s
    specific_force_b: Vector3  # specific force, body axes, m/s^2
    velocity_air_b: Vector3  # velocity relative to the air, body axes, m/s
    fix: Fix  # latest fix of satellite navigation


class VehicleSensors(eqx.Module):
    """Satellite navigation, inertial sensors and air data of one aircraft, with errors; a part of `NoisySensors`."""

    satellite: SatelliteNavigation
    inertial: InertialSensors
    air_data: AirDataSensors

    def init(self, truth: Truth, instant: Instant) -> VehicleSensorState:
        """Return the state before the first sample, with random errors of this flight."""
        normals = instant.normals(VEHICLE_SENSORS, _NORMALS, once=True)
        satellite, inertial, air = self.satellite, self.inertial, self.air_data
        velocity_n = velocity_over_ground_n(truth.condition, truth.state)
        return VehicleSensorState(
            position_n=satellite.position_sigma * instant.normals(SATELLITES, _FIX_NORMALS, once=True)[0:3],
            attitude_b=inertial.attitude_sigma * normals[0:3],
            rates_b=inertial.rates_bias * normals[3:6],
            force_b=inertial.force_bias * normals[6:9],
            air=jnp.stack([air.airspeed_bias, air.vane_bias, air.vane_bias]) * normals[9:12],
            fix=Fix(truth.state.position_n, velocity_n, jnp.asarray(False)),
        )

    def read(
        self, sensor_state: VehicleSensorState, truth: Truth, instant: Instant
    ) -> tuple[VehicleReading, VehicleSensorState]:
        """Return the measurements of this sample, and the new state."""
        normals, inertial, air = instant.normals(VEHICLE_SENSORS, _NORMALS), self.inertial, self.air_data
        # the initial random numbers apply to the first sample
        attitude_b = gauss_markov(
            sensor_state.attitude_b, inertial.attitude_sigma, inertial.attitude_time, instant.step, normals[0:3]
        )
        attitude_b = jnp.where(instant.number > 0, attitude_b, sensor_state.attitude_b)
        has_new_fix, previous_fix = is_due(instant, self.satellite.period), sensor_state.fix
        position_n, fix_position_n, fix_velocity_n = select_if_any(
            has_new_fix,
            lambda: self._new_fix(sensor_state.position_n, truth, instant),
            (sensor_state.position_n, previous_fix.position_n, previous_fix.velocity_n),
        )
        fix = Fix(fix_position_n, fix_velocity_n, has_new_fix)
        state, data = truth.state, truth.condition.air_data
        measured = jnp.stack([data.V, data.alpha, data.beta]) + sensor_state.air
        measured = measured + jnp.stack([air.airspeed_noise, air.vane_noise, air.vane_noise]) * normals[9:12]
        force_b = truth.condition.wrench.force_b / truth.airframe.mass_properties.mass
        reading = VehicleReading(
            quaternion=tilt_attitude(state.quaternion, attitude_b),
            rates_b=state.rates_b + sensor_state.rates_b + inertial.rates_noise * normals[3:6],
            specific_force_b=force_b + sensor_state.force_b + inertial.force_noise * normals[6:9],
            velocity_air_b=_air_velocity_b(*measured),
            fix=fix,
        )
        errors = VehicleSensorState(
            position_n, attitude_b, sensor_state.rates_b, sensor_state.force_b, sensor_state.air, fix
        )
        return reading, errors

    def _new_fix(self, slow_n: Vector3, truth: Truth, instant: Instant) -> tuple[Vector3, Vector3, Vector3]:
        """Return slow error (m), position (m) and velocity (m/s) of a new fix, NED; `slow_n` is the last slow error."""
        satellite, normals = self.satellite, instant.normals(SATELLITES, _FIX_NORMALS)
        next_slow_n = gauss_markov(
            slow_n, satellite.position_sigma, satellite.correlation_time, satellite.period, normals[0:3]
        )
        slow_n = jnp.where(instant.number > 0, next_slow_n, slow_n)
        position_n = truth.state.position_n + slow_n + satellite.noise_sigma * normals[3:6]
        velocity_n = velocity_over_ground_n(truth.condition, truth.state) + satellite.velocity_sigma * normals[6:9]
        return slow_n, position_n, velocity_n


def is_due(instant: Instant, period: Scalar) -> Array:
    """Whether a sensor with the measurement period `period` (s) measures at the instant's sample.

    The period is rounded to a multiple of the sampling period, at least one.
    """
    period_samples = jnp.maximum(jnp.round(period / instant.step).astype(instant.number.dtype), 1)
    return instant.number % period_samples == 0


def tilt_attitude(quaternion: Quaternion, angles_b: Vector3) -> Quaternion:
    """Return an attitude quaternion, NED to body, rotated by small angles about the body axes x, y and z (rad).

    The rotation angle is 2 arctan(|angles| / 2) instead of |angles|; relative error 1e-6 at 0.2 deg, 1e-4 at 2 deg.
    """
    half_b = 0.5 * angles_b
    return quaternion_multiply(quaternion, normalize(jnp.concatenate([jnp.ones_like(half_b[:1]), half_b])))


def _air_velocity_b(V: Scalar, alpha: Scalar, beta: Scalar) -> Vector3:
    """Return the velocity relative to the air (body axes, m/s) from airspeed (m/s) and flow angles (rad)."""
    level = V * jnp.cos(beta)
    return jnp.stack([level * jnp.cos(alpha), V * jnp.sin(beta), level * jnp.sin(alpha)])
