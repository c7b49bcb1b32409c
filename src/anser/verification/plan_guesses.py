"""First guesses for the second search: polylines of the right length with detours of many kinds."""

import numpy as np
from jaxtyping import Float

from anser.verification.plan_spline import SplineFlight

__all__ = ["guess_path"]

_FIT_WEIGHT = 3e-3
"""Smoothness against closeness to the polyline: corners are rounded over a few cells."""


def guess_path(flight: SplineFlight, rng: np.random.Generator) -> Float[np.ndarray, " unknown"]:
    """Unknowns of a spline that follows a random polyline at an even speed.

    Notes
    -----
    In the air, whose mean wind is taken off, the polyline runs from the start some way ahead, through detours, some
    way along the arrival's direction, to the rendezvous. Detours: one corner on an ellipse (so the length is right),
    a zigzag, whole circles at the begin or the end, or none. Height runs straight with a random hump.
    """
    case, who = flight.case, flight.who
    start, velocity = case.starts.position_n[who], case.starts.velocity_n[who]
    flown = flight.arrival - case.starts.time
    meeting = case.goals.meeting_n(who, np.array([flight.arrival]))[0]
    heights = np.linspace(-start[2], -meeting[2], 9)
    wind = case.wind.at(heights).mean(axis=1)[:2]
    aim = meeting[:2] - start[:2] - wind * flown
    slow, fast = case.limits.speed_min[who], case.limits.speed_max[who]
    length = rng.uniform(slow, fast) * flown
    ahead = velocity[:2] - wind
    turn_radius = (0.5 * (slow + fast)) ** 2 / (case.gravity * np.tan(case.limits.bank_max[who]))
    course = case.goals.course[who]
    last = np.array([np.cos(course), np.sin(course)]) if np.isfinite(course) else _direction(rng)
    first_leg = rng.choice([0.0, 0.5, 1.5]) * turn_radius * rng.random()
    last_leg = (rng.uniform(0.3, 2.0) if np.isfinite(course) else rng.choice([0.0, 0.0, 1.0])) * turn_radius
    p0, p1 = first_leg * ahead / max(float(np.linalg.norm(ahead)), 1e-9), aim - last_leg * last
    points = [np.zeros(2), p0, *_detour(p0, p1, length - first_leg - last_leg, turn_radius, rng), p1, aim]
    line = np.array(points)
    done = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    share = (flight.seen - case.starts.time) / flown
    flat = np.stack([np.interp(share * done[-1], done, line[:, k]) for k in range(2)])
    flat += start[:2, None] + wind[:, None] * share * flown
    hump = rng.choice([0.0, 0.0, 1.0]) * rng.normal(0.0, 300.0)
    height = -start[2] + (start[2] - meeting[2]) * share + hump * np.sin(np.pi * share)
    height = np.clip(height, case.limits.altitude_min[who], case.limits.altitude_max[who])
    return _fit(flight, np.stack([flat[0], flat[1], -height]))


def _direction(rng: np.random.Generator) -> Float[np.ndarray, "2"]:
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def _detour(
    a: Float[np.ndarray, "2"], b: Float[np.ndarray, "2"], length: float, radius: float, rng: np.random.Generator
) -> list[Float[np.ndarray, "2"]]:
    """Points between two that make the way about as long as asked."""
    straight = float(np.linalg.norm(b - a))
    if length <= 1.01 * straight:
        return []
    along = (b - a) / straight if straight > 1.0 else _direction(rng)
    across = np.array([-along[1], along[0]])
    middle, half = 0.5 * (a + b), 0.5 * length
    spare, side = length - straight, float(rng.choice([-1.0, 1.0]))
    width = np.sqrt(max(half**2 - 0.25 * straight**2, 0.0))
    kind = rng.random()
    if kind < 0.45:
        angle = rng.uniform(0.0, 2.0 * np.pi) if rng.random() < 0.5 else side * rng.uniform(0.3, 0.7) * np.pi
        return [middle + half * np.cos(angle) * along + width * np.sin(angle) * across]
    if kind < 0.75:
        bends = int(rng.integers(2, 5))
        rise = np.sqrt(max(length**2 - straight**2, 0.0)) / (2.0 * bends)
        steps = (2 * np.arange(bends) + 1) / (2 * bends)
        return [a + s * (b - a) + side * (-1) ** k * rise * across for k, s in enumerate(steps)]
    rounds = int(spare // (2.0 * np.pi * 1.05 * radius))
    if rounds < 1:
        return [middle + side * width * across]
    rounds = int(rng.integers(max(1, rounds - 1), rounds + 1))
    ring = spare / (2.0 * np.pi * rounds)
    place = a + rng.choice([0.0, 1.0, rng.random()]) * (b - a)
    turn = np.linspace(0.0, 2.0 * np.pi * rounds, 16 * rounds + 1)[:, None]
    return list(place + ring * (np.sin(turn) * along + side * (1.0 - np.cos(turn)) * across))


def _fit(flight: SplineFlight, position: Float[np.ndarray, "3 time"]) -> Float[np.ndarray, " unknown"]:
    """Unknowns whose path lies near positions at `flight.seen` and is smooth."""
    basis, slope = flight.P.basis, flight.P.slope.reshape(-1, flight.P.slope.shape[2])
    jerk = np.diff(flight.A.slope, axis=1) * flight.width
    offset = np.diff(flight.fixed @ flight.A.basis, axis=1) * flight.width
    weight = _FIT_WEIGHT * flight.width**4
    jerk = jerk.reshape(-1, jerk.shape[2])
    normal = slope.T @ slope + weight * jerk.T @ jerk
    right = slope.T @ (position - flight.fixed @ basis).ravel() - weight * jerk.T @ offset.ravel()
    return np.linalg.solve(normal + 1e-9 * np.trace(normal) / len(normal) * np.eye(len(normal)), right)
