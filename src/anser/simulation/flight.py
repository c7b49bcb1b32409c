"""Flight of a fleet: definition, state between two steps, and the functions that fly and replan.

Plans are computed in float64; steps are computed in float64 (default) or float32 (`cast_flight`).
"""

import dataclasses
import functools
from collections.abc import Sequence
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PyTree

from anser.compiling.single_kernel import as_single_kernel
from anser.environment.environment import Environment
from anser.numerics.arrays import (
    Stacked,
    any_in_batch,
    as_array,
    cast_to_precision,
    stack_objects,
    stack_rows,
    tree_signature,
)
from anser.numerics.randomness import AbstractRandomness
from anser.parts.perception import GoalState, Instant, velocity_over_ground_n
from anser.parts.planners import AbstractPlanner, AircraftPlan, AircraftReport
from anser.shapes import Flag, Integer, Scalar, ScalarLike, Vector3
from anser.simulation.closed_loop import (
    PLAN_TOO_NEAR,
    Perception,
    control,
    guide,
    is_breakaway,
    make_sample,
    move,
    perceive,
)
from anser.simulation.recorders import (
    AbstractRecorder,
    FleetSample,
    History,
    scan_steps,
    to_fleet_order,
    to_group_order,
)
from anser.simulation.vehicle import Vehicle, VehicleState
from anser.spatial.rotations import safe_norm
from anser.steady.trim import TrimTarget


class Timing(eqx.Module):
    """Periods of a flight."""

    step: Scalar  # sampling period of the aircraft's parts, and step of the integrator, s
    replan_steps: Integer  # number of steps between plans; 0: only the first plan
    freeze: Scalar  # time before the arrival during which the plan no longer changes, s


class AircraftGroup(eqx.Module):
    """Aircraft of a fleet whose parts have the same pytree structure, shapes and dtypes, flown as one batch."""

    vehicles: Stacked[Vehicle]  # parts of the aircraft, stacked; leading axis members
    starts: TrimTarget  # steady flights at the start
    start_positions_n: Float[Array, "members 3"]  # positions at the start, NED, m
    is_real: Bool[Array, " members"]  # False for padding aircraft, which never fly
    members: tuple[int, ...] = eqx.field(static=True)  # fleet indices of the aircraft


class Flight(eqx.Module):
    """Complete definition of a flight."""

    environment: Environment
    #: The fleet by aircraft groups. `AircraftGroup.members` are the fleet indices of a group's aircraft.
    groups: tuple[AircraftGroup, ...]
    planner: AbstractPlanner
    timing: Timing
    #: Source of random numbers; None: no part may draw random numbers.
    randomness: AbstractRandomness | None = None

    @property
    def members(self) -> tuple[tuple[int, ...], ...]:
        """Fleet indices of the aircraft, by aircraft group."""
        return tuple(group.members for group in self.groups)

    @property
    def count(self) -> int:
        """Number of aircraft, padding aircraft included."""
        return sum(len(group.members) for group in self.groups)

    @property
    def surfaces(self) -> tuple[tuple[str, ...], ...]:
        """Names of the control surfaces, by aircraft in fleet order."""
        names_by_index = {
            index: group.vehicles.batched.airframe.actuators.names for group in self.groups for index in group.members
        }
        return tuple(names_by_index[index] for index in range(self.count))

    def aircraft(self, index: int) -> tuple[Vehicle, TrimTarget, Vector3]:
        """Return an aircraft by fleet index, with trim target and position (NED, m) at the start.

        Raises IndexError if the index is out of range.
        """
        for group in self.groups:
            if index in group.members:
                k = group.members.index(index)
                start = jax.tree.map(lambda leaf, k=k: leaf[k], (group.starts, group.start_positions_n))
                return group.vehicles.at(k), *start
        raise IndexError(f"a fleet of {self.count} aircraft has none at place {index}")


class FlightState(eqx.Module):
    """State of a flight between two steps."""

    vehicles: tuple[VehicleState, ...]  #: States of the aircraft by group; leading axis members.
    planner: PyTree  #: State of the planner, with the current plan.
    #: Latest sample at which `AbstractPlanner.replan_between_steps` has made a plan, or must make one; `fly` makes no
    #: plan at this sample. -1: no such sample.
    replan_sample: Integer = eqx.field(default_factory=lambda: as_array(-1, np.int32))


