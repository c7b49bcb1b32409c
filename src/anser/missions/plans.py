"""Plans of a scenario by the planner that it names, and plan files that are flown without planning again."""

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
from typing import Any, get_args, get_type_hints

import equinox as eqx
import jax
import numpy as np

from anser.compiling.options import compiled, compiled_quickly, enable_compilation_cache
from anser.files import write_file
from anser.missions.consensus import Agreement, DecentralisedFirstPlan, plan_decentralised
from anser.missions.first_plan import (
    SPEED_TOLERANCE,
    CertifiedFirstPlan,
    FirstPlan,
    PlanFileError,
    PrepareNext,
    initialize_compiled,
    plan_certified,
    trim_at_start,
    with_randomness,
)
from anser.missions.saved_flights import PLAN
from anser.numerics.arrays import as_array, first_rows
from anser.numerics.randomness import AbstractRandomness
from anser.planning.certified.planner import CertifiedPlanner, CertifiedPlanState
from anser.planning.certified.search import SearchOutcome
from anser.planning.decentralised.planner import DecentralisedPlanner
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
from anser.simulation.flight import FlightState, statuses
from anser.simulation.start import start_flight

_start_flight = compiled_quickly(start_flight)
_separation = compiled(separation_min)
_SAME_WIND_M_S = 0.5


@compiled
def _limits_of(plan: FleetPlan, limits: Any, gravity: Any) -> LimitReport:
    return jax.vmap(check_limits, in_axes=(0, None, None))(plan.trajectories, limits, gravity)


@dataclass(frozen=True, repr=False)
class PublishedFirstPlan(FirstPlan):
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
        return first_rows(self._all, len(self.scenario.aircraft))

    @property
    def _all(self) -> FleetPlan:
        """The plan with those that fill the fleet up."""
        return self.state.planner.plan

    @functools.cached_property
    def limits(self) -> LimitReport:
        """How the paths keep the scenario's limits; leading axis aircraft."""
        found = _limits_of(self._all, build_path_limits(self.scenario), self.flight.environment.gravity)
        return first_rows(found, len(self.scenario.aircraft))

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
            if stopped[k] or is_breakaway(status):
                found.append(f'aircraft "{aircraft.name}": {STATUS_MESSAGES[status]}')
            elif planned[k]:
                found.append(f'aircraft "{aircraft.name}": {PLAN_MESSAGES[int(planned[k])]}')
            elif limits[k]:
                found.append(f'aircraft "{aircraft.name}": {LIMIT_MESSAGES[int(limits[k])]}')
        return tuple(found)

    def path_descriptions(self) -> tuple[str, ...]:
        """How the path of each aircraft goes: "nominal", "bent left" or "bent right"."""
        return tuple(describe_bend(float(bend)) for bend in np.asarray(self.plan.lateral_bends))

    def initial_state(self) -> FlightState:
        """The fleet at its start, with the plan."""
        return self.state


def _change_of_wind_m_s(scenario: Scenario, one: Aircraft, arrival_s: float) -> float:
    """How much the wind at an aircraft's rendezvous differs from that at its start, m/s."""
    up_m = scenario.goal_of(one).position_m(arrival_s)[2] + one.rendezvous.stand_off_up_m
    return math.dist(scenario.wind.velocity_m_s(up_m), scenario.wind.velocity_m_s(one.start.altitude_m))


