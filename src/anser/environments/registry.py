"""Construction of an environment from a task, an aircraft, air, sensors and cases."""

import dataclasses
import os
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from anser.compiling.options import enable_compilation_cache
from anser.constants import STEP_MAX_S, STEP_MIN_S
from anser.environment.environment import Environment, SteadyWind
from anser.environment.gusts import NoGusts
from anser.environments.actions import LEVELS
from anser.environments.cases import (
    FlightRange,
    aircraft_identity,
    autopilot_of,
    default_range,
    single_aircraft,
    stack_cases,
)
from anser.environments.environment import MOTION, AircraftEnvironment, Parameters
from anser.environments.fleet import FleetEnvironment, entries_of_others
from anser.environments.planned_tasks import (
    AbstractPlannedTask,
    Arrival,
    FleetArrival,
    PathTracking,
    planned_cases,
    read_study,
)
from anser.environments.spaces import Entry, catalogue_entry
from anser.environments.tasks import AbstractTask, AltitudeChange, AttitudeHold, UpsetRecovery, VelocityCommand
from anser.numerics.arrays import Stacked, as_array, cast_to_precision
from anser.sensing.ideal_sensors import IdealSensors
from anser.simulation.flight import PRECISIONS, Precision
from anser.simulation.vehicle import Vehicle
from anser.units import RAD_DEG
from anser.variables import surface_variables

_TASKS = AttitudeHold, VelocityCommand, AltitudeChange, UpsetRecovery, PathTracking, Arrival, FleetArrival
TASKS: dict[str, Callable[[], AbstractTask]] = {task.__name__: task for task in _TASKS}
"""Classes of the package's tasks by name."""


def make(
    task: str | AbstractTask,
    action: str = "surfaces",
    *,
    aircraft: str | Mapping[str, Any] = "f16",
    flown: FlightRange | None = None,
    study: str | os.PathLike[str] | None = None,
    cases: int | None = None,
    seed: int | None = None,
    precision: Precision = "float64",
    step_s: float | None = None,
    **tables: Any,
) -> AircraftEnvironment | FleetEnvironment:
    """Make an environment of one aircraft, or of a fleet for the task "FleetArrival".

    Parameters
    ----------
    task
        Name of a task of the package, such as "VelocityCommand", or a user's `AbstractTask`.
    action
        Level of action: "surfaces", "rates" or "velocity"; must be one of the task's `levels`.
    aircraft
        Name of an airframe, path of an aircraft file, or a table `[[aircraft]]` of a scenario. The table must have no
        goal and no rendezvous.
    flown
        Range from which starts and wind are drawn; None: `default_range` of the aircraft.
    study
        Path of a study file, for the tasks "PathTracking", "Arrival" and "FleetArrival" only; None: a study of the
        package. The study's flights are planned and become the cases; flights that have no plan are left out. The
        study determines `aircraft`, `flown`, `cases`, `seed` and `tables`, which must not be given.
    cases
        Number of cases (start and commands of an episode), one of which a reset selects; None: 4,096.
    seed
        Seed of the random cases; None: 0.
    precision
        Precision of the flight: "float64" or "float32".
    step_s
        Step of the integration, s: 0.001 to 0.05 s, and a divisor of the level's `decision_s`. None: 0.01 s, or the
        step of the study.
    **tables
        Tables of a scenario: `atmosphere`, `earth`, `event` ("aircraft-changes", "thrust-lost"), `excitation`, `gust`,
        `limits`, `navigation`, `parts` (sensors and estimator), `turbulence`, `wind`.

    Raises
    ------
    ValueError, ScenarioError
        If an argument or a table is not valid or has no effect; if at most 2 % of the conditions in the range `flown`
        are steady flights; if no flight of the study has a plan.
    """
    enable_compilation_cache()
    if isinstance(task, str):
        _require("task", task, TASKS, ", or an AbstractTask")
    _require("action", action, LEVELS)
    _require("precision", precision, PRECISIONS)
    for name, number, least in (("cases", cases, 1), ("seed", seed, 0)):
        if number is not None and not (isinstance(number, int | np.integer) and number >= least):
            raise ValueError(f"{name}: arrived {number!r}; expected a whole number from {least}")
    level, chosen_task = LEVELS[action], TASKS[task]() if isinstance(task, str) else task
    _require("action", action, chosen_task.levels, ": at other levels the autopilot itself solves the task")
    name = task if isinstance(task, str) else type(task).__name__
    agents, separation_m, dtype, is_fleet = (), None, np.dtype(precision), isinstance(chosen_task, FleetArrival)
    if isinstance(chosen_task, AbstractPlannedTask):
        planned_study = read_study(study, chosen_task.study)
        step_s = planned_study.scenario.timing.step_s if step_s is None else step_s
        decision_steps = _decision_steps(level.decision_s, step_s)
        given = {"flown": flown, "aircraft": None if aircraft == "f16" else aircraft, "cases": cases, "seed": seed}
        if excluded := ", ".join([*tables, *(key for key, value in given.items() if value is not None)]):
            raise ValueError(f"{name}: arrived {excluded}; expected these in a study and its scenario, study=PATH")
        agents, separation_m = planned_study.agents, planned_study.scenario.separation.required_m
        if is_fleet and len(agents) < 2:
            raise ValueError("study: arrived one aircraft; expected several, or the task Arrival or PathTracking")
        if not is_fleet and len(agents) > 1:
            raise ValueError(f"study: arrived {len(agents)} aircraft; expected one, or the task FleetArrival")
        bank = planned_cases(planned_study, level.decision_s, step_s, dtype)
        identity = planned_study.identity
        vehicle = bank.combine(jax.tree.map(lambda leaf: leaf[0, 0], bank.batched)).vehicle
        if not is_fleet:
            bank = Stacked(jax.tree.map(lambda leaf: leaf[:, 0], bank.batched), bank.shared)
    elif study is not None:
        raise ValueError(f"study: arrived {study}; expected a task with a plan, PathTracking, Arrival or FleetArrival")
    else:
        step_s = 0.01 if step_s is None else step_s
        decision_steps = _decision_steps(level.decision_s, step_s)
        vehicle, environment = single_aircraft(aircraft, tables, step_s)
        identity = aircraft_identity({"type": aircraft} if isinstance(aircraft, str) else aircraft)
        flown = default_range(vehicle) if flown is None else flown
        count, rng = 4096 if cases is None else cases, np.random.default_rng(0 if seed is None else seed)
        # Starts are steady in still air; `stack_cases` adds the wind to the velocities.
        still = Environment(environment.atmosphere, SteadyWind(as_array(np.zeros(3))), environment.earth)
        drawn = chosen_task.draw(vehicle, still, flown, count, rng)
        decisions = round(chosen_task.duration_s / level.decision_s)
        bank = stack_cases(vehicle, environment, flown, drawn, decisions, rng, dtype)
    made = AircraftEnvironment(
        task=chosen_task,
        level=level,
        parameters=Parameters(bank, None, cast_to_precision(as_array(step_s), precision)),
        observed=(*MOTION, *_surface_entries(vehicle), *chosen_task.entries()),
        commanded=level.entries(autopilot_of(vehicle), vehicle.airframe),
        decision_steps=decision_steps,
        name=name,
        identity=identity,
    )
    if is_fleet:
        return FleetEnvironment(made, agents, separation_m, (*made.observed, *entries_of_others(len(agents))))
    return _with_start_observations(made)


