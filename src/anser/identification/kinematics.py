"""Kinematics of a record: specific force, and the rates of flow angles and attitude that inertial sensors imply."""

import numpy as np
from jaxtyping import Float

from anser.constants import STANDARD_GRAVITY_M_S2
from anser.identification.records import FlightRecord
from anser.identification.smoothing import noise_level, smooth

RATES = ("roll_rate", "pitch_rate", "yaw_rate")
SPECIFIC_FORCE = ("specific_force_x", "specific_force_y", "specific_force_z")
_VELOCITY_B = ("velocity_u", "velocity_v", "velocity_w")
_VELOCITY_N = ("velocity_north", "velocity_east", "velocity_down")

Rows3 = Float[np.ndarray, "3 sample"]


def with_attitude(record: FlightRecord) -> FlightRecord:
    """Return the record with roll, pitch and yaw, from the quaternion where the record has no angles.

    The angles over a full turn are continuous. Source: [SL] eq. 1.3-32.
    """
    if all(key in record for key in ("roll", "pitch")) or "quaternion_0" not in record:
        return record
    q0, q1, q2, q3 = record.stack(*(f"quaternion_{k}" for k in range(4)))
    roll = np.arctan2(2.0 * (q0 * q1 + q2 * q3), q0**2 - q1**2 - q2**2 + q3**2)
    pitch = np.arcsin(np.clip(2.0 * (q0 * q2 - q1 * q3), -1.0, 1.0))
    yaw = np.arctan2(2.0 * (q1 * q2 + q0 * q3), q0**2 + q1**2 - q2**2 - q3**2)
    return record.with_channels(roll=np.unwrap(roll), pitch=pitch, yaw=np.unwrap(yaw))


def gravity_b(record: FlightRecord) -> Rows3:
    """Return the gravity in body axes, m/s^2, from roll and pitch."""
    roll, pitch = record.stack("roll", "pitch")
    down = [-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)]
    return STANDARD_GRAVITY_M_S2 * np.stack(down)


