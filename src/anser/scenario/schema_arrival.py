"""When the aircraft arrive: the rule of the fleet, the times of each, and what does not fit together."""

from typing import Annotated, Literal

from pydantic import Field

from anser.scenario.errors import Problem, plain, show
from anser.scenario.schema_aircraft import Aircraft
from anser.scenario.schema_base import NAME_PATTERN, Table, choice, expects, number
from anser.scenario.schema_checks import label
from anser.scenario.schema_settings import DURATION_MAX_S, Timing

RULES = ("together", "earliest", "at", "sequence", "times", "windows")

_RULE_OF = {"time_s": "at", "spacing_s": "sequence", "order": "sequence"}
_RULE_OF_AIRCRAFT = {"arrive_s": "times", "arrive_from_s": "windows", "arrive_to_s": "windows"}


class Arrival(Table):
    """The rule that sets the times of arrival."""

    rule: Literal["together", "earliest", "at", "sequence", "times", "windows"] = choice(
        "all at one time: of the farthest at fleet.speed_m_s, the earliest that the limits allow, or a given one; "
        "or one after another; or each at its own time, or within its own window",
        RULES,
        "together",
    )
    time_s: float | None = number('time of arrival of all, with rule "at"', 1, DURATION_MAX_S, "s", None)
    spacing_s: float | None = number('time between two arrivals, with rule "sequence"', 0, 3600, "s", None)
    order: tuple[Annotated[str, Field(pattern=NAME_PATTERN)], ...] | None = Field(
        default=None,
        min_length=1,
        strict=False,  # a TOML list arrives as a Python list; the items stay strict
        description='who arrives after whom, with rule "sequence"; left out: as in the file',
        json_schema_extra=expects('a list of the names of all aircraft, such as ["first", "second"]'),
    )

    def own_problems(self) -> list[Problem]:
        """Find keys that the rule does not know or lacks."""
        found = []
        for key, rule in _RULE_OF.items():
            value = getattr(self, key)
            if value is not None and self.rule != rule:
                arrived = f'{show(value) if key == "order" else plain(value)} with rule "{self.rule}"'
                found.append(Problem(key, arrived, f'rule = "{rule}", or no {key}'))
            if value is None and self.rule == rule and key != "order":
                found.append(Problem(key, "nothing", f'a number (s), which rule "{rule}" needs'))
        return found

    @property
    def is_common(self) -> bool:
        """Whether all arrive at one time."""
        return self.rule in ("together", "earliest", "at") or (self.rule == "sequence" and self.spacing_s == 0.0)

    def meet(self, one: Aircraft, other: Aircraft) -> bool:
        """Say whether two aircraft of the fleet arrive at the same time by this rule."""
        return self.is_common or (self.rule == "times" and one.arrive_s == other.arrive_s)


def arrival_problems(arrival: Arrival, aircraft: tuple[Aircraft, ...], timing: Timing) -> list[Problem]:
    """Find times that the rule lacks or does not know, an order that is none, and arrivals after the flight.

    The names of the aircraft are unique.
    """
    found = [] if arrival.time_s is None else _late("arrival.time_s", arrival.time_s, timing)
    for index, one in enumerate(aircraft):
        found.extend(_own_times(f"aircraft[{index}]", one, arrival, timing))
    if arrival.order is not None:
        found.extend(_order(arrival.order, aircraft))
    if arrival.spacing_s is not None:
        lasting_s = (len(aircraft) - 1) * arrival.spacing_s
        if lasting_s >= timing.duration_s:
            arrived = f"{plain(arrival.spacing_s)}, which is {plain(lasting_s)} s from the first arrival to the last"
            words = f"a spacing with which all arrive before timing.duration_s, which is {plain(timing.duration_s)} s"
            found.append(Problem("arrival.spacing_s", arrived, words))
    return found


def _own_times(path: str, one: Aircraft, arrival: Arrival, timing: Timing) -> list[Problem]:
    """Find what is wrong with the times of one aircraft."""
    found, whom = [], label("aircraft", one)
    for key, rule in _RULE_OF_AIRCRAFT.items():
        time_s: float | None = getattr(one, key)
        where = f"{path}.{key}"
        if time_s is None:
            if arrival.rule == rule:
                words = f'a time (s), which arrival.rule "{rule}" needs of every aircraft'
                found.append(Problem(where, "nothing", words, whom))
        elif arrival.rule != rule:
            words = f'arrival.rule = "{rule}", or no {key}'
            found.append(Problem(where, f'{plain(time_s)} with arrival.rule "{arrival.rule}"', words, whom))
        else:
            found.extend(_late(where, time_s, timing, whom))
    if found or one.arrive_from_s is None or one.arrive_to_s is None:
        return found
    if one.arrive_from_s >= one.arrive_to_s:
        words = f"less than arrive_to_s, which is {plain(one.arrive_to_s)} s"
        found.append(Problem(f"{path}.arrive_from_s", plain(one.arrive_from_s), words, whom))
    return found


def _late(path: str, time_s: float, timing: Timing, whom: str = "") -> list[Problem]:
    """Find a time of arrival at the end of the flight or after it."""
    if time_s < timing.duration_s:
        return []
    return [Problem(path, plain(time_s), f"less than timing.duration_s, which is {plain(timing.duration_s)} s", whom)]


def _order(order: tuple[str, ...], aircraft: tuple[Aircraft, ...]) -> list[Problem]:
    """Find names of the order that no aircraft has or that come twice, and aircraft that it leaves out."""
    found = []
    names = [one.name for one in aircraft]
    for index, name in enumerate(order):
        if name not in names:
            words = "the name of an aircraft of this scenario"
            found.append(Problem(f"arrival.order[{index}]", show(name), words))
        elif name in order[:index]:
            taken = f"{show(name)}, already arrival.order[{order.index(name)}]"
            found.append(Problem(f"arrival.order[{index}]", taken, "every aircraft once"))
    if not found and len(order) < len(names):
        missing = ", ".join(show(name) for name in names if name not in order)
        found.append(Problem("arrival.order", f"a list without {missing}", "every aircraft once"))
    return found
