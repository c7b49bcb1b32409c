"""Closed loop of one aircraft over one step: sense, estimate, guide, control, move; and the status codes."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from anser.aircraft.air_data import Disturbance
from anser.aircraft.airframe import AircraftState, Controls
from anser.aircraft.motion import air_data_and_forces, to_local_state, to_motion_state
from anser.environment.environment import Environment
from anser.environment.gridded_wind import has_left_field
from anser.environment.gusts import AirFlow, NoGusts
from anser.numerics.arrays import cast_like, select_if_any
from anser.numerics.randomness import AIR, AbstractRandomness
from anser.parts.perception import GOAL_DIVERGED, GOAL_NEVER_SEEN, Belief, Instant, Truth, velocity_over_ground_n
from anser.parts.planners import AircraftPlan
from anser.planning.published.coordination import DIRECTION_UNATTAINABLE, NO_BEND, PLAN_MESSAGES
from anser.shapes import Flag, Integer, ScalarLike, Vector3
from anser.simulation.recorders import AbstractRecorder, AircraftSample, GoalApproach, scan_steps
from anser.simulation.stand_off import must_break_away
from anser.simulation.vehicle import Mission, Vehicle, VehicleState, advance
from anser.spatial.rotations import rotate, rotation_from_quaternion, safe_norm
from anser.steady.trim import TrimPoint

FLYING = 0
_VEHICLE_STATUSES = range(len(PLAN_MESSAGES), len(PLAN_MESSAGES) + 10)
NO_TRIM, NOT_FINITE, BREAKAWAY, AT_GROUND, TOO_NEAR, PLAN_TOO_NEAR, LEFT_FLEET, GOAL_UNSEEN, GOAL_LOST, OUTSIDE_WIND = (
    _VEHICLE_STATUSES
)

STATUS_MESSAGES: tuple[str, ...] = (
    "arrived",
    *PLAN_MESSAGES[1:],
    "no steady flight exists at the start state: the aircraft was not flown",
    "the motion diverged to non-finite values; later samples repeat the last state",
    "broke off to stay above the least altitude: it pulled up, left its path and went to its hold",
    "the aircraft reached the ground; later samples repeat the last state",
    "came, or was about to come, nearer to its goal than a rendezvous may be (150 m to a surface goal, 100 m to an "
    "airborne one): broke off and went to its hold",
    "the plan ended nearer to the goal than a rendezvous may be (150 m to a surface goal, 100 m to an airborne one): "
    "it was refused, and the aircraft went to its hold",
    "left the fleet and flew its exit path",
    "its goal was never seen: it held at the reported position of the goal",
    "the filter of its goal diverged: it held at the last estimated position of the goal",
    "left the wind field of the file, in space or time; later samples repeat the last state",
)
"""Message of each status code: 0 (no event), the codes of the planner (`PLAN_MESSAGES`), the codes of the flight."""


def is_breakaway(status: Any) -> Any:
    """Whether a status code (or each code of an array) is a breakaway, after which the aircraft flies its hold."""
    has_left_plan = (status == BREAKAWAY) | (status == TOO_NEAR) | (status == PLAN_TOO_NEAR)
    return has_left_plan | (status == GOAL_UNSEEN) | (status == GOAL_LOST)


def is_off_plan(status: Any) -> Any:
    """Whether a status code (or each code of an array) means that the aircraft flies no path to the rendezvous.

    The result is False for `NO_BEND` and `DIRECTION_UNATTAINABLE`, because the path still leads to the rendezvous.
    """
    return (status != FLYING) & (status != NO_BEND) & (status != DIRECTION_UNATTAINABLE)


def plan_status(status: Any, planned: Any) -> Any:
    """Return the aircraft's code `status`, or the plan's code `planned` where `status` is `FLYING`."""
    return jnp.where(status == FLYING, planned.astype(status.dtype), status)


APPROACH, FROZEN, HOLD = range(3)


class Perception(eqx.Module):
    """Result of `perceive` for one aircraft at one sample."""

    truth: Truth
    belief: Belief  # the aircraft's own estimate
    flow: AirFlow  # input of the gust model
    sensors: Any  # new state of the sensors
    estimator: Any  # new state of the estimator


def true_situation(vehicle: Vehicle, state: AircraftState, instant: Instant, gusts: Any, flow: AirFlow) -> Truth:
    """Return the truth at an instant: aircraft, air data, forces, goal and disturbances."""
    time = instant.time
    airframe = vehicle.airframe_at(time)
    disturbance = Disturbance(vehicle.gusts.at(gusts, flow), vehicle.thrust_ratio_at(time))
    condition = air_data_and_forces(airframe, instant.environment, time, state, disturbance=disturbance)
    goal = None if vehicle.mission is None else vehicle.mission.goal_at(time)
    return Truth(airframe, state, condition, goal, vehicle.faults.goal_sensor_works(time), disturbance)


def air_flow(state: AircraftState, instant: Instant) -> AirFlow:
    """Return the input of the gust model at an aircraft.

    The airspeed (m/s) is relative to the mean wind; the height (m) is above altitude 0.
    """
    wind_n = instant.environment.wind.at(state.position_n, instant.time)
    R_bn = rotation_from_quaternion(state.quaternion)
    airspeed = safe_norm(state.velocity_b - rotate(R_bn, wind_n))
    return AirFlow(airspeed, -state.position_n[2], R_bn, wind_n, instant.time)


def for_aircraft(instant: Instant, index: Integer) -> Instant:
    """Return the instant with the random numbers of aircraft `index`; unchanged if the instant has none."""
    if instant.randomness is None:
        return instant
    return eqx.tree_at(lambda i: i.randomness, instant, instant.randomness.for_aircraft(index))


def trimmed_vehicle(vehicle: Vehicle, instant: Instant, trim: TrimPoint, index: ScalarLike = 0) -> VehicleState:
    """Return the initial state of an aircraft in the steady flight `trim`.

    Sensors, filters and autopilot are in the settled state of this flight. `index` is the aircraft's fleet index, which
    selects the random numbers.
    """
    return start_vehicle(vehicle, instant, trim, index)[0]


def start_vehicle(
    vehicle: Vehicle, instant: Instant, trim: TrimPoint, index: ScalarLike = 0
) -> tuple[VehicleState, Perception]:
    """Return the state from `trimmed_vehicle`, and the result of `perceive` for this state."""
    index = jnp.asarray(index, dtype=jnp.int32)
    instant = for_aircraft(instant, index)
    flow = air_flow(trim.state, instant)
    gusts = vehicle.gusts.init(_gust_normals(vehicle, instant, once=True), flow)
    truth = true_situation(vehicle, trim.state, instant, gusts, flow)
    sensors = vehicle.sensors.init(truth, instant)
    reading, next_sensors = vehicle.sensors.read(sensors, truth, instant)
    estimator = vehicle.estimator.init(reading, vehicle.airframe, instant)
    belief, next_estimator = vehicle.estimator.estimate(estimator, reading, vehicle.airframe, instant)
    state = VehicleState(
        aircraft=to_motion_state(instant.environment, trim.state),
        sensors=sensors,
        estimator=estimator,
        guidance=vehicle.guidance.init(belief, instant),
        controller=vehicle.controller.init(trim.state, jnp.stack([trim.mu, trim.alpha, trim.beta])),
        gusts=gusts,
        status=jnp.asarray(FLYING, dtype=jnp.int32),
        stopped=jnp.asarray(False),
        index=index,
    )
    return state, Perception(truth, belief, flow, next_sensors, next_estimator)


def perceive(vehicle: Vehicle, state: VehicleState, instant: Instant) -> Perception:
    """Read the sensors and update the estimator at one sample; `move` stores the new sensor and estimator states."""
    instant = for_aircraft(instant, state.index)
    local_state = to_local_state(instant.environment, state.aircraft)
    flow = air_flow(local_state, instant)
    truth = true_situation(vehicle, local_state, instant, state.gusts, flow)
    reading, sensors = vehicle.sensors.read(state.sensors, truth, instant)
    belief, estimator = vehicle.estimator.estimate(state.estimator, reading, vehicle.airframe, instant)
    return Perception(truth, belief, flow, sensors, estimator)


def _gust_normals(vehicle: Vehicle, instant: Instant, *, once: bool = False) -> Array:
    count = vehicle.gusts.normals
    return instant.normals(AIR, count, once=once) if count else jnp.zeros(0, instant.step.dtype)


class GuidedCommand(eqx.Module):
    """Result of `guide` for one aircraft at one sample."""

    command: Any
    reference_n: Vector3 | None  # position to follow, NED, m
    guidance: Any  # new state of the guidance
    approach: GoalApproach | None  # approach to the goal; None for an aircraft without a mission
    status: Integer  # status code at the sample: code of the aircraft, or code of the plan if the former is 0
    next_status: Integer  # the aircraft's own code after the checks for departure and breakaway


class ControlAction(eqx.Module):
    """Result of `control` for one aircraft at one sample."""

    controls: Controls  # surfaces and throttle, test inputs included
    signals: Any  # signals of the controller, for the record
    controller: Any  # new state of the controller


def guide(
    vehicle: Vehicle,
    state: VehicleState,
    perception: Perception,
    plan: AircraftPlan | None,  # None: no planner. An aircraft with a mission must have a plan
    instant: Instant,
    # time before the arrival during which the plan no longer changes (recorded phase `FROZEN`), s. An aircraft that has
    # not seen its goal by then breaks away
    freeze: ScalarLike = 0.0,
) -> GuidedCommand:
    """Return the command of a step, with test inputs, and the new status.

    After arrival or breakaway, the command comes from the hold (the flight after the arrival) instead of the guidance.
    Raises ValueError if an aircraft with a mission has no plan.
    """
    instant = for_aircraft(instant, state.index)
    truth, belief = perception.truth, perception.belief
    command, reference_n, guidance = vehicle.guidance.command(state.guidance, belief, plan, instant)
    status = next_status = state.status if plan is None else plan_status(state.status, plan.status)
    approach = None
    if vehicle.mission is not None:
        if plan is None:
            raise ValueError("an aircraft with a goal is flown with a plan: simulation.fly, with a planner")
        next_status = _vehicle_status(vehicle, status, belief, plan, instant, freeze)
        approach, next_status = _approach_goal(vehicle.mission, truth, belief, plan, next_status, instant, freeze)
        next_status = _own_status(state.status, status, next_status)
        mission, clearance, has_left_plan = vehicle.mission, approach.clearance, is_breakaway(next_status)
        command, reference_n = select_if_any(
            approach.phase == HOLD,
            lambda: mission.hold.command(
                belief, clearance, mission.rendezvous, mission.distance_min, plan, has_left_plan, instant
            ),
            (command, reference_n),
        )
    if vehicle.excitation is not None:
        command = vehicle.excitation.excite_command(command, instant.time)
    return GuidedCommand(command, reference_n, guidance, approach, status, next_status)


def control(
    vehicle: Vehicle, state: VehicleState, perception: Perception, guided: GuidedCommand, instant: Instant
) -> ControlAction:
    """Return surfaces and throttle of a step, with test inputs."""
    controls, signals, controller = vehicle.controller.control(
        state.controller, perception.belief, guided.command, instant.step
    )
    if vehicle.excitation is not None:
        surfaces = vehicle.airframe.actuators.names
        controls = vehicle.excitation.excite_controls(controls, surfaces, instant.time)
    return ControlAction(controls, signals, controller)


def move(
    vehicle: Vehicle,
    state: VehicleState,
    perception: Perception,
    guided: GuidedCommand,
    action: ControlAction,
    instant: Instant,
) -> VehicleState:
    """Return the state after one step with constant controls.

    An aircraft with a mission stops at the ground, outside a wind field that has no values beyond its boundary, or if a
    value is not finite; later states repeat the last valid state. An aircraft without a mission never stops.
    """
    instant = for_aircraft(instant, state.index)
    airframe = vehicle.airframe_at(instant.time)
    disturbance = perception.truth.disturbance
    aircraft = advance(
        airframe, instant.environment, instant.time, state.aircraft, action.controls, instant.step, disturbance
    )
    gusts = vehicle.gusts.advance(state.gusts, _gust_normals(vehicle, instant), perception.flow, instant.step)
    part_states = perception.sensors, perception.estimator, guided.guidance, action.controller, gusts
    # a part that computes in float64 must not change the precision of a float32 flight
    previous_parts = state.sensors, state.estimator, state.guidance, state.controller, state.gusts
    previous = state.aircraft, previous_parts
    aircraft, part_states = cast_like((aircraft, part_states), previous)
    status, stopped = guided.next_status, state.stopped
    if vehicle.mission is not None:
        finite = _all_finite((aircraft, part_states))
        position_n = to_local_state(instant.environment, aircraft).position_n
        grounded = position_n[2] >= 0.0
        next_status = jnp.where(~finite, NOT_FINITE, jnp.where(grounded, AT_GROUND, status)).astype(status.dtype)
        is_over = ~finite | grounded
        is_outside = has_left_field(instant.environment.wind, position_n, instant.time + instant.step)
        next_status = jnp.where(is_outside & ~is_over, OUTSIDE_WIND, next_status).astype(status.dtype)
        is_over = is_over | is_outside
        status = jnp.where(stopped, guided.status, next_status)
        stopped = stopped | is_over
        aircraft, part_states = jax.tree.map(
            lambda old, new: jnp.where(stopped, old, new), previous, (aircraft, part_states)
        )
    return VehicleState(aircraft, *part_states, status=status, stopped=stopped, index=state.index)


def make_sample(
    vehicle: Vehicle, perception: Perception, plan: AircraftPlan | None, guided: GuidedCommand, action: ControlAction
) -> AircraftSample:
    """Return one aircraft's sample for recorders, from the results of `perceive`, `guide` and `control`."""
    return AircraftSample(
        truth=perception.truth,
        belief=perception.belief,
        controls=action.controls,
        signals=action.signals,
        command=guided.command,
        reference_n=guided.reference_n,
        plan=plan,
        approach=guided.approach,
        status=guided.status,
        flow=None if isinstance(vehicle.gusts, NoGusts) else perception.flow,
    )


