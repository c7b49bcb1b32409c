"""BeBOT's example of four airliners: its numbers, the task for anser's planner, and a dense check of a plan."""

import math
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

EXAMPLE = Path(__file__).with_name("airliners.toml")
GRAVITY_M_S2 = 9.80665
GRID = 50_001  # times of the dense check: every 0.2 to 0.5 s of a flight


@dataclass(frozen=True)
class Example:
    """The example's numbers; one row per aircraft, columns east and north in the plane of the projection."""

    names: tuple[str, ...]
    start_m: np.ndarray
    goal_m: np.ndarray
    start_velocity_m_s: np.ndarray
    goal_velocity_m_s: np.ndarray
    speed_min_m_s: float
    speed_max_m_s: float
    turn_rate_max_rad_s: float
    separation_m: float
    degree: int
    elevation: int
    cost_tolerance_s: float
    iterations_max: int


@dataclass(frozen=True)
class Request:
    """The example for anser's planner: NED, one row per aircraft, level flight at one altitude.

    The origin is the middle of the map. The source has no altitude: 10,000 m represents a typical cruise. The bank
    limit follows from the turn-rate limit at the lowest speed, g tan(bank) = V omega, so that every turn is within the
    source's limit at every speed; the load factor belongs to this bank. Each aircraft arrives as early as possible.
    """

    names: tuple[str, ...]
    start_n: np.ndarray
    start_velocity_n: np.ndarray
    goal_n: np.ndarray
    goal_velocity_n: np.ndarray
    speed_min: float
    speed_max: float
    bank_max: float
    load_factor_max: float
    separation: float


def load_example(path: Path = EXAMPLE) -> Example:
    """Read the example and project its cities onto the plane."""
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    radius, limits, method, aircraft = (table[key] for key in ("projection", "limits", "method", "aircraft"))

    def project(city: str) -> tuple[float, float]:
        longitude, latitude = np.radians(table["cities"][city])
        return radius["radius_m"] * longitude, radius["radius_m"] * math.atanh(math.sin(latitude))

    def velocity(state: dict[str, float]) -> tuple[float, float]:
        course = math.radians(state["course_deg"])
        return state["speed_m_s"] * math.sin(course), state["speed_m_s"] * math.cos(course)

    return Example(
        names=tuple(entry["name"] for entry in aircraft),
        start_m=np.array([project(entry["from"]) for entry in aircraft]),
        goal_m=np.array([project(entry["to"]) for entry in aircraft]),
        start_velocity_m_s=np.array([velocity(entry["start"]) for entry in aircraft]),
        goal_velocity_m_s=np.array([velocity(entry["arrival"]) for entry in aircraft]),
        **limits,
        **method,
    )


def map_middle(example: Example) -> np.ndarray:
    """Middle of the map, (east, north), m: the origin of the NED frame."""
    positions = np.concatenate([example.start_m, example.goal_m])
    return (positions.max(axis=0) + positions.min(axis=0)) / 2


def our_request(example: Example, altitude_m: float = 10_000.0) -> Request:
    """Convert the example for anser's planner."""
    middle = map_middle(example)
    bank_max = math.atan(example.speed_min_m_s * example.turn_rate_max_rad_s / GRAVITY_M_S2)

    def ned(east_north: np.ndarray, down: float) -> np.ndarray:
        return np.column_stack([east_north[:, ::-1], np.full(len(east_north), down)])

    return Request(
        names=example.names,
        start_n=ned(example.start_m - middle, -altitude_m),
        start_velocity_n=ned(example.start_velocity_m_s, 0.0),
        goal_n=ned(example.goal_m - middle, -altitude_m),
        goal_velocity_n=ned(example.goal_velocity_m_s, 0.0),
        speed_min=example.speed_min_m_s,
        speed_max=example.speed_max_m_s,
        bank_max=bank_max,
        load_factor_max=1.0 / math.cos(bank_max),
        separation=example.separation_m,
    )


