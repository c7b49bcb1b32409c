"""Planning a fleet anew in flight, after something has happened."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.planning.certified import AircraftTask, CertifiedPlan, Standing
from anser.planning.certified.certified_plan import certify
from anser.planning.certified.renewal import COMMITTED_S, from_plan, intervals_of
from anser.sensing import Instant
from anser.shapes import Count
from anser.simulation.certified_planner import CertifiedPlanner, CertifiedPlanState
from anser.simulation.fleet import Flight, FlightState
from anser.simulation.flight import fleet_reports
from anser.simulation.leaving import leaving_path

TURNS = (0.0, 0.25, -0.25, 0.5, -0.5, 0.8, -0.8, 1.2, -1.2, 1.6, -1.6, 2.2, -2.2, 3.1, -3.1)
"""Turns that are tried, in this order, for an aircraft that leaves, rad."""


class Present(NamedTuple):
    """A fleet in flight, as the planner sees it.

    Attributes
    ----------
    tasks
        From where the plan has each aircraft now to its goal as it is sensed now; active: those that may be planned.
    standing
        The paths in force of all others that fly: they have arrived, are about to, or have left.
    seen
        The tasks with every aircraft active that flies, those that have left among them.
    """

    tasks: AircraftTask
    standing: Standing
    seen: AircraftTask


def present(flight: Flight, state: FlightState, number: Count) -> Present:
    """A fleet planned by the certified planner, at a sample; `flight` says who has left by then."""
    instant = Instant(flight.environment, number, flight.timing.step, flight.randomness)
    planner, memory = _certified(flight, state)
    _, reports = fleet_reports(flight, state, instant)
    plan, now = memory.plan, instant.time
    seen = planner.aircraft_tasks(reports, memory.limits)
    free = reports.active & (plan.arrival_times - now > jnp.maximum(planner.freeze, COMMITTED_S))
    left = left_fleet(flight, state, now)
    here = jax.vmap(from_plan, in_axes=(0, 0, None))(plan.paths, seen, now)
    here = eqx.tree_at(lambda t: t.active, here, jnp.where(free, 1.0, 0.0))
    flies = reports.active | left
    standing = Standing(flies & ~free, plan.paths, plan.arrival_times)
    seen = eqx.tree_at(lambda t: t.active, seen, jnp.where(flies, 1.0, 0.0))
    return Present(here, standing, seen)


def left_fleet(flight: Flight, state: FlightState, now: Array) -> Bool[Array, " aircraft"]:
    """Who has left by a time (s), and is in the air."""
    rows = jnp.zeros(flight.count, dtype=bool)
    for kind, states in zip(flight.kinds, state.vehicles, strict=True):
        gone = kind.vehicles.map(lambda vehicle, one: vehicle.faults.left(now) & ~one.stopped, states)
        rows = rows.at[jnp.asarray(kind.members)].set(gone)
    return rows


def leaving(
    flight: Flight, state: FlightState, number: Count, who: Count, until: Array, turns: Float[Array, " turns"]
) -> tuple[CertifiedPlan, Float[Array, " turns"]]:
    """The plan in force with one aircraft on its way out by the first of some turns that keeps clear of the others.

    Parameters
    ----------
    flight, state, number
        The fleet at a sample.
    who
        Its place in the fleet.
    until
        End of the flight, s.
    turns
        From its course, rad, in the order of preference.

    Returns
    -------
    The plan, in which it arrives nowhere before the end; and for each turn the least ratio of its distances from the
    others, on their paths, to the separation: 1 is enough. Where none keeps clear, the one that does most is flown.
    """
    planner, memory = _certified(flight, state)
    plan, now = memory.plan, number * flight.timing.step
    airspace, tasks = planner.airspace, present(flight, state, number).seen
    own = jax.tree.map(lambda leaf: leaf[who], plan.paths)

    def along(turn: Array) -> tuple[CertifiedPlan, Array]:
        path = leaving_path(own, now, until, turn, airspace.wind, airspace.gravity)
        paths = jax.tree.map(lambda all_, one: all_.at[who].set(one), plan.paths, path)
        certificate = certify(paths, tasks, airspace, intervals_of(paths), now)
        out = eqx.tree_at(
            lambda p: (p.paths, p.arrival_times, p.certificate),
            plan,
            (paths, plan.arrival_times.at[who].set(until), certificate),
        )
        return out, jnp.min(certificate.clearance_ratio[who])

    plans, ratios = jax.lax.map(along, turns)
    clear = ratios >= 1.0
    chosen = jnp.where(jnp.any(clear), jnp.argmax(clear), jnp.argmax(ratios))
    return jax.tree.map(lambda leaf: leaf[chosen], plans), ratios


def with_plan(state: FlightState, plan: CertifiedPlanState) -> FlightState:
    """The same fleet with another plan in force."""
    return eqx.tree_at(lambda s: s.planner, state, plan)


def _certified(flight: Flight, state: FlightState) -> tuple[CertifiedPlanner, CertifiedPlanState]:
    if not isinstance(flight.planner, CertifiedPlanner):
        raise TypeError(f"planned anew in flight: arrived a {type(flight.planner).__name__}, expected CertifiedPlanner")
    return flight.planner, state.planner
