"""Chosen variables of many flights at a chosen rate: recorded beside the running summary."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import equinox as eqx
import numpy as np
from jaxtyping import Array

from anser.results.series_values import missing_series, series_values, variable_of
from anser.scenario import Scenario
from anser.sensing import Instant
from anser.simulation import SEGMENT_STEPS, FleetSummary, SummaryRecorder
from anser.simulation.record import record
from anser.simulation.recorder import AbstractRecorder, FleetSample

if TYPE_CHECKING:
    import xarray as xr


class SeriesKept(eqx.Module):
    """Which variables are kept of many flights, and how often.

    Attributes
    ----------
    keys
        Of `anser.variables.CATALOGUE`.
    every
        Steps between two rows.
    """

    keys: tuple[str, ...] = eqx.field(static=True)
    every: int = eqx.field(static=True)

    @classmethod
    def of(cls, scenario: Scenario, keys: Sequence[str], every_s: float) -> "SeriesKept":
        """Of variables kept every so many seconds, a whole number of the scenario's steps."""
        return cls(tuple(keys), round(every_s / scenario.timing.step_s))

    @property
    def recorded_every(self) -> int:
        """Steps between two rows that are recorded, so that they fill a segment; some of them are kept."""
        return math.gcd(self.every, SEGMENT_STEPS)

    def rows(self, scenario: Scenario) -> int:
        """How many are kept of a flight: at its start, and every so many steps."""
        return round(scenario.timing.duration_s / scenario.timing.step_s) // self.every + 1

    def times_s(self, scenario: Scenario) -> np.ndarray:
        """Times of the rows, s."""
        return np.arange(self.rows(scenario)) * (self.every * scenario.timing.step_s)

    def kept_of(self, rows: Mapping[str, Array], since: int, last: int) -> dict[str, np.ndarray]:
        """Of the recorded rows of a segment, shape (flights, rows, aircraft), those that are kept."""
        numbers = since + np.arange(SEGMENT_STEPS // self.recorded_every) * self.recorded_every
        chosen = np.flatnonzero((numbers % self.every == 0) & (numbers <= last))
        return {key: np.asarray(values)[:, chosen] for key, values in rows.items()}

    def values(
        self, parts: Sequence[Mapping[str, np.ndarray]], place: int, scenario: Scenario
    ) -> dict[str, np.ndarray]:
        """Of one flight of a batch, from what is kept of each segment: by key, as `FlightRow.series`."""
        shape = len(scenario.aircraft), self.rows(scenario)
        return {
            key: series_values(key, np.concatenate([part[key][place] for part in parts]).T)
            if key in parts[0]
            else missing_series(key, shape)
            for key in self.keys
        }

    def values_of(self, dataset: "xr.Dataset") -> dict[str, np.ndarray]:
        """Of a flight that was recorded as often: by key, as `FlightRow.series`."""
        shape = dataset.sizes["aircraft"], dataset.sizes["time"]
        found = {}
        for key in self.keys:
            variable = variable_of(key)
            missing = missing_series(key, shape)
            held = dataset[variable.name].values.T if variable.name in dataset else missing
            found[key] = held.astype(missing.dtype)
        return found

    def recorder(self, summary: SummaryRecorder) -> "SummaryAndSeries":
        """What records both."""
        return SummaryAndSeries(summary=summary, keys=self.keys, every=self.recorded_every)


class SummaryAndSeries(AbstractRecorder):
    """The running summary, and rows of chosen variables; those that a flight has not are not in its rows.

    Attributes
    ----------
    summary
        Of which the memory is.
    keys
        Of `anser.variables.CATALOGUE`.
    every
        Number of samples between two rows.
    """

    summary: SummaryRecorder
    keys: tuple[str, ...] = eqx.field(static=True)
    every: int = eqx.field(static=True)

    def init(self, aircraft: int) -> tuple[FleetSummary, Any]:
        """Summary of no sample."""
        return self.summary.init(aircraft)

    def take(self, memory: Any, sample: FleetSample, instant: Instant) -> Any:
        """Summary with one more sample."""
        return self.summary.take(memory, sample, instant)

    def row(self, sample: FleetSample, instant: Instant) -> dict[str, Array]:
        """Each variable of each aircraft, SI units and radians."""
        found = sample.rows(record)
        return {key: found[key] for key in self.keys if key in found}
