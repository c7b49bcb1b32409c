"""Precision of a flight: planned in float64, and flown in that of its numbers, which is float64 but where asked."""

import dataclasses
from typing import Any, Literal, TypeVar

import jax
import jax.numpy as jnp

from anser.numerics import as_array
from anser.simulation.fleet import Flight, FlightState

T = TypeVar("T")

Precision = Literal["float64", "float32"]
PRECISIONS: tuple[Precision, ...] = ("float64", "float32")


def in_precision(value: T, dtype: Any) -> T:
    """All real numbers, or shapes of some, in a precision; what has it already stays as it is."""
    wanted = jnp.dtype(dtype)

    def one(leaf: Any) -> Any:
        if not jnp.issubdtype(leaf.dtype, jnp.floating) or leaf.dtype == wanted:
            return leaf
        if isinstance(leaf, jax.ShapeDtypeStruct):
            return jax.ShapeDtypeStruct(leaf.shape, wanted)
        return as_array(leaf, wanted)

    return jax.tree.map(one, value)


def flight_in(flight: Flight, precision: Precision) -> Flight:
    """The flight with aircraft, environment and periods in a precision.

    `fly` takes the precision of its steps from them; the planner stays as it is and plans in float64, from reports and
    for plans that are converted on the way.
    """
    parts = in_precision((flight.environment, flight.kinds, flight.timing), precision)
    environment, kinds, timing = parts
    return dataclasses.replace(flight, environment=environment, kinds=kinds, timing=timing)


def state_in(state: FlightState, precision: Precision) -> FlightState:
    """The state of a flight with that of every aircraft in a precision; its planner's stays as it is."""
    return dataclasses.replace(state, vehicles=in_precision(state.vehicles, precision))
