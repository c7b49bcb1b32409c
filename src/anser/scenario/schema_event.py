"""What happens on the way: an aircraft leaves or loses something, a goal changes its motion, a keep-out appears."""

from collections.abc import Sequence
from typing import Literal

from pydantic import Field

from anser.aircraft_files.sources import SPEED_MAX_M_S
from anser.config.errors import Problem, describe_value, format_number
from anser.config.tables import NAME_PATTERN, Table, choice, expects, number, table
from anser.scenario.schema_aircraft import Aircraft, Goal
from anser.scenario.schema_airspace import KeepOut
from anser.scenario.schema_settings import DURATION_MAX_S, Timing

KINDS = (
    "aircraft-leaves",
    "goal-sensor-lost",
    "thrust-lost",
    "goal-stops",
    "goal-turns",
    "keep-out-appears",
    "arrival-put-off",
)
GOAL_EVENTS = ("goal-sensor-lost", "goal-stops", "goal-turns")
"""Those that leave fleet and airspace as they are: the plan is renewed towards where the goal is taken to be."""
_REQUIRED_KEYS: dict[str, tuple[str, ...]] = {
    "aircraft-leaves": ("aircraft",),
    "goal-sensor-lost": ("aircraft",),
    "thrust-lost": ("aircraft", "thrust_left"),
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
    """One event; which keys it needs goes by its kind."""

    time_s: float = number("when it happens", 0, DURATION_MAX_S, "s", exclusive_minimum=True)
    kind: Literal[
        "aircraft-leaves",
        "goal-sensor-lost",
        "thrust-lost",
        "goal-stops",
        "goal-turns",
        "keep-out-appears",
        "arrival-put-off",
    ] = choice("what happens", KINDS)
    aircraft: str | None = Field(
        None,
        pattern=NAME_PATTERN,
        description="to which aircraft",
        json_schema_extra=expects("the name of an aircraft"),
    )
    goal: str | None = Field(
        None, pattern=NAME_PATTERN, description="to which goal", json_schema_extra=expects("the name of a goal")
    )
    thrust_left: float | None = number("part of its thrust that is left", 0, 1, "", None)
    course_deg: float | None = number(
        "new course: of a goal over the ground; of an aircraft that leaves, through the air (left out: the least turn "
        "that keeps clear of the others)",
        -360,
        360,
        "deg",
        None,
    )
    speed_m_s: float | None = number("new speed of a goal; left out: as before", 0, SPEED_MAX_M_S, "m/s", None)
    later_s: float | None = number(
        "by how much all arrivals are put off", 0, DURATION_MAX_S, "s", None, exclusive_minimum=True
    )
    keep_out: KeepOut | None = table("what appears", "a table as of [[keep_out]]", None)
    gaps: Literal["close-up", "keep"] | None = choice(
        'what those behind an aircraft that leaves a sequence do: move up by one place ("close-up"; left out), or keep '
        "their times",
        ("close-up", "keep"),
        None,
    )
    goal_taken_over_by: Literal["nearest", "spare"] | None = choice(
        'who flies to the goal of an aircraft that leaves: the nearest that can be there in time ("nearest"), the '
        'nearest of those whose own goal another aircraft flies to as well ("spare"), or nobody (left out)',
        ("nearest", "spare"),
        None,
    )

    def consistency_problems(self) -> list[Problem]:
        """Find keys that the kind needs or does not know."""
        found = []
        needed, allowed = _REQUIRED_KEYS[self.kind], (*_REQUIRED_KEYS[self.kind], *_OPTIONAL_KEYS.get(self.kind, ()))
        for key in needed:
            if getattr(self, key) is None:
                found.append(Problem(key, "nothing", f'what kind "{self.kind}" needs: {", ".join(needed)}'))
        for key in sorted(self.model_fields_set - {"time_s", "kind", *allowed}):
            value = getattr(self, key)
            if value is not None:
                arrived = (
                    f"{format_number(value) if isinstance(value, float) else describe_value(value)} with "
                    f'kind "{self.kind}"'
                )
                found.append(Problem(key, arrived, f"no {key}; that kind knows {', '.join(allowed)}"))
        return found


def event_problems(
    events: Sequence[Event], aircraft: Sequence[Aircraft], goals: Sequence[Goal], timing: Timing, planner: str
) -> list[Problem]:
    """Find events for what does not exist, after the end, or that the planner does not know."""
    found = []
    if events and planner == "published":
        words = 'no events, or fleet.planner = "certified": only that planner plans on after them'
        return [Problem("event", f'{len(events)} with fleet.planner = "published"', words)]
    gone: dict[str, int] = {}
    for index, event in enumerate(events):
        path = f"event[{index}]"
        for key, named in (("aircraft", [one.name for one in aircraft]), ("goal", [one.name for one in goals])):
            name = getattr(event, key)
            if name is not None and name not in named:
                known = ", ".join(f'"{one}"' for one in named)
                words = f"the name of {'an aircraft' if key == 'aircraft' else 'a goal'} of this scenario ({known})"
                found.append(Problem(f"{path}.{key}", f'"{name}"', words))
        if event.time_s >= timing.duration_s:
            words = f"a time before the end of the flight, timing.duration_s = {format_number(timing.duration_s)} s"
            found.append(Problem(f"{path}.time_s", format_number(event.time_s), words))
        if event.kind == "aircraft-leaves" and event.aircraft is not None:
            if event.aircraft in gone:
                arrived = f'"{event.aircraft}", which leaves by event[{gone[event.aircraft]}] already'
                found.append(Problem(f"{path}.aircraft", arrived, "an aircraft that has not left"))
            gone[event.aircraft] = index
    return found
