"""Files: size-limited reading, XML decoding, and output files and folders that are either complete or absent.

An interrupted or killed process leaves no partial file under the final name.
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
    """Return the content of a file.

    Raises OSError if the file is larger than `size_max` bytes or cannot be read, ValueError if the path contains a null
    character.
    """
    with path.open("rb") as file:
        content = file.read(size_max + 1)
    if len(content) > size_max:
        raise OSError(errno.EFBIG, f"more than {size_max:,} bytes", str(path))
    return content


def decode_xml(content: bytes) -> str:
    """Return the text of an XML document; the encoding is UTF-8 if neither byte order mark nor declaration gives one.

    Raises LookupError if the declared encoding is not in `XML_ENCODINGS`, UnicodeDecodeError if the content is not
    valid in the encoding.
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
"""Greatest length, in characters, of a suffix that the name of a temporary file keeps."""
_unfinished: set[Path] = set()


@contextlib.contextmanager
def new_file(path: Path, *, overwrite: bool = False) -> Iterator[Path]:
    """Yield a temporary path for the block to write to; afterwards the file is flushed to disk and renamed to `path`.

    If the block raises, the temporary file is removed and a file at `path` is unchanged.

    Raises
    ------
    FileExistsError
        `path` exists and `overwrite` is False, or `path` is a folder or device.
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
    """Write text (UTF-8, line ends unchanged) or bytes to a complete file; raises the errors of `new_file`."""
    data = content.encode() if isinstance(content, str) else content
    with new_file(path, overwrite=overwrite) as partial:
        partial.write_bytes(data)


@contextlib.contextmanager
def staged_folder(folder: Path) -> Iterator[Path]:
    """Yield a new, empty folder inside `folder`, and move its content into `folder` at the end of the block.

    Files of `folder` with equal names are replaced; its other content stays. If the block raises, `folder` is
    unchanged. Raises FileExistsError, and moves nothing, if a file would replace a folder or device, or a folder would
    replace a file.
    """
    staging = folder / f".anser-{secrets.token_hex(6)}"
    with _temporary(staging, folder):
        staging.mkdir()
        yield staging
        with defer_interrupts():
            _move_into(staging, folder)


@contextlib.contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """Create `folder` with its parents, yield a temporary folder inside, and move its content into `folder` at the end.

    If the block raises or writes no file, `folder` and the parents that were created are removed. Raises
    FileExistsError if `folder` exists.
    """
    _refuse_null(folder)
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True)
        with staged_folder(folder) as staging:
            yield staging
    finally:
        remove_empty_folders(missing)


@contextlib.contextmanager
def result_folder(folder: Path, *, replace: bool) -> Iterator[Path]:
    """Yield a temporary folder for the files of a result, and move them into `folder` at the end of the block.

    Other files of an existing `folder` stay. Raises FileExistsError if `folder` is a file, or exists and `replace` is
    False.
    """
    if folder.exists() and not (folder.is_dir() and replace):
        or_force = ", or give force=True to replace the result in it" if folder.is_dir() else ""
        raise FileExistsError(f"{folder} exists and is not overwritten: choose another folder{or_force}")
    with staged_folder(folder) if folder.exists() else new_folder(folder) as staging:
        yield staging


def remove_empty_folders(folders: list[Path]) -> None:
    """Remove the listed folders in order (innermost first), up to the first folder that is missing or has content."""
    with defer_interrupts(), contextlib.suppress(OSError):
        for folder in folders:
            folder.rmdir()


def remove_temporary_outputs() -> None:
    """Remove the temporary files and folders of all unfinished outputs; called before the process ends early."""
    for path in list(_unfinished):
        _remove(path)


@contextlib.contextmanager
def defer_interrupts() -> Iterator[None]:
    """Delay an interrupt by Ctrl-C to the end of the block; without effect outside the main thread."""
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
    """Remove the temporary file or folder `path` after the block, and replace `path` by `target` in an OSError."""
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
    """Raise FileExistsError if `path` exists; if `overwrite` is True, only if `path` is a folder or device."""
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
    """Flush a file to disk; raises OSError on a full disk, which some file systems report only here."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _move_into(staging: Path, folder: Path) -> None:
    """Move the content of `staging` into `folder`, merging folders; raises FileExistsError if a file meets a folder."""
    moves: list[tuple[Path, Path]] = []
    waiting = sorted(staging.iterdir(), reverse=True)
    while waiting:
        source = waiting.pop()
        target = folder / source.relative_to(staging)
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
