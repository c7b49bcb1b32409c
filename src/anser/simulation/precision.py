"""Precision of a flight: plans are computed in float64, the steps in float64 (default) or float32."""

import dataclasses
from typing import Literal

from anser.numerics.arrays import cast_to_precision
from anser.simulation.flight import Flight, FlightState

Precision = Literal["float64", "float32"]
PRECISIONS: tuple[Precision, ...] = ("float64", "float32")


def cast_flight(flight: Flight, precision: Precision) -> Flight:
    """Convert aircraft, environment and periods of a flight to a precision.

    `fly` takes the precision of the steps from the flight. The planner is unchanged and works in float64; reports and
    plans are converted in each step.
    """
    parts = cast_to_precision((flight.environment, flight.groups, flight.timing), precision)
    environment, groups, timing = parts
    return dataclasses.replace(flight, environment=environment, groups=groups, timing=timing)


def cast_state(state: FlightState, precision: Precision) -> FlightState:
    """Convert the states of the aircraft to a precision; the planner's state is unchanged."""
    return dataclasses.replace(state, vehicles=cast_to_precision(state.vehicles, precision))
