"""The room that the aircraft share: how far apart they stay, where none of them may be, and what starts wrongly."""

import math

from anser.scenario.errors import Problem, plain
from anser.scenario.schema_aircraft import Aircraft
from anser.scenario.schema_arrival import Arrival
from anser.scenario.schema_base import Table, Vector, misordered, naming, number, velocity_on_course
from anser.scenario.schema_checks import SAME_PLACE_M, groups, label, listed
from anser.scenario.schema_goal import PLACE_MAX_M, Goal
from anser.scenario.schema_settings import ALTITUDE_MAX_M, SPEED_MAX_M_S


class Separation(Table):
    """How far apart any two aircraft stay, holds included: in the plane or in altitude."""

    horizontal_m: float = number("distance in the plane; 0 asks for none", 0, 50_000, "m", 0.0)
    vertical_m: float = number(
        "difference in altitude that does instead; 0: altitude does not count", 0, 5_000, "m", 0.0
    )
    reserve_m: float = number("what the plan adds to both, for the errors of flight", 0, 1_000, "m", 10.0)

    def own_problems(self) -> list[Problem]:
        """Find altitudes without a distance in the plane."""
        if self.horizontal_m > 0.0 or self.vertical_m == 0.0:
            return []
        words = "horizontal_m above 0 beside it: aircraft are apart in the plane or in altitude"
        return [Problem("vertical_m", f"{plain(self.vertical_m)} without horizontal_m", words)]

    @property
    def asked_m(self) -> tuple[float, float] | None:
        """Distances in the plane and in altitude, m; None where none is asked for."""
        return (self.horizontal_m, self.vertical_m) if self.horizontal_m > 0.0 else None

    def is_kept(self, one_m: Vector, other_m: Vector) -> bool:
        """Say whether two places (north, east, up; m) are far enough apart, without the reserve."""
        apart_up_m = abs(one_m[2] - other_m[2])
        return math.dist(one_m[:2], other_m[:2]) >= self.horizontal_m or 0.0 < self.vertical_m <= apart_up_m


class KeepOut(Table):
    """An upright cylinder that no aircraft enters, at rest or moving steadily over the ground."""

    name: str = naming("name of the cylinder, unique")
    north_m: float = number("its middle north of the origin at time 0", -PLACE_MAX_M, PLACE_MAX_M, "m")
    east_m: float = number("its middle east of the origin at time 0", -PLACE_MAX_M, PLACE_MAX_M, "m")
    radius_m: float = number("its radius", 10, 200_000, "m")
    bottom_m: float = number("its bottom above sea level", 0, ALTITUDE_MAX_M, "m", 0.0)
    top_m: float = number("its top above sea level", 0, ALTITUDE_MAX_M, "m", ALTITUDE_MAX_M)
    speed_m_s: float = number("its speed over the ground", 0, SPEED_MAX_M_S, "m/s", 0.0)
    course_deg: float = number("direction of its motion over the ground", -360, 360, "deg", 0.0)

    def own_problems(self) -> list[Problem]:
        """Find a cylinder without a height."""
        return misordered(self, "bottom_m", "top_m", "m")

    def velocity_m_s(self) -> Vector:
        """Velocity over the ground (north, east, up), m/s."""
        return velocity_on_course(self.speed_m_s, self.course_deg)

    def holds(self, place_m: Vector) -> bool:
        """Say whether a place (north, east, up; m) is inside at time 0; its surface is outside."""
        away_m = math.dist(place_m[:2], (self.north_m, self.east_m))
        return away_m < self.radius_m and self.bottom_m < place_m[2] < self.top_m


def separation_problems(aircraft: tuple[Aircraft, ...], separation: Separation) -> list[Problem]:
    """Find aircraft that start closer than the separation."""
    found = []
    vertical = f" or {plain(separation.vertical_m)} m in altitude" if separation.vertical_m else ""
    words = f"a start {plain(separation.horizontal_m)} m away in the plane{vertical}, as [separation] asks"
    if separation.horizontal_m == 0.0:
        return found
    at_m = [one.start.position_m for one in aircraft]

    def too_close(i: int, j: int) -> bool:
        return math.dist(at_m[i], at_m[j]) >= SAME_PLACE_M and not separation.is_kept(at_m[i], at_m[j])

    for group in groups(len(aircraft), too_close):
        pairs = [(i, j) for i in group for j in group if j < i and too_close(i, j)]
        index, other = min(pairs, key=lambda pair: math.dist(at_m[pair[0]], at_m[pair[1]]))
        here_m, there_m = at_m[index], at_m[other]
        # rounded down, so that a distance that is too small by little does not read as the one asked for
        away_m, up_m = _tenths(math.dist(here_m[:2], there_m[:2])), _tenths(abs(here_m[2] - there_m[2]))
        arrived = (
            f"a start {away_m} m in the plane and {up_m} m in altitude from {listed('aircraft', aircraft, [other])}"
        )
        if len(group) > 2:
            arrived += f", the closest of {len(pairs)} pairs too close among {listed('aircraft', aircraft, group)}"
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
        below, above = f"below {plain(keep_out.bottom_m)} m", f"above {plain(keep_out.top_m)} m"
        outside = f"at least {plain(keep_out.radius_m)} m from its middle, {below} or {above}"
        for place, one in enumerate(aircraft):
            path, whom, goal = f"aircraft[{place}]", label("aircraft", one), by_name[one.goal]
            if keep_out.holds(one.start.position_m):
                found.append(Problem(f"{path}.start", f"a start {inside}", f"a start {outside}", whom))
            north_m, east_m, up_m = goal.position_m(0.0)
            off_north_m, off_east_m, off_up_m = one.rendezvous.stand_off_m
            if keep_out.holds((north_m + off_north_m, east_m + off_east_m, up_m + off_up_m)) and _move_alike(
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
        return other.goal == one.goal and apart_m < SAME_PLACE_M and arrival.meet(one, other)

    for first, *others in groups(len(aircraft), meet):
        also = f", also that of {listed('aircraft', aircraft, others[1:])}" if len(others) > 1 else ""
        arrived = f"the rendezvous point of {listed('aircraft', aircraft, [first])} at the same goal{also}"
        words = f"stand-offs that keep them at least {SAME_PLACE_M:g} m apart: they arrive at the same time"
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
