"""Store of a campaign: results of every flight in Zarr arrays in a folder.

The arrays are allocated for all flights at the start and filled in chunks of flights. A chunk is complete when the
checksums of its files are recorded. The module also evaluates the study's stopping rule (the number of chunks after
which the estimate is precise enough) and repairs damaged files that were written once, when the store was created.
"""

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
from anser.campaigns.store_integrity import (
    FORMAT,
    UNCHECKED_FORMAT,
    AbstractFlightStore,
    StoreChecksums,
    StoreError,
    chunk_files,
    damage_as_store_error,
)
from anser.campaigns.study import Study, select_series, validate_study
from anser.config.errors import ScenarioError
from anser.results.checksums import file_digest
from anser.results.documents import version_attributes
from anser.results.flight_rows import FlightRow, tabulate_flights, worst_of_fleet
from anser.results.sampling_statistics import order_statistic_interval, wilson_interval
from anser.results.separation import separation_attributes
from anser.scenario.schema import Scenario, validate


def count_converged_chunks(
    study: Study, is_complete: np.ndarray, chunk: int, values: np.ndarray, unconverged: int = 0
) -> int | None:
    """Return how many leading chunks first satisfy the study's stopping rule; None without a rule or if unsatisfied.

    The rule is evaluated after each chunk in order of chunk numbers, so the result is independent of the number of
    parallel processes. With repeated evaluation an interval's coverage is slightly below its confidence level.

    Parameters
    ----------
    is_complete
        Whether each chunk is complete; shape (chunks,).
    chunk
        Number of flights per chunk.
    values
        Values of the rule's statistic, one per flight; infinite for the worst possible outcome.
    unconverged
        Number of leading chunks for which an earlier evaluation has already failed; not evaluated again.
    """
    rule = study.until
    if rule is None:
        return None
    for count in range(unconverged + 1, complete_prefix(is_complete) + 1):
        flights = min(count * chunk, values.size)
        if flights < rule.at_least:
            continue
        low, high = _interval(study, values[:flights])
        if high - low <= rule.width:
            return count
    return None


def complete_prefix(is_complete: np.ndarray) -> int:
    """Return the number of complete chunks before the first incomplete chunk."""
    return is_complete.size if is_complete.all() else int(np.argmin(is_complete))


def _interval(study: Study, values: np.ndarray) -> tuple[float, float]:
    """Return the confidence interval of the stopping rule's statistic over the given flights: lower and upper bound."""
    assert study.until is not None
    if study.until.statistic == "met":
        return wilson_interval(int(np.sum(values)), values.size, study.answers.confidence)
    low, high = order_statistic_interval(values, study.until.share, study.answers.confidence)
    # both infinite: the quantile is only known to be the worst possible
    return (low, high) if np.isfinite(low) else (-np.inf, np.inf)


STORE_FOLDER = "flights.zarr"
_DONE = "chunk_done"
"""Completion marks of chunks in the format without checksums."""
_UNREADABLE = OSError, ValueError, KeyError, TypeError, AttributeError, IndexError, RuntimeError
"""Exceptions of Zarr and its codecs for a damaged store without checksums."""
_SPARE = 2.0
"""Required free disk space over the uncompressed size of the store."""