def assemble(
    environment: Environment,
    aircraft: Sequence[tuple[Vehicle, TrimTarget, Vector3]],
    planner: AbstractPlanner,
    step: ScalarLike,
    replan_steps: int,
    freeze: ScalarLike = 0.0,
    randomness: AbstractRandomness | None = None,
    real_count: int | None = None,
) -> Flight:
    """Build a flight; aircraft of the same structure form one group.

    Parameters
    ----------
    aircraft
        Parts, trim target at the start, and start position (NED, m) of every aircraft, in fleet order.
    step
        Sampling period, s.
    replan_steps
        Number of steps between plans; 0: only the first plan.
    freeze
        Time before the arrival during which the plan no longer changes, s.
    real_count
        Number of real aircraft, which come first. The rest are padding aircraft, which never fly; they extend the fleet
        to a size for which a compiled program exists. None: no padding.

    Raises
    ------
    ValueError
        If `aircraft` is empty, or an aircraft has no mission.
    """
    if not aircraft:
        raise ValueError("a flight needs at least one aircraft")
    missing = [str(k) for k, (vehicle, _, _) in enumerate(aircraft) if vehicle.mission is None]
    if missing:
        raise ValueError(f"aircraft without a goal cannot be planned for: place {', '.join(missing)} of the fleet")
    structures: dict[Any, list[int]] = {}
    for k, (vehicle, _, _) in enumerate(aircraft):
        structures.setdefault(tree_signature(vehicle), []).append(k)
    return Flight(
        environment=environment,
        groups=tuple(
            _stack_group(aircraft, members, len(aircraft) if real_count is None else real_count)
            for members in structures.values()
        ),
        planner=planner,
        timing=Timing(step=as_array(step), replan_steps=as_array(replan_steps, np.int32), freeze=as_array(freeze)),
        randomness=randomness,
    )


def _mission_of(vehicle: Vehicle) -> Any:
    return vehicle.mission


def _stack_group(
    aircraft: Sequence[tuple[Vehicle, TrimTarget, Vector3]], members: Sequence[int], real_count: int
) -> AircraftGroup:
    vehicles, starts, positions_n = zip(*(aircraft[k] for k in members), strict=True)
    return AircraftGroup(
        vehicles=stack_objects(vehicles, batched=_mission_of),
        starts=stack_rows(starts),
        start_positions_n=stack_rows(positions_n),
        is_real=as_array([k < real_count for k in members], bool),
        members=tuple(members),
    )


def statuses(flight: Flight, state: FlightState) -> tuple[Array, Bool[Array, " aircraft"]]:
    """Return status codes, and flags of the stopped aircraft, in fleet order."""
    return to_fleet_order([(group_state.status, group_state.stopped) for group_state in state.vehicles], flight.members)


SEGMENT_STEPS = 500
"""Number of steps in one compiled program, which flights of any duration repeat."""
_ROUNDING_M = 1e-3  # rounding tolerance of plans that end exactly at the least distance


def aircraft_report(vehicle: Vehicle, perception: Perception, is_flying: Flag, has_left: Flag) -> AircraftReport:
    """Return an aircraft's report to the planner from its belief, in chart coordinates.

    `is_flying` is true if the aircraft has neither stopped nor broken away; `has_left` is true if the aircraft has left
    the fleet. Raises ValueError if the aircraft has no goal.
    """
    belief, mission = perception.belief, vehicle.mission
    if belief.goal is None or mission is None:
        raise ValueError("only an aircraft with a goal reports to a planner")
    condition = belief.condition
    scale = condition.earth.chart_scale
    wind_n = scale * condition.wind_n
    return AircraftReport(
        position_n=belief.state.position_n,
        air_velocity_n=scale * velocity_over_ground_n(condition, belief.state) - wind_n,
        wind_n=wind_n,
        airspeed=condition.air_data.V,
        goal_position_n=belief.goal.position_n,
        goal_velocity_n=belief.goal.velocity_n,
        rendezvous=mission.rendezvous,
        active=is_flying & ~has_left,
        has_left=is_flying & has_left,
        goal_covariance=None if belief.uncertainty is None else belief.uncertainty.goal_covariance,
    )


def fleet_reports(flight: Flight, state: FlightState, instant: Instant) -> tuple[list[Perception], AircraftReport]:
    """Read the sensors of every aircraft; return perceptions by aircraft group, and the reports in fleet order."""

    def perceive_one(vehicle: Vehicle, vehicle_state: VehicleState) -> Perception:
        return perceive(vehicle, vehicle_state, instant)

    def report_one(vehicle: Vehicle, perception: Perception, current: VehicleState) -> AircraftReport:
        is_flying = ~(current.stopped | is_breakaway(current.status))
        return aircraft_report(vehicle, perception, is_flying, vehicle.faults.has_left_fleet(instant.time))

    pairs = list(zip(flight.groups, state.vehicles, strict=True))
    perceptions = [group.vehicles.map(perceive_one, states) for group, states in pairs]
    reports = [
        group.vehicles.map(report_one, perception, states)
        for (group, states), perception in zip(pairs, perceptions, strict=True)
    ]
    return perceptions, to_fleet_order(reports, flight.members)


