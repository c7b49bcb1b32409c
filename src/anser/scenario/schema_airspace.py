"""Tables of a scenario for arrival times, separation and keep-out volumes, with their checks."""

import math
from typing import Annotated, Literal

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

RULES = ("together", "earliest", "at", "sequence", "times", "windows")

_RULE_OF = {"time_s": "at", "spacing_s": "sequence", "order": "sequence"}
_RULE_OF_AIRCRAFT = {"arrive_s": "times", "arrive_from_s": "windows", "arrive_to_s": "windows"}


class Arrival(Table):
    """The rule that sets the times of arrival."""

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
        description='who arrives after whom, with rule "sequence"; left out: as in the file',
        json_schema_extra=expects('a list of the names of all aircraft, such as ["first", "second"]'),
    )

    def consistency_problems(self) -> list[Problem]:
        """Find keys that the rule does not know or lacks."""
        found = []
        for key, rule in _RULE_OF.items():
            value = getattr(self, key)
            if value is not None and self.rule != rule:
                arrived = f'{describe_value(value) if key == "order" else format_number(value)} with rule "{self.rule}"'
                found.append(Problem(key, arrived, f'rule = "{rule}", or no {key}'))
            if value is None and self.rule == rule and key != "order":
                found.append(Problem(key, "nothing", f'a number (s), which rule "{rule}" needs'))
        return found

    @property
    def is_common(self) -> bool:
        """Whether all arrive at one time."""
        return self.rule in ("together", "earliest", "at") or (self.rule == "sequence" and self.spacing_s == 0.0)

    def arrive_together(self, aircraft: Aircraft, other: Aircraft) -> bool:
        """Say whether two aircraft of the fleet arrive at the same time by this rule."""
        return self.is_common or (self.rule == "times" and aircraft.arrive_s == other.arrive_s)


def arrival_problems(arrival: Arrival, aircraft: tuple[Aircraft, ...], timing: Timing) -> list[Problem]:
    """Find times that the rule lacks or does not know, an order that is none, and arrivals after the flight.

    The names of the aircraft are unique.
    """
    found = [] if arrival.time_s is None else _late_problems("arrival.time_s", arrival.time_s, timing)
    for index, one in enumerate(aircraft):
        found.extend(_aircraft_time_problems(f"aircraft[{index}]", one, arrival, timing))
    if arrival.order is not None:
        found.extend(_sequence_problems(arrival.order, aircraft))
    if arrival.spacing_s is not None:
        lasting_s = (len(aircraft) - 1) * arrival.spacing_s
        if lasting_s >= timing.duration_s:
            arrived = (
                f"{format_number(arrival.spacing_s)}, which is {format_number(lasting_s)} s from the "
                "first arrival to the last"
            )
            words = (
                "a spacing with which all arrive before timing.duration_s, which is "
                f"{format_number(timing.duration_s)} s"
            )
            found.append(Problem("arrival.spacing_s", arrived, words))
    return found


def _aircraft_time_problems(path: str, aircraft: Aircraft, arrival: Arrival, timing: Timing) -> list[Problem]:
    """Find what is wrong with the times of one aircraft."""
    found, whom = [], label("aircraft", aircraft)
    for key, rule in _RULE_OF_AIRCRAFT.items():
        time_s: float | None = getattr(aircraft, key)
        where = f"{path}.{key}"
        if time_s is None:
            if arrival.rule == rule:
                words = f'a time (s), which arrival.rule "{rule}" needs of every aircraft'
                found.append(Problem(where, "nothing", words, whom))
        elif arrival.rule != rule:
            words = f'arrival.rule = "{rule}", or no {key}'
            found.append(Problem(where, f'{format_number(time_s)} with arrival.rule "{arrival.rule}"', words, whom))
        else:
            found.extend(_late_problems(where, time_s, timing, whom))
    if found or aircraft.arrive_from_s is None or aircraft.arrive_to_s is None:
        return found
    if aircraft.arrive_from_s >= aircraft.arrive_to_s:
        words = f"less than arrive_to_s, which is {format_number(aircraft.arrive_to_s)} s"
        found.append(Problem(f"{path}.arrive_from_s", format_number(aircraft.arrive_from_s), words, whom))
    return found


def _late_problems(path: str, time_s: float, timing: Timing, whom: str = "") -> list[Problem]:
    """Find a time of arrival at the end of the flight or after it."""
    if time_s < timing.duration_s:
        return []
    return [
        Problem(
            path,
            format_number(time_s),
            f"less than timing.duration_s, which is {format_number(timing.duration_s)} s",
            whom,
        )
    ]


