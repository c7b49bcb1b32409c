"""The closed loop of a fleet: all perceive, the plan is renewed when it is due, all act."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from anser.compiling import as_one_kernel
from anser.numerics import any_in_batch, in_precision
from anser.planning import AircraftPlan, Report
from anser.sensing import GoalState, Instant, velocity_over_ground_n
from anser.shapes import Count, Flag, ScalarLike
from anser.simulation.closed_loop import Perceived, act, perceive
from anser.simulation.fleet import Flight, FlightState, fleet_rows, of_members
from anser.simulation.recorder import AbstractRecorder, FleetSample, History, scanned
from anser.simulation.status import PLAN_TOO_NEAR, broken_off
from anser.simulation.vehicle import Vehicle, VehicleState
from anser.spatial import safe_norm

SEGMENT_STEPS = 500
"""Steps compiled as one: a flight of any duration is a number of these, so the duration does not recompile."""
_ROUNDING_M = 1e-3  # by which a plan that ends at the least distance itself may be nearer


def report(vehicle: Vehicle, seen: Perceived, active: Flag) -> Report:
    """What an aircraft with a mission reports to the planner."""
    belief, mission = seen.belief, vehicle.mission
    if belief.goal is None or mission is None:
        raise ValueError("only an aircraft with a goal reports to a planner")
    now = belief.now
    scale = now.earth.chart_scale
    wind_n = scale * now.wind_n
    return Report(
        position_n=belief.state.position_n,
        air_velocity_n=scale * velocity_over_ground_n(now, belief.state) - wind_n,
        wind_n=wind_n,
        airspeed=now.air_data.V,
        goal_position_n=belief.goal.position_n,
        goal_velocity_n=belief.goal.velocity_n,
        rendezvous=mission.rendezvous,
        active=active,
        goal_covariance=None if belief.uncertainty is None else belief.uncertainty.goal_covariance,
    )


def fleet_reports(
    flight: Flight, state: FlightState, instant: Instant, *, one_kernel: bool = False
) -> tuple[list[Perceived], Report]:
    """What each aircraft perceives, by kinds, and what all of them report to the planner; leading axis aircraft."""
    compiled = as_one_kernel if one_kernel else lambda function: function

    def perceived(vehicle: Vehicle, before: VehicleState) -> Perceived:
        return perceive(vehicle, before, instant)

    def reported(vehicle: Vehicle, seen: Perceived, before: VehicleState) -> Report:
        away = before.stopped | broken_off(before.status) | vehicle.faults.left(instant.time)
        return report(vehicle, seen, ~away)

    pairs = list(zip(flight.kinds, state.vehicles, strict=True))
    seen = [compiled(kind.vehicles.map)(perceived, states) for kind, states in pairs]
    told = [kind.vehicles.map(reported, one, states) for (kind, states), one in zip(pairs, seen, strict=True)]
    return seen, fleet_rows(flight, told)


def plans_too_near(flight: Flight, plans: AircraftPlan, reports: Report, time: ScalarLike) -> Bool[Array, " aircraft"]:
    """Which plans end nearer to the goal, as it is foreseen at steady velocity, than a rendezvous may be."""
    earth = flight.environment.earth

    def one(vehicle: Vehicle, plan: AircraftPlan, report: Report) -> Flag:
        assert vehicle.mission is not None
        ahead = jnp.maximum(plan.arrival_time - time, 0.0)
        goal = GoalState(report.goal_position_n + ahead * report.goal_velocity_n, report.goal_velocity_n)
        end_n = plan.trajectory.position_n(plan.arrival_time)
        to_goal_n, _ = earth.sight(end_n, goal.position_n, goal.velocity_n)
        # not a number: there is no such plan
        return ~(safe_norm(to_goal_n) >= vehicle.mission.distance_min - _ROUNDING_M)

    found = [kind.vehicles.map(one, *of_members((plans, reports), kind, flight.count)) for kind in flight.kinds]
    # What has arrived is flown no more, and what does not fly has no plan of now.
    return fleet_rows(flight, found) & reports.active & (plans.arrival_time > time)


def _renewed(
    flight: Flight, state: FlightState, number: Count, reports: Report
) -> tuple[Any, Bool[Array, " aircraft"]]:
    """The planner's state with a plan renewed where that is due, and which new plans are refused."""
    timing, planner = in_precision(flight.timing, float), flight.planner
    time = number * timing.step
    plans = planner.plans(state.planner)
    frozen = time >= plans.arrival_time - timing.freeze
    needed = ~jnp.all(frozen | ~reports.active)
    # Free of what a batch of flights has different: planning is costly, and would run at every step otherwise.
    due = (timing.replan_steps > 0) & (number % jnp.maximum(timing.replan_steps, 1) == 0) & any_in_batch(needed)

    def anew() -> tuple[Any, Bool[Array, " aircraft"]]:
        made = planner.renew(state.planner, time, reports)
        made = jax.tree.map(lambda new, old: jnp.where(needed, new, old), made, state.planner)
        return made, needed & plans_too_near(flight, planner.plans(made), reports, time)

    return jax.lax.cond(due, anew, lambda: (state.planner, jnp.zeros(flight.count, dtype=bool)))


