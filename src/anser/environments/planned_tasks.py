"""Tasks with a plan: path tracking, and arrival at a moving goal at the planned time.

The cases are those flights of a study file that have a plan; every case is therefore known to be solvable.
"""

import os
from collections.abc import Sequence
from importlib import resources
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.campaigns.flights import applied_values, campaign_seeds, dispersed_scenario
from anser.campaigns.study import Study, load_study
from anser.config.errors import Problem, ScenarioError
from anser.constants import AIRBORNE_STAND_OFF_MIN_M, SURFACE_STAND_OFF_MIN_M
from anser.environment.environment import Environment
from anser.environments.cases import Case, FlightRange, Rng, Situation, aircraft_identity, autopilot_of
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
    stand_off_n: Vector3  #: Position of the rendezvous relative to the goal, NED, m.
    distance_min: Scalar  #: Least allowed distance to the goal, m.
    turn: Scalar  #: Direction in which the aircraft turns away from a goal that comes too near: +1 right, -1 left.

    def rendezvous_n(self, time: Any) -> Vector3:
        """Return the predicted position of the rendezvous at the arrival time (chart, NED, m).

        The prediction assumes that the goal keeps the velocity that it has at `time` (s).
        """
        time_left = self.trajectory.arrival_time - time
        return self.goal.position_n(time) + time_left * self.goal.velocity_n(time) + self.stand_off_n


class PlannedStudy(NamedTuple):
    """A study whose flights are cases of a task with a plan."""

    study: Study
    scenario: Scenario
    columns: Any  # values of the study's table, see `load_study`

    @property
    def agents(self) -> tuple[str, ...]:
        """Names of the aircraft."""
        return tuple(aircraft.name for aircraft in self.scenario.aircraft)

    @property
    def identity(self) -> dict[str, str | int | float]:
        """Description of the aircraft, which are of one type, for the attributes of flights."""
        first = self.scenario.aircraft[0]
        is_own = first.airframe is not None
        return {"aircraft": "custom"} if is_own else aircraft_identity(first.model_dump())


def read_study(study: str | os.PathLike[str] | None, default: str) -> PlannedStudy:
    """Read a study file; None: the package's study with the file name `default`.

    Raises ScenarioError if a file is not valid, the arrival rule is "earliest", or the goals are measured.
    """
    shipped = str(resources.files("anser.environments").joinpath(f"data/{default}"))
    planned_study = PlannedStudy(*load_study(shipped if study is None else study))
    scenario, problems = planned_study.scenario, []
    if scenario.arrival.rule == "earliest":  # an episode needs a planned arrival time
        problems.append(Problem("arrival.rule", '"earliest"', 'one common time, rule = "together" or "at"'))
    if scenario.goal_sensor.preset != "exact":
        expected = '"exact": an episode tells the true motion of the goal'
        problems.append(Problem("goal_sensor.preset", f'"{scenario.goal_sensor.preset}"', expected))
    if problems:
        raise ScenarioError(planned_study.study.name, problems)
    return planned_study


def planned_cases(planned_study: PlannedStudy, decision_s: float, step_s: float, dtype: Any) -> Stacked[Case]:
    """Plan the flights of a study, and return the cases with leading axes (flight, aircraft).

    Flights that have no plan, or no valid scenario, are left out. If the arrival rule is "together", each flight gets a
    random common arrival time.

    Parameters
    ----------
    planned_study
        The study, from `read_study`.
    decision_s, step_s
        Duration of a decision, and step of the integration, s.
    dtype
        Floating-point precision of the cases.

    Raises
    ------
    ScenarioError
        If the study cannot be flown with this step, or no flight has a plan.
    ValueError
        If the aircraft of a flight arrive at different times, or a controller is not an `InversionAutopilot`.
    """
    loaded, scenario, columns = planned_study
    if scenario.timing.step_s != step_s:
        scenario = scenario.replace("timing.step_s", step_s)
    applied = applied_values(loaded, scenario, columns)
    seeds = campaign_seeds(loaded, applied)
    rng = np.random.default_rng(loaded.seed)
    scenarios = []
    for number, seed in enumerate(seeds):
        factor = rng.uniform(*_TIME_FACTORS)
        try:
            dispersed = dispersed_scenario(scenario, int(seed), applied, number)
            if dispersed.arrival.rule == "together":
                time_s = round(factor * _straight_time_s(dispersed), 1)
                dispersed = dispersed.replace("arrival", {"rule": "at", "time_s": time_s})
        except ScenarioError:  # no valid scenario, or an arrival time after the end of the flight
            continue
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
    stacked = stack_objects(cases, tables_only=False, batched=lambda case: (case.start, case.decisions))
    batched = jax.tree.map(lambda leaf: leaf.reshape(-1, len(scenario.aircraft), *leaf.shape[1:]), stacked.batched)
    return cast_to_precision(Stacked(batched, stacked.shared), dtype)