def with_specific_force(
    record: FlightRecord, accelerometer_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> FlightRecord:
    """Return the record with the specific force at the centre of gravity.

    That of accelerometers at another position r is corrected: f = f_r - w' x r - w x (w x r). Without accelerometers,
    the force follows from the velocity over ground: f = v' + w x v - g in body axes, over a flat Earth.

    Parameters
    ----------
    record
        Record with body rates, and with specific forces or velocities.
    accelerometer_m
        Position of the accelerometers relative to the centre of gravity, body axes, m.

    Raises
    ------
    ValueError
        The record lacks body rates, or both specific force and velocity.
    """
    record = with_attitude(record)
    rates = record.stack(*RATES)
    if all(key in record for key in SPECIFIC_FORCE):
        position = np.asarray(accelerometer_m, dtype=float)[:, None]
        if not np.any(position):
            return record
        angular = smooth(rates, record.step_s)
        force = record.stack(*SPECIFIC_FORCE) - _cross(angular.rate, position)
        force -= _cross(angular.values, _cross(angular.values, np.broadcast_to(position, rates.shape)))
        note = "The specific force is corrected for the position of the accelerometers."
    else:
        force = _force_from_velocity(record, rates)
        note = "The specific force follows from the velocity, without accelerometers."
    return record.with_channels((note,), **dict(zip(SPECIFIC_FORCE, force, strict=True)))


def _force_from_velocity(record: FlightRecord, rates: Rows3) -> Rows3:
    if all(key in record for key in _VELOCITY_B):
        velocity = smooth(record.stack(*_VELOCITY_B), record.step_s)
        return velocity.rate + _cross(rates, velocity.values) - gravity_b(record)
    if all(key in record for key in _VELOCITY_N):
        acceleration_n = smooth(record.stack(*_VELOCITY_N), record.step_s).rate
        acceleration_n[2] -= STANDARD_GRAVITY_M_S2
        return _to_body(record, acceleration_n)
    raise ValueError(
        "record: arrived without specific_force_x_m_s2, _y_, _z_ (accelerometers) and without the velocity in body or "
        "NED axes; expected one of them, for forces"
    )


def _to_body(record: FlightRecord, vector_n: Rows3) -> Rows3:
    roll, pitch, yaw = record.stack("roll", "pitch", "yaw")
    (sr, sp, sy), (cr, cp, cy) = np.sin((roll, pitch, yaw)), np.cos((roll, pitch, yaw))
    x, y, z = vector_n
    return np.stack(
        [
            cp * cy * x + cp * sy * y - sp * z,
            (sr * sp * cy - cr * sy) * x + (sr * sp * sy + cr * cy) * y + sr * cp * z,
            (cr * sp * cy + sr * sy) * x + (cr * sp * sy - sr * cy) * y + cr * cp * z,
        ]
    )


def _cross(a: Rows3, b: Rows3) -> Rows3:
    return np.cross(a, np.broadcast_to(b, a.shape), axis=0)


def implied_rates(record: FlightRecord) -> dict[str, Float[np.ndarray, " sample"]]:
    """Return the time derivatives of airspeed, flow angles, attitude and altitude that other channels imply.

    Body rates and specific force of the record; air at rest relative to the ground or moving steadily. A derivative is
    left out where the record lacks a channel for it. Source: [SL] eqs. 1.4-4 and 2.5-29 to 2.5-31.
    """
    P, Q, R = record.stack(*RATES)
    if "roll" not in record or "pitch" not in record:
        return {}
    roll, pitch = record.stack("roll", "pitch")
    turning = Q * np.sin(roll) + R * np.cos(roll)
    derivatives = {
        "roll": P + np.tan(pitch) * turning,
        "pitch": Q * np.cos(roll) - R * np.sin(roll),
        "yaw": turning / np.cos(pitch),
    }
    if "airspeed" in record and "alpha" in record:
        V, alpha = record.stack("airspeed", "alpha")
        beta = record.channels.get("beta", np.zeros_like(alpha))
        (sa, sb), (ca, cb) = np.sin((alpha, beta)), np.cos((alpha, beta))
        climb = [ca * cb * np.sin(pitch), -sb * np.sin(roll) * np.cos(pitch), -sa * cb * np.cos(roll) * np.cos(pitch)]
        derivatives["altitude"] = V * np.sum(climb, axis=0)
        if all(key in record for key in SPECIFIC_FORCE):
            ax, ay, az = record.stack(*SPECIFIC_FORCE) + gravity_b(record)
            derivatives["airspeed"] = ax * ca * cb + ay * sb + az * sa * cb
            derivatives["alpha"] = Q - np.tan(beta) * (P * ca + R * sa) + (az * ca - ax * sa) / (V * cb)
            derivatives["beta"] = P * sa - R * ca + (ay * cb - sb * (ax * ca + az * sa)) / V
        elif "altitude" in record:  # wings nearly level: the pitch less the path angle
            path = np.clip(smooth(record["altitude"], record.step_s).rate / V, -1.0, 1.0)
            derivatives["alpha"] = np.gradient(pitch - np.arcsin(path), record.step_s)
    return {key: rate for key, rate in derivatives.items() if key in record}


GUST_BAND_HZ = 1.5
_GUST_MIN = 4.0
"""Least rate of a gust, relative to the noise of the measured flow angle's derivative in the band of the gusts."""


def gust_rates(record: FlightRecord) -> dict[str, Float[np.ndarray, " sample"]]:
    """Return the part of the rates of alpha and beta that the air causes, rad/s, by `alpha` and `beta`; empty in calm.

    The measured rate less the rate that inertial sensors imply. Through a frozen field of gusts it is minus the pitch
    rate, or the yaw rate, of the air, up to the lag of the aircraft's extent. Calm: within the band of gusts, the
    difference is explained by the noise of the flow angle.
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