def refuse(
    flight: Flight, vehicles: Sequence[VehicleState], refused: Bool[Array, " aircraft"]
) -> tuple[VehicleState, ...]:
    """The aircraft, those with a refused plan on their way into their holds."""

    def one(state: VehicleState, no_plan: Array) -> VehicleState:
        away = no_plan & ~state.stopped & ~broken_off(state.status)
        return eqx.tree_at(lambda s: s.status, state, jnp.where(away, PLAN_TOO_NEAR, state.status))

    return tuple(
        one(state, of_members(refused, kind, flight.count)) for kind, state in zip(flight.kinds, vehicles, strict=True)
    )


def step_fleet(
    flight: Flight, state: FlightState, number: Count, *, one_kernel: bool = False
) -> tuple[FlightState, FleetSample, Instant]:
    """Fly the fleet over one step; the next state, and everything known at the step's start (see `fly`)."""
    instant = Instant(flight.environment, number, flight.timing.step, flight.randomness)
    compiled = as_one_kernel if one_kernel else lambda function: function
    seen, reports = fleet_reports(flight, state, instant, one_kernel=one_kernel)
    reports = in_precision(reports, float)
    planner, refused = _renewed(flight, state, number, reports)
    plans = in_precision(flight.planner.plans(planner), instant.step.dtype)
    vehicles = refuse(flight, state.vehicles, refused)

    def acted(vehicle: Vehicle, before: VehicleState, perceived: Perceived, plan: AircraftPlan) -> Any:
        return act(vehicle, before, perceived, instant, plan, flight.timing.freeze)

    moved = [
        compiled(kind.vehicles.map)(acted, before, one, of_members(plans, kind, flight.count))
        for kind, before, one in zip(flight.kinds, vehicles, seen, strict=True)
    ]
    step = in_precision(flight.timing.step, float)
    planner = flight.planner.observe(planner, reports, number, step, flight.randomness)
    after = FlightState(tuple(states for states, _ in moved), planner)
    return after, FleetSample(tuple(samples for _, samples in moved), flight.members), instant


def fly(
    flight: Flight,
    state: FlightState,
    since: Count,
    count: int = SEGMENT_STEPS,
    recorder: AbstractRecorder | None = None,
    memory: Any = None,
    *,
    one_kernel: bool = False,
    flown: Count | None = None,
) -> tuple[FlightState, Any, Any]:
    """Fly a number of steps.

    Pure: to be compiled, batched by `vmap` over flights and states (`since` must not be batched, nor should `timing`
    be: planning would run at every step), differentiated, or moved to a GPU.

    Parameters
    ----------
    flight
        What flies.
    state
        Before the first step, from `start_flight` or from here.
    since
        Number of the first step: 0 at the start.
    count
        Number of steps.
    recorder, memory
        What is to be kept, and what has been so far (None: nothing yet); every variable at every step where no recorder
        is given.
    one_kernel
        Whether what each aircraft does in a step is compiled as one kernel where the machine is a CPU. It makes a
        flight by itself two to three times as fast; one that is to be batched must not be compiled so.
    flown
        How many of the steps are flown; the rows of the others mean nothing. None: all.

    Returns
    -------
    The state after the last step, the recorder's memory, and its rows: leading axis time, then aircraft.
    """
    recorder = History() if recorder is None else recorder
    memory = recorder.init(flight.count) if memory is None else memory

    def one(before: FlightState, number: Count) -> tuple[FlightState, FleetSample, Instant]:
        return step_fleet(flight, before, number, one_kernel=one_kernel)

    return scanned(one, state, jnp.asarray(since, dtype=jnp.int32), count, recorder, memory, flown)