_TIME_ROUNDING_S = 1e-6
_TIME_FACTORS = (1.1, 1.4)
"""Least and greatest ratio of a random arrival time to `_straight_time_s`, for the arrival rule "together"."""


def _straight_time_s(scenario: Scenario) -> float:
    """Return the time (s) in which every aircraft can reach its rendezvous on a straight line at its airspeed."""
    times = []
    for aircraft in scenario.aircraft:
        goal, up = scenario.goal_of(aircraft), np.asarray(aircraft.rendezvous.stand_off_m)
        relative = np.asarray(goal.position_m(0.0)) + up - np.asarray(aircraft.start.position_m)
        wind = np.asarray(scenario.wind.velocity_m_s(aircraft.start.altitude_m))
        velocity = np.asarray(goal.velocity_m_s()) - wind
        times.append(float(time_to_go(as_array(relative), as_array(velocity), scenario.speed_for(aircraft))[0]))
    return max(times)


def _cases_of(flight: Flight, trims: Sequence[Any], paths: TimedPath, decision_s: float) -> list[Case]:
    """Return the case of each aircraft of a planned flight.

    `trims` has the trim points by aircraft group, `paths` the planned paths of all aircraft. Raises ValueError if the
    aircraft arrive at different times, or a controller is not an `InversionAutopilot`.
    """
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
    """Base of the tasks with a plan, which the expert follows.

    An episode ends by failure as soon as the aircraft must break off to keep the least distance to the goal: 150 m to a
    goal on the surface, 100 m to an airborne goal (`anser.simulation.stand_off`).
    """

    #: File name of the package's study that supplies the cases if the user names no study.
    study: str = eqx.field(static=True, default="arrival-study.toml")

    def draw(self, vehicle: Vehicle, environment: Environment, flown: FlightRange, count: int, rng: Rng) -> Drawn:
        """Raise TypeError, because the cases of a task with a plan are flights of a study."""
        raise TypeError(f"{type(self).__name__}: the cases are flights of a study; see anser.environments.make")

    def expert_command(self, situation: Situation) -> PathCommand:
        """Return the command by which the guidance follows the plan: airspeed (m/s), path angle and course (rad)."""
        case, belief = situation.case, situation.belief
        return case.vehicle.guidance.command(None, belief, case.task, situation.instant)[0]


def comes_too_near(situation: Situation) -> Flag:
    """Whether the aircraft must turn away now to keep its least distance from the goal."""
    task, truth, time = situation.case.task, situation.truth, situation.time
    earth = situation.instant.environment.earth
    to_goal_n, goal_velocity_n = earth.sight(
        truth.state.position_n, task.goal.position_n(time), task.goal.velocity_n(time)
    )
    acceleration = truth.condition.earth.gravity * jnp.tan(situation.case.autopilot.limits.bank_max)
    velocity_n = velocity_over_ground_n(truth.condition, truth.state)
    return must_break_away(to_goal_n, velocity_n, goal_velocity_n, task.distance_min, acceleration, task.turn)


def in_course_axes(situation: Situation, vector_n: Vector3) -> tuple[Scalar, Scalar, Scalar]:
    """Return a NED vector's horizontal components along and to the right of the course, and the upward component.

    The course is the estimated course of the velocity relative to the air.
    """
    chi = situation.estimates["course_deg"] / RAD_DEG
    cosine, sine = jnp.cos(chi), jnp.sin(chi)
    north, east, down = jnp.unstack(vector_n)
    return cosine * north + sine * east, cosine * east - sine * north, -down


def axes_entries(name: str, unit: str, suffix: str, half_range: float, meaning: str) -> tuple[Entry, ...]:
    """Return the table entries of a vector's components along the course, to the right and upwards.

    `name` begins and `suffix`, a unit, ends the entries' names. `meaning` describes the vector. A component of
    `half_range` is normalized to 1.
    """
    return tuple(
        Entry(f"{name}_{axis}_{suffix}", unit, 0.0, half_range, f"{meaning}, {where}")
        for axis, where in (("ahead", "along the course"), ("right", "to the right"), ("up", "upwards"))
    )


