"""The store of a campaign.

Preallocated, written in whole chunks; a chunk is complete when its checksums are recorded. With the stopping rule of
the study (number of chunks after which the estimate is converged) and the repair of damaged base files.
"""

import contextlib
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
import zarr

from anser.campaigns.store_arrays import (
    FLOWN,
    FORMAT,
    SERIES,
    create_arrays,
    create_series,
    open_arrays,
    series_bytes,
    series_dataset,
    to_fixed_width,
    write_every_chunk,
    write_series,
)
from anser.campaigns.store_integrity import StoreChecksums, StoreError, chunk_files, folder_lock
from anser.campaigns.study import Study, select_series, validate_study
from anser.config.errors import ScenarioError
from anser.results.checksums import DamagedFileError, file_digest
from anser.results.documents import version_attributes
from anser.results.flight_rows import FlightRow, tabulate_flights, worst_of_fleet
from anser.results.sampling_statistics import order_statistic_interval, wilson_interval
from anser.results.separation import separation_attributes
from anser.scenario.schema import Scenario, validate


def count_converged_chunks(
    study: Study, done: np.ndarray, chunk: int, values: np.ndarray, since: int = 0
) -> int | None:
    """How many of the first chunks are enough; None where the study does not say, or they are not yet.

    Looked at after each chunk in their order, whichever was complete first: so it does not depend on how many fly at a
    time. An interval that is looked at again and again covers somewhat less often than its confidence says.

    Parameters
    ----------
    study
        With its rule.
    done
        Whether each chunk is complete.
    chunk
        Flights of a chunk.
    values
        Of the rule's statistic, one for each flight; infinite where it is infinitely bad.
    since
        Chunks of which it is known that they are not enough.
    """
    until = study.until
    if until is None:
        return None
    for count in range(since + 1, complete_prefix(done) + 1):
        flights = min(count * chunk, values.size)
        if flights < until.at_least:
            continue
        low, high = _interval(study, values[:flights])
        if high - low <= until.width:
            return count
    return None


def complete_prefix(done: np.ndarray) -> int:
    """How many chunks are complete without one missing before them."""
    return done.size if done.all() else int(np.argmin(done))


def _interval(study: Study, values: np.ndarray) -> tuple[float, float]:
    assert study.until is not None
    if study.until.statistic == "met":
        return wilson_interval(int(np.sum(values)), values.size, study.answers.confidence)
    low, high = order_statistic_interval(values, study.until.share, study.answers.confidence)
    # both infinite: all that is known is that it is the worst
    return (low, high) if np.isfinite(low) else (-np.inf, np.inf)


_UNCHECKED = 1
"""Format without checksums, which is read, but not gone on with."""
STORE_FOLDER = "flights.zarr"
_DONE = "chunk_done"
"""Marks of complete chunks in the format without checksums."""
_UNREADABLE = OSError, ValueError, KeyError, TypeError, AttributeError, IndexError, RuntimeError
"""What Zarr and its codecs raise where a store without checksums is damaged."""
_SPARE = 2.0
"""How much more space there must be than the store takes uncompressed."""


