"""Integrity of a campaign's folder.

The error StoreError, the lock of the process that flies it, and the SHA-256 records of the store's files.
"""

import contextlib
import fcntl
import itertools
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from anser.files import write_file
from anser.results.checksums import DamagedFileError, add_checksum, damaged_file_error, file_digest, read_document


class StoreError(ValueError):
    """A folder that is no store of this study, or cannot be one; `str()` is the finished message."""


@contextlib.contextmanager
def folder_lock(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder; the system releases it when the process ends, however it does.

    Raises
    ------
    StoreError
        Another process holds it, or the file system has no locks.
    """
    path = folder / "lock"
    with contextlib.ExitStack() as stack:
        try:
            file = stack.enter_context(path.open("a"))
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            words = "arrived a folder into which another process flies; expected one at a time: wait until it ends"
            raise StoreError(f"{folder}: {words}") from None
        except OSError as error:
            words = f"arrived {path}, which cannot be locked ({error.strerror}); expected a file system with locks"
            raise StoreError(f"{folder}: {words}") from None
        yield


_BASE = "store"
"""Record of what is written once: metadata, coordinates, seeds and what varies."""


class StoreChecksums:
    """Records in a folder, each a JSON document with the SHA-256 of files by their path in the store.

    The record of a chunk is written when all its files are on the disk: a chunk with a record is complete.

    Parameters
    ----------
    folder
        Of the campaign; the records lie in `checksums`.
    store
        Name of the store's folder in it, from which the paths of files start.
    """

    def __init__(self, folder: Path, store: str) -> None:
        self._folder, self._store = folder / "checksums", folder / store

    @property
    def has_records(self) -> bool:
        """Whether there are records: stores of the first format have none."""
        return self._folder.is_dir()

    def record_base(self, about: Mapping[str, int]) -> None:
        """Record every file that the store has, and some numbers that are needed to make them anew."""
        self._folder.mkdir(exist_ok=True)
        files = sorted(path for path in self._store.rglob("*") if path.is_file())
        self._write(_BASE, (str(path.relative_to(self._store)) for path in files), about)

    def record_chunk(self, chunk: int, files: Iterable[str]) -> None:
        """Record the files of a chunk, which is complete from then on."""
        self._write(str(chunk), files, {})

    def forget_chunk(self, chunk: int) -> None:
        """Take the record of a chunk away: the chunk is no longer complete."""
        self._path(str(chunk)).unlink(missing_ok=True)

    def chunks(self) -> set[int]:
        """Numbers of the chunks that have a record."""
        stems = (path.stem for path in self._folder.glob("*.json"))
        return {int(stem) for stem in stems if stem.isdecimal()}

    def base_number(self, key: str) -> int:
        """A number that `record_base` was given; raises DamagedFileError if the record is not whole."""
        return self._read(_BASE)["about"][key]

    def base_problems(self) -> dict[str, str]:
        """Files written once that are not as recorded, with their checksums; DamagedFileError of the record itself."""
        files = self._read(_BASE)["files"]
        return {name: digest for name, digest in files.items() if not self._matches(name, digest)}

    def refuse_damaged_base(self) -> None:
        """Refuse a store of which a file that is written once is not as recorded (DamagedFileError)."""
        problems = list(self.base_problems())
        if problems:
            more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
            arrived = f"a file that is damaged or missing{more}"
            raise damaged_file_error(
                self._store / problems[0], arrived, "it as anser wrote it: anser campaign with --resume makes it anew"
            )

    def chunk_problem(self, chunk: int, is_verified: Callable[[str], bool] = lambda name: True) -> str | None:
        """What is wrong with the first damaged file of a chunk; None if nothing is.

        Parameters
        ----------
        chunk
            Number of a chunk that has a record.
        is_verified
            Whether the file of a path in the store is verified.
        """
        try:
            files = self._read(str(chunk))["files"]
        except DamagedFileError as error:
            return str(error)
        for name, digest in files.items():
            if is_verified(name) and not self._matches(name, digest):
                return f"{self._store / name} is {'damaged' if (self._store / name).is_file() else 'missing'}"
        return None

    def _matches(self, name: str, digest: str) -> bool:
        path = self._store / name
        return path.is_file() and file_digest(path) == digest

    def _write(self, name: str, files: Iterable[str], about: Mapping[str, int]) -> None:
        digests = {file: file_digest(self._store / file) for file in files}
        document = add_checksum({"about": dict(about), "files": digests, "record": name})
        write_file(self._path(name), json.dumps(document, indent=0) + "\n", overwrite=True)

    def _read(self, name: str) -> dict[str, Any]:
        path = self._path(name)
        try:
            document, checked = read_document(path)
        except OSError as error:
            raise damaged_file_error(path, f"a record that cannot be read ({error.strerror})") from None
        # a record under the name of another is whole, and wrong
        if not checked or document.get("record") != name:
            raise damaged_file_error(path, "a record without its checksum, or of another chunk")
        return document

    def _path(self, name: str) -> Path:
        return self._folder / f"{name}.json"


def chunk_files(array: str, chunk: int, grid: tuple[int, ...]) -> Iterable[str]:
    """Paths of the files of an array (Zarr format 2) that hold a chunk of its first dimension.

    Parameters
    ----------
    array
        Path of the array in the store.
    chunk
        Its number.
    grid
        Number of chunks along each dimension of the array.
    """
    for others in itertools.product(*map(range, grid[1:])):
        yield f"{array}/{'.'.join(map(str, (chunk, *others)))}"
