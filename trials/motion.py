"""Motion along delivered paths, and the resulting demands on an aircraft: the checker's independent formulas."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

__all__ = ["EMPTY_S", "Demands", "PathCells", "path_cells", "path_demands"]

EMPTY_S = 1e-9
"""Cells up to this length are empty: an aircraft moves less than a micrometre."""
_SHORT_S = 1e-2
_ROUNDING_M = 1e-9
"""Over 10 ms this is an acceleration of 6e-4 m/s^2, less than the check's tolerance."""

Rows = Float[np.ndarray, "3 ..."]


class Demands(NamedTuple):
    """Demands of a motion on the aircraft."""

    speed: Float[np.ndarray, "..."]
    """True airspeed, m/s."""
    climb_rate: Float[np.ndarray, "..."]
    """Relative to the air, up positive, m/s."""
    side: Float[np.ndarray, "..."]
    """Acceleration to the side, right positive, m/s^2."""
    normal: Float[np.ndarray, "..."]
    """Acceleration against gravity, normal to the path in its vertical plane: g cos(gamma) + V gamma_dot, m/s^2."""
    along: Float[np.ndarray, "..."]
    """Acceleration by thrust minus drag: along the air velocity, including g sin(gamma), m/s^2."""


def path_demands(velocity_n: Rows, acceleration_n: Rows, wind_n: Rows, gravity: float) -> Demands:
    """Limited quantities, from the motion over the ground.

    Parameters
    ----------
    velocity_n, acceleration_n
        Over the ground, NED, components first, m/s and m/s^2.
    wind_n
        Velocity of the air at the aircraft, NED, m/s.
    gravity
        Gravity, m/s^2.

    Notes
    -----
    The force per mass without gravity is f = a - g down. Across the air velocity u it is lift (and side force, zero in
    coordinated flight), so bank = atan2(side, normal) and load factor = hypot(side, normal)/g; along u it is thrust
    minus drag. The acceleration is relative to the ground, an inertial frame.
    """
    north, east, down = velocity_n - wind_n
    level_square = north * north + east * east
    level_speed = np.sqrt(level_square)
    speed = np.sqrt(level_square + down * down)
    # Vertical flight has no side direction: the lower bound keeps the quotients finite.
    level_safe, speed_safe = np.maximum(level_speed, 1e-12), np.maximum(speed, 1e-12)
    side = (north * acceleration_n[1] - east * acceleration_n[0]) / level_safe
    force_down = acceleration_n[2] - gravity
    force_ahead = (north * acceleration_n[0] + east * acceleration_n[1]) / level_safe
    along = (level_speed * force_ahead + down * force_down) / speed_safe
    normal = (down * force_ahead - level_speed * force_down) / speed_safe
    return Demands(speed, -down, side, normal, along)


class PathCells(NamedTuple):
    """Polynomials of one path over the ground."""

    begin: Float[np.ndarray, " cell"]
    """s."""
    end: Float[np.ndarray, " cell"]
    """s."""
    factors: Float[np.ndarray, "cell 9 6"]
    """Rows: position, velocity, acceleration (NED each); columns: powers 0 to 5 of the time since the cell began."""

    def at(self, time: Float[np.ndarray, " time"]) -> Float[np.ndarray, "9 time"]:
        """Position, velocity and acceleration (NED each) at rising times, s, within the path."""
        cell = np.clip(np.searchsorted(self.begin, time, side="right") - 1, 0, self.begin.size - 1)
        out = np.empty((9, time.size))
        bounds = np.flatnonzero(np.diff(cell)) + 1
        for start, stop in zip([0, *bounds], [*bounds, time.size], strict=True):
            if stop > start:
                elapsed = time[start:stop] - self.begin[cell[start]]
                powers = np.empty((6, stop - start))
                powers[0] = 1.0
                for k in range(1, 6):
                    np.multiply(powers[k - 1], elapsed, out=powers[k])
                np.matmul(self.factors[cell[start]], powers, out=out[:, start:stop])
        return out


def path_cells(times: Float[np.ndarray, " knot"], knots: Float[np.ndarray, "knot 3 3"]) -> PathCells:
    """Quintic Hermite polynomials between knots with given value, first and second derivative.

    Cells shorter than EMPTY_S count as empty and are omitted. In cells shorter than _SHORT_S, an end position
    consistent with both end velocities to _ROUNDING_M is replaced by the consistent value: rounding a position of 1e5 m
    in float64 would otherwise appear as an acceleration.

    Parameters
    ----------
    times
        Knot times, s, not decreasing.
    knots
        Shape (knot, order of the derivative, axis).
    """
    span = np.diff(times)
    real = span > EMPTY_S
    h = span[real][:, None]
    p, v, a = (knots[:-1][real, k] for k in range(3))
    P, V, A = (knots[1:][real, k] for k in range(3))
    # Remainders for the powers 3 to 5 after the powers 0 to 2 match the start of the cell.
    left_p = (P - p - h * (v + 0.5 * h * a)) / h**3
    left_v = (V - v - h * a) / h**2
    left_a = (A - a) / h
    as_speeds_say = 0.5 * left_v - left_a / 12.0
    rounded = (h < _SHORT_S) & (np.abs(left_p - as_speeds_say) * h**3 < _ROUNDING_M)
    left_p = np.where(rounded, as_speeds_say, left_p)
    c3 = 10.0 * left_p - 4.0 * left_v + 0.5 * left_a
    c4 = (-15.0 * left_p + 7.0 * left_v - left_a) / h
    c5 = (6.0 * left_p - 3.0 * left_v + 0.5 * left_a) / h**2
    powers = np.stack([p, v, 0.5 * a, c3, c4, c5], axis=-1)
    factors = np.zeros((powers.shape[0], 9, 6))
    factors[:, 0:3] = powers
    factors[:, 3:6, :5] = powers[:, :, 1:] * np.arange(1.0, 6.0)
    factors[:, 6:9, :4] = powers[:, :, 2:] * np.array([2.0, 6.0, 12.0, 20.0])
    return PathCells(times[:-1][real], times[1:][real], factors)
