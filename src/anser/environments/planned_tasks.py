"""Tasks with a plan made before: path tracking, and arrival at a moving place at a given time.

The cases are flights of a study: each is trimmed and planned by the certified planner, so that each is known to be
solvable. Flights without a plan are left out.
"""

import os
from collections.abc import Sequence
from importlib import resources
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.campaigns.flights import applied_values, campaign_seeds, dispersed_scenario
from anser.campaigns.study import load_study
from anser.config.errors import Problem, ScenarioError
from anser.constants import AIRBORNE_STAND_OFF_MIN_M, SURFACE_STAND_OFF_MIN_M
from anser.environment.environment import Environment
from anser.environments.cases import Case, FlightRange, Rng, Situation, autopilot_of
from anser.environments.spaces import Entry
from anser.environments.tasks import AbstractTask, Drawn
from anser.missions.flight_batches import FlightCase, plan_many
from anser.numerics.arrays import Stacked, as_array, cast_to_precision, stack_objects, unstack_rows
from anser.parts.paths import PathCommand
from anser.parts.perception import velocity_over_ground_n
from anser.parts.planners import time_to_go
from anser.planning.goals import GoalMotion
from anser.planning.timed_path import TimedPath
from anser.scenario.schema import Scenario
from anser.shapes import Flag, Scalar, Vector3
from anser.simulation.flight import Flight
from anser.simulation.stand_off import must_break_away
from anser.simulation.vehicle import Vehicle
from anser.spatial.vectors import norm
from anser.units import RAD_DEG


class PlannedMission(eqx.Module):
    """Goal, rendezvous and plan of one aircraft in an episode."""

    trajectory: TimedPath  #: Planned path up to the arrival.
    goal: GoalMotion  #: Motion of the goal.
    stand_off_n: Vector3  #: Rendezvous relative to the goal, NED, m.
    distance_min: Scalar  #: Least distance to the goal, m.
    turn: Scalar  #: Direction of the turn away from the goal: +1 right, -1 left.

    def rendezvous_n(self, time: Any) -> Vector3:
        """Return the rendezvous at the arrival as foreseen at a time (s): the goal keeps its present velocity."""
        time_left = self.trajectory.arrival_time - time
        return self.goal.position_n(time) + time_left * self.goal.velocity_n(time) + self.stand_off_n


def planned_cases(
    study: str | os.PathLike[str] | None, default: str, decision_s: float, dtype: Any
) -> tuple[Stacked[Case], tuple[str, ...], tuple[float, float] | None]:
    """Plan the flights of a study file, or of the package's study `default`; a decision takes `decision_s`.

    Returns cases with leading axes over flights and aircraft, the names of the aircraft, and the required horizontal
    and vertical separation, m (None: none). Raises ScenarioError if a file is not valid, or no flight of the study has
    a plan.
    """
    shipped = str(resources.files("anser.environments").joinpath(f"data/{default}"))
    loaded, scenario, columns = load_study(shipped if study is None else study)
    applied = applied_values(loaded, scenario, columns)
    seeds = campaign_seeds(loaded, applied)
    rng = np.random.default_rng(loaded.seed)
    scenarios = []
    for number, seed in enumerate(seeds):
        factor = rng.uniform(*_TIME_FACTORS)
        try:
            dispersed = dispersed_scenario(scenario, int(seed), applied, number)
        except ScenarioError:  # values that make no scenario, as in a campaign
            continue
        if dispersed.arrival.rule == "together":
            time_s = round(factor * _straight_time_s(dispersed), 1)
            dispersed = dispersed.replace("arrival", {"rule": "at", "time_s": time_s})
        elif dispersed.arrival.rule == "earliest":  # without preferred times, which are the only ones planned for here
            expected = 'one common time, rule = "together" or "at"'
            raise ScenarioError(loaded.name, [Problem("arrival.rule", '"earliest"', expected)])
        scenarios.append(dispersed)
    planned = plan_many([FlightCase(dispersed) for dispersed in scenarios])
    if not planned.numbers:
        arrived, expected = f"{len(seeds)} flights of which none has a plan", "values with which some are planned"
        raise ScenarioError(loaded.name, [Problem("vary", arrived, expected)])
    longest = max(plan.paths.times.shape[1] for plan in planned.plans)

    def padded(leaf: Array) -> np.ndarray:  # the last knot is repeated: the cells between equal knots are empty
        missing = {1: (0, longest - leaf.shape[1])}
        return np.pad(leaf, [missing.get(axis, (0, 0)) for axis in range(leaf.ndim)], mode="edge")

    cases = [
        case
        for flight, fleet, plan in zip(planned.flights, planned.fleets, planned.plans, strict=True)
        for case in _cases_of(flight, fleet.trims, jax.tree.map(padded, plan.paths), decision_s)
    ]
    names = tuple(aircraft.name for aircraft in scenario.aircraft)
    stacked = stack_objects(cases, tables_only=False, batched=lambda case: (case.start, case.decisions))
    batched = jax.tree.map(lambda leaf: leaf.reshape(-1, len(names), *leaf.shape[1:]), stacked.batched)
    return cast_to_precision(Stacked(batched, stacked.shared), dtype), names, scenario.separation.required_m


