"""Segments of a flight: the steps that one compiled program flies, and replanning between two steps.

The compiled loop corrects plans. Where a new plan is needed, the flight stops at this sample, and the plan is made by
programs of its own: the program of the loop stays small, and the programs of a search serve here too.
"""

import dataclasses
import functools
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from anser.compiling.options import compiled, compiled_by_older_generator, compiled_quickly
from anser.compiling.program import PreparedProgram, Program
from anser.numerics.arrays import as_array, cast_to_precision
from anser.parts.perception import Instant
from anser.parts.planners import AbstractPlanner, AircraftReport
from anser.planning.certified.planner import CertifiedPlanner
from anser.shapes import Integer, Scalar
from anser.simulation.flight import SEGMENT_STEPS, Flight, FlightState, fleet_reports, fly

fly_segment = compiled(functools.partial(fly, one_kernel=True), "flight")
"""One segment of a single flight of up to four aircraft, compiled; see `anser.simulation.fly`."""
fly_large_segment = compiled_by_older_generator(None, "flight")(fly)
"""One segment of a single flight of more aircraft, compiled."""
# Greatest number of aircraft whose step is one kernel. With more, the kernel takes longer (on two cores 16 % for eight
# aircraft, a third for twenty) and compiles twice as long or longer.
_KERNEL_AIRCRAFT = 4


def segment_program(flight: Flight) -> Program[..., Any]:
    """Return the program of a flight's segments, by the number of its aircraft."""
    return fly_segment if flight.count <= _KERNEL_AIRCRAFT else fly_large_segment


def without_replanning(flight: Flight) -> Flight:
    """Return the flight with a planner that does not replan: a smaller program, sufficient for most segments."""
    return dataclasses.replace(flight, planner=dataclasses.replace(flight.planner, allow_replanning=False))


def prepare_flight(flight: Flight, state: FlightState) -> PreparedProgram:
    """Prepare the program of a flight's segments, for a state or the shapes of a state."""
    steps = as_array(SEGMENT_STEPS, np.int32)
    return segment_program(flight).prepare(without_replanning(flight), state, as_array(0, np.int32), active_steps=steps)


def fly_with_replanning(
    flight: Flight, state: FlightState, sample: int, step_count: int = SEGMENT_STEPS
) -> tuple[FlightState, dict[str, np.ndarray]]:
    """Fly at most `SEGMENT_STEPS` steps from sample `sample` on, and replan between the steps where needed.

    Returns the state after the last step, and the recorded rows by key, each (step, aircraft).
    """
    light_flight, end, parts = without_replanning(flight), sample + step_count, []
    while sample < end:
        next_state, rows = _fly_until(end, light_flight, state, sample)
        reached = end
        if int(next_state.replan_sample) != int(state.replan_sample):
            reached = int(next_state.replan_sample)
            next_state, rows = _fly_until(reached, light_flight, state, sample)
            next_state = replan_stopped_flight(flight, next_state, reached)
        parts.append(rows)
        state, sample = next_state, reached
    return state, {key: np.concatenate([rows[key] for rows in parts]) for key in parts[0]}


def _fly_until(end: int, flight: Flight, state: FlightState, sample: int) -> tuple[FlightState, dict[str, np.ndarray]]:
    steps = end - sample
    final_state, _, rows = segment_program(flight)(
        flight, state, as_array(sample, np.int32), active_steps=as_array(steps, np.int32)
    )
    return final_state, {key: np.asarray(values)[:steps] for key, values in rows.items()}


@compiled_quickly
def sense_fleet(flight: Flight, state: FlightState, sample: Integer) -> tuple[AircraftReport, Bool[Array, " aircraft"]]:
    """Sense a fleet in flight at sample `sample`, by a compiled program.

    Returns the reports to the planner, and the mask of the aircraft that have left the fleet and still fly; both in
    fleet order.
    """
    instant = Instant(flight.environment, sample, flight.timing.step, flight.randomness)
    reports = cast_to_precision(fleet_reports(flight, state, instant)[1], float)
    is_departed = jnp.zeros(flight.count, dtype=bool)
    for group, states in zip(flight.groups, state.vehicles, strict=True):
        group_departed = group.vehicles.map(
            lambda vehicle, vehicle_state: vehicle.faults.has_departed(instant.time) & ~vehicle_state.stopped, states
        )
        is_departed = is_departed.at[jnp.asarray(group.members)].set(group_departed)
    return reports, is_departed


@compiled_by_older_generator(None)
def _replan(planner: AbstractPlanner, planner_state: Any, time: Scalar, reports: AircraftReport) -> Any:
    return planner.replan(planner_state, time, reports)


def replan_stopped_flight(flight: Flight, state: FlightState, sample: int) -> FlightState:
    """Replan a fleet in flight before the step from sample `sample` on, as the planner does in a compiled loop."""
    number, planner = as_array(sample, np.int32), flight.planner
    (reports, is_departed), time_s = sense_fleet(flight, state, number), sample * float(flight.timing.step)
    if isinstance(planner, CertifiedPlanner):
        planner_state = planner.replan_outside_loop(state.planner, time_s, reports, np.asarray(is_departed))
    else:
        planner_state = _replan(planner, state.planner, as_array(time_s), reports)
    return FlightState(state.vehicles, planner_state, number)
