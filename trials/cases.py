"""Random planning tasks by seed, with every arrival rule; about a fifth of them are impossible."""

import numpy as np

from trials.data import (
    ArrivalRule,
    FleetLimits,
    Goals,
    KeepOutCylinders,
    PlanCase,
    Starts,
    WindProfile,
)

__all__ = ["random_case"]

_BOX_M = 30_000.0
_GRAVITY = 9.80665


def random_case(seed: int) -> PlanCase:
    """Draw the task of a seed: 2 to 8 aircraft in a box of 30 km.

    Notes
    -----
    Altitudes 500 to 5,000 m, speeds 110 to 200 m/s, wind none, steady up to 20 m/s or in 2 to 4 layers, separation up
    to 1,500 m / 300 m, up to 4 keep-outs, bank limits 25 to 60 deg, climb limits 10 to 60 m/s, every arrival rule. No
    aircraft starts in conflict, in a keep-out or outside its limits; the rest of the task may be impossible.
    """
    rng = np.random.default_rng([5, seed])
    size = int(rng.integers(2, 9))
    wind = _wind(rng)
    keep_outs = _keep_outs(rng)
    horizontal = 0.0 if rng.random() < 0.15 else float(rng.uniform(200.0, 1500.0))
    vertical = float(rng.uniform(150.0, 300.0))
    starts, speeds = _starts(rng, size, wind, keep_outs, (horizontal, vertical))
    limits = _limits(rng, speeds, starts)
    goals = _goals(rng, size, max(horizontal, 200.0))
    rule = _rule(rng, starts, goals, limits)
    fleet_speed = float(
        np.clip(np.median(speeds), limits.speed_min.max(), max(limits.speed_max.min(), limits.speed_min.max()))
    )
    return PlanCase(starts, goals, limits, wind, keep_outs, horizontal, vertical, rule, fleet_speed, _GRAVITY, seed)


def _wind(rng: np.random.Generator) -> WindProfile:
    kind = rng.random()
    count = 1 if kind < 0.6 else int(rng.integers(2, 5))
    speed = np.zeros(1) if kind < 0.3 else rng.uniform(0.0, 20.0, count)
    toward = rng.uniform(0.0, 2.0 * np.pi) + rng.uniform(-0.7, 0.7, count)
    altitudes = np.sort(rng.uniform(300.0, 5000.0, count)) + 300.0 * np.arange(count)
    return WindProfile(altitudes, np.stack([speed * np.cos(toward), speed * np.sin(toward), np.zeros(count)], axis=1))


def _keep_outs(rng: np.random.Generator) -> KeepOutCylinders:
    count = int(rng.integers(0, 5))
    moving = rng.random(count) < 0.5
    speed, course = moving * rng.uniform(5.0, 20.0, count), rng.uniform(0.0, 2.0 * np.pi, count)
    whole = rng.random(count) < 0.6
    bottom = np.where(whole, -100.0, rng.uniform(0.0, 2500.0, count))
    return KeepOutCylinders(
        rng.uniform(0.1, 0.9, (count, 2)) * _BOX_M,
        np.stack([speed * np.cos(course), speed * np.sin(course)], axis=1),
        rng.uniform(500.0, 4000.0, count) * rng.uniform(0.4, 1.0, count),
        bottom,
        np.where(whole, 20_000.0, bottom + rng.uniform(800.0, 3000.0, count)),
    )


def _starts(
    rng: np.random.Generator, size: int, wind: WindProfile, keep_outs: KeepOutCylinders, separation: tuple[float, float]
) -> tuple[Starts, np.ndarray]:
    """Level starts with distance from each other and from keep-outs, and the airspeeds."""
    speeds = rng.uniform(110.0, 200.0, size)
    if rng.random() < 0.4:
        speeds = np.clip(speeds.mean() + rng.uniform(-3.0, 3.0, size), 110.0, 200.0)
    heading = rng.uniform(0.0, 2.0 * np.pi, size)
    velocity = np.stack([speeds * np.cos(heading), speeds * np.sin(heading), np.zeros(size)], axis=1)
    room_flat, room_up = 1.5 * separation[0] + 300.0, separation[1] + 50.0
    placed: list[np.ndarray] = []
    while len(placed) < size:
        candidate = np.array([*(rng.random(2) * _BOX_M), -rng.uniform(700.0, 4800.0)])
        next_positions = velocity[len(placed)] * np.array([0.0, 10.0, 20.0])[:, None] + candidate
        is_close = any(
            np.hypot(*(candidate - p)[:2]) < room_flat and abs(candidate[2] - p[2]) < room_up for p in placed
        )
        stamps = np.array([0.0, 10.0, 20.0])
        blocked = any(
            np.any(keep_outs.clearance(k, stamps, next_positions.T) < 300.0) for k in range(keep_outs.radius.size)
        )
        if not is_close and not blocked:
            placed.append(candidate)
    positions = np.array(placed)
    velocity = velocity + wind.at(-positions[:, 2]).T
    return Starts(0.0, positions, velocity, np.zeros((size, 3))), speeds


