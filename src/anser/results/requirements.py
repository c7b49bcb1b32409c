"""What a scenario asks of a flight, and whether the flight met it."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from anser.scenario.schema import Scenario

_Row = Mapping[str, Any]


def _of_all(key: str) -> Callable[[Sequence[_Row], _Row], list[float | None]]:
    return lambda aircraft, fleet: [row[key] for row in aircraft]


def _of_fleet(key: str) -> Callable[[Sequence[_Row], _Row], list[float | None]]:
    return lambda aircraft, fleet: [fleet[key]]


def _arrival_errors(aircraft: Sequence[_Row], fleet: _Row) -> list[float | None]:
    pairs = [(row["arrival_s"], row["planned_arrival_s"]) for row in aircraft]
    return [None if flown is None or planned is None else abs(flown - planned) for flown, planned in pairs]


def _of_pairs(key: str) -> Callable[[Sequence[_Row], _Row], list[float | None]]:
    # One aircraft alone has no separation to lose.
    return lambda aircraft, fleet: [] if len(aircraft) == 1 else [fleet.get(key)]


# Greatest (or least) value over these numbers must not exceed (or fall below) the limit.
_AT_MOST = {
    "miss_max_m": _of_all("miss_m"),
    "arrival_error_max_s": _arrival_errors,
    "arrival_spread_max_s": _of_fleet("arrival_spread_s"),
    "position_error_max_m": _of_all("position_error_max_m"),
    "speed_max_m_s": _of_all("speed_max_m_s"),
    "tables_left_max_s": _of_all("tables_left_s"),
}
_AT_LEAST = {
    "separation_ratio_min": _of_pairs("separation_ratio_min"),
    "separation_min_m": _of_pairs("separation_min_m"),
    "clearance_min_m": _of_all("clearance_min_m"),
    "speed_min_m_s": _of_all("speed_min_m_s"),
}

REQUIREMENT_NAMES: tuple[str, ...] = (*_AT_MOST, *_AT_LEAST)
"""Names that a scenario may require; `max` and `min` in a name say on which side of the limit the flight must stay."""


@dataclass(frozen=True)
class Requirement:
    """A limit that a flight must keep.

    Attributes
    ----------
    name
        One of `REQUIREMENT_NAMES`, which ends with the unit.
    limit
        In that unit.
    own
        The limit of each aircraft where they differ; that with the least margin is told.
    """

    name: str
    limit: float
    aircraft_limits: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        if self.name not in REQUIREMENT_NAMES:
            raise ValueError(f"requirement {self.name!r} is unknown; known are {', '.join(REQUIREMENT_NAMES)}")


def scenario_requirements(scenario: Scenario) -> tuple[Requirement, ...]:
    """What a scenario asks of a flight besides the distances from its goals."""
    wanted, limits = scenario.requirements, [scenario.limits_for(one) for one in scenario.aircraft]
    slowest, fastest = tuple(one.speed_min_m_s for one in limits), tuple(one.speed_max_m_s for one in limits)
    asked = {
        "miss_max_m": wanted.miss_max_m,
        "arrival_spread_max_s": wanted.arrival_spread_max_s if scenario.arrival.is_common else None,
        "speed_min_m_s": min(slowest),
        "speed_max_m_s": max(fastest),
        "position_error_max_m": wanted.position_error_max_m,
        "separation_min_m": wanted.separation_min_m,
        "separation_ratio_min": None if scenario.separation.required_m is None else 1.0,
    }
    own = {"speed_min_m_s": slowest, "speed_max_m_s": fastest}
    differ = {name: limits for name, limits in own.items() if len(set(limits)) > 1}
    return tuple(Requirement(name, limit, differ.get(name)) for name, limit in asked.items() if limit is not None)


def evaluate_requirements(
    requirements: Sequence[Requirement],
    aircraft: Sequence[_Row],
    fleet: _Row,
    clearances: Sequence[tuple[str, float]],
) -> list[dict[str, Any]]:
    """Judge a flight: one entry {name, limit, value, met} for each requirement and for each kind of goal.

    Parameters
    ----------
    requirements
        What the scenario asks.
    aircraft, fleet
        The summary's rows of the aircraft, and its numbers of the fleet.
    clearances
        Kind of goal and least clearance, m, of each aircraft. Of each kind the aircraft with the least margin counts.

    Returns
    -------
    list
        `value` is the worst of the fleet. It is None, and the requirement not met, where an aircraft lacks the number;
        separation is met by an aircraft that flies alone.
    """
    judged = [_evaluate_requirement(requirement, aircraft, fleet) for requirement in requirements]
    for kind in dict.fromkeys(kind for kind, _ in clearances):
        values = [
            (row["clearance_min_m"], limit) for row, (of, limit) in zip(aircraft, clearances, strict=True) if of == kind
        ]
        lacking = [pair for pair in values if pair[0] is None]
        value, limit = lacking[0] if lacking else min(values, key=lambda pair: pair[0] - pair[1])
        judged.append(_entry(f"clearance_{kind}_min_m", limit, value, value is not None and value >= limit))
    return judged


def _evaluate_requirement(requirement: Requirement, aircraft: Sequence[_Row], fleet: _Row) -> dict[str, Any]:
    name, limit = requirement.name, requirement.limit
    at_most = name in _AT_MOST
    if requirement.aircraft_limits is not None:
        pairs = [
            (row[name], own)
            for row, own in zip(aircraft, requirement.aircraft_limits, strict=True)
            if "left_s" not in row
        ]
        if not pairs:
            return _entry(name, limit, None, True)
        worst = min(
            pairs, key=lambda pair: -math.inf if pair[0] is None else (pair[1] - pair[0]) * (1 if at_most else -1)
        )
        value, limit = worst
        met = value is not None and (value <= limit if at_most else value >= limit)
        return _entry(name, limit, value, met)
    staying = [row for row in aircraft if "left_s" not in row]  # nothing is asked of one that has left the fleet
    values = (_AT_MOST if at_most else _AT_LEAST)[name](staying, fleet)
    if not values:
        return _entry(name, limit, None, True)
    numbers = [value for value in values if value is not None]
    if len(numbers) < len(values):
        return _entry(name, limit, None, False)
    value = max(numbers) if at_most else min(numbers)
    return _entry(name, limit, value, value <= limit if at_most else value >= limit)


def _entry(name: str, limit: float, value: float | None, met: bool) -> dict[str, Any]:
    return {"name": name, "limit": limit, "value": value, "met": met}
