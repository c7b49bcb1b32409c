"""Running one scenario: plan it, fly it, keep what came of it."""

import dataclasses
import functools
import importlib
import json
import os
import time as clock
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from anser.compiling import Prepared, compiled
from anser.execution.batches import Progress, silent
from anser.execution.flown_limits import limits_text
from anser.execution.happenings import Happenings
from anser.execution.negotiated import DecentralisedPlanned
from anser.execution.plan_interface import NoPlanError, Planned
from anser.execution.planned import plan
from anser.execution.precisions import refuse_precision
from anser.execution.saved_flight import FLIGHT, SUMMARY, SavedFlight
from anser.numerics import as_array, in_precision
from anser.output_files import new_folder, replaced_within
from anser.scenario import Scenario, as_scenario
from anser.simulation import SEGMENT_STEPS, Flight, FlightState, Precision, flight_in, fly, state_in

_FILES = (FLIGHT, SUMMARY, "report.html")

fly_segment = compiled(functools.partial(fly, one_kernel=True))
"""One segment of a flight by itself, compiled; see `anser.simulation.fly`."""


def without_replanning(flight: Flight) -> Flight:
    """The same flight with a planner that only keeps its plan up to date: a smaller program, for most segments."""
    return dataclasses.replace(flight, planner=dataclasses.replace(flight.planner, replans=False))


def prepare_flight(flight: Flight, state: FlightState) -> Prepared:
    """Begin with the program of a flight's segments, for a state or the shapes of one."""
    return fly_segment.prepare(without_replanning(flight), state, as_array(0, np.int32))


def _prepare(precision: Precision, flight: Flight, state: FlightState) -> Prepared:
    """As `prepare_flight`, in a precision.

    xarray and pandas, which take as long to import as a program to load, come meanwhile.
    """
    prepared = prepare_flight(flight_in(flight, precision), state_in(state, precision))
    importlib.import_module("anser.results")
    return prepared


@dataclass(frozen=True, repr=False)
class Flown(SavedFlight):
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
    planned: Planned

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
        with replaced_within(target) if target.exists() else new_folder(target) as beside:
            self.write_into(beside)
        return target

    def write_into(self, folder: Path) -> None:
        """Write the three files into a folder that exists; refuses to overwrite any (FileExistsError)."""
        from anser.results import write_netcdf, write_summary

        flight, summary, report = (folder / name for name in _FILES)
        write_netcdf(self.dataset, flight)
        write_summary(self.summary, summary)
        self.report(report)


def run(
    scenario: Scenario | str | os.PathLike[str],
    progress: Progress | None = None,
    planned: Planned | None = None,
    precision: Precision = "float64",
) -> Flown:
    """Fly a scenario.

    Parameters
    ----------
    scenario
        Validated, from `load`, or the path of its file.
    progress
        Called now and then with what is being done and how much of the flight is behind; None before and after it.
    planned
        A finished plan of this scenario, from `anser.plan` or `anser.execution.read_plan`; None: one is made.
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
    scenario, on_progress = as_scenario(scenario), progress or silent
    refuse_precision(scenario, precision)
    began = clock.perf_counter()
    if planned is None:
        planned = plan(scenario, lambda what: on_progress(what, None), functools.partial(_prepare, precision))
    elif planned.scenario != scenario:
        raise ValueError(f"planned: arrived a plan for {planned.scenario.name}; expected one for the scenario itself")
    from anser.results import summarize, summarize_network, to_dataset, version_attributes

    if planned.refusals:
        raise NoPlanError(planned.refusals)
    flight, state = flight_in(planned.flight, precision), state_in(planned.begun(), precision)
    simpler = without_replanning(flight)
    timing = scenario.timing
    steps = round(timing.duration_s / timing.step_s)
    on_progress("flying", 0.0)
    segments, at = [], 0
    happenings = Happenings(scenario, lambda what: on_progress(what, None))
    while at <= steps:
        flight, state = happenings.take_place(flight, state, at)
        simpler = without_replanning(flight)
        flown = happenings.steps_until_next(at, min(SEGMENT_STEPS, steps + 1 - at))
        # a flight without events has none of the program that can fly part of a segment
        part = {"flown": as_array(flown, np.int32)} if scenario.event else {}
        number = as_array(at, np.int32)
        after, _, history = fly_segment(simpler, state, number, **part)
        if after.planner.asked:  # what came of it does not count
            after, _, history = fly_segment(flight, state, number, **part)
        at += flown if scenario.event else SEGMENT_STEPS
        state = happenings.looked_after(flight, after, at)
        rows = slice(flown if scenario.event else None), slice(len(scenario.aircraft))
        segments.append({key: np.asarray(values)[rows] for key, values in in_precision(history, float).items()})
        on_progress("flying", min(at / (steps + 1), 1.0))
    history = {key: np.concatenate([part[key] for part in segments])[: steps + 1] for key in segments[0]}
    time_s = np.arange(steps + 1) * timing.step_s
    wall_s = clock.perf_counter() - began
    on_progress("summing up", None)
    happened = [one.as_dict() for one in happenings.outcomes]
    surfaces = planned.flight.surfaces[: len(scenario.aircraft)]
    summary = summarize(time_s, history, scenario, wall_s, planned.path_words(), happened, happenings.goals, surfaces)
    attributes = _attributes(scenario) | {"limits": limits_text(scenario, planned.flight)} | version_attributes()
    if isinstance(planned, DecentralisedPlanned):
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
    return Flown(dataset, summary, scenario, planned)


def _attributes(scenario: Scenario) -> dict[str, Any]:
    from anser.results.separated import separation_attributes

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
