"""Segments of flights, each flown by one call of a compiled program, and replanning between two steps.

The compiled steps only correct a plan. At a sample at which the flight needs a new plan, the compiled steps end, and
`replan_between_steps` of the planner makes the new plan.
"""

import functools
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Int

from anser.compiling.options import compiled_by_older_generator, compiled_quickly
from anser.compiling.program import PreparedProgram, Program
from anser.numerics.arrays import Stacked, as_array, cast_to_precision, stack_rows, with_rows
from anser.parts.perception import Instant
from anser.parts.planners import AircraftReport
from anser.shapes import Integer
from anser.simulation.flight import SEGMENT_STEPS, Flight, FlightState, fleet_reports, fly

fly_segment = compiled_by_older_generator(None, "flight")(functools.partial(fly, one_kernel=True, packed_rows=True))
"""Program that flies one segment of a single flight of up to four aircraft; see `anser.simulation.fly`."""
fly_large_segment = compiled_by_older_generator(None, "flight")(functools.partial(fly, packed_rows=True))
"""Program that flies one segment of a single flight of more than four aircraft."""
# Greatest number of aircraft for which a step is made of single kernels. For twenty aircraft, such a step takes 1.7
# times as long on two cores.
_KERNEL_AIRCRAFT = 4
_SHORT_SEGMENTS = 6  # number of segments from one planning time to the next that a batch flies after a new plan


def segment_program(flight: Flight) -> Program[..., Any]:
    """Return the program that flies segments: `fly_segment` for up to four aircraft, `fly_large_segment` for more."""
    return fly_segment if flight.count <= _KERNEL_AIRCRAFT else fly_large_segment


def prepare_flight(flight: Flight, state: FlightState) -> PreparedProgram:
    """Return the program of a flight's segments for a state or the shapes of a state, prepared but not called."""
    steps = as_array(SEGMENT_STEPS, np.int32)
    return segment_program(flight).prepare(flight, state, as_array(0, np.int32), active_steps=steps)


def start_replanning_programs(flight: Flight, state: FlightState) -> None:
    """Start the compilation of the programs that replan a flight between two steps, for the shapes of a state."""
    sensed = sense_fleet.prepare(flight, state, as_array(0, np.int32)).start()
    for program in flight.planner.prepare_replanning(state.planner, sensed.shapes):
        program.start()


def fly_with_replanning(
    flight: Flight, state: FlightState, sample: int, step_count: int = SEGMENT_STEPS
) -> tuple[FlightState, dict[str, np.ndarray]]:
    """Fly `step_count` steps (at most `SEGMENT_STEPS`) from sample `sample`, and replan between steps if necessary.

    Returns the state after the last step, and the recorded rows by key, each (step, aircraft).
    """
    end, parts = sample + step_count, []
    while sample < end:
        next_state, rows = _fly_until(end, flight, state, sample)
        reached = end
        if int(next_state.replan_sample) != int(state.replan_sample):
            reached = int(next_state.replan_sample)
            next_state, rows = _fly_until(reached, flight, state, sample)
            next_state = replan_stopped_flight(flight, next_state, reached)
        parts.append(rows)
        state, sample = next_state, reached
    if len(parts) == 1:
        return state, parts[0]
    return state, {key: np.concatenate([rows[key] for rows in parts]) for key in parts[0]}


def _fly_until(end: int, flight: Flight, state: FlightState, sample: int) -> tuple[FlightState, dict[str, np.ndarray]]:
    steps = end - sample
    final_state, _, rows = segment_program(flight)(
        flight, state, as_array(sample, np.int32), active_steps=as_array(steps, np.int32)
    )
    return final_state, {key: values[:steps] for key, values in rows.unpacked().items()}


