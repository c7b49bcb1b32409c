"""Store of a campaign: results of every flight in Zarr arrays in a folder.

The arrays are filled in chunks: consecutive flights that one process flies and stores together. The module also
evaluates the study's stopping rule and rebuilds damaged files that are written only at creation.
"""

import contextlib
import itertools
import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
import xarray as xr
import zarr

from anser.campaigns.store_integrity import SERIES, AbstractFlightStore, StoreChecksums, StoreError, store_attributes
from anser.campaigns.study import Study, select_series
from anser.missions.flight_outputs import OutputRecording
from anser.missions.series import SeriesSelection
from anser.results.arrival import THEN
from anser.results.checksums import file_digest
from anser.results.flight_rows import FlightColumn, FlightRow, tabulate_flights, worst_of_fleet
from anser.results.sampling_statistics import order_statistic_interval, wilson_interval
from anser.results.separation import separation_attributes
from anser.results.variable_labels import (
    catalogue_attributes,
    catalogue_variable,
    is_quantity,
    missing_series,
    record_coordinates,
)
from anser.scenario.schema import Scenario


def count_converged_chunks(
    study: Study,
    is_complete: np.ndarray,  # whether each chunk is complete; shape (chunks,)
    chunk: int,  # number of flights per chunk
    values: np.ndarray,  # values of the rule's statistic, one per flight; infinite for the worst possible outcome
    # number of leading chunks for which an earlier evaluation has already failed; not evaluated again
    unconverged: int = 0,
) -> int | None:
    """Return the least number of leading chunks that satisfies the stopping rule; None if unsatisfied or without rule.

    The rule requires a minimum number of flights, and a confidence interval no wider than the rule's width. Repeated
    evaluation lowers the interval's coverage slightly below its confidence level.
    """
    rule = study.until
    if rule is None:
        return None
    # chunk by chunk: the result does not depend on the number of parallel processes
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
    """Return the confidence interval of the stopping rule's statistic over the flights with `values`."""
    assert study.until is not None
    if study.until.statistic == "met":
        return wilson_interval(int(np.sum(values)), values.size, study.answers.confidence)
    low, high = order_statistic_interval(values, study.until.share, study.answers.confidence)
    # both infinite: the quantile is only known to be the worst possible
    return (low, high) if np.isfinite(low) else (-np.inf, np.inf)


FLOWN = "flown"
_SPARE = 2.0
"""Required ratio of free disk space to the uncompressed size of the store."""


