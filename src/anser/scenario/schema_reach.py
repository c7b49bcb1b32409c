"""Checks that every aircraft can reach its goal, made in the frame of the moving air (theory section 7)."""

import itertools
import math
from dataclasses import dataclass

from anser.config.errors import Problem, format_number
from anser.config.tables import Vector
from anser.constants import STANDARD_GRAVITY_M_S2
from anser.scenario.schema_aircraft import Aircraft, Goal
from anser.scenario.schema_tables import ScenarioTables

FLIGHT_MIN_S = 1.0
_HALVINGS = 40  # bisection steps, which resolve the longest flight to less than a microsecond


@dataclass(frozen=True)
class ReferenceSpeed:
    """True airspeed with which the checks decide whether an aircraft can reach its goal."""

    speed_m_s: float
    key: str  # key of the scenario that sets the airspeed
    is_mean: bool  # True: mean airspeed of the plan; False: greatest airspeed
    # True: the published planner may raise the mean, because the farthest aircraft cannot descend so slowly
    may_rise: bool = False
    # True: the plan uses the wind of all altitudes; False: only the wind at the start of the aircraft
    uses_wind_layers: bool = False

    def __str__(self) -> str:
        return f"{self.key} = {format_number(self.speed_m_s)} m/s"


def reference_speed(scenario: ScenarioTables, aircraft: Aircraft) -> ReferenceSpeed:
    """Return the true airspeed with which the checks decide whether an aircraft can reach its goal.

    If a certified or decentralised planner has an arrival rule other than "together", the result is the greatest
    airspeed of the limits; in all other cases, the result is the preferred airspeed.
    """
    fleet, limits, arrival = scenario.fleet, scenario.limits_for(aircraft), scenario.arrival
    certified = fleet.is_certified
    if not certified or arrival.rule == "together":
        rises = not certified and fleet.speed_profile == "even"
        fleet_key = fleet.airspeed_name("fleet")
        key = f'the {aircraft.airspeed_key} of "{aircraft.name}"' if aircraft.airspeed_forms else fleet_key
        return ReferenceSpeed(
            scenario.speed_for(aircraft), key, is_mean=True, may_rise=rises, uses_wind_layers=certified
        )
    return ReferenceSpeed(limits.speed_max_m_s, "limits.speed_max_m_s", is_mean=False, uses_wind_layers=True)


def time_to_go_s(relative_m: Vector, velocity_m_s: Vector, speed_m_s: float) -> float | None:
    """Compute the least time, s, in which an aircraft on a straight line meets a moving point; None if never.

    `relative_m` (R) is the position of the point relative to the aircraft, `velocity_m_s` (W) is the velocity of the
    point relative to the air, and `speed_m_s` (V) is the airspeed; vectors are (north, east, up). The time is the
    smallest positive root of ``(|W|^2 - V^2) t^2 + 2 (R.W) t + |R|^2 = 0`` (theory section 7).
    """
    squared = _dot(velocity_m_s, velocity_m_s) - speed_m_s**2
    half_linear = _dot(relative_m, velocity_m_s)
    constant = _dot(relative_m, relative_m)
    if constant == 0.0:
        return 0.0
    discriminant = half_linear**2 - squared * constant
    if discriminant < 0.0:
        return None
    # no cancellation for nearly equal speeds
    q = -(half_linear + math.copysign(math.sqrt(discriminant), half_linear))
    roots = [constant / q] if q != 0.0 else []
    if squared != 0.0:
        roots.append(q / squared)
    return min((root for root in roots if root > 0.0), default=None)


def reach_problems(scenario: ScenarioTables, *, unaided: bool = False) -> list[Problem]:
    """List goals that outrun their aircraft, flights that are too short, and rendezvous outside the altitude limits.

    Every aircraft must have a goal, and the wind must be slower than the fleet. If `unaided` is True, neither a descent
    nor a tail wind at another altitude counts as a gain in speed.
    """
    problems = []
    for index, goal in enumerate(scenario.goal):
        # the first plan uses the wind at the aircraft's start
        visitors = [aircraft for aircraft in scenario.aircraft if aircraft.goal == goal.name]
        if not visitors:
            continue
        starts_m = [aircraft.start.altitude_m for aircraft in visitors]
        reference = min(
            (reference_speed(scenario, aircraft) for aircraft in visitors), key=lambda speed: speed.speed_m_s
        )
        winds_m_s = dict.fromkeys(scenario.wind.velocity_m_s(altitude_m) for altitude_m in starts_m)
        problems.extend(_leg_speed_problems(f"goal[{index}]", goal, reference, tuple(winds_m_s)))
    if problems:
        return problems  # the times below need an airspeed that suffices
    for index, aircraft in enumerate(scenario.aircraft):
        reference = reference_speed(scenario, aircraft)
        fastest_m_s = None if unaided else _fastest_mean_airspeed_m_s(scenario, reference)
        problems.extend(_aircraft_reach_problems(f"aircraft[{index}]", aircraft, scenario, reference, fastest_m_s))
    return problems


