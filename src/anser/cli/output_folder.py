"""Folders and files that commands write: new ones, or with --force those that are there, all else in them untouched."""

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import typer

from anser.cli.console import RefusedError

Force = Annotated[
    bool,
    typer.Option(
        "--force",
        help="Write where something exists: files of the same names are replaced, all others stay.",
    ),
]


@contextlib.contextmanager
def written_into(folder: Path, force: bool = False) -> Iterator[Path]:
    """Make the output folder and give the one to write into, before anything is flown; refuse one that exists.

    A new folder into which nothing is written does not stay: what did not end leaves nothing behind. With `force` the
    folder may exist, and what is written takes the places of files of the same names when all of it is complete.
    """
    if force and folder.is_dir():
        from anser.results.replacing_files import replaced_within  # here: help needs no libraries

        with _kept_unless_empty(folder), contextlib.ExitStack() as replacing:
            with _refusing("--out", folder, "a folder in which files can be replaced"):
                into = replacing.enter_context(replaced_within(folder))
            yield into
            with _refusing("--out", folder, "a folder in which files can be replaced"):
                replacing.pop_all().close()
        return
    _make_new(folder)
    with _kept_unless_empty(folder):
        yield folder


def _make_new(folder: Path) -> None:
    with _refusing("--out", folder, "a place where a folder can be made"):
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            words = "a new folder, or --force (nothing is overwritten without it)"
            raise RefusedError(
                f"--out: arrived {folder}, which exists; expected {words if folder.is_dir() else 'a folder'}"
            ) from None


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
        reason = error.strerror or str(error)
        raise RefusedError(
            f"--out: arrived nothing, and {folder} cannot be made ({reason}); expected a place where it can"
        ) from None


@contextlib.contextmanager
def _kept_unless_empty(folder: Path) -> Iterator[None]:
    """Take the new folder away at the end where nothing was written into it."""
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            folder.rmdir()  # succeeds only while it is empty


def must_be_new_file(option: str, path: Path, suffixes: Sequence[str], force: bool = False) -> None:
    """Refuse a file that cannot be written, before anything is computed; with `force` it may exist."""
    if path.suffix not in suffixes:
        words = " or ".join([*filter(None, [", ".join(suffixes[:-1])]), suffixes[-1]])
        raise RefusedError(f"{option}: arrived {path}; expected a name that ends with {words}")
    if path.is_dir() or (path.exists() and not force):
        words = "a new file, or --force (nothing is overwritten without it)"
        raise RefusedError(f"{option}: arrived {path}, which exists; expected {words}")
    if not path.parent.is_dir():
        raise RefusedError(f"{option}: arrived {path}; expected a file in a folder that exists")


@contextlib.contextmanager
def written_file(option: str, path: Path, force: bool = False) -> Iterator[Path]:
    """Give the file to write, which with `force` replaces one that exists; refuse one that cannot be written."""
    with _refusing(option, path, "a place for a file"):
        if not force:
            yield path
            return
        from anser.results.replacing_files import replaced_within

        with replaced_within(path.parent) as beside:
            yield beside / path.name


@contextlib.contextmanager
def _refusing(option: str, path: Path, expected: str) -> Iterator[None]:
    """Refuse a path of an option that the system does not take."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise RefusedError(f"{option}: arrived {path}; expected {expected} ({reason})") from None
