"""Running one scenario: plan it, fly it, keep what came of it."""

import functools
import tempfile
import time as clock
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from anser.campaign.certified import CertifiedPlanned, plan_certified
from anser.campaign.untrimmable import refuse_untrimmable
from anser.compilation_cache import enable_compilation_cache
from anser.numerics import compiled_quickly
from anser.planning import LIMIT_MESSAGES, PLAN_MESSAGES, FleetPlan, LimitReport, check_limits, separation_min
from anser.report import write_report
from anser.results import (
    FlightFacts,
    Requirement,
    summarize,
    summary_text,
    to_dataset,
    versions,
    write_netcdf,
    write_summary,
)
from anser.scenario import Scenario, build_flight, build_path_limits
from anser.scenario.schema_checks import AIRBORNE_STAND_OFF_MIN_M, SURFACE_STAND_OFF_MIN_M
from anser.simulation import (
    SEGMENT_STEPS,
    STATUS_MESSAGES,
    Flight,
    FlightState,
    TrimPoint,
    begin,
    fly_segment,
    start_flight,
)

CLEARANCE_MIN_M = {"surface": SURFACE_STAND_OFF_MIN_M, "airborne": AIRBORNE_STAND_OFF_MIN_M}
"""Least distance from a goal of each kind: the product's scope, whatever a scenario says."""

_FILES = ("flight.nc", "summary.json", "report.html")


class NoPlanError(Exception):
    """The certified planner found no plan; `reasons` says why, one sentence each."""

    def __init__(self, reasons: tuple[str, ...]) -> None:
        super().__init__("; ".join(reasons))
        self.reasons = reasons


Progress = Callable[[str, float], None]
"""Called with what is being done and how much of the flight is behind, 0 to 1."""

_start = compiled_quickly(start_flight)
_segment = eqx.filter_jit(fly_segment)
_separation = eqx.filter_jit(separation_min)


@eqx.filter_jit
def _limits_of(plan: FleetPlan, limits: Any, gravity: Any) -> LimitReport:
    return jax.vmap(check_limits, in_axes=(0, None, None))(plan.trajectories, limits, gravity)


@dataclass(frozen=True)
class Planned:
    """The first plan of a scenario.

    Attributes
    ----------
    scenario
        What was planned.
    state
        The fleet at its start, with the plan.
    trims
        Steady flight of each aircraft at its start; leading axis aircraft.
    flight
        Its arrays.
    """

    scenario: Scenario
    flight: Flight
    state: FlightState
    trims: TrimPoint

    @property
    def plan(self) -> FleetPlan:
        """The plan itself."""
        assert isinstance(self.state.plan, FleetPlan)
        return self.state.plan

    @functools.cached_property
    def limits(self) -> LimitReport:
        """How the paths keep the scenario's limits; leading axis aircraft."""
        return _limits_of(self.plan, build_path_limits(self.scenario), self.flight.environment.gravity)

    @functools.cached_property
    def separation_min_m(self) -> float | None:
        """Least planned distance between two aircraft up to the arrival, m; None for one aircraft."""
        if len(self.scenario.aircraft) == 1:
            return None
        return float(np.min(np.asarray(_separation(self.plan.trajectories))))

    def problems(self) -> tuple[str, ...]:
        """Why the plan cannot be flown as it stands, one sentence each; empty where it can."""
        found = []
        for k, aircraft in enumerate(self.scenario.aircraft):
            status = int(self.state.status[k])
            if bool(self.state.stopped[k]):
                found.append(f'aircraft "{aircraft.name}": {STATUS_MESSAGES[status]}')
            elif int(self.plan.status[k]):
                found.append(f'aircraft "{aircraft.name}": {PLAN_MESSAGES[int(self.plan.status[k])]}')
            elif int(self.limits.status[k]):
                found.append(f'aircraft "{aircraft.name}": {LIMIT_MESSAGES[int(self.limits.status[k])]}')
        return tuple(found)


@dataclass(frozen=True, repr=False)
class Flown:
    """A flown scenario; printed, it is who arrived when.

    Attributes
    ----------
    scenario
        What was flown.
    dataset
        Recorded at the scenario's record period; dimensions time and aircraft, every variable with unit, frame, name.
    summary
        The contract of `summary.json`.
    planned
        The first plan, with what of it the scenario's limits forbid.
    """

    scenario: Scenario
    dataset: xr.Dataset
    summary: dict[str, Any]
    planned: "Planned | CertifiedPlanned"

    @property
    def met(self) -> bool:
        """Whether every aircraft arrived and every requirement is met."""
        arrived = all(row["status"] == "arrived" for row in self.summary["aircraft"])
        return arrived and all(row["met"] for row in self.summary["requirements"])

    def __repr__(self) -> str:
        return summary_text(self.summary)

    def report(self, path: Path | str) -> Path:
        """Write the interactive HTML report; refuses to overwrite (FileExistsError)."""
        write_report(self.dataset, self.summary, Path(path))
        return Path(path)

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
        if target.is_dir() and force:
            self._replace_in(target)
            return target
        if target.exists():
            or_force = ", or give force=True to replace the run in it" if target.is_dir() else ""
            raise FileExistsError(f"{target} exists and is not overwritten: choose another folder{or_force}")
        target.mkdir(parents=True)
        self.write_into(target)
        return target

    def _replace_in(self, folder: Path) -> None:
        """Write the three files beside those that stand there, and only when all are complete in their place."""
        with tempfile.TemporaryDirectory(dir=folder, prefix=".anser-") as beside:
            self.write_into(Path(beside))
            for name in _FILES:
                (Path(beside) / name).replace(folder / name)

    def write_into(self, folder: Path) -> None:
        """Write the three files into a folder that exists; refuses to overwrite any (FileExistsError)."""
        flight, summary, report = (folder / name for name in _FILES)
        write_netcdf(self.dataset, flight)
        write_summary(self.summary, summary)
        self.report(report)


