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
    """Faults of one aircraft: times of thrust loss, goal sensor failure and departure from the fleet; infinite: never.

    The scenario's events set the times when the flight is built (`anser.scenario.build.build_faults`).

    Attributes
    ----------
    thrust_loss_time, thrust_ratio
        Time of a thrust loss, s, and fraction of the thrust that remains afterwards (0..1).
    goal_sensor_loss_time
        Time of a failure of the goal sensor, s.
    leaving_time
        Time at which the aircraft leaves the fleet and flies its exit path, s; the fleet no longer waits for it.
    """

    thrust_loss_time: Scalar
    thrust_ratio: Scalar
    goal_sensor_loss_time: Scalar
    leaving_time: Scalar

    def thrust_ratio_at(self, time: ScalarLike) -> Scalar:
        """Return the fraction of the nominal thrust that a thrust loss leaves at a time (s): 1 before the loss."""
        return jnp.where(time >= self.thrust_loss_time, self.thrust_ratio, 1.0)

    def goal_sensor_works(self, time: ScalarLike) -> Flag:
        """Whether the goal sensor works at a time (s)."""
        return jnp.asarray(time < self.goal_sensor_loss_time)

    def has_left_fleet(self, time: ScalarLike) -> Flag:
        """Whether the aircraft has left the fleet by a time (s)."""
        return jnp.asarray(time >= self.leaving_time)


def no_faults() -> Faults:
    """Return faults that never occur: infinite times."""
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

    Controls and disturbance (None: no gusts, full thrust) are constant over the step. The quaternion is normalized
    after the step. Parts without lag take their commanded value at the start of the step.
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
    """Mission of an aircraft: the motion of the goal, the rendezvous, and the hold after the arrival.

    Attributes
    ----------
    goal
        True motion of the goal, for the sensors and the check of the least distance, never for the planner.
    airborne
        Whether the goal is in the air; otherwise the goal is on the surface.
    rendezvous
        Rendezvous point relative to the goal, and prescribed directions of arrival.
    hold
        Guidance after the arrival or a breakaway: along the hold of the plan, or on a circle around the goal.
    """

    goal: GoalMotion
    airborne: Flag
    rendezvous: Rendezvous
    hold: HoldAroundGoal

    @property
    def distance_min(self) -> Scalar:
        """Least distance allowed to the goal, m; fixed for airborne and for surface goals, and not a setting."""
        return jnp.where(self.airborne, AIRBORNE_STAND_OFF_MIN_M, SURFACE_STAND_OFF_MIN_M)

    def goal_at(self, time: ScalarLike) -> GoalState:
        """Return the true position (m) and velocity (m/s) of the goal at a time (s), NED in the chart."""
        return GoalState(self.goal.position_n(time), self.goal.velocity_n(time))


class Vehicle(eqx.Module):
    """One aircraft of the closed loop, made of interchangeable parts; user-defined parts are possible.

    Attributes
    ----------
    airframe
        The true airframe, as at the start.
    sensors, estimator
        Sensors measure the truth; the estimator computes the aircraft's belief from the readings.
    guidance
        Source of the commands; for an aircraft with a mission, until the hold begins.
    controller
        Computes surfaces and throttle from the command.
    mission
        Goal, rendezvous and hold; None: the aircraft has no goal and needs no planner.
    gusts
        Model of the gusts, in addition to the mean wind.
    faults
        Thrust loss, sensor failure and departure, by time.
    changes
        Changes of the true airframe during the flight, unknown to estimator and controller; None: no changes.
    excitation
        Test inputs added to the command and to the controls; None: no test inputs.
    """

    airframe: AbstractAirframe
    sensors: AbstractSensors
    estimator: AbstractEstimator
    guidance: AbstractGuidance
    controller: AbstractController
    mission: Mission | None = None
    gusts: AbstractGusts = eqx.field(default_factory=NoGusts)
    faults: Faults = eqx.field(default_factory=no_faults)
    changes: AirframeChanges | None = None
    excitation: Excitation | None = None

    def airframe_at(self, time: ScalarLike) -> AbstractAirframe:
        """Return the true airframe at a time (s), with the changes that have occurred until then."""
        return self.airframe if self.changes is None else changed_airframe(self.airframe, self.changes.at(time))

    def thrust_ratio_at(self, time: ScalarLike) -> Scalar:
        """Return the fraction of the nominal thrust that faults and changes leave at a time (s)."""
        thrust = self.faults.thrust_ratio_at(time)
        return thrust if self.changes is None else thrust * self.changes.at(time).thrust


class VehicleState(eqx.Module):
    """State of one aircraft between two steps: motion (`aircraft`), states of the parts, and status.

    `status` is an index into `STATUS_MESSAGES`, 0 without an event. A `stopped` aircraft no longer moves: on the
    ground, outside the wind field of a file, not trimmed, after a non-finite state, or padding. `index` is the fleet
    index.
    """

    aircraft: MotionState
    # states of the parts; opaque to the closed loop
    sensors: Any
    estimator: Any
    guidance: Any
    controller: Any
    gusts: Any
    status: Integer
    stopped: Flag
    index: Integer