def plan(
    scenario: Scenario | str | os.PathLike[str],
    on_progress: Callable[[str], None] = lambda what: None,
    prepare_next: PrepareNext = lambda *of: None,
    randomness: AbstractRandomness | None = None,
) -> FirstPlan:
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
        `anser.missions.NoPlanError`.

    Raises
    ------
    ScenarioError
        If the file cannot be read or is no valid scenario, or an aircraft cannot fly steadily at its start; the message
        says what stops it.
    """
    enable_compilation_cache()
    scenario = as_scenario(scenario)
    if scenario.fleet.planner == "certified":
        return plan_certified(scenario, on_progress, prepare_next, randomness)
    if scenario.fleet.planner == "decentralised":
        return plan_decentralised(scenario, on_progress, prepare_next)
    on_progress("trimming and planning")
    flight = with_randomness(randomness, build_flight(scenario, pad_fleet=True))
    start = _start_flight.prepare(flight).start()
    following = prepare_next(flight, start.shapes[0])
    if following is not None:
        following.start()
    state, fleet = _start_flight(flight)
    made = PublishedFirstPlan(scenario, flight, fleet, (), state)
    check_trimmable(scenario, flight, fleet.is_trimmed)
    return made


_FORMAT = 2
_STATES = {"published": PublishedPlanState, "certified": CertifiedPlanState, "decentralised": Agreement}


def write_plan(planned: FirstPlan, path: Path) -> None:
    """Write a finished plan into a new file, a NumPy archive whose comment is its checksum.

    Raises
    ------
    FileExistsError
        The file exists: nothing is overwritten.
    NoPlanError
        There is no plan.
    """
    leaves = jax.tree_util.tree_flatten_with_path(planned.saved_state())[0]
    arrays = {jax.tree_util.keystr(place, simple=True, separator="."): np.asarray(leaf) for place, leaf in leaves}
    about = {
        "format_version": _FORMAT,
        "planner": planned.scenario.fleet.planner,
        "scenario_hash": planned.scenario.hash,
        **version_attributes(),
    }
    archive = io.BytesIO()
    np.savez(archive, allow_pickle=False, about=np.array(json.dumps(about)), **arrays)
    write_file(path, _with_checksum(archive))


def read_plan(path: str | os.PathLike[str], scenario: Scenario) -> FirstPlan:
    """Read a finished plan of a scenario; its aircraft are trimmed again, its search is not repeated.

    Parameters
    ----------
    path
        Of the file, or of the folder that `anser plan --out` wrote, with its `plan.npz`.
    scenario
        Whose plan it is.

    Raises
    ------
    PlanFileError
        The file cannot be read, is damaged, or holds a plan for another scenario.
    ScenarioError
        An aircraft cannot fly steadily at its start.
    """
    path = Path(path)
    if path.is_dir():
        path = path / PLAN
    try:
        _verify(path)
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        about = json.loads(str(arrays.pop("about")))
        _refuse_foreign_plan(about, scenario, path)
        state = _rebuild_state(_STATES[about["planner"]], "", arrays)
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
        words = "a file without a checksum, cut or of an older version"
        raise PlanFileError(f"{path}: arrived {words}; expected a plan of format {_FORMAT}, as anser plan --out writes")


def _refuse_foreign_plan(about: dict[str, Any], scenario: Scenario, path: Path) -> None:
    """Refuse a plan of another format, version of anser or scenario."""
    if about["format_version"] != _FORMAT:
        raise PlanFileError(f"{path} has format_version {about['format_version']}; expected {_FORMAT}")
    made_by, version = about["version_anser"], version_attributes()["version_anser"]
    if made_by != version:
        raise PlanFileError(f"{path}: arrived a plan of anser {made_by}; expected one of {version}: plan again")
    if (about["planner"], about["scenario_hash"]) != (scenario.fleet.planner, scenario.hash):
        raise PlanFileError(
            f"{path} holds the plan of another scenario ({about['planner']}, hash {about['scenario_hash']}); "
            f"expected that of this one ({scenario.fleet.planner}, {scenario.hash}): other numbers, another plan"
        )


def _first_plan_from_state(scenario: Scenario, state: Any, path: Path) -> FirstPlan:
    enable_compilation_cache()
    flight = build_flight(scenario, pad_fleet=True)
    if flight.count != jax.tree.leaves(state)[0].shape[0]:
        raise PlanFileError(f"{path} holds a plan of another size than this version of anser makes")
    fleet = trim_at_start(flight)
    check_trimmable(scenario, flight, fleet.is_trimmed)
    if scenario.fleet.planner == "published":
        return PublishedFirstPlan(scenario, flight, fleet, (), initialize_compiled(flight, fleet, state))
    first = state.plan_state if isinstance(state, Agreement) else state
    planner = flight.planner.aircraft_planner if isinstance(flight.planner, DecentralisedPlanner) else flight.planner
    assert isinstance(planner, CertifiedPlanner)
    tasks = planner.aircraft_tasks(fleet.reports, first.limits)
    made = scenario, flight, fleet, (), SearchOutcome(first.plan, 0), tasks, planner.airspace, first.holds
    if isinstance(state, Agreement):
        return DecentralisedFirstPlan(*made, float(state.negotiation_s))
    return CertifiedFirstPlan(*made)


def _with_checksum(archive: io.BytesIO) -> bytes:
    """Bytes of an archive with their checksum as its comment, which stands at the end."""
    with zipfile.ZipFile(archive, "a") as file:
        file.comment = bytes(TRAILER_BYTES)
    content = archive.getvalue()[:-TRAILER_BYTES]
    return content + checksum_trailer(hashlib.sha256(content).hexdigest())


def _rebuild_state(kind: type, place: str, arrays: dict[str, np.ndarray]) -> Any:
    """A module of arrays from those under its place, by the types of its fields."""
    fields = {}
    for name, hint in get_type_hints(kind).items():
        own = f"{place}{name}"
        modules = [one for one in (hint, *get_args(hint)) if isinstance(one, type) and issubclass(one, eqx.Module)]
        if not modules:
            left_out = own not in arrays and type(None) in get_args(hint)
            fields[name] = None if left_out else as_array(arrays[own], None)
        elif any(key.startswith(f"{own}.") for key in arrays):
            fields[name] = _rebuild_state(modules[0], f"{own}.", arrays)
        else:
            fields[name] = None
    return kind(**fields)
