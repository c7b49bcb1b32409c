"""Checks between tables of a scenario.

Names, positions, envelope, data ranges, and the minimum stand-off of the product's scope. Each `*_problems` function
returns a list of problems, empty if the tables are consistent.
"""

import copy
import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

from anser.aircraft_files.sources import AirframeRange
from anser.config.errors import Problem, describe_value, format_number
from anser.config.tables import Table, ordering_problems
from anser.constants import AIRBORNE_STAND_OFF_MIN_M, SURFACE_STAND_OFF_MIN_M
from anser.scenario.schema_aircraft import Aircraft, Goal
from anser.scenario.schema_settings import Limits, Timing

if TYPE_CHECKING:
    from anser.scenario.schema import Scenario


_KEYS = (
    ("speed_min_m_s", "speed_max_m_s", "airspeed_m_s", "m/s"),
    ("altitude_min_m", "altitude_max_m", "altitude_m", "m"),
    ("alpha_min_deg", "alpha_max_deg", "alpha_deg", "deg"),
)


def limits_for(limits: Limits, data_range: AirframeRange) -> Limits:
    """Limits of one aircraft: airspeeds and angles of attack that the scenario leaves out are those of its file.

    An aircraft without a file has the limits of the scenario.
    """
    if not data_range.is_from_file:
        return limits
    meant = copy.copy(limits)
    for low_key, high_key, name, _ in _KEYS:
        ends = getattr(data_range, name)
        if ends is None or name == "altitude_m":
            continue
        # as the planner that is meant: the file does not hold them, and what is written again must not either
        if low_key not in limits.model_fields_set:
            value = ends[0] if name == "airspeed_m_s" else max(ends[0], getattr(limits, low_key))
            object.__setattr__(meant, low_key, value)
        if high_key not in limits.model_fields_set:
            value = ends[1] if name == "airspeed_m_s" else min(ends[1], getattr(limits, high_key))
            object.__setattr__(meant, high_key, value)
    return meant


def order_problems(limits: Limits) -> list[Problem]:
    """Find limits of airspeed and angle of attack without a width."""
    found = [
        *ordering_problems(limits, "speed_min_m_s", "speed_max_m_s", "m/s"),
        *ordering_problems(limits, "alpha_min_deg", "alpha_max_deg", "deg"),
    ]
    return [Problem(f"limits.{one.path}", one.arrived, one.expected) for one in found]


def range_problems(aircraft: tuple[Aircraft, ...], limits: Limits) -> list[Problem]:
    """Find limits that let an aircraft fly where its data do not hold; altitudes beyond them are only marked."""
    found: dict[str, Problem] = {}
    for one in dict.fromkeys(each.range for each in aircraft):
        for problem in _exceeded_limits(one, limits_for(limits, one)):
            found.setdefault(problem.path, problem)
    return list(found.values())


def _exceeded_limits(data_range: AirframeRange, limits: Limits) -> list[Problem]:
    found = []
    for low_key, high_key, name, unit in _KEYS:
        ends = getattr(data_range, name)
        if ends is None or name == "altitude_m":
            continue
        for key, bad, words in (
            (low_key, getattr(limits, low_key) < ends[0], f"at least {format_number(ends[0])} {unit}"),
            (high_key, getattr(limits, high_key) > ends[1], f"at most {format_number(ends[1])} {unit}"),
        ):
            if bad:
                arrived = format_number(getattr(limits, key))
                found.append(Problem(f"limits.{key}", arrived, f"{words}, where the data of {data_range.name} hold"))
    return found


AIRBORNE_ALTITUDE_MIN_M = 50.0
SAME_POSITION_M = 10.0  # about the span of the aircraft

GRAVITY_M_S2 = 9.80665
_SCOPE = "this is the scope of anser: a rendezvous is never the goal itself"
_CERTIFIED_LIMITS = ("altitude_max_m", "roll_rate_max_deg_s", "acceleration_max_m_s2", "deceleration_max_m_s2")
_CERTIFIED_AIRCRAFT_KEYS = ("speed_m_s", "arrive_s", "arrive_from_s", "arrive_to_s")
"""Keys that the certified planner alone knows."""