@dataclass(frozen=True)
class EarlyArrival(Problem):
    """An arrival time that is too early for any flight within the limits."""

    given_s: float = 0.0  #: Arrival time in the scenario, or the end of the arrival window, s.


def arrival_time_problems(scenario: ScenarioTables) -> list[EarlyArrival]:
    """List arrival times that are too early even for a straight flight at the greatest airspeed and tail wind.

    For an arrival window, the end counts. `reach_problems` must find no problem. For a common arrival time of several
    aircraft, only the aircraft that arrives last is reported.
    """
    worst: dict[str, tuple[float, EarlyArrival]] = {}
    arrival = scenario.arrival
    for index, aircraft in enumerate(scenario.aircraft):
        key = "arrive_s" if arrival.rule == "times" else "arrive_to_s"
        required_s, path = getattr(aircraft, key), f"aircraft[{index}].{key}"
        if arrival.rule == "at":
            required_s, path = arrival.time_s, "arrival.time_s"
        if required_s is None:
            continue
        earliest_s = _earliest_arrival_s(scenario, aircraft)
        if required_s < earliest_s and (path not in worst or worst[path][0] < earliest_s):
            fastest = f"limits.speed_max_m_s, which is {format_number(scenario.limits_for(aircraft).speed_max_m_s)} m/s"
            expected = (
                f'at least {math.ceil(10.0 * earliest_s) / 10.0:.1f} s: "{aircraft.name}" gets to goal '
                f'"{aircraft.goal}" no sooner, straight at {fastest}, in this wind'
            )
            worst[path] = (
                earliest_s,
                EarlyArrival(path, format_number(required_s), expected, aircraft.label, given_s=required_s),
            )
    return [problem for _, problem in worst.values()]


def _earliest_arrival_s(scenario: ScenarioTables, aircraft: Aircraft) -> float:
    """Return a lower bound of an aircraft's arrival time, s, for any flight within its limits of airspeed."""
    goal, wind = scenario.goal_of(aircraft), scenario.wind
    wind_m_s = wind.velocity_m_s(aircraft.start.altitude_m)
    tail_wind_m_s = max(math.dist(wind_m_s, layer_wind_m_s) for _, layer_wind_m_s in wind.profile_m_s)
    fastest_m_s = scenario.limits_for(aircraft).speed_max_m_s + tail_wind_m_s

    def remaining_distance_m(time_s: float) -> float:
        rendezvous_m = _plus(goal.position_m(time_s), aircraft.rendezvous.stand_off_m)
        return math.dist(rendezvous_m, _plus(aircraft.start.position_m, wind_m_s, time_s)) - fastest_m_s * time_s

    if goal.waypoints is None:
        rendezvous_m = _plus(goal.position_m(0.0), aircraft.rendezvous.stand_off_m)
        relative_m = _plus(rendezvous_m, aircraft.start.position_m, -1.0)
        return time_to_go_s(relative_m, _plus(goal.velocity_m_s(), wind_m_s, -1.0), fastest_m_s) or 0.0
    # the goal is slower than the aircraft, so the remaining distance decreases
    low_s, high_s = 0.0, scenario.timing.duration_s
    for _ in range(_HALVINGS):
        middle_s = 0.5 * (low_s + high_s)
        low_s, high_s = (middle_s, high_s) if remaining_distance_m(middle_s) > 0.0 else (low_s, middle_s)
    return low_s


def _fastest_mean_airspeed_m_s(scenario: ScenarioTables, reference: ReferenceSpeed) -> float:
    """Return an upper bound of the mean airspeed (m/s) that the planner may choose for the fleet."""
    speeds_m_s = [reference.speed_m_s]
    for aircraft in scenario.aircraft if reference.may_rise else ():
        goal = scenario.goal_of(aircraft)
        if goal.waypoints is None:
            lowest_m = min(goal.altitude_m, goal.position_m(scenario.timing.duration_s)[2])
        else:
            lowest_m = min(point.altitude_m for point in goal.waypoints)
        # without drag, kinetic plus potential energy is constant
        descent_m = max(0.0, aircraft.start.altitude_m - lowest_m - aircraft.rendezvous.stand_off_up_m)
        speeds_m_s.append(math.sqrt(aircraft.start.airspeed_m_s**2 + 2.0 * STANDARD_GRAVITY_M_S2 * descent_m))
    return max(speeds_m_s)


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _plus(a: Vector, b: Vector, factor: float = 1.0) -> Vector:
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