def _decision_steps(decision_s: float, step_s: float) -> int:
    """Return the number of integration steps (s) in a decision (s). Raises ValueError if `step_s` is not valid."""
    number = round(decision_s / step_s) if STEP_MIN_S <= step_s <= STEP_MAX_S else 0
    if number < 1 or abs(number * step_s - decision_s) > 1e-9:
        expected = f"a divisor of the decision, {decision_s:g} s, from {STEP_MIN_S:g} to {STEP_MAX_S:g} s"
        raise ValueError(f"step_s: arrived {step_s:g}; expected {expected}")
    return number


def _require(name: str, arrived: str, expected: Iterable[str], remark: str = "") -> None:
    if arrived not in expected:
        raise ValueError(f"{name}: arrived {arrived!r}; expected one of {', '.join(expected)}{remark}")


def _surface_entries(vehicle: Vehicle) -> tuple[Entry, ...]:
    actuators = vehicle.airframe.actuators
    positions = surface_variables(actuators.names)[: len(actuators.names)]
    low, high = np.asarray(actuators.lower), np.asarray(actuators.upper)
    scales = zip(positions, 0.5 * RAD_DEG * (low + high), 0.5 * RAD_DEG * (high - low), strict=True)
    return tuple(catalogue_entry(*scale) for scale in scales)


def _with_start_observations(made: AircraftEnvironment) -> AircraftEnvironment:
    """Return `made` with `Parameters.observations`; with gusts or sensors that are not ideal, `made` is unchanged."""
    parameters, vehicle = made.parameters, made.parameters.cases.shared.vehicle
    if not (isinstance(vehicle.gusts, NoGusts) and isinstance(vehicle.sensors, IdealSensors)):
        return made
    key = jnp.zeros(2, jnp.uint32)

    def observation(row: Any) -> Any:
        return made.observe(key, made.start_of_case(row, key, parameters), None, parameters)

    observations = jax.jit(jax.vmap(observation))(jnp.arange(len(parameters.decisions), dtype=jnp.int32))
    return dataclasses.replace(made, parameters=dataclasses.replace(parameters, observations=observations))
