"""Whether each aircraft can reach its goal: in the air mass, where the wind is at rest (theory section 7)."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from anser.config.errors import Problem, format_number
from anser.config.tables import Vector
from anser.scenario.schema_aircraft import Aircraft, Goal
from anser.scenario.schema_checks import GRAVITY_M_S2, label

if TYPE_CHECKING:
    from anser.scenario.schema import Scenario


FLIGHT_MIN_S = 1.0
_HALVINGS = 40  # of the longest flight: to less than a microsecond


@dataclass(frozen=True)
class ReferenceSpeed:
    """The speed that a way to a goal is judged by.

    Parameters
    ----------
    speed_m_s
        Airspeed, m/s.
    key
        Where the scenario has it.
    is_mean
        The plan flies the mean of it; otherwise it flies no faster.
    may_rise
        The published planner raises that mean where its farthest aircraft cannot slow down or come down so slowly.
    knows_layers
        The plan reckons with the wind of every altitude; otherwise with that where each aircraft starts.
    """

    speed_m_s: float
    key: str
    is_mean: bool
    may_rise: bool = False
    uses_wind_layers: bool = False

    def __str__(self) -> str:
        return f"{self.key} = {format_number(self.speed_m_s)} m/s"


def reference_speed(scenario: "Scenario", aircraft: Aircraft) -> ReferenceSpeed:
    """Say which speed decides whether a goal is within an aircraft's reach."""
    fleet, limits, arrival = scenario.fleet, scenario.limits_for(aircraft), scenario.arrival
    certified = fleet.is_certified
    if not certified or arrival.rule == "together":
        rises = not certified and fleet.speed_profile == "even"
        key = "fleet.speed_m_s" if aircraft.speed_m_s is None else f'the speed_m_s of "{aircraft.name}"'
        return ReferenceSpeed(
            scenario.speed_for(aircraft), key, is_mean=True, may_rise=rises, uses_wind_layers=certified
        )
    return ReferenceSpeed(limits.speed_max_m_s, "limits.speed_max_m_s", is_mean=False, uses_wind_layers=True)


def time_to_go_s(relative_m: Vector, velocity_m_s: Vector, speed_m_s: float) -> float | None:
    """Find the time to a point that moves steadily, on a straight line at constant speed.

    Parameters
    ----------
    relative_m
        Point seen from the aircraft (north, east, up), m.
    velocity_m_s
        Velocity of the point in the same frame as the speed, m/s; in wind, goal velocity minus wind.
    speed_m_s
        Airspeed of the aircraft, m/s.

    Returns
    -------
    The smallest time of meeting, s; None if the point outruns the aircraft.

    Notes
    -----
    Smallest positive root of ``(|W|^2 - V^2) t^2 + 2 (R.W) t + |R|^2 = 0``, theory section 7, in the form that
    loses no digits when the speeds are equal or nearly so.
    """
    squared = _dot(velocity_m_s, velocity_m_s) - speed_m_s**2
    half_linear = _dot(relative_m, velocity_m_s)
    constant = _dot(relative_m, relative_m)
    if constant == 0.0:
        return 0.0
    discriminant = half_linear**2 - squared * constant
    if discriminant < 0.0:
        return None
    q = -(half_linear + math.copysign(math.sqrt(discriminant), half_linear))
    roots = [constant / q] if q != 0.0 else []
    if squared != 0.0:
        roots.append(q / squared)
    return min((root for root in roots if root > 0.0), default=None)


def reach_problems(scenario: "Scenario", *, unaided: bool = False) -> list[Problem]:
    """Find goals that outrun their aircraft, flights too short, and rendezvous points outside the envelope.

    Parameters
    ----------
    scenario
        Whose aircraft all have a goal; the wind is slower than the fleet.
    unaided
        Whether to call a flight too short that is so only without a descent that raises the plan's speed and without
        the wind of other altitudes than that of the start.
    """
    found = []
    for index, goal in enumerate(scenario.goal):
        # the first plan reckons with the wind where the aircraft starts
        coming = [one for one in scenario.aircraft if one.goal == goal.name]
        if not coming:
            continue
        starts_m = [one.start.altitude_m for one in coming]
        reference = min((reference_speed(scenario, one) for one in coming), key=lambda aircraft: aircraft.speed_m_s)
        winds_m_s = dict.fromkeys(scenario.wind.velocity_m_s(altitude_m) for altitude_m in starts_m)
        found.extend(_fast_legs(f"goal[{index}]", goal, reference, tuple(winds_m_s)))
    if found:
        return found  # without a speed that suffices the times below mean nothing
    for index, one in enumerate(scenario.aircraft):
        reference = reference_speed(scenario, one)
        quickest_m_s = None if unaided else _quickest_m_s(scenario, reference)
        found.extend(_reach_problems_of(f"aircraft[{index}]", one, scenario, reference, quickest_m_s))
    return found


