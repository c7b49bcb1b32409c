"""The F-16 of Stevens and Lewis in plain NumPy and the textbook's own units: a second opinion on the equations of motion.

Written from [SL] eq. 1.7-18, 2.3-6 and section 3.5, with its state (VT, alpha, beta, Euler angles): nothing but the
numbers of the data file is shared with the package. ft, slug, s, rad; surfaces in deg, power in percent.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from importlib import resources
from typing import NamedTuple

import numpy as np
from scipy.optimize import fsolve

FOOT_M = 0.3048
SLUG_KG = 0.45359237 * 9.80665 / FOOT_M

DATA = json.loads(resources.files("anser.aircraft").joinpath("data/f16.json").read_text(encoding="utf-8"))
TABLES = {name: np.array(table["values"], dtype=float) for name, table in DATA["tables"].items()}
OF_ALPHA = np.stack(
    [TABLES[name] for name in ("CZ0", "CXq", "CYr", "CYp", "CZq", "Clr", "Clp", "Cmq", "Cnr", "Cnp")], axis=-1
)
OF_ELEVATOR = np.stack([TABLES["CX0"], TABLES["Cm0"]], axis=-1)
OF_SIDESLIP = np.stack([TABLES["Cl0"], TABLES["Cn0"]], axis=-1)
OF_SURFACES = np.stack([TABLES[name] for name in ("Clda", "Cldr", "Cnda", "Cndr")], axis=-1)
THRUST = np.stack([TABLES[name] for name in ("T_idle", "T_mil", "T_max")], axis=-1)

SPAN, AREA, CHORD = 30.0, 300.0, 11.32
JX, JY, JZ, JXZ = 9496.0, 55814.0, 63100.0, 982.0
HE = 160.0

STATES = ("VT", "alpha", "beta", "phi", "theta", "psi", "P", "Q", "R", "north", "east", "altitude", "power")
SURFACES = ("elevator", "aileron", "rudder")
LAG, RATE_LIMIT, LIMIT = 0.0495, np.array([60.0, 80.0, 120.0]), np.array([25.0, 21.5, 30.0])


class Controls(NamedTuple):
    """Commands of throttle (0 to 1), elevator, aileron and rudder (deg)."""

    throttle: float
    elevator: float
    aileron: float
    rudder: float


def exact_ratios():
    """c1 to c9 of the inertia, [SL] eq. 1.7-5."""
    gamma = JX * JZ - JXZ**2
    return (
        ((JY - JZ) * JZ - JXZ**2) / gamma,
        (JX - JY + JZ) * JXZ / gamma,
        JZ / gamma,
        JXZ / gamma,
        (JZ - JX) / JY,
        JXZ / JY,
        1.0 / JY,
        (JX * (JX - JY) + JXZ**2) / gamma,
        JX / gamma,
    )


def textbook_air(altitude):
    """Density (slug/ft^3) and speed of sound (ft/s): subroutine ADC."""
    factor = 1.0 - 0.703e-5 * altitude
    temperature = 390.0 if altitude >= 35000.0 else 519.0 * factor
    return 0.002377 * factor**4.14, np.sqrt(1.4 * 1716.3 * temperature)


def standard_air(altitude):
    """Density (slug/ft^3) and speed of sound (ft/s) of the U.S. Standard Atmosphere 1976, up to 11 km."""
    z = altitude * FOOT_M
    h = 6356766.0 * z / (6356766.0 + z)
    temperature, gas = 288.15 - 6.5e-3 * h, 8.31432 / 0.0289644
    pressure = 101325.0 * (temperature / 288.15) ** (9.80665 / (6.5e-3 * gas))
    density = pressure / (gas * temperature)
    return density * FOOT_M**3 / SLUG_KG, np.sqrt(1.4 * gas * temperature) / FOOT_M


@dataclass(frozen=True)
class Aircraft:
    """Constants that the textbook's program rounds: mass (slug), gravity (ft/s^2), c1 to c9, deg/rad in CZ; air, cg."""

    mass: float
    gravity: float
    ratios: tuple[float, ...]
    deg_per_rad: float
    air: Callable[[float], tuple[float, float]]
    x_cg: float = 0.30


def rounded_constants(x_cg=0.30):
    """Constants of the program behind the textbook's figures."""
    ratios = (-0.770, 0.02755, 1.055e-4, 1.642e-6, 0.9604, 1.759e-2, 1.792e-5, -0.7336, 1.587e-5)
    return Aircraft(1.0 / 1.57e-3, 32.17, ratios, 57.3, textbook_air, x_cg)


