"""The start of a flight: a fleet trimmed, what it reports to the planner, the state at time 0."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from anser.aircraft.motion import flight_condition
from anser.parts.perception import Instant
from anser.parts.planners import AircraftReport, Performance
from anser.shapes import Flag, Vector3
from anser.simulation.closed_loop import NO_TRIM, perceive, plan_status, trimmed_vehicle
from anser.simulation.flight import (
    Flight,
    FlightState,
    merge_groups,
    plans_too_near,
    report,
    select_group_rows,
    send_to_hold,
)
from anser.simulation.vehicle import Vehicle, VehicleState
from anser.steady.performance import performance_at
from anser.steady.trim import EXCESS_NOISE, TrimPoint, TrimTarget, solve_trim


class TrimmedFleet(eqx.Module):
    """A fleet trimmed at its start, which has no plan yet.

    Attributes
    ----------
    trims
        Steady flight of each, by kind; leading axis members.
    steady
        Whether each has one, within its limits; leading axis aircraft.
    vehicles
        The state of each there, by kind.
    reports
        What each reports to the planner; leading axis aircraft.
    performance
        What each can do along its path; leading axis aircraft.
    """

    trims: tuple[TrimPoint, ...]
    is_trimmed: Bool[Array, " aircraft"]
    vehicles: tuple[VehicleState, ...]
    reports: AircraftReport
    performance: Performance


def trimmed_fleet(flight: Flight) -> TrimmedFleet:
    """Trim every aircraft at its start and look at its goal, at time 0."""
    environment, timing = flight.environment, flight.timing
    instant = Instant(environment, jnp.asarray(0, dtype=jnp.int32), timing.step, flight.randomness)

    def one(vehicle: Vehicle, target: TrimTarget, place_n: Vector3, is_real: Flag, index: Array) -> Any:
        trim = solve_trim(vehicle.airframe, environment, target, place_n)
        state = trimmed_vehicle(vehicle, instant, trim, index)
        untrimmed = ~trim.converged | (trim.excess > EXCESS_NOISE)
        status = jnp.where(untrimmed, NO_TRIM, state.status).astype(jnp.int32)
        state = eqx.tree_at(lambda s: (s.status, s.stopped), state, (status, untrimmed | ~is_real))
        seen = perceive(vehicle, state, instant)
        known, now = seen.belief.airframe, seen.truth.condition
        if known is not vehicle.airframe:  # what the planner knows is what the aircraft takes itself to be
            now = flight_condition(known, environment, instant.time, trim.state)
        performance = performance_at(known, environment, now, trim.state.surfaces)
        return (trim, state), (~untrimmed, report(vehicle, seen, ~state.stopped), performance)

    found = [
        kind.vehicles.map(
            one, kind.starts, kind.start_positions_n, kind.is_real, jnp.asarray(kind.members, dtype=jnp.int32)
        )
        for kind in flight.groups
    ]
    trims, states = zip(*(own for own, _ in found), strict=True)
    steady, reports, performance = merge_groups(flight, [of_all for _, of_all in found])
    return TrimmedFleet(trims, steady, states, reports, performance)


def start_flight(flight: Flight) -> tuple[FlightState, TrimmedFleet]:
    """Trim every aircraft at its start and make the first plan, at time 0.

    Of a planner whose first plan is one program: that of the certified planner is a search, see `begin`.
    """
    fleet = trimmed_fleet(flight)
    return initialize_flight(
        flight, fleet, flight.planner.first_plan(jnp.zeros(()), fleet.reports, fleet.performance)
    ), fleet


def initialize_flight(flight: Flight, fleet: TrimmedFleet, planner: Any) -> FlightState:
    """State of a flight at time 0 with its planner's state, the first plan among it.

    An aircraft whose plan ends nearer to its goal than a rendezvous may be does not fly it, see `PLAN_TOO_NEAR`.
    """
    plans = flight.planner.plans(planner)
    vehicles = send_to_hold(flight, fleet.vehicles, plans_too_near(flight, plans, fleet.reports, 0.0))
    vehicles = tuple(
        eqx.tree_at(
            lambda s: s.status, state, plan_status(state.status, select_group_rows(plans.status, kind, flight.count))
        )
        for kind, state in zip(flight.groups, vehicles, strict=True)
    )
    return FlightState(vehicles, planner)