def plans_too_near(
    flight: Flight, plans: AircraftPlan, reports: AircraftReport, time: ScalarLike
) -> Bool[Array, " aircraft"]:
    """Return flags of the aircraft whose plan ends nearer to the goal than `Mission.distance_min`, or is not finite.

    The goal moves on from the report at constant velocity. The flag is False for aircraft that are inactive or have
    arrived at `time` (s).
    """
    earth = flight.environment.earth

    def ends_too_near(vehicle: Vehicle, plan: AircraftPlan, report: AircraftReport) -> Flag:
        assert vehicle.mission is not None
        time_left = jnp.maximum(plan.arrival_time - time, 0.0)
        goal = GoalState(report.goal_position_n + time_left * report.goal_velocity_n, report.goal_velocity_n)
        end_n = plan.trajectory.position_n(plan.arrival_time)
        to_goal_n, _ = earth.sight(end_n, goal.position_n, goal.velocity_n)
        # negated comparison: true for NaN, an invalid plan
        return ~(safe_norm(to_goal_n) >= vehicle.mission.distance_min - _ROUNDING_M)

    too_near = [
        group.vehicles.map(ends_too_near, *to_group_order((plans, reports), group.members, flight.count))
        for group in flight.groups
    ]
    # An arrived aircraft no longer flies its plan; an inactive aircraft has no new plan.
    return to_fleet_order(too_near, flight.members) & reports.active & (plans.arrival_time > time)


def _replan_if_due(
    flight: Flight, state: FlightState, sample: Integer, reports: AircraftReport
) -> tuple[Any, Bool[Array, " aircraft"]]:
    """Replan if due; return planner state and flags of new plans that end too near the goal (`plans_too_near`)."""
    timing, planner = cast_to_precision(flight.timing, float), flight.planner
    time = sample * timing.step
    plans = planner.plans(state.planner)
    is_frozen = time >= plans.arrival_time - timing.freeze
    is_needed = ~jnp.all(is_frozen | ~reports.active)
    # The same for all flights of a batch: with a batched condition, the costly planning would run at every step.
    is_due = (timing.replan_steps > 0) & (sample % jnp.maximum(timing.replan_steps, 1) == 0) & any_in_batch(is_needed)

    is_open = is_needed & (sample != state.replan_sample)

    def replan() -> tuple[Any, Bool[Array, " aircraft"]]:
        replanned = planner.replan(state.planner, time, reports)
        replanned = jax.tree.map(lambda new, old: jnp.where(is_open, new, old), replanned, state.planner)
        return replanned, is_needed & plans_too_near(flight, planner.plans(replanned), reports, time)

    return jax.lax.cond(is_due, replan, lambda: (state.planner, jnp.zeros(flight.count, dtype=bool)))


def send_to_hold(
    flight: Flight, vehicles: Sequence[VehicleState], refused: Bool[Array, " aircraft"]
) -> tuple[VehicleState, ...]:
    """Return the states by group, with status `PLAN_TOO_NEAR` for aircraft in `refused`, which then fly to their hold.

    `refused` is in fleet order. Aircraft that have stopped or broken away keep their status.
    """

    def updated_state(state: VehicleState, no_plan: Array) -> VehicleState:
        is_sent = no_plan & ~state.stopped & ~is_breakaway(state.status)
        return eqx.tree_at(lambda s: s.status, state, jnp.where(is_sent, PLAN_TOO_NEAR, state.status))

    return tuple(
        updated_state(state, to_group_order(refused, group.members, flight.count))
        for group, state in zip(flight.groups, vehicles, strict=True)
    )


