"""Scenario table for events: departures, losses of thrust or sensor, changed goal motions, and new keep-outs."""

from typing import TYPE_CHECKING, Literal

from pydantic import Field

from anser.aircraft_files.sources import SPEED_MAX_M_S
from anser.config.errors import Problem, format_number, format_value
from anser.config.tables import NAME_PATTERN, Table, choice, expects, number, table
from anser.scenario.schema_airspace import KeepOut
from anser.scenario.schema_settings import DURATION_MAX_S

if TYPE_CHECKING:
    from anser.scenario.schema import Scenario

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
"""Events that change only a goal's motion or the estimate of it; periodic replanning follows the estimate."""
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
    """One event during the flight; the required keys depend on the kind of event."""

    time_s: float = number("time of the event", 0, DURATION_MAX_S, "s", exclusive_minimum=True)
    kind: Literal[
        "aircraft-leaves",
        "goal-sensor-lost",
        "thrust-lost",
        "goal-stops",
        "goal-turns",
        "keep-out-appears",
        "arrival-put-off",
    ] = choice("kind of event", KINDS)
    aircraft: str | None = Field(
        None,
        pattern=NAME_PATTERN,
        description="aircraft concerned",
        json_schema_extra=expects("the name of an aircraft"),
    )
    goal: str | None = Field(
        None, pattern=NAME_PATTERN, description="goal concerned", json_schema_extra=expects("the name of a goal")
    )
    thrust_left: float | None = number("fraction of the thrust that is left", 0, 1, "", None)
    course_deg: float | None = number(
        "new course: of a goal over the ground; of an aircraft that leaves, through the air (left out: the least turn "
        "that keeps clear of the others)",
        -360,
        360,
        "deg",
        None,
    )
    speed_m_s: float | None = number("new speed of a goal; left out: as before", 0, SPEED_MAX_M_S, "m/s", None)
    later_s: float | None = number("delay of all arrivals", 0, DURATION_MAX_S, "s", None, exclusive_minimum=True)
    keep_out: KeepOut | None = table("new keep-out volume", "a table as of [[keep_out]]", None)
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
        """List missing keys, which the kind of event requires, and keys that the kind does not allow."""
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
        return problems


def event_problems(scenario: "Scenario") -> list[Problem]:
    """List events with unknown names, after the end of the flight, or without support by the planner."""
    events, duration_s, problems = scenario.event, scenario.timing.duration_s, []
    if events and scenario.fleet.planner == "published":
        expected = 'no events, or fleet.planner = "certified": only that planner plans on after them'
        return [Problem("event", f'{len(events)} with fleet.planner = "published"', expected)]
    departures: dict[str, int] = {}
    for index, event in enumerate(events):
        path = f"event[{index}]"
        for key, names in (
            ("aircraft", [aircraft.name for aircraft in scenario.aircraft]),
            ("goal", [goal.name for goal in scenario.goal]),
        ):
            name = getattr(event, key)
            if name is not None and name not in names:
                name_list = ", ".join(f'"{known_name}"' for known_name in names)
                expected = (
                    f"the name of {'an aircraft' if key == 'aircraft' else 'a goal'} of this scenario ({name_list})"
                )
                problems.append(Problem(f"{path}.{key}", f'"{name}"', expected))
        if event.time_s >= duration_s:
            expected = f"a time before the end of the flight, timing.duration_s = {format_number(duration_s)} s"
            problems.append(Problem(f"{path}.time_s", format_number(event.time_s), expected))
        if event.kind == "aircraft-leaves" and event.aircraft is not None:
            if event.aircraft in departures:
                arrived = f'"{event.aircraft}", which leaves by event[{departures[event.aircraft]}] already'
                problems.append(Problem(f"{path}.aircraft", arrived, "an aircraft that has not left"))
            departures[event.aircraft] = index
    return problems