class CampaignStore(AbstractFlightStore):
    """Store of a campaign in a folder: the sampled values and the results of every flight; see `create` and `open`.

    The store is also readable by ``xarray.open_zarr(folder / "flights.zarr")``, with every planned flight and the flag
    `flown`; `dataset` returns completed flights only.
    """

    description, command, data_folder = "a campaign", "campaign", "flights.zarr"

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._group = zarr.open_group(folder / self.data_folder, mode="r+")
        self.chunk = int(self.attributes["chunk"])  # flights per chunk
        self._unconverged_chunks = 0  # leading chunks for which the stopping rule has already failed
        self.series_selection = select_series(self.study.keep, self.scenario)
        self.output_recording = OutputRecording.of_study(self.study.output, self.scenario)

    @classmethod
    def create(
        cls,
        folder: Path,
        study: Study,
        scenario: Scenario,
        applied: Mapping[str, np.ndarray],  # sampled values as applied to the scenario, one per flight, by key path
        seeds: np.ndarray,  # seed of each flight
        chunk: int,  # number of flights per chunk
    ) -> Self:
        """Create the store in an existing folder; raises StoreError if the disk space is insufficient."""
        columns = _result_columns([FlightRow.failed_start("")], study, scenario)
        selection = select_series(study.keep, scenario)
        flight_bytes = sum(values[0].nbytes for _, values, _ in columns.values())
        if selection is not None:
            flight_bytes += 4 * len(selection.keys) * len(scenario.aircraft) * selection.rows(scenario)
        required_bytes = seeds.size * flight_bytes + sum(values.nbytes for values in applied.values())
        free_bytes = shutil.disk_usage(folder).free
        if free_bytes < _SPARE * required_bytes:
            detail = (
                f"arrived a disk with {free_bytes / 1e6:.3f} MB free; expected {_SPARE * required_bytes / 1e6:.3f} MB"
            )
            raise StoreError(f"{folder}: {detail}")
        attributes = store_attributes(study, scenario) | {"varied": json.dumps(list(applied)), "chunk": chunk}
        with _write_every_chunk():
            group = zarr.open_group(folder / cls.data_folder, mode="w-", zarr_format=2)
            group.attrs.update(attributes)
            _create_rows(group, scenario, applied, seeds, chunk, columns)
            if selection is not None:
                _create_series(group, selection, scenario, seeds.size, chunk)
        zarr.consolidate_metadata(group.store)
        StoreChecksums(folder, cls.data_folder).record_base(attributes)
        return cls(folder)

    @property
    def flights(self) -> int:
        """Number of planned flights of the campaign."""
        return self._array("flight").shape[0]

    @property
    def chunk_is_complete(self) -> np.ndarray:
        """Whether each chunk of flights is flown and stored completely; shape (chunks,)."""
        return np.isin(np.arange(-(-self.flights // self.chunk)), list(self._checksums.chunks()))

    @property
    def converged_chunks(self) -> int | None:
        """Number of leading chunks that satisfy the study's stopping rule; None without a rule or if unsatisfied."""
        if self.study.until is None:
            return None
        statistic = self.study.until.statistic
        columns = {name: np.asarray(self._array(name)[:]) for name in {"met", "miss_m", statistic}}
        is_upper = statistic not in [output.name for output in self.study.output if not output.is_upper]
        # the width of the interval does not depend on the sign
        worst = columns["met"] if statistic == "met" else worst_of_fleet(columns, statistic, upper=is_upper)
        values = worst if is_upper else -worst
        is_complete = self.chunk_is_complete
        count = count_converged_chunks(self.study, is_complete, self.chunk, values, self._unconverged_chunks)
        if count is None:
            self._unconverged_chunks = complete_prefix(is_complete)
        return count

    @property
    def flown(self) -> np.ndarray:
        """Numbers of the completed flights that count in the results.

        If the stopping rule is satisfied, flights after the chunk that satisfied the rule do not count.
        """
        is_counted, stop = self.chunk_is_complete, self.converged_chunks
        if stop is not None:
            is_counted[stop:] = False
        return np.flatnonzero(np.repeat(is_counted, self.chunk)[: self.flights])

    @property
    def varied(self) -> list[str]:
        """Key paths of the varied parameters in the scenario."""
        return json.loads(self.attributes["varied"])

    def chunk_slice(self, chunk: int) -> slice:
        """Return the range of flight numbers of a chunk."""
        return slice(chunk * self.chunk, min((chunk + 1) * self.chunk, self.flights))

    def applied(self, flights: slice) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Return the seeds and, by key path, the values of the varied parameters of a range of flights."""
        values = {path: np.asarray(self._array(path)[flights]) for path in self.varied}
        return np.asarray(self._array("seed")[flights]), values

    def write(self, chunk: int, flight_rows: list[FlightRow]) -> None:
        """Write the results of a chunk's flights, and mark the chunk as complete."""
        flights = self.chunk_slice(chunk)
        columns = {
            name: values for name, (_, values, _) in _result_columns(flight_rows, self.study, self.scenario).items()
        }
        if self.series_selection is not None:
            columns |= self._series_columns(self.series_selection, flight_rows)
        self._checksums.begin_chunk(chunk)
        with _write_every_chunk():
            for name, values in columns.items():
                self._array(name)[flights] = values
            os.sync()  # otherwise a power cut could destroy the chunk but not the record
            self._array(FLOWN)[flights] = True
        files = (file for name in [*columns, FLOWN] for file in self._chunk_files(name, chunk))
        self._checksums.record_chunk(chunk, files)

    def refuse_other_values(self, applied: Mapping[str, np.ndarray]) -> None:
        """Raise StoreError if a study's values of the varied parameters (by key path) differ from the store's."""
        stored = self.applied(slice(None))[1]
        unchanged = [
            path for path, values in applied.items() if path in stored and np.array_equal(stored[path], values)
        ]
        if list(stored) != unchanged:
            raise StoreError(
                f"{self.folder}: arrived a campaign with other values; expected those of the study, to go on with it"
            )

    def dataset(self) -> xr.Dataset:
        """Return the completed flights as a labelled dataset with the dimensions flight and aircraft.

        Raises StoreError if a file is damaged.
        """
        self.refuse_damaged()
        with self._open_dataset() as data:
            flights = data.drop_vars(FLOWN).isel(flight=self.flown).load()
        attributes = {"confidence": self.study.answers.confidence, "precision": self.study.precision}
        attributes |= separation_attributes(self.scenario)
        return flights.set_coords(["flight", "aircraft"]).assign_attrs(attributes)

    def series(self) -> xr.Dataset:
        """Return the time series of completed flights, read when used; dimensions flight, aircraft and time.

        Quantities are float32, NaN if missing; codes and flags are int32, -1 if missing. Raises StoreError if the study
        selects no time series, or a file is damaged.
        """
        if self.series_selection is None:
            expected = 'a study that keeps some, such as [keep] series = ["position_error", "airspeed"]'
            raise StoreError(f"{self.folder}: arrived a campaign without series; expected one of {expected}")
        self.refuse_damaged(series=True)
        return self._open_dataset(SERIES).isel(flight=self.flown)

    def _open_dataset(self, group: str | None = None) -> xr.Dataset:
        """Open the arrays of the store, or of the Zarr group `group` in the store; values are read when used."""
        path = self.folder / self.data_folder
        dataset = xr.open_zarr(path, group=group, chunks=None, consolidated=False, mask_and_scale=False)
        for values in dataset.variables.values():
            values.attrs.pop("_FillValue", None)
        return dataset

    def _series_columns(self, selection: SeriesSelection, flight_rows: list[FlightRow]) -> dict[str, np.ndarray]:
        """Return the selected time series of a chunk's flights, by array name; shape (flights, aircraft, times)."""
        shape = len(self.scenario.aircraft), selection.rows(self.scenario)
        return {
            # a flight that could not start has no series
            _series_name(key): np.stack(
                [row.series.get(key, missing_series(key, shape)) for row in flight_rows]
            ).astype(_series_type(key))
            for key in selection.keys
        }

    def _array(self, name: str) -> zarr.Array:
        array = self._group[name]
        assert isinstance(array, zarr.Array)
        return array

    def _chunk_files(self, name: str, chunk: int) -> Iterator[str]:
        """Yield the paths, relative to the data folder, of the Zarr files of a chunk of flights in the array `name`."""
        for further_indices in itertools.product(*map(range, self._array(name).cdata_shape[1:])):
            yield f"{name}/{'.'.join(map(str, (chunk, *further_indices)))}"

    def _last_file(self, chunk: int) -> Path:
        return self.folder / self.data_folder / FLOWN / str(chunk)

    def _chunk_label(self, chunk: int) -> str:
        flights = self.chunk_slice(chunk)
        return f"chunk {chunk} (flights {flights.start} to {flights.stop - 1})"


def repair_base(
    folder: Path, study: Study, scenario: Scenario, applied: Mapping[str, np.ndarray], seeds: np.ndarray
) -> None:
    """Rebuild damaged files that were written once, when the store was created.

    The files are metadata, coordinates, seeds and sampled values (`applied`, by key path). Raises StoreError if the
    record of checksums is damaged, or if a rebuilt file does not match its recorded checksum.
    """
    data_folder = folder / CampaignStore.data_folder
    checksums = StoreChecksums(folder, data_folder.name)
    problems = checksums.base_problems() if data_folder.is_dir() else {}
    if not problems:
        return
    with tempfile.TemporaryDirectory(dir=folder, prefix=".anser-") as temporary_folder:
        CampaignStore.create(Path(temporary_folder), study, scenario, applied, seeds, checksums.attributes()["chunk"])
        rebuilt = Path(temporary_folder) / data_folder.name
        for name, digest in problems.items():
            if not (rebuilt / name).is_file() or file_digest(rebuilt / name) != digest:
                detail = "a damaged file that this study and version do not make anew; expected those of the campaign"
                raise StoreError(f"{data_folder / name}: arrived {detail}, to go on with it")
        for name in problems:
            target = data_folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            (rebuilt / name).replace(target)


@contextlib.contextmanager
def _write_every_chunk() -> Iterator[None]:
    """In the `with` block, make Zarr write even files with only fill values; a missing file then means damage."""
    with zarr.config.set({"array.write_empty_chunks": True}):
        yield


_WIDTHS = {"status": 128, "unmet": 256, "reason": 512}
"""Maximum number of characters of text columns by name; longer texts are truncated and end with three dots."""


def _result_columns(flight_rows: Sequence[FlightRow], study: Study, scenario: Scenario) -> dict[str, FlightColumn]:
    """Return columns (dimensions, values, attributes) of flight results by name; texts are cut to a fixed width."""
    labels = {output.name: output.labels for output in study.output}
    columns = tabulate_flights(flight_rows, len(scenario.aircraft), labels)
    for name in _WIDTHS:
        dimensions, values, labels = columns[name]
        columns[name] = dimensions, shortened(values, name), labels
    return columns


def shortened(texts: np.ndarray, name: str) -> np.ndarray:
    """Return the values of column `name` as stored: texts longer than the column's width are cut and end in dots.

    Of a status "first; then last" each part is cut, so that both remain distinct.
    """
    width = _WIDTHS.get(name)
    if width is None:
        return texts

    def cut(text: str) -> str:
        parts = text.split(THEN) if name == "status" and len(text) > width else [text]
        longest = (width - len(THEN) * (len(parts) - 1)) // len(parts)
        return THEN.join(part if len(part) <= longest else f"{part[: longest - 3]}..." for part in parts)

    stored = list(map(cut, texts.ravel().tolist()))
    return np.array(stored, dtype=f"<U{width}").reshape(texts.shape)


def _create_rows(
    group: zarr.Group,
    scenario: Scenario,
    applied: Mapping[str, np.ndarray],
    seeds: np.ndarray,
    chunk: int,
    columns: Mapping[str, FlightColumn],
) -> None:
    """Write coordinates, seeds and values of the varied parameters, and allocate the arrays of the results.

    `columns`, the results of an example flight, give the data type, dimensions and attributes of each array.
    """
    names = np.array([aircraft.name for aircraft in scenario.aircraft], dtype=np.str_)
    _write_whole(group, "aircraft", names, "aircraft", {"long_name": "Aircraft"})
    _write_whole(group, "flight", np.arange(seeds.size), "flight", _FLIGHT_LABELS)
    _write_whole(group, "seed", seeds, "flight", {"long_name": "Seed of the flight's scenario"})
    for key_path, values in applied.items():
        _write_whole(group, key_path, values, "flight", {"long_name": f"{key_path} of the scenario, as flown"})
    flown_column = (), np.zeros(1, dtype=bool), {"long_name": "Whether the flight was flown"}
    for name, (dimensions, values, labels) in {**columns, FLOWN: flown_column}.items():
        shape = values.shape[1:]
        _allocate(group, name, (seeds.size, *shape), (chunk, *shape), values.dtype, ["flight", *dimensions], labels)


_FLIGHT_LABELS = {"long_name": "Number of the flight"}
_PIECE = 1 << 26
"""Maximum number of values in a file of the store; longer time series are divided into several files."""


def _create_series(group: zarr.Group, selection: SeriesSelection, scenario: Scenario, flights: int, chunk: int) -> None:
    """Write the coordinates and allocate the arrays of the selected time series, in the store's Zarr group `series`.

    `flights` is the number of all flights, `chunk` is the number of flights in one chunk of an array.
    """
    names, times_s = [aircraft.name for aircraft in scenario.aircraft], selection.times_s(scenario)
    group.create_group(SERIES)
    coordinates = {"flight": ("flight", np.arange(flights), _FLIGHT_LABELS), **record_coordinates(times_s, names)}
    for name, (dimension, values, labels) in coordinates.items():
        _write_whole(group, f"{SERIES}/{name}", values, dimension, labels)
    piece = max(1, min(times_s.size, _PIECE // (chunk * len(names))))
    for key in selection.keys:
        shape, chunks = (flights, len(names), times_s.size), (chunk, len(names), piece)
        labels = {
            label: value.tolist() if isinstance(value, np.ndarray) else value
            for label, value in catalogue_attributes(catalogue_variable(key)).items()
        }
        dimensions = ["flight", "aircraft", "time"]
        _allocate(group, _series_name(key), shape, chunks, _series_type(key), dimensions, labels)


def _write_whole(group: zarr.Group, name: str, values: np.ndarray, dimension: str, labels: Mapping[str, Any]) -> None:
    attributes = {**labels, "_ARRAY_DIMENSIONS": [dimension]}
    group.create_array(name, data=values, chunks=values.shape, fill_value=None, attributes=attributes)


def _allocate(
    group: zarr.Group,
    name: str,
    shape: tuple[int, ...],
    chunks: tuple[int, ...],
    dtype: np.dtype,
    dimensions: list[str],
    labels: Mapping[str, Any],
) -> None:
    """Create an array without values; `labels` are attributes.

    Only an array of floats has a fill value (NaN), because xarray reads fill values as missing.
    """
    group.create_array(
        name,
        shape=shape,
        chunks=chunks,
        dtype=dtype,
        fill_value=np.nan if dtype.kind == "f" else None,
        attributes={**labels, "_ARRAY_DIMENSIONS": dimensions},
    )


def _series_name(key: str) -> str:
    return f"{SERIES}/{catalogue_variable(key).name}"


def _series_type(key: str) -> np.dtype:
    return np.dtype(np.float32 if is_quantity(catalogue_variable(key)) else np.int32)
