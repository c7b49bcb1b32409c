"""Goals that were left by the aircraft that flew to them, taken over by others of the fleet."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import numpy as np
from scipy.optimize import linear_sum_assignment

from anser.execution.replanned import EventOutcome, planned_anew, seen_at
from anser.numerics import as_array
from anser.scenario import Scenario
from anser.scenario.schema_event import Event
from anser.sensing.handover import handed_over
from anser.simulation import Flight, FlightState
from anser.simulation.replanning import Present

TAKEN_OVER = "goal-taken-over"
_NEVER = 1e12  # cost of what is not possible, m


@dataclass(frozen=True)
class _Fleet:
    """A fleet at the sample at which goals become free."""

    scenario: Scenario
    goals: tuple[str, ...]
    present: Present
    arrival_times_s: np.ndarray
    now_s: float

    def flying_to(self, goal: str) -> list[str]:
        """Names of those who fly to a goal and have not left."""
        events = self.scenario.event
        left = {one.aircraft for one in events if one.kind == "aircraft-leaves" and one.time_s <= self.now_s}
        names = [one.name for one in self.scenario.aircraft]
        return [name for name, own in zip(names, self.goals, strict=True) if own == goal and name not in left]

    def ways_m(self, left: Sequence[tuple[int, Event]]) -> np.ndarray:
        """Way of each aircraft to the rendezvous of each who left, where it may be there in time; else `_NEVER`.

        In time is what a straight flight at the greatest airspeed, with the wind, allows: the search decides.
        """
        tasks, names = self.present.tasks, [one.name for one in self.scenario.aircraft]
        places = np.asarray(tasks.position_n)
        free = np.asarray(tasks.active)[: len(names)] > 0.0
        last_s = self.arrival_times_s
        if self.scenario.arrival.rule in ("together", "earliest", "sequence"):
            last_s = np.full_like(last_s, self.scenario.timing.latest_arrival_s)
        reach_m = (last_s - self.now_s) * (np.asarray(tasks.limits.speed_max) + self.scenario.wind.greatest_m_s)
        seen, ways = self.present.seen, np.full((len(names), len(left)), _NEVER)
        for column, (leaver, event) in enumerate(left):
            to_go_s = np.maximum(self.arrival_times_s - self.now_s, 0.0)[:, None]
            goal_n = np.asarray(seen.goal_position_n)[leaver] + to_go_s * np.asarray(seen.goal_velocity_n)[leaver]
            away = np.linalg.norm(goal_n + np.asarray(seen.rendezvous.stand_off_n)[leaver] - places, axis=1)
            for row in np.flatnonzero(free):
                spare = len(self.flying_to(self.goals[row])) > 1
                if away[row] <= reach_m[row] and (spare or event.goal_taken_over_by == "nearest"):
                    ways[row, column] = away[row]
        return ways


def take_over(
    scenario: Scenario,
    flight: Flight,
    state: FlightState,
    number: int,
    left: Sequence[Event],
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
    asked = [event for event in left if event.goal_taken_over_by is not None]
    if not asked:
        return flight, state, tuple(goals), []
    on_progress("looking for aircraft that take over a goal")
    names, now_s = [one.name for one in scenario.aircraft], number * scenario.timing.step_s
    fleet = _Fleet(
        scenario, tuple(goals), seen_at(flight, state, number), np.asarray(state.planner.plan.arrival_times), now_s
    )
    free: list[tuple[int, Event]] = []
    visited: list[EventOutcome] = []
    for event in asked:
        leaver = names.index(str(event.aircraft))
        others = fleet.flying_to(goals[leaver])
        if others:
            message = f'its goal "{goals[leaver]}" is not free: "{others[0]}" flies to it'
            visited.append(EventOutcome(now_s, TAKEN_OVER, names[leaver], True, message))
        else:
            free.append((leaver, event))
    ways = fleet.ways_m(free)
    while np.any(ways < _NEVER):
        rows, columns = linear_sum_assignment(ways)
        pairs = [(int(r), int(c)) for r, c in zip(rows, columns, strict=True) if ways[r, c] < _NEVER]
        handed, moved = flight, state
        for taker, column in pairs:
            handed, moved = _handed_over(handed, moved, free[column][0], taker)
        planned = planned_anew(scenario, handed, moved, number, on_progress)
        if planned is not None:
            after = list(goals)
            for taker, column in pairs:
                after[taker] = goals[free[column][0]]
            done = [
                EventOutcome(
                    now_s,
                    TAKEN_OVER,
                    names[taker],
                    True,
                    f'goes to the goal "{after[taker]}" of "{names[free[column][0]]}" instead of "{goals[taker]}"',
                )
                for taker, column in pairs
            ]
            lacking = sorted(set(range(len(free))) - {column for _, column in pairs})
            return handed, planned, tuple(after), [*visited, *done, *(_nobody(now_s, *free[c], goals) for c in lacking)]
        taker, column = max(pairs, key=lambda pair: ways[pair])
        ways[taker, column] = _NEVER
    return flight, state, tuple(goals), [*visited, *(_nobody(now_s, *one, goals) for one in free)]


def _nobody(now_s: float, leaver: int, event: Event, goals: Sequence[str]) -> EventOutcome:
    return EventOutcome(
        now_s, TAKEN_OVER, str(event.aircraft), False, f'nobody can take over its goal "{goals[leaver]}" in time'
    )


def _handed_over(flight: Flight, state: FlightState, giver: int, taker: int) -> tuple[Flight, FlightState]:
    """One aircraft with the goal, the rendezvous and what is known of the goal of another."""
    (of_giver, row), (of_taker, at) = _place(flight, giver), _place(flight, taker)

    def mission(kind: int) -> Any:
        own = flight.kinds[kind].vehicles.own.mission
        assert own is not None
        return own.goal, own.airborne, own.rendezvous

    def memories(kind: int) -> Any:
        return state.vehicles[kind].sensors, state.vehicles[kind].estimator

    given, known = _row(mission(of_giver), row), _row(memories(of_giver), row)
    flight = eqx.tree_at(
        lambda f: (
            f.kinds[of_taker].vehicles.own.mission.goal,
            f.kinds[of_taker].vehicles.own.mission.airborne,
            f.kinds[of_taker].vehicles.own.mission.rendezvous,
        ),
        flight,
        _with_row(mission(of_taker), at, given),
    )
    after = handed_over(_row(memories(of_taker), at), known)
    state = eqx.tree_at(
        lambda s: (s.vehicles[of_taker].sensors, s.vehicles[of_taker].estimator),
        state,
        _with_row(memories(of_taker), at, after),
        is_leaf=lambda leaf: leaf is None,
    )
    return flight, state


def _place(flight: Flight, aircraft: int) -> tuple[int, int]:
    """Kind of an aircraft, and its place there."""
    return next((k, kind.members.index(aircraft)) for k, kind in enumerate(flight.kinds) if aircraft in kind.members)


def _row(rows: Any, at: int) -> Any:
    return jax.tree.map(lambda leaf: np.asarray(leaf)[at], rows)


def _with_row(rows: Any, at: int, row: Any) -> Any:
    """Rows with one replaced, on the host: nothing is compiled."""

    def one(leaf: Any, new: Any) -> Any:
        table = np.array(leaf)
        table[at] = new
        return as_array(table, None)

    return jax.tree.map(one, rows, row)
