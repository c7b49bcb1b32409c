"""The closed loop of a whole fleet: sense, plan, guide, control, move, record; compiled in segments of fixed length."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from anser.aircraft import AbstractAirframe, AircraftState, Condition, MotionState, condition, seen_state
from anser.control import (
    AutopilotGains,
    AutopilotState,
    FlightLimits,
    follow,
    ground_clearance,
    hold,
    hold_point,
    levelled_off,
    make_plant,
    velocity_control,
)
from anser.environment import Environment, FlatEarth
from anser.planning import (
    FleetPlan,
    Rendezvous,
    Trajectory,
    renew,
    rescaled,
)
from anser.planning.certified import ANEW, CertifiedPlan, Renewed, Traveller, renew_certified
from anser.planning.timed_path import TimedPath
from anser.shapes import Count, Flag, Scalar, ScalarLike, Vector3
from anser.simulation.fleet import Fleet, Flight, FlightState
from anser.simulation.hold_assignment import assign_holds
from anser.simulation.motion import advance
from anser.simulation.planned_hold import PlannedHolds, each_alone, hold_reference
from anser.simulation.record import APPROACH, FROZEN, HOLD, Moment, record
from anser.simulation.sensing import Sensed
from anser.simulation.start import planning_tasks, sense_all, travellers, velocity_over_ground_n
from anser.simulation.status import AT_GROUND, BROKE_OFF, FLYING, NOT_FINITE

SEGMENT_STEPS = 500
"""Steps compiled as one: a flight of any duration is a number of these, so the duration does not recompile."""


class _Own(eqx.Module):
    """One aircraft's share of the fleet."""

    airframe: AbstractAirframe
    gains: AutopilotGains
    limits: FlightLimits
    rendezvous: Rendezvous
    trajectory: Trajectory | TimedPath
    moving: MotionState
    state: AircraftState
    autopilot: AutopilotState
    now: Condition
    sensed: Sensed
    goal_n: Vector3
    goal_velocity_n: Vector3
    lateral_bend: ScalarLike
    planned_length: ScalarLike
    status: Count
    stopped: Flag
    holds: PlannedHolds | None


def _fly_one(
    own: _Own,
    environment: Environment,
    fleet: Fleet,
    time: ScalarLike,
    arrival_time: Scalar,
    phase: Count,
    renewal: Count,
    step: ScalarLike,
) -> tuple[MotionState, AutopilotState, Count, Flag, dict[str, Array]]:
    """Guide, control, move and record one aircraft over one step."""
    state, now, settings = own.state, own.now, fleet.guidance
    earth, scale = environment.earth, now.earth.chart_scale
    velocity_n, wind_n = scale * velocity_over_ground_n(now, state), scale * now.wind_n
    plant = make_plant(own.airframe, own.limits, own.gains, state, now, own.autopilot, now.earth.gravity, step)
    clearance = ground_clearance(plant, -state.position_n[2], velocity_over_ground_n(now, state)[2])
    broke_off = (own.status == BROKE_OFF) | clearance.lost
    phase = jnp.where(broke_off, HOLD, phase)
    planned = follow(own.trajectory, time, state.position_n, velocity_n, wind_n, settings)
    relative_n = state.position_n - own.sensed.goal_position_n
    # where the rendezvous lies below the least altitude the hold does not
    height = jnp.maximum(-own.rendezvous.stand_off_n[2], own.limits.altitude_min + own.sensed.goal_position_n[2])
    if own.holds is not None:
        circle = own.holds.circles
        height = circle.height
        settings = eqx.tree_at(lambda s: (s.hold_radius, s.hold_turn), settings, (circle.radius, circle.turn))
    circle_n = hold_point(relative_n, own.sensed.goal_position_n, height, settings)
    held = hold(
        relative_n,
        velocity_n,
        own.sensed.goal_velocity_n,
        wind_n,
        own.trajectory.velocity_n(arrival_time) - own.sensed.goal_velocity_n,
        height,
        fleet.speed,
        settings,
    )
    if own.holds is not None:
        seen = own.sensed.goal_position_n, own.sensed.goal_velocity_n
        ahead, foreseen = hold_reference(own.holds, time, *seen, fleet.speed)
        followed = follow(ahead, time, state.position_n, velocity_n, wind_n, settings), ahead.position_n(time)
        on_it = foreseen & ~broke_off  # whoever broke off is not where its hold begins
        held, circle_n = jax.tree.map(lambda a, b: jnp.where(on_it, a, b), followed, (held, circle_n))
    command = jax.tree.map(lambda a, b: jnp.where(phase == HOLD, a, b), held, planned)
    if not isinstance(earth, FlatEarth):  # there the chart's rates are the velocities
        command = rescaled(command, 1.0 / scale)
    level = levelled_off(command, plant, clearance)
    command = jax.tree.map(lambda a, b: jnp.where(phase == HOLD, a, b), level, command)
    controls, signals, autopilot = velocity_control(plant, own.autopilot, command)
    to_goal_n, _ = earth.sight(state.position_n, own.goal_n, jnp.zeros(3))
    to_rendezvous_n, _ = earth.sight(state.position_n, own.goal_n + own.rendezvous.stand_off_n, jnp.zeros(3))
    moment = Moment(
        airframe=own.airframe,
        state=state,
        now=now,
        controls=controls,
        signals=signals,
        command=command,
        reference_n=jnp.where(phase == HOLD, circle_n, own.trajectory.position_n(time)),
        sight=own.sensed.sight,
        goal_n=own.goal_n,
        goal_velocity_n=own.goal_velocity_n,
        goal_estimate_n=own.sensed.goal_position_n,
        goal_velocity_estimate_n=own.sensed.goal_velocity_n,
        stand_off_n=own.rendezvous.stand_off_n,
        to_goal_n=to_goal_n,
        to_rendezvous_n=to_rendezvous_n,
        arrival_time=jnp.asarray(arrival_time),
        lateral_bend=jnp.asarray(own.lateral_bend),
        planned_length=jnp.asarray(own.planned_length),
        phase=phase,
        renewal=renewal,
        status=own.status,
    )
    row = record(moment)
    after = advance(own.airframe, environment, time, own.moving, controls, step)
    finite = jnp.all(jnp.stack([jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves((after, autopilot))]))
    grounded = seen_state(environment, after).position_n[2] >= 0.0
    aloft = jnp.where(broke_off, BROKE_OFF, own.status)
    event = jnp.where(~finite, NOT_FINITE, jnp.where(grounded, AT_GROUND, aloft)).astype(own.status.dtype)
    status = jnp.where(own.stopped, own.status, event)
    stay = own.stopped | ~finite | grounded
    after, autopilot = jax.tree.map(
        lambda old, new: jnp.where(stay, old, new), (own.moving, own.autopilot), (after, autopilot)
    )
    return after, autopilot, status, stay, row


