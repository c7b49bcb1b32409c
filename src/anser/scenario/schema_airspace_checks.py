"""Checks of starts, arrival times, rendezvous points and keep-out volumes of a fleet against each other."""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence

from anser.config.errors import Problem, describe_value, format_number
from anser.config.tables import Vector
from anser.scenario.schema_aircraft import Aircraft, Goal
from anser.scenario.schema_airspace import Arrival, KeepOut
from anser.scenario.schema_settings import Timing
from anser.scenario.schema_tables import ScenarioTables

SAME_POSITION_M = 10.0  # about the span of the aircraft
_RULE_OF_KEY = {"arrive_s": "times", "arrive_from_s": "windows", "arrive_to_s": "windows"}


def connected_groups(count: int, is_connected: Callable[[int, int], bool]) -> list[list[int]]:
    """Return the connected components with two or more nodes of a graph with the nodes 0 to `count` - 1.

    `is_connected` tells whether two nodes have an edge; the nodes of a component are in rising order.
    """
    groups: list[list[int]] = []
    for index in range(count):
        joined = [group for group in groups if any(is_connected(index, member) for member in group)]
        groups = [group for group in groups if group not in joined]
        groups.append(sorted([index, *itertools.chain(*joined)]))
    return sorted(group for group in groups if len(group) > 1)


def _list_aircraft(aircraft: Sequence[Aircraft], indices: Sequence[int]) -> str:
    """Return the text of aircraft with `indices` for a message: ``aircraft[0] "north" and aircraft[2] "south"``."""
    names = [f'aircraft[{index}] "{aircraft[index].name}"' for index in indices]
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _coinciding(
    aircraft: Sequence[Aircraft], coincide: Callable[[int, int], bool]
) -> Iterator[tuple[int, str, str, str]]:
    """Yield index and label of the second of each group of coinciding aircraft, and texts on the first and the rest."""
    for reference, duplicate, *further_indices in connected_groups(len(aircraft), coincide):
        addition = f", also that of {_list_aircraft(aircraft, further_indices)}" if further_indices else ""
        yield duplicate, aircraft[duplicate].label, _list_aircraft(aircraft, [reference]), addition


def same_start_problems(scenario: ScenarioTables) -> list[Problem]:
    """Return a problem for each group of aircraft with starts less than `SAME_POSITION_M` apart."""
    positions_m = [aircraft.start.position_m for aircraft in scenario.aircraft]
    expected = f"a start at least {SAME_POSITION_M:g} m from every other"
    return [
        Problem(f"aircraft[{index}].start", f"the place of {reference}{addition}", expected, subject)
        for index, subject, reference, addition in _coinciding(
            scenario.aircraft, lambda i, j: math.dist(positions_m[i], positions_m[j]) < SAME_POSITION_M
        )
    ]


def same_point_problems(scenario: ScenarioTables) -> list[Problem]:
    """Return a problem for each group of aircraft with the same goal, rendezvous point and arrival time."""

    def meet(i: int, j: int) -> bool:
        a, b = scenario.aircraft[i], scenario.aircraft[j]
        distance_m = math.dist(a.rendezvous.stand_off_m, b.rendezvous.stand_off_m)
        return a.goal == b.goal and distance_m < SAME_POSITION_M and scenario.arrival.arrive_together(a, b)

    expected = f"stand-offs that keep them at least {SAME_POSITION_M:g} m apart: they arrive at the same time"
    return [
        Problem(
            f"aircraft[{index}].rendezvous",
            f"the rendezvous point of {reference} at the same goal{addition}",
            expected,
            subject,
        )
        for index, subject, reference, addition in _coinciding(scenario.aircraft, meet)
    ]


def separation_problems(scenario: ScenarioTables) -> list[Problem]:
    """Return a problem on the closest pair of each group of aircraft whose starts violate the separation."""
    aircraft, separation = scenario.aircraft, scenario.separation
    if separation.horizontal_m == 0.0:
        return []
    problems, positions_m = [], [member.start.position_m for member in aircraft]
    vertical = f" or {format_number(separation.vertical_m)} m in altitude" if separation.vertical_m else ""
    expected = f"a start {format_number(separation.horizontal_m)} m away in the plane{vertical}, as [separation] asks"

    def too_close(i: int, j: int) -> bool:
        position_m, neighbour_m = positions_m[i], positions_m[j]
        is_apart = separation.is_satisfied(position_m, neighbour_m)
        return math.dist(position_m, neighbour_m) >= SAME_POSITION_M and not is_apart

    for group in connected_groups(len(aircraft), too_close):
        pairs = [(i, j) for i in group for j in group if j < i and too_close(i, j)]
        index, neighbour = min(pairs, key=lambda pair: math.dist(positions_m[pair[0]], positions_m[pair[1]]))
        distances_m = _rounded_down_distances(positions_m[index], positions_m[neighbour])
        arrived = f"a start {distances_m} from {_list_aircraft(aircraft, [neighbour])}"
        if len(group) > 2:
            arrived += f", the closest of {len(pairs)} pairs too close among {_list_aircraft(aircraft, group)}"
        problems.append(Problem(f"aircraft[{index}].start", arrived, expected, aircraft[index].label))
    return problems


def _rounded_down_distances(position_m: Vector, neighbour_m: Vector) -> str:
    """Describe horizontal distance and altitude difference, rounded down so that they stay below a requirement."""
    lengths_m = math.dist(position_m[:2], neighbour_m[:2]), abs(position_m[2] - neighbour_m[2])
    horizontal, vertical = (f"{math.floor(10.0 * length_m) / 10.0:.1f}" for length_m in lengths_m)
    return f"{horizontal} m in the plane and {vertical} m in altitude"


