"""One flight of a scenario: check of the precision, planning, the flight with its events, and the result."""

import contextlib
import functools
import importlib
import json
import os
import threading
import time as clock
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from anser.compiling.program import PreparedProgram
from anser.config.errors import Problem, ScenarioError
from anser.environment.atmosphere import atmosphere_layers
from anser.files import result_folder
from anser.missions.batches import Progress, no_progress
from anser.missions.events import EventSchedule
from anser.missions.first_plan import FirstPlan, NoPlanError
from anser.missions.plans import plan, plan_for_flight
from anser.missions.saved_flights import FLIGHT, SUMMARY, SavedFlight
from anser.missions.segments import fly_with_replanning, prepare_flight, start_replanning_programs
from anser.scenario.build_aircraft import resolve_fleet
from anser.scenario.files import as_scenario
from anser.scenario.schema import Scenario
from anser.scenario.user_parts import UserParts, attach_parts, user_parts
from anser.simulation.flight import SEGMENT_STEPS, Flight, FlightState, Precision, cast_flight, cast_state


def needs_single_flight(scenario: Scenario) -> bool:
    """Whether a scenario must be flown alone, because the planner responds to events or is decentralised."""
    is_central = scenario.fleet.is_central or user_parts(scenario).planner is not None
    return bool(scenario.planned_events) or not is_central


def _precision_problem(scenario: Scenario, precision: Precision) -> Problem | None:
    """Return the reason why a scenario cannot be flown in a precision; None if the precision is allowed."""
    received = None
    if scenario.earth.model != "flat":
        received = "a round Earth, whose distances float32 rounds to half a metre"
    elif needs_single_flight(scenario):
        received = "one with events, or without a centre"
    if precision == "float64" or received is None:
        return None
    return Problem("precision", f'"{precision}" of {received}', 'precision = "float64" for it')


def check_precision(scenario: Scenario, precision: Precision, source: str | None = None) -> None:
    """Raise ScenarioError if a scenario cannot be flown in a precision; `source` is the file named in the message."""
    problem = _precision_problem(scenario, precision)
    if problem is not None:
        raise ScenarioError(source or scenario.name, [problem])


def precision_problems(scenarios: Sequence[Scenario], precision: Precision) -> dict[int, str]:
    """Return the reason for each scenario that cannot be flown in a precision, by index in `scenarios`."""
    problems = {k: _precision_problem(scenario, precision) for k, scenario in enumerate(scenarios)}
    return {k: str(problem) for k, problem in problems.items() if problem is not None}


def limits_text(
    scenario: Scenario,
    flight: Flight,  # arrays built from the scenario; padding aircraft are left out
) -> str:
    """Return the limits of the scenario's aircraft as JSON text, one object per aircraft.

    The objects have the keys of `[limits]` with the effective values (null: no limit). The key `surfaces_deg` has the
    lower and upper stop of each control surface by name, deg; surfaces without finite stops are left out.
    """
    stops: dict[int, dict[str, list[float]]] = {}
    for group in flight.groups:
        actuators = group.vehicles.batched.airframe.actuators  # arrays with one axis are always batched
        stop_angles = [np.degrees(np.asarray(angles)) for angles in (actuators.lower, actuators.upper)]
        for position, index in enumerate(group.members):
            surface_stops = zip(actuators.names, *(angles[position] for angles in stop_angles), strict=True)
            stops[index] = {
                name: [round(float(a), 6), round(float(b), 6)] for name, a, b in surface_stops if np.isfinite(a + b)
            }
    limits_by_aircraft = [
        aircraft.limits.model_dump() | {"surfaces_deg": stops[index]}
        for index, aircraft in enumerate(resolve_fleet(scenario))
    ]
    return json.dumps(limits_by_aircraft)


_RESULT_FILES = (FLIGHT, SUMMARY, "report.html")


def _prepare(precision: Precision, flight: Flight, state: FlightState) -> PreparedProgram:
    """Start to compile the program of a flight's segments in a precision, and import xarray meanwhile."""
    prepared = prepare_flight(cast_flight(flight, precision), cast_state(state, precision)).start()
    if prepared.is_compiling:
        _import_results()
    return prepared