@compiled_quickly
def sense_fleet(flight: Flight, state: FlightState, sample: Integer) -> AircraftReport:
    """Return the aircraft's reports to the planner at sample `sample`, in fleet order, by a compiled program."""
    instant = Instant(flight.environment, sample, flight.timing.step, flight.randomness)
    return cast_to_precision(fleet_reports(flight, state, instant)[1], float)


def replan_stopped_flight(flight: Flight, state: FlightState, sample: int) -> FlightState:
    """Return the state of a flight at sample `sample` with a new plan, made before the next step."""
    number = as_array(sample, np.int32)
    reports, time_s = sense_fleet(flight, state, number), sample * float(flight.timing.step)
    planner_state = flight.planner.replan_between_steps(state.planner, time_s, reports)
    return FlightState(state.vehicles, planner_state, number)


class BatchState(NamedTuple):
    """State of a batch between two steps: stacked states of the flights, and of their recorders (`summaries`)."""

    flights: FlightState
    summaries: Any


class Segment(NamedTuple):
    """Segment that a batch has flown."""

    first_sample: int
    end: int  # first sample of the next segment
    state: BatchState  # state after the last step
    rows: Any  # recorded rows


def fly_segments(
    # function from (state, first sample, number of steps) to (new state, recorded rows)
    fly_on: Callable[[BatchState, int, int], tuple[BatchState, Any]],
    replan: Callable[[FlightState, Int[np.ndarray, " chosen"], int], FlightState],  # see `replan_flights`
    state: BatchState,
    positions: Sequence[int],  # indices of the flights in the batch, without the padding
    last_sample: int,
    replan_steps: int,  # number of steps between two planning times; 0: none
    row_stride: int,  # number of steps between two recorded rows, counted from the start of a segment
) -> Iterator[Segment]:
    """Fly a batch from sample 0 to the last sample, and yield each segment.

    The compiled steps make no new plans. If a flight needs a new plan within a segment, the segment is discarded and
    replaced by shorter segments up to the planning times, at which `replan` makes the new plans. After
    `_SHORT_SEGMENTS` short segments without a new plan, the segments are long again.
    """

    def flights_to_replan(after: BatchState) -> Int[np.ndarray, " flights"]:
        is_needed = np.asarray(after.flights.replan_sample) != np.asarray(state.flights.replan_sample)
        return np.intersect1d(np.flatnonzero(is_needed), positions)

    sample, short_segments = 0, 0
    while sample <= last_sample:
        step_count = min(SEGMENT_STEPS, last_sample + 1 - sample)
        if short_segments:
            step_count, short_segments = min(step_count, replan_steps - sample % replan_steps), short_segments - 1
            next_state, recorded = fly_on(state, sample, 1)  # a trial step shows which flights need a plan
            indices = flights_to_replan(next_state)
            if indices.size:
                state, short_segments = state._replace(flights=replan(state.flights, indices, sample)), _SHORT_SEGMENTS
            elif row_stride == 1:  # every step is recorded: the trial step is a segment of its own
                yield Segment(sample, sample + 1, next_state, recorded)
                state, sample, step_count = next_state, sample + 1, step_count - 1
                if step_count == 0:
                    continue
        next_state, recorded = fly_on(state, sample, step_count)
        if flights_to_replan(next_state).size:
            short_segments = _SHORT_SEGMENTS
            continue
        yield Segment(sample, sample + step_count, next_state, recorded)
        state, sample = next_state, sample + step_count


def replan_flights(
    flights: Stacked[Flight], states: FlightState, indices: Int[np.ndarray, " chosen"], sample: int
) -> FlightState:
    """Return the states of a batch at sample `sample` with new plans for the flights at `indices`."""
    batched, rows = (jax.tree.map(np.asarray, tree) for tree in (flights.batched, states))
    host_flights = Stacked(batched, flights.shared)
    replanned = [
        replan_stopped_flight(host_flights.at(k), jax.tree.map(lambda leaf, k=k: leaf[k], rows), sample)
        for k in indices
    ]
    return with_rows(states, indices, stack_rows(replanned))
