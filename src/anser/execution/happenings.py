"""The events of a flight by itself, in the order of time: what each does to flight and plan, and what became of it."""

import dataclasses
from collections.abc import Callable

import numpy as np

from anser.execution.replanned import NO_PLAN, EventOutcome, after_event, planned_anew
from anser.execution.takeover import take_over
from anser.planning.certified.renewal import BENT_IN_PART, KEPT
from anser.scenario import Scenario
from anser.scenario.schema_event import GOAL_EVENTS, Event
from anser.simulation import Flight, FlightState

_TRIES = 3  # searches after one event
_SETTLED_S = 10.0  # after an event in which renewals are looked at one by one: a filter takes its time too


class Happenings:
    """Events still to come, and what became of those that were.

    Parameters
    ----------
    scenario
        With its events.
    on_progress
        Called with what is being done.

    Attributes
    ----------
    outcomes
        What was done, in the order of time.
    goals
        Name of the goal of each aircraft.
    """

    def __init__(self, scenario: Scenario, on_progress: Callable[[str], None]) -> None:
        self.outcomes: list[EventOutcome] = []
        self.goals = tuple(one.goal for one in scenario.aircraft)
        self._scenario, self._on_progress = scenario, on_progress
        step_s = scenario.timing.step_s
        pairs = [(round(event.time_s / step_s), event) for event in scenario.event]
        self._coming = sorted(pairs, key=lambda pair: pair[0])
        self._renewal_steps = round(scenario.timing.replan_period_s / step_s)
        # place in the outcomes of an event after which the renewals are looked at, and how often that may be searched
        self._watched: tuple[int, int] | None = None

    def take_place(self, flight: Flight, state: FlightState, number: int) -> tuple[Flight, FlightState]:
        """Flight and state after the events that are due at a sample."""
        due: list[Event] = []
        while self._coming and self._coming[0][0] <= number:
            due.append(self._coming.pop(0)[1])
        for event in due:
            flight, state, outcome = after_event(self._scenario, flight, state, number, event, self._on_progress)
            self.outcomes.append(outcome)
            if event.kind in GOAL_EVENTS and self._scenario.fleet.planner == "certified":
                self._watched = len(self.outcomes) - 1, _TRIES
        flight, state, self.goals, taken = take_over(
            self._scenario, flight, state, number, due, self.goals, self._on_progress
        )
        self.outcomes += taken
        return flight, state

    def steps_until_next(self, number: int, most: int) -> int:
        """Steps to be flown from a sample on before the next event, or the next look at a renewal after one."""
        steps = min([most, *(due - number for due, _ in self._coming[:1])])
        if self._watched is not None and self._renewal_steps:
            steps = min(steps, -number % self._renewal_steps + 1)
        return steps

    def looked_after(self, flight: Flight, state: FlightState, number: int) -> FlightState:
        """The state at a sample, planned anew by the whole search where renewal finds no plan to a goal that changed.

        What renewal tries on the way is little; the search, which takes longer, may find more.
        """
        if self._watched is None:
            return state
        (place, tries), now_s = self._watched, number * self._scenario.timing.step_s
        event = self.outcomes[place]
        if int(np.asarray(state.planner.renewal)) not in (KEPT, BENT_IN_PART):
            if now_s > event.time_s + _SETTLED_S:
                self._watched = None
            return state
        self._on_progress(f"planning anew at {now_s:g} s")
        planned = planned_anew(self._scenario, flight, state, number, self._on_progress)
        message = f"{NO_PLAN if planned is None else 'planned anew'} ({now_s:g} s)"
        self.outcomes[place] = dataclasses.replace(event, planned=planned is not None, message=message)
        self._watched = (place, tries - 1) if tries > 1 and planned is None else None
        return state if planned is None else planned
