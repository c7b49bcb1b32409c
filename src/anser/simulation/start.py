"""Start of a flight: the trimmed fleet, its reports to the planner, and the state at time 0."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.aircraft.motion import air_data_and_forces
from anser.compiling.program import strongly_typed
from anser.parts.perception import Instant
from anser.parts.planners import AircraftReport, Performance
from anser.shapes import Flag, Vector3
from anser.simulation.closed_loop import NO_TRIM, start_vehicle
from anser.simulation.flight import Flight, FlightState, aircraft_report, plans_too_near, send_to_hold
from anser.simulation.recorders import to_fleet_order
from anser.simulation.vehicle import Vehicle, VehicleState
from anser.steady.performance import performance_at
from anser.steady.trim import LIMIT_TOLERANCE, TrimPoint, TrimTarget, solve_trim


class TrimmedFleet(eqx.Module):
    """Trim points, first reports and performance of a fleet at its start, before the first plan."""

    trims: tuple[TrimPoint, ...]  # by aircraft group
    is_trimmed: Bool[Array, " aircraft"]  # whether a steady flight within the limits exists
    vehicles: tuple[VehicleState, ...]  # states at time 0, by aircraft group
    reports: AircraftReport  # leading axis aircraft
    performance: Performance  # greatest acceleration and deceleration along the path; leading axis aircraft

    @property
    def alphas(self) -> tuple[Float[Array, "..."], ...]:
        """Angles of attack of the trim points, rad, an array for each aircraft group."""
        return tuple(trim.alpha for trim in self.trims)


def trimmed_fleet(flight: Flight) -> TrimmedFleet:
    """Trim every aircraft at its start, and return trim points, first reports and performance at time 0.

    If an aircraft has no steady flight within the limits, the aircraft is stopped with the status `NO_TRIM`. Padding
    aircraft are stopped too.
    """
    environment, timing = flight.environment, flight.timing
    instant = Instant(environment, jnp.asarray(0, dtype=jnp.int32), timing.step, flight.randomness)

    def trim_one(vehicle: Vehicle, target: TrimTarget, position_n: Vector3, is_real: Flag, index: Array) -> Any:
        trim = solve_trim(vehicle.airframe, environment, target, position_n)
        state, perception = start_vehicle(vehicle, instant, trim, index)
        is_untrimmed = ~trim.converged | (trim.excess > LIMIT_TOLERANCE)
        status = jnp.where(is_untrimmed, NO_TRIM, state.status).astype(jnp.int32)
        state = eqx.tree_at(lambda s: (s.status, s.stopped), state, (status, is_untrimmed | ~is_real))
        airframe, condition = perception.belief.airframe, perception.truth.condition
        if airframe is not vehicle.airframe:  # the planner uses the aircraft's own model
            condition = air_data_and_forces(airframe, environment, instant.time, trim.state)
        performance = performance_at(airframe, environment, condition, trim.state.surfaces)
        report = aircraft_report(vehicle, perception, ~state.stopped, jnp.asarray(False))
        return (trim, state), (~is_untrimmed, report, performance)

    results = [
        group.vehicles.loop(
            trim_one, group.starts, group.start_positions_n, group.is_real, jnp.asarray(group.members, dtype=jnp.int32)
        )
        for group in flight.groups
    ]
    trims, states = zip(*(group_result for group_result, _ in results), strict=True)
    is_trimmed, reports, performance = to_fleet_order([fleet_result for _, fleet_result in results], flight.members)
    return TrimmedFleet(trims, is_trimmed, states, reports, performance)


def start_flight(flight: Flight) -> tuple[FlightState, TrimmedFleet]:
    """Trim every aircraft and compute the first plan (`flight.planner.first_plan`); return state and trimmed fleet."""
    fleet = trimmed_fleet(flight)
    return initialize_flight(
        flight, fleet, flight.planner.first_plan(jnp.zeros(()), fleet.reports, fleet.performance)
    ), fleet


def initialize_flight(flight: Flight, fleet: TrimmedFleet, planner: Any) -> FlightState:
    """Return the state of a flight at time 0; `planner` must be the planner's state with the first plan.

    If a plan ends nearer to the goal than allowed, the aircraft goes to its hold instead (`PLAN_TOO_NEAR`).
    """
    plans = flight.planner.plans(planner)
    vehicles = send_to_hold(flight, fleet.vehicles, plans_too_near(flight, plans, fleet.reports, 0.0))
    return strongly_typed(FlightState(vehicles, planner))
