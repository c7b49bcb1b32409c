"""The first plan of a scenario, by the planner that it names."""

import functools
import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from anser.compiling import compiled, compiled_quickly, enable_compilation_cache
from anser.execution.certified import drawing_from, plan_certified
from anser.execution.negotiated import plan_decentralised
from anser.execution.plan_interface import SPEED_TOLERANCE, Ahead, Planned
from anser.execution.untrimmable import refuse_untrimmable
from anser.numerics import AbstractRandomness, leading
from anser.planning import (
    LIMIT_MESSAGES,
    PLAN_MESSAGES,
    FleetPlan,
    LimitReport,
    bend_words,
    check_limits,
    separation_min,
)
from anser.scenario import Scenario, as_scenario, build_flight, build_path_limits
from anser.scenario.schema_aircraft import Aircraft
from anser.simulation import (
    STATUS_MESSAGES,
    FlightState,
    start_flight,
    statuses,
)
from anser.simulation.status import broken_off

_start = compiled_quickly(start_flight)
_separation = compiled(separation_min)
_SAME_WIND_M_S = 0.5


@compiled
def _limits_of(plan: FleetPlan, limits: Any, gravity: Any) -> LimitReport:
    return jax.vmap(check_limits, in_axes=(0, None, None))(plan.trajectories, limits, gravity)


@dataclass(frozen=True, repr=False)
class PublishedPlanned(Planned):
    """The first plan of a scenario by the published planner, which always plans: `problems` says what is wrong with it.

    Attributes
    ----------
    state
        The fleet at its start, with the plan.
    """

    state: FlightState

    @functools.cached_property
    def plan(self) -> FleetPlan:
        """The plan itself."""
        return leading(self._all, len(self.scenario.aircraft))

    @property
    def _all(self) -> FleetPlan:
        """The plan with those that fill the fleet up."""
        return self.state.planner.plan

    @functools.cached_property
    def limits(self) -> LimitReport:
        """How the paths keep the scenario's limits; leading axis aircraft."""
        found = _limits_of(self._all, build_path_limits(self.scenario), self.flight.environment.gravity)
        return leading(found, len(self.scenario.aircraft))

    @functools.cached_property
    def separation_min_m(self) -> float | None:
        """Least planned distance between two aircraft up to the arrival, m; None for one aircraft."""
        if len(self.scenario.aircraft) == 1:
            return None
        return float(np.min(np.asarray(_separation(self._all.trajectories, active=self._all.active))))

    def notes(self) -> tuple[str, ...]:
        """Where the plan differs from the scenario's words, one sentence each: mean airspeed, wind."""
        found, asked_m_s, speed_m_s = [], self.scenario.fleet.speed_m_s, float(self.plan.speed)
        if speed_m_s > asked_m_s * (1.0 + SPEED_TOLERANCE):
            farthest = self.scenario.aircraft[int(self.plan.farthest)].name
            found.append(
                f"the plan's mean airspeed is {speed_m_s:.1f} m/s instead of fleet.speed_m_s = {asked_m_s:g} m/s: "
                f'aircraft "{farthest}" has the longest way and cannot slow down or come down more slowly'
            )
        changes = {one.name: _change_of_wind_m_s(self.scenario, one, self.arrival_s) for one in self.scenario.aircraft}
        name = max(changes, key=lambda one: changes[one])
        if changes[name] > _SAME_WIND_M_S:
            found.append(
                "the plan reckons with the wind where each aircraft starts; that at the rendezvous differs, by "
                f'{changes[name]:.1f} m/s for aircraft "{name}": lengths and arrival time change as the plan is renewed'
            )
        return tuple(found)

    @property
    def arrival_s(self) -> float:
        """When all arrive, s."""
        return float(self.plan.arrival_time)

    def problems(self) -> tuple[str, ...]:
        """Why the plan cannot be flown as it stands, one sentence each; empty where it can."""
        found, duration_s = [], self.scenario.timing.duration_s
        if self.arrival_s >= duration_s:
            found.append(f"the fleet arrives at {self.arrival_s:.1f} s, the flight ends at {duration_s:g} s")
        codes, stopped = (np.asarray(rows) for rows in statuses(self.flight, self.state))
        planned, limits = np.asarray(self.plan.status), np.asarray(self.limits.status)
        for k, aircraft in enumerate(self.scenario.aircraft):
            status = int(codes[k])
            if stopped[k] or broken_off(status):
                found.append(f'aircraft "{aircraft.name}": {STATUS_MESSAGES[status]}')
            elif planned[k]:
                found.append(f'aircraft "{aircraft.name}": {PLAN_MESSAGES[int(planned[k])]}')
            elif limits[k]:
                found.append(f'aircraft "{aircraft.name}": {LIMIT_MESSAGES[int(limits[k])]}')
        return tuple(found)

    def path_words(self) -> tuple[str, ...]:
        """How the path of each aircraft goes: "nominal", "bent left" or "bent right"."""
        return tuple(bend_words(float(bend)) for bend in np.asarray(self.plan.lateral_bends))

    def begun(self) -> FlightState:
        """The fleet at its start, with the plan."""
        return self.state


def _change_of_wind_m_s(scenario: Scenario, one: Aircraft, arrival_s: float) -> float:
    """How much the wind at an aircraft's rendezvous differs from that at its start, m/s."""
    up_m = scenario.goal_of(one).position_m(arrival_s)[2] + one.rendezvous.stand_off_up_m
    return math.dist(scenario.wind.velocity_m_s(up_m), scenario.wind.velocity_m_s(one.start.altitude_m))


def plan(
    scenario: Scenario | str | os.PathLike[str],
    on_progress: Callable[[str], None] = lambda what: None,
    ahead: Ahead = lambda *of: None,
    randomness: AbstractRandomness | None = None,
) -> Planned:
    """Trim every aircraft at its start and make the first plan of the scenario's planner, as seen at time 0.

    `anser.run` flies what this gives, and `anser plan` prints it.

    Parameters
    ----------
    scenario
        Validated, from `load`, or the path of its file; its `fleet.planner` says which planner.
    on_progress
        Called now and then with what is being done.
    ahead
        Prepares a program that is needed next, for a flight and the shapes of its first state: it is traced while the
        start is compiled, and compiled beside it.
    randomness
        Source of all random numbers; None: that of the scenario's seed. Not without a centre.

    Returns
    -------
    Planned
        With `plan`, `refusals`, which says why there is none, `problems()`, which also says why one that is there
        cannot be flown as it stands (both are empty of a good plan), and `notes()`, which says where it differs from
        the scenario's words. Only the certified planner refuses: without a plan, `plan` raises
        `anser.execution.NoPlanError`.

    Raises
    ------
    ScenarioError
        If the file cannot be read or is no valid scenario, or an aircraft cannot fly steadily at its start; the message
        says what stops it.
    """
    enable_compilation_cache()
    scenario = as_scenario(scenario)
    if scenario.fleet.planner == "certified":
        return plan_certified(scenario, on_progress, ahead, randomness)
    if scenario.fleet.planner == "decentralised":
        return plan_decentralised(scenario, on_progress, ahead)
    on_progress("trimming and planning")
    flight = drawing_from(randomness, build_flight(scenario, filled_up=True))
    start = _start.prepare(flight).begin()
    following = ahead(flight, start.shapes[0])
    if following is not None:
        following.begin()
    state, fleet = _start(flight)
    made = PublishedPlanned(scenario, flight, fleet, (), state)
    refuse_untrimmable(scenario, flight, fleet.steady)
    return made
