"""Checks of consistency between the tables of a scenario.

Names, positions, envelope, data ranges, and the minimum stand-off of the product's scope. Each `*_problems` function
returns a list of problems, empty if the tables are consistent.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

from anser.aircraft_files.sources import AirframeRange
from anser.config.errors import Problem, format_number, format_value
from anser.config.tables import Table, ordering_problems
from anser.constants import AIRBORNE_STAND_OFF_MIN_M, STANDARD_GRAVITY_M_S2, SURFACE_STAND_OFF_MIN_M
from anser.scenario.schema_aircraft import Aircraft, Goal
from anser.scenario.schema_settings import Limits

if TYPE_CHECKING:
    from anser.scenario.schema import Scenario


_KEYS = (
    ("speed_min_m_s", "speed_max_m_s", "airspeed_m_s", "m/s"),
    ("altitude_min_m", "altitude_max_m", "altitude_m", "m"),
    ("alpha_min_deg", "alpha_max_deg", "alpha_deg", "deg"),
)


def limits_for(limits: Limits, data_range: AirframeRange) -> Limits:
    """Return one aircraft's limits; airspeeds and angles of attack left out follow from the aircraft file.

    An aircraft without a file keeps the scenario's limits.
    """
    if not data_range.is_from_file:
        return limits
    values = {}
    for low_key, high_key, name, _ in _KEYS:
        bounds = getattr(data_range, name)
        if bounds is None or name == "altitude_m":
            continue
        is_airspeed = name == "airspeed_m_s"
        values[low_key] = bounds[0] if is_airspeed else max(bounds[0], getattr(limits, low_key))
        values[high_key] = bounds[1] if is_airspeed else min(bounds[1], getattr(limits, high_key))
    return limits.with_defaults(**values)


def order_problems(scenario: "Scenario") -> list[Problem]:
    """List limits of airspeed and angle of attack whose lower bound is not below the upper bound."""
    problems = [
        *ordering_problems(scenario.limits, "speed_min_m_s", "speed_max_m_s", "m/s"),
        *ordering_problems(scenario.limits, "alpha_min_deg", "alpha_max_deg", "deg"),
    ]
    return [Problem(f"limits.{problem.path}", problem.arrived, problem.expected) for problem in problems]


def range_problems(scenario: "Scenario") -> list[Problem]:
    """List limits beyond the range of an aircraft's data.

    Altitudes beyond the range are allowed: the results mark the time spent outside.
    """
    aircraft_tables, limits = scenario.aircraft, scenario.limits
    problems: dict[str, Problem] = {}
    for data_range in dict.fromkeys(aircraft.range for aircraft in aircraft_tables):
        for problem in _exceeded_limits(data_range, limits_for(limits, data_range)):
            problems.setdefault(problem.path, problem)
    return list(problems.values())


def _exceeded_limits(data_range: AirframeRange, limits: Limits) -> list[Problem]:
    problems = []
    for low_key, high_key, name, unit in _KEYS:
        bounds = getattr(data_range, name)
        if bounds is None or name == "altitude_m":
            continue
        for key, is_exceeded, expected in (
            (low_key, getattr(limits, low_key) < bounds[0], f"at least {format_number(bounds[0])} {unit}"),
            (high_key, getattr(limits, high_key) > bounds[1], f"at most {format_number(bounds[1])} {unit}"),
        ):
            if is_exceeded:
                arrived = format_number(getattr(limits, key))
                problems.append(
                    Problem(f"limits.{key}", arrived, f"{expected}, where the data of {data_range.name} hold")
                )
    return problems


AIRBORNE_ALTITUDE_MIN_M = 50.0
SAME_POSITION_M = 10.0  # about the span of the aircraft

_SCOPE = "this is the scope of anser: a rendezvous is never the goal itself"
_CERTIFIED_LIMITS = ("altitude_max_m", "roll_rate_max_deg_s", "acceleration_max_m_s2", "deceleration_max_m_s2")
_CERTIFIED_AIRCRAFT_KEYS = ("speed_m_s", "arrive_s", "arrive_from_s", "arrive_to_s")
"""Aircraft keys that only the certified planner supports."""


def label(kind: str, item: Aircraft | Goal) -> str:
    """Format the name of an aircraft or a goal for a message, such as ``goal "ship"``."""
    return f'{kind} "{item.name}"'


def connected_groups(count: int, is_connected: Callable[[int, int], bool]) -> list[list[int]]:
    """Return the connected components, of two or more nodes each, of a graph with the nodes 0 to `count` - 1.

    The nodes of a component are in rising order.
    """
    groups: list[list[int]] = []
    for index in range(count):
        joined = [group for group in groups if any(is_connected(index, member) for member in group)]
        groups = [group for group in groups if group not in joined]
        groups.append(sorted([index, *itertools.chain(*joined)]))
    return sorted(group for group in groups if len(group) > 1)


def format_list(kind: str, items: Sequence[Aircraft] | Sequence[Goal], indices: Sequence[int]) -> str:
    """Format list items for a message, such as ``aircraft[0] "north" and aircraft[2] "south"``."""
    names = [f'{kind}[{index}] "{items[index].name}"' for index in indices]
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def name_problems(scenario: "Scenario") -> list[Problem]:
    """List names used twice and references to goals that do not exist."""
    aircraft_tables, goals = scenario.aircraft, scenario.goal
    problems = []
    for kind, items in (("aircraft", aircraft_tables), ("goal", goals)):
        first_indices: dict[str, int] = {}
        for index, item in enumerate(items):
            if item.name in first_indices:
                arrived = f'"{item.name}", already the name of {kind}[{first_indices[item.name]}]'
                problems.append(Problem(f"{kind}[{index}].name", arrived, "a name of its own"))
            first_indices.setdefault(item.name, index)
    goal_names = ", ".join(f'"{goal.name}"' for goal in goals) or "none yet: add a [[goal]] table"
    names = {goal.name for goal in goals}
    for index, aircraft in enumerate(aircraft_tables):
        if aircraft.goal not in names:
            expected = f"the name of a goal of this scenario ({goal_names})"
            problems.append(
                Problem(f"aircraft[{index}].goal", f'"{aircraft.goal}"', expected, label("aircraft", aircraft))
            )
    return problems


def speed_problems(scenario: "Scenario") -> list[Problem]:
    """List preferred airspeeds outside the limits or below the wind speed, and a hold radius that is too small."""
    problems: dict[str, Problem] = {}
    for index, aircraft in enumerate(scenario.aircraft):
        for problem in _aircraft_speed_problems(scenario, index, aircraft):
            problems.setdefault(problem.path, problem)
    return list(problems.values())


def _aircraft_speed_problems(scenario: "Scenario", index: int, aircraft: Aircraft) -> list[Problem]:
    problems, limits, wind = [], scenario.limits_for(aircraft), scenario.wind
    speed_m_s = scenario.speed_for(aircraft)
    key = "fleet.speed_m_s" if aircraft.speed_m_s is None else f"aircraft[{index}].speed_m_s"
    subject = "" if aircraft.speed_m_s is None else label("aircraft", aircraft)
    if not limits.speed_min_m_s < speed_m_s < limits.speed_max_m_s:
        expected = (
            f"a speed between limits.speed_min_m_s ({format_number(limits.speed_min_m_s)} m/s) and "
            f"limits.speed_max_m_s ({format_number(limits.speed_max_m_s)} m/s){_limits_owner(scenario, aircraft)}"
        )
        problems.append(Problem(key, format_number(speed_m_s), expected, subject))
    if wind.speed_max_m_s >= speed_m_s:
        expected = f"a wind slower than {key}, which is {format_number(speed_m_s)} m/s"
        wind_path = "wind.speed_m_s" if wind.layers is None else "wind.layers"
        problems.append(
            Problem(wind_path, format_number(wind.speed_m_s if wind.layers is None else wind.speed_max_m_s), expected)
        )
    ground_speed_m_s = speed_m_s + max(math.hypot(*velocity[:2]) for _, velocity in wind.profile_m_s)
    tightest_m = ground_speed_m_s**2 / (STANDARD_GRAVITY_M_S2 * math.tan(math.radians(limits.bank_max_deg)))
    if scenario.hold.radius_m < tightest_m:
        expected = (
            f"at least {math.ceil(tightest_m)} m, the turn at {ground_speed_m_s:.1f} m/s over the ground "
            f"with limits.bank_max_deg = {format_number(limits.bank_max_deg)}"
        )
        arrived = format_number(scenario.hold.radius_m)
        if "radius_m" not in scenario.hold.model_fields_set:
            arrived += ", the default"
            expected += f"; write [hold] with radius_m = {math.ceil(tightest_m / 100.0) * 100:.1f}, or more"
        problems.append(Problem("hold.radius_m", arrived, expected))
    return problems


def _limits_owner(scenario: "Scenario", aircraft: Aircraft) -> str:
    """Return an addition to messages about a fleet of several types: the origin of the limits, and a remedy."""
    if len({fleet_member.range for fleet_member in scenario.aircraft}) == 1:
        return ""
    remedy = "" if aircraft.speed_m_s is not None else "; aircraft[].speed_m_s gives an aircraft an airspeed of its own"
    return f", those of {aircraft.range.name}{remedy}"


def start_problems(scenario: "Scenario") -> list[Problem]:
    """List starts outside the envelope, and aircraft that start at the same position."""
    problems, aircraft_tables = [], scenario.aircraft
    for index, aircraft in enumerate(aircraft_tables):
        path, subject, start, limits = (
            f"aircraft[{index}].start",
            label("aircraft", aircraft),
            aircraft.start,
            scenario.limits_for(aircraft),
        )
        if not limits.speed_min_m_s <= start.speed_m_s <= limits.speed_max_m_s:
            expected = (
                f"a speed from limits.speed_min_m_s ({format_number(limits.speed_min_m_s)} m/s) to "
                f"limits.speed_max_m_s ({format_number(limits.speed_max_m_s)} m/s)"
            )
            problems.append(Problem(f"{path}.speed_m_s", format_number(start.speed_m_s), expected, subject))
        if start.altitude_m < limits.altitude_min_m:
            expected = f"at least limits.altitude_min_m, which is {format_number(limits.altitude_min_m)} m"
            problems.append(Problem(f"{path}.altitude_m", format_number(start.altitude_m), expected, subject))
        if start.altitude_m > limits.altitude_max_m:
            expected = f"at most limits.altitude_max_m, which is {format_number(limits.altitude_max_m)} m"
            problems.append(Problem(f"{path}.altitude_m", format_number(start.altitude_m), expected, subject))
        problems.extend(
            _climb_rate_problems(f"{path}.path_angle_deg", subject, start.path_angle_deg, start.speed_m_s, limits)
        )
    positions_m = [aircraft.start.position_m for aircraft in aircraft_tables]
    for first_index, *later_indices in connected_groups(
        len(aircraft_tables), lambda i, j: math.dist(positions_m[i], positions_m[j]) < SAME_POSITION_M
    ):
        addition = (
            f", also that of {format_list('aircraft', aircraft_tables, later_indices[1:])}"
            if len(later_indices) > 1
            else ""
        )
        arrived = f"the place of {format_list('aircraft', aircraft_tables, [first_index])}{addition}"
        expected = f"a start at least {SAME_POSITION_M:g} m from every other"
        problems.append(
            Problem(
                f"aircraft[{later_indices[0]}].start",
                arrived,
                expected,
                label("aircraft", aircraft_tables[later_indices[0]]),
            )
        )
    return problems


def rendezvous_problems(scenario: "Scenario") -> list[Problem]:
    """List stand-offs below the minimum and arrivals that are too steep.

    Requires that the goal of every aircraft exists.
    """
    problems = []
    goal_kinds = {goal.name: goal.kind for goal in scenario.goal}
    for index, aircraft in enumerate(scenario.aircraft):
        limits, speed_m_s = scenario.limits_for(aircraft), scenario.speed_for(aircraft)
        path, subject, rendezvous = f"aircraft[{index}].rendezvous", label("aircraft", aircraft), aircraft.rendezvous
        if goal_kinds[aircraft.goal] == "surface" and rendezvous.stand_off_up_m < SURFACE_STAND_OFF_MIN_M:
            expected = f'at least {SURFACE_STAND_OFF_MIN_M:g} m above the surface goal "{aircraft.goal}"; {_SCOPE}'
            problems.append(
                Problem(f"{path}.stand_off_up_m", format_number(rendezvous.stand_off_up_m), expected, subject)
            )
        if goal_kinds[aircraft.goal] == "airborne" and rendezvous.stand_off_distance_m < AIRBORNE_STAND_OFF_MIN_M:
            expected = f'at least {AIRBORNE_STAND_OFF_MIN_M:g} m from the airborne goal "{aircraft.goal}"; {_SCOPE}'
            arrived = f"a stand-off of {rendezvous.stand_off_distance_m:.1f} m"
            problems.append(Problem(path, arrived, expected, subject))
        if rendezvous.path_angle_deg is not None:
            problems.extend(
                _climb_rate_problems(f"{path}.path_angle_deg", subject, rendezvous.path_angle_deg, speed_m_s, limits)
            )
    return problems


def goal_problems(scenario: "Scenario") -> list[Problem]:
    """List airborne goals that start at or sink to the surface during the flight."""
    problems = []
    for index, goal in enumerate(scenario.goal):
        if goal.kind == "surface":
            continue
        if goal.waypoints is not None:
            heights = {f"waypoints[{k}].altitude_m": point.altitude_m for k, point in enumerate(goal.waypoints)}
        else:
            heights = {"altitude_m": goal.altitude_m, "climb_rate_m_s": goal.position_m(scenario.timing.duration_s)[2]}
        low_heights = {key: height for key, height in heights.items() if height < AIRBORNE_ALTITUDE_MIN_M}
        for key, height in low_heights.items():
            if key == "climb_rate_m_s":
                if "altitude_m" in low_heights:
                    continue
                arrived = (
                    f"{format_number(goal.climb_rate_m_s)}, which brings it to {height:.1f} m at the end of the flight"
                )
            else:
                arrived = format_number(height)
            expected = f'an airborne goal at {AIRBORNE_ALTITUDE_MIN_M:g} m or higher; for a lower one, kind = "surface"'
            problems.append(Problem(f"goal[{index}].{key}", arrived, expected, label("goal", goal)))
    return problems


def _climb_rate_problems(path: str, subject: str, angle_deg: float, speed_m_s: float, limits: Limits) -> list[Problem]:
    """List a path angle at which the aircraft would climb or descend faster than the limit."""
    rate_m_s = speed_m_s * math.sin(math.radians(angle_deg))
    if abs(rate_m_s) <= limits.climb_rate_max_m_s:
        return []
    arrived = f"{format_number(angle_deg)}, a climb rate of {rate_m_s:.1f} m/s"
    expected = f"a climb rate within limits.climb_rate_max_m_s, which is {format_number(limits.climb_rate_max_m_s)} m/s"
    return [Problem(path, arrived, expected, subject)]


def planner_problems(scenario: "Scenario") -> list[Problem]:
    """List keys that the scenario's planner does not support.

    If ``planner = "published"`` is written in the file, keys with their default values are accepted; a scenario
    recorded with all defaults then loads again.
    """
    fleet = scenario.fleet
    if fleet.is_certified:
        if fleet.speed_profile == "published":
            expected = '"even", or fleet.planner = "published", which alone has such polynomials'
            return [Problem("fleet.speed_profile", f'"published" with fleet.planner "{fleet.planner}"', expected)]
        return []
    explicit = "planner" in fleet.model_fields_set
    certified_keys: list[tuple[str, Table, Iterable[str], str]] = [
        ("fleet", fleet, ("reserve",), ""),
        ("limits", scenario.limits, _CERTIFIED_LIMITS, ""),
        ("arrival", scenario.arrival, type(scenario.arrival).model_fields, ""),
        ("separation", scenario.separation, type(scenario.separation).model_fields, ""),
    ]
    for index, aircraft in enumerate(scenario.aircraft):
        certified_keys.append((f"aircraft[{index}]", aircraft, _CERTIFIED_AIRCRAFT_KEYS, label("aircraft", aircraft)))
    expected = 'fleet.planner = "certified" beside it, which alone knows this key'
    problems = []
    for path, table, keys, subject in certified_keys:
        for key in keys:
            value, default = getattr(table, key), type(table).model_fields[key].default
            if key in table.model_fields_set and not (explicit and value == default):
                value_text = format_value(value)
                problems.append(
                    Problem(f"{path}.{key}", f'{value_text} with fleet.planner "published"', expected, subject)
                )
    if scenario.keep_out:
        arrived = f'a list of {len(scenario.keep_out)} with fleet.planner "published"'
        problems.append(Problem("keep_out", arrived, expected))
    return problems
