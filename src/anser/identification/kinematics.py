"""Flight kinematics of a record: specific force, and rates of airspeed, flow angles and attitude from inertial data."""

from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from anser.constants import STANDARD_GRAVITY_M_S2
from anser.identification.records import FlightRecord
from anser.identification.smoothing import noise_level, smooth

RATES = ("roll_rate", "pitch_rate", "yaw_rate")
SPECIFIC_FORCE = ("specific_force_x", "specific_force_y", "specific_force_z")
_VELOCITY_B = ("velocity_u", "velocity_v", "velocity_w")
_VELOCITY_N = ("velocity_north", "velocity_east", "velocity_down")

Rows3 = Float[np.ndarray, "3 sample"]


def flow_rates(
    airspeed: Any, alpha: Any, beta: Any, rates_b: Any, specific_force_b: Any, gravity_b: Any, xp: Any = np
) -> Any:
    """Return an array with rows airspeed rate (m/s^2), angle-of-attack rate and sideslip rate (rad/s).

    Airspeed is in m/s, angles are in rad; body rates (rad/s), specific force and gravity (m/s^2) have one row per body
    axis. The wind must be constant and uniform. `xp` is `numpy` or `jax.numpy`. Source: [SL] eqs. 2.5-29 to 2.5-31.
    """
    P, Q, R = rates_b
    ax, ay, az = specific_force_b + gravity_b
    sa, ca, sb, cb = xp.sin(alpha), xp.cos(alpha), xp.sin(beta), xp.cos(beta)
    forward = ax * ca + az * sa
    return xp.stack(
        [
            forward * cb + ay * sb,
            Q - xp.tan(beta) * (P * ca + R * sa) + (az * ca - ax * sa) / (airspeed * cb),
            P * sa - R * ca + (ay * cb - forward * sb) / airspeed,
        ]
    )


def attitude_rates(roll: Any, pitch: Any, rates_b: Any, xp: Any = np) -> Any:
    """Return an array with the rates of the Euler angles roll, pitch and yaw (rad/s) as rows.

    Angles are in rad, body rates (rows) in rad/s. `xp` is `numpy` or `jax.numpy`. Source: [SL] eq. 1.4-4.
    """
    P, Q, R = rates_b
    turning = Q * xp.sin(roll) + R * xp.cos(roll)
    return xp.stack([P + xp.tan(pitch) * turning, Q * xp.cos(roll) - R * xp.sin(roll), turning / xp.cos(pitch)])


def gravity_in_body(roll: Any, pitch: Any, xp: Any = np) -> Any:
    """Return the standard gravity vector in body axes, m/s^2, rows x, y, z; roll and pitch in rad."""
    level = xp.cos(pitch)
    return STANDARD_GRAVITY_M_S2 * xp.stack([-xp.sin(pitch), xp.sin(roll) * level, xp.cos(roll) * level])


def with_attitude(record: FlightRecord) -> FlightRecord:
    """Return the record with roll, pitch and yaw (rad) from its quaternion, if roll or pitch is not recorded.

    A record with both angles, or without a quaternion, is returned unchanged.
    """
    if all(key in record for key in ("roll", "pitch")) or "quaternion_0" not in record:
        return record
    quaternion = record.stack(*(f"quaternion_{k}" for k in range(4))).T
    yaw, pitch, roll = Rotation.from_quat(quaternion, scalar_first=True).as_euler("ZYX").T
    return record.with_channels(roll=np.unwrap(roll), pitch=pitch, yaw=np.unwrap(yaw))


def record_gravity(record: FlightRecord) -> Rows3:
    """Return the standard gravity vector in body axes at the samples of a record, m/s^2."""
    return gravity_in_body(record["roll"], record["pitch"])


