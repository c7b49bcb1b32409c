"""Base of the stores of campaigns and rare events: lock against a second writer, and checksums of the files."""

import abc
import contextlib
import fcntl
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar, Self

from anser.campaigns.study import Study, validate_study
from anser.files import write_file
from anser.results.checksums import DamagedFileError, add_checksum, damaged_file_error, file_digest, read_document
from anser.results.documents import version_attributes
from anser.scenario.schema import Scenario, validate

FORMAT = 2
"""Version of the file format of the stores of campaigns and of rare events."""
SERIES = "series"
"""Name of the Zarr group with a campaign's time series."""


class StoreError(ValueError):
    """Error of a campaign's or rare event's folder, or of the processes that fly into it; `str()` is the message."""


@contextlib.contextmanager
def folder_lock(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder in the `with` block; the operating system also releases the lock when the process ends.

    Raises StoreError if another process holds the lock, or the lock file cannot be opened or locked.
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


def store_attributes(study: Study, scenario: Scenario) -> dict[str, Any]:
    """Return the attributes of a new store: study and scenario with their hashes, and the current software versions."""
    return {
        "format_version": FORMAT,
        "title": study.name,
        "study": study.model_dump_json(exclude_unset=True),
        "study_hash": study.hash,
        "precision": study.precision,
        "scenario": scenario.model_dump_json(exclude_unset=True),
        "scenario_hash": scenario.hash,
        **version_attributes(),
    }


class AbstractFlightStore(abc.ABC):
    """Folder with the results of a study's flights; only one process at a time may write; a later process can resume.

    A chunk (flights that are flown and stored together) is complete when the checksums of its files are recorded, see
    `StoreChecksums`. The constructor raises StoreError if the folder has another format version.
    """

    description: ClassVar[str]  # name of the content in messages
    command: ClassVar[str]  # subcommand of `anser` that flies and resumes, for messages
    data_folder: ClassVar[str]  # name of the subfolder with the results

    def __init__(self, folder: Path) -> None:
        self._checksums = StoreChecksums(folder, self.data_folder)
        self.folder, self.attributes = folder, self._checksums.attributes()
        if self.attributes.get("format_version") != FORMAT:
            raise StoreError(f"{folder}: arrived {self.description} of another format; expected format {FORMAT}")
        study, scenario = (json.loads(self.attributes[key]) for key in ("study", "scenario"))
        self.study = validate_study(study, f"{folder}, study", is_stored=True)
        self.scenario = validate(scenario, f"{folder}, scenario", is_stored=True)
        self.damages: list[str] = []  # messages about damaged results that were removed and are flown again
        self._has_lock = False
        self._verified: dict[bool, set[int]] = {False: set(), True: set()}  # by whether the series are verified

    @classmethod
    def open(cls, folder: Path, *, verify_chunks: bool = True) -> Self:
        """Open the store in a folder; raises StoreError if the store is missing, damaged, or of another format.

        The files written only at creation are verified; if `verify_chunks` is True, also the results of the flights.
        Time series are verified when they are read.
        """
        if not (folder / cls.data_folder).is_dir():
            raise StoreError(
                f"{folder}: arrived a folder without {cls.data_folder}; expected that of {cls.description}"
            )
        StoreChecksums(folder, cls.data_folder).refuse_damaged_base()
        store = cls(folder)
        if verify_chunks:
            store.refuse_damaged()
        return store

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Lock the folder in the `with` block; remove damaged results, and append a message for each to `damages`.

        Nested use is allowed. Raises StoreError if another process flies into the folder, or the folder cannot be
        locked.
        """
        if self._has_lock:
            yield
            return
        with folder_lock(self.folder):
            for chunk, problem in self._chunk_problems(series=True).items():
                self._checksums.forget_chunk(chunk)
                self._last_file(chunk).unlink(missing_ok=True)
                self.damages.append(f"{self.folder}: {self._chunk_label(chunk)} is flown again: {problem}")
            self._has_lock = True
            try:
                yield
            finally:
                self._has_lock = False

    def refuse_damaged(self, *, series: bool = False) -> None:
        """Raise StoreError if a completed chunk is damaged; if `series` is True, time series are verified, too."""
        problems = self._chunk_problems(series=series)
        if problems:
            (chunk, problem), further_count = next(iter(problems.items())), len(problems) - 1
            further = f", and {further_count} more chunks are damaged" if further_count else ""
            expected = f"expected a whole store: anser {self.command} with --resume flies damaged chunks again"
            raise StoreError(
                f"{self.folder}: arrived {self._chunk_label(chunk)} of which {problem}{further}; {expected}"
            )

    def refuse_unless_same(self, study: Study, scenario: Scenario) -> None:
        """Raise StoreError if precision, study, scenario or a software version differs from the store's."""
        hashes = {"study_hash": study.hash, "scenario_hash": scenario.hash}
        self._refuse_differences({"precision": study.precision, **hashes, **version_attributes()})

    def refuse_other_versions(self) -> None:
        """Raise StoreError if a software version of this process or worker differs from the store's."""
        self._refuse_differences(version_attributes())

    def _refuse_differences(self, current: Mapping[str, object]) -> None:
        for key, value in current.items():
            if self.attributes.get(key) != value:
                difference = f"{self.description} with the {key.replace('_', ' ')} {self.attributes.get(key)}"
                raise StoreError(f"{self.folder}: arrived {difference}; expected {value}, to go on with it")

    def _chunk_problems(self, *, series: bool) -> dict[int, str]:
        """Return the problem of each damaged chunk, by chunk number; `series` includes the chunk's time series.

        Chunks that this object has already verified are not read again.
        """
        recorded, problems = self._checksums.chunks(), dict[int, str]()
        for chunk in sorted(recorded - self._verified[series]):
            problem = self._checksums.chunk_problem(chunk, lambda name: series or not name.startswith(f"{SERIES}/"))
            if problem is None:
                self._verified[series].add(chunk)
            else:
                problems[chunk] = problem
        if self._has_lock:  # chunks without a record were removed when the lock was taken; others are being written
            return problems
        # In this order: of a chunk that another process writes meanwhile, the mark ends after the record is complete.
        written = {int(path.stem) for path in self._last_file(0).parent.iterdir() if path.stem.isdecimal()}
        begun = self._checksums.begun()
        damaged = written - begun - self._checksums.chunks()
        return problems | dict.fromkeys(sorted(damaged), "the record of checksums is missing")

    @abc.abstractmethod
    def _last_file(self, chunk: int) -> Path:
        """Return the path of the file that is written last of a chunk's files."""

    @abc.abstractmethod
    def _chunk_label(self, chunk: int) -> str:
        """Return the name of a chunk for messages."""


def refuse_existing(folder: Path) -> None:
    """Raise FileExistsError if the folder intended for a new store already exists."""
    if folder.exists():
        raise FileExistsError(f"{folder} exists and is not overwritten: choose another folder, or resume")


_MARK = ".begun"
"""Suffix of the mark of a chunk that is being written."""
_BASE = "store"
"""Name of the record of the files written once at creation: metadata, coordinates, seeds, sampled values."""


class StoreChecksums:
    """Checksums of a store's files, in JSON files ("records") in the subfolder `checksums`.

    One record has the store's attributes and covers the files that are written only at creation (the "base"). Each
    chunk has its own record, written last; a chunk with a record is therefore complete. A chunk that is being written
    has a mark, which tells an interrupted chunk from one whose record was lost. Paths of files are relative to the
    subfolder `data_folder`. A damaged or missing record raises StoreError, except in `chunk_problem`.
    """

    def __init__(self, folder: Path, data_folder: str) -> None:
        self._folder, self._data_folder = folder / "checksums", folder / data_folder

    def record_base(self, attributes: Mapping[str, Any]) -> None:
        """Record the attributes of the store and the checksums of all files now in the data folder."""
        self._folder.mkdir(exist_ok=True)
        files = sorted(path for path in self._data_folder.rglob("*") if path.is_file())
        self._write(_BASE, (str(path.relative_to(self._data_folder)) for path in files), attributes)

    def begin_chunk(self, chunk: int) -> None:
        """Mark a chunk as being written, until `record_chunk`."""
        self._mark(chunk).touch()

    def begun(self) -> set[int]:
        """Return the numbers of the chunks that are being written, or whose writing was interrupted."""
        return {int(path.stem) for path in self._folder.glob(f"*{_MARK}")}

    def record_chunk(self, chunk: int, files: Iterable[str]) -> None:
        """Record the checksums of a chunk's files: the chunk is complete."""
        self._write(str(chunk), files, {})
        self._mark(chunk).unlink(missing_ok=True)

    def forget_chunk(self, chunk: int) -> None:
        """Remove the record of a chunk, which thereby counts as incomplete."""
        self._path(str(chunk)).unlink(missing_ok=True)

    def chunks(self) -> set[int]:
        """Return the numbers of the complete chunks, which are the chunks with a record."""
        stems = (path.stem for path in self._folder.glob("*.json"))
        return {int(stem) for stem in stems if stem.isdecimal()}

    def attributes(self) -> dict[str, Any]:
        """Return the attributes of the store."""
        return self._read(_BASE)["about"]

    def base_problems(self) -> dict[str, str]:
        """Return the recorded checksum of each damaged or missing file of the base, by path; empty if intact."""
        files = self._read(_BASE)["files"]
        return {name: digest for name, digest in files.items() if not self._matches(name, digest)}

    def refuse_damaged_base(self) -> None:
        """Raise StoreError if a file written once at creation (see `record_base`) is damaged or missing."""
        problems = list(self.base_problems())
        if problems:
            further = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
            arrived = f"a file that is damaged or missing{further}"
            expected = "it as anser wrote it: anser campaign with --resume makes it anew"
            raise StoreError(f"{self._data_folder / problems[0]}: arrived {arrived}; expected {expected}")

    def chunk_problem(self, chunk: int, is_verified: Callable[[str], bool]) -> str | None:
        """Describe the first damaged or missing file of a chunk, or its damaged record; None if intact.

        Only files whose paths `is_verified` selects are read.
        """
        try:
            files = self._read(str(chunk))["files"]
        except StoreError as error:
            return str(error)
        for name, digest in files.items():
            if is_verified(name) and not self._matches(name, digest):
                return (
                    f"{self._data_folder / name} is {'damaged' if (self._data_folder / name).is_file() else 'missing'}"
                )
        return None

    def _matches(self, name: str, digest: str) -> bool:
        path = self._data_folder / name
        return path.is_file() and file_digest(path) == digest

    def _write(self, name: str, files: Iterable[str], attributes: Mapping[str, Any]) -> None:
        digests = {file: file_digest(self._data_folder / file) for file in files}
        document = add_checksum({"about": dict(attributes), "files": digests, "record": name})
        write_file(self._path(name), json.dumps(document, indent=0) + "\n", overwrite=True)

    def _read(self, name: str) -> dict[str, Any]:
        path = self._path(name)
        try:
            document, has_checksum = read_document(path)
        except DamagedFileError as error:
            raise StoreError(str(error)) from None
        except OSError as error:
            raise StoreError(
                str(damaged_file_error(path, f"a record that cannot be read ({error.strerror})"))
            ) from None
        # a renamed record is undamaged, but wrong
        if not has_checksum or document.get("record") != name:
            raise StoreError(str(damaged_file_error(path, "a record without its checksum, or of another chunk")))
        return document

    def _mark(self, chunk: int) -> Path:
        return self._folder / f"{chunk}{_MARK}"

    def _path(self, name: str) -> Path:
        return self._folder / f"{name}.json"
