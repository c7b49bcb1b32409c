"""Scenario tables for arrival times, separation and keep-out volumes, with their checks."""

import math
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from anser.aircraft_files.sources import ALTITUDE_MAX_M, SPEED_MAX_M_S
from anser.config.errors import Problem, describe_value, format_number
from anser.config.tables import (
    NAME_PATTERN,
    Table,
    Vector,
    choice,
    expects,
    identifier,
    number,
    ordering_problems,
    velocity_on_course,
)
from anser.scenario.schema_aircraft import POSITION_MAX_M, Aircraft, Goal
from anser.scenario.schema_checks import SAME_POSITION_M, connected_groups, format_list, label
from anser.scenario.schema_settings import DURATION_MAX_S, Timing

if TYPE_CHECKING:
    from anser.scenario.schema import Scenario

RULES = ("together", "earliest", "at", "sequence", "times", "windows")

_RULE_OF = {"time_s": "at", "spacing_s": "sequence", "order": "sequence"}
_RULE_OF_AIRCRAFT = {"arrive_s": "times", "arrive_from_s": "windows", "arrive_to_s": "windows"}


class Arrival(Table):
    """The rule for the arrival times."""

    rule: Literal["together", "earliest", "at", "sequence", "times", "windows"] = choice(
        "all at one time: of the farthest at fleet.speed_m_s, the earliest that the limits allow, or a given one; "
        "or one after another; or each at its own time, or within its own window",
        RULES,
        "together",
    )
    time_s: float | None = number('time of arrival of all, with rule "at"', 1, DURATION_MAX_S, "s", None)
    spacing_s: float | None = number('time between two arrivals, with rule "sequence"', 0, 3600, "s", None)
    order: tuple[Annotated[str, Field(pattern=NAME_PATTERN)], ...] | None = Field(
        default=None,
        min_length=1,
        strict=False,  # a TOML list arrives as a Python list; the items stay strict
        description='order of arrival, with rule "sequence"; left out: as in the file',
        json_schema_extra=expects('a list of the names of all aircraft, such as ["first", "second"]'),
    )

    def consistency_problems(self) -> list[Problem]:
        """List keys that the rule requires but the table lacks, and keys that the rule does not use."""
        problems = []
        for key, rule in _RULE_OF.items():
            value = getattr(self, key)
            if value is not None and self.rule != rule:
                arrived = f'{describe_value(value) if key == "order" else format_number(value)} with rule "{self.rule}"'
                problems.append(Problem(key, arrived, f'rule = "{rule}", or no {key}'))
            if value is None and self.rule == rule and key != "order":
                problems.append(Problem(key, "nothing", f'a number (s), which rule "{rule}" needs'))
        return problems

    @property
    def is_common(self) -> bool:
        """Whether all aircraft arrive at one time."""
        return self.rule in ("together", "earliest", "at") or (self.rule == "sequence" and self.spacing_s == 0.0)

    def arrive_together(self, aircraft: Aircraft, second_aircraft: Aircraft) -> bool:
        """Whether this rule makes two aircraft of the fleet arrive at the same time."""
        return self.is_common or (self.rule == "times" and aircraft.arrive_s == second_aircraft.arrive_s)


def arrival_problems(scenario: "Scenario") -> list[Problem]:
    """List missing or unused arrival times, an invalid order, and arrivals after the end of the flight.

    Requires that the names of the aircraft are unique.
    """
    aircraft_tables, arrival, timing = scenario.aircraft, scenario.arrival, scenario.timing
    problems = [] if arrival.time_s is None else _end_of_flight_problems("arrival.time_s", arrival.time_s, timing)
    for index, aircraft in enumerate(aircraft_tables):
        problems.extend(_aircraft_time_problems(f"aircraft[{index}]", aircraft, arrival, timing))
    if arrival.order is not None:
        problems.extend(_sequence_problems(arrival.order, aircraft_tables))
    if arrival.spacing_s is not None:
        lasting_s = (len(aircraft_tables) - 1) * arrival.spacing_s
        if lasting_s >= timing.duration_s:
            arrived = (
                f"{format_number(arrival.spacing_s)}, which is {format_number(lasting_s)} s from the "
                "first arrival to the last"
            )
            expected = (
                "a spacing with which all arrive before timing.duration_s, which is "
                f"{format_number(timing.duration_s)} s"
            )
            problems.append(Problem("arrival.spacing_s", arrived, expected))
    return problems