class CampaignStore:
    """Values applied and what came of every flight, in a folder; open one with `create` or `open`.

    ``xarray.open_zarr(folder / "flights.zarr")`` reads it as well, with every flight and whether it was `flown`;
    `dataset` holds those that were. A chunk is complete when the checksums of its files are recorded.

    Attributes
    ----------
    folder
        Of the campaign.
    study, scenario
        What is flown.
    chunk
        Flights of a chunk.
    kept
        Variables that are kept over time; None: none are.
    damages
        Messages about damaged chunks, which are to be flown again.
    """

    def __init__(self, folder: Path, group: zarr.Group) -> None:
        self.folder, self._group = folder, group
        self._checksums = StoreChecksums(folder, STORE_FOLDER)
        self._verified: dict[bool, set[int]] = {False: set(), True: set()}  # chunks, without and with their series
        self._has_lock = False
        self.damages: list[str] = []
        about: dict[str, Any] = dict(group.attrs)
        self.study = validate_study(json.loads(about["study"]), f"{folder}, study")
        self.scenario = validate(json.loads(about["scenario"]), f"{folder}, scenario")
        self.chunk = int(about["chunk"])
        self._unconverged_chunks = 0  # chunks that were looked at: each look sorts all flights so far
        self.series_selection = select_series(self.study.keep, self.scenario)
        self.versions = {key: value for key, value in about.items() if key.startswith("version_")}

    @classmethod
    def create(
        cls,
        folder: Path,
        study: Study,
        scenario: Scenario,
        applied: Mapping[str, np.ndarray],
        seeds: np.ndarray,
        chunk: int,
    ) -> "CampaignStore":
        """Make the store in a folder that exists.

        Parameters
        ----------
        folder
            Without a store so far.
        study, scenario
            What is to be flown.
        applied
            By path of the scenario, what is put there in each flight.
        seeds
            Of each flight.
        chunk
            Flights that are written at once.

        Raises
        ------
        StoreError
            There is not enough space.
        """
        kept = select_series(study.keep, scenario)
        flights, names = seeds.size, [one.name for one in scenario.aircraft]
        columns = tabulate_flights([FlightRow.failed_start("")], len(names))
        sized = {name: to_fixed_width(name, column) for name, column in columns.items()}
        needed = flights * sum(one[1][0].nbytes for one in sized.values()) + sum(one.nbytes for one in applied.values())
        needed += 0 if kept is None else flights * series_bytes(kept, scenario)
        free = shutil.disk_usage(folder).free
        if free < _SPARE * needed:
            words = f"arrived a disk with {free / 1e6:.3f} MB free; expected {_SPARE * needed / 1e6:.3f} MB"
            raise StoreError(f"{folder}: {words}")
        with write_every_chunk():
            group = create_arrays(folder / STORE_FOLDER, study, scenario, applied, seeds, chunk, sized)
            if kept is not None:
                create_series(group, kept, scenario, flights, chunk)
        zarr.consolidate_metadata(group.store)
        StoreChecksums(folder, STORE_FOLDER).record_base({"chunk": chunk})
        return cls(folder, group)

    @classmethod
    def open(cls, folder: Path, *, verify_chunks: bool = True) -> "CampaignStore":
        """Open the store of a folder, and verify its files; those of the series are verified when they are read.

        Parameters
        ----------
        folder
            Of the campaign.
        verify_chunks
            Whether to verify the chunks, too, not only what is written once.

        Raises
        ------
        StoreError
            There is none, or one of another format, or one with a damaged file.
        """
        if not (folder / STORE_FOLDER).is_dir():
            raise StoreError(f"{folder}: arrived a folder without {STORE_FOLDER}; expected that of a campaign")
        checksums = StoreChecksums(folder, STORE_FOLDER)
        if checksums.has_records:
            with _damage_as_store_error():
                checksums.refuse_damaged_base()
        try:
            group = zarr.open_group(folder / STORE_FOLDER, mode="r+")
            version = group.attrs.get("format_version")
            if version != (FORMAT if checksums.has_records else _UNCHECKED) or not (
                checksums.has_records or _DONE in group
            ):
                words = f"a store of format {version}{'' if checksums.has_records else ' without checksums'}"
                raise StoreError(f"{folder}: arrived {words}; expected one of format {FORMAT}, with its checksums")
            store = cls(folder, group)
        except (StoreError, ScenarioError):
            raise
        except _UNREADABLE as error:
            raise StoreError(f"{folder}: arrived a store that cannot be read ({error}); expected a whole one") from None
        if verify_chunks:
            store.refuse_damaged()
        return store

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Let no other process fly this campaign meanwhile; damaged chunks are then no longer complete.

        Raises
        ------
        StoreError
            Another process flies it, or its format has no checksums.
        """
        if self._has_lock:
            yield
            return
        if not self._checksums.has_records:
            words = f"a campaign of format {_UNCHECKED}, which can only be read; expected one of format {FORMAT}"
            raise StoreError(f"{self.folder}: arrived {words}, to go on with it")
        with folder_lock(self.folder):
            self._forget_damaged()
            self._has_lock = True
            try:
                yield
            finally:
                self._has_lock = False

    def refuse_damaged(self, *, series: bool = False) -> None:
        """Refuse a store with a damaged chunk (StoreError), without its series or with them."""
        problems = self._chunk_problems(series=series)
        if problems:
            (first, problem), more = next(iter(problems.items())), len(problems) - 1
            others = f", and {more} more chunks are damaged" if more else ""
            words = "expected a whole store: anser campaign with --resume flies damaged chunks again"
            raise StoreError(f"{self.folder}: arrived {self._chunk_label(first)} of which {problem}{others}; {words}")

    def _forget_damaged(self) -> None:
        for chunk, problem in self._chunk_problems(series=True).items():
            self._checksums.forget_chunk(chunk)
            (self.folder / STORE_FOLDER / FLOWN / str(chunk)).unlink(missing_ok=True)
            self.damages.append(f"{self.folder}: {self._chunk_label(chunk)} is flown again: {problem}")

    def _chunk_problems(self, *, series: bool) -> dict[int, str]:
        """Chunks that are damaged, with what is wrong; those that were whole before are not looked at again."""
        if not self._checksums.has_records:
            return {}
        selected: Callable[[str], bool] = (
            (lambda _: True) if series else (lambda name: not name.startswith(f"{SERIES}/"))
        )
        recorded, problems = self._checksums.chunks(), dict[int, str]()
        for chunk in sorted(recorded - self._verified[series]):
            problem = self._checksums.chunk_problem(chunk, selected)
            if problem is None:
                self._verified[series].add(chunk)
            else:
                problems[chunk] = problem
        if self._has_lock:  # one that was being written when the campaign was stopped is not complete, nor damaged
            return problems
        flown = {int(path.name) for path in (self.folder / STORE_FOLDER / FLOWN).iterdir() if path.name.isdecimal()}
        return problems | dict.fromkeys(sorted(flown - self._checksums.chunks()), "the record of checksums is missing")

    def _chunk_label(self, chunk: int) -> str:
        rows = self.chunk_slice(chunk)
        return f"chunk {chunk} (flights {rows.start} to {rows.stop - 1})"

    @property
    def flights(self) -> int:
        """How many flights the campaign has."""
        return self._array("flight").shape[0]

    @property
    def chunk_is_complete(self) -> np.ndarray:
        """Whether each chunk is complete."""
        if not self._checksums.has_records:
            return np.asarray(self._array(_DONE)[:]) == 1
        return np.isin(np.arange(-(-self.flights // self.chunk)), list(self._checksums.chunks()))

    @property
    def converged_chunks(self) -> int | None:
        """How many of the first chunks are enough by the study's rule; None where they are not, or it has none."""
        if self.study.until is None:
            return None
        statistic = self.study.until.statistic
        columns = {name: np.asarray(self._array(name)[:]) for name in {"met", "miss_m", statistic}}
        values = columns["met"] if statistic == "met" else worst_of_fleet(columns, statistic)
        done = self.chunk_is_complete
        found = count_converged_chunks(self.study, done, self.chunk, values, self._unconverged_chunks)
        if found is None:
            self._unconverged_chunks = complete_prefix(done)
        return found

    @property
    def flown(self) -> np.ndarray:
        """Numbers of the flights that count: those of complete chunks, as far as the study's rule asks for them."""
        counts, stop = self.chunk_is_complete, self.converged_chunks
        if stop is not None:
            counts = counts & (np.arange(counts.size) < stop)
        return np.flatnonzero(np.repeat(counts, self.chunk)[: self.flights])

    @property
    def varied(self) -> list[str]:
        """Paths of what varies."""
        return json.loads(str(self._group.attrs["varied"]))

    def chunk_slice(self, chunk: int) -> slice:
        """Flights of a chunk."""
        return slice(chunk * self.chunk, min((chunk + 1) * self.chunk, self.flights))

    def applied(self, flights: slice) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Seeds of some flights, and what is put into their scenarios, by path."""
        return np.asarray(self._array("seed")[flights]), {
            path: np.asarray(self._array(path)[flights]) for path in self.varied
        }

    def write(self, chunk: int, rows: list[FlightRow]) -> None:
        """Write a chunk, and record its checksums when all of it is on the disk."""
        place, columns = self.chunk_slice(chunk), tabulate_flights(rows, len(self.scenario.aircraft))
        names = [*columns, FLOWN]
        with write_every_chunk():
            for name, column in columns.items():
                self._array(name)[place] = to_fixed_width(name, column)[1]
            if self.series_selection is not None:
                names += [f"{SERIES}/{name}" for name in write_series(self._group, self.series_selection, place, rows)]
            os.sync()  # or the record could outlive a power cut that its chunk does not
            self._array(FLOWN)[place] = True
        files = (file for name in names for file in chunk_files(name, chunk, self._array(name).cdata_shape))
        self._checksums.record_chunk(chunk, files)

    def refuse_unless_same(self, study: Study, scenario: Scenario, applied: Mapping[str, np.ndarray]) -> None:
        """Refuse to go on with another study, scenario, value or version of what numbers depend on (StoreError)."""
        about = self._group.attrs
        self._refuse_others(precision=(about.get("precision", "float64"), study.precision))
        self._refuse_others(study=(about["study_hash"], study.hash))
        self._refuse_others(scenario=(about["scenario_hash"], scenario.hash))
        self.refuse_other_versions()
        kept = self.applied(slice(None))[1]
        same = [path for path, values in applied.items() if path in kept and np.array_equal(kept[path], values)]
        if list(kept) != same:
            words = "arrived a campaign with other values; expected those of the study, to go on with it"
            raise StoreError(f"{self.folder}: {words}")

    def refuse_other_versions(self) -> None:
        """Refuse to go on with other versions of what numbers depend on (StoreError): here, or on a worker."""
        self._refuse_others(**{key: (self.versions.get(key), value) for key, value in version_attributes().items()})

    def _refuse_others(self, **pairs: tuple[Any, Any]) -> None:
        for what, (found, wanted) in pairs.items():
            if found != wanted:
                words = f"{what.replace('_', ' ')} {found}"
                raise StoreError(
                    f"{self.folder}: arrived a campaign with the {words}; expected {wanted}, to go on with it"
                )

    def dataset(self) -> xr.Dataset:
        """All flights of complete chunks, labelled: dimensions flight and aircraft."""
        self.refuse_damaged()
        try:
            with open_arrays(self.folder / STORE_FOLDER) as data:
                found = data.drop_vars([FLOWN, _DONE], errors="ignore").isel(flight=self.flown).load()
        except _UNREADABLE as error:
            words = f"arrived a store that cannot be read ({error}); expected a whole one"
            raise StoreError(f"{self.folder}: {words}") from None
        attributes = {"confidence": self.study.answers.confidence, "precision": self.study.precision}
        attributes |= separation_attributes(self.scenario)
        return found.set_coords(["flight", "aircraft"]).assign_attrs(attributes)

    def series(self) -> xr.Dataset:
        """What was kept over time of all flights of complete chunks; dimensions flight, aircraft and time.

        Read when it is asked for. Quantities are float32, NaN where there is none; codes and truth values int32, -1
        where there is none.

        Raises
        ------
        StoreError
            The study keeps none, or a file of the series is damaged.
        """
        if self.series_selection is None:
            words = 'a study that keeps some, such as [keep] series = ["position_error", "airspeed"]'
            raise StoreError(f"{self.folder}: arrived a campaign without series; expected one of {words}")
        self.refuse_damaged(series=True)
        return series_dataset(self.folder / STORE_FOLDER, self.flown)

    def read_series_chunks(self, name: str, flights: np.ndarray) -> Iterator[np.ndarray]:
        """One variable of some flights over time, chunk by chunk: shape (flights of the chunk, aircraft, times)."""
        self.refuse_damaged(series=True)
        array = self._array(f"{SERIES}/{name}")
        for chunk in np.unique(flights // self.chunk):
            rows = self.chunk_slice(int(chunk))
            some = flights[flights // self.chunk == chunk]
            yield np.asarray(array[rows])[some - rows.start]

    def _array(self, name: str) -> zarr.Array:
        found = self._group[name]
        assert isinstance(found, zarr.Array)
        return found


@contextlib.contextmanager
def _damage_as_store_error() -> Iterator[None]:
    try:
        yield
    except DamagedFileError as error:
        raise StoreError(str(error)) from None


def repair_base(
    folder: Path, study: Study, scenario: Scenario, applied: Mapping[str, np.ndarray], seeds: np.ndarray
) -> tuple[str, ...]:
    """Make damaged metadata, coordinates, seeds and sampled values of a store anew, where they come out as recorded.

    Parameters
    ----------
    folder
        Of the campaign.
    study, scenario, applied, seeds
        As `CampaignStore.create` takes them.

    Returns
    -------
    Paths of the files that were made anew.

    Raises
    ------
    StoreError
        The record of checksums is damaged, or a file comes out otherwise: of another study or version.
    """
    checksums = StoreChecksums(folder, STORE_FOLDER)
    if not checksums.has_records:
        return ()
    try:
        problems, chunk = checksums.base_problems(), checksums.base_number("chunk")
    except DamagedFileError as error:
        raise StoreError(str(error)) from None
    if not problems:
        return ()
    with tempfile.TemporaryDirectory(dir=folder, prefix=".anser-") as place:
        CampaignStore.create(Path(place), study, scenario, applied, seeds, chunk)
        anew = Path(place) / STORE_FOLDER
        for name, digest in problems.items():
            if not (anew / name).is_file() or file_digest(anew / name) != digest:
                words = "a damaged file that this study and version do not make anew; expected those of the campaign"
                raise StoreError(f"{folder / STORE_FOLDER / name}: arrived {words}, to go on with it")
        for name in problems:
            target = folder / STORE_FOLDER / name
            target.parent.mkdir(parents=True, exist_ok=True)
            (anew / name).replace(target)
    return tuple(str(folder / STORE_FOLDER / name) for name in problems)