def step_fleet(
    flight: Flight, state: FlightState, sample: Integer, *, one_kernel: bool = False
) -> tuple[FlightState, FleetSample, Instant]:
    """Fly the fleet over step number `sample`; return the next state, and quantities and instant at the step's start.

    `one_kernel` has the same meaning as in `fly`.
    """
    instant = Instant(flight.environment, sample, flight.timing.step, flight.randomness)
    perceptions, reports = fleet_reports(flight, state, instant)
    reports = cast_to_precision(reports, float)
    planner, refused = _replan_if_due(flight, state, sample, reports)
    plans = cast_to_precision(flight.planner.plans(planner), instant.step.dtype)
    group_states = send_to_hold(flight, state.vehicles, refused)

    guide_one = functools.partial(guide, instant=instant, freeze=flight.timing.freeze)
    control_one, move_one = functools.partial(control, instant=instant), functools.partial(move, instant=instant)
    next_states, samples = [], []
    for group, states, perception in zip(flight.groups, group_states, perceptions, strict=True):
        vehicles, group_plans = group.vehicles, to_group_order(plans, group.members, flight.count)
        # Three kernels, which LLVM compiles at the same time; a loop over the aircraft is traced and compiled faster.
        # Sensors and estimators are no kernel: the matrices of a filter would compile more slowly and run no faster.
        over_aircraft = vehicles.map
        if one_kernel:
            over_aircraft = as_single_kernel(vehicles.loop, otherwise=as_single_kernel(vehicles.map))
        guided = over_aircraft(guide_one, states, perception, group_plans)
        action = over_aircraft(control_one, states, perception, guided)
        next_states.append(over_aircraft(move_one, states, perception, guided, action))
        samples.append(vehicles.map(make_sample, perception, group_plans, guided, action))
    step = cast_to_precision(flight.timing.step, float)
    is_replan_missing = flight.planner.replan_needed(planner) & ~flight.planner.replan_needed(state.planner)
    replan_sample = jnp.where(is_replan_missing, sample, state.replan_sample)
    planner = flight.planner.observe(planner, reports, sample, step, flight.randomness)
    next_state = FlightState(tuple(next_states), planner, replan_sample)
    return next_state, FleetSample(tuple(samples), flight.members), instant


def fly(
    flight: Flight,
    state: FlightState,
    first_step: Integer,
    count: int = SEGMENT_STEPS,
    recorder: AbstractRecorder | None = None,
    recorder_state: Any = None,
    *,
    one_kernel: bool = False,
    active_steps: Integer | None = None,
    packed_rows: bool = False,
) -> tuple[FlightState, Any, Any]:
    """Fly a fleet for `count` steps and record the flight.

    The function is pure. Do not batch `first_step` or the flight's `timing` with `vmap`, because planning would then
    run at every step.

    Parameters
    ----------
    state
        State before the first step, from `start_flight` or an earlier call.
    first_step
        Number of the first step: 0 at the start.
    recorder
        None: every variable is recorded at every step.
    recorder_state
        Present state of the recorder; None: initial state.
    one_kernel
        True: on a CPU, guidance, control and motion become one compiled kernel each. A single flight of up to four
        aircraft is then 1.1 to 3 times as fast. Must not be used for batched flights.
    active_steps
        Number of steps to fly; recorder outputs of later steps have no meaning. None: `count`.
    packed_rows
        True: the recorder's outputs are returned in one array, `PackedRows`, and the flight ends after the step at
        which `FlightState.replan_sample` changes, because the planner needs a new plan. Requires `active_steps`, and a
        recorder with an output at every step.

    Returns
    -------
    State after the last step, state of the recorder, and the recorder's outputs with leading axes (time, aircraft).
    """
    recorder = History() if recorder is None else recorder
    recorder_state = recorder.init(flight.count) if recorder_state is None else recorder_state

    def advance_step(flight_state: FlightState, number: Integer) -> tuple[FlightState, FleetSample, Instant]:
        return step_fleet(flight, flight_state, number, one_kernel=one_kernel)

    first = jnp.asarray(first_step, dtype=jnp.int32)
    return scan_steps(
        *(advance_step, state, first, count, recorder, recorder_state, active_steps, packed_rows),
        is_final=(lambda flown: flown.replan_sample != state.replan_sample) if packed_rows else None,
    )


Precision = Literal["float64", "float32"]
PRECISIONS: tuple[Precision, ...] = ("float64", "float32")


def cast_flight(flight: Flight, precision: Precision) -> Flight:
    """Convert aircraft, environment and periods of a flight to the precision in which `fly` must compute the steps.

    The planner is unchanged and works in float64.
    """
    parts = cast_to_precision((flight.environment, flight.groups, flight.timing), precision)
    environment, groups, timing = parts
    return dataclasses.replace(flight, environment=environment, groups=groups, timing=timing)


def cast_state(state: FlightState, precision: Precision) -> FlightState:
    """Return the state with the aircraft's states in a precision; the planner's state is unchanged."""
    return dataclasses.replace(state, vehicles=cast_to_precision(state.vehicles, precision))