def arrival_time_problems(scenario: "Scenario") -> list[Problem]:
    """Find times of arrival before the fastest flight: straight at the greatest airspeed with the most tail wind.

    Of a window counts its end. `reach_problems` found nothing, so that every goal is reached within the flight.
    """
    worst: dict[str, tuple[float, Problem]] = {}
    arrival = scenario.arrival
    for index, one in enumerate(scenario.aircraft):
        own, path = f"aircraft[{index}]", "arrival.time_s"
        if arrival.rule == "at":
            asked_s = arrival.time_s
        elif arrival.rule == "times":
            asked_s, path = one.arrive_s, f"{own}.arrive_s"
        else:
            asked_s, path = one.arrive_to_s, f"{own}.arrive_to_s"
        if asked_s is None:
            continue
        earliest_s = _earliest_s(scenario, one)
        if asked_s < earliest_s and (path not in worst or worst[path][0] < earliest_s):
            fastest = f"limits.speed_max_m_s, which is {format_number(scenario.limits_for(one).speed_max_m_s)} m/s"
            words = (
                f'at least {math.ceil(10.0 * earliest_s) / 10.0:.1f} s: "{one.name}" gets to goal "{one.goal}" no '
                f"sooner, straight at {fastest}, in this wind"
            )
            worst[path] = earliest_s, Problem(path, format_number(asked_s), words, label("aircraft", one))
    return [problem for _, problem in worst.values()]


def _earliest_s(scenario: "Scenario", aircraft: Aircraft) -> float:
    """Time before which an aircraft is not at its rendezvous, whatever it flies within its limits."""
    goal, wind = scenario.goal_of(aircraft), scenario.wind
    wind_m_s = wind.velocity_m_s(aircraft.start.altitude_m)
    carried_m_s = max(math.dist(wind_m_s, other_m_s) for _, other_m_s in wind.profile_m_s)
    fastest_m_s = scenario.limits_for(aircraft).speed_max_m_s + carried_m_s

    def short_of_m(time_s: float) -> float:
        place_m = _plus(goal.position_m(time_s), aircraft.rendezvous.stand_off_m)
        return math.dist(place_m, _plus(aircraft.start.position_m, wind_m_s, time_s)) - fastest_m_s * time_s

    if goal.waypoints is None:
        place_m = _plus(goal.position_m(0.0), aircraft.rendezvous.stand_off_m)
        relative_m = _plus(place_m, aircraft.start.position_m, -1.0)
        return time_to_go_s(relative_m, _plus(goal.velocity_m_s(), wind_m_s, -1.0), fastest_m_s) or 0.0
    # the goal is slower than the aircraft, so that what is short of it only falls
    low_s, high_s = 0.0, scenario.timing.duration_s
    for _ in range(_HALVINGS):
        middle_s = 0.5 * (low_s + high_s)
        low_s, high_s = (middle_s, high_s) if short_of_m(middle_s) > 0.0 else (low_s, middle_s)
    return low_s


def _quickest_m_s(scenario: "Scenario", reference: ReferenceSpeed) -> float:
    """Greatest mean airspeed to which the plan may raise that of the fleet, m/s.

    Nobody gets faster on the way down than without any drag: speed and height together have so much energy. Which of
    the aircraft is the farthest, whose speed counts, is not asked.
    """
    found = [reference.speed_m_s]
    for one in scenario.aircraft if reference.may_rise else ():
        goal = scenario.goal_of(one)
        if goal.waypoints is None:
            lowest_m = min(goal.altitude_m, goal.position_m(scenario.timing.duration_s)[2])
        else:
            lowest_m = min(point.altitude_m for point in goal.waypoints)
        fall_m = max(0.0, one.start.altitude_m - lowest_m - one.rendezvous.stand_off_up_m)
        found.append(math.sqrt(one.start.speed_m_s**2 + 2.0 * GRAVITY_M_S2 * fall_m))
    return max(found)


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _plus(a: Vector, b: Vector, factor: float = 1.0) -> Vector:
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