def _limits(rng: np.random.Generator, speeds: np.ndarray, starts: Starts) -> FleetLimits:
    size = speeds.size
    narrow = rng.random() < 0.35
    below, above = (rng.uniform(2.0, 10.0, (2, size))) if narrow else rng.uniform(15.0, 60.0, (2, size))
    altitude = -starts.position_n[:, 2]
    ones = np.ones(size)
    bank = ones * rng.uniform(np.deg2rad(25.0), np.deg2rad(60.0))
    return FleetLimits(
        speed_min=np.minimum(np.maximum(speeds - below, 95.0), speeds - 2.0),
        speed_max=np.minimum(speeds + above, 240.0),
        bank_max=bank,
        climb_rate_max=ones * rng.uniform(10.0, 60.0) ** rng.uniform(0.85, 1.0),
        altitude_min=np.minimum(ones * rng.uniform(200.0, 600.0), altitude - 100.0),
        altitude_max=np.maximum(ones * rng.uniform(4500.0, 7000.0), altitude + 100.0),
        load_factor_max=1.05 / np.cos(bank) + rng.uniform(0.0, 1.5),
        acceleration_max=ones * rng.uniform(0.8, 3.0),
        deceleration_max=ones * rng.uniform(0.8, 3.0),
    )


def _goals(rng: np.random.Generator, size: int, spacing: float) -> Goals:
    """Goals across the whole box, or close together, or one common goal with neighbouring rendezvous points."""
    kind = rng.random()
    if kind < 0.5:
        positions = rng.random((size, 2)) * _BOX_M
    else:
        spread = rng.uniform(0.5, 3.0) * spacing * np.sqrt(size)
        positions = rng.uniform(0.2, 0.8, 2) * _BOX_M + rng.uniform(-1.0, 1.0, (size, 2)) * spread
    levels = rng.uniform(300.0, 2000.0) + rng.uniform(150.0, 350.0) * np.arange(size)
    altitude = rng.uniform(300.0, 4300.0, size) if rng.random() < 0.6 else levels
    moving = rng.random() < 0.6
    speed, course = moving * rng.uniform(0.0, 30.0, size), rng.uniform(0.0, 2.0 * np.pi, size)
    if kind >= 0.5:
        speed, course = np.full(size, speed[0]), np.full(size, course[0])
    prescribed = rng.random(size) < rng.choice([0.0, 0.3, 1.0])
    return Goals(
        times=np.zeros((size, 1)),
        positions_n=np.concatenate([positions, -altitude[:, None]], axis=1)[:, None],
        velocity_after_n=np.stack([speed * np.cos(course), speed * np.sin(course), np.zeros(size)], axis=1),
        stand_off_n=np.tile([0.0, 0.0, -300.0], (size, 1)),
        course=np.where(prescribed, rng.uniform(0.0, 2.0 * np.pi, size), np.nan),
        path_angle=np.where(prescribed & (rng.random(size) < 0.3), 0.0, np.nan),
    )


def _rule(rng: np.random.Generator, starts: Starts, goals: Goals, limits: FleetLimits) -> ArrivalRule:
    """A random rule; times are flight times of straight lines, times a factor from barely possible to long."""
    size = starts.position_n.shape[0]
    name = str(rng.choice(["together", "earliest", "at", "sequence", "times", "windows"]))
    direct = np.linalg.norm(goals.positions_n[:, 0, :2] - starts.position_n[:, :2], axis=1)
    speed = 0.5 * (limits.speed_min + limits.speed_max)
    climb = np.abs(goals.positions_n[:, 0, 2] - 300.0 - starts.position_n[:, 2]) / limits.climb_rate_max
    turn = 0.35 * np.pi * speed / (_GRAVITY * np.tan(limits.bank_max))
    required_times = np.maximum(direct / speed + turn, climb + 5.0)
    times, windows = np.full(size, np.nan), np.full((size, 2), np.nan)
    order = np.arange(size)
    spacing = float("nan")
    factor = 1.0 + rng.exponential(0.5, size) + rng.choice([-0.1, 0.1, 0.4])
    if name == "at":
        times = np.full(size, np.round(factor[0] * required_times.max(), 1))
    elif name == "times":
        times = np.round(factor * required_times, 1)
    elif name == "windows":
        early = np.round(factor * required_times, 1)
        windows = np.stack([early, early + np.round(rng.uniform(2.0, 60.0, size), 1)], axis=1)
    elif name == "sequence":
        spacing, order = float(np.round(rng.uniform(5.0, 60.0), 1)), rng.permutation(size)
    return ArrivalRule(name, times, windows, spacing, order)