def exact_constants(x_cg=0.30):
    """Constants of the library's aircraft: 9295.44 kg, unrounded inertia, standard gravity and atmosphere."""
    return Aircraft(9295.44 / SLUG_KG, 9.80665 / FOOT_M, exact_ratios(), 180.0 / np.pi, standard_air, x_cg)


def _cell(value, start, spacing, count):
    """Cell of an even axis and the fraction within it; the last cells extend beyond the ends."""
    at = (value - start) / spacing
    k = min(max(int(np.floor(at)), 0), count - 2)
    return k, at - k


def _bilinear(table, row_position, column):
    (i, s), (j, t) = row_position, column
    return (1 - s) * ((1 - t) * table[i, j] + t * table[i, j + 1]) + s * (
        (1 - t) * table[i + 1, j] + t * table[i + 1, j + 1]
    )


def coefficients(aircraft, VT, alpha, beta, rates, surfaces):
    """CX, CY, CZ, Cl, Cm, Cn, moments about the centre of gravity; alpha, beta in rad, surfaces in deg."""
    a_deg, b_deg = np.degrees([alpha, beta])
    elevator, aileron, rudder = surfaces
    a = _cell(a_deg, -10.0, 5.0, 12)
    CZ0, CXq, CYr, CYp, CZq, Clr, Clp, Cmq, Cnr, Cnp = (1 - a[1]) * OF_ALPHA[a[0]] + a[1] * OF_ALPHA[a[0] + 1]
    CX0, Cm0 = _bilinear(OF_ELEVATOR, a, _cell(elevator, -24.0, 12.0, 5))
    Cl0, Cn0 = np.sign(b_deg) * _bilinear(OF_SIDESLIP, a, _cell(abs(b_deg), 0.0, 5.0, 7))
    Clda, Cldr, Cnda, Cndr = _bilinear(OF_SURFACES, a, _cell(b_deg, -30.0, 10.0, 7))
    p, q, r = np.array([SPAN, CHORD, SPAN]) * rates / (2 * VT)
    da, dr = aileron / 20.0, rudder / 30.0
    CX = CX0 + CXq * q
    CY = -0.02 * b_deg + 0.021 * da + 0.086 * dr + CYr * r + CYp * p
    CZ = CZ0 * (1 - (b_deg / aircraft.deg_per_rad) ** 2) - 0.19 * elevator / 25.0 + CZq * q
    lever = 0.35 - aircraft.x_cg
    Cl = Cl0 + Clda * da + Cldr * dr + Clr * r + Clp * p
    Cm = Cm0 + Cmq * q + CZ * lever
    Cn = Cn0 + Cnda * da + Cndr * dr + Cnr * r + Cnp * p - CY * lever * CHORD / SPAN
    return CX, CY, CZ, Cl, Cm, Cn


def thrust(power, altitude, mach):
    """Thrust, lbf."""
    idle, military, maximum = _bilinear(THRUST, _cell(altitude, 0.0, 10000.0, 6), _cell(mach, 0.0, 0.2, 6))
    if power < 50.0:
        return idle + (military - idle) * power / 50.0
    return military + (maximum - military) * (power - 50.0) / 50.0


def gearing(throttle):
    """Commanded power, percent."""
    return 64.94 * throttle if throttle <= 0.77 else 217.38 * throttle - 117.38


def power_rate(power, command):
    """Lag of the engine, percent/s."""
    if command >= 50.0:
        target, fast = (command, True) if power >= 50.0 else (60.0, False)
    else:
        target, fast = (40.0, True) if power >= 50.0 else (command, False)
    gap = target - power
    if fast:
        return 5.0 * gap
    if gap <= 25.0:
        return gap
    return 0.1 * gap if gap >= 50.0 else (1.9 - 0.036 * gap) * gap


