"""Segments of a flight: the steps that one compiled program flies.

A segment is first flown without replanning, by a smaller program; if a new plan was needed, it is repeated with
replanning.
"""

import dataclasses
import functools
from collections.abc import Iterator
from typing import Any

import numpy as np

from anser.compiling.options import compiled
from anser.compiling.program import PreparedProgram
from anser.numerics.arrays import as_array
from anser.simulation.flight import SEGMENT_STEPS, Flight, FlightState, fly

fly_segment = compiled(functools.partial(fly, one_kernel=True))
"""One segment of a single flight, compiled; see `anser.simulation.fly`."""


def without_replanning(flight: Flight) -> Flight:
    """Return the flight with a planner that does not replan: a smaller program, sufficient for most segments."""
    return dataclasses.replace(flight, planner=dataclasses.replace(flight.planner, allow_replanning=False))


def prepare_flight(flight: Flight, state: FlightState) -> PreparedProgram:
    """Prepare the program of a flight's segments, for a state or the shapes of a state."""
    steps = as_array(SEGMENT_STEPS, np.int32)
    return fly_segment.prepare(without_replanning(flight), state, as_array(0, np.int32), active_steps=steps)


def fly_with_replanning(flight: Flight, state: FlightState, sample: int, step_count: int = SEGMENT_STEPS) -> Any:
    """Fly a segment from sample `sample` on; repeat it with replanning if a new plan was needed.

    Parameters
    ----------
    flight, state, sample
        Flight, its state at the first sample, and the number of that sample.
    step_count
        Number of steps to fly; the rows of later steps are meaningless.

    Returns
    -------
    Result of `anser.simulation.fly`.
    """
    number, steps = as_array(sample, np.int32), as_array(step_count, np.int32)
    segment = fly_segment(without_replanning(flight), state, number, active_steps=steps)
    if flight.planner.replan_needed(segment[0].planner):
        segment = fly_segment(flight, state, number, active_steps=steps)
    return segment


def padded_batches(indices: np.ndarray, size: int) -> Iterator[np.ndarray]:
    """Yield batches of `size` indices; the last batch is padded with its last index."""
    for k in range(0, indices.size, size):
        batch = indices[k : k + size]
        yield np.concatenate([batch, np.repeat(batch[-1:], size - batch.size)])
