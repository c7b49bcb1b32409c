"""Folders and files that commands write: new ones, or with --force those that are there, all else in them untouched."""

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import typer

from anser.cli.console import RefusedError
from anser.output_files import new_file, new_folder, remove_while_empty, replaced_within
from anser.scenario.errors import reason_of

Force = Annotated[
    bool,
    typer.Option(
        "--force",
        help="Write where something exists: files of the same names are replaced, all others stay.",
    ),
]


@contextlib.contextmanager
def written_into(folder: Path, force: bool = False) -> Iterator[Path]:
    """Make the output folder and give one to write into, before anything is flown; refuse one that exists.

    What is written gets its place in the folder when all of it is complete. A new folder into which nothing is written
    does not stay. With `force` the folder may exist, and files of the same names are replaced.
    """
    is_old = force and _is_folder(folder)
    place = "a folder in which files can be replaced" if is_old else "a place where a folder can be made"
    with contextlib.ExitStack() as writing:
        if is_old:
            writing.callback(remove_while_empty, [folder])
        with _refusing("--out", folder, place):
            try:
                into = writing.enter_context(replaced_within(folder) if is_old else new_folder(folder))
            except FileExistsError:
                words = "a new folder, or --force (nothing is overwritten without it)"
                raise RefusedError(
                    f"--out: arrived {folder}, which exists; expected {words if folder.is_dir() else 'a folder'}"
                ) from None
        yield into
        with _refusing("--out", folder, place):
            writing.close()


def make_next(folder: Path) -> Path:
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
            f"--out: arrived nothing, and {folder} cannot be made ({reason_of(error)}); expected a place where it can"
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
def written_file(option: str, path: Path, force: bool = False) -> Iterator[Path]:
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
        raise RefusedError(f"{option}: arrived {path}; expected {expected} ({reason_of(error)})") from None
