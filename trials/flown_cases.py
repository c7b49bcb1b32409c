"""Tasks derived from a random fleet's flight: feasible by construction, to measure the success rate of a search."""

from itertools import combinations

import numpy as np
from jaxtyping import Float

from trials.data import (
    ArrivalRule,
    FleetLimits,
    Goals,
    KeepOutCylinders,
    PlanCase,
    Starts,
    WindProfile,
)
from trials.motion import path_demands

__all__ = ["flown_case"]

_STEP = 0.05
"""Time step of the flown trajectories, s."""
_GRAVITY = 9.80665


def flown_case(seed: int) -> PlanCase:
    """Task with a known solution: a random fleet's flight gives starts, goals, times, limits and separation.

    Notes
    -----
    Each aircraft flies random bank angles, climbs and speeds, sometimes nearly straight, so that its arrival time
    leaves little slack. Each limit exceeds the flown maximum by 3 to 50 % (of the margin to steady level flight);
    separation and keep-outs take 60 to 97 % of the distances in the fleet's flight. The arrival times are the flown
    times, as a common time, individual times, windows or a sequence.
    """
    rng = np.random.default_rng([6, seed])
    size = int(rng.integers(2, 9))
    layers = int(rng.integers(1, 5))
    toward = rng.uniform(0.0, 2.0 * np.pi) + rng.uniform(-0.7, 0.7, layers)
    speed = rng.uniform(0.0, 20.0, layers) * (rng.random() < 0.7)
    altitudes = np.sort(rng.uniform(300.0, 5000.0, layers)) + 300.0 * np.arange(layers)
    wind = WindProfile(altitudes, np.stack([speed * np.cos(toward), speed * np.sin(toward), np.zeros(layers)], axis=1))
    rule = str(rng.choice(["at", "times", "windows", "sequence"]))
    longest = rng.uniform(80.0, 320.0)
    flown = np.full(size, longest) if rule == "at" else longest * rng.uniform(0.6, 1.0, size)
    if rule == "sequence":
        flown = longest - rng.uniform(3.0, 10.0) * np.arange(size)
    flown = np.round(flown / _STEP) * _STEP
    bank = rng.uniform(np.deg2rad(18.0), np.deg2rad(50.0))
    box = rng.uniform(1500.0, 8000.0)
    tracks = [_fly(rng, wind, t, bank * rng.choice([0.1, 0.4, 1.0]), box) for t in flown]
    slack = rng.uniform(0.03, 0.5)
    limits = _limits(tracks, wind, slack)
    positions = [p for p, _, _ in tracks]
    horizontal, vertical = _separation(rng, positions)
    motion = rng.uniform(-20.0, 20.0, (size, 2)) * (rng.random() < 0.6)
    end_positions = np.array([p[-1] for p in positions])
    velocity = np.concatenate([motion, np.zeros((size, 1))], axis=1)
    has_course = rng.random(size) < rng.choice([0.0, 0.5])
    course = np.array([np.arctan2(v[-1, 1], v[-1, 0]) for _, v, _ in tracks])
    stand_off = np.tile([0.0, 0.0, -300.0], (size, 1))
    nan = np.full(size, np.nan)
    goals = Goals(
        np.zeros((size, 1)),
        (end_positions - velocity * flown[:, None] - stand_off)[:, None],
        velocity,
        stand_off,
        np.where(has_course, course, np.nan),
        nan,
    )
    spacing = float(flown[-2] - flown[-1]) if rule == "sequence" else float("nan")
    early_margin = rng.uniform(0.0, 10.0, size)
    windows = np.stack([flown - early_margin, flown + rng.uniform(0.0, 10.0, size)], axis=1)
    arrival = ArrivalRule(
        rule,
        flown if rule in ("at", "times") else nan,
        windows if rule == "windows" else np.full((size, 2), np.nan),
        spacing,
        np.arange(size)[::-1].copy(),
    )
    starts = Starts(0.0, *(np.array([track[k][0] for track in tracks]) for k in range(3)))
    keep_outs = _keep_outs(rng, positions)
    middle = float(np.mean(0.5 * (limits.speed_min + limits.speed_max)))
    return PlanCase(starts, goals, limits, wind, keep_outs, horizontal, vertical, arrival, middle, _GRAVITY, seed)