def plan(scenario: Scenario) -> Planned:
    """Trim every aircraft at its start and make the fleet's first plan, as seen by the sensors at time 0.

    Raises
    ------
    ScenarioError
        If an aircraft cannot fly steadily at its start; the message says what stops it.
    """
    enable_compilation_cache()
    return _plan(scenario, build_flight(scenario))


def _plan(scenario: Scenario, flight: Flight) -> Planned:
    state, trims = _start(flight)
    refuse_untrimmable(scenario, flight, trims)
    return Planned(scenario, flight, state, trims)


def run(scenario: Scenario, progress: Progress | None = None) -> Flown:
    """Fly a scenario.

    Parameters
    ----------
    scenario
        Validated, from `load`.
    progress
        Called now and then with what is being done and how much of the flight is behind.

    Raises
    ------
    ScenarioError
        If an aircraft cannot fly steadily at its start; the message says what stops it.
    NoPlanError
        If the certified planner finds no plan; the message says why.
    """
    enable_compilation_cache()
    told = progress if progress is not None else lambda what, done: None
    began = clock.perf_counter()
    told("planning (the first time, this compiles)", 0.0)
    if scenario.fleet.planner == "certified":
        planned = plan_certified(scenario, lambda what: told(what, 0.0))
        if planned.refusals:
            raise NoPlanError(planned.refusals)
        flight = planned.flight
        state = begin(flight, planned.ready, planned.plan, jnp.zeros(len(scenario.aircraft)), planned.holds)
    else:
        flight = build_flight(scenario)
        planned = _plan(scenario, flight)
        state = planned.state
    timing = scenario.timing
    steps = round(timing.duration_s / timing.step_s)
    told("flying (the first time, this compiles)", 0.0)
    segments = []
    count = -(-(steps + 1) // SEGMENT_STEPS)
    for k in range(count):
        state, history = _segment(flight, state)
        segments.append(jax.tree.map(np.asarray, history))
        told("flying", (k + 1) / count)
    history = {key: np.concatenate([part[key] for part in segments])[: steps + 1] for key in segments[0]}
    time_s = np.arange(steps + 1) * timing.step_s
    wall_s = clock.perf_counter() - began
    told("summing up", 1.0)
    summary = summarize(time_s, history, _facts(scenario, history), wall_s)
    stride = round(timing.record_period_s / timing.step_s)
    dataset = to_dataset(
        time_s[::stride],
        {key: values[::stride] for key, values in history.items()},
        [a.name for a in scenario.aircraft],
        _attributes(scenario),
    )
    return Flown(scenario, dataset, summary, planned)


def _facts(scenario: Scenario, history: dict[str, np.ndarray]) -> FlightFacts:
    goals = [scenario.goal_of(a) for a in scenario.aircraft]
    wanted, limits = scenario.requirements, scenario.limits
    requirements = [
        Requirement("miss_max_m", wanted.miss_max_m),
        *([Requirement("arrival_spread_max_s", wanted.arrival_spread_max_s)] if scenario.arrival.is_common else []),
        Requirement("speed_min_m_s", limits.speed_min_m_s),
        Requirement("speed_max_m_s", limits.speed_max_m_s),
    ]
    if wanted.position_error_max_m is not None:
        requirements.append(Requirement("position_error_max_m", wanted.position_error_max_m))
    if wanted.separation_min_m is not None:
        requirements.append(Requirement("separation_min_m", wanted.separation_min_m))
    apart = scenario.separation
    if apart.horizontal_m > 0.0:
        requirements.append(Requirement("separation_ratio_min", 1.0))
    return FlightFacts(
        scenario_name=scenario.name,
        scenario_hash=scenario.hash,
        seed=scenario.seed,
        aircraft_names=tuple(a.name for a in scenario.aircraft),
        goal_names=tuple(a.goal for a in scenario.aircraft),
        goal_kinds=tuple(goal.kind for goal in goals),
        planned_arrivals_s=tuple(float(t) for t in history["arrival_time"][-1]),
        minimum_clearances_m=tuple(CLEARANCE_MIN_M[goal.kind] for goal in goals),
        requirements=tuple(requirements),
        status_messages=dict(enumerate(STATUS_MESSAGES)),
        separation_m=(apart.horizontal_m, apart.vertical_m) if apart.horizontal_m > 0.0 else None,
    )


def _attributes(scenario: Scenario) -> dict[str, Any]:
    return {
        "title": scenario.name,
        "description": scenario.description,
        "scenario_hash": scenario.hash,
        "scenario": scenario.model_dump_json(),
        "seed": scenario.seed,
        "earth_model": scenario.earth.model,
        "reference_latitude_deg": scenario.earth.latitude_deg,
        "reference_longitude_deg": scenario.earth.longitude_deg,
        **{f"version_{name}": version for name, version in versions().items()},
    }
