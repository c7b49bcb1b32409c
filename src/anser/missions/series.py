"""Time series of selected variables, recorded for many flights in addition to the running summary.

A row of a series contains the values at one time.
"""

import dataclasses
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
    """Selection of the variables that are recorded over time for many flights, and of the recording period."""

    keys: tuple[str, ...] = eqx.field(static=True)  # keys of `anser.variables.CATALOGUE`
    stride: int = eqx.field(static=True)  # steps between two rows
    # every segment has a multiple of this number of steps
    segment_divisor: int = eqx.field(static=True, default=SEGMENT_STEPS)

    @classmethod
    def from_period(cls, scenario: Scenario, keys: Sequence[str], every_s: float) -> "SeriesSelection":
        """Make a selection with a period `every_s`, s, which must be a whole multiple of the scenario's step."""
        return cls(tuple(keys), round(every_s / scenario.timing.step_s))

    @property
    def recording_stride(self) -> int:
        """Number of steps between two rows recorded by the compiled program; a divisor of every segment's step count.

        The program may record more rows than the series has; `segment_rows` selects the rows of the series.
        """
        return math.gcd(self.stride, self.segment_divisor)

    def for_segments(self, divisor: int) -> "SeriesSelection":
        """Return the selection for segments whose numbers of steps are multiples of `divisor`."""
        return dataclasses.replace(self, segment_divisor=divisor)

    def rows(self, scenario: Scenario) -> int:
        """Return the number of rows of one flight, the start included."""
        return round(scenario.timing.duration_s / scenario.timing.step_s) // self.stride + 1

    def times_s(self, scenario: Scenario) -> np.ndarray:
        """Return the time of each row, s after the start of the flight."""
        return np.arange(self.rows(scenario)) * (self.stride * scenario.timing.step_s)

    def segment_rows(self, recorded: Mapping[str, Array], first_sample: int, last_sample: int) -> dict[str, np.ndarray]:
        """Select the rows of the series from the rows recorded in a segment, up to the sample `last_sample`.

        Arguments and result are arrays (flights, rows, aircraft) by key; `first_sample` is the segment's first sample.
        """
        numbers = first_sample + np.arange(SEGMENT_STEPS // self.recording_stride) * self.recording_stride
        selected = np.flatnonzero((numbers % self.stride == 0) & (numbers <= last_sample))
        return {key: np.asarray(values)[:, selected] for key, values in recorded.items()}

    def values(
        self, parts: Sequence[Mapping[str, np.ndarray]], index: int, scenario: Scenario
    ) -> dict[str, np.ndarray]:
        """Join the rows of all segments (`parts`) to the series of one flight of a batch.

        `index` is the flight's index in the batch. Returns arrays (aircraft, rows) by key, in dataset units. Missing
        values and variables are NaN, or -1 for codes and flags.
        """
        shape = len(scenario.aircraft), self.rows(scenario)
        return {
            key: convert_series(key, np.concatenate([part[key][index] for part in parts]).T)
            if key in parts[0]
            else missing_series(key, shape)
            for key in self.keys
        }

    def values_from_dataset(self, dataset: "xr.Dataset") -> dict[str, np.ndarray]:
        """Return the series as `values` does, from the dataset of a flight recorded with the period of the series."""
        series = {}
        for key in self.keys:
            name, missing = catalogue_variable(key).name, missing_series(key, dataset["north_m"].T.shape)
            series[key] = dataset[name].values.T.astype(missing.dtype) if name in dataset else missing
        return series

    def recorder(self, summary: SummaryRecorder) -> "SeriesRecorder":
        """Return the recorder of the summary and of the selected variables."""
        return SeriesRecorder(summary=summary, keys=self.keys, stride=self.recording_stride)


class SeriesRecorder(AbstractRecorder):
    """Recorder of the running summary and of selected variables; variables absent from a flight are omitted."""

    summary: SummaryRecorder  # recorder of the summary; the state of a `SeriesRecorder` is the state of `summary`
    keys: tuple[str, ...] = eqx.field(static=True)  # keys of `anser.variables.CATALOGUE`
    stride: int = eqx.field(static=True)  # steps between two rows

    def init(self, aircraft: int) -> tuple[FleetSummary, Any]:
        """Return the recorder state at the start, the summary of no samples; `aircraft`: number of aircraft."""
        return self.summary.init(aircraft)

    def update(self, recorder_state: Any, sample: FleetSample, instant: Instant) -> Any:
        """Return the recorder state after one more sample: the updated summary."""
        return self.summary.update(recorder_state, sample, instant)

    def output(self, sample: FleetSample, instant: Instant) -> dict[str, Array]:
        """Return the selected variables at a sample by key, (aircraft,), in SI units and radians."""
        values = sample.rows(record)
        return {key: values[key] for key in self.keys if key in values}
