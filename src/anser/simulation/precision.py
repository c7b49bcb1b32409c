"""Precision of a flight: planned in float64, and flown in that of its numbers, which is float64 but where asked."""

import dataclasses
from typing import Literal

from anser.numerics.arrays import cast_to_precision
from anser.simulation.flight import Flight, FlightState

Precision = Literal["float64", "float32"]
PRECISIONS: tuple[Precision, ...] = ("float64", "float32")


def cast_flight(flight: Flight, precision: Precision) -> Flight:
    """The flight with aircraft, environment and periods in a precision.

    `fly` takes the precision of its steps from them; the planner stays as it is and plans in float64, from reports and
    for plans that are converted on the way.
    """
    parts = cast_to_precision((flight.environment, flight.groups, flight.timing), precision)
    environment, kinds, timing = parts
    return dataclasses.replace(flight, environment=environment, groups=kinds, timing=timing)


def cast_state(state: FlightState, precision: Precision) -> FlightState:
    """The state of a flight with that of every aircraft in a precision; its planner's stays as it is."""
    return dataclasses.replace(state, vehicles=cast_to_precision(state.vehicles, precision))
