"""The aircraft: airframe, start, rendezvous."""

import math
from typing import Literal

from anser.scenario.schema_base import Table, choice, naming, number, table
from anser.scenario.schema_gains import Gains
from anser.scenario.schema_goal import PLACE_MAX_M
from anser.scenario.schema_settings import ALTITUDE_MAX_M, DURATION_MAX_S, SPEED_MAX_M_S

STAND_OFF_MAX_M = 20_000.0
PATH_ANGLE_MAX_DEG = 60.0


class Start(Table):
    """Where and how an aircraft begins; the speed and its direction are those through the air."""

    north_m: float = number("north of the origin", -PLACE_MAX_M, PLACE_MAX_M, "m")
    east_m: float = number("east of the origin", -PLACE_MAX_M, PLACE_MAX_M, "m")
    altitude_m: float = number("height above sea level", 0, ALTITUDE_MAX_M, "m")
    speed_m_s: float = number("airspeed", 30, SPEED_MAX_M_S, "m/s")
    course_deg: float = number("direction of flight, clockwise from north", -360, 360, "deg")
    path_angle_deg: float = number("climb angle", -PATH_ANGLE_MAX_DEG, PATH_ANGLE_MAX_DEG, "deg", 0.0)

    @property
    def position_m(self) -> tuple[float, float, float]:
        """Position (north, east, up), m."""
        return self.north_m, self.east_m, self.altitude_m


class Rendezvous(Table):
    """The point to be at, seen from the goal, and the direction to arrive in."""

    stand_off_up_m: float = number("height above the goal", -STAND_OFF_MAX_M, STAND_OFF_MAX_M, "m", 300.0)
    stand_off_north_m: float = number("distance north of the goal", -STAND_OFF_MAX_M, STAND_OFF_MAX_M, "m", 0.0)
    stand_off_east_m: float = number("distance east of the goal", -STAND_OFF_MAX_M, STAND_OFF_MAX_M, "m", 0.0)
    course_deg: float | None = number("final course over the ground; left out: along the line", -360, 360, "deg", None)
    path_angle_deg: float | None = number(
        "final climb angle; left out: along the line", -PATH_ANGLE_MAX_DEG, PATH_ANGLE_MAX_DEG, "deg", None
    )

    @property
    def stand_off_m(self) -> tuple[float, float, float]:
        """Rendezvous point seen from the goal (north, east, up), m."""
        return self.stand_off_north_m, self.stand_off_east_m, self.stand_off_up_m

    @property
    def stand_off_distance_m(self) -> float:
        """Distance of the rendezvous point from the goal, m."""
        return math.hypot(*self.stand_off_m)


class Aircraft(Table):
    """One aircraft of the fleet."""

    name: str = naming("name of the aircraft, unique")
    type: Literal["f16"] = choice("airframe", ("f16",), "f16")
    variant: Literal["textbook", "s119", "founding"] = choice(
        "which published set of its aerodynamic tables", ("textbook", "s119", "founding"), "textbook"
    )
    x_cg_over_c: float | None = number("centre of mass; left out: the variant's own", 0.1, 0.5, "of the chord", None)
    goal: str = naming("name of the goal to meet")
    bend: Literal["auto", "left", "right"] = choice(
        "side of a detour, seen along the flight", ("auto", "left", "right"), "auto"
    )
    arrive_s: float | None = number('time of arrival, with arrival.rule "times"', 1, DURATION_MAX_S, "s", None)
    arrive_from_s: float | None = number('earliest arrival, with arrival.rule "windows"', 0, DURATION_MAX_S, "s", None)
    arrive_to_s: float | None = number('latest arrival, with arrival.rule "windows"', 1, DURATION_MAX_S, "s", None)
    start: Start = table("beginning", "a table [aircraft.start]")
    rendezvous: Rendezvous = table("where to be", "a table [aircraft.rendezvous]", Rendezvous())
    gains: Gains = table("gains of the autopilot", "tables [aircraft.gains.rates] and so on", Gains())