def label(kind: str, named: Aircraft | Goal) -> str:
    """Name an aircraft or a goal in a message, such as ``goal "ship"``."""
    return f'{kind} "{named.name}"'


def connected_groups(count: int, together: Callable[[int, int], bool]) -> list[list[int]]:
    """Groups of two or more, of so many, each member together with another of the group; all in rising order."""
    found: list[list[int]] = []
    for index in range(count):
        joined = [group for group in found if any(together(index, other) for other in group)]
        found = [group for group in found if group not in joined]
        found.append(sorted([index, *itertools.chain(*joined)]))
    return sorted(group for group in found if len(group) > 1)


def format_list(kind: str, items: Sequence[Aircraft] | Sequence[Goal], places: Sequence[int]) -> str:
    """Name several of a list in a message, such as ``aircraft[0] "north" and aircraft[2] "south"``."""
    names = [f'{kind}[{place}] "{items[place].name}"' for place in places]
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def name_problems(aircraft: tuple[Aircraft, ...], goals: tuple[Goal, ...]) -> list[Problem]:
    """Find names used twice and goals that do not exist."""
    found = []
    for kind, items in (("aircraft", aircraft), ("goal", goals)):
        first: dict[str, int] = {}
        for index, item in enumerate(items):
            if item.name in first:
                taken = f'"{item.name}", already the name of {kind}[{first[item.name]}]'
                found.append(Problem(f"{kind}[{index}].name", taken, "a name of its own"))
            first.setdefault(item.name, index)
    known = ", ".join(f'"{goal.name}"' for goal in goals) or "none yet: add a [[goal]] table"
    names = {goal.name for goal in goals}
    for index, one in enumerate(aircraft):
        if one.goal not in names:
            words = f"the name of a goal of this scenario ({known})"
            found.append(Problem(f"aircraft[{index}].goal", f'"{one.goal}"', words, label("aircraft", one)))
    return found


def speed_problems(scenario: "Scenario") -> list[Problem]:
    """Find preferred airspeeds outside the limits, a wind too strong for them and a hold too tight for them."""
    found: dict[str, Problem] = {}
    for index, one in enumerate(scenario.aircraft):
        for problem in _speed_problems_of(scenario, index, one):
            found.setdefault(problem.path, problem)
    return list(found.values())


def _speed_problems_of(scenario: "Scenario", index: int, aircraft: Aircraft) -> list[Problem]:
    found, limits, wind = [], scenario.limits_for(aircraft), scenario.wind
    speed_m_s = scenario.speed_for(aircraft)
    key = "fleet.speed_m_s" if aircraft.speed_m_s is None else f"aircraft[{index}].speed_m_s"
    whom = "" if aircraft.speed_m_s is None else label("aircraft", aircraft)
    if not limits.speed_min_m_s < speed_m_s < limits.speed_max_m_s:
        words = (
            f"a speed between limits.speed_min_m_s ({format_number(limits.speed_min_m_s)} m/s) and "
            f"limits.speed_max_m_s ({format_number(limits.speed_max_m_s)} m/s){_limits_owner(scenario, aircraft)}"
        )
        found.append(Problem(key, format_number(speed_m_s), words, whom))
    if wind.speed_max_m_s >= speed_m_s:
        words = f"a wind slower than {key}, which is {format_number(speed_m_s)} m/s"
        where = "wind.speed_m_s" if wind.layers is None else "wind.layers"
        found.append(
            Problem(where, format_number(wind.speed_m_s if wind.layers is None else wind.speed_max_m_s), words)
        )
    ground_speed_m_s = speed_m_s + max(math.hypot(*velocity[:2]) for _, velocity in wind.profile_m_s)
    tightest_m = ground_speed_m_s**2 / (GRAVITY_M_S2 * math.tan(math.radians(limits.bank_max_deg)))
    if scenario.hold.radius_m < tightest_m:
        words = (
            f"at least {math.ceil(tightest_m)} m, the turn at {ground_speed_m_s:.1f} m/s over the ground "
            f"with limits.bank_max_deg = {format_number(limits.bank_max_deg)}"
        )
        arrived = format_number(scenario.hold.radius_m)
        if "radius_m" not in scenario.hold.model_fields_set:
            arrived += ", the default"
            words += f"; write [hold] with radius_m = {math.ceil(tightest_m / 100.0) * 100:.1f}, or more"
        found.append(Problem("hold.radius_m", arrived, words))
    return found


