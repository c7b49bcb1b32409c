"""Make the first plan of a scenario with the planner that the scenario names; write and read plan files."""

import functools
import hashlib
import io
import json
import math
import os
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args, get_type_hints

import equinox as eqx
import jax
import numpy as np

from anser.compiling.options import compiled, compiled_quickly, enable_compilation_cache
from anser.files import write_file
from anser.missions.consensus import DecentralisedFirstPlan
from anser.missions.first_plan import (
    SPEED_TOLERANCE,
    CertifiedFirstPlan,
    FirstPlan,
    OnProgress,
    PlanFileError,
    PrepareNext,
    Randomness,
    initialize_compiled,
    trim_at_start,
    with_randomness,
)
from anser.missions.saved_flights import PLAN
from anser.numerics.arrays import as_array, first_rows
from anser.numerics.randomness import AbstractRandomness
from anser.planning.limits import LIMIT_MESSAGES, describe_bend
from anser.planning.published.coordination import PLAN_MESSAGES, FleetPlan
from anser.planning.published.planner import LimitReport, PublishedPlanState, check_limits, separation_min
from anser.results.checksums import TRAILER_BYTES, DamagedFileError, checksum_trailer, verify_checksum
from anser.results.documents import version_attributes
from anser.scenario.build import build_flight
from anser.scenario.build_aircraft import build_path_limits
from anser.scenario.files import as_scenario
from anser.scenario.flight_checks import check_trimmable
from anser.scenario.schema import Scenario
from anser.scenario.schema_aircraft import Aircraft
from anser.simulation.closed_loop import STATUS_MESSAGES, is_breakaway
from anser.simulation.flight import Flight, FlightState, statuses
from anser.simulation.start import TrimmedFleet, start_flight

if TYPE_CHECKING:
    from anser.missions.plan_output import RecordedPlan

_start_flight = compiled_quickly(start_flight)
_separation = compiled(separation_min)
_WIND_CHANGE_M_S = 0.5


@compiled
def _check_path_limits(plan: FleetPlan, limits: Any, gravity: Any) -> LimitReport:
    return jax.vmap(check_limits, in_axes=(0, None, None))(plan.trajectories, limits, gravity)


@dataclass(frozen=True, repr=False)
class PublishedFirstPlan(FirstPlan):
    """The first plan of a scenario by the published planner, which never refuses: `problems` lists the obstacles."""

    state_type = PublishedPlanState
    state: FlightState  # state of the fleet at the start, with the plan

    @classmethod
    def make(
        cls, scenario: Scenario, on_progress: OnProgress, prepare_next: PrepareNext, randomness: Randomness
    ) -> "PublishedFirstPlan":
        """Trim every aircraft at its start and coordinate the fleet, in one compiled program."""
        on_progress("trimming and planning")
        flight = with_randomness(randomness, build_flight(scenario, pad_fleet=True))
        start = _start_flight.prepare(flight).start()
        next_program = prepare_next(flight, start.shapes[0])
        if next_program is not None:
            next_program.start()
        state, fleet = _start_flight(flight)
        check_trimmable(scenario, flight, fleet.is_trimmed)
        return cls(scenario, flight, fleet, (), state)

    @classmethod
    def restore(cls, scenario: Scenario, flight: Flight, fleet: TrimmedFleet, state: Any) -> "PublishedFirstPlan":
        """Rebuild the first plan from a trimmed fleet and the content of a plan file (`state`)."""
        return cls(scenario, flight, fleet, (), initialize_compiled(flight, fleet, state))

    @functools.cached_property
    def plan(self) -> FleetPlan:
        """Plan of the scenario's aircraft."""
        return first_rows(self._all, len(self.scenario.aircraft))

    @property
    def _all(self) -> FleetPlan:
        """Plan of all aircraft of `flight`, the padding included."""
        return self.state.planner.plan

    @functools.cached_property
    def limits(self) -> LimitReport:
        """Extremes of each path and comparison with the scenario's limits; leading axis aircraft."""
        report = _check_path_limits(self._all, build_path_limits(self.scenario), self.flight.environment.gravity)
        return first_rows(report, len(self.scenario.aircraft))

    @functools.cached_property
    def separation_min_m(self) -> float | None:
        """Least planned distance between two aircraft before the arrival, m; None for a single aircraft."""
        if len(self.scenario.aircraft) == 1:
            return None
        return float(np.min(np.asarray(_separation(self._all.trajectories, active=self._all.active))))

    def notes(self) -> tuple[str, ...]:
        """Notes on a mean airspeed other than requested, and on the change of the wind on the way."""
        notes, preferred_m_s, speed_m_s = [], self.scenario.fleet.speed_m_s, float(self.plan.speed)
        if speed_m_s > preferred_m_s * (1.0 + SPEED_TOLERANCE):
            farthest = self.scenario.aircraft[int(self.plan.farthest)].name
            notes.append(
                f"the plan's mean airspeed is {speed_m_s:.1f} m/s instead of fleet.speed_m_s = {preferred_m_s:g} m/s: "
                f'aircraft "{farthest}" has the longest way and cannot slow down or come down more slowly'
            )
        changes = {
            aircraft.name: _wind_change_m_s(self.scenario, aircraft, self.arrival_s)
            for aircraft in self.scenario.aircraft
        }
        name = max(changes, key=lambda aircraft: changes[aircraft])
        if changes[name] > _WIND_CHANGE_M_S:
            notes.append(
                "the plan reckons with the wind where each aircraft starts; that at the rendezvous differs, by "
                f'{changes[name]:.1f} m/s for aircraft "{name}": lengths and arrival time change as the plan is renewed'
            )
        return tuple(notes)

    def problems(self) -> tuple[str, ...]:
        """Obstacles to flying the plan, one sentence each; empty for a flyable plan."""
        problems, duration_s = [], self.scenario.timing.duration_s
        if self.arrival_s >= duration_s:
            problems.append(f"the fleet arrives at {self.arrival_s:.1f} s, the flight ends at {duration_s:g} s")
        status_codes, is_stopped = (np.asarray(values) for values in statuses(self.flight, self.state))
        plan_statuses, limit_statuses = np.asarray(self.plan.status), np.asarray(self.limits.status)
        for k, aircraft in enumerate(self.scenario.aircraft):
            status = int(status_codes[k])
            if is_stopped[k] or is_breakaway(status):
                problems.append(f'aircraft "{aircraft.name}": {STATUS_MESSAGES[status]}')
            elif plan_statuses[k]:
                problems.append(f'aircraft "{aircraft.name}": {PLAN_MESSAGES[int(plan_statuses[k])]}')
            elif limit_statuses[k]:
                problems.append(f'aircraft "{aircraft.name}": {LIMIT_MESSAGES[int(limit_statuses[k])]}')
        return tuple(problems)

    def path_descriptions(self) -> tuple[str, ...]:
        """Shape of the path of each aircraft: "nominal", "bent left" or "bent right"."""
        return tuple(describe_bend(float(bend)) for bend in np.asarray(self.plan.lateral_bends))

    def initial_state(self) -> FlightState:
        """State of the fleet at the start of the flight, with the plan."""
        return self.state

    def saved_state(self) -> Any:
        """Return the content of a plan file: the planner's state."""
        return self.state.planner

    def record(self) -> "RecordedPlan":
        """Sample and summarize the plan."""
        from anser.missions.plan_output import record_published

        return record_published(self)