def _fly(
    rng: np.random.Generator, wind: WindProfile, flown: float, bank_max: float, box: float
) -> tuple[np.ndarray, ...]:
    """Position, velocity and acceleration over the ground every _STEP (time, 3); steady for the first second."""
    count = round(flown / _STEP) + 1
    times = _STEP * np.arange(count)
    nodes = np.concatenate([[0.0, 1.0], np.cumsum(rng.uniform(6.0, 30.0, int(flown / 6.0) + 2)) + 1.0])

    def wander(size: float) -> Float[np.ndarray, " time"]:
        values = rng.uniform(-size, size, nodes.size)
        values[:2] = 0.0
        return np.interp(times, nodes, values)

    speed = rng.uniform(125.0, 185.0) + wander(rng.uniform(1.0, 20.0))
    gamma = wander(rng.uniform(0.0, 0.12))
    turn_rate = _GRAVITY * np.tan(wander(bank_max)) / speed
    course = rng.uniform(0.0, 2.0 * np.pi) + np.concatenate(
        [[0.0], np.cumsum(0.5 * _STEP * (turn_rate[1:] + turn_rate[:-1]))]
    )
    height = np.concatenate([[0.0], np.cumsum((speed * np.sin(gamma))[:-1] * _STEP)])
    low, high = 500.0 - height.min(), 5000.0 - height.max()
    height += rng.uniform(low, max(high, low + 1.0))
    air = np.stack([np.cos(gamma) * np.cos(course), np.cos(gamma) * np.sin(course), -np.sin(gamma)]) * speed
    velocity = air + wind.at(height)
    acceleration = np.gradient(velocity, _STEP, axis=1)
    moved = np.concatenate(
        [np.zeros((3, 1)), np.cumsum(0.5 * _STEP * (velocity[:, 1:] + velocity[:, :-1]), axis=1)], axis=1
    )
    start_position = np.array([*(rng.uniform(-box, box, 2) - 0.5 * moved[:2, -1]), -height[0]])
    return (start_position[:, None] + moved).T, velocity.T, acceleration.T


def _limits(tracks: list[tuple[np.ndarray, ...]], wind: WindProfile, slack: float) -> FleetLimits:
    """Limits slightly wider than each aircraft's flight."""
    limit_rows = []
    for position, velocity, acceleration in tracks:
        demands = path_demands(velocity.T, acceleration.T, wind.at(-position[:, 2]), _GRAVITY)
        width = float(np.ptp(demands.speed)) * slack + 0.5
        heights = -position[:, 2]
        height_margin = float(np.ptp(heights)) * slack + 20.0
        bank = float(np.max(np.abs(np.arctan2(demands.side, demands.normal))))
        load = float(np.max(np.hypot(demands.side, demands.normal))) / _GRAVITY
        limit_rows.append([
            demands.speed.min() - width, demands.speed.max() + width, min(bank * (1.0 + slack), 1.3),
            np.abs(demands.climb_rate).max() * (1.0 + slack) + 0.5,
            heights.min() - height_margin, heights.max() + height_margin,
            1.0 + (load - 1.0) * (1.0 + slack) + 0.02,
            max(demands.along.max(), 0.0) * (1.0 + slack) + 0.05, max(-demands.along.min(), 0.0) * (1.0 + slack) + 0.05,
        ])  # fmt: skip
    low, high, bank, climb, floor, ceiling, load, faster, slower = np.array(limit_rows).T
    return FleetLimits(low, high, bank, climb, floor, ceiling, load, faster, slower)


def _separation(rng: np.random.Generator, positions: list[np.ndarray]) -> tuple[float, float]:
    """Separation satisfied by the fleet's flight, with a margin; none if the aircraft come too close."""
    vertical = float(rng.uniform(150.0, 300.0))
    distance_min = np.inf
    for first_path, second_path in combinations(positions, 2):
        offset = first_path[: len(second_path)] - second_path[: len(first_path)]
        close = np.abs(offset[:, 2]) < vertical + 5.0
        if close.any():
            distance_min = min(distance_min, float(np.min(np.hypot(offset[close, 0], offset[close, 1]))))
    horizontal = min(distance_min * float(rng.uniform(0.6, 0.97)), 1500.0)
    return (horizontal, vertical) if horizontal >= 20.0 else (0.0, vertical)


def _keep_outs(rng: np.random.Generator, positions: list[np.ndarray]) -> KeepOutCylinders:
    """Cylinders near the paths, at rest or moving, most of the way to the nearest aircraft."""
    count = int(rng.integers(0, 5))
    centres, speeds, radii = [], [], []
    for _ in range(count):
        centre, velocity = rng.uniform(-9000.0, 9000.0, 2), rng.uniform(-12.0, 12.0, 2) * (rng.random() < 0.5)
        nearest = min(
            float(np.min(np.linalg.norm(p[:, :2] - centre - velocity * (_STEP * np.arange(len(p)))[:, None], axis=1)))
            for p in positions
        )
        centres.append(centre)
        speeds.append(velocity)
        radii.append(min(nearest * float(rng.uniform(0.6, 0.97)), 4000.0))
    return KeepOutCylinders(
        np.array(centres).reshape(-1, 2),
        np.array(speeds).reshape(-1, 2),
        np.array(radii),
        np.full(count, -100.0),
        np.full(count, 20_000.0),
    )