def derivative(aircraft, x, surfaces, throttle):
    """Time derivative of `STATES`."""
    VT, alpha, beta, phi, theta, psi, P, Q, R, _, _, altitude, power = x
    density, speed_of_sound = aircraft.air(altitude)
    qbar, g, m = 0.5 * density * VT**2, aircraft.gravity, aircraft.mass
    CX, CY, CZ, Cl, Cm, Cn = coefficients(aircraft, VT, alpha, beta, x[6:9], surfaces)
    s_th, c_th, s_ph, c_ph, s_ps, c_ps = *_sincos(theta), *_sincos(phi), *_sincos(psi)
    U, V, W = VT * np.cos(alpha) * np.cos(beta), VT * np.sin(beta), VT * np.sin(alpha) * np.cos(beta)
    U_dot = R * V - Q * W - g * s_th + (qbar * AREA * CX + thrust(power, altitude, VT / speed_of_sound)) / m
    V_dot = P * W - R * U + g * c_th * s_ph + qbar * AREA * CY / m
    W_dot = Q * U - P * V + g * c_th * c_ph + qbar * AREA * CZ / m
    VT_dot = (U * U_dot + V * V_dot + W * W_dot) / VT
    L, M, N = qbar * AREA * SPAN * Cl, qbar * AREA * CHORD * Cm, qbar * AREA * SPAN * Cn
    c1, c2, c3, c4, c5, c6, c7, c8, c9 = aircraft.ratios
    return np.array(
        [
            VT_dot,
            (U * W_dot - W * U_dot) / (U**2 + W**2),
            (VT * V_dot - V * VT_dot) * np.cos(beta) / (U**2 + W**2),
            P + np.tan(theta) * (Q * s_ph + R * c_ph),
            Q * c_ph - R * s_ph,
            (Q * s_ph + R * c_ph) / c_th,
            (c2 * P + c1 * R + c4 * HE) * Q + c3 * L + c4 * N,
            (c5 * P - c7 * HE) * R - c6 * (P**2 - R**2) + c7 * M,
            (c8 * P - c2 * R + c9 * HE) * Q + c4 * L + c9 * N,
            U * c_th * c_ps + V * (s_ph * c_ps * s_th - c_ph * s_ps) + W * (c_ph * s_th * c_ps + s_ph * s_ps),
            U * c_th * s_ps + V * (c_ph * c_ps + s_ph * s_th * s_ps) + W * (c_ph * s_th * s_ps - s_ph * c_ps),
            U * s_th - V * s_ph * c_th - W * c_ph * c_th,
            power_rate(power, gearing(throttle)),
        ]
    )


def _sincos(angle):
    return np.sin(angle), np.cos(angle)


def with_actuators(aircraft, y, controls):
    """Time derivative of `STATES` followed by `SURFACES` (deg), first-order lags with limits."""
    command = np.clip(controls[1:], -LIMIT, LIMIT)
    rate = np.clip((command - y[13:]) / LAG, -RATE_LIMIT, RATE_LIMIT)
    return np.concatenate([derivative(aircraft, y[:13], y[13:], controls.throttle), rate])


def trim(aircraft, VT, altitude, gamma=0.0, turn_rate=0.0):
    """State with surfaces and the controls of steady flight without sideslip; rad, rad/s."""

    def state(unknown):
        alpha, phi, theta, elevator, aileron, rudder, throttle = unknown
        turning = turn_rate * np.array([-np.sin(theta), np.sin(phi) * np.cos(theta), np.cos(phi) * np.cos(theta)])
        x = np.array([VT, alpha, 0.0, phi, theta, 0.3, *turning, 0.0, 0.0, altitude, gearing(throttle)])
        return x, np.array([elevator, aileron, rudder])

    def residual(unknown):
        x, surfaces = state(unknown)
        rate = derivative(aircraft, x, surfaces, unknown[-1])
        return np.concatenate([rate[:3], rate[6:9], [(rate[11] - VT * np.sin(gamma)) / VT]])

    bank = np.arctan(turn_rate * VT / aircraft.gravity)
    unknown = fsolve(residual, [0.1, bank, 0.1 + gamma, -2.0, 0.0, 0.0, 0.3], xtol=1e-13)
    assert np.abs(residual(unknown)).max() < 1e-8
    x, surfaces = state(unknown)
    return np.concatenate([x, surfaces]), Controls(float(unknown[-1]), *map(float, surfaces))


def fly(aircraft, y, control_history, step):
    """States with surfaces at each sample, by the classical Runge-Kutta method; controls held over each step."""
    flown = [y]
    for controls in control_history:
        k1 = with_actuators(aircraft, y, controls)
        k2 = with_actuators(aircraft, y + 0.5 * step * k1, controls)
        k3 = with_actuators(aircraft, y + 0.5 * step * k2, controls)
        k4 = with_actuators(aircraft, y + step * k3, controls)
        y = y + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        flown.append(y)
    return np.array(flown)
