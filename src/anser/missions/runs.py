"""One run of a scenario.

The precisions that it allows, planning, the flight with its events, and the result with the limits of each aircraft.
"""

import dataclasses
import functools
import importlib
import json
import os
import time as clock
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from anser.compiling.options import compiled
from anser.compiling.program import PreparedProgram
from anser.config.errors import Problem, ScenarioError
from anser.files import new_folder, staged_folder
from anser.missions.batches import Progress, no_progress
from anser.missions.consensus import DecentralisedFirstPlan
from anser.missions.events import EventSchedule
from anser.missions.first_plan import FirstPlan, NoPlanError
from anser.missions.plans import plan
from anser.missions.saved_flights import FLIGHT, SUMMARY, SavedFlight
from anser.numerics.arrays import as_array, cast_to_precision
from anser.scenario.build_aircraft import resolve_limits
from anser.scenario.files import as_scenario
from anser.scenario.schema import Scenario
from anser.simulation.flight import SEGMENT_STEPS, Flight, FlightState, fly
from anser.simulation.precision import Precision, cast_flight, cast_state


def needs_single_flight(scenario: Scenario) -> bool:
    """Whether a scenario's flight stops for a search on the host, or has plans of several sizes."""
    return bool(scenario.event) or scenario.fleet.planner == "decentralised"


def check_precision(scenario: Scenario, precision: Precision, source: str | None = None) -> None:
    """Refuse to fly a scenario in a precision that does not fit it (ScenarioError), of the file `source`.

    Over a round Earth places are integrated as distances from its centre, of which float32 tells no two apart that are
    nearer than half a metre. Fleets that plan while they fly do so from their state between two steps.
    """
    if precision == "float64":
        return
    arrived = None
    if scenario.earth.model != "flat":
        arrived = "a round Earth, whose distances float32 rounds to half a metre"
    elif needs_single_flight(scenario):
        arrived = "one with events, or without a centre"
    if arrived is not None:
        words = 'precision = "float64" for it'
        raise ScenarioError(source or scenario.name, [Problem("precision", f'"{precision}" of {arrived}', words)])


def precision_problems(scenarios: Sequence[Scenario], precision: Precision) -> dict[int, str]:
    """Places of scenarios that a precision does not fit, and why."""
    found: dict[int, str] = {}
    for k, scenario in enumerate(scenarios):
        try:
            check_precision(scenario, precision)
        except ScenarioError as error:
            found[k] = "; ".join(map(str, error.problems))
    return found


def limits_text(scenario: Scenario, flight: Flight) -> str:
    """JSON: a list with one object for each aircraft of the scenario.

    Parameters
    ----------
    scenario
        As flown.
    flight
        What was built of it; its further aircraft, which only fill it up, are left out.

    Returns
    -------
    str
        Of each aircraft the keys of `[limits]` with the values that hold for it (null: none), and `surfaces_deg`: the
        lower and the upper stop of each control surface by its name, deg; surfaces without finite stops are left out.
    """
    stops: dict[int, dict[str, list[float]]] = {}
    for kind in flight.groups:
        actuators = kind.vehicles.batched.airframe.actuators  # what has one axis is always stacked
        ends = [np.degrees(np.asarray(end)) for end in (actuators.lower, actuators.upper)]
        for row, place in enumerate(kind.members):
            named = zip(actuators.names, *(end[row] for end in ends), strict=True)
            stops[place] = {
                name: [round(float(a), 6), round(float(b), 6)] for name, a, b in named if np.isfinite(a + b)
            }
    each = [
        resolve_limits(scenario, one).model_dump() | {"surfaces_deg": stops[place]}
        for place, one in enumerate(scenario.aircraft)
    ]
    return json.dumps(each)


_FILES = (FLIGHT, SUMMARY, "report.html")

fly_segment = compiled(functools.partial(fly, one_kernel=True))
"""One segment of a flight by itself, compiled; see `anser.simulation.fly`."""


def without_replanning(flight: Flight) -> Flight:
    """The same flight with a planner that only keeps its plan up to date: a smaller program, for most segments."""
    return dataclasses.replace(flight, planner=dataclasses.replace(flight.planner, allow_replanning=False))


def prepare_flight(flight: Flight, state: FlightState) -> PreparedProgram:
    """Begin with the program of a flight's segments, for a state or the shapes of one."""
    return fly_segment.prepare(without_replanning(flight), state, as_array(0, np.int32))


def _prepare(precision: Precision, flight: Flight, state: FlightState) -> PreparedProgram:
    """As `prepare_flight`, in a precision.

    xarray and pandas, which take as long to import as a program to load, come meanwhile.
    """
    prepared = prepare_flight(cast_flight(flight, precision), cast_state(state, precision))
    importlib.import_module("anser.results")
    return prepared