def guide_and_move(
    vehicle: Vehicle,
    state: VehicleState,
    perception: Perception,
    instant: Instant,
    plan: AircraftPlan | None = None,
    freeze: ScalarLike = 0.0,
) -> tuple[VehicleState, AircraftSample]:
    """Fly one aircraft over one step; return the next state, and the sample at the start of the step."""
    guided = guide(vehicle, state, perception, plan, instant, freeze)
    action = control(vehicle, state, perception, guided, instant)
    next_state = move(vehicle, state, perception, guided, action, instant)
    return next_state, make_sample(vehicle, perception, plan, guided, action)


def _vehicle_status(
    vehicle: Vehicle, status: Integer, belief: Belief, plan: AircraftPlan, instant: Instant, freeze: ScalarLike
) -> Integer:
    """Return the status code after the checks for departure and for an unseen or lost goal."""
    time = instant.time
    has_left = ~is_off_plan(status) & vehicle.faults.has_left_fleet(time)
    status = jnp.where(has_left, LEFT_FLEET, status).astype(status.dtype)
    if belief.uncertainty is None:
        return status
    unseen = belief.uncertainty.goal_status == GOAL_NEVER_SEEN
    lost = belief.uncertainty.goal_status == GOAL_DIVERGED
    # Until the plan is frozen, the goal may still be seen.
    unseen = unseen & (time >= plan.arrival_time - freeze)
    next_status = jnp.where(lost, GOAL_LOST, jnp.where(unseen, GOAL_UNSEEN, status))
    return jnp.where(is_off_plan(status), status, next_status).astype(status.dtype)


