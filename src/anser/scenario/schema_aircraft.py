"""The aircraft: airframe, start, rendezvous, gains of the autopilot (given, or as wanted bandwidths and damping)."""

import math
from typing import Literal

from anser.scenario.errors import Problem, plain
from anser.scenario.schema_base import Gain3, Table, choice, designed, gain, naming, number, table
from anser.scenario.schema_deviation import Deviation
from anser.scenario.schema_goal import PLACE_MAX_M
from anser.scenario.schema_settings import ALTITUDE_MAX_M, DURATION_MAX_S, SPEED_MAX_M_S

STAND_OFF_MAX_M = 20_000.0
PATH_ANGLE_MAX_DEG = 60.0
DAMPING_MIN = 0.1
_GAIN_WAYS = "either proportional and integral, or bandwidth_rad_s and damping; not both"


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


class _LoopGains(Table):
    """What the gains of all loops share: the other way to give them."""

    bandwidth_rad_s: Gain3 | None = designed("wanted bandwidth, instead of proportional and integral")
    damping: Gain3 | None = designed("wanted damping of the pair of poles; left out: no integral")

    def own_problems(self) -> list[Problem]:
        """Find gains given in both ways, and a damping without a bandwidth or too small."""
        found = []
        if self.bandwidth_rad_s is not None:
            both = [key for key in ("proportional", "integral") if key in self.model_fields_set]
            found = [Problem(key, f"{plain(getattr(self, key)[0])} beside bandwidth_rad_s", _GAIN_WAYS) for key in both]
        elif self.damping is not None:
            found = [Problem("damping", f"{plain(self.damping[0])} without bandwidth_rad_s", _GAIN_WAYS)]
        if self.damping is not None and min(self.damping) < DAMPING_MIN:
            found.append(Problem("damping", plain(min(self.damping)), f"a number from {DAMPING_MIN:g}"))
        return found


class RateGains(_LoopGains):
    """Gains of the fast loop, axes (roll rate P, pitch rate Q, yaw rate R)."""

    proportional: Gain3 = gain("of the error, 1/s", 10.0)
    integral: Gain3 = gain("of the integrated error, 1/s^2", 0.25)
    derivative: Gain3 = gain("of the error's rate", 1.0)
    feed_forward: Gain3 = gain("of the commanded rate of change", 1.0)


class AttitudeGains(_LoopGains):
    """Gains of the middle loop, axes (bank mu, angle of attack alpha, sideslip beta)."""

    proportional: Gain3 = gain("of the error, 1/s", 2.0)
    integral: Gain3 = gain("of the integrated error, 1/s^2", 0.0)
    derivative: Gain3 = gain("of the error's rate", 0.0)
    feed_forward: Gain3 = gain("of the commanded rate of change", 1.0)


class VelocityGains(_LoopGains):
    """Gains of the slow loop, axes (speed V, path angle gamma, course chi)."""

    proportional: Gain3 = gain("of the error, 1/s", 1.0)
    integral: Gain3 = gain("of the integrated error, 1/s^2", 0.025)
    derivative: Gain3 = gain("of the error's rate", 0.0)
    feed_forward: Gain3 = gain("of the commanded rate of change", 1.0)


class Gains(Table):
    """Gains of the autopilot's three loops (theory section 5), and which inversion they drive."""

    inversion: Literal["model", "incremental"] = choice(
        "what is inverted: the model, or the change from what the sensors measure", ("model", "incremental"), "model"
    )
    sensor_bandwidth_rad_s: float = number(
        "of the filter on the sensors of the incremental inversion", 1, 100, "rad/s", 20.0
    )

    rates: RateGains = table("fast loop", "a table [aircraft.gains.rates]", RateGains())
    attitude: AttitudeGains = table("middle loop", "a table [aircraft.gains.attitude]", AttitudeGains())
    velocity: VelocityGains = table("slow loop", "a table [aircraft.gains.velocity]", VelocityGains())


class Aircraft(Table):
    """One aircraft of the fleet."""

    name: str = naming("name of the aircraft, unique")
    type: Literal["f16"] = choice("airframe", ("f16",), "f16")
    variant: Literal["textbook", "s119", "founding", "tp1538"] = choice(
        "which published set of its aerodynamic tables", ("textbook", "s119", "founding", "tp1538"), "textbook"
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
    deviation: Deviation = table(
        "how it differs from what its autopilot and planner know", "a table [aircraft.deviation]", Deviation()
    )