def _aircraft_time_problems(path: str, aircraft: Aircraft, arrival: Arrival, timing: Timing) -> list[Problem]:
    """List invalid arrival times of one aircraft."""
    problems, subject = [], label("aircraft", aircraft)
    for key, rule in _RULE_OF_AIRCRAFT.items():
        time_s: float | None = getattr(aircraft, key)
        key_path = f"{path}.{key}"
        if time_s is None:
            if arrival.rule == rule:
                expected = f'a time (s), which arrival.rule "{rule}" needs of every aircraft'
                problems.append(Problem(key_path, "nothing", expected, subject))
        elif arrival.rule != rule:
            expected = f'arrival.rule = "{rule}", or no {key}'
            problems.append(
                Problem(key_path, f'{format_number(time_s)} with arrival.rule "{arrival.rule}"', expected, subject)
            )
        else:
            problems.extend(_end_of_flight_problems(key_path, time_s, timing, subject))
    if problems or aircraft.arrive_from_s is None or aircraft.arrive_to_s is None:
        return problems
    if aircraft.arrive_from_s >= aircraft.arrive_to_s:
        expected = f"less than arrive_to_s, which is {format_number(aircraft.arrive_to_s)} s"
        problems.append(Problem(f"{path}.arrive_from_s", format_number(aircraft.arrive_from_s), expected, subject))
    return problems


def _end_of_flight_problems(path: str, time_s: float, timing: Timing, subject: str = "") -> list[Problem]:
    """List an arrival time at or after the end of the flight."""
    if time_s < timing.duration_s:
        return []
    return [
        Problem(
            path,
            format_number(time_s),
            f"less than timing.duration_s, which is {format_number(timing.duration_s)} s",
            subject,
        )
    ]


def _sequence_problems(order: tuple[str, ...], aircraft_tables: tuple[Aircraft, ...]) -> list[Problem]:
    """List unknown, repeated and missing names in the arrival order."""
    problems = []
    names = [aircraft.name for aircraft in aircraft_tables]
    for index, name in enumerate(order):
        if name not in names:
            expected = "the name of an aircraft of this scenario"
            problems.append(Problem(f"arrival.order[{index}]", describe_value(name), expected))
        elif name in order[:index]:
            arrived = f"{describe_value(name)}, already arrival.order[{order.index(name)}]"
            problems.append(Problem(f"arrival.order[{index}]", arrived, "every aircraft once"))
    if not problems and len(order) < len(names):
        missing = ", ".join(describe_value(name) for name in names if name not in order)
        problems.append(Problem("arrival.order", f"a list without {missing}", "every aircraft once"))
    return problems


class Separation(Table):
    """Minimum separation of any two aircraft, also in their holds: either horizontal or vertical suffices."""

    horizontal_m: float = number("horizontal distance; 0: no requirement", 0, 50_000, "m", 0.0)
    vertical_m: float = number(
        "difference in altitude that suffices instead; 0: altitude does not count", 0, 5_000, "m", 0.0
    )
    reserve_m: float = number("margin added to both by the plan, for path-following errors", 0, 1_000, "m", 10.0)

    def consistency_problems(self) -> list[Problem]:
        """List a vertical separation without a horizontal separation."""
        if self.horizontal_m > 0.0 or self.vertical_m == 0.0:
            return []
        expected = "horizontal_m above 0 beside it: aircraft are apart in the plane or in altitude"
        return [Problem("vertical_m", f"{format_number(self.vertical_m)} without horizontal_m", expected)]

    @property
    def required_m(self) -> tuple[float, float] | None:
        """Required separation (horizontal, vertical), m; None if no separation is required."""
        return (self.horizontal_m, self.vertical_m) if self.horizontal_m > 0.0 else None

    def is_satisfied(self, first_m: Vector, second_m: Vector) -> bool:
        """Whether two positions (north, east, up), m, satisfy the separation, without the reserve."""
        vertical_distance_m = abs(first_m[2] - second_m[2])
        return math.dist(first_m[:2], second_m[:2]) >= self.horizontal_m or 0.0 < self.vertical_m <= vertical_distance_m


