"""One aircraft of the closed loop: interchangeable parts, mission, faults, state, and motion over one step."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from anser.aircraft.air_data import Disturbance
from anser.aircraft.airframe import AbstractAirframe, Controls
from anser.aircraft.changes import AirframeChanges, changed_airframe
from anser.aircraft.motion import AnyMotionState, MotionState, motion_derivative
from anser.constants import AIRBORNE_STAND_OFF_MIN_M, SURFACE_STAND_OFF_MIN_M
from anser.environment.environment import Environment
from anser.environment.gusts import AbstractGusts, NoGusts
from anser.numerics.arrays import as_array
from anser.numerics.integration import rk4_step
from anser.parts.controllers import AbstractController, AbstractGuidance
from anser.parts.excitation import Excitation
from anser.parts.perception import AbstractEstimator, AbstractSensors, GoalState
from anser.parts.planners import Rendezvous
from anser.planning.goals import GoalMotion
from anser.planning.holds.hold_around_goal import HoldAroundGoal
from anser.shapes import Flag, Integer, Scalar, ScalarLike
from anser.spatial.rotations import normalize


class Faults(eqx.Module):
    """Faults of one aircraft and departure from the fleet, by time; an infinite time means never."""

    thrust_loss_time: Scalar  #: Time of a thrust loss, s.
    thrust_ratio: Scalar  #: Fraction of the thrust that remains after the loss, 0..1.
    goal_sensor_loss_time: Scalar  #: Time of a failure of the goal sensor, s.
    leaving_time: Scalar  #: Time at which the aircraft leaves the fleet, s.

    def thrust_ratio_at(self, time: ScalarLike) -> Scalar:
        """Return the fraction of the nominal thrust at a time (s): 1 before the thrust loss."""
        return jnp.where(time >= self.thrust_loss_time, self.thrust_ratio, 1.0)

    def goal_sensor_works(self, time: ScalarLike) -> Flag:
        """Whether the goal sensor works at a time (s)."""
        return jnp.asarray(time < self.goal_sensor_loss_time)

    def has_left_fleet(self, time: ScalarLike) -> Flag:
        """Whether the aircraft has left the fleet by a time (s)."""
        return jnp.asarray(time >= self.leaving_time)


def no_faults() -> Faults:
    """Return faults that never occur."""
    never = as_array(jnp.inf)
    return Faults(never, as_array(1.0), never, never)


def advance(
    airframe: AbstractAirframe,
    environment: Environment,
    time: ScalarLike,
    state: AnyMotionState,
    controls: Controls,
    step: ScalarLike,
    disturbance: Disturbance | None = None,
) -> AnyMotionState:
    """Integrate the equations of motion from `time` over one step (s) by the classical Runge-Kutta method.

    Controls and disturbance (None: no gusts, full thrust) are constant over the step.
    """

    def derivative(t: ScalarLike, y: AnyMotionState) -> AnyMotionState:
        return motion_derivative(airframe, environment, t, y, controls, disturbance)

    state = dataclasses.replace(
        state,
        actuators=airframe.actuators.before_step(state.actuators, controls.surfaces),
        engine=airframe.engine.before_step(state.engine, controls.throttle),
    )
    # jit: one trace for the four stages.
    next_state = rk4_step(jax.jit(derivative), jnp.asarray(time, state.velocity_b.dtype), state, step)
    return eqx.tree_at(lambda s: s.quaternion, next_state, normalize(next_state.quaternion))


class Mission(eqx.Module):
    """Mission of an aircraft: goal, rendezvous, and hold after the arrival."""

    goal: GoalMotion  #: True motion of the goal, which the planner must not use.
    airborne: Flag  #: True: the goal is in the air; False: the goal is on the surface.
    rendezvous: Rendezvous  #: Rendezvous point relative to the goal, and prescribed directions of arrival.
    #: Guidance after the arrival or a breakaway, along the planned hold or on a circle around the goal.
    hold: HoldAroundGoal

    @property
    def distance_min(self) -> Scalar:
        """Least distance allowed to the goal, m."""
        return jnp.where(self.airborne, AIRBORNE_STAND_OFF_MIN_M, SURFACE_STAND_OFF_MIN_M)

    def goal_at(self, time: ScalarLike) -> GoalState:
        """Return the true position (m) and velocity (m/s) of the goal at a time (s), chart, NED."""
        return GoalState(self.goal.position_n(time), self.goal.velocity_n(time))


class Vehicle(eqx.Module):
    """One aircraft of the closed loop, made of interchangeable parts; user-defined parts are possible."""

    airframe: AbstractAirframe  #: True airframe at the start.
    sensors: AbstractSensors  #: Sensors, which measure the truth.
    estimator: AbstractEstimator  #: Estimator, which computes the aircraft's belief from the readings.
    guidance: AbstractGuidance  #: Source of the commands until the hold of the mission begins.
    controller: AbstractController  #: Controller, which computes surfaces and throttle from the command.
    mission: Mission | None = None  #: Goal, rendezvous and hold; None: the aircraft has no goal and needs no planner.
    gusts: AbstractGusts = eqx.field(default_factory=NoGusts)  #: Model of the gusts, in addition to the mean wind.
    faults: Faults = eqx.field(default_factory=no_faults)  #: Thrust loss, sensor failure and departure, by time.
    #: Changes of the true airframe during the flight, unknown to estimator and controller; None: no changes.
    changes: AirframeChanges | None = None
    excitation: Excitation | None = None  #: Test inputs added to command and controls; None: no test inputs.

    def airframe_at(self, time: ScalarLike) -> AbstractAirframe:
        """Return the true airframe at a time (s), changes included."""
        return self.airframe if self.changes is None else changed_airframe(self.airframe, self.changes.at(time))

    def thrust_ratio_at(self, time: ScalarLike) -> Scalar:
        """Return the fraction of the nominal thrust that faults and changes leave at a time (s)."""
        thrust = self.faults.thrust_ratio_at(time)
        return thrust if self.changes is None else thrust * self.changes.at(time).thrust


class VehicleState(eqx.Module):
    """State of one aircraft between two steps."""

    aircraft: MotionState  # motion of the aircraft
    # states of the parts; opaque to the closed loop
    sensors: Any
    estimator: Any
    guidance: Any
    controller: Any
    gusts: Any
    status: Integer  # index into `STATUS_MESSAGES`; 0: no event
    stopped: Flag  # True: the aircraft no longer moves (see `move`), has no trim, or is padding
    index: Integer  # fleet index
