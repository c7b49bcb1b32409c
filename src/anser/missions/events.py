"""Events of a single flight in the order of time, and the reassignment of a departing aircraft's goal.

`anser.missions.runs` calls `EventSchedule` between two segments of the flight. Only the effect of an event on the plan
is applied here; the physical effect (such as lost thrust) is part of the flight from its start, see
`anser.scenario.build`.
"""

import dataclasses
import heapq
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import numpy as np

from anser.missions.event_replanning import (
    NO_PLAN_MESSAGE,
    EventOutcome,
    FleetSnapshot,
    apply_event,
    replan_fleet,
    snapshot_at,
)
from anser.numerics.arrays import rows_on_host, with_rows
from anser.parts.planners import Performance
from anser.planning.certified.replanning import PARTLY_CORRECTED, UNCHANGED
from anser.scenario.schema import Scenario
from anser.scenario.schema_airspace import GOAL_EVENTS, Event
from anser.sensing.goal_filters import hand_over_goal
from anser.simulation.flight import Flight, FlightState

GOAL_TAKEN_OVER = "goal-taken-over"
_INFEASIBLE_M = 1e12  # cost of an infeasible pair, m


@dataclass(frozen=True)
class _FleetGoals:
    """State of the fleet at the sample at which departing aircraft leave their goals to other aircraft."""

    scenario: Scenario
    goals: tuple[str, ...]  # name of the goal of each aircraft
    snapshot: FleetSnapshot  # the fleet as input of the planner
    arrival_times_s: np.ndarray  # planned arrival times, s
    now_s: float  # time of the sample, s

    def aircraft_with_goal(self, goal: str) -> list[int]:
        """Return the indices of the aircraft that fly to a goal and have not left the fleet."""
        events = self.scenario.event
        departed = {
            event.aircraft for event in events if event.kind == "aircraft-leaves" and event.time_s <= self.now_s
        }
        names = [aircraft.name for aircraft in self.scenario.aircraft]
        return [k for k, name in enumerate(names) if self.goals[k] == goal and name not in departed]

    def distances_m(self, departures: Sequence[tuple[int, Event]]) -> np.ndarray:
        """Return each aircraft's distance from the rendezvous of each departed aircraft, (aircraft, departure), m.

        The rendezvous is extrapolated to the planned arrival of the aircraft that would take over. The distance is
        `_INFEASIBLE_M` for an aircraft that cannot be replanned, or would arrive too late even in a straight flight.
        The same holds for the only aircraft of a goal, unless the event asks for the "nearest" aircraft.

        `departures` are pairs (index of the departed aircraft, event).
        """
        tasks, names = self.snapshot.replannable_tasks, [aircraft.name for aircraft in self.scenario.aircraft]
        positions_n = np.asarray(tasks.position_n)
        can_replan = np.asarray(tasks.active)[: len(names)] > 0.0
        latest_s = self.arrival_times_s
        if self.scenario.arrival.rule in ("together", "earliest", "sequence"):
            latest_s = np.full_like(latest_s, self.scenario.timing.latest_arrival_s)
        reach_m = (latest_s - self.now_s) * (np.asarray(tasks.limits.speed_max) + self.scenario.wind.speed_max_m_s)
        flying, distances = self.snapshot.flying_tasks, np.full((len(names), len(departures)), _INFEASIBLE_M)
        for column, (departed, event) in enumerate(departures):
            to_go_s = np.maximum(self.arrival_times_s - self.now_s, 0.0)[:, None]
            goal_n = (
                np.asarray(flying.goal_position_n)[departed] + to_go_s * np.asarray(flying.goal_velocity_n)[departed]
            )
            range_m = np.linalg.norm(goal_n + np.asarray(flying.rendezvous.stand_off_n)[departed] - positions_n, axis=1)
            for aircraft in np.flatnonzero(can_replan):
                is_spare = len(self.aircraft_with_goal(self.goals[aircraft])) > 1
                if range_m[aircraft] <= reach_m[aircraft] and (is_spare or event.goal_taken_over_by == "nearest"):
                    distances[aircraft, column] = range_m[aircraft]
        return distances


