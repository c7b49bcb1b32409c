"""Reading the folder that `anser run` wrote."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from anser.cli.console import RefusedError
from anser.execution import saved_flight
from anser.execution.saved_flight import FLIGHT, PLAN, RUN_FILES, SUMMARY, RunFolderError, load_flight

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["FLIGHT", "PLAN", "RUN_FILES", "SUMMARY", "must_be_run", "read_flight", "read_run"]


def must_be_run(folder: Path, place: str = "RUN") -> None:
    """Refuse a folder that holds no run; `place` is the argument that names it."""
    try:
        saved_flight.must_be_run(folder)
    except RunFolderError as error:
        raise RefusedError(f"{place}: {error}") from None


def read_run(folder: Path, place: str = "RUN") -> tuple["xr.Dataset", dict[str, Any]]:
    """Read a flight and its summary; refuse a folder that does not hold both."""
    must_be_run(folder, place)
    try:
        found = load_flight(folder)
    except RunFolderError as error:
        raise RefusedError(f"{place}, {error}") from None
    return found.dataset, found.summary


def read_flight(folder: Path, names: tuple[str, ...]) -> tuple["xr.Dataset", dict[str, Any]]:
    """As `read_run`; refuse a flight that lacks variables."""
    dataset, summary = read_run(folder)
    missing = [name for name in names if name not in dataset.variables]
    if missing:
        raise RefusedError(
            f"{folder / FLIGHT}: arrived without {', '.join(missing)}; expected a flight of this version of anser"
        )
    return dataset, summary