def _renewed_holds(
    fleet: Fleet, holds: PlannedHolds | None, own: Traveller, made: Renewed, time: ScalarLike
) -> PlannedHolds | None:
    """Holds after a renewal: chosen anew where paths were planned anew; those that are flown already stay."""
    if holds is None or fleet.certified is None:
        return holds
    airspace = fleet.certified.airspace

    def anew() -> PlannedHolds:
        until, cells = jnp.max(holds.paths.times), holds.paths.times.shape[1] - 1
        return assign_holds(made.plan.paths, own, airspace, fleet.guidance, time, until, cells, former=holds)

    return jax.lax.cond(made.how == ANEW, anew, lambda: holds)


def step_flight(flight: Flight, carry: FlightState) -> tuple[FlightState, dict[str, Array]]:
    """Fly the fleet over one step; returns the next state and the row recorded at the step's start."""
    fleet, environment, timing = flight.fleet, flight.environment, flight.timing
    time = carry.step_index * timing.step
    aircraft = jax.vmap(seen_state, in_axes=(None, 0))(environment, carry.aircraft)
    now = jax.vmap(condition, in_axes=(0, None, None, 0))(fleet.airframes, environment, time, aircraft)
    sensed = sense_all(environment, fleet, time, aircraft, now)
    frozen = time >= carry.plan.arrival_times - timing.freeze
    on_time = (timing.replan_steps > 0) & (carry.step_index % jnp.maximum(timing.replan_steps, 1) == 0)

    out = carry.stopped | (carry.status == BROKE_OFF)

    def renewed() -> tuple[FleetPlan | CertifiedPlan, Count, PlannedHolds | None]:
        if isinstance(carry.plan, CertifiedPlan) and fleet.certified is not None:
            own, settings = travellers(fleet, aircraft, now, sensed, out), fleet.certified
            made = renew_certified(
                carry.plan, time, own, settings.airspace, settings.movable, timing.freeze, settings.latest
            )
            return made.plan, made.how, _renewed_holds(fleet, carry.holds, own, made, time)
        if isinstance(carry.plan, FleetPlan):
            tasks = planning_tasks(
                fleet, time, aircraft, now, sensed, carry.flown, carry.deceleration, carry.plan.speed, out
            )
            return renew(carry.plan, time, tasks, carry.sides, fleet.even_speed), carry.renewal, None
        raise ValueError("a certified plan is flown by a fleet with settings of the certified planner")

    due = on_time & ~jnp.all(frozen | out)
    plan, renewal, holds = jax.lax.cond(due, renewed, lambda: (carry.plan, carry.renewal, carry.holds))
    phase = jnp.where(time >= plan.arrival_times, HOLD, jnp.where(frozen, FROZEN, APPROACH))
    status = jnp.where(carry.status == FLYING, plan.statuses.astype(carry.status.dtype), carry.status)
    own = _Own(
        airframe=fleet.airframes,
        gains=fleet.gains,
        limits=fleet.limits,
        rendezvous=fleet.rendezvous,
        trajectory=plan.trajectories,
        moving=carry.aircraft,
        state=aircraft,
        autopilot=carry.autopilots,
        now=now,
        sensed=sensed,
        goal_n=jax.vmap(lambda goal: goal.position_n(time))(fleet.goals),
        goal_velocity_n=jax.vmap(lambda goal: goal.velocity_n(time))(fleet.goals),
        lateral_bend=plan.lateral_bends,
        planned_length=plan.lengths,
        status=status,
        stopped=carry.stopped,
        holds=None if holds is None else each_alone(holds),
    )
    fly = jax.vmap(_fly_one, in_axes=(0, None, None, None, 0, 0, None, None))
    after, autopilots, status, stopped, row = fly(
        own, environment, fleet, time, plan.arrival_times, phase, renewal, timing.step
    )
    flown = carry.flown + jnp.where(carry.stopped, 0.0, timing.step * now.air_data.V)
    return FlightState(
        carry.step_index + 1,
        after,
        autopilots,
        plan,
        renewal,
        carry.sides,
        carry.deceleration,
        flown,
        status,
        stopped,
        holds,
    ), row


def fly_segment(flight: Flight, carry: FlightState) -> tuple[FlightState, dict[str, Array]]:
    """Fly `SEGMENT_STEPS` steps; the history has shape (SEGMENT_STEPS, aircraft) per key."""
    return jax.lax.scan(lambda c, _: step_flight(flight, c), carry, length=SEGMENT_STEPS)