def arrival_problems(scenario: ScenarioTables) -> list[Problem]:
    """List missing or unused arrival times, an invalid order, and arrivals not before the end of the flight.

    The names of the aircraft must be unique.
    """
    aircraft_tables, arrival, timing = scenario.aircraft, scenario.arrival, scenario.timing
    problems = [] if arrival.time_s is None else _end_of_flight_problems("arrival.time_s", arrival.time_s, timing)
    for index, aircraft in enumerate(aircraft_tables):
        problems.extend(_aircraft_time_problems(f"aircraft[{index}]", aircraft, arrival, timing))
    if arrival.order is not None:
        problems.extend(_sequence_problems(arrival.order, [aircraft.name for aircraft in aircraft_tables]))
    if arrival.spacing_s is not None:
        lasting_s, duration = (len(aircraft_tables) - 1) * arrival.spacing_s, format_number(timing.duration_s)
        if lasting_s >= timing.duration_s:
            lasting = f"which is {format_number(lasting_s)} s from the first arrival to the last"
            expected = f"a spacing with which all arrive before timing.duration_s, which is {duration} s"
            problems.append(Problem("arrival.spacing_s", f"{format_number(arrival.spacing_s)}, {lasting}", expected))
    return problems


def _aircraft_time_problems(path: str, aircraft: Aircraft, arrival: Arrival, timing: Timing) -> list[Problem]:
    """List arrival times of one aircraft that are missing, not used by the arrival rule, too late, or not in order."""
    problems = []
    for key, rule in _RULE_OF_KEY.items():
        time_s: float | None = getattr(aircraft, key)
        if time_s is None and arrival.rule == rule:
            expected = f'a time (s), which arrival.rule "{rule}" needs of every aircraft'
            problems.append(Problem(f"{path}.{key}", "nothing", expected, aircraft.label))
        elif time_s is not None and arrival.rule != rule:
            arrived = f'{format_number(time_s)} with arrival.rule "{arrival.rule}"'
            problems.append(Problem(f"{path}.{key}", arrived, f'arrival.rule = "{rule}", or no {key}', aircraft.label))
        elif time_s is not None:
            problems.extend(_end_of_flight_problems(f"{path}.{key}", time_s, timing, aircraft.label))
    from_s, to_s = aircraft.arrive_from_s, aircraft.arrive_to_s
    if not problems and from_s is not None and to_s is not None and from_s >= to_s:
        expected = f"less than arrive_to_s, which is {format_number(to_s)} s"
        problems.append(Problem(f"{path}.arrive_from_s", format_number(from_s), expected, aircraft.label))
    return problems


def _end_of_flight_problems(path: str, time_s: float, timing: Timing, subject: str = "") -> list[Problem]:
    """Return a problem if the arrival time `time_s` at the key `path` is not before the end of the flight."""
    expected = f"less than timing.duration_s, which is {format_number(timing.duration_s)} s"
    return [Problem(path, format_number(time_s), expected, subject)] if time_s >= timing.duration_s else []


def _sequence_problems(order: Sequence[str], names: Sequence[str]) -> list[Problem]:
    """List unknown, repeated and missing names in the arrival order."""
    problems = []
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


def keep_out_problems(scenario: ScenarioTables) -> list[Problem]:
    """List keep-outs with the same name, starts inside a keep-out, and rendezvous points that stay inside a keep-out.

    The goal of every aircraft must exist. For keep-outs in events, only the names are checked.
    """
    problems, path_of = [], {}
    appearing = ((f"event[{k}].keep_out", event.keep_out) for k, event in enumerate(scenario.event) if event.keep_out)
    for path, keep_out in [*((f"keep_out[{k}]", table) for k, table in enumerate(scenario.keep_out)), *appearing]:
        if keep_out.name in path_of:
            arrived = f'"{keep_out.name}", already the name of {path_of[keep_out.name]}'
            problems.append(Problem(f"{path}.name", arrived, "a name of its own", f'keep_out "{keep_out.name}"'))
        path_of.setdefault(keep_out.name, path)
    for index, keep_out in enumerate(scenario.keep_out):
        inside = f'inside keep_out[{index}] "{keep_out.name}"'
        below, above = f"below {format_number(keep_out.bottom_m)} m", f"above {format_number(keep_out.top_m)} m"
        outside = f"at least {format_number(keep_out.radius_m)} m from its middle, {below} or {above}"
        for k, aircraft in enumerate(scenario.aircraft):
            goal, stand_off_m = scenario.goal_of(aircraft), aircraft.rendezvous.stand_off_m
            if keep_out.contains(aircraft.start.position_m):
                arrived, expected = f"a start {inside}", f"a start {outside}"
                problems.append(Problem(f"aircraft[{k}].start", arrived, expected, aircraft.label))
            north_m, east_m, up_m = (a + b for a, b in zip(goal.position_m(0.0), stand_off_m, strict=True))
            if keep_out.contains((north_m, east_m, up_m)) and _have_equal_motion(goal, keep_out):
                arrived = f'a rendezvous point {inside}, which moves as goal "{goal.name}" does and so never leaves it'
                expected = f"a rendezvous point {outside}"
                problems.append(Problem(f"aircraft[{k}].rendezvous", arrived, expected, aircraft.label))
    return problems


def _have_equal_motion(goal: Goal, keep_out: KeepOut) -> bool:
    """Whether goal and keep-out move with the same constant velocity, or are both at rest."""
    if goal.waypoints is None:
        return goal.velocity_m_s() == keep_out.velocity_m_s()
    positions = {point.position_m for point in goal.waypoints}
    return len(positions) == 1 and keep_out.speed_m_s == 0.0
