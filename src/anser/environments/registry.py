"""Environments by name: the tasks with their aircraft, air, sensors and cases."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from anser.compiling.options import enable_compilation_cache
from anser.environment.gusts import NoGusts
from anser.environments.actions import LEVELS
from anser.environments.cases import (
    FlightRange,
    autopilot_of,
    default_range,
    scenario_tables,
    single_aircraft,
    stack_cases,
    wind_rows,
)
from anser.environments.environment import MOTION, AircraftEnvironment, Parameters
from anser.environments.spaces import Entry, catalogue_entry
from anser.environments.tasks import AbstractTask, AltitudeChange, AttitudeHold, UpsetRecovery, VelocityCommand
from anser.numerics.arrays import as_array, cast_to_precision
from anser.sensing.ideal_sensors import IdealSensors
from anser.simulation.precision import PRECISIONS, Precision
from anser.simulation.vehicle import Vehicle
from anser.units import RAD_DEG
from anser.variables import surface_variables

TASKS: dict[str, Callable[[], AbstractTask]] = {
    "AttitudeHold": AttitudeHold,
    "VelocityCommand": VelocityCommand,
    "AltitudeChange": AltitudeChange,
    "UpsetRecovery": UpsetRecovery,
}
"""Tasks of one aircraft by name."""


def make(
    task: str | AbstractTask,
    action: str = "surfaces",
    *,
    aircraft: str | Mapping[str, Any] = "f16",
    flown: FlightRange | None = None,
    cases: int = 4096,
    seed: int = 0,
    precision: Precision = "float64",
    step_s: float = 0.01,
    **tables: Any,
) -> AircraftEnvironment:
    """Make an environment of one aircraft.

    Parameters
    ----------
    task
        Name of a task of the package, such as "VelocityCommand", or an own task.
    action
        Level of action: "surfaces", "rates" or "velocity".
    aircraft
        Name of an airframe, path of an aircraft file, or a table `[[aircraft]]` of a scenario with deviations, gains
        and the like.
    flown
        Range of the starts and of the wind; None: the range of the aircraft.
    cases
        Number of cases: starts and commands from which a reset draws.
    seed
        Seed of the cases.
    precision
        Precision of the flight: "float64" or "float32".
    step_s
        Step of the integration, s.
    **tables
        Tables of a scenario: `wind`, `turbulence`, `navigation`, `earth`, `limits`.

    Raises
    ------
    ValueError
        An argument is not valid, or the aircraft has hardly any steady flight in the range.
    ScenarioError
        A table is not valid.
    """
    enable_compilation_cache()
    if action not in LEVELS:
        raise ValueError(f"action: arrived {action!r}; expected one of {', '.join(LEVELS)}")
    if isinstance(task, str) and task not in TASKS:
        raise ValueError(f"task: arrived {task!r}; expected one of {', '.join(TASKS)}, or an AbstractTask")
    if precision not in PRECISIONS:
        raise ValueError(f"precision: arrived {precision!r}; expected one of {', '.join(PRECISIONS)}")
    if cases < 1:
        raise ValueError(f"cases: arrived {cases}; expected at least 1")
    level, chosen_task = LEVELS[action], TASKS[task]() if isinstance(task, str) else task
    if action not in chosen_task.levels:
        raise ValueError(
            f"action: arrived {action!r}; expected one of {', '.join(chosen_task.levels)}: at other levels the "
            "autopilot itself solves the task"
        )
    decision_steps = round(level.decision_s / step_s)
    if decision_steps < 1 or abs(decision_steps * step_s - level.decision_s) > 1e-9:
        raise ValueError(f"step_s: arrived {step_s:g}; expected a divisor of the decision, {level.decision_s:g} s")
    vehicle, environment = single_aircraft(scenario_tables(aircraft, tables))
    flown = default_range(vehicle) if flown is None else flown
    rng = np.random.default_rng(seed)
    starts, numbers = chosen_task.draw(vehicle, environment, flown, cases, rng)
    decisions = round(chosen_task.duration_s / level.decision_s)
    bank = stack_cases(
        vehicle, environment, starts, wind_rows(flown, cases, rng), numbers, decisions, np.dtype(precision)
    )
    name = task if isinstance(task, str) else type(task).__name__
    made = AircraftEnvironment(
        task=chosen_task,
        level=level,
        parameters=Parameters(bank, None, cast_to_precision(as_array(step_s), precision)),
        observed=(*MOTION, *_surface_entries(vehicle), *chosen_task.entries()),
        commanded=level.entries(autopilot_of(vehicle), vehicle.airframe),
        decision_steps=decision_steps,
        name=name,
    )
    return with_start_observations(made)


def _surface_entries(vehicle: Vehicle) -> tuple[Entry, ...]:
    actuators = vehicle.airframe.actuators
    positions = surface_variables(actuators.names)[: len(actuators.names)]
    stops = zip(positions, np.asarray(actuators.lower), np.asarray(actuators.upper), strict=True)
    return tuple(
        catalogue_entry(v.name, 0.5 * RAD_DEG * (low + high), 0.5 * RAD_DEG * (high - low), v) for v, low, high in stops
    )


def with_start_observations(made: AircraftEnvironment) -> AircraftEnvironment:
    """Return an environment with the observation at the start of each case, where no random number enters it."""
    vehicle = made.parameters.cases.shared.vehicle
    if not (isinstance(vehicle.gusts, NoGusts) and isinstance(vehicle.sensors, IdealSensors)):
        return made
    parameters = made.parameters

    def observation(row: Any) -> Any:
        state = made.start_of_case(row, jnp.zeros(2, jnp.uint32), parameters)
        return made.observe(jnp.zeros(2, jnp.uint32), state, None, parameters)

    rows = jnp.arange(parameters.count, dtype=jnp.int32)
    observations = jax.jit(jax.vmap(observation))(rows)
    return dataclasses.replace(made, parameters=dataclasses.replace(parameters, observations=observations))
