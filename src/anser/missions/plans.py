"""Make the first plan of a scenario with the planner that the scenario names; write and read plan files."""

import dataclasses
import hashlib
import io
import json
import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args, get_type_hints

import equinox as eqx
import jax
import numpy as np

from anser.compiling.options import compiled_quickly, enable_compilation_cache
from anser.files import write_file
from anser.missions.consensus import DecentralisedFirstPlan
from anser.missions.first_plan import (
    CertifiedFirstPlan,
    FirstPlan,
    PlanFileError,
    PrepareNext,
    PublishedFirstPlan,
    prepare_nothing,
)
from anser.missions.saved_flights import PLAN
from anser.missions.user_plans import UserFirstPlan
from anser.numerics.arrays import as_array
from anser.numerics.randomness import AbstractRandomness
from anser.parts.planners import AbstractPlanner
from anser.planning.certified.planner import CertifiedPlanner
from anser.planning.decentralised.planner import DecentralisedPlanner
from anser.planning.published.planner import PublishedPlanner
from anser.results.checksums import TRAILER_BYTES, DamagedFileError, checksum_trailer, verify_checksum
from anser.results.documents import version_attributes
from anser.scenario.build import build_flight
from anser.scenario.files import as_scenario
from anser.scenario.flight_checks import check_trimmable
from anser.scenario.schema import Scenario
from anser.scenario.user_parts import UserParts, attach_parts, differs_in_values, replaced_parts
from anser.simulation.start import trimmed_fleet

_trim_at_start = compiled_quickly(trimmed_fleet)


def plan(
    scenario: Scenario | str | os.PathLike[str],
    on_progress: Callable[[str], None] = lambda message: None,
    prepare_next: PrepareNext = prepare_nothing,
    randomness: AbstractRandomness | None = None,
    **user_parts: Any,
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
        Function from the flight and the shapes of its first state to a program that is needed after planning; the
        program is compiled in parallel. By default none.
    randomness
        Source of the random numbers; None: derived from the scenario's seed. Ignored for a fleet without a central
        planner.
    **user_parts
        User-defined parts: `controller`, `guidance`, `sensors`, `estimator`, `planner`, as for `anser.run`.

    Returns
    -------
    FirstPlan
        The plan (`plan`, which raises `anser.missions.NoPlanError` if none was found), the reasons for a missing plan
        (`refusals`), the reasons and the obstacles to flying the plan (`problems()`, empty for a flyable plan), and the
        differences from the scenario's request (`notes()`). The published planner never refuses.

    Raises
    ------
    ScenarioError
        If the file cannot be read or is not a valid scenario, or an aircraft cannot be trimmed at its start.
    """
    enable_compilation_cache()
    scenario = attach_parts(as_scenario(scenario), UserParts(**user_parts))
    flight = build_flight(scenario, pad_fleet=True)
    if randomness is not None:
        flight = dataclasses.replace(flight, randomness=randomness)
    plan_type = _FIRST_PLANS.get(type(flight.planner), UserFirstPlan)
    return plan_type.make(scenario, flight, on_progress, prepare_next)


_FIRST_PLANS: dict[type[AbstractPlanner], type[FirstPlan]] = {
    PublishedPlanner: PublishedFirstPlan,
    CertifiedPlanner: CertifiedFirstPlan,
    DecentralisedPlanner: DecentralisedFirstPlan,
}
_FORMAT = 2


def write_plan(planned: FirstPlan, path: Path) -> None:
    """Write a finished plan to a new file: a NumPy archive with its checksum as the archive comment.

    Raises
    ------
    FileExistsError
        If the file exists.
    NoPlanError
        If `planned` has no plan.
    ValueError
        If the planner is user-defined.
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
        If the file cannot be read, is damaged, contains the plan of another scenario, or was written by another version
        of anser.
    ScenarioError
        If an aircraft cannot be trimmed at its start.
    """
    path = Path(path)
    if path.is_dir():
        path = path / PLAN
    enable_compilation_cache()
    flight = build_flight(scenario, pad_fleet=True)
    plan_type = _FIRST_PLANS.get(type(flight.planner), UserFirstPlan)
    if plan_type is UserFirstPlan:
        received = f"a plan file for a scenario with a user-defined planner, {type(flight.planner).__name__}"
        raise PlanFileError(
            f"{path}: arrived {received}; expected the scenario without it: only plans of the package's planners are "
            "written to files"
        )
    try:
        _verify(path)
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        metadata = json.loads(str(arrays.pop("about")))
        _refuse_foreign_plan(metadata, scenario, path)
        state = _rebuild_state(plan_type.state_type, "", arrays)
    except (OSError, KeyError, TypeError, ValueError, EOFError, zipfile.BadZipFile) as error:
        if isinstance(error, PlanFileError):
            raise
        raise PlanFileError(f"{path} cannot be read as a plan ({error})") from None
    if flight.count != jax.tree.leaves(state)[0].shape[0]:
        raise PlanFileError(f"{path} holds a plan of another size than this version of anser makes")
    fleet = _trim_at_start(flight)
    check_trimmable(scenario, flight, fleet.is_trimmed, fleet.alphas)
    return plan_type.restore(scenario, flight, fleet, state)


def plan_for_flight(planned: FirstPlan, scenario: Scenario) -> FirstPlan:
    """Return the plan `planned` for the flight of `scenario`, which may have additional user-defined parts.

    The flight uses the random numbers with which the plan was made. Raises ValueError if the plan was made for another
    scenario, with another planner, or with user-defined parts that `scenario` lacks or replaces. Raises ScenarioError
    if an aircraft cannot be trimmed at its start.
    """
    if planned.scenario == scenario:
        return planned
    if differs_in_values(planned.scenario, scenario):
        raise ValueError(f"planned: arrived a plan for {planned.scenario.name}; expected one for the scenario itself")
    kinds = replaced_parts(planned.scenario, scenario)
    if kinds:
        arrived = f"a plan made with other user-defined parts ({', '.join(kinds)}) than those of the flight"
        raise ValueError(
            f"planned: arrived {arrived}; expected the same, as in anser.run(planned.scenario, planned=planned)"
        )
    flight = build_flight(scenario, pad_fleet=True)
    flight = dataclasses.replace(flight, randomness=planned.flight.randomness)
    fleet = _trim_at_start(flight)
    check_trimmable(scenario, flight, fleet.is_trimmed, fleet.alphas)
    return dataclasses.replace(planned, scenario=scenario, flight=flight, fleet=fleet, start_state=None)


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


def _with_checksum(archive: io.BytesIO) -> bytes:
    """Return the bytes of a plan file: the archive with its checksum as archive comment, at the end of the file."""
    with zipfile.ZipFile(archive, "a") as file:
        file.comment = bytes(TRAILER_BYTES)
    content = archive.getvalue()[:-TRAILER_BYTES]
    return content + checksum_trailer(hashlib.sha256(content).hexdigest())


def _rebuild_state(kind: type, prefix: str, arrays: dict[str, np.ndarray]) -> Any:
    """Rebuild an object of the class `kind` from the arrays of a plan file whose keys begin with `prefix`.

    An optional field is None if the file has no array for the field.
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