def reassign_goals(
    # the fleet at sample `sample`, after the events
    scenario: Scenario,
    flight: Flight,
    state: FlightState,
    sample: int,
    departures: Sequence[Event],  # all events of the sample; only events with `goal_taken_over_by` count
    goals: Sequence[str],  # name of the present goal of each aircraft
    has_valid_plan: bool,  # whether the fleet has a valid plan after the events
    on_progress: Callable[[str], None] = lambda message: None,  # called with a description of the current work
) -> tuple[Flight, FlightState, tuple[str, ...], list[EventOutcome]]:
    """Reassign the goals of departing aircraft to other aircraft, if a plan exists for the new assignment.

    The assignment of the most goals with the least sum of distances is tried first. If no plan is found, the pair of
    aircraft and goal with the longest distance is excluded, and the next assignment is tried.

    Returns the flight and the state with the new goals and plan (unchanged if no goal is reassigned), the name of each
    aircraft's goal, and the outcome of each event that asks for a takeover.
    """
    requests = [event for event in departures if event.goal_taken_over_by is not None]
    if not requests:
        return flight, state, tuple(goals), []
    on_progress("looking for aircraft that take over a goal")
    names, now_s = [aircraft.name for aircraft in scenario.aircraft], sample * scenario.timing.step_s
    event_of = {names.index(str(event.aircraft)): event for event in requests}
    fleet = _FleetGoals(
        scenario, tuple(goals), snapshot_at(flight, state, sample), np.asarray(state.planner.plan.arrival_times), now_s
    )
    open_goals: list[int] = []  # aircraft that have left a goal to which nobody else flies

    messages: list[tuple[int, str, str | None]] = []  # aircraft, message, and the goal that the aircraft takes over

    def outcomes(departed: Sequence[int], has_plan: bool) -> list[EventOutcome]:
        unassigned = [(k, f'no aircraft can take over its goal "{goals[k]}" in time', None) for k in departed]
        return [
            EventOutcome(now_s, GOAL_TAKEN_OVER, names[aircraft], has_plan, message, goal)
            for aircraft, message, goal in (*messages, *unassigned)
        ]

    for departed in event_of:
        remaining = fleet.aircraft_with_goal(goals[departed])
        if remaining:
            message = f'its goal "{goals[departed]}" is not free: "{names[remaining[0]]}" flies to it'
            messages.append((departed, message, None))
        else:
            open_goals.append(departed)
    distances = fleet.distances_m([(departed, event_of[departed]) for departed in open_goals])
    while pairs := _least_assignment(fleet, distances, [event_of[departed] for departed in open_goals]):
        givers = {taker: open_goals[column] for taker, column in pairs}
        reassigned_flight, reassigned_state = flight, state
        for taker, giver in givers.items():
            reassigned_flight, reassigned_state = _hand_over_goal(reassigned_flight, reassigned_state, giver, taker)
        replanned_state = replan_fleet(scenario, reassigned_flight, reassigned_state, sample, on_progress)
        if replanned_state is not None:
            new_goals = tuple(goals[givers.get(aircraft, aircraft)] for aircraft in range(len(goals)))
            for taker, giver in givers.items():
                message = f'goes to the goal "{goals[giver]}" of "{names[giver]}" instead of "{goals[taker]}"'
                messages.append((taker, message, goals[giver]))
            unassigned = [departed for departed in open_goals if departed not in givers.values()]
            return reassigned_flight, replanned_state, new_goals, outcomes(unassigned, True)
        distances[max(pairs, key=lambda pair: distances[pair])] = _INFEASIBLE_M
    return flight, state, tuple(goals), outcomes(open_goals, has_valid_plan)


