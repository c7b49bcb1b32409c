"""Folders and files of commands.

New output folders and files (or, with --force, replaced ones), and the folder of a finished run.
"""

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from anser.cli.console import RefusedError
from anser.config.errors import os_error_reason
from anser.files import new_file, new_folder, remove_empty_folders, staged_folder
from anser.missions import saved_flights
from anser.missions.saved_flights import FLIGHT, PLAN, RUN_FILES, SUMMARY, RunFolderError, load_flight

if TYPE_CHECKING:
    import xarray as xr


Force = Annotated[
    bool,
    typer.Option(
        "--force",
        help="Write where something exists: files of the same names are replaced, all others stay.",
    ),
]


@contextlib.contextmanager
def open_output_folder(folder: Path, force: bool = False) -> Iterator[Path]:
    """Make the output folder and give one to write into, before anything is flown; refuse one that exists.

    What is written gets its place in the folder when all of it is complete. A new folder into which nothing is written
    does not stay. With `force` the folder may exist, and files of the same names are replaced.
    """
    is_old = force and _is_folder(folder)
    place = "a folder in which files can be replaced" if is_old else "a place where a folder can be made"
    with contextlib.ExitStack() as writing:
        if is_old:
            writing.callback(remove_empty_folders, [folder])
        with _refusing("--out", folder, place):
            try:
                into = writing.enter_context(staged_folder(folder) if is_old else new_folder(folder))
            except FileExistsError:
                words = "a new folder, or --force (nothing is overwritten without it)"
                raise RefusedError(
                    f"--out: arrived {folder}, which exists; expected {words if folder.is_dir() else 'a folder'}"
                ) from None
        yield into
        with _refusing("--out", folder, place):
            writing.close()


def make_next_folder(folder: Path) -> Path:
    """Make the output folder that nobody named: this one, or the first that is free with -2, -3, ... behind it."""
    place, count = folder, 1
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        while True:
            with contextlib.suppress(FileExistsError):
                place.mkdir()
                return place
            count += 1
            place = folder.with_name(f"{folder.name}-{count}")
    except OSError as error:
        raise RefusedError(
            f"--out: arrived nothing, and {folder} cannot be made ({os_error_reason(error)}); "
            "expected a place where it can"
        ) from None


def must_be_new_file(option: str, path: Path, suffixes: Sequence[str], force: bool = False) -> None:
    """Refuse a file that cannot be written, before anything is computed; with `force` it may exist."""
    if path.suffix not in suffixes:
        words = " or ".join([*filter(None, [", ".join(suffixes[:-1])]), suffixes[-1]])
        raise RefusedError(f"{option}: arrived {path}; expected a name that ends with {words}")
    must_be_writable(option, path, force)


def must_be_writable(option: str, path: Path, force: bool) -> None:
    """Refuse a file that exists, unless `force` may replace it, and one for which there is no place."""
    with _refusing(option, path, "a place for a file"):
        if path.is_file() and not force:
            words = "a new file, or --force (nothing is overwritten without it)"
            raise RefusedError(f"{option}: arrived {path}, which exists; expected {words}")
        if path.exists() and not path.is_file():
            kind = "a folder" if path.is_dir() else "a device"
            raise RefusedError(f"{option}: arrived {path}, which is {kind}; expected a file")
        if not path.parent.is_dir():
            raise RefusedError(f"{option}: arrived {path}; expected a file in a folder that exists")


@contextlib.contextmanager
def open_output_file(option: str, path: Path, force: bool = False) -> Iterator[Path]:
    """Give a path to write to, whose file takes its place when it is complete; refuse one that cannot be written."""
    with _refusing(option, path, "a place for a file"), new_file(path, overwrite=force) as partial:
        yield partial


def _is_folder(path: Path) -> bool:
    with _refusing("--out", path, "a place where a folder can be made"):
        return path.is_dir()


@contextlib.contextmanager
def _refusing(option: str, path: Path, expected: str) -> Iterator[None]:
    """Refuse a path of an option that the system does not take."""
    try:
        yield
    except OSError as error:
        raise RefusedError(f"{option}: arrived {path}; expected {expected} ({os_error_reason(error)})") from None


__all__ = ["FLIGHT", "PLAN", "RUN_FILES", "SUMMARY", "check_run_folder", "read_flight", "read_run"]


def check_run_folder(folder: Path, place: str = "RUN") -> None:
    """Refuse a folder that holds no run; `place` is the argument that names it."""
    try:
        saved_flights.check_run_folder(folder)
    except RunFolderError as error:
        raise RefusedError(f"{place}: {error}") from None


def read_run(folder: Path, place: str = "RUN") -> tuple["xr.Dataset", dict[str, Any]]:
    """Read a flight and its summary; refuse a folder that does not hold both."""
    check_run_folder(folder, place)
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
