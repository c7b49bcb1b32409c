"""The places to meet: fixed, moving steadily, or moving along waypoints."""

from typing import Literal

from anser.scenario.errors import Problem, plain
from anser.scenario.schema_base import Table, Vector, between, choice, naming, number, tables, velocity_on_course
from anser.scenario.schema_settings import ALTITUDE_MAX_M, SPEED_MAX_M_S

PLACE_MAX_M = 500_000.0
GROUND_MIN_M = -500.0  # the deepest dry land lies at -430 m

_WAYS = "either north_m and east_m (with speed_m_s and course_deg if it moves), or waypoints; not both"
_STEADY_KEYS = ("north_m", "east_m", "altitude_m", "speed_m_s", "course_deg", "climb_rate_m_s")


class Waypoint(Table):
    """A place that a goal passes at a given time."""

    time_s: float = number("time since the start of the flight", 0, 1e6, "s")
    north_m: float = number("north of the origin", -PLACE_MAX_M, PLACE_MAX_M, "m")
    east_m: float = number("east of the origin", -PLACE_MAX_M, PLACE_MAX_M, "m")
    altitude_m: float = number("height above sea level", GROUND_MIN_M, ALTITUDE_MAX_M, "m")


class Goal(Table):
    """A place to meet: a ship, a buoy, a point of a storm, a balloon, a waypoint."""

    name: str = naming("name of the goal, unique")
    kind: Literal["surface", "airborne"] = choice("where it is", ("surface", "airborne"))
    north_m: float | None = number("north of the origin at time 0", -PLACE_MAX_M, PLACE_MAX_M, "m", None)
    east_m: float | None = number("east of the origin at time 0", -PLACE_MAX_M, PLACE_MAX_M, "m", None)
    altitude_m: float = number("height above sea level at time 0", GROUND_MIN_M, ALTITUDE_MAX_M, "m", 0.0)
    speed_m_s: float = number("horizontal speed over the ground", 0, SPEED_MAX_M_S, "m/s", 0.0)
    course_deg: float = number("direction of its motion over the ground", -360, 360, "deg", 0.0)
    climb_rate_m_s: float = number("rate of climb", -100, 100, "m/s", 0.0)
    waypoints: tuple[Waypoint, ...] | None = tables(
        "its motion, instead of position and speed", "a list of waypoints, at least one", at_least=1, default=None
    )

    def own_problems(self) -> list[Problem]:
        """Find a motion given in no way or in both, and waypoints out of order."""
        found: list[Problem] = []
        if self.waypoints is None:
            place = {"north_m": self.north_m, "east_m": self.east_m}
            missing = [key for key, value in place.items() if value is None]
            found.extend(Problem(key, "nothing", f"a number (m): {_WAYS}") for key in missing)
        else:
            both = [key for key in _STEADY_KEYS if key in self.model_fields_set]
            found.extend(Problem(key, f"{plain(getattr(self, key))} beside waypoints", _WAYS) for key in both)
            found.extend(_disordered(self.waypoints))
        return found

    def velocity_m_s(self) -> Vector:
        """Velocity over the ground (north, east, up) at time 0 of a goal without waypoints, m/s."""
        return velocity_on_course(self.speed_m_s, self.course_deg, self.climb_rate_m_s)

    def position_m(self, time_s: float) -> Vector:
        """Position (north, east, up; m) at a time since the start, s; after its last waypoint the goal stays there."""
        if self.waypoints is None:
            north, east, up = self.velocity_m_s()
            start_north_m, start_east_m = self.north_m or 0.0, self.east_m or 0.0
            return start_north_m + north * time_s, start_east_m + east * time_s, self.altitude_m + up * time_s
        return between([(p.time_s, (p.north_m, p.east_m, p.altitude_m)) for p in self.waypoints], time_s)


def _disordered(points: tuple[Waypoint, ...]) -> list[Problem]:
    """Find waypoints whose times do not begin at 0 and grow."""
    found = []
    if points[0].time_s != 0:
        found.append(
            Problem("waypoints[0].time_s", plain(points[0].time_s), "0: the first waypoint is where it starts")
        )
    for index in range(1, len(points)):
        before_s, time_s = points[index - 1].time_s, points[index].time_s
        if time_s <= before_s:
            words = f"more than the {plain(before_s)} s of the waypoint before"
            found.append(Problem(f"waypoints[{index}].time_s", plain(time_s), words))
    return found
