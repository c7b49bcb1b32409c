"""Requirements of a scenario on a flight, and the evaluation of a flight against its requirements."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from anser.scenario.schema import Scenario

_Entry = Mapping[str, Any]


def _aircraft_values(key: str) -> Callable[[Sequence[_Entry], _Entry], list[float | None]]:
    return lambda aircraft, fleet: [entry[key] for entry in aircraft]


def _fleet_value(key: str) -> Callable[[Sequence[_Entry], _Entry], list[float | None]]:
    return lambda aircraft, fleet: [fleet.get(key)]


def _arrival_errors(aircraft: Sequence[_Entry], fleet: _Entry) -> list[float | None]:
    pairs = [(entry["arrival_s"], entry["planned_arrival_s"]) for entry in aircraft]
    return [None if arrival is None or planned is None else abs(arrival - planned) for arrival, planned in pairs]


# The maximum (minimum) of the values must not exceed (fall below) the limit.
_AT_MOST = {
    "miss_max_m": _aircraft_values("miss_m"),
    "arrival_error_max_s": _arrival_errors,
    "arrival_spread_max_s": _fleet_value("arrival_spread_s"),
    "position_error_max_m": _aircraft_values("position_error_max_m"),
    "speed_max_m_s": _aircraft_values("speed_max_m_s"),
    "tables_left_max_s": _aircraft_values("tables_left_s"),
}
_AT_LEAST = {
    "separation_ratio_min": _fleet_value("separation_ratio_min"),
    "separation_min_m": _fleet_value("separation_min_m"),
    "keep_out_room_min_m": _aircraft_values("keep_out_room_min_m"),
    "clearance_min_m": _aircraft_values("clearance_min_m"),
    "speed_min_m_s": _aircraft_values("speed_min_m_s"),
}

_OF_PAIRS = frozenset({"separation_ratio_min", "separation_min_m"})
"""Requirements on pairs of aircraft, which a single aircraft meets; aircraft that left the fleet count as well."""

REQUIREMENT_NAMES: tuple[str, ...] = (*_AT_MOST, *_AT_LEAST)
"""Names of the requirements; `max` in a name marks an upper limit, `min` a lower limit."""


@dataclass(frozen=True)
class Requirement:
    """An upper limit (`max` in the name) or lower limit (`min`) of a value of a flight.

    Raises ValueError if the name is not in `REQUIREMENT_NAMES`.
    """

    name: str  # one of `REQUIREMENT_NAMES`
    limit: float  # in the unit at the end of the name
    aircraft_limits: tuple[float, ...] | None = None  # limit of each aircraft, if the limits differ

    def __post_init__(self) -> None:
        if self.name not in REQUIREMENT_NAMES:
            raise ValueError(f"requirement {self.name!r} is unknown; known are {', '.join(REQUIREMENT_NAMES)}")


def scenario_requirements(scenario: Scenario) -> tuple[Requirement, ...]:
    """Return the requirements of a scenario, except the least distances from the goals (`CLEARANCE_MIN_M`)."""
    config, limits = scenario.requirements, [scenario.limits_for(item) for item in scenario.aircraft]
    slowest, fastest = tuple(item.speed_min_m_s for item in limits), tuple(item.speed_max_m_s for item in limits)
    limits_by_name = {
        "miss_max_m": config.miss_max_m,
        "arrival_spread_max_s": config.arrival_spread_max_s if scenario.arrival.is_common else None,
        "speed_min_m_s": min(slowest),
        "speed_max_m_s": max(fastest),
        "position_error_max_m": config.position_error_max_m,
        "separation_min_m": config.separation_min_m,
        "separation_ratio_min": None if scenario.separation.required_m is None else 1.0,
        "keep_out_room_min_m": 0.0 if scenario.has_keep_outs else None,
    }
    limits_by_aircraft = {"speed_min_m_s": slowest, "speed_max_m_s": fastest}
    different = {name: limits for name, limits in limits_by_aircraft.items() if len(set(limits)) > 1}
    return tuple(
        Requirement(name, limit, different.get(name)) for name, limit in limits_by_name.items() if limit is not None
    )


def evaluate_requirements(
    requirements: Sequence[Requirement],
    # aircraft entries and fleet entry of the summary
    aircraft: Sequence[_Entry],
    fleet: _Entry,
    # for every goal to which an aircraft flew: kind, least distance from it (None: missing), and required distance, m
    clearances: Sequence[tuple[str, float | None, float]],
) -> list[dict[str, Any]]:
    """Evaluate a flight against its requirements, and against the least distances from its goals.

    Returns an entry {name, limit, value, met} for each requirement and each kind of goal; limit and value are from the
    aircraft with the least margin. A requirement with a missing value (None) is not met, unless it applies to no
    aircraft, as a separation of a single aircraft.
    """
    evaluations = [_evaluate_requirement(requirement, aircraft, fleet) for requirement in requirements]
    for kind in dict.fromkeys(kind for kind, _, _ in clearances):
        values = [(value, limit) for goal_kind, value, limit in clearances if goal_kind == kind]
        value, limit = min(values, key=lambda pair: -math.inf if pair[0] is None else pair[0] - pair[1])
        evaluations.append(_entry(f"clearance_{kind}_min_m", limit, value, value is not None and value >= limit))
    return evaluations


def _evaluate_requirement(requirement: Requirement, aircraft: Sequence[_Entry], fleet: _Entry) -> dict[str, Any]:
    """Return the entry {name, limit, value, met} of one requirement, for the aircraft with the least margin.

    A missing value is None, and does not meet the requirement. A requirement that applies to no aircraft, such as the
    separation of a single aircraft, is met with the value None.
    """
    name, is_upper = requirement.name, requirement.name in _AT_MOST
    if name in _OF_PAIRS and len(aircraft) == 1:
        return _entry(name, requirement.limit, None, True)
    staying = [k for k, entry in enumerate(aircraft) if "left_s" not in entry]
    values = (_AT_MOST if is_upper else _AT_LEAST)[name]([aircraft[k] for k in staying], fleet)
    limits = [requirement.limit] * len(values)
    if requirement.aircraft_limits is not None:
        limits = [requirement.aircraft_limits[k] for k in staying]
    if not values:
        return _entry(name, requirement.limit, None, True)
    sign = 1.0 if is_upper else -1.0

    def margin(k: int) -> tuple[float, float]:
        value = values[k]
        return (-math.inf, 0.0) if value is None else (sign * (limits[k] - value), -sign * value)

    worst = min(range(len(values)), key=margin)
    value, limit = values[worst], limits[worst]
    return _entry(name, limit, value, value is not None and (value <= limit if is_upper else value >= limit))


def _entry(name: str, limit: float, value: float | None, is_met: bool) -> dict[str, Any]:
    return {"name": name, "limit": limit, "value": value, "met": is_met}
