"""Chosen variables of many flights at a chosen rate: recorded beside the running summary."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import equinox as eqx
import numpy as np
from jaxtyping import Array

from anser.parts.perception import Instant
from anser.results.variable_labels import catalogue_variable, convert_series, missing_series
from anser.scenario.schema import Scenario
from anser.simulation.fleet_summary import FleetSummary, SummaryRecorder
from anser.simulation.flight import SEGMENT_STEPS
from anser.simulation.recorders import AbstractRecorder, FleetSample, record

if TYPE_CHECKING:
    import xarray as xr


class SeriesSelection(eqx.Module):
    """Which variables are kept of many flights, and how often.

    Attributes
    ----------
    keys
        Of `anser.variables.CATALOGUE`.
    every
        Steps between two rows.
    """

    keys: tuple[str, ...] = eqx.field(static=True)
    stride: int = eqx.field(static=True)

    @classmethod
    def from_period(cls, scenario: Scenario, keys: Sequence[str], every_s: float) -> "SeriesSelection":
        """Of variables kept every so many seconds, a whole number of the scenario's steps."""
        return cls(tuple(keys), round(every_s / scenario.timing.step_s))

    @property
    def recording_stride(self) -> int:
        """Steps between two rows that are recorded, so that they fill a segment; some of them are kept."""
        return math.gcd(self.stride, SEGMENT_STEPS)

    def rows(self, scenario: Scenario) -> int:
        """How many are kept of a flight: at its start, and every so many steps."""
        return round(scenario.timing.duration_s / scenario.timing.step_s) // self.stride + 1

    def times_s(self, scenario: Scenario) -> np.ndarray:
        """Times of the rows, s."""
        return np.arange(self.rows(scenario)) * (self.stride * scenario.timing.step_s)

    def segment_rows(self, rows: Mapping[str, Array], since: int, last: int) -> dict[str, np.ndarray]:
        """Of the recorded rows of a segment, shape (flights, rows, aircraft), those that are kept."""
        numbers = since + np.arange(SEGMENT_STEPS // self.recording_stride) * self.recording_stride
        chosen = np.flatnonzero((numbers % self.stride == 0) & (numbers <= last))
        return {key: np.asarray(values)[:, chosen] for key, values in rows.items()}

    def values(
        self, parts: Sequence[Mapping[str, np.ndarray]], place: int, scenario: Scenario
    ) -> dict[str, np.ndarray]:
        """Of one flight of a batch, from what is kept of each segment: by key, as `FlightRow.series`."""
        shape = len(scenario.aircraft), self.rows(scenario)
        return {
            key: convert_series(key, np.concatenate([part[key][place] for part in parts]).T)
            if key in parts[0]
            else missing_series(key, shape)
            for key in self.keys
        }

    def values_from_dataset(self, dataset: "xr.Dataset") -> dict[str, np.ndarray]:
        """Of a flight that was recorded as often: by key, as `FlightRow.series`."""
        shape = dataset.sizes["aircraft"], dataset.sizes["time"]
        found = {}
        for key in self.keys:
            variable = catalogue_variable(key)
            missing = missing_series(key, shape)
            held = dataset[variable.name].values.T if variable.name in dataset else missing
            found[key] = held.astype(missing.dtype)
        return found

    def recorder(self, summary: SummaryRecorder) -> "SeriesRecorder":
        """What records both."""
        return SeriesRecorder(summary=summary, keys=self.keys, stride=self.recording_stride)


class SeriesRecorder(AbstractRecorder):
    """The running summary, and rows of chosen variables; those that a flight has not are not in its rows.

    Attributes
    ----------
    summary
        Of which the recorder_state is.
    keys
        Of `anser.variables.CATALOGUE`.
    every
        Number of samples between two rows.
    """

    summary: SummaryRecorder
    keys: tuple[str, ...] = eqx.field(static=True)
    stride: int = eqx.field(static=True)

    def init(self, aircraft: int) -> tuple[FleetSummary, Any]:
        """Summary of no sample."""
        return self.summary.init(aircraft)

    def update(self, recorder_state: Any, sample: FleetSample, instant: Instant) -> Any:
        """Summary with one more sample."""
        return self.summary.update(recorder_state, sample, instant)

    def output(self, sample: FleetSample, instant: Instant) -> dict[str, Array]:
        """Each variable of each aircraft, SI units and radians."""
        found = sample.rows(record)
        return {key: found[key] for key in self.keys if key in found}
