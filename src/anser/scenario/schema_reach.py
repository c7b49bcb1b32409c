"""Whether each aircraft can reach its goal: in the air mass, where the wind is at rest (theory section 7)."""

import math
from dataclasses import dataclass

from anser.scenario.errors import Problem, plain
from anser.scenario.schema_aircraft import Aircraft
from anser.scenario.schema_arrival import Arrival
from anser.scenario.schema_checks import label
from anser.scenario.schema_goal import Goal
from anser.scenario.schema_settings import Fleet, Limits, Timing
from anser.scenario.schema_surroundings import Vector, Wind

FLIGHT_MIN_S = 1.0


@dataclass(frozen=True)
class Pace:
    """The speed that a way to a goal is judged by.

    Parameters
    ----------
    speed_m_s
        Airspeed, m/s.
    key
        Where the scenario has it.
    is_mean
        The plan flies the mean of it; otherwise it flies no faster.
    """

    speed_m_s: float
    key: str
    is_mean: bool

    def __str__(self) -> str:
        return f"{self.key} = {plain(self.speed_m_s)} m/s"


def pace_of(fleet: Fleet, limits: Limits, arrival: Arrival) -> Pace:
    """Say which speed decides whether a goal is within reach.

    Parameters
    ----------
    fleet, limits, arrival
        Tables of the scenario.
    """
    if fleet.planner == "published" or arrival.rule == "together":
        return Pace(fleet.speed_m_s, "fleet.speed_m_s", is_mean=True)
    return Pace(limits.speed_max_m_s, "limits.speed_max_m_s", is_mean=False)


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
    float or None
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


def reach_problems(
    aircraft: tuple[Aircraft, ...],
    goals: tuple[Goal, ...],
    pace: Pace,
    limits: Limits,
    wind: Wind,
    timing: Timing,
) -> list[Problem]:
    """Find goals that outrun their aircraft, flights too short, and rendezvous points outside the envelope.

    Parameters
    ----------
    aircraft, goals
        All of the scenario; every aircraft's goal exists.
    pace
        What decides.
    limits, wind, timing
        Tables of the scenario; the wind is slower than the fleet.

    Returns
    -------
    list of Problem
        Empty if all is well.
    """
    found = []
    by_name = {goal.name: goal for goal in goals}
    for index, goal in enumerate(goals):
        # the first plan reckons with the wind where the aircraft starts
        starts_m = [one.start.altitude_m for one in aircraft if one.goal == goal.name]
        winds_m_s = dict.fromkeys(wind.velocity_m_s(altitude_m) for altitude_m in starts_m)
        found.extend(_fast_legs(f"goal[{index}]", goal, pace, tuple(winds_m_s)))
    if found:
        return found  # without a speed that suffices the times below mean nothing
    for index, one in enumerate(aircraft):
        found.extend(_unreached(f"aircraft[{index}]", one, by_name[one.goal], pace, limits, wind, timing))
    return found


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _plus(a: Vector, b: Vector, factor: float = 1.0) -> Vector:
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


def _fast_legs(path: str, goal: Goal, pace: Pace, winds_m_s: tuple[Vector, ...]) -> list[Problem]:
    """Find legs of a goal that are faster through the air than the fleet, in any of the winds."""
    found = []
    points = goal.waypoints or ()
    for index in range(1, len(points)):
        begin, end = points[index - 1], points[index]
        lasting_s = end.time_s - begin.time_s
        leg_m = (end.north_m - begin.north_m, end.east_m - begin.east_m, end.altitude_m - begin.altitude_m)
        through_air = _plus((0.0, 0.0, 0.0), leg_m, 1.0 / lasting_s)
        speed_m_s = max((math.hypot(*_plus(through_air, air_m_s, -1.0)) for air_m_s in winds_m_s), default=0.0)
        if speed_m_s >= pace.speed_m_s:
            arrived = f"a leg flown at {speed_m_s:.1f} m/s through the air"
            words = f"less than {pace.key}, which is {plain(pace.speed_m_s)} m/s: the goal outruns its aircraft"
            found.append(Problem(f"{path}.waypoints[{index}]", arrived, words, label("goal", goal)))
    return found


def _unreached(
    path: str, one: Aircraft, goal: Goal, pace: Pace, limits: Limits, wind: Wind, timing: Timing
) -> list[Problem]:
    """Find why an aircraft does not reach its goal, if it does not."""
    whom = label("aircraft", one)
    place_m = _plus(goal.position_m(0.0), one.rendezvous.stand_off_m)
    relative_m = _plus(place_m, one.start.position_m, -1.0)
    heights_m = [place_m[2]]
    wind_m_s = wind.velocity_m_s(one.start.altitude_m)
    if goal.waypoints is None:
        velocity_m_s = _plus(goal.velocity_m_s(), wind_m_s, -1.0)
        time_s = time_to_go_s(relative_m, velocity_m_s, pace.speed_m_s)
        if time_s is None:
            arrived = f'"{goal.name}", which moves at {math.hypot(*velocity_m_s):.1f} m/s through the air and gets away'
            words = f"a goal that an aircraft at {pace} can reach"
            return [Problem(f"{path}.goal", arrived, words, whom)]
        # when the plan arrives is known only at a mean speed
        heights_m = [place_m[2] + goal.climb_rate_m_s * time_s] if pace.is_mean or not goal.climb_rate_m_s else []
        if time_s >= timing.duration_s:
            words = f'more than {time_s:.1f} s, the shortest flight from "{one.name}" to goal "{goal.name}" at {pace}'
            return [Problem("timing.duration_s", plain(timing.duration_s), words)]
        near = time_s < FLIGHT_MIN_S
    else:
        heights_m = [point.altitude_m + one.rendezvous.stand_off_up_m for point in goal.waypoints]
        # the goal is slower than the aircraft, so once within reach it stays within reach
        last_m = _plus(goal.position_m(timing.duration_s), one.rendezvous.stand_off_m)
        drifted_m = _plus(one.start.position_m, wind_m_s, timing.duration_s)
        distance_m = math.dist(last_m, drifted_m)
        if distance_m >= pace.speed_m_s * timing.duration_s:
            words = f'a longer flight: "{one.name}" does not get to goal "{goal.name}" in this time'
            return [Problem("timing.duration_s", plain(timing.duration_s), words)]
        near = math.hypot(*relative_m) < pace.speed_m_s * FLIGHT_MIN_S
    found = []
    if near:
        words = f"a start at least {FLIGHT_MIN_S:g} s of flight away from it"
        found.append(Problem(f"{path}.start", "the rendezvous point itself, or nearly so", words, whom))
    outside = [height for height in heights_m if not limits.altitude_min_m <= height <= limits.altitude_max_m]
    if outside:
        lowest, highest = plain(limits.altitude_min_m), plain(limits.altitude_max_m)
        words = f"from limits.altitude_min_m ({lowest} m) to limits.altitude_max_m ({highest} m)"
        arrived = f'a rendezvous point at {outside[0]:.1f} m altitude above goal "{goal.name}"'
        found.append(Problem(f"{path}.rendezvous.stand_off_up_m", arrived, words, whom))
    return found