_TIME_ROUNDING_S = 1e-6
_TIME_FACTORS = (1.1, 1.4)
"""Arrival time over the time of the straight way at the fleet's airspeed, for a study without a rule of its own."""


def _straight_time_s(scenario: Scenario) -> float:
    """Return the time in which the farthest aircraft meets its rendezvous on a straight way in still air, s."""
    times = []
    for aircraft in scenario.aircraft:
        goal, up = scenario.goal_of(aircraft), np.asarray(aircraft.rendezvous.stand_off_m)
        relative = np.asarray(goal.position_m(0.0)) + up - np.asarray(aircraft.start.position_m)
        wind = np.asarray(scenario.wind.velocity_m_s(aircraft.start.altitude_m))
        velocity = np.asarray(goal.velocity_m_s()) - wind
        times.append(float(time_to_go(as_array(relative), as_array(velocity), scenario.speed_for(aircraft))[0]))
    return max(times)


def _cases_of(flight: Flight, trims: Sequence[Any], paths: TimedPath, decision_s: float) -> list[Case]:
    """Return the case of each aircraft of a planned flight, without its mission."""
    cases: list[Case] = []
    arrivals = np.asarray(paths.times)[:, -1]
    decisions = as_array(int(float(arrivals[0]) / decision_s + 1e-9), np.int32)
    if np.ptp(arrivals) > _TIME_ROUNDING_S:
        raise ValueError(
            f"arrival.rule: arrived a rule with several arrival times, {arrivals.min():g} to {arrivals.max():g} s; "
            'expected one common time, rule = "together" or "at"'
        )
    for index in range(flight.count):
        vehicle, _, _ = flight.aircraft(index)
        autopilot_of(vehicle)
        mission = vehicle.mission
        assert mission is not None
        group = next(k for k, members in enumerate(flight.members) if index in members)
        row = flight.members[group].index(index)
        start, trajectory = unstack_rows(trims[group])[row], unstack_rows(paths)[index]
        least = AIRBORNE_STAND_OFF_MIN_M if bool(mission.airborne) else SURFACE_STAND_OFF_MIN_M
        stand_off_n, turn = mission.rendezvous.stand_off_n, mission.hold.settings.hold_turn
        task = PlannedMission(trajectory, mission.goal, stand_off_n, as_array(least), turn)
        bare = eqx.tree_at(lambda v: v.mission, vehicle, None)
        cases.append(Case(bare, flight.environment, start, task, decisions))
    return cases


class AbstractPlannedTask(AbstractTask):
    """Base of the tasks with a plan: the expert follows the plan, and the stand-off to the goal is kept.

    An episode ends by failure as soon as the aircraft would have to break off so as not to come nearer to its goal than
    a rendezvous may be (`anser.simulation.stand_off`).
    """

    #: Study of the package from which the cases are made.
    study: str = eqx.field(static=True, default="arrival-study.toml")

    def draw(self, vehicle: Vehicle, environment: Environment, flown: FlightRange, count: int, rng: Rng) -> Drawn:
        """Raise TypeError: the cases of a task with a plan are flights of a study."""
        raise TypeError(f"{type(self).__name__}: the cases are flights of a study; see anser.environments.make")

    def expert_command(self, situation: Situation) -> PathCommand:
        """Return the path command (through the air) with which the guidance follows the plan."""
        case, belief = situation.case, situation.belief
        return case.vehicle.guidance.command(None, belief, case.task, situation.instant)[0]


def comes_too_near(situation: Situation) -> Flag:
    """Whether an aircraft must break off because it comes too near its goal; the environment ends the episode then."""
    task, truth, time = situation.case.task, situation.truth, situation.time
    earth = situation.instant.environment.earth
    to_goal_n, goal_velocity_n = earth.sight(
        truth.state.position_n, task.goal.position_n(time), task.goal.velocity_n(time)
    )
    acceleration = truth.condition.earth.gravity * jnp.tan(situation.case.autopilot.limits.bank_max)
    velocity_n = velocity_over_ground_n(truth.condition, truth.state)
    return must_break_away(to_goal_n, velocity_n, goal_velocity_n, task.distance_min, acceleration, task.turn)


def in_course_axes(situation: Situation, vector_n: Vector3) -> tuple[Scalar, Scalar, Scalar]:
    """Return a horizontal vector's parts along and to the right of the course through the air, and the part upwards."""
    chi = situation.estimates["course_deg"] / RAD_DEG
    cosine, sine = jnp.cos(chi), jnp.sin(chi)
    north, east, down = jnp.unstack(vector_n)
    return cosine * north + sine * east, cosine * east - sine * north, -down