def _own_status(own: Any, status: Any, next_status: Any) -> Any:
    """Return the code to store: `next_status` if the checks have changed `status`, or else the previous code `own`."""
    # The code of a plan is not stored, because a later plan has its own code.
    return jnp.where(next_status == status, own, next_status)


def _approach_goal(
    mission: Mission,
    truth: Truth,
    belief: Belief,
    plan: AircraftPlan,
    status: Integer,
    instant: Instant,
    freeze: ScalarLike,
) -> tuple[GoalApproach, Integer]:
    """Return the approach to the goal, and the status code after the checks for a breakaway.

    Checks: ground clearance, and distance to the true goal (`must_break_away`).
    """
    earth, time = instant.environment.earth, instant.time
    goal = mission.goal_at(time)
    rendezvous_n = goal.position_n + mission.rendezvous.stand_off_n
    to_goal_n, goal_velocity_n = earth.sight(truth.state.position_n, goal.position_n, goal.velocity_n)
    to_rendezvous_n, _ = earth.sight(truth.state.position_n, rendezvous_n, jnp.zeros_like(rendezvous_n))
    clearance = mission.hold.clearance(belief)
    is_too_near = must_break_away(
        to_goal_n,
        velocity_over_ground_n(truth.condition, truth.state),
        goal_velocity_n,
        mission.distance_min,
        mission.hold.lateral_acceleration_max(clearance, truth.condition.earth.gravity),
        mission.hold.settings.hold_turn,
    )
    has_left_plan = is_breakaway(status)
    next_status = jnp.where(clearance.is_lost, BREAKAWAY, TOO_NEAR)
    status = jnp.where((clearance.is_lost | is_too_near) & ~has_left_plan, next_status, status).astype(status.dtype)
    approach = jnp.where(time >= plan.arrival_time - freeze, FROZEN, APPROACH)
    phase = jnp.where((time >= plan.arrival_time) | is_breakaway(status), HOLD, approach)
    return GoalApproach(
        goal=goal,
        rendezvous_n=rendezvous_n,
        to_goal_n=to_goal_n,
        to_rendezvous_n=to_rendezvous_n,
        clearance=clearance,
        phase=phase,
    ), status


def _all_finite(value: object) -> Flag:
    leaves = [leaf for leaf in jax.tree.leaves(value) if jnp.issubdtype(jnp.result_type(leaf), jnp.inexact)]
    return jnp.all(jnp.stack([jnp.all(jnp.isfinite(leaf)) for leaf in leaves]))


def fly_alone(
    vehicle: Vehicle,  # must have no mission
    environment: Environment,
    state: VehicleState,  # state at time 0
    step: ScalarLike,  # sampling period, s
    count: int,  # number of periods
    recorder: AbstractRecorder,
    randomness: AbstractRandomness | None = None,
) -> tuple[VehicleState, Any, Any]:
    """Fly one aircraft without a planner from time 0.

    Returns the final state, the final state of the recorder, and the recorder's outputs with a leading time axis.
    """
    step = jnp.asarray(step, dtype=float)

    def advance_step(state: VehicleState, number: Integer) -> tuple[VehicleState, AircraftSample, Instant]:
        instant = Instant(environment, number, step, randomness)
        next_state, sample = guide_and_move(vehicle, state, perceive(vehicle, state, instant), instant)
        return next_state, sample, instant

    return scan_steps(advance_step, state, jnp.asarray(0, dtype=jnp.int32), count, recorder, recorder.init(1))
