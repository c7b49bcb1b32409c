"""Events of a single flight in the order of time.

Their effects on flight and plan, and the reassignment of goals that departing aircraft leave.
"""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import numpy as np
from scipy.optimize import linear_sum_assignment

from anser.missions.replanning import (
    NO_PLAN_MESSAGE,
    EventOutcome,
    FleetSnapshot,
    apply_event,
    replan_fleet,
    snapshot_at,
)
from anser.numerics.arrays import as_array
from anser.planning.certified.replanning import PARTLY_CORRECTED, UNCHANGED
from anser.scenario.schema import Scenario
from anser.scenario.schema_event import GOAL_EVENTS, Event
from anser.sensing.goal_filters import hand_over_goal
from anser.simulation.flight import Flight, FlightState

GOAL_TAKEN_OVER = "goal-taken-over"
_INFEASIBLE_M = 1e12  # cost of what is not possible, m


@dataclass(frozen=True)
class _FleetGoals:
    """A fleet at the sample at which goals become free."""

    scenario: Scenario
    goals: tuple[str, ...]
    snapshot: FleetSnapshot
    arrival_times_s: np.ndarray
    now_s: float

    def aircraft_with_goal(self, goal: str) -> list[str]:
        """Names of those who fly to a goal and have not left."""
        events = self.scenario.event
        left = {one.aircraft for one in events if one.kind == "aircraft-leaves" and one.time_s <= self.now_s}
        names = [one.name for one in self.scenario.aircraft]
        return [name for name, own in zip(names, self.goals, strict=True) if own == goal and name not in left]

    def distances_m(self, departures: Sequence[tuple[int, Event]]) -> np.ndarray:
        """Way of each aircraft to the rendezvous of each who left, where it may be there in time; else `_NEVER`.

        In time is what a straight flight at the greatest airspeed, with the wind, allows: the search decides.
        """
        tasks, names = self.snapshot.tasks, [one.name for one in self.scenario.aircraft]
        places = np.asarray(tasks.position_n)
        free = np.asarray(tasks.active)[: len(names)] > 0.0
        last_s = self.arrival_times_s
        if self.scenario.arrival.rule in ("together", "earliest", "sequence"):
            last_s = np.full_like(last_s, self.scenario.timing.latest_arrival_s)
        reach_m = (last_s - self.now_s) * (np.asarray(tasks.limits.speed_max) + self.scenario.wind.speed_max_m_s)
        seen, ways = self.snapshot.seen, np.full((len(names), len(departures)), _INFEASIBLE_M)
        for column, (leaver, event) in enumerate(departures):
            to_go_s = np.maximum(self.arrival_times_s - self.now_s, 0.0)[:, None]
            goal_n = np.asarray(seen.goal_position_n)[leaver] + to_go_s * np.asarray(seen.goal_velocity_n)[leaver]
            away = np.linalg.norm(goal_n + np.asarray(seen.rendezvous.stand_off_n)[leaver] - places, axis=1)
            for row in np.flatnonzero(free):
                spare = len(self.aircraft_with_goal(self.goals[row])) > 1
                if away[row] <= reach_m[row] and (spare or event.goal_taken_over_by == "nearest"):
                    ways[row, column] = away[row]
        return ways


def reassign_goals(
    scenario: Scenario,
    flight: Flight,
    state: FlightState,
    number: int,
    departures: Sequence[Event],
    goals: Sequence[str],
    on_progress: Callable[[str], None] = lambda what: None,
) -> tuple[Flight, FlightState, tuple[str, ...], list[EventOutcome]]:
    """Give the goals of aircraft that leave at a sample to others, where that can be planned.

    The assignment with the shortest ways in all, of those aircraft that may still be planned anew and can be there in
    time; one for which no plan is found gives way to the next.

    Parameters
    ----------
    scenario, flight, state, number
        The fleet at the sample, after the aircraft have left.
    left
        The events by which they left.
    goals
        Name of the goal of each aircraft.
    on_progress
        Called with what is being done.

    Returns
    -------
    Flight and state after it, the name of the goal of each aircraft, and what was done.
    """
    asked = [event for event in departures if event.goal_taken_over_by is not None]
    if not asked:
        return flight, state, tuple(goals), []
    on_progress("looking for aircraft that take over a goal")
    names, now_s = [one.name for one in scenario.aircraft], number * scenario.timing.step_s
    fleet = _FleetGoals(
        scenario, tuple(goals), snapshot_at(flight, state, number), np.asarray(state.planner.plan.arrival_times), now_s
    )
    free: list[tuple[int, Event]] = []
    visited: list[EventOutcome] = []
    for event in asked:
        leaver = names.index(str(event.aircraft))
        others = fleet.aircraft_with_goal(goals[leaver])
        if others:
            message = f'its goal "{goals[leaver]}" is not free: "{others[0]}" flies to it'
            visited.append(EventOutcome(now_s, GOAL_TAKEN_OVER, names[leaver], True, message))
        else:
            free.append((leaver, event))
    ways = fleet.distances_m(free)
    while np.any(ways < _INFEASIBLE_M):
        rows, columns = linear_sum_assignment(ways)
        pairs = [(int(r), int(c)) for r, c in zip(rows, columns, strict=True) if ways[r, c] < _INFEASIBLE_M]
        handed, moved = flight, state
        for taker, column in pairs:
            handed, moved = _hand_over_goal(handed, moved, free[column][0], taker)
        planned = replan_fleet(scenario, handed, moved, number, on_progress)
        if planned is not None:
            after = list(goals)
            for taker, column in pairs:
                after[taker] = goals[free[column][0]]
            done = [
                EventOutcome(
                    now_s,
                    GOAL_TAKEN_OVER,
                    names[taker],
                    True,
                    f'goes to the goal "{after[taker]}" of "{names[free[column][0]]}" instead of "{goals[taker]}"',
                )
                for taker, column in pairs
            ]
            lacking = sorted(set(range(len(free))) - {column for _, column in pairs})
            return (
                handed,
                planned,
                tuple(after),
                [*visited, *done, *(_no_successor(now_s, *free[c], goals) for c in lacking)],
            )
        taker, column = max(pairs, key=lambda pair: ways[pair])
        ways[taker, column] = _INFEASIBLE_M
    return flight, state, tuple(goals), [*visited, *(_no_successor(now_s, *one, goals) for one in free)]