def _limits_owner(scenario: "Scenario", aircraft: Aircraft) -> str:
    """Whose limits they are where a fleet has several kinds; what to do where one speed serves none of them."""
    if len({other.range for other in scenario.aircraft}) == 1:
        return ""
    way = "" if aircraft.speed_m_s is not None else "; aircraft[].speed_m_s gives an aircraft an airspeed of its own"
    return f", those of {aircraft.range.name}{way}"


def start_problems(scenario: "Scenario") -> list[Problem]:
    """Find starts outside the envelope and two aircraft at one place."""
    found, aircraft = [], scenario.aircraft
    for index, one in enumerate(aircraft):
        path, whom, start, limits = (
            f"aircraft[{index}].start",
            label("aircraft", one),
            one.start,
            scenario.limits_for(one),
        )
        if not limits.speed_min_m_s <= start.speed_m_s <= limits.speed_max_m_s:
            words = (
                f"a speed from limits.speed_min_m_s ({format_number(limits.speed_min_m_s)} m/s) to "
                f"limits.speed_max_m_s ({format_number(limits.speed_max_m_s)} m/s)"
            )
            found.append(Problem(f"{path}.speed_m_s", format_number(start.speed_m_s), words, whom))
        if start.altitude_m < limits.altitude_min_m:
            words = f"at least limits.altitude_min_m, which is {format_number(limits.altitude_min_m)} m"
            found.append(Problem(f"{path}.altitude_m", format_number(start.altitude_m), words, whom))
        if start.altitude_m > limits.altitude_max_m:
            words = f"at most limits.altitude_max_m, which is {format_number(limits.altitude_max_m)} m"
            found.append(Problem(f"{path}.altitude_m", format_number(start.altitude_m), words, whom))
        found.extend(_too_steep(f"{path}.path_angle_deg", whom, start.path_angle_deg, start.speed_m_s, limits))
    at_m = [one.start.position_m for one in aircraft]
    for first, *others in connected_groups(len(aircraft), lambda i, j: math.dist(at_m[i], at_m[j]) < SAME_POSITION_M):
        also = f", also that of {format_list('aircraft', aircraft, others[1:])}" if len(others) > 1 else ""
        arrived = f"the place of {format_list('aircraft', aircraft, [first])}{also}"
        words = f"a start at least {SAME_POSITION_M:g} m from every other"
        found.append(Problem(f"aircraft[{others[0]}].start", arrived, words, label("aircraft", aircraft[others[0]])))
    return found


def rendezvous_problems(scenario: "Scenario") -> list[Problem]:
    """Find stand-offs below the minimum and arrivals too steep; every aircraft's goal exists."""
    found = []
    kinds = {goal.name: goal.kind for goal in scenario.goal}
    for index, one in enumerate(scenario.aircraft):
        limits, speed_m_s = scenario.limits_for(one), scenario.speed_for(one)
        path, whom, there = f"aircraft[{index}].rendezvous", label("aircraft", one), one.rendezvous
        if kinds[one.goal] == "surface" and there.stand_off_up_m < SURFACE_STAND_OFF_MIN_M:
            words = f'at least {SURFACE_STAND_OFF_MIN_M:g} m above the surface goal "{one.goal}"; {_SCOPE}'
            found.append(Problem(f"{path}.stand_off_up_m", format_number(there.stand_off_up_m), words, whom))
        if kinds[one.goal] == "airborne" and there.stand_off_distance_m < AIRBORNE_STAND_OFF_MIN_M:
            words = f'at least {AIRBORNE_STAND_OFF_MIN_M:g} m from the airborne goal "{one.goal}"; {_SCOPE}'
            arrived = f"a stand-off of {there.stand_off_distance_m:.1f} m"
            found.append(Problem(path, arrived, words, whom))
        if there.path_angle_deg is not None:
            found.extend(_too_steep(f"{path}.path_angle_deg", whom, there.path_angle_deg, speed_m_s, limits))
    return found