def _wind_change_m_s(scenario: Scenario, aircraft: Aircraft, arrival_s: float) -> float:
    """Magnitude of the difference between the wind at an aircraft's rendezvous and at its start, m/s."""
    up_m = scenario.goal_of(aircraft).position_m(arrival_s)[2] + aircraft.rendezvous.stand_off_up_m
    return math.dist(scenario.wind.velocity_m_s(up_m), scenario.wind.velocity_m_s(aircraft.start.altitude_m))


def plan(
    scenario: Scenario | str | os.PathLike[str],
    on_progress: Callable[[str], None] = lambda message: None,
    prepare_next: PrepareNext = lambda *_: None,
    randomness: AbstractRandomness | None = None,
) -> FirstPlan:
    """Trim every aircraft at its start and make the first plan of the scenario's planner, at time 0.

    The result is printed by `anser plan` and flown by `anser.run`.

    Parameters
    ----------
    scenario
        From `load`, or the path of a scenario file; `fleet.planner` selects the planner.
    on_progress
        Called with a description of the current work.
    prepare_next
        Prepares a program that is needed after planning, from a flight and the shapes of its first state; the program
        is compiled in parallel.
    randomness
        Source of the random numbers; None: derived from the scenario's seed. Ignored for a fleet without a central
        planner.

    Returns
    -------
    FirstPlan
        `plan` is the plan (raises `anser.missions.NoPlanError` if none was found), `refusals` the reasons for a missing
        plan, `problems()` the reasons and the obstacles to flying the plan, and `notes()` the differences from the
        scenario's request. Reasons and obstacles are empty for a flyable plan. The published planner never refuses.

    Raises
    ------
    ScenarioError
        If the file cannot be read or is not a valid scenario, or an aircraft cannot be trimmed at its start.
    """
    enable_compilation_cache()
    scenario = as_scenario(scenario)
    return _FIRST_PLANS[scenario.fleet.planner].make(scenario, on_progress, prepare_next, randomness)


_FIRST_PLANS: dict[str, type[FirstPlan]] = {
    "published": PublishedFirstPlan,
    "certified": CertifiedFirstPlan,
    "decentralised": DecentralisedFirstPlan,
}
_FORMAT = 2


