"""Integrity of a campaign folder: errors, the lock of the process that flies, and checksums (SHA-256) of the files."""

import abc
import contextlib
import fcntl
import itertools
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

from anser.campaigns.study import Study
from anser.files import write_file
from anser.results.checksums import DamagedFileError, add_checksum, damaged_file_error, file_digest, read_document
from anser.scenario.schema import Scenario

FORMAT = 2
"""Format of the stores of campaigns and of rare events, with checksums."""
UNCHECKED_FORMAT = 1
"""Former format without checksums: stores of this format can be read but not resumed."""


class StoreError(ValueError):
    """Error for a folder that is not a valid store of the study; `str()` is the complete message."""


@contextlib.contextmanager
def damage_as_store_error() -> Iterator[None]:
    """Convert a DamagedFileError raised in the `with` block to a StoreError with the same message."""
    try:
        yield
    except DamagedFileError as error:
        raise StoreError(str(error)) from None


@contextlib.contextmanager
def folder_lock(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder in the `with` block; the operating system also releases the lock when the process ends.

    Raises
    ------
    StoreError
        Another process holds the lock, or the file system does not support locks.
    """
    path = folder / "lock"
    with contextlib.ExitStack() as stack:
        try:
            file = stack.enter_context(path.open("a"))
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            detail = "arrived a folder into which another process flies; expected one at a time: wait until it ends"
            raise StoreError(f"{folder}: {detail}") from None
        except OSError as error:
            detail = f"arrived {path}, which cannot be locked ({error.strerror}); expected a file system with locks"
            raise StoreError(f"{folder}: {detail}") from None
        yield


class AbstractFlightStore(abc.ABC):
    """Folder with the results of a study's flights; only one process at a time may write, and a later one can resume.

    Attributes
    ----------
    description
        Name of the content in messages: "a campaign" or "a rare event".
    folder
        Folder of the results.
    study, scenario
        Study, and the scenario that its flights vary.
    format
        Version of the folder's format.
    damages
        A message for each damaged result that was removed and is flown again.
    """

    description: ClassVar[str]

    def __init__(self, folder: Path, study: Study, scenario: Scenario, version: int) -> None:
        self.folder, self.study, self.scenario, self.format = folder, study, scenario, version
        self.damages: list[str] = []
        self._has_lock = False

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Lock the folder in the `with` block, and remove damaged results; `damages` lists them.

        Raises
        ------
        StoreError
            Another process flies into the folder, or the format has no checksums.
        """
        if self._has_lock:
            yield
            return
        if self.format != FORMAT:
            found_format = f"{self.description} of format {self.format}, which can only be read"
            raise StoreError(
                f"{self.folder}: arrived {found_format}; expected one of format {FORMAT}, to go on with it"
            )
        with folder_lock(self.folder):
            self.damages += self._remove_damaged()
            self._has_lock = True
            try:
                yield
            finally:
                self._has_lock = False

    @abc.abstractmethod
    def _remove_damaged(self) -> list[str]:
        """Remove damaged results, so that they are flown again; return a message for each."""

    def _refuse_differences(self, stored: Mapping[str, Any], current: Mapping[str, object]) -> None:
        """Raise StoreError if one of the `current` values differs from the stored value of the same name."""
        for key, value in current.items():
            if stored.get(key) != value:
                difference = f"{self.description} with the {key.replace('_', ' ')} {stored.get(key)}"
                raise StoreError(f"{self.folder}: arrived {difference}; expected {value}, to go on with it")


def refuse_existing(folder: Path) -> None:
    """Raise FileExistsError if the folder intended for a new store already exists."""
    if folder.exists():
        raise FileExistsError(f"{folder} exists and is not overwritten: choose another folder, or resume")


_BASE = "store"
"""Name of the checksum record of the files written once at creation: metadata, coordinates, seeds, sampled values."""


class StoreChecksums:
    """Checksums of a store's files, in JSON files ("records") in the subfolder `checksums`.

    One record covers the files that are written once, when the store is created (the "base"); each chunk has a record
    of its own, written after the chunk's files are on disk. A chunk with a record is therefore complete.

    Parameters
    ----------
    folder
        Folder of the campaign; the records are in `checksums`.
    store
        Name of the store's subfolder, to which file paths are relative.
    """

    def __init__(self, folder: Path, store: str) -> None:
        self._folder, self._store = folder / "checksums", folder / store

    @property
    def has_records(self) -> bool:
        """Whether records exist; stores of the first format have none."""
        return self._folder.is_dir()

    def record_base(self, parameters: Mapping[str, int]) -> None:
        """Record the checksums of all files now in the store, and numbers (`parameters`) needed for repairs."""
        self._folder.mkdir(exist_ok=True)
        files = sorted(path for path in self._store.rglob("*") if path.is_file())
        self._write(_BASE, (str(path.relative_to(self._store)) for path in files), parameters)

    def record_chunk(self, chunk: int, files: Iterable[str]) -> None:
        """Record the checksums of a chunk's files, which marks the chunk as complete."""
        self._write(str(chunk), files, {})

    def forget_chunk(self, chunk: int) -> None:
        """Remove the record of a chunk, which thereby counts as incomplete."""
        self._path(str(chunk)).unlink(missing_ok=True)

    def chunks(self) -> set[int]:
        """Return the numbers of the complete chunks, that is, of the chunks with a record."""
        stems = (path.stem for path in self._folder.glob("*.json"))
        return {int(stem) for stem in stems if stem.isdecimal()}

    def base_number(self, key: str) -> int:
        """Return a number that was passed to `record_base`; raises DamagedFileError if the record is damaged."""
        return self._read(_BASE)["about"][key]

    def base_problems(self) -> dict[str, str]:
        """Return the recorded checksum of each damaged or missing file of the base, by path in the store.

        Raises DamagedFileError if the record itself is damaged.
        """
        files = self._read(_BASE)["files"]
        return {name: digest for name, digest in files.items() if not self._matches(name, digest)}

    def refuse_damaged_base(self) -> None:
        """Raise DamagedFileError if a file written once at creation (see `record_base`) is damaged or missing."""
        problems = list(self.base_problems())
        if problems:
            further = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
            arrived = f"a file that is damaged or missing{further}"
            raise damaged_file_error(
                self._store / problems[0], arrived, "it as anser wrote it: anser campaign with --resume makes it anew"
            )

    def chunk_problem(self, chunk: int, is_verified: Callable[[str], bool] = lambda name: True) -> str | None:
        """Describe the first damaged file of a chunk; None if the chunk is intact.

        Parameters
        ----------
        is_verified
            Function that selects the files to verify, by path in the store; by default all files.
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

    def _write(self, name: str, files: Iterable[str], parameters: Mapping[str, int]) -> None:
        digests = {file: file_digest(self._store / file) for file in files}
        document = add_checksum({"about": dict(parameters), "files": digests, "record": name})
        write_file(self._path(name), json.dumps(document, indent=0) + "\n", overwrite=True)

    def _read(self, name: str) -> dict[str, Any]:
        path = self._path(name)
        try:
            document, checked = read_document(path)
        except OSError as error:
            raise damaged_file_error(path, f"a record that cannot be read ({error.strerror})") from None
        # a renamed record is undamaged, but wrong
        if not checked or document.get("record") != name:
            raise damaged_file_error(path, "a record without its checksum, or of another chunk")
        return document

    def _path(self, name: str) -> Path:
        return self._folder / f"{name}.json"


def chunk_files(array: str, chunk: int, grid: tuple[int, ...]) -> Iterable[str]:
    """Yield the paths of the files that hold one chunk of flights of an array (Zarr format 2).

    Parameters
    ----------
    array
        Path of the array in the store.
    chunk
        Index of the chunk along the first dimension, the flights.
    grid
        Number of chunks along each dimension of the array.
    """
    for further_indices in itertools.product(*map(range, grid[1:])):
        yield f"{array}/{'.'.join(map(str, (chunk, *further_indices)))}"