def _import_results() -> None:
    """Import the modules of results in advance; a failure is ignored, since `run` imports the modules again."""
    with contextlib.suppress(Exception):
        importlib.import_module("anser.results.dataset")


def _start_replanning_programs(flight: Flight, state: FlightState) -> None:
    """Start to compile the replanning programs while the flight's program is compiled, if a new plan is likely."""
    is_uncertain = flight.randomness is not None and int(flight.timing.replan_steps) > 0
    if is_uncertain and flight.planner.searches_often and prepare_flight(flight, state).is_compiling:
        start_replanning_programs(flight, state)


@dataclass(frozen=True, repr=False)
class FlightResult(SavedFlight):
    """A flown scenario: dataset, summary and plan; the printed form lists the arrivals."""

    scenario: Scenario  #: Scenario of the flight.
    planned: FirstPlan  #: The first plan.

    def save(self, folder: Path | str, *, force: bool = False) -> Path:
        """Write `flight.nc`, `summary.json` and `report.html` into a new folder; returns the folder.

        If `force` is True, the folder may exist: the three files are replaced, and other files stay.

        Raises
        ------
        FileExistsError
            If the folder exists and `force` is False.
        """
        target = Path(folder)
        with result_folder(target, replace=force) as staging:
            self.write_into(staging)
        return target

    def write_into(self, folder: Path) -> None:
        """Write `flight.nc`, `summary.json` and `report.html` into an existing folder.

        Raises FileExistsError if one of the files exists.
        """
        from anser.results.netcdf import write_netcdf
        from anser.results.summary import write_summary

        flight, summary, report = (folder / name for name in _RESULT_FILES)
        with ThreadPoolExecutor(1) as second_core:  # the compression of the flight leaves a core to the report
            written_flight = second_core.submit(write_netcdf, self.dataset, flight)
            write_summary(self.summary, summary)
            self.report(report)
            written_flight.result()


