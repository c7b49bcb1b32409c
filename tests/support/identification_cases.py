"""Records with known truth: the short period of an F-16, and an unstable aircraft under feedback.

The cases are defined in the reference figures of the project: E. A. Morelli, *Real-time parameter estimation in the
frequency domain* (J. Guidance 23(5), 2000), and R. V. Jategaonkar, *Flight Vehicle System Identification*, chapter 9.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

SHORT_PERIOD_STEP_S = 0.02
SHORT_PERIOD_FREQUENCIES_HZ = np.arange(0.10, 1.501, 0.04)


class Record(NamedTuple):
    """Times (s), input and states without noise, and the true parameters by equation."""

    time_s: np.ndarray
    inputs: np.ndarray
    states: np.ndarray
    truth: np.ndarray


def pulses(time_s, start_s, levels, edges_s):
    """Input that jumps to the levels at the edges, as an input at the end of each step."""
    index = np.searchsorted(start_s + np.asarray(edges_s), time_s + 1e-9, side="right")
    return np.array([0.0, *levels, 0.0])[index]


def short_period(duration_s, m_alpha=-4.3, manoeuvre="doublet"):
    """States alpha (deg) and q (deg/s); the input of a sample was held over the step before it."""
    dt, time_s = SHORT_PERIOD_STEP_S, np.arange(round(duration_s / SHORT_PERIOD_STEP_S) + 1) * SHORT_PERIOD_STEP_S
    if manoeuvre == "doublet":
        u = pulses(time_s, 1.0, (2.0, -2.0), (0.0, 1.0, 2.0))
    else:
        u = pulses(time_s, 1.0, (2.0, -2.0, 2.0, -2.0), (0.0, 3.0, 5.0, 6.0, 7.0))
    A, B = np.array([[-0.6, 0.95], [m_alpha, -1.2]]), np.array([-0.115, -5.157])
    phi = np.eye(2) + A * dt + A @ A * dt**2 / 2.0
    gamma = (np.eye(2) * dt + A * dt**2 / 2.0 + A @ A * dt**3 / 6.0) @ B
    x = np.zeros((time_s.size, 2))
    for k in range(time_s.size - 1):
        x[k + 1] = phi @ x[k] + gamma * u[k + 1]
    return Record(time_s, u, x, np.column_stack([A, B]))


UNSTABLE_TRUTH = {"Z_w": -1.4249, "Z_q": -1.4768, "Z_d": -6.2632, "M_w": 0.2163, "M_q": -3.7067, "M_d": -12.784}
UNSTABLE_START = {"Z_w": -1.22871, "Z_d": -4.20491, "M_w": 0.116197, "M_q": -2.70670, "M_d": -18.7718}
UNSTABLE_U0, UNSTABLE_GAIN, UNSTABLE_STEP_S = 44.5695, 0.032399, 0.05
UNSTABLE_NOISE = np.array([0.1, 0.002, 0.05])  # w, m/s; q, rad/s; a_z, m/s^2


def unstable_aircraft():
    """Inputs delta (rad), states w (m/s) and q (rad/s) under feedback of w at the samples; truth: A and B.

    The deflection of a sample is held over the step after it; the pilot's input is a 3-2-1-1 of 0.02 rad.
    """
    time_s = np.arange(251) * UNSTABLE_STEP_S
    pilot = pulses(time_s, 1.0, (0.02, -0.02, 0.02, -0.02), np.array([0.0, 3.0, 5.0, 6.0, 7.0]) * 0.7)
    p = UNSTABLE_TRUTH
    A = np.array([[p["Z_w"], UNSTABLE_U0 + p["Z_q"]], [p["M_w"], p["M_q"]]])
    B = np.array([p["Z_d"], p["M_d"]])
    block = expm(np.block([[A, B[:, None]], [np.zeros((1, 3))]]) * UNSTABLE_STEP_S)
    x, u = np.zeros((251, 2)), np.zeros(251)
    for k in range(251):
        u[k] = pilot[k] + UNSTABLE_GAIN * x[k, 0]
        if k < 250:
            x[k + 1] = block[:2, :2] @ x[k] + block[:2, 2] * u[k]
    return Record(time_s, u, x, np.column_stack([A, B]))


def unstable_measurements(record, rng):
    """Measured w, q and a_z, shape (sample, 3)."""
    p = UNSTABLE_TRUTH
    a_z = record.states @ np.array([p["Z_w"], p["Z_q"]]) + p["Z_d"] * record.inputs
    clean = np.column_stack([record.states, a_z])
    return clean + UNSTABLE_NOISE * rng.normal(size=clean.shape)