def with_specific_force(
    record: FlightRecord, accelerometer_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> FlightRecord:
    """Return the record with the specific force f at the centre of gravity (body axes, m/s^2), and a note.

    Accelerometers at the position r measure f_r, and f = f_r - w' x r - w x (w x r) with the body rates w; if r = 0,
    the record is returned unchanged. If there are no accelerometers, f = v' + w x v - g, with the velocity v over
    ground and the gravity g over a flat Earth.

    Parameters
    ----------
    record
        Record with body rates, and with specific forces, or with velocity (body or NED axes) and attitude.
    accelerometer_m
        Position r of the accelerometers relative to the centre of gravity, body axes, m.

    Raises
    ------
    ValueError
        If the record lacks body rates, or has neither specific forces nor velocity with attitude.
    """
    record = with_attitude(record)
    rates = record.stack(*RATES)
    if all(key in record for key in SPECIFIC_FORCE):
        position = np.asarray(accelerometer_m, dtype=float)[:, None]
        if not np.any(position):
            return record
        angular = smooth(rates, record.step_s)
        force = record.stack(*SPECIFIC_FORCE) - _cross(angular.rate, position)
        force -= _cross(angular.values, _cross(angular.values, position))
        note = "The specific force is corrected for the position of the accelerometers."
    else:
        force = _force_from_velocity(record, rates)
        note = "The specific force follows from the velocity, without accelerometers."
    return record.with_channels((note,), **dict(zip(SPECIFIC_FORCE, force, strict=True)))


def _force_from_velocity(record: FlightRecord, rates: Rows3) -> Rows3:
    if all(key in record for key in _VELOCITY_B):
        velocity = smooth(record.stack(*_VELOCITY_B), record.step_s)
        return velocity.rate + _cross(rates, velocity.values) - record_gravity(record)
    if all(key in record for key in _VELOCITY_N):
        acceleration_n = smooth(record.stack(*_VELOCITY_N), record.step_s).rate
        acceleration_n[2] -= STANDARD_GRAVITY_M_S2
        attitude = Rotation.from_euler("ZYX", record.stack("yaw", "pitch", "roll").T)
        return attitude.inv().apply(acceleration_n.T).T
    raise ValueError(
        "record: arrived without specific_force_x_m_s2, _y_, _z_ (accelerometers) and without the velocity in body or "
        "NED axes; expected one of them, for forces"
    )


def _cross(a: Rows3, b: Float[np.ndarray, "3 #sample"]) -> Rows3:
    return np.cross(a, b, axis=0)


def implied_rates(record: FlightRecord) -> dict[str, Float[np.ndarray, " sample"]]:
    """Return time derivatives of recorded channels, by key, computed from the other channels by flight kinematics.

    The keys are roll, pitch, yaw, alpha, beta (rad/s), altitude (m/s) and airspeed (m/s^2); a key is absent if a
    required channel is not recorded. The air must be at rest or move steadily. If specific forces are missing, the rate
    of alpha holds for wings nearly level. If roll or pitch is missing, the result is empty. Raises ValueError if body
    rates are missing.
    """
    rates = record.stack(*RATES)
    if "roll" not in record or "pitch" not in record:
        return {}
    roll, pitch = record.stack("roll", "pitch")
    derivatives: dict[str, Float[np.ndarray, " sample"]] = dict(
        zip(("roll", "pitch", "yaw"), attitude_rates(roll, pitch, rates), strict=True)
    )
    if "airspeed" in record and "alpha" in record:
        V, alpha = record.stack("airspeed", "alpha")
        beta = record.channels.get("beta", np.zeros_like(alpha))
        along = np.stack([np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)])
        derivatives["altitude"] = -V * np.sum(along * record_gravity(record), axis=0) / STANDARD_GRAVITY_M_S2
        if all(key in record for key in SPECIFIC_FORCE):
            flow = flow_rates(V, alpha, beta, rates, record.stack(*SPECIFIC_FORCE), record_gravity(record))
            derivatives |= dict(zip(("airspeed", "alpha", "beta"), flow, strict=True))
        elif "altitude" in record:  # wings nearly level: the pitch less the path angle
            path = np.clip(smooth(record["altitude"], record.step_s).rate / V, -1.0, 1.0)
            derivatives["alpha"] = np.gradient(pitch - np.arcsin(path), record.step_s)
    return {key: rate for key, rate in derivatives.items() if key in record}


GUST_BAND_HZ = 1.5
"""Upper frequency of the band in which gusts are detected, Hz."""
_GUST_MIN = 4.0
"""Amplitude of the rate that counts as gusts, relative to the noise of the flow angle's derivative in the same band."""


def gust_rates(record: FlightRecord) -> dict[str, Float[np.ndarray, " sample"]]:
    """Return the rates of the flow angles that gusts cause, rad/s, by the keys `alpha` and `beta`.

    The rate is the derivative of the measured angle minus the rate computed from inertial sensors. The rate of alpha is
    the pitch rate of the air; the rate of beta is minus the yaw rate of the air (both approximately, for a frozen field
    of gusts). A key is absent if the record lacks a channel, or if the noise of the measured angle explains the rate.
    """
    implied, step, gusts = implied_rates(record), record.step_s, {}
    for key in ("alpha", "beta"):
        if key not in implied:
            continue
        difference = np.gradient(record[key], step) - implied[key]
        time = np.linspace(-1.0, 1.0, difference.size)
        spectrum = np.fft.rfft(difference - np.polyval(np.polyfit(time, difference, 1), time))
        inside = np.fft.rfftfreq(difference.size, step) <= GUST_BAND_HZ
        level = np.sqrt(2.0 * np.sum(np.abs(spectrum[inside]) ** 2)) / difference.size
        # standard deviation of the derivative of white noise up to the frequency
        noise = float(noise_level(record[key])) * 2.0 * np.pi * np.sqrt(2.0 * step * GUST_BAND_HZ**3 / 3.0)
        if level > max(_GUST_MIN * noise, 1e-3):
            gusts[key] = difference
    return gusts
