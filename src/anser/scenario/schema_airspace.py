"""Scenario tables for arrival times, separation, keep-out volumes, and events during the flight."""

import math
from typing import Annotated, Literal

from pydantic import Field

from anser.aircraft_files.deviations import CoefficientFactors, Deviation
from anser.aircraft_files.sources import ALTITUDE_MAX_M, SPEED_MAX_M_S
from anser.config.errors import Problem, format_number, format_value
from anser.config.tables import (
    NAME_PATTERN,
    Table,
    Vector,
    expects,
    identifier,
    number,
    ordering_problems,
    table,
    velocity_on_course,
)
from anser.scenario.schema_aircraft import POSITION_MAX_M, Aircraft
from anser.scenario.schema_settings import DURATION_MAX_S

_RULE_OF = {"time_s": "at", "spacing_s": "sequence", "order": "sequence"}


class Arrival(Table):
    """Rule by which the arrival times of the aircraft are chosen."""

    rule: Literal["together", "earliest", "at", "sequence", "times", "windows"] = Field(
        default="together",
        description="all at one time: of the farthest at fleet.speed_m_s, the earliest that the limits allow, or a "
        "given one; or one after another; or each at its own time, or within its own window",
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
        """List keys that the arrival rule requires but the table lacks, and keys that the rule does not use."""
        problems = []
        for key, rule in _RULE_OF.items():
            value = getattr(self, key)
            if value is not None and self.rule != rule:
                arrived = f'{format_value(value)} with rule "{self.rule}"'
                problems.append(Problem(key, arrived, f'rule = "{rule}", or no {key}'))
            if value is None and self.rule == rule and key != "order":
                problems.append(Problem(key, "nothing", f'a number (s), which rule "{rule}" needs'))
        return problems

    @property
    def is_common(self) -> bool:
        """Whether the rule makes all aircraft arrive at the same time."""
        return self.rule in ("together", "earliest", "at") or (self.rule == "sequence" and self.spacing_s == 0.0)

    def arrive_together(self, aircraft: Aircraft, second_aircraft: Aircraft) -> bool:
        """Whether the rule makes two aircraft of the fleet arrive at the same time."""
        return self.is_common or (self.rule == "times" and aircraft.arrive_s == second_aircraft.arrive_s)


class Separation(Table):
    """Minimum separation of any two aircraft, also after the arrival: horizontal or vertical separation suffices."""

    horizontal_m: float = number("horizontal distance; 0: no requirement", 0, 50_000, "m", 0.0)
    vertical_m: float = number(
        "difference in altitude that suffices instead; 0: altitude does not count", 0, 5_000, "m", 0.0
    )
    reserve_m: float = number("margin added to both by the plan, for path-following errors", 0, 1_000, "m", 10.0)

    def consistency_problems(self) -> list[Problem]:
        """Return a problem if the table has a vertical separation without a horizontal separation."""
        if self.horizontal_m > 0.0 or self.vertical_m == 0.0:
            return []
        expected = "horizontal_m above 0 beside it: aircraft are apart in the plane or in altitude"
        return [Problem("vertical_m", f"{format_number(self.vertical_m)} without horizontal_m", expected)]

    @property
    def required_m(self) -> tuple[float, float] | None:
        """Required separation (horizontal, vertical), m; None if no separation is required."""
        return (self.horizontal_m, self.vertical_m) if self.horizontal_m > 0.0 else None

    def is_satisfied(self, first_m: Vector, second_m: Vector) -> bool:
        """Whether two positions (north, east, up), m, are separated horizontally or vertically, without reserve."""
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
        """Return a problem if the top of the cylinder is not above its bottom."""
        return ordering_problems(self, "bottom_m", "top_m", "m")

    def velocity_m_s(self) -> Vector:
        """Velocity over the ground (north, east, up), m/s."""
        return velocity_on_course(self.speed_m_s, self.course_deg)

    def contains(self, position_m: Vector) -> bool:
        """Whether a position (north, east, up), m, is inside the cylinder, not on its surface, at time 0."""
        distance_m = math.dist(position_m[:2], (self.north_m, self.east_m))
        return distance_m < self.radius_m and self.bottom_m < position_m[2] < self.top_m


GOAL_EVENTS = ("goal-sensor-lost", "goal-stops", "goal-turns")
"""Kinds of event that change only a goal's motion or estimate; periodic replanning follows the estimate."""
AIRCRAFT_CHANGES = "aircraft-changes"
"""Kind of event that changes an aircraft; autopilot and planner do not know the change, and no plan changes."""
_REQUIRED_KEYS: dict[str, tuple[str, ...]] = {
    "aircraft-leaves": ("aircraft",),
    "goal-sensor-lost": ("aircraft",),
    "thrust-lost": ("aircraft", "thrust_left"),
    AIRCRAFT_CHANGES: ("aircraft", "deviation"),
    "goal-stops": ("goal",),
    "goal-turns": ("goal", "course_deg"),
    "keep-out-appears": ("keep_out",),
    "arrival-put-off": ("later_s",),
}
_OPTIONAL_KEYS: dict[str, tuple[str, ...]] = {
    "aircraft-leaves": ("course_deg", "gaps", "goal_taken_over_by"),
    "goal-turns": ("speed_m_s",),
}


class Event(Table):
    """One event during the flight; the required keys depend on the kind of event."""

    time_s: float = number("time of the event", 0, DURATION_MAX_S, "s", exclusive_minimum=True)
    kind: Literal[
        "aircraft-leaves",
        "goal-sensor-lost",
        "thrust-lost",
        "aircraft-changes",
        "goal-stops",
        "goal-turns",
        "keep-out-appears",
        "arrival-put-off",
    ] = Field(description="kind of event")
    aircraft: str | None = identifier("aircraft concerned", "the name of an aircraft", None)
    goal: str | None = identifier("goal concerned", "the name of a goal", None)
    thrust_left: float | None = number("fraction of the thrust that is left", 0, 1, "", None)
    deviation: Deviation | None = table(
        "deviation of the aircraft from then on, from its state until then (factors multiply, shifts add); unknown to "
        "autopilot and planner",
        "a table as of [aircraft.deviation], without coefficients",
        None,
        omit_default=True,
    )
    course_deg: float | None = number(
        "new course: of a goal over the ground; of an aircraft that leaves, through the air (left out: the least turn "
        "that keeps clear of the others)",
        *(-360, 360, "deg", None),
    )
    speed_m_s: float | None = number("new speed of a goal; left out: as before", 0, SPEED_MAX_M_S, "m/s", None)
    later_s: float | None = number("delay of all arrivals", 0, DURATION_MAX_S, "s", None, exclusive_minimum=True)
    keep_out: KeepOut | None = table("new keep-out volume", "a table as of [[keep_out]]", None)
    gaps: Literal["close-up", "keep"] | None = Field(
        default=None,
        description='what those behind an aircraft that leaves a sequence do: move up by one place ("close-up"; left '
        "out), or keep their times",
    )
    goal_taken_over_by: Literal["nearest", "spare"] | None = Field(
        default=None,
        description="who flies to the goal of an aircraft that leaves: the nearest that can be there in time "
        '("nearest"), the nearest of those whose own goal another aircraft flies to as well ("spare"), or nobody (left '
        "out)",
    )

    def consistency_problems(self) -> list[Problem]:
        """List keys that the kind of event requires but the table lacks, and keys that the kind does not allow."""
        problems = []
        required, allowed = _REQUIRED_KEYS[self.kind], (*_REQUIRED_KEYS[self.kind], *_OPTIONAL_KEYS.get(self.kind, ()))
        for key in required:
            if getattr(self, key) is None:
                problems.append(Problem(key, "nothing", f'what kind "{self.kind}" needs: {", ".join(required)}'))
        for key in sorted(self.model_fields_set - {"time_s", "kind", *allowed}):
            value = getattr(self, key)
            if value is not None:
                arrived = f'{format_value(value)} with kind "{self.kind}"'
                problems.append(Problem(key, arrived, f"no {key}; that kind knows {', '.join(allowed)}"))
        if self.deviation is not None and self.deviation.coefficients != CoefficientFactors():
            expected = "none: coefficients deviate from the start on, in aircraft.deviation.coefficients"
            problems.append(Problem("deviation.coefficients", "a table", expected))
        return problems
