"""Flying a fleet segment by segment, and changing the aircraft of a fleet of one kind."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from anser.missions.plans import _start_flight
from anser.missions.runs import fly_segment, without_replanning
from anser.simulation.flight import SEGMENT_STEPS


def started(flight):
    """State of a flight at time 0 with the published planner's first plan."""
    return _start_flight(flight)[0]


def segment(flight, state, number=0):
    """State after one segment, and its history; `number` counts segments from the start.

    As `anser.run` flies it: by the program that plans anew only where a new plan is asked for.
    """
    at = jnp.asarray(SEGMENT_STEPS * number, dtype=jnp.int32)
    after, _, history = fly_segment(without_replanning(flight), state, at)
    if after.planner.replan_needed:
        after, _, history = fly_segment(flight, state, at)
    return after, history


def segments(flight, state, count):
    """State after so many segments from the start on, and the whole history."""
    parts = []
    for number in range(count):
        state, history = segment(flight, state, number)
        parts.append(jax.tree.map(np.asarray, history))
    return state, {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}


def own(state):
    """States of the aircraft of a fleet of one kind."""
    (of_kind,) = state.vehicles
    return of_kind


def with_own(where, state, values):
    """The flight's state with other values in the aircraft's; `where` chooses among `own`."""
    return eqx.tree_at(lambda s: where(s.vehicles[0]), state, values)


def parts_of(flight):
    """Parts of the aircraft of a fleet of one kind; common leaves have no leading axis."""
    (kind,) = flight.groups
    return eqx.combine(kind.vehicles.batched, kind.vehicles.shared)