class KeepOut(Table):
    """An upright cylinder closed to all aircraft, at rest or in steady motion over the ground."""

    name: str = identifier("name of the cylinder, unique")
    north_m: float = number("centre, north of the origin at time 0", -POSITION_MAX_M, POSITION_MAX_M, "m")
    east_m: float = number("centre, east of the origin at time 0", -POSITION_MAX_M, POSITION_MAX_M, "m")
    radius_m: float = number("radius of the cylinder", 10, 200_000, "m")
    bottom_m: float = number("bottom above sea level", 0, ALTITUDE_MAX_M, "m", 0.0)
    top_m: float = number("top above sea level", 0, ALTITUDE_MAX_M, "m", ALTITUDE_MAX_M)
    speed_m_s: float = number("speed over the ground", 0, SPEED_MAX_M_S, "m/s", 0.0)
    course_deg: float = number("direction of its motion over the ground", -360, 360, "deg", 0.0)

    def consistency_problems(self) -> list[Problem]:
        """List a cylinder without height."""
        return ordering_problems(self, "bottom_m", "top_m", "m")

    def velocity_m_s(self) -> Vector:
        """Velocity over the ground (north, east, up), m/s."""
        return velocity_on_course(self.speed_m_s, self.course_deg)

    def contains(self, position_m: Vector) -> bool:
        """Whether a position (north, east, up), m, is inside the cylinder at time 0; points on its surface are not."""
        distance_m = math.dist(position_m[:2], (self.north_m, self.east_m))
        return distance_m < self.radius_m and self.bottom_m < position_m[2] < self.top_m


def separation_problems(scenario: "Scenario") -> list[Problem]:
    """List aircraft whose starts violate the separation."""
    aircraft_tables, separation = scenario.aircraft, scenario.separation
    problems = []
    vertical = f" or {format_number(separation.vertical_m)} m in altitude" if separation.vertical_m else ""
    expected = f"a start {format_number(separation.horizontal_m)} m away in the plane{vertical}, as [separation] asks"
    if separation.horizontal_m == 0.0:
        return problems
    positions_m = [aircraft_row.start.position_m for aircraft_row in aircraft_tables]

    def too_close(i: int, j: int) -> bool:
        return math.dist(positions_m[i], positions_m[j]) >= SAME_POSITION_M and not separation.is_satisfied(
            positions_m[i], positions_m[j]
        )

    for group in connected_groups(len(aircraft_tables), too_close):
        pairs = [(i, j) for i in group for j in group if j < i and too_close(i, j)]
        index, neighbour = min(pairs, key=lambda pair: math.dist(positions_m[pair[0]], positions_m[pair[1]]))
        position_m, neighbour_m = positions_m[index], positions_m[neighbour]
        # rounded down, so a distance just below the requirement is not shown as equal to it
        horizontal_m, vertical_m = (
            _floor_to_tenths(math.dist(position_m[:2], neighbour_m[:2])),
            _floor_to_tenths(abs(position_m[2] - neighbour_m[2])),
        )
        arrived = (
            f"a start {horizontal_m} m in the plane and {vertical_m} m in altitude from "
            f"{format_list('aircraft', aircraft_tables, [neighbour])}"
        )
        if len(group) > 2:
            arrived += (
                f", the closest of {len(pairs)} pairs too close among {format_list('aircraft', aircraft_tables, group)}"
            )
        problems.append(
            Problem(f"aircraft[{index}].start", arrived, expected, label("aircraft", aircraft_tables[index]))
        )
    return problems