class PathTracking(AbstractPlannedTask):
    """Follow a planned path in space and time up to the arrival.

    Success: a distance of at most 50 m to the planned position in the last 10 s. A distance of more than 1 km ends the
    episode by failure.
    """

    duration_s: float = eqx.field(static=True, default=180.0)
    settled_s: float = eqx.field(static=True, default=10.0)

    def errors(self, situation: Situation) -> Float[Array, " error"]:
        """Return the true distance to the planned position, divided by 50 m, shape (1,)."""
        planned_n = situation.case.task.trajectory.position_n(situation.time)
        return norm(planned_n - situation.truth.state.position_n)[None] / 50.0

    def has_failed(self, situation: Situation) -> Flag:
        """Whether the aircraft is more than 1 km away from the planned position."""
        return self.errors(situation)[0] > 20.0

    def entries(self) -> tuple[Entry, ...]:
        """Return the entries of three vectors: to the planned position now, and in 2 s; planned minus own velocity."""
        return (
            *axes_entries("path_offset", "m", "m", 100.0, "Planned less present position"),
            *axes_entries("path_ahead", "m", "m", 500.0, "Planned position in 2 s less present position"),
            *axes_entries("path_slip", "m s-1", "m_s", 50.0, "Planned less present velocity over the ground"),
        )

    def observation(self, situation: Situation) -> tuple[Scalar, ...]:
        """Return the quantities of `entries` (m and m/s), not normalized, as the aircraft estimates them."""
        belief, trajectory = situation.belief, situation.case.task.trajectory
        planned, later = trajectory.at(situation.time), trajectory.at(situation.time + 2.0)
        position_n = belief.state.position_n
        velocity_n = velocity_over_ground_n(belief.condition, belief.state)
        slip_n = planned.velocity_n / belief.condition.earth.chart_scale - velocity_n
        vectors = planned.position_n - position_n, later.position_n - position_n, slip_n
        return tuple(part for vector in vectors for part in in_course_axes(situation, vector))


class Arrival(AbstractPlannedTask):
    """Reach the rendezvous with a moving goal at the planned arrival time.

    The rendezvous is at least 150 m above a goal on the surface, or at least 100 m from an airborne goal. Success: a
    distance of at most 50 m to the rendezvous at the arrival time. The error is the zero-effort miss: the distance at
    the arrival time if aircraft and goal keep their present velocities.
    """

    duration_s: float = eqx.field(static=True, default=180.0)
    settled_s: float = eqx.field(static=True, default=0.0)

    def errors(self, situation: Situation) -> Float[Array, " error"]:
        """Return the true zero-effort miss, divided by 50 m, shape (1,)."""
        task, truth = situation.case.task, situation.truth
        velocity_n = truth.condition.earth.chart_scale * velocity_over_ground_n(truth.condition, truth.state)
        time_left = task.trajectory.arrival_time - situation.time
        miss_n = task.rendezvous_n(situation.time) - truth.state.position_n - time_left * velocity_n
        return norm(miss_n)[None] / 50.0

    def entries(self) -> tuple[Entry, ...]:
        """Return the entries of time to go, relative position of the rendezvous, mean velocity needed, and velocity."""
        return (
            Entry("time_to_go_s", "s", 0.0, 100.0, "Time until the arrival"),
            *axes_entries("rendezvous", "m", "m", 10000.0, "Rendezvous at the arrival less present position"),
            *axes_entries("mean_velocity", "m s-1", "m_s", 200.0, "Mean velocity needed to the rendezvous"),
            *axes_entries("ground_velocity", "m s-1", "m_s", 200.0, "Velocity over the ground"),
        )

    def observation(self, situation: Situation) -> tuple[Scalar, ...]:
        """Return the quantities of `entries` (s, m, m/s), not normalized.

        The aircraft's position and velocity are estimates; the goal's motion is true.
        """
        belief, task, time = situation.belief, situation.case.task, situation.time
        time_left = task.trajectory.arrival_time - time
        to_rendezvous_n = task.rendezvous_n(time) - belief.state.position_n
        velocity_n = velocity_over_ground_n(belief.condition, belief.state)
        mean_n = to_rendezvous_n / jnp.maximum(time_left, 1.0) / belief.condition.earth.chart_scale
        vectors = to_rendezvous_n, mean_n, velocity_n
        return (time_left, *(part for vector in vectors for part in in_course_axes(situation, vector)))


class FleetArrival(Arrival):
    """Bring each aircraft of a fleet to its rendezvous at one common time, with the required separation."""

    study: str = eqx.field(static=True, default="fleet-study.toml")