def _fast_legs(path: str, goal: Goal, reference: ReferenceSpeed, winds_m_s: tuple[Vector, ...]) -> list[Problem]:
    """Find legs of a goal that are faster through the air than the fleet, in any of the winds."""
    found = []
    points = goal.waypoints or ()
    for index in range(1, len(points)):
        begin, end = points[index - 1], points[index]
        lasting_s = end.time_s - begin.time_s
        leg_m = (end.north_m - begin.north_m, end.east_m - begin.east_m, end.altitude_m - begin.altitude_m)
        through_air = _plus((0.0, 0.0, 0.0), leg_m, 1.0 / lasting_s)
        speed_m_s = max((math.hypot(*_plus(through_air, air_m_s, -1.0)) for air_m_s in winds_m_s), default=0.0)
        if speed_m_s >= reference.speed_m_s:
            arrived = f"a leg flown at {speed_m_s:.1f} m/s through the air"
            words = (
                f"less than {reference.key}, which is {format_number(reference.speed_m_s)} m/s: the goal "
                "outruns its aircraft"
            )
            found.append(Problem(f"{path}.waypoints[{index}]", arrived, words, label("goal", goal)))
    return found


def _reach_problems_of(
    path: str, aircraft: Aircraft, scenario: "Scenario", reference: ReferenceSpeed, quickest_m_s: float | None
) -> list[Problem]:
    """Find why an aircraft does not reach its goal, if it does not."""
    goal, limits, wind, timing = (
        scenario.goal_of(aircraft),
        scenario.limits_for(aircraft),
        scenario.wind,
        scenario.timing,
    )
    whom = label("aircraft", aircraft)
    place_m = _plus(goal.position_m(0.0), aircraft.rendezvous.stand_off_m)
    relative_m = _plus(place_m, aircraft.start.position_m, -1.0)
    heights_m = [place_m[2]]
    wind_m_s = wind.velocity_m_s(aircraft.start.altitude_m)
    # the mean wind of the way may differ from that at the start by so much, and carry the aircraft on
    carried_m_s = max(math.dist(wind_m_s, other_m_s) for _, other_m_s in wind.profile_m_s)
    most_m_s = reference.speed_m_s if quickest_m_s is None else quickest_m_s + carried_m_s
    if goal.waypoints is None:
        velocity_m_s = _plus(goal.velocity_m_s(), wind_m_s, -1.0)
        time_s = time_to_go_s(
            relative_m, velocity_m_s, reference.speed_m_s + (carried_m_s if reference.uses_wind_layers else 0.0)
        )
        if time_s is None:
            arrived = f'"{goal.name}", which moves at {math.hypot(*velocity_m_s):.1f} m/s through the air and gets away'
            words = f"a goal that an aircraft at {reference} can reach"
            return [Problem(f"{path}.goal", arrived, words, whom)]
        # when the plan arrives is known only at a mean speed
        heights_m = [place_m[2] + goal.climb_rate_m_s * time_s] if reference.is_mean or not goal.climb_rate_m_s else []
        shortest_s = time_to_go_s(relative_m, velocity_m_s, most_m_s) or 0.0
        if shortest_s >= timing.duration_s:
            way = f'from "{aircraft.name}" to goal "{goal.name}" at {reference}'
            words = f"more than {shortest_s:.1f} s, the shortest flight {way}"
            if most_m_s > reference.speed_m_s:
                words += f", of which descent, speed at the start and layers of wind may make {most_m_s:.1f} m/s"
            return [Problem("timing.duration_s", format_number(timing.duration_s), words)]
        near = time_s < FLIGHT_MIN_S
    else:
        heights_m = [point.altitude_m + aircraft.rendezvous.stand_off_up_m for point in goal.waypoints]
        # the goal is slower than the aircraft, so once within reach it stays within reach
        last_m = _plus(goal.position_m(timing.duration_s), aircraft.rendezvous.stand_off_m)
        drifted_m = _plus(aircraft.start.position_m, wind_m_s, timing.duration_s)
        distance_m = math.dist(last_m, drifted_m)
        if distance_m >= most_m_s * timing.duration_s:
            words = f'a longer flight: "{aircraft.name}" does not get to goal "{goal.name}" in this time'
            return [Problem("timing.duration_s", format_number(timing.duration_s), words)]
        near = math.hypot(*relative_m) < reference.speed_m_s * FLIGHT_MIN_S
    found = []
    if near:
        words = f"a start at least {FLIGHT_MIN_S:g} s of flight away from it"
        found.append(Problem(f"{path}.start", "the rendezvous point itself, or nearly so", words, whom))
    outside = [height for height in heights_m if not limits.altitude_min_m <= height <= limits.altitude_max_m]
    if outside:
        lowest, highest = format_number(limits.altitude_min_m), format_number(limits.altitude_max_m)
        words = f"from limits.altitude_min_m ({lowest} m) to limits.altitude_max_m ({highest} m)"
        arrived = f'a rendezvous point at {outside[0]:.1f} m altitude above goal "{goal.name}"'
        found.append(Problem(f"{path}.rendezvous.stand_off_up_m", arrived, words, whom))
    return found