def _sequence_problems(order: tuple[str, ...], aircraft: tuple[Aircraft, ...]) -> list[Problem]:
    """Find names of the order that no aircraft has or that come twice, and aircraft that it leaves out."""
    found = []
    names = [one.name for one in aircraft]
    for index, name in enumerate(order):
        if name not in names:
            words = "the name of an aircraft of this scenario"
            found.append(Problem(f"arrival.order[{index}]", describe_value(name), words))
        elif name in order[:index]:
            taken = f"{describe_value(name)}, already arrival.order[{order.index(name)}]"
            found.append(Problem(f"arrival.order[{index}]", taken, "every aircraft once"))
    if not found and len(order) < len(names):
        missing = ", ".join(describe_value(name) for name in names if name not in order)
        found.append(Problem("arrival.order", f"a list without {missing}", "every aircraft once"))
    return found


class Separation(Table):
    """How far apart any two aircraft stay, holds included: in the plane or in altitude."""

    horizontal_m: float = number("distance in the plane; 0 asks for none", 0, 50_000, "m", 0.0)
    vertical_m: float = number(
        "difference in altitude that does instead; 0: altitude does not count", 0, 5_000, "m", 0.0
    )
    reserve_m: float = number("what the plan adds to both, for the errors of flight", 0, 1_000, "m", 10.0)

    def consistency_problems(self) -> list[Problem]:
        """Find altitudes without a distance in the plane."""
        if self.horizontal_m > 0.0 or self.vertical_m == 0.0:
            return []
        words = "horizontal_m above 0 beside it: aircraft are apart in the plane or in altitude"
        return [Problem("vertical_m", f"{format_number(self.vertical_m)} without horizontal_m", words)]

    @property
    def required_m(self) -> tuple[float, float] | None:
        """Distances in the plane and in altitude, m; None where none is asked for."""
        return (self.horizontal_m, self.vertical_m) if self.horizontal_m > 0.0 else None

    def is_satisfied(self, one_m: Vector, other_m: Vector) -> bool:
        """Say whether two places (north, east, up; m) are far enough apart, without the reserve."""
        apart_up_m = abs(one_m[2] - other_m[2])
        return math.dist(one_m[:2], other_m[:2]) >= self.horizontal_m or 0.0 < self.vertical_m <= apart_up_m


class KeepOut(Table):
    """An upright cylinder that no aircraft enters, at rest or moving steadily over the ground."""

    name: str = identifier("name of the cylinder, unique")
    north_m: float = number("its middle north of the origin at time 0", -POSITION_MAX_M, POSITION_MAX_M, "m")
    east_m: float = number("its middle east of the origin at time 0", -POSITION_MAX_M, POSITION_MAX_M, "m")
    radius_m: float = number("its radius", 10, 200_000, "m")
    bottom_m: float = number("its bottom above sea level", 0, ALTITUDE_MAX_M, "m", 0.0)
    top_m: float = number("its top above sea level", 0, ALTITUDE_MAX_M, "m", ALTITUDE_MAX_M)
    speed_m_s: float = number("its speed over the ground", 0, SPEED_MAX_M_S, "m/s", 0.0)
    course_deg: float = number("direction of its motion over the ground", -360, 360, "deg", 0.0)

    def consistency_problems(self) -> list[Problem]:
        """Find a cylinder without a height."""
        return ordering_problems(self, "bottom_m", "top_m", "m")

    def velocity_m_s(self) -> Vector:
        """Velocity over the ground (north, east, up), m/s."""
        return velocity_on_course(self.speed_m_s, self.course_deg)

    def contains(self, place_m: Vector) -> bool:
        """Say whether a place (north, east, up; m) is inside at time 0; its surface is outside."""
        away_m = math.dist(place_m[:2], (self.north_m, self.east_m))
        return away_m < self.radius_m and self.bottom_m < place_m[2] < self.top_m


