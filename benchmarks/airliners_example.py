"""BeBOT's example of four airliners: its numbers, the same asked of our planner, and a dense check of a plan."""

import math
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

EXAMPLE = Path(__file__).with_name("airliners.toml")
GRAVITY_M_S2 = 9.80665
GRID = 50_001  # instants of the dense check: one each 0.2 to 0.5 s of a flight


@dataclass(frozen=True)
class Example:
    """The example's numbers; one row for each aircraft, columns east and north in the plane of the projection."""

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
    """The same example as our planner asks for it: NED, one row for each aircraft, level flight at one altitude.

    The origin is the middle of the map. The source has no altitude: 10,000 m stands for a usual cruise. The bank limit
    is that of the turn-rate limit at the lowest speed, g tan(bank) = V omega, so no turn at any speed of the window is
    faster than the source allows; the load factor is that of this bank. Each aircraft is to arrive as early as it can.
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
    """Read the example and project its cities on the plane."""
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    radius, limits, method, aircraft = (table[key] for key in ("projection", "limits", "method", "aircraft"))

    def place(city: str) -> tuple[float, float]:
        longitude, latitude = np.radians(table["cities"][city])
        return radius["radius_m"] * longitude, radius["radius_m"] * math.atanh(math.sin(latitude))

    def velocity(state: dict[str, float]) -> tuple[float, float]:
        course = math.radians(state["course_deg"])
        return state["speed_m_s"] * math.sin(course), state["speed_m_s"] * math.cos(course)

    return Example(
        names=tuple(one["name"] for one in aircraft),
        start_m=np.array([place(one["from"]) for one in aircraft]),
        goal_m=np.array([place(one["to"]) for one in aircraft]),
        start_velocity_m_s=np.array([velocity(one["start"]) for one in aircraft]),
        goal_velocity_m_s=np.array([velocity(one["arrival"]) for one in aircraft]),
        **limits,
        **method,
    )


def map_middle(example: Example) -> np.ndarray:
    """Middle of the map, (east, north), m: the origin of our NED frame."""
    places = np.concatenate([example.start_m, example.goal_m])
    return (places.max(axis=0) + places.min(axis=0)) / 2


def our_request(example: Example, altitude_m: float = 10_000.0) -> Request:
    """State the example for our planner."""
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
    """A plan, by whatever method, as the dense check reads it."""

    durations_s: np.ndarray
    state: Callable[[int, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]
    """Aircraft and times (n,), s, to position, velocity and acceleration (n, 2) in the plane, in metres and seconds."""


def flown_from_ned(
    example: Example,
    durations_s: np.ndarray,
    state_n: Callable[[int, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]],
) -> Flown:
    """Read a plan of our planner: its position, velocity and acceleration (n, 3), NED, of an aircraft at times (n,)."""
    middle = map_middle(example)

    def state(i: int, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        position, velocity, acceleration = (np.asarray(one)[:, 1::-1] for one in state_n(i, times))
        return position + middle, velocity, acceleration

    return Flown(np.asarray(durations_s), state)


@dataclass(frozen=True)
class Extremes:
    """What a plan asks at most, on a dense grid."""

    speed_min_m_s: float
    speed_max_m_s: float
    turn_rate_max_rad_s: float
    separation_min_m: float
    end_position_error_m: float
    end_velocity_error_m_s: float


def dense_extremes(example: Example, flown: Flown, grid: int = GRID) -> Extremes:
    """Sample every flight, and every pair until the earlier of its arrivals, at `grid` equal instants with the ends."""
    slowest, fastest, turning, place_error, velocity_error = math.inf, 0.0, 0.0, 0.0, 0.0
    for i, duration in enumerate(flown.durations_s):
        position, velocity, acceleration = flown.state(i, np.linspace(0.0, duration, grid))
        speed = np.linalg.norm(velocity, axis=1)
        across = velocity[:, 0] * acceleration[:, 1] - velocity[:, 1] * acceleration[:, 0]
        slowest, fastest = min(slowest, speed.min()), max(fastest, speed.max())
        turning = max(turning, np.abs(across / speed**2).max())
        wanted = (example.start_m[i], example.goal_m[i]), (example.start_velocity_m_s[i], example.goal_velocity_m_s[i])
        place_error = max(place_error, *np.linalg.norm(position[[0, -1]] - wanted[0], axis=1))
        velocity_error = max(velocity_error, *np.linalg.norm(velocity[[0, -1]] - wanted[1], axis=1))
    apart = math.inf
    for i, j in combinations(range(len(flown.durations_s)), 2):
        times = np.linspace(0.0, min(flown.durations_s[[i, j]]), grid)
        apart = min(apart, np.linalg.norm(flown.state(i, times)[0] - flown.state(j, times)[0], axis=1).min())
    return Extremes(*map(float, (slowest, fastest, turning, apart, place_error, velocity_error)))


def broken_limits(example: Example, found: Extremes, speed_tolerance_m_s: float) -> list[str]:
    """Name each limit that a plan breaks.

    The ends are exact but for rounding: 1e-9 of the map's 1e7 m, and a velocity is a difference of such places over
    2,000 s or more. The other limits have no tolerance but what the caller grants the speed.
    """
    checks = (
        ("lowest speed", found.speed_min_m_s, ">=", example.speed_min_m_s, speed_tolerance_m_s, "m/s"),
        ("highest speed", found.speed_max_m_s, "<=", example.speed_max_m_s, speed_tolerance_m_s, "m/s"),
        ("turn rate", found.turn_rate_max_rad_s, "<=", example.turn_rate_max_rad_s, 0.0, "rad/s"),
        ("separation", found.separation_min_m, ">=", example.separation_m, 0.0, "m"),
        ("position at the ends", found.end_position_error_m, "<=", 0.0, 1e-2, "m off"),
        ("velocity at the ends", found.end_velocity_error_m_s, "<=", 0.0, 1e-6, "m/s off"),
    )
    return [
        f"{name}: {value:.6g} {unit}, limit {limit:.6g}"
        for name, value, sense, limit, tolerance, unit in checks
        if (limit - value if sense == ">=" else value - limit) > tolerance
    ]