def _leg_speed_problems(
    path: str, goal: Goal, reference: ReferenceSpeed, winds_m_s: tuple[Vector, ...]
) -> list[Problem]:
    """List legs on which a goal is faster through the air than the aircraft, in at least one wind of `winds_m_s`."""
    problems = []
    for index, (leg_start, leg_end) in enumerate(itertools.pairwise(goal.waypoints or ()), 1):
        leg_m = _plus(leg_end.position_m, leg_start.position_m, -1.0)
        through_air = _plus((0.0, 0.0, 0.0), leg_m, 1.0 / (leg_end.time_s - leg_start.time_s))
        speed_m_s = max((math.hypot(*_plus(through_air, wind_m_s, -1.0)) for wind_m_s in winds_m_s), default=0.0)
        if speed_m_s >= reference.speed_m_s:
            arrived = f"a leg flown at {speed_m_s:.1f} m/s through the air"
            expected = (
                f"less than {reference.key}, which is {format_number(reference.speed_m_s)} m/s: the goal outruns its "
                "aircraft"
            )
            problems.append(Problem(f"{path}.waypoints[{index}]", arrived, expected, goal.label))
    return problems


def _aircraft_reach_problems(
    path: str, aircraft: Aircraft, scenario: ScenarioTables, reference: ReferenceSpeed, fastest_m_s: float | None
) -> list[Problem]:
    """List the problems of one aircraft's flight to the rendezvous.

    `fastest_m_s` is an upper bound of the mean airspeed, to which the greatest tail wind is added; None: the reference
    airspeed without tail wind.
    """
    goal, limits, subject = scenario.goal_of(aircraft), scenario.limits_for(aircraft), aircraft.label
    wind, timing = scenario.wind, scenario.timing
    rendezvous_m = _plus(goal.position_m(0.0), aircraft.rendezvous.stand_off_m)
    relative_m = _plus(rendezvous_m, aircraft.start.position_m, -1.0)
    heights_m: list[float] = []
    wind_m_s = wind.velocity_m_s(aircraft.start.altitude_m)
    # greatest difference between the mean wind along the path and the wind at the start, taken as tail wind
    tail_wind_m_s = max(math.dist(wind_m_s, layer_wind_m_s) for _, layer_wind_m_s in wind.profile_m_s)
    greatest_m_s = reference.speed_m_s if fastest_m_s is None else fastest_m_s + tail_wind_m_s
    if goal.waypoints is None:
        velocity_m_s = _plus(goal.velocity_m_s(), wind_m_s, -1.0)
        time_s = time_to_go_s(
            relative_m, velocity_m_s, reference.speed_m_s + (tail_wind_m_s if reference.uses_wind_layers else 0.0)
        )
        if time_s is None:
            arrived = f'"{goal.name}", which moves at {math.hypot(*velocity_m_s):.1f} m/s through the air and gets away'
            expected = f"a goal that an aircraft at {reference} can reach"
            return [Problem(f"{path}.goal", arrived, expected, subject)]
        # the arrival time is known for a mean airspeed only
        if reference.is_mean or not goal.climb_rate_m_s:
            heights_m = [rendezvous_m[2] + goal.climb_rate_m_s * time_s]
        shortest_s = time_to_go_s(relative_m, velocity_m_s, greatest_m_s) or 0.0
        if shortest_s >= timing.duration_s:
            route = f'from "{aircraft.name}" to goal "{goal.name}" at {reference}'
            expected = f"more than {shortest_s:.1f} s, the shortest flight {route}"
            if greatest_m_s > reference.speed_m_s:
                expected += f", of which descent, speed at the start and layers of wind may make {greatest_m_s:.1f} m/s"
            return [Problem("timing.duration_s", format_number(timing.duration_s), expected)]
        is_at_goal = time_s < FLIGHT_MIN_S
    else:
        heights_m = [point.altitude_m + aircraft.rendezvous.stand_off_up_m for point in goal.waypoints]
        # the goal is slower than the aircraft, so it stays within reach
        last_m = _plus(goal.position_m(timing.duration_s), aircraft.rendezvous.stand_off_m)
        drifted_m = _plus(aircraft.start.position_m, wind_m_s, timing.duration_s)
        distance_m = math.dist(last_m, drifted_m)
        if distance_m >= greatest_m_s * timing.duration_s:
            expected = f'a longer flight: "{aircraft.name}" does not get to goal "{goal.name}" in this time'
            return [Problem("timing.duration_s", format_number(timing.duration_s), expected)]
        is_at_goal = math.hypot(*relative_m) < reference.speed_m_s * FLIGHT_MIN_S
    problems = []
    if is_at_goal:
        expected = f"a start at least {FLIGHT_MIN_S:g} s of flight away from it"
        problems.append(Problem(f"{path}.start", "the rendezvous point itself, or nearly so", expected, subject))
    heights_outside = [height for height in heights_m if not limits.altitude_min_m <= height <= limits.altitude_max_m]
    if heights_outside:
        lowest, highest = format_number(limits.altitude_min_m), format_number(limits.altitude_max_m)
        expected = f"from limits.altitude_min_m ({lowest} m) to limits.altitude_max_m ({highest} m)"
        arrived = f'a rendezvous point at {heights_outside[0]:.1f} m altitude above goal "{goal.name}"'
        problems.append(Problem(f"{path}.rendezvous.stand_off_up_m", arrived, expected, subject))
    return problems