def separation_problems(aircraft: tuple[Aircraft, ...], separation: Separation) -> list[Problem]:
    """Find aircraft that start closer than the separation."""
    found = []
    vertical = f" or {format_number(separation.vertical_m)} m in altitude" if separation.vertical_m else ""
    words = f"a start {format_number(separation.horizontal_m)} m away in the plane{vertical}, as [separation] asks"
    if separation.horizontal_m == 0.0:
        return found
    at_m = [one.start.position_m for one in aircraft]

    def too_close(i: int, j: int) -> bool:
        return math.dist(at_m[i], at_m[j]) >= SAME_POSITION_M and not separation.is_satisfied(at_m[i], at_m[j])

    for group in connected_groups(len(aircraft), too_close):
        pairs = [(i, j) for i in group for j in group if j < i and too_close(i, j)]
        index, other = min(pairs, key=lambda pair: math.dist(at_m[pair[0]], at_m[pair[1]]))
        here_m, there_m = at_m[index], at_m[other]
        # rounded down, so that a distance that is too small by little does not read as the one asked for
        away_m, up_m = _tenths(math.dist(here_m[:2], there_m[:2])), _tenths(abs(here_m[2] - there_m[2]))
        arrived = (
            f"a start {away_m} m in the plane and {up_m} m in altitude from "
            f"{format_list('aircraft', aircraft, [other])}"
        )
        if len(group) > 2:
            arrived += f", the closest of {len(pairs)} pairs too close among {format_list('aircraft', aircraft, group)}"
        found.append(Problem(f"aircraft[{index}].start", arrived, words, label("aircraft", aircraft[index])))
    return found


def keep_out_problems(
    keep_outs: tuple[KeepOut, ...], aircraft: tuple[Aircraft, ...], goals: tuple[Goal, ...]
) -> list[Problem]:
    """Find names used twice, starts inside a keep-out, and rendezvous points that never leave one.

    Every aircraft's goal exists.
    """
    found = []
    names = [one.name for one in keep_outs]
    by_name = {goal.name: goal for goal in goals}
    for index, keep_out in enumerate(keep_outs):
        if keep_out.name in names[:index]:
            taken = f'"{keep_out.name}", already the name of keep_out[{names.index(keep_out.name)}]'
            whom = f'keep_out "{keep_out.name}"'
            found.append(Problem(f"keep_out[{index}].name", taken, "a name of its own", whom))
        inside = f'inside keep_out[{index}] "{keep_out.name}"'
        below, above = f"below {format_number(keep_out.bottom_m)} m", f"above {format_number(keep_out.top_m)} m"
        outside = f"at least {format_number(keep_out.radius_m)} m from its middle, {below} or {above}"
        for place, one in enumerate(aircraft):
            path, whom, goal = f"aircraft[{place}]", label("aircraft", one), by_name[one.goal]
            if keep_out.contains(one.start.position_m):
                found.append(Problem(f"{path}.start", f"a start {inside}", f"a start {outside}", whom))
            north_m, east_m, up_m = goal.position_m(0.0)
            off_north_m, off_east_m, off_up_m = one.rendezvous.stand_off_m
            if keep_out.contains((north_m + off_north_m, east_m + off_east_m, up_m + off_up_m)) and _move_alike(
                goal, keep_out
            ):
                arrived = f'a rendezvous point {inside}, which moves as goal "{goal.name}" does and so never leaves it'
                found.append(Problem(f"{path}.rendezvous", arrived, f"a rendezvous point {outside}", whom))
    return found


def same_point_problems(aircraft: tuple[Aircraft, ...], arrival: Arrival) -> list[Problem]:
    """Find two aircraft sent to one point at one time."""
    found = []

    def meet(i: int, j: int) -> bool:
        one, other = aircraft[i], aircraft[j]
        apart_m = math.dist(one.rendezvous.stand_off_m, other.rendezvous.stand_off_m)
        return other.goal == one.goal and apart_m < SAME_POSITION_M and arrival.arrive_together(one, other)

    for first, *others in connected_groups(len(aircraft), meet):
        also = f", also that of {format_list('aircraft', aircraft, others[1:])}" if len(others) > 1 else ""
        arrived = f"the rendezvous point of {format_list('aircraft', aircraft, [first])} at the same goal{also}"
        words = f"stand-offs that keep them at least {SAME_POSITION_M:g} m apart: they arrive at the same time"
        whom = label("aircraft", aircraft[others[0]])
        found.append(Problem(f"aircraft[{others[0]}].rendezvous", arrived, words, whom))
    return found


def _tenths(length_m: float) -> str:
    return f"{math.floor(10.0 * length_m) / 10.0:.1f}"


def _move_alike(goal: Goal, keep_out: KeepOut) -> bool:
    """Say whether goal and cylinder stay as they are to each other for good."""
    if goal.waypoints is None:
        return goal.velocity_m_s() == keep_out.velocity_m_s()
    places = {(point.north_m, point.east_m, point.altitude_m) for point in goal.waypoints}
    return len(places) == 1 and keep_out.speed_m_s == 0.0