def keep_out_problems(scenario: "Scenario") -> list[Problem]:
    """List keep-outs with the same name, starts inside a keep-out, and rendezvous points that stay inside a keep-out.

    Requires that the goal of every aircraft exists.
    """
    keep_outs, aircraft_tables, goals = scenario.keep_out, scenario.aircraft, scenario.goal
    problems = []
    names = [aircraft.name for aircraft in keep_outs]
    by_name = {goal.name: goal for goal in goals}
    for index, keep_out in enumerate(keep_outs):
        if keep_out.name in names[:index]:
            arrived_name = f'"{keep_out.name}", already the name of keep_out[{names.index(keep_out.name)}]'
            subject = f'keep_out "{keep_out.name}"'
            problems.append(Problem(f"keep_out[{index}].name", arrived_name, "a name of its own", subject))
        inside = f'inside keep_out[{index}] "{keep_out.name}"'
        below, above = f"below {format_number(keep_out.bottom_m)} m", f"above {format_number(keep_out.top_m)} m"
        outside = f"at least {format_number(keep_out.radius_m)} m from its middle, {below} or {above}"
        for aircraft_index, aircraft in enumerate(aircraft_tables):
            path, subject, goal = f"aircraft[{aircraft_index}]", label("aircraft", aircraft), by_name[aircraft.goal]
            if keep_out.contains(aircraft.start.position_m):
                problems.append(Problem(f"{path}.start", f"a start {inside}", f"a start {outside}", subject))
            north_m, east_m, up_m = goal.position_m(0.0)
            off_north_m, off_east_m, off_up_m = aircraft.rendezvous.stand_off_m
            if keep_out.contains((north_m + off_north_m, east_m + off_east_m, up_m + off_up_m)) and _have_equal_motion(
                goal, keep_out
            ):
                arrived = f'a rendezvous point {inside}, which moves as goal "{goal.name}" does and so never leaves it'
                problems.append(Problem(f"{path}.rendezvous", arrived, f"a rendezvous point {outside}", subject))
    return problems


def same_point_problems(scenario: "Scenario") -> list[Problem]:
    """List aircraft with the same rendezvous point and arrival time."""
    aircraft_tables = scenario.aircraft
    problems = []

    def meet(i: int, j: int) -> bool:
        aircraft_i, aircraft_j = aircraft_tables[i], aircraft_tables[j]
        distance_m = math.dist(aircraft_i.rendezvous.stand_off_m, aircraft_j.rendezvous.stand_off_m)
        return (
            aircraft_j.goal == aircraft_i.goal
            and distance_m < SAME_POSITION_M
            and scenario.arrival.arrive_together(aircraft_i, aircraft_j)
        )

    for first_index, *later_indices in connected_groups(len(aircraft_tables), meet):
        addition = (
            f", also that of {format_list('aircraft', aircraft_tables, later_indices[1:])}"
            if len(later_indices) > 1
            else ""
        )
        arrived = (
            f"the rendezvous point of {format_list('aircraft', aircraft_tables, [first_index])} at the same "
            f"goal{addition}"
        )
        expected = f"stand-offs that keep them at least {SAME_POSITION_M:g} m apart: they arrive at the same time"
        subject = label("aircraft", aircraft_tables[later_indices[0]])
        problems.append(Problem(f"aircraft[{later_indices[0]}].rendezvous", arrived, expected, subject))
    return problems


def _floor_to_tenths(length_m: float) -> str:
    return f"{math.floor(10.0 * length_m) / 10.0:.1f}"


def _have_equal_motion(goal: Goal, keep_out: KeepOut) -> bool:
    """Whether goal and cylinder move with the same velocity."""
    if goal.waypoints is None:
        return goal.velocity_m_s() == keep_out.velocity_m_s()
    positions = {(point.north_m, point.east_m, point.altitude_m) for point in goal.waypoints}
    return len(positions) == 1 and keep_out.speed_m_s == 0.0