class CampaignStore(AbstractFlightStore):
    """Store of a campaign in a folder: the sampled values and the results of every flight; see `create` and `open`.

    The store is also readable by ``xarray.open_zarr(folder / "flights.zarr")``, with every flight and the flag `flown`;
    `dataset` returns completed flights only. A chunk is complete when the checksums of its files are recorded.

    Attributes
    ----------
    chunk
        Flights per chunk.
    series_selection
        Variables stored over time; None if the study selects none.
    versions
        Software versions with which the store was created, by name.
    folder, study, scenario, format, damages
        See `AbstractFlightStore`.
    """

    description = "a campaign"

    def __init__(self, folder: Path, group: zarr.Group) -> None:
        attributes: dict[str, Any] = dict(group.attrs)
        study = validate_study(json.loads(attributes["study"]), f"{folder}, study")
        scenario = validate(json.loads(attributes["scenario"]), f"{folder}, scenario")
        super().__init__(folder, study, scenario, int(attributes["format_version"]))
        self._group = group
        self._checksums = StoreChecksums(folder, STORE_FOLDER)
        self._verified: dict[bool, set[int]] = {
            False: set(),
            True: set(),
        }  # chunks, by whether their series are verified
        self.chunk = int(attributes["chunk"])
        self._unconverged_chunks = 0  # evaluated chunks: each evaluation sorts every flight so far
        self.series_selection = select_series(self.study.keep, self.scenario)
        self.versions = {key: value for key, value in attributes.items() if key.startswith("version_")}

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
        """Create the store in an existing folder.

        Parameters
        ----------
        applied
            Sampled values as applied to the scenario, one per flight, by key path.
        seeds
            Seed of each flight.
        chunk
            Number of flights per chunk.

        Raises
        ------
        StoreError
            The disk space is insufficient.
        """
        selection = select_series(study.keep, scenario)
        flights, names = seeds.size, [item.name for item in scenario.aircraft]
        columns = tabulate_flights([FlightRow.failed_start("")], len(names))
        sized = {name: to_fixed_width(name, column) for name, column in columns.items()}
        required_bytes = flights * sum(item[1][0].nbytes for item in sized.values()) + sum(
            item.nbytes for item in applied.values()
        )
        required_bytes += 0 if selection is None else flights * series_bytes(selection, scenario)
        free_bytes = shutil.disk_usage(folder).free
        if free_bytes < _SPARE * required_bytes:
            detail = (
                f"arrived a disk with {free_bytes / 1e6:.3f} MB free; expected {_SPARE * required_bytes / 1e6:.3f} MB"
            )
            raise StoreError(f"{folder}: {detail}")
        with write_every_chunk():
            group = create_arrays(folder / STORE_FOLDER, study, scenario, applied, seeds, chunk, sized)
            if selection is not None:
                create_series(group, selection, scenario, flights, chunk)
        zarr.consolidate_metadata(group.store)
        StoreChecksums(folder, STORE_FOLDER).record_base({"chunk": chunk})
        return cls(folder, group)

    @classmethod
    def open(cls, folder: Path, *, verify_chunks: bool = True) -> "CampaignStore":
        """Open the store of a folder and verify its files; time series are verified later, when they are read.

        Parameters
        ----------
        verify_chunks
            Whether to verify the results of the flights (chunks) in addition to the files written once at creation.

        Raises
        ------
        StoreError
            The store is missing, has another format, or has a damaged file.
        """
        if not (folder / STORE_FOLDER).is_dir():
            raise StoreError(f"{folder}: arrived a folder without {STORE_FOLDER}; expected that of a campaign")
        checksums = StoreChecksums(folder, STORE_FOLDER)
        if checksums.has_records:
            with damage_as_store_error():
                checksums.refuse_damaged_base()
        try:
            group = zarr.open_group(folder / STORE_FOLDER, mode="r+")
            version = group.attrs.get("format_version")
            if version != (FORMAT if checksums.has_records else UNCHECKED_FORMAT) or not (
                checksums.has_records or _DONE in group
            ):
                found_format = f"a store of format {version}{'' if checksums.has_records else ' without checksums'}"
                raise StoreError(
                    f"{folder}: arrived {found_format}; expected one of format {FORMAT}, with its checksums"
                )
            store = cls(folder, group)
        except (StoreError, ScenarioError):
            raise
        except _UNREADABLE as error:
            raise StoreError(f"{folder}: arrived a store that cannot be read ({error}); expected a whole one") from None
        if verify_chunks:
            store.refuse_damaged()
        return store

    def refuse_damaged(self, *, series: bool = False) -> None:
        """Raise StoreError if a chunk is damaged, optionally including its series."""
        problems = self._chunk_problems(series=series)
        if problems:
            (chunk, problem), further_count = next(iter(problems.items())), len(problems) - 1
            further = f", and {further_count} more chunks are damaged" if further_count else ""
            expected = "expected a whole store: anser campaign with --resume flies damaged chunks again"
            raise StoreError(
                f"{self.folder}: arrived {self._chunk_label(chunk)} of which {problem}{further}; {expected}"
            )

    def _remove_damaged(self) -> list[str]:
        problems = self._chunk_problems(series=True)
        for chunk in problems:
            self._checksums.forget_chunk(chunk)
            (self.folder / STORE_FOLDER / FLOWN / str(chunk)).unlink(missing_ok=True)
        return [
            f"{self.folder}: {self._chunk_label(chunk)} is flown again: {problem}"
            for chunk, problem in problems.items()
        ]

    def _chunk_problems(self, *, series: bool) -> dict[int, str]:
        """Return the problem of each damaged chunk, by chunk number; `series` includes the chunk's time series.

        Chunks that this object has already verified are not read again.
        """
        if not self._checksums.has_records:
            return {}
        is_selected: Callable[[str], bool] = (
            (lambda _: True) if series else (lambda name: not name.startswith(f"{SERIES}/"))
        )
        recorded, problems = self._checksums.chunks(), dict[int, str]()
        for chunk in sorted(recorded - self._verified[series]):
            problem = self._checksums.chunk_problem(chunk, is_selected)
            if problem is None:
                self._verified[series].add(chunk)
            else:
                problems[chunk] = problem
        if self._has_lock:  # a chunk interrupted while being written is incomplete, not damaged
            return problems
        flown = {int(path.name) for path in (self.folder / STORE_FOLDER / FLOWN).iterdir() if path.name.isdecimal()}
        return problems | dict.fromkeys(sorted(flown - self._checksums.chunks()), "the record of checksums is missing")

    def _chunk_label(self, chunk: int) -> str:
        flights = self.chunk_slice(chunk)
        return f"chunk {chunk} (flights {flights.start} to {flights.stop - 1})"

    @property
    def flights(self) -> int:
        """Number of flights of the campaign."""
        return self._array("flight").shape[0]

    @property
    def chunk_is_complete(self) -> np.ndarray:
        """Whether each chunk is complete."""
        if not self._checksums.has_records:
            return np.asarray(self._array(_DONE)[:]) == 1
        return np.isin(np.arange(-(-self.flights // self.chunk)), list(self._checksums.chunks()))

    @property
    def converged_chunks(self) -> int | None:
        """Number of leading chunks that first satisfies the stopping rule; None without a rule or if unsatisfied."""
        if self.study.until is None:
            return None
        statistic = self.study.until.statistic
        columns = {name: np.asarray(self._array(name)[:]) for name in {"met", "miss_m", statistic}}
        values = columns["met"] if statistic == "met" else worst_of_fleet(columns, statistic)
        is_complete = self.chunk_is_complete
        count = count_converged_chunks(self.study, is_complete, self.chunk, values, self._unconverged_chunks)
        if count is None:
            self._unconverged_chunks = complete_prefix(is_complete)
        return count

    @property
    def flown(self) -> np.ndarray:
        """Numbers of the completed flights that count in the results.

        With a satisfied stopping rule, only the flights up to the chunk that satisfied it.
        """
        is_counted, stop = self.chunk_is_complete, self.converged_chunks
        if stop is not None:
            is_counted = is_counted & (np.arange(is_counted.size) < stop)
        return np.flatnonzero(np.repeat(is_counted, self.chunk)[: self.flights])

    @property
    def varied(self) -> list[str]:
        """Key paths of the varied parameters in the scenario."""
        return json.loads(str(self._group.attrs["varied"]))

    def chunk_slice(self, chunk: int) -> slice:
        """Return the range of flight numbers of a chunk."""
        return slice(chunk * self.chunk, min((chunk + 1) * self.chunk, self.flights))

    def applied(self, flights: slice) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Return the seeds of a range of flights, and their sampled values by key path."""
        return np.asarray(self._array("seed")[flights]), {
            path: np.asarray(self._array(path)[flights]) for path in self.varied
        }

    def write(self, chunk: int, flight_rows: list[FlightRow]) -> None:
        """Write the results of a chunk's flights; its checksums are recorded only when the data are on disk."""
        flights, columns = self.chunk_slice(chunk), tabulate_flights(flight_rows, len(self.scenario.aircraft))
        names = [*columns, FLOWN]
        with write_every_chunk():
            for name, column in columns.items():
                self._array(name)[flights] = to_fixed_width(name, column)[1]
            if self.series_selection is not None:
                names += [
                    f"{SERIES}/{name}"
                    for name in write_series(self._group, self.series_selection, flights, flight_rows)
                ]
            os.sync()  # otherwise a power cut could destroy the chunk but not the record
            self._array(FLOWN)[flights] = True
        files = (file for name in names for file in chunk_files(name, chunk, self._array(name).cdata_shape))
        self._checksums.record_chunk(chunk, files)

    def refuse_unless_same(self, study: Study, scenario: Scenario, applied: Mapping[str, np.ndarray]) -> None:
        """Raise StoreError if the study cannot be continued in this store.

        The study, scenario, sampled values, precision and the software versions that affect results must equal the
        store's.
        """
        self._refuse_differences(
            {"precision": "float64", **dict(self._group.attrs)},
            {"precision": study.precision, "study_hash": study.hash, "scenario_hash": scenario.hash},
        )
        self.refuse_other_versions()
        stored = self.applied(slice(None))[1]
        unchanged = [
            path for path, values in applied.items() if path in stored and np.array_equal(stored[path], values)
        ]
        if list(stored) != unchanged:
            raise StoreError(
                f"{self.folder}: arrived a campaign with other values; expected those of the study, to go on with it"
            )

    def refuse_other_versions(self) -> None:
        """Raise StoreError if a software version that affects results differs from the store's, here or on a worker."""
        self._refuse_differences(self.versions, version_attributes())

    def dataset(self) -> xr.Dataset:
        """Return the completed flights as a labelled dataset with the dimensions flight and aircraft."""
        self.refuse_damaged()
        try:
            with open_arrays(self.folder / STORE_FOLDER) as data:
                flights = data.drop_vars([FLOWN, _DONE], errors="ignore").isel(flight=self.flown).load()
        except _UNREADABLE as error:
            detail = f"arrived a store that cannot be read ({error}); expected a whole one"
            raise StoreError(f"{self.folder}: {detail}") from None
        attributes = {"confidence": self.study.answers.confidence, "precision": self.study.precision}
        attributes |= separation_attributes(self.scenario)
        return flights.set_coords(["flight", "aircraft"]).assign_attrs(attributes)

    def series(self) -> xr.Dataset:
        """Return the time series of completed flights, read when used; dimensions flight, aircraft and time.

        Quantities are float32, NaN if missing; codes and flags are int32, -1 if missing.

        Raises
        ------
        StoreError
            The study selects no series, or a file of the series is damaged.
        """
        if self.series_selection is None:
            expected = 'a study that keeps some, such as [keep] series = ["position_error", "airspeed"]'
            raise StoreError(f"{self.folder}: arrived a campaign without series; expected one of {expected}")
        self.refuse_damaged(series=True)
        return series_dataset(self.folder / STORE_FOLDER, self.flown)

    def read_series_chunks(self, name: str, flights: np.ndarray) -> Iterator[np.ndarray]:
        """Yield one variable of the given flights over time, by chunk: shape (selected flights, aircraft, times)."""
        self.refuse_damaged(series=True)
        array = self._array(f"{SERIES}/{name}")
        for chunk in np.unique(flights // self.chunk):
            chunk_flights = self.chunk_slice(int(chunk))
            selected = flights[flights // self.chunk == chunk]
            yield np.asarray(array[chunk_flights])[selected - chunk_flights.start]

    def _array(self, name: str) -> zarr.Array:
        array = self._group[name]
        assert isinstance(array, zarr.Array)
        return array


def repair_base(
    folder: Path, study: Study, scenario: Scenario, applied: Mapping[str, np.ndarray], seeds: np.ndarray
) -> tuple[str, ...]:
    """Rebuild the damaged files that were written once, when the store was created, from the study and scenario.

    These are metadata, coordinates, seeds and sampled values. A file is replaced only if the rebuilt file matches the
    recorded checksum.

    Returns
    -------
    Paths of the rebuilt files.

    Raises
    ------
    StoreError
        The record of checksums is damaged, or a rebuilt file differs from the record, because of another study or
        version.
    """
    checksums = StoreChecksums(folder, STORE_FOLDER)
    if not checksums.has_records:
        return ()
    with damage_as_store_error():
        problems, chunk = checksums.base_problems(), checksums.base_number("chunk")
    if not problems:
        return ()
    with tempfile.TemporaryDirectory(dir=folder, prefix=".anser-") as temporary_folder:
        CampaignStore.create(Path(temporary_folder), study, scenario, applied, seeds, chunk)
        rebuilt = Path(temporary_folder) / STORE_FOLDER
        for name, digest in problems.items():
            if not (rebuilt / name).is_file() or file_digest(rebuilt / name) != digest:
                detail = "a damaged file that this study and version do not make anew; expected those of the campaign"
                raise StoreError(f"{folder / STORE_FOLDER / name}: arrived {detail}, to go on with it")
        for name in problems:
            target = folder / STORE_FOLDER / name
            target.parent.mkdir(parents=True, exist_ok=True)
            (rebuilt / name).replace(target)
    return tuple(str(folder / STORE_FOLDER / name) for name in problems)