def _no_successor(now_s: float, leaver: int, event: Event, goals: Sequence[str]) -> EventOutcome:
    return EventOutcome(
        now_s, GOAL_TAKEN_OVER, str(event.aircraft), False, f'nobody can take over its goal "{goals[leaver]}" in time'
    )


def _hand_over_goal(flight: Flight, state: FlightState, giver: int, taker: int) -> tuple[Flight, FlightState]:
    """One aircraft with the goal, the rendezvous and what is known of the goal of another."""
    (of_giver, row), (of_taker, at) = _group_and_row(flight, giver), _group_and_row(flight, taker)

    def mission(kind: int) -> Any:
        own = flight.groups[kind].vehicles.batched.mission
        assert own is not None
        return own.goal, own.airborne, own.rendezvous

    def memories(kind: int) -> Any:
        return state.vehicles[kind].sensors, state.vehicles[kind].estimator

    given, known = _row(mission(of_giver), row), _row(memories(of_giver), row)
    flight = eqx.tree_at(
        lambda f: (
            f.groups[of_taker].vehicles.batched.mission.goal,
            f.groups[of_taker].vehicles.batched.mission.airborne,
            f.groups[of_taker].vehicles.batched.mission.rendezvous,
        ),
        flight,
        _with_row(mission(of_taker), at, given),
    )
    after = hand_over_goal(_row(memories(of_taker), at), known)
    state = eqx.tree_at(
        lambda s: (s.vehicles[of_taker].sensors, s.vehicles[of_taker].estimator),
        state,
        _with_row(memories(of_taker), at, after),
        is_leaf=lambda leaf: leaf is None,
    )
    return flight, state


def _group_and_row(flight: Flight, aircraft: int) -> tuple[int, int]:
    """Kind of an aircraft, and its place there."""
    return next((k, kind.members.index(aircraft)) for k, kind in enumerate(flight.groups) if aircraft in kind.members)


def _row(rows: Any, at: int) -> Any:
    return jax.tree.map(lambda leaf: np.asarray(leaf)[at], rows)


def _with_row(rows: Any, at: int, row: Any) -> Any:
    """Rows with one replaced, on the host: nothing is compiled."""

    def one(leaf: Any, new: Any) -> Any:
        table = np.array(leaf)
        table[at] = new
        return as_array(table, None)

    return jax.tree.map(one, rows, row)


_TRIES = 3  # searches after one event
_SETTLED_S = 10.0  # after an event in which renewals are looked at one by one: a filter takes its time too


class EventSchedule:
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

    def apply_due(self, flight: Flight, state: FlightState, number: int) -> tuple[Flight, FlightState]:
        """Flight and state after the events that are due at a sample."""
        due: list[Event] = []
        while self._coming and self._coming[0][0] <= number:
            due.append(self._coming.pop(0)[1])
        for event in due:
            flight, state, outcome = apply_event(self._scenario, flight, state, number, event, self._on_progress)
            self.outcomes.append(outcome)
            if event.kind in GOAL_EVENTS and self._scenario.fleet.planner == "certified":
                self._watched = len(self.outcomes) - 1, _TRIES
        flight, state, self.goals, taken = reassign_goals(
            self._scenario, flight, state, number, due, self.goals, self._on_progress
        )
        self.outcomes += taken
        return flight, state

    def steps_until_next(self, number: int, steps_max: int) -> int:
        """Steps to be flown from a sample on before the next event, or the next look at a renewal after one."""
        steps = min([steps_max, *(due - number for due, _ in self._coming[:1])])
        if self._watched is not None and self._renewal_steps:
            steps = min(steps, -number % self._renewal_steps + 1)
        return steps

    def check_replanning(self, flight: Flight, state: FlightState, number: int) -> FlightState:
        """The state at a sample, planned anew by the whole search where renewal finds no plan to a goal that changed.

        What renewal tries on the way is little; the search, which takes longer, may find more.
        """
        if self._watched is None:
            return state
        (place, tries), now_s = self._watched, number * self._scenario.timing.step_s
        event = self.outcomes[place]
        if int(np.asarray(state.planner.replanning)) not in (UNCHANGED, PARTLY_CORRECTED):
            if now_s > event.time_s + _SETTLED_S:
                self._watched = None
            return state
        self._on_progress(f"planning anew at {now_s:g} s")
        planned = replan_fleet(self._scenario, flight, state, number, self._on_progress)
        message = f"{NO_PLAN_MESSAGE if planned is None else 'planned anew'} ({now_s:g} s)"
        self.outcomes[place] = dataclasses.replace(event, planned=planned is not None, message=message)
        self._watched = (place, tries - 1) if tries > 1 and planned is None else None
        return state if planned is None else planned
