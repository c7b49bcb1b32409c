"""The store of a campaign: preallocated, a chunk written whole and then marked; what is marked is complete."""

import json
import os
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
import zarr

from anser.campaigns.kept import series_of
from anser.campaigns.series_store import SERIES, create_series, series_bytes, series_dataset, write_series
from anser.campaigns.stopping import complete_from_first, enough
from anser.campaigns.study import Study, validate_study
from anser.results import version_attributes
from anser.results.flight_columns import Column, flight_columns, worst_of_fleet
from anser.results.flight_row import FlightRow
from anser.scenario import Scenario
from anser.scenario.schema import validate

FORMAT = 1
_FOLDER = "flights.zarr"
_DONE = "chunk_done"
_WIDTHS = {"status": 64, "unmet": 256, "reason": 512}
"""Characters of texts; what is longer is cut, with dots."""
_SPARE = 2.0
"""How much more space there must be than the store takes uncompressed."""


class StoreError(ValueError):
    """A folder that is no store of this study, or cannot be one; `str()` is the finished message."""


class CampaignStore:
    """Values applied and what came of every flight, in a folder; open one with `create` or `open`.

    ``xarray.open_zarr(folder / "flights.zarr")`` reads it as well; `dataset` leaves out what has not been flown.

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
    """

    def __init__(self, folder: Path, group: zarr.Group) -> None:
        self.folder, self._group = folder, group
        about: dict[str, Any] = dict(group.attrs)
        self.study = validate_study(json.loads(about["study"]), f"{folder}, study")
        self.scenario = validate(json.loads(about["scenario"]), f"{folder}, scenario")
        self.chunk = int(about["chunk"])
        self._not_enough = 0  # chunks that were looked at: each look sorts all flights so far
        self.kept = series_of(self.study.keep, self.scenario)
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
        kept = series_of(study.keep, scenario)
        flights, names = seeds.size, [one.name for one in scenario.aircraft]
        columns = flight_columns([FlightRow.failed("")], len(names))
        sized = {name: _typed(name, column) for name, column in columns.items()}
        needed = flights * sum(one[1][0].nbytes for one in sized.values()) + sum(one.nbytes for one in applied.values())
        needed += 0 if kept is None else flights * series_bytes(kept, scenario)
        free = shutil.disk_usage(folder).free
        if free < _SPARE * needed:
            words = f"arrived a disk with {free / 1e6:.3f} MB free; expected {_SPARE * needed / 1e6:.3f} MB"
            raise StoreError(f"{folder}: {words}")
        group = zarr.open_group(folder / _FOLDER, mode="w-", zarr_format=2)
        group.attrs.update(
            {
                "format_version": FORMAT,
                "title": study.name,
                "study": study.model_dump_json(exclude_unset=True),
                "study_hash": study.hash,
                "precision": study.precision,
                "scenario": scenario.model_dump_json(exclude_unset=True),
                "scenario_hash": scenario.hash,
                "varied": json.dumps(list(applied)),
                "chunk": chunk,
                **version_attributes(),
            }
        )
        _put_whole(group, "flight", np.arange(flights), ("flight",), {"long_name": "Number of the flight"})
        _put_whole(group, "aircraft", np.array(names, dtype=np.str_), ("aircraft",), {"long_name": "Aircraft"})
        _put_whole(group, "seed", seeds, ("flight",), {"long_name": "Seed of the flight's scenario"})
        for path, values in applied.items():
            _put_whole(group, path, values, ("flight",), {"long_name": f"{path} of the scenario, as flown"})
        for name, (dimensions, values, labels) in sized.items():
            group.create_array(
                name,
                shape=(flights, *values.shape[1:]),
                chunks=(chunk, *values.shape[1:]),
                dtype=values.dtype,
                fill_value=np.nan if values.dtype.kind == "f" else values.dtype.type(),
                attributes={**labels, "_ARRAY_DIMENSIONS": ["flight", *dimensions]},
            )
        if kept is not None:
            create_series(group, kept, scenario, flights, chunk)
        count = -(-flights // chunk)
        words = {"long_name": "Whether the flights of a chunk are complete", "_ARRAY_DIMENSIONS": ["chunk"]}
        group.create_array(_DONE, shape=(count,), chunks=(1,), dtype="int8", fill_value=0, attributes=words)
        return cls(folder, group)

    @classmethod
    def open(cls, folder: Path) -> "CampaignStore":
        """Open the store of a folder.

        Raises
        ------
        StoreError
            There is none, or one of another format.
        """
        try:
            group = zarr.open_group(folder / _FOLDER, mode="r+")
        except (FileNotFoundError, ValueError):
            raise StoreError(f"{folder}: arrived a folder without {_FOLDER}; expected that of a campaign") from None
        if group.attrs.get("format_version") != FORMAT or _DONE not in group:
            words = "a store that was not finished when it was made, or one of another format"
            raise StoreError(f"{folder}: arrived {words}; expected a store of format {FORMAT}")
        return cls(folder, group)

    @property
    def flights(self) -> int:
        """How many flights the campaign has."""
        return self._array("flight").shape[0]

    @property
    def done(self) -> np.ndarray:
        """Whether each chunk is complete."""
        return np.asarray(self._array(_DONE)[:]) == 1

    @property
    def enough(self) -> int | None:
        """How many of the first chunks are enough by the study's rule; None where they are not, or it has none."""
        if self.study.until is None:
            return None
        statistic = self.study.until.statistic
        columns = {name: np.asarray(self._array(name)[:]) for name in {"met", "miss_m", statistic}}
        values = columns["met"] if statistic == "met" else worst_of_fleet(columns, statistic)
        done = self.done
        found = enough(self.study, done, self.chunk, values, self._not_enough)
        if found is None:
            self._not_enough = complete_from_first(done)
        return found

    @property
    def flown(self) -> np.ndarray:
        """Numbers of the flights that count: those of complete chunks, as far as the study's rule asks for them."""
        counts, stop = self.done, self.enough
        if stop is not None:
            counts = counts & (np.arange(counts.size) < stop)
        return np.flatnonzero(np.repeat(counts, self.chunk)[: self.flights])

    @property
    def varied(self) -> list[str]:
        """Paths of what varies."""
        return json.loads(str(self._group.attrs["varied"]))

    def rows_of(self, chunk: int) -> slice:
        """Flights of a chunk."""
        return slice(chunk * self.chunk, min((chunk + 1) * self.chunk, self.flights))

    def applied(self, flights: slice) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Seeds of some flights, and what is put into their scenarios, by path."""
        return np.asarray(self._array("seed")[flights]), {
            path: np.asarray(self._array(path)[flights]) for path in self.varied
        }

    def write(self, chunk: int, rows: list[FlightRow]) -> None:
        """Write a chunk, and mark it when all of it is on the disk."""
        place = self.rows_of(chunk)
        for name, column in flight_columns(rows, len(self.scenario.aircraft)).items():
            self._array(name)[place] = _typed(name, column)[1]
        if self.kept is not None:
            write_series(self._group, self.kept, place, rows)
        os.sync()  # or the mark could outlive a power cut that its chunk does not
        self._array(_DONE)[chunk] = 1

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
        with xr.open_zarr(self.folder / _FOLDER, chunks=None, consolidated=False, mask_and_scale=False) as data:
            found = data.drop_vars(_DONE).isel(flight=self.flown).load()
        attributes = {"confidence": self.study.answers.confidence, "precision": self.study.precision}
        return found.set_coords(["flight", "aircraft"]).assign_attrs(attributes)

    def series(self) -> xr.Dataset:
        """What was kept over time of all flights of complete chunks; dimensions flight, aircraft and time.

        Read when it is asked for. Quantities are float32, NaN where there is none; codes and truth values int32, -1
        where there is none.

        Raises
        ------
        StoreError
            The study keeps none.
        """
        if self.kept is None:
            words = 'a study that keeps some, such as [keep] series = ["position_error", "airspeed"]'
            raise StoreError(f"{self.folder}: arrived a campaign without series; expected one of {words}")
        return series_dataset(self.folder / _FOLDER, self.flown)

    def series_of(self, name: str, flights: np.ndarray) -> Iterator[np.ndarray]:
        """One variable of some flights over time, chunk by chunk: shape (flights of the chunk, aircraft, times)."""
        array = self._array(f"{SERIES}/{name}")
        for chunk in np.unique(flights // self.chunk):
            rows = self.rows_of(int(chunk))
            some = flights[flights // self.chunk == chunk]
            yield np.asarray(array[rows])[some - rows.start]

    def _array(self, name: str) -> zarr.Array:
        found = self._group[name]
        assert isinstance(found, zarr.Array)
        return found


def _typed(name: str, column: Column) -> Column:
    """Texts in the width of the store."""
    dimensions, values, labels = column
    width = _WIDTHS.get(name)
    if width is None:
        return column
    cut = [one if len(one) <= width else f"{one[: width - 3]}..." for one in values.ravel().tolist()]
    return dimensions, np.array(cut, dtype=f"<U{width}").reshape(values.shape), labels


def _put_whole(
    group: zarr.Group, name: str, values: np.ndarray, dimensions: tuple[str, ...], labels: dict[str, Any]
) -> None:
    group.create_array(
        name, data=values, chunks=values.shape, attributes={**labels, "_ARRAY_DIMENSIONS": list(dimensions)}
    )