@dataclass(frozen=True, repr=False)
class FlightResult(SavedFlight):
    """A flown scenario; printed, it is who arrived when.

    Attributes
    ----------
    dataset, summary
        As of `SavedFlight`.
    scenario
        What was flown.
    planned
        The first plan, with what of it the scenario's limits forbid.
    """

    scenario: Scenario
    planned: FirstPlan

    def save(self, folder: Path | str, *, force: bool = False) -> Path:
        """Write `flight.nc`, `summary.json` and `report.html` into a new folder.

        Parameters
        ----------
        folder
            To make and write into.
        force
            Whether the folder may exist: these three files are then replaced in it, all others are left alone.

        Raises
        ------
        FileExistsError
            If the folder exists: without `force` nothing is overwritten.
        """
        target = Path(folder)
        if target.exists() and not (target.is_dir() and force):
            or_force = ", or give force=True to replace the run in it" if target.is_dir() else ""
            raise FileExistsError(f"{target} exists and is not overwritten: choose another folder{or_force}")
        with staged_folder(target) if target.exists() else new_folder(target) as beside:
            self.write_into(beside)
        return target

    def write_into(self, folder: Path) -> None:
        """Write the three files into a folder that exists; refuses to overwrite any (FileExistsError)."""
        from anser.results.netcdf import write_netcdf
        from anser.results.summary import write_summary

        flight, summary, report = (folder / name for name in _FILES)
        write_netcdf(self.dataset, flight)
        write_summary(self.summary, summary)
        self.report(report)


def run(
    scenario: Scenario | str | os.PathLike[str],
    progress: Progress | None = None,
    planned: FirstPlan | None = None,
    precision: Precision = "float64",
) -> FlightResult:
    """Fly a scenario.

    Parameters
    ----------
    scenario
        Validated, from `load`, or the path of its file.
    progress
        Called now and then with what is being done and how much of the flight is behind; None before and after it.
    planned
        A finished plan of this scenario, from `anser.plan` or `anser.missions.read_plan`; None: one is made.
    precision
        In which it is flown; it is planned in float64 in any case.

    Raises
    ------
    ValueError
        The plan is one of another scenario.
    ScenarioError
        If the file cannot be read or is no valid scenario, or an aircraft cannot fly steadily at its start, or the
        precision does not fit the scenario; the message says what stops it.
    NoPlanError
        If the certified planner finds no plan; the message says why.
    """
    scenario, on_progress = as_scenario(scenario), progress or no_progress
    check_precision(scenario, precision)
    began = clock.perf_counter()
    if planned is None:
        planned = plan(scenario, lambda what: on_progress(what, None), functools.partial(_prepare, precision))
    elif planned.scenario != scenario:
        raise ValueError(f"planned: arrived a plan for {planned.scenario.name}; expected one for the scenario itself")
    from anser.results.dataset import to_dataset
    from anser.results.documents import version_attributes
    from anser.results.network_summary import summarize_network
    from anser.results.summary import summarize

    if planned.refusals:
        raise NoPlanError(planned.refusals)
    flight, state = cast_flight(planned.flight, precision), cast_state(planned.initial_state(), precision)
    simpler = without_replanning(flight)
    timing = scenario.timing
    steps = round(timing.duration_s / timing.step_s)
    on_progress("flying", 0.0)
    segments, at = [], 0
    happenings = EventSchedule(scenario, lambda what: on_progress(what, None))
    while at <= steps:
        flight, state = happenings.apply_due(flight, state, at)
        simpler = without_replanning(flight)
        flown = happenings.steps_until_next(at, min(SEGMENT_STEPS, steps + 1 - at))
        # a flight without events has none of the program that can fly part of a segment
        part = {"flown": as_array(flown, np.int32)} if scenario.event else {}
        number = as_array(at, np.int32)
        after, _, history = fly_segment(simpler, state, number, **part)
        if after.planner.replan_needed:  # what came of it does not count
            after, _, history = fly_segment(flight, state, number, **part)
        at += flown if scenario.event else SEGMENT_STEPS
        state = happenings.check_replanning(flight, after, at)
        rows = slice(flown if scenario.event else None), slice(len(scenario.aircraft))
        segments.append({key: np.asarray(values)[rows] for key, values in cast_to_precision(history, float).items()})
        on_progress("flying", min(at / (steps + 1), 1.0))
    history = {key: np.concatenate([part[key] for part in segments])[: steps + 1] for key in segments[0]}
    time_s = np.arange(steps + 1) * timing.step_s
    wall_s = clock.perf_counter() - began
    on_progress("summing up", None)
    happened = [one.as_dict() for one in happenings.outcomes]
    surfaces = planned.flight.surfaces[: len(scenario.aircraft)]
    summary = summarize(
        time_s, history, scenario, wall_s, planned.path_descriptions(), happened, happenings.goals, surfaces
    )
    attributes = _attributes(scenario) | {"limits": limits_text(scenario, planned.flight)} | version_attributes()
    if isinstance(planned, DecentralisedFirstPlan):
        summary["network"] = summarize_network(time_s, history, scenario, planned.agreed_after_s)
        attributes["network"] = json.dumps(summary["network"])
    stride = round(timing.record_period_s / timing.step_s)
    dataset = to_dataset(
        time_s[::stride],
        {key: values[::stride] for key, values in history.items()},
        [a.name for a in scenario.aircraft],
        attributes,
        surfaces,
    )
    return FlightResult(dataset, summary, scenario, planned)


def _attributes(scenario: Scenario) -> dict[str, Any]:
    from anser.results.separation import separation_attributes

    return {
        "title": scenario.name,
        "description": scenario.description,
        "scenario_hash": scenario.hash,
        "scenario": scenario.model_dump_json(),
        "seed": scenario.seed,
        "earth_model": scenario.earth.model,
        "reference_latitude_deg": scenario.earth.latitude_deg,
        "reference_longitude_deg": scenario.earth.longitude_deg,
        **separation_attributes(scenario),
    }