def axes_entries(name: str, unit: str, suffix: str, half_range: float, meaning: str) -> tuple[Entry, ...]:
    """Return the table of a vector's three entries in the axes of `in_course_axes`."""
    return tuple(
        Entry(f"{name}_{axis}_{suffix}", unit, 0.0, half_range, f"{meaning}, {where}")
        for axis, where in (("ahead", "along the course"), ("right", "to the right"), ("up", "upwards"))
    )


class PathTracking(AbstractPlannedTask):
    """Follow a planned path in space and time up to the arrival.

    Tolerance in the last 10 s: 50 m of distance to the planned position. An error of more than 1 km ends the episode.
    """

    duration_s: float = eqx.field(static=True, default=180.0)
    settled_s: float = eqx.field(static=True, default=10.0)

    def errors(self, situation: Situation) -> Float[Array, " error"]:
        """Return the distance to the planned position, divided by its tolerance."""
        planned_n = situation.case.task.trajectory.position_n(situation.time)
        return norm(planned_n - situation.truth.state.position_n)[None] / 50.0

    def has_failed(self, situation: Situation) -> Flag:
        """Whether the aircraft is more than 1 km off its path."""
        return self.errors(situation)[0] > 20.0

    def entries(self) -> tuple[Entry, ...]:
        """Return the table of entries: planned position now and in 2 s, and planned velocity, in axes of the course."""
        return (
            *axes_entries("path_offset", "m", "m", 100.0, "Planned less present position"),
            *axes_entries("path_ahead", "m", "m", 500.0, "Planned position in 2 s less present position"),
            *axes_entries("path_slip", "m s-1", "m_s", 50.0, "Planned less present velocity over the ground"),
        )

    def observation(self, situation: Situation) -> tuple[Scalar, ...]:
        """Return the values of `entries`, in their units, from the aircraft's own estimates."""
        belief, trajectory = situation.belief, situation.case.task.trajectory
        planned, later = trajectory.at(situation.time), trajectory.at(situation.time + 2.0)
        position_n = belief.state.position_n
        velocity_n = velocity_over_ground_n(belief.condition, belief.state)
        vectors = planned.position_n - position_n, later.position_n - position_n, planned.velocity_n - velocity_n
        return tuple(part for vector in vectors for part in in_course_axes(situation, vector))


class Arrival(AbstractPlannedTask):
    """Be at the rendezvous with a moving goal at the planned arrival time.

    The rendezvous stands above the goal, at least 150 m above a goal on the surface and 100 m from one in the air.
    Success is a distance of at most 50 m at the arrival time. The error before is the zero-effort miss: the distance at
    the arrival time if aircraft and goal kept their velocities.
    """

    duration_s: float = eqx.field(static=True, default=180.0)
    settled_s: float = eqx.field(static=True, default=0.0)

    def errors(self, situation: Situation) -> Float[Array, " error"]:
        """Return the zero-effort miss, divided by its tolerance."""
        task, truth = situation.case.task, situation.truth
        velocity_n = velocity_over_ground_n(truth.condition, truth.state)
        time_left = task.trajectory.arrival_time - situation.time
        miss_n = task.rendezvous_n(situation.time) - truth.state.position_n - time_left * velocity_n
        return norm(miss_n)[None] / 50.0

    def entries(self) -> tuple[Entry, ...]:
        """Return the table of entries: time left, rendezvous at the arrival, mean velocity needed, ground velocity."""
        return (
            Entry("time_to_go_s", "s", 0.0, 100.0, "Time until the arrival"),
            *axes_entries("rendezvous", "m", "m", 10000.0, "Rendezvous at the arrival less present position"),
            *axes_entries("mean_velocity", "m s-1", "m_s", 200.0, "Mean velocity needed to the rendezvous"),
            *axes_entries("ground_velocity", "m s-1", "m_s", 200.0, "Velocity over the ground"),
        )

    def observation(self, situation: Situation) -> tuple[Scalar, ...]:
        """Return the values of `entries`, in their units, from own estimates and the goal's present motion."""
        belief, task, time = situation.belief, situation.case.task, situation.time
        time_left = task.trajectory.arrival_time - time
        to_rendezvous_n = task.rendezvous_n(time) - belief.state.position_n
        velocity_n = velocity_over_ground_n(belief.condition, belief.state)
        mean_n = to_rendezvous_n / jnp.maximum(time_left, 1.0)
        vectors = to_rendezvous_n, mean_n, velocity_n
        return (time_left, *(part for vector in vectors for part in in_course_axes(situation, vector)))


class FleetArrival(Arrival):
    """Be at the rendezvous of each aircraft at one common time, with the separation kept: the task of a fleet."""

    study: str = eqx.field(static=True, default="fleet-study.toml")