def _least_assignment(fleet: _FleetGoals, distances: np.ndarray, departures: Sequence[Event]) -> list[tuple[int, int]]:
    """Return the assignment of aircraft to goals that serves the most goals, with the least sum of distances (m).

    The result has pairs (index of the aircraft that takes over, column of `distances` and `departures`). The last
    aircraft of a goal can be assigned to another goal only if the event asks for the "nearest" aircraft.
    """
    from scipy.optimize import linear_sum_assignment  # the import takes half a second

    order, queue = itertools.count(), []
    asks_for_spare = np.flatnonzero([event.goal_taken_over_by != "nearest" for event in departures])

    def add(table: np.ndarray) -> None:
        rows, columns = linear_sum_assignment(table)
        heapq.heappush(queue, (table[rows, columns].sum(), next(order), table, list(zip(rows, columns, strict=True))))

    add(distances)
    while True:
        _, _, table, assigned = heapq.heappop(queue)
        pairs = [(int(taker), int(column)) for taker, column in assigned if table[taker, column] < _INFEASIBLE_M]
        abandoning = (pair for pair in pairs if _abandons_goal(fleet, pair, pairs, departures))
        taker = next(abandoning, (None, None))[0]
        if taker is None:
            return pairs
        # branch and bound: each new table keeps one of the goal's aircraft, or forbids all of them such departures
        rows = fleet.aircraft_with_goal(fleet.goals[taker])
        for excluded in (*((row, slice(None)) for row in rows), np.ix_(np.array(rows), asks_for_spare)):
            without = table.copy()
            without[excluded] = _INFEASIBLE_M
            add(without)


def _abandons_goal(
    fleet: _FleetGoals, pair: tuple[int, int], pairs: Sequence[tuple[int, int]], departures: Sequence[Event]
) -> bool:
    """Whether the assignment `pairs` would leave the present goal of the aircraft in `pair` without any aircraft.

    False if the departure asks for the "nearest" aircraft. Pairs are (aircraft, column of `departures`).
    """
    if departures[pair[1]].goal_taken_over_by == "nearest":
        return False
    goal = fleet.goals[pair[0]]
    return sum(fleet.goals[taker] == goal for taker, _ in pairs) >= len(fleet.aircraft_with_goal(goal))


def _hand_over_goal(flight: Flight, state: FlightState, giver: int, taker: int) -> tuple[Flight, FlightState]:
    """Return flight and state in which `taker` has goal, rendezvous and goal estimate of `giver` (aircraft indices)."""
    (giver_group, giver_row), (taker_group, taker_row) = _group_and_row(flight, giver), _group_and_row(flight, taker)

    def mission(group: int) -> Any:
        group_mission = flight.groups[group].vehicles.batched.mission
        assert group_mission is not None
        return group_mission.goal, group_mission.airborne, group_mission.rendezvous

    def goal_states(group: int) -> Any:
        return state.vehicles[group].sensors, state.vehicles[group].estimator

    giver_mission, giver_states = rows_on_host((mission(giver_group), goal_states(giver_group)), giver_row)
    flight = eqx.tree_at(
        lambda f: (
            f.groups[taker_group].vehicles.batched.mission.goal,
            f.groups[taker_group].vehicles.batched.mission.airborne,
            f.groups[taker_group].vehicles.batched.mission.rendezvous,
        ),
        flight,
        with_rows(mission(taker_group), taker_row, giver_mission),
    )
    taker_states = hand_over_goal(rows_on_host(goal_states(taker_group), taker_row), giver_states)
    state = eqx.tree_at(
        lambda s: (s.vehicles[taker_group].sensors, s.vehicles[taker_group].estimator),
        state,
        with_rows(goal_states(taker_group), taker_row, taker_states),
        is_leaf=lambda leaf: leaf is None,
    )
    return flight, state


def _group_and_row(flight: Flight, aircraft: int) -> tuple[int, int]:
    """Return the index of the group to which an aircraft belongs, and the index of the aircraft in the group."""
    return next((k, kind.members.index(aircraft)) for k, kind in enumerate(flight.groups) if aircraft in kind.members)


_SEARCHES_MAX = 3  # complete searches after one event
_SETTLED_S = 10.0  # time after an event in which every replanning is checked, s; goal filters need time to settle