def run(
    scenario: Scenario | str | os.PathLike[str],
    progress: Progress | None = None,
    planned: FirstPlan | None = None,
    precision: Precision = "float64",
    *,
    controller: Any = None,
    guidance: Any = None,
    sensors: Any = None,
    estimator: Any = None,
    planner: Any = None,
    on_segment: Callable[[np.ndarray, dict[str, np.ndarray]], None] = lambda time_s, history: None,
) -> FlightResult:
    """Fly a scenario and return the recorded flight.

    Parameters
    ----------
    scenario
        From `load`, or the path of a scenario file.
    progress
        Called with a description of the current work and the completed share of the flight, 0..1; the share is None
        during planning, replanning and the final summary.
    planned
        A finished plan of this scenario, from `anser.plan` or `anser.missions.read_plan`; None: the scenario is planned
        first. The flight may have user-defined parts that the plan lacks, but not another planner.
    precision
        Precision of the flight; planning always uses float64.
    controller, guidance, sensors, estimator, planner
        User-defined parts that replace the parts of the scenario: an object of a subclass of
        `anser.parts.AbstractController` and so on, or a name as text ("my_package:MyController"). Except for `planner`,
        also a mapping from names of aircraft to parts.
    on_segment
        Called after each segment of the flight with the times of the steps, s, and the recorded values by key of
        `anser.variables.CATALOGUE`, (time, aircraft), SI units and radians.

    Raises
    ------
    ValueError
        If `planned` is the plan of another scenario, or was made with other user-defined parts or another planner.
    ScenarioError
        If the file cannot be read or is not a valid scenario, if a user-defined part is not valid, if an aircraft
        cannot be trimmed at its start, or if the scenario cannot be flown in the precision.
    NoPlanError
        If no plan was found; the message contains the reasons.
    """
    parts = UserParts(controller, guidance, sensors, estimator, planner)
    scenario, on_progress = attach_parts(as_scenario(scenario), parts), progress or no_progress
    check_precision(scenario, precision)
    start_time = clock.perf_counter()
    if planned is None:
        planned = plan(scenario, lambda message: on_progress(message, None), functools.partial(_prepare, precision))
    else:
        planned = plan_for_flight(planned, scenario)
    if planned.refusals:
        raise NoPlanError(planned.refusals)
    flight, state = cast_flight(planned.flight, precision), cast_state(planned.initial_state(), precision)
    timing = scenario.timing
    steps = round(timing.duration_s / timing.step_s)
    _start_replanning_programs(flight, state)
    # While the compiled steps leave a core free. No daemon: the interpreter must not end within an import.
    threading.Thread(target=_import_results, name="anser-imports").start()
    on_progress("flying", 0.0)
    history: dict[str, np.ndarray] = {}
    sample_index = 0
    schedule = EventSchedule(scenario, lambda message: on_progress(message, None), planned.fleet.performance)
    while sample_index <= steps:
        flight, state = schedule.apply_due(flight, state, sample_index)
        step_count = schedule.steps_until_next(sample_index, min(SEGMENT_STEPS, steps + 1 - sample_index))
        final_state, rows = fly_with_replanning(flight, state, sample_index, step_count)
        segment = slice(sample_index, sample_index + step_count)
        _store_rows(history, rows, segment, (steps + 1, len(scenario.aircraft)))
        sample_index += step_count
        state = schedule.check_replanning(flight, final_state, sample_index)
        on_segment(
            np.arange(segment.start, segment.stop) * timing.step_s,
            {key: values[segment] for key, values in history.items()},
        )
        on_progress("flying", min(sample_index / (steps + 1), 1.0))
    time_s = np.arange(steps + 1) * timing.step_s
    wall_s = clock.perf_counter() - start_time
    on_progress("summing up", None)
    from anser.results.dataset import to_dataset
    from anser.results.documents import version_attributes
    from anser.results.summary import summarize

    outcomes = [outcome.as_dict() for outcome in schedule.outcomes]
    surfaces = planned.flight.surfaces[: len(scenario.aircraft)]
    summary = summarize(
        time_s, history, scenario, wall_s, planned.path_descriptions(), outcomes, schedule.goals, surfaces
    )
    attributes = _attributes(scenario) | {"limits": limits_text(scenario, planned.flight)} | version_attributes()
    network = planned.network_summary(time_s, history)
    if network is not None:
        summary["network"] = network
        attributes["network"] = json.dumps(network)
    stride = round(timing.record_period_s / timing.step_s)
    dataset = to_dataset(
        time_s[::stride],
        {key: values[::stride] for key, values in history.items()},
        [aircraft.name for aircraft in scenario.aircraft],
        attributes,
        surfaces,
        atmosphere_layers(planned.flight.environment.atmosphere),
    )
    return FlightResult(dataset, summary, scenario, planned)


def _store_rows(
    history: dict[str, np.ndarray],  # record of the flight by key; the arrays are made with the first segment
    rows: dict[str, np.ndarray],  # rows of a segment by key, (step, aircraft), padding aircraft included
    segment: slice,  # samples of the segment
    shape: tuple[int, int],  # number of samples and of aircraft of the flight
) -> None:
    """Store the rows of a segment in the record of a flight; real numbers are stored in double precision."""
    for key, values in rows.items():
        if key not in history:
            dtype = np.float64 if values.dtype.kind == "f" else values.dtype
            history[key] = np.empty((*shape, *values.shape[2:]), dtype)
        history[key][segment] = values[:, : shape[1]]


def _attributes(scenario: Scenario) -> dict[str, Any]:
    from anser.results.separation import separation_attributes

    return {
        "title": scenario.name,
        "description": scenario.description,
        "scenario_hash": scenario.hash,
        "scenario": scenario.model_dump_json(),
        "scenario_written": scenario.model_dump_json(exclude_unset=True),
        "seed": scenario.seed,
        "earth_model": scenario.earth.model,
        "reference_latitude_deg": scenario.earth.latitude_deg,
        "reference_longitude_deg": scenario.earth.longitude_deg,
        **({"user_parts": json.dumps(parts.describe())} if (parts := user_parts(scenario)) else {}),
        **separation_attributes(scenario),
    }
