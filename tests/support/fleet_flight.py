"""Flights of a fleet segment by segment, with changes to the aircraft of a single group."""

import equinox as eqx
import jax
import numpy as np

from anser.missions.first_plan import _start_flight
from anser.missions.segments import fly_with_replanning
from anser.simulation.flight import SEGMENT_STEPS


def started(flight):
    """State of a flight at time 0 with the published planner's first plan."""
    return _start_flight(flight)[0]


def segment(flight, state, number=0):
    """State after one segment, flown as in `anser.run`, and its history; `number` counts segments from the start."""
    next_state, history = fly_with_replanning(flight, state, SEGMENT_STEPS * number)
    return next_state, history


def segments(flight, state, count):
    """State after `count` segments from the start, and the whole history."""
    parts = []
    for number in range(count):
        state, history = segment(flight, state, number)
        parts.append(jax.tree.map(np.asarray, history))
    return state, {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}


def own(state):
    """States of the aircraft of a fleet with a single group."""
    (of_kind,) = state.vehicles
    return of_kind


def with_own(select, state, values):
    """The flight's state with replaced values in the aircraft's state; `select` chooses them in `own`."""
    return eqx.tree_at(lambda s: select(s.vehicles[0]), state, values)


def parts_of(flight):
    """Parts of the aircraft of a fleet with a single group; shared leaves have no leading axis."""
    (kind,) = flight.groups
    return eqx.combine(kind.vehicles.batched, kind.vehicles.shared)
