"""Output folders and files of commands (new, or replaced with --force), and folders of finished runs."""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from anser.cli.console import InputError, print_note, refuse_on
from anser.config.errors import os_error_reason
from anser.files import new_file, new_folder, remove_empty_folders, staged_folder
from anser.missions import saved_flights
from anser.missions.saved_flights import FLIGHT, SUMMARY, RunFolderError, load_flight

if TYPE_CHECKING:
    import xarray as xr


Force = Annotated[
    bool,
    typer.Option(
        "--force", help="Write where something exists: files of the same names are replaced, all others stay."
    ),
]


@contextlib.contextmanager
def open_output_folder(folder: Path, force: bool = False) -> Iterator[Path]:
    """Create the output folder and yield a temporary folder; if no error occurs, the files move to the output folder.

    With `force` the output folder may exist, and files of the same names are replaced. Raises InputError if the folder
    exists and `force` is False, or if the folder cannot be written.
    """
    is_old = force and _is_folder(folder)
    expected_place = "a folder in which files can be replaced" if is_old else "a place where a folder can be made"
    with contextlib.ExitStack() as writing:
        if is_old:
            writing.callback(remove_empty_folders, [folder])
        with _refusing("--out", folder, expected_place):
            try:
                into = writing.enter_context(staged_folder(folder) if is_old else new_folder(folder))
            except FileExistsError:
                remedy = "a new folder, or --force (nothing is overwritten without it)"
                raise InputError(
                    f"--out: arrived {folder}, which exists; expected {remedy if folder.is_dir() else 'a folder'}"
                ) from None
        yield into
        with _refusing("--out", folder, expected_place):
            writing.close()


def make_next_folder(folder: Path) -> Path:
    """Create the default output folder or, if the folder exists, the first free one with suffix -2, -3, ...; return it.

    Raises InputError if no folder can be created.
    """
    candidate, count = folder, 1
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        while True:
            with contextlib.suppress(FileExistsError):
                candidate.mkdir()
                return candidate
            count += 1
            candidate = folder.with_name(f"{folder.name}-{count}")
    except OSError as error:
        raise InputError(
            f"--out: arrived nothing, and {folder} cannot be made ({os_error_reason(error)}); "
            "expected a place where it can"
        ) from None


PICTURE_SUFFIXES = (".svg", ".png", ".pdf")
"""File formats of pictures."""


def must_be_new_file(
    option: str, path: Path | None, suffixes: Sequence[str] = PICTURE_SUFFIXES, force: bool = False
) -> None:
    """Raise InputError if a path has none of the suffixes, or if `must_be_writable` refuses the path; None passes."""
    if path is None:
        return
    if path.suffix not in suffixes:
        endings = " or ".join([*filter(None, [", ".join(suffixes[:-1])]), suffixes[-1]])
        raise InputError(f"{option}: arrived {path}; expected a name that ends with {endings}")
    must_be_writable(option, path, force)


def must_be_writable(option: str, path: Path, force: bool) -> None:
    """Raise InputError if no file can be written at a path, or a file exists and `force` is False."""
    with _refusing(option, path, "a place for a file"):
        if path.is_file() and not force:
            remedy = "a new file, or --force (nothing is overwritten without it)"
            raise InputError(f"{option}: arrived {path}, which exists; expected {remedy}")
        if path.exists() and not path.is_file():
            kind = "a folder" if path.is_dir() else "a device"
            raise InputError(f"{option}: arrived {path}, which is {kind}; expected a file")
        if not path.parent.is_dir():
            raise InputError(f"{option}: arrived {path}; expected a file in a folder that exists")


@contextlib.contextmanager
def open_output_file(option: str, path: Path, force: bool = False) -> Iterator[Path]:
    """Yield a temporary path for an output file; if no error occurs, the file is moved to `path`.

    Raises InputError if the file cannot be written, or if the file exists and `force` is False.
    """
    with _refusing(option, path, "a place for a file"), new_file(path, overwrite=force) as partial:
        yield partial


def write_if_requested(option: str, path: Path | None, force: bool, write: Callable[[Path], object]) -> None:
    """Write an output file with `write`, unless `path` is None; raises InputError if the file cannot be written."""
    if path is not None:
        with open_output_file(option, path, force) as file:
            write(file)


def note_if_written(path: Path | None, contents: str = "") -> None:
    """Print that the file `path`, or a folder with `contents`, was written; print nothing if `path` is None."""
    if path is not None:
        print_note(f"{path}: {contents} written" if contents else f"{path}: written")


def _is_folder(path: Path) -> bool:
    with _refusing("--out", path, "a place where a folder can be made"):
        return path.is_dir()


@contextlib.contextmanager
def _refusing(option: str, path: Path, expected: str) -> Iterator[None]:
    """Convert an operating-system error in the `with` block to InputError; `expected` says what `path` should be."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{option}: arrived {path}; expected {expected} ({os_error_reason(error)})") from None


def check_run_folder(folder: Path, argument: str = "RUN") -> None:
    """Raise InputError if a folder lacks the files of a run; `argument` names the folder on the command line."""
    with refuse_on(RunFolderError, f"{argument}: "):
        saved_flights.check_run_folder(folder)


def read_run(folder: Path, argument: str = "RUN") -> tuple["xr.Dataset", dict[str, Any]]:
    """Return dataset and summary of a run folder; `argument` names the folder on the command line.

    Raises InputError if files are missing or damaged.
    """
    check_run_folder(folder, argument)
    with refuse_on(RunFolderError, f"{argument}, "):
        flight = load_flight(folder)
    return flight.dataset, flight.summary


def read_aircraft_flight(folder: Path) -> "xr.Dataset | None":
    """Return the dataset of a folder that `anser simulate` wrote; None for any other folder.

    Raises InputError if the dataset is damaged.
    """
    from anser.results.checksums import DamagedFileError
    from anser.results.netcdf import read_netcdf

    if not (folder / FLIGHT).is_file() or (folder / SUMMARY).exists():
        return None
    with refuse_on(DamagedFileError, "RUN, "):
        dataset = read_netcdf(folder / FLIGHT)
    return dataset if "aircraft" in dataset.attrs and tuple(dataset.dims) == ("time",) else None


def read_flight(folder: Path, names: tuple[str, ...]) -> tuple["xr.Dataset", dict[str, Any]]:
    """Return dataset and summary of a run folder.

    Raises InputError if files are missing or damaged, or the dataset lacks one of the variables `names`.
    """
    dataset, summary = read_run(folder)
    missing = [name for name in names if name not in dataset.variables]
    if missing:
        raise InputError(
            f"{folder / FLIGHT}: arrived without {', '.join(missing)}; expected a flight of this version of anser"
        )
    return dataset, summary