def goal_problems(goals: tuple[Goal, ...], timing: Timing) -> list[Problem]:
    """Find airborne goals that stand on the surface or sink to it during the flight."""
    found = []
    for index, goal in enumerate(goals):
        if goal.kind == "surface":
            continue
        if goal.waypoints is not None:
            heights = {f"waypoints[{k}].altitude_m": point.altitude_m for k, point in enumerate(goal.waypoints)}
        else:
            heights = {"altitude_m": goal.altitude_m, "climb_rate_m_s": goal.position_m(timing.duration_s)[2]}
        low = {key: height for key, height in heights.items() if height < AIRBORNE_ALTITUDE_MIN_M}
        for key, height in low.items():
            if key == "climb_rate_m_s":
                if "altitude_m" in low:
                    continue
                arrived = (
                    f"{format_number(goal.climb_rate_m_s)}, which brings it to {height:.1f} m at the end of the flight"
                )
            else:
                arrived = format_number(height)
            words = f'an airborne goal at {AIRBORNE_ALTITUDE_MIN_M:g} m or higher; for a lower one, kind = "surface"'
            found.append(Problem(f"goal[{index}].{key}", arrived, words, label("goal", goal)))
    return found


def _too_steep(path: str, whom: str, angle_deg: float, speed_m_s: float, limits: Limits) -> list[Problem]:
    """Find a path angle whose climb or descent is faster than the limit."""
    rate_m_s = speed_m_s * math.sin(math.radians(angle_deg))
    if abs(rate_m_s) <= limits.climb_rate_max_m_s:
        return []
    arrived = f"{format_number(angle_deg)}, a climb rate of {rate_m_s:.1f} m/s"
    words = f"a climb rate within limits.climb_rate_max_m_s, which is {format_number(limits.climb_rate_max_m_s)} m/s"
    return [Problem(path, arrived, words, whom)]


def planner_problems(scenario: "Scenario") -> list[Problem]:
    """Find keys that the planner of the scenario does not know.

    Beside ``planner = "published"`` written out, a key written out with its default asks for nothing and may stand; so
    a scenario that was recorded with all its defaults loads again.
    """
    fleet = scenario.fleet
    if fleet.is_certified:
        if fleet.speed_profile == "published":
            words = '"even", or fleet.planner = "published", which alone has such polynomials'
            return [Problem("fleet.speed_profile", f'"published" with fleet.planner "{fleet.planner}"', words)]
        return []
    explicit = "planner" in fleet.model_fields_set
    asked: list[tuple[str, Table, Iterable[str], str]] = [
        ("fleet", fleet, ("reserve",), ""),
        ("limits", scenario.limits, _CERTIFIED_LIMITS, ""),
        ("arrival", scenario.arrival, type(scenario.arrival).model_fields, ""),
        ("separation", scenario.separation, type(scenario.separation).model_fields, ""),
    ]
    for index, one in enumerate(scenario.aircraft):
        asked.append((f"aircraft[{index}]", one, _CERTIFIED_AIRCRAFT_KEYS, label("aircraft", one)))
    words = 'fleet.planner = "certified" beside it, which alone knows this key'
    found = []
    for path, table, keys, whom in asked:
        for key in keys:
            value, default = getattr(table, key), type(table).model_fields[key].default
            if key in table.model_fields_set and not (explicit and value == default):
                shown = format_number(value) if isinstance(value, float) else describe_value(value)
                found.append(Problem(f"{path}.{key}", f'{shown} with fleet.planner "published"', words, whom))
    if scenario.keep_out:
        arrived = f'a list of {len(scenario.keep_out)} with fleet.planner "published"'
        found.append(Problem("keep_out", arrived, words))
    return found
