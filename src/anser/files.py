"""Files: input read up to a greatest size.

XML text in its declared encoding, and output files and folders that are complete under their name or absent,
whatever ends the process.
"""

import codecs
import contextlib
import errno
import os
import re
import secrets
import shutil
import signal
import threading
from collections.abc import Iterator
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Final

MIB: Final = 1 << 20
XML_ENCODINGS: Final = ("UTF-8", "UTF-16", "ISO-8859-1", "US-ASCII", "windows-1252")
_XML_ENCODING = re.compile(rb"""\s*<\?xml[^>]*?encoding\s*=\s*["']([A-Za-z0-9._-]+)["']""")


def read_file(path: Path | Traversable, size_max: int = 8 * MIB) -> bytes:
    """Content of a file; a device or a file of gigabytes is refused before it fills the memory.

    Parameters
    ----------
    path
        The file.
    size_max
        Greatest size that is read, bytes.

    Raises
    ------
    OSError
        The file cannot be read or is larger.
    ValueError
        The path holds a null character.
    """
    with path.open("rb") as file:
        content = file.read(size_max + 1)
    if len(content) > size_max:
        raise OSError(errno.EFBIG, f"more than {size_max:,} bytes", str(path))
    return content


def decode_xml(content: bytes) -> str:
    """Text of an XML document in the encoding that it declares.

    Raises
    ------
    LookupError
        The encoding is none of `XML_ENCODINGS`.
    UnicodeDecodeError
        The document is not in that encoding.
    """
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16")
    declared = None if content.startswith(codecs.BOM_UTF8) else _XML_ENCODING.match(content)
    if declared is None:
        return content.decode("utf-8-sig")
    name = declared[1].decode("ascii")
    if name.lower() not in map(str.lower, XML_ENCODINGS):
        raise LookupError(f'the encoding "{name}"')
    return content.decode(name)


_SUFFIX_MAX = 16
"""Longer suffixes are no kinds of files; a temporary name with one could be too long for the file system."""
_unfinished: set[Path] = set()


@contextlib.contextmanager
def new_file(path: Path, *, overwrite: bool = False) -> Iterator[Path]:
    """Give a temporary path beside an output file; at the end what was written there gets the file's name.

    The content is on the disk before it gets the name. Where the block raises, nothing has changed.

    Parameters
    ----------
    path
        The output file, in a folder that exists.
    overwrite
        Whether a file of this name may be replaced.

    Raises
    ------
    FileExistsError
        `path` exists and may not be replaced, or is no file.
    OSError
        The file cannot be written; `filename` is `path`.
    """
    _refuse_taken(path, overwrite)
    suffix = path.suffix if len(path.suffix) <= _SUFFIX_MAX else ""
    partial = path.with_name(f".anser-{secrets.token_hex(6)}{suffix}")
    with _temporary(partial, path):
        yield partial
        with defer_interrupts():
            _flush(partial)
            _refuse_taken(path, overwrite)
            partial.replace(path)


def write_file(path: Path, content: str | bytes, *, overwrite: bool = False) -> None:
    """Write a whole file; text in UTF-8, its ends of lines as they are. Raises as `new_file` does."""
    data = content.encode() if isinstance(content, str) else content
    with new_file(path, overwrite=overwrite) as partial:
        partial.write_bytes(data)


@contextlib.contextmanager
def staged_folder(folder: Path) -> Iterator[Path]:
    """Give a new, empty folder to write into; at the end its files go to their places in `folder`.

    Files of the same names are replaced, each by one that is complete; all others in `folder` are left alone. Where the
    block raises, nothing in `folder` has changed.

    Parameters
    ----------
    folder
        That exists.

    Raises
    ------
    FileExistsError
        Something that is no file stands where a file is to go: then nothing is replaced.
    """
    beside = folder / f".anser-{secrets.token_hex(6)}"
    with _temporary(beside, folder):
        beside.mkdir()
        yield beside
        with defer_interrupts():
            _move_into(beside, folder)


@contextlib.contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """Make a folder, and give one to write into, whose files it gets at the end.

    Where the block raises, or writes nothing, the new folder does not stay, nor its new parents.

    Raises
    ------
    FileExistsError
        `folder` exists.
    """
    _refuse_null(folder)
    made = [one for one in (folder, *folder.parents) if not one.exists()]
    try:
        folder.mkdir(parents=True)
        with staged_folder(folder) as beside:
            yield beside
    finally:
        remove_empty_folders(made)


def remove_empty_folders(folders: list[Path]) -> None:
    """Remove folders, the innermost first, up to the first that is not empty."""
    with defer_interrupts(), contextlib.suppress(OSError):
        for one in folders:
            one.rmdir()


def remove_temporary_outputs() -> None:
    """Remove the temporary files and folders of all outputs under way, before the process ends without finishing."""
    for one in list(_unfinished):
        _remove(one)


@contextlib.contextmanager
def defer_interrupts() -> Iterator[None]:
    """Let Ctrl-C take effect at the end of the block: for steps that belong together and take no time."""
    handler = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(handler):
        yield
        return
    arrived: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _: arrived.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
        if arrived:
            handler(arrived[0], None)


@contextlib.contextmanager
def _temporary(path: Path, target: Path) -> Iterator[None]:
    """Remove a file or folder of this name at the end, if it is there; errors name what it stands for."""
    _unfinished.add(path)
    try:
        yield
    except OSError as error:
        if error.filename is not None:
            name = Path(os.fsdecode(error.filename))
            if name.is_relative_to(path):
                error.filename = str(target / name.relative_to(path))
        elif error.errno is not None and not path.is_dir():
            error.filename = str(target)
        raise
    finally:
        with defer_interrupts():
            _remove(path)


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with contextlib.suppress(OSError):
            path.unlink()
    _unfinished.discard(path)


def _refuse_taken(path: Path, overwrite: bool) -> None:
    """Refuse a name that is taken, and where a file may be replaced, one of a folder or device."""
    _refuse_null(path)
    if not overwrite and os.path.lexists(path):
        raise FileExistsError(f"{path} exists and is not overwritten: choose another name or folder")
    if path.exists() and not path.is_file():
        kind = "a folder" if path.is_dir() else "a device"
        raise FileExistsError(f"{path} is {kind}, which no file replaces")


def _refuse_null(path: Path) -> None:
    if "\0" in str(path):
        raise OSError(errno.EINVAL, "a name with a null character", str(path))


def _flush(path: Path) -> None:
    """Put a file's content on the disk: some file systems only then say that there was no space for it."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _move_into(beside: Path, folder: Path) -> None:
    """Rename everything in a folder into another one; folders that are there already are merged."""
    moves: list[tuple[Path, Path]] = []
    waiting = sorted(beside.iterdir(), reverse=True)
    while waiting:
        source = waiting.pop()
        target = folder / source.relative_to(beside)
        if source.is_dir() and target.is_dir():
            waiting += sorted(source.iterdir(), reverse=True)
            continue
        if source.is_dir() and os.path.lexists(target):
            raise FileExistsError(errno.EEXIST, "a file, which no folder replaces", str(target))
        if source.is_file():
            _refuse_taken(target, overwrite=True)
        moves.append((source, target))
    for source, target in moves:
        source.replace(target)