@dataclass(frozen=True)
class Flown:
    """A plan of any method, in the format of the dense check."""

    durations_s: np.ndarray
    state: Callable[[int, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]
    """Aircraft and times (n,), s, to position, velocity and acceleration (n, 2) in the plane, in metres and seconds."""


def flown_from_ned(
    example: Example,
    durations_s: np.ndarray,
    state_n: Callable[[int, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]],
) -> Flown:
    """Convert a plan of anser's planner, given by position, velocity and acceleration (n, 3), NED, at times (n,)."""
    middle = map_middle(example)

    def state(i: int, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        position, velocity, acceleration = (np.asarray(values)[:, 1::-1] for values in state_n(i, times))
        return position + middle, velocity, acceleration

    return Flown(np.asarray(durations_s), state)


@dataclass(frozen=True)
class Extremes:
    """Extremes of a plan on a dense grid."""

    speed_min_m_s: float
    speed_max_m_s: float
    turn_rate_max_rad_s: float
    separation_min_m: float
    end_position_error_m: float
    end_velocity_error_m_s: float


def dense_extremes(example: Example, flown: Flown, grid: int = GRID) -> Extremes:
    """Sample every flight, and every pair until its earlier arrival, at `grid` equally spaced times."""
    slowest, fastest, turn_rate_max, position_error, velocity_error = math.inf, 0.0, 0.0, 0.0, 0.0
    for i, duration in enumerate(flown.durations_s):
        position, velocity, acceleration = flown.state(i, np.linspace(0.0, duration, grid))
        speed = np.linalg.norm(velocity, axis=1)
        across = velocity[:, 0] * acceleration[:, 1] - velocity[:, 1] * acceleration[:, 0]
        slowest, fastest = min(slowest, speed.min()), max(fastest, speed.max())
        turn_rate_max = max(turn_rate_max, np.abs(across / speed**2).max())
        required_states = (
            (example.start_m[i], example.goal_m[i]),
            (example.start_velocity_m_s[i], example.goal_velocity_m_s[i]),
        )
        position_error = max(position_error, *np.linalg.norm(position[[0, -1]] - required_states[0], axis=1))
        velocity_error = max(velocity_error, *np.linalg.norm(velocity[[0, -1]] - required_states[1], axis=1))
    separation_min = math.inf
    for i, j in combinations(range(len(flown.durations_s)), 2):
        times = np.linspace(0.0, min(flown.durations_s[[i, j]]), grid)
        separation_min = min(
            separation_min, np.linalg.norm(flown.state(i, times)[0] - flown.state(j, times)[0], axis=1).min()
        )
    return Extremes(*map(float, (slowest, fastest, turn_rate_max, separation_min, position_error, velocity_error)))


def broken_limits(example: Example, extremes: Extremes, speed_tolerance_m_s: float) -> list[str]:
    """Names of the violated limits of a plan.

    The end states are exact except for rounding: 1e-9 of the map's 1e7 m, and a velocity is a difference of positions
    over 2,000 s or more. The other limits have no tolerance except the caller's tolerance of the speed.
    """
    checks = (
        ("lowest speed", extremes.speed_min_m_s, ">=", example.speed_min_m_s, speed_tolerance_m_s, "m/s"),
        ("highest speed", extremes.speed_max_m_s, "<=", example.speed_max_m_s, speed_tolerance_m_s, "m/s"),
        ("turn rate", extremes.turn_rate_max_rad_s, "<=", example.turn_rate_max_rad_s, 0.0, "rad/s"),
        ("separation", extremes.separation_min_m, ">=", example.separation_m, 0.0, "m"),
        ("position at the ends", extremes.end_position_error_m, "<=", 0.0, 1e-2, "m off"),
        ("velocity at the ends", extremes.end_velocity_error_m_s, "<=", 0.0, 1e-6, "m/s off"),
    )
    return [
        f"{name}: {value:.6g} {unit}, limit {limit:.6g}"
        for name, value, sense, limit, tolerance, unit in checks
        if (limit - value if sense == ">=" else value - limit) > tolerance
    ]