def write_plan(planned: FirstPlan, path: Path) -> None:
    """Write a finished plan to a new file: a NumPy archive with its checksum as the archive comment.

    Raises
    ------
    FileExistsError
        If the file exists.
    NoPlanError
        If no plan was found.
    """
    leaves = jax.tree_util.tree_flatten_with_path(planned.saved_state())[0]
    arrays = {jax.tree_util.keystr(key_path, simple=True, separator="."): np.asarray(leaf) for key_path, leaf in leaves}
    metadata = {
        "format_version": _FORMAT,
        "planner": planned.scenario.fleet.planner,
        "scenario_hash": planned.scenario.hash,
        **version_attributes(),
    }
    archive = io.BytesIO()
    np.savez(archive, allow_pickle=False, about=np.array(json.dumps(metadata)), **arrays)
    write_file(path, _with_checksum(archive))


def read_plan(path: str | os.PathLike[str], scenario: Scenario) -> FirstPlan:
    """Read a finished plan of a scenario: the aircraft are trimmed again, the search is not repeated.

    Parameters
    ----------
    path
        Plan file, or the folder from `anser plan --out` with `plan.npz`.
    scenario
        Scenario of the plan.

    Raises
    ------
    PlanFileError
        If the file cannot be read, is damaged, or contains the plan of another scenario.
    ScenarioError
        If an aircraft cannot be trimmed at its start.
    """
    path = Path(path)
    if path.is_dir():
        path = path / PLAN
    try:
        _verify(path)
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        metadata = json.loads(str(arrays.pop("about")))
        _refuse_foreign_plan(metadata, scenario, path)
        state = _rebuild_state(_FIRST_PLANS[scenario.fleet.planner].state_type, "", arrays)
    except (OSError, KeyError, TypeError, ValueError, EOFError, zipfile.BadZipFile) as error:
        if isinstance(error, PlanFileError):
            raise
        raise PlanFileError(f"{path} cannot be read as a plan ({error})") from None
    return _first_plan_from_state(scenario, state, path)


def _verify(path: Path) -> None:
    try:
        verified = verify_checksum(path)
    except DamagedFileError as error:
        raise PlanFileError(str(error)) from None
    if not verified:
        received = "a file without a checksum, cut or of an older version"
        raise PlanFileError(
            f"{path}: arrived {received}; expected a plan of format {_FORMAT}, as anser plan --out writes"
        )


def _refuse_foreign_plan(metadata: dict[str, Any], scenario: Scenario, path: Path) -> None:
    """Raise PlanFileError for a plan of another file format, of another version of anser, or of another scenario."""
    if metadata["format_version"] != _FORMAT:
        raise PlanFileError(f"{path} has format_version {metadata['format_version']}; expected {_FORMAT}")
    file_version, version = metadata["version_anser"], version_attributes()["version_anser"]
    if file_version != version:
        raise PlanFileError(f"{path}: arrived a plan of anser {file_version}; expected one of {version}: plan again")
    if (metadata["planner"], metadata["scenario_hash"]) != (scenario.fleet.planner, scenario.hash):
        raise PlanFileError(
            f"{path} holds the plan of another scenario ({metadata['planner']}, hash {metadata['scenario_hash']}); "
            f"expected that of this one ({scenario.fleet.planner}, {scenario.hash}): other numbers, another plan"
        )


def _first_plan_from_state(scenario: Scenario, state: Any, path: Path) -> FirstPlan:
    enable_compilation_cache()
    flight = build_flight(scenario, pad_fleet=True)
    if flight.count != jax.tree.leaves(state)[0].shape[0]:
        raise PlanFileError(f"{path} holds a plan of another size than this version of anser makes")
    fleet = trim_at_start(flight)
    check_trimmable(scenario, flight, fleet.is_trimmed)
    return _FIRST_PLANS[scenario.fleet.planner].restore(scenario, flight, fleet, state)


def _with_checksum(archive: io.BytesIO) -> bytes:
    """Return the bytes of a plan file: the archive with its checksum as archive comment, at the end of the file."""
    with zipfile.ZipFile(archive, "a") as file:
        file.comment = bytes(TRAILER_BYTES)
    content = archive.getvalue()[:-TRAILER_BYTES]
    return content + checksum_trailer(hashlib.sha256(content).hexdigest())


def _rebuild_state(kind: type, prefix: str, arrays: dict[str, np.ndarray]) -> Any:
    """Rebuild a planner's state from the arrays of a plan file whose keys begin with `prefix`.

    The fields and their types are those of the class `kind`.
    """
    fields = {}
    for name, hint in get_type_hints(kind).items():
        field_key = f"{prefix}{name}"
        module_types = [
            field_type
            for field_type in (hint, *get_args(hint))
            if isinstance(field_type, type) and issubclass(field_type, eqx.Module)
        ]
        if not module_types:
            is_absent = field_key not in arrays and type(None) in get_args(hint)
            fields[name] = None if is_absent else as_array(arrays[field_key], None)
        elif any(key.startswith(f"{field_key}.") for key in arrays):
            fields[name] = _rebuild_state(module_types[0], f"{field_key}.", arrays)
        else:
            fields[name] = None
    return kind(**fields)
