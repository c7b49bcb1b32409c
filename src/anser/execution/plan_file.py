"""A finished plan as a file: all its arrays, so that it can be flown without being made again."""

import hashlib
import io
import json
import os
import zipfile
from pathlib import Path
from typing import Any, get_args, get_type_hints

import equinox as eqx
import jax
import numpy as np

from anser.compiling import enable_compilation_cache
from anser.execution.certified import CertifiedPlanned, begun, trimmed
from anser.execution.negotiated import Agreement, DecentralisedPlanned
from anser.execution.plan_interface import PlanFileError, Planned
from anser.execution.planned import PublishedPlanned
from anser.execution.saved_flight import PLAN
from anser.execution.untrimmable import refuse_untrimmable
from anser.numerics import as_array
from anser.output_files import write_file
from anser.planning.certified import Outcome
from anser.planning.published_planner import PublishedPlanState
from anser.results import DamagedFileError, version_attributes
from anser.results.checksums import TRAILER_BYTES, trailer_of, verify_checksum
from anser.scenario import Scenario, build_flight
from anser.simulation import CertifiedPlanner, CertifiedPlanState, DecentralisedPlanner

_FORMAT = 2
_STATES = {"published": PublishedPlanState, "certified": CertifiedPlanState, "decentralised": Agreement}


def write_plan(planned: Planned, path: Path) -> None:
    """Write a finished plan into a new file, a NumPy archive whose comment is its checksum.

    Raises
    ------
    FileExistsError
        The file exists: nothing is overwritten.
    NoPlanError
        There is no plan.
    """
    leaves = jax.tree_util.tree_flatten_with_path(planned.kept())[0]
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


def read_plan(path: str | os.PathLike[str], scenario: Scenario) -> Planned:
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
        _refuse_other(about, scenario, path)
        state = _rebuilt(_STATES[about["planner"]], "", arrays)
    except (OSError, KeyError, TypeError, ValueError, EOFError, zipfile.BadZipFile) as error:
        if isinstance(error, PlanFileError):
            raise
        raise PlanFileError(f"{path} cannot be read as a plan ({error})") from None
    return _planned(scenario, state, path)


def _verify(path: Path) -> None:
    try:
        verified = verify_checksum(path)
    except DamagedFileError as error:
        raise PlanFileError(str(error)) from None
    if not verified:
        words = "a file without a checksum, cut or of an older version"
        raise PlanFileError(f"{path}: arrived {words}; expected a plan of format {_FORMAT}, as anser plan --out writes")


def _refuse_other(about: dict[str, Any], scenario: Scenario, path: Path) -> None:
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


def _planned(scenario: Scenario, state: Any, path: Path) -> Planned:
    enable_compilation_cache()
    flight = build_flight(scenario, filled_up=True)
    if flight.count != jax.tree.leaves(state)[0].shape[0]:
        raise PlanFileError(f"{path} holds a plan of another size than this version of anser makes")
    fleet = trimmed(flight)
    refuse_untrimmable(scenario, flight, fleet.steady)
    if scenario.fleet.planner == "published":
        return PublishedPlanned(scenario, flight, fleet, (), begun(flight, fleet, state))
    first = state.first if isinstance(state, Agreement) else state
    planner = flight.planner.each if isinstance(flight.planner, DecentralisedPlanner) else flight.planner
    assert isinstance(planner, CertifiedPlanner)
    tasks = planner.aircraft_tasks(fleet.reports, first.limits)
    made = scenario, flight, fleet, (), Outcome(first.plan, 0), tasks, planner.airspace, first.holds
    if isinstance(state, Agreement):
        return DecentralisedPlanned(*made, float(state.after_s))
    return CertifiedPlanned(*made)


def _with_checksum(archive: io.BytesIO) -> bytes:
    """Bytes of an archive with their checksum as its comment, which stands at the end."""
    with zipfile.ZipFile(archive, "a") as file:
        file.comment = bytes(TRAILER_BYTES)
    content = archive.getvalue()[:-TRAILER_BYTES]
    return content + trailer_of(hashlib.sha256(content).hexdigest())


def _rebuilt(kind: type, place: str, arrays: dict[str, np.ndarray]) -> Any:
    """A module of arrays from those under its place, by the types of its fields."""
    fields = {}
    for name, hint in get_type_hints(kind).items():
        own = f"{place}{name}"
        modules = [one for one in (hint, *get_args(hint)) if isinstance(one, type) and issubclass(one, eqx.Module)]
        if not modules:
            left_out = own not in arrays and type(None) in get_args(hint)
            fields[name] = None if left_out else as_array(arrays[own], None)
        elif any(key.startswith(f"{own}.") for key in arrays):
            fields[name] = _rebuilt(modules[0], f"{own}.", arrays)
        else:
            fields[name] = None
    return kind(**fields)