class EventSchedule:
    """Events of a flight that are still to come, and the outcomes of past events.

    `anser.missions.run` calls, for each segment of the flight, `apply_due`, `steps_until_next` and `check_replanning`.

    Parameters
    ----------
    scenario
        Scenario with the events.
    on_progress
        Called with a description of the current work.
    performance
        Accelerations that the aircraft can reach at the start of the flight; None if no event is a loss of thrust.

    Attributes
    ----------
    outcomes
        Outcomes in the order of time.
    goals
        Name of the goal of each aircraft.
    """

    def __init__(
        self, scenario: Scenario, on_progress: Callable[[str], None], performance: Performance | None = None
    ) -> None:
        self.outcomes: list[EventOutcome] = []
        self.goals = tuple(aircraft.goal for aircraft in scenario.aircraft)
        self._scenario, self._on_progress, self._performance = scenario, on_progress, performance
        step_s = scenario.timing.step_s
        # The first sample at or after the event, as for the faults in the compiled steps.
        pairs = [(math.ceil(round(event.time_s / step_s, 6)), event) for event in scenario.event]
        self._coming = sorted(pairs, key=lambda pair: pair[0])
        self._replan_steps = round(scenario.timing.replan_period_s / step_s)
        # index of the last goal event among the outcomes, and the searches left for it
        self._goal_event: tuple[int, int] | None = None

    def apply_due(self, flight: Flight, state: FlightState, sample: int) -> tuple[Flight, FlightState]:
        """Apply the events that are due at sample `sample`, and return flight and state after the events."""
        due_events: list[Event] = []
        while self._coming and self._coming[0][0] <= sample:
            due_events.append(self._coming.pop(0)[1])
        for event in due_events:
            flight, state, outcome = apply_event(
                self._scenario, flight, state, sample, event, self._performance, self._on_progress
            )
            self.outcomes.append(outcome)
            if event.kind in GOAL_EVENTS and self._scenario.fleet.is_central:
                self._goal_event = len(self.outcomes) - 1, _SEARCHES_MAX
        # If no goal is handed over, the plan after the last departure is flown.
        departure = next((outcome for outcome in reversed(self.outcomes) if outcome.kind == "aircraft-leaves"), None)
        has_valid_plan = departure is not None and departure.has_valid_plan
        flight, state, self.goals, handovers = reassign_goals(
            self._scenario, flight, state, sample, due_events, self.goals, has_valid_plan, self._on_progress
        )
        self.outcomes += handovers
        return flight, state

    def steps_until_next(self, sample: int, steps_max: int) -> int:
        """Return the number of steps from `sample` to the next event, at most `steps_max`.

        After an event of a goal (`GOAL_EVENTS`), no step follows the step that begins at the next replanning time,
        because `check_replanning` must come next.
        """
        steps = min([steps_max, *(event_step - sample for event_step, _ in self._coming[:1])])
        if self._goal_event is not None and self._replan_steps:
            steps = min(steps, -sample % self._replan_steps + 1)
        return steps

    def check_replanning(self, flight: Flight, state: FlightState, sample: int) -> FlightState:
        """Search for a new plan if periodic replanning fails after an event of a goal, and return the state.

        At most three searches follow an event of a goal (`GOAL_EVENTS`). The checks end when a search finds a plan, or
        when periodic replanning succeeds later than 10 s after the event. Without a new plan, the state is unchanged.
        """
        if self._goal_event is None:
            return state
        (outcome_index, tries_left), now_s = self._goal_event, sample * self._scenario.timing.step_s
        event = self.outcomes[outcome_index]
        if int(np.asarray(state.planner.replanning)) not in (UNCHANGED, PARTLY_CORRECTED):
            if now_s > event.time_s + _SETTLED_S:
                self._goal_event = None
            return state
        self._on_progress(f"planning anew at {now_s:g} s")
        replanned_state = replan_fleet(self._scenario, flight, state, sample, self._on_progress)
        message = f"{NO_PLAN_MESSAGE if replanned_state is None else 'planned anew'} ({now_s:g} s)"
        self.outcomes[outcome_index] = dataclasses.replace(
            event, has_valid_plan=replanned_state is not None, message=message
        )
        self._goal_event = (outcome_index, tries_left - 1) if tries_left > 1 and replanned_state is None else None
        return state if replanned_state is None else replanned_state
