"""One aircraft of the closed loop.

Its interchangeable parts, its mission, its faults, its state between two steps, and its motion over one step with
controls held.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from anser.aircraft.air_data import Disturbance
from anser.aircraft.airframe import AbstractAirframe, Controls
from anser.aircraft.motion import AnyMotionState, MotionState, motion_derivative
from anser.constants import AIRBORNE_STAND_OFF_MIN_M, SURFACE_STAND_OFF_MIN_M
from anser.environment.environment import Environment
from anser.environment.gusts import AbstractGusts, NoGusts
from anser.numerics.arrays import as_array
from anser.numerics.integration import rk4_step
from anser.parts.controllers import AbstractController, AbstractGuidance
from anser.parts.perception import AbstractEstimator, AbstractSensors, GoalState
from anser.parts.planners import Rendezvous
from anser.planning.goals import GoalMotion
from anser.planning.holds.hold_around_goal import HoldAroundGoal
from anser.shapes import Count, Flag, Scalar, ScalarLike
from anser.spatial.rotations import normalize


class Faults(eqx.Module):
    """Losses of one aircraft, each from a time on (s); infinite: never.

    Attributes
    ----------
    thrust_time, thrust_left
        From when on its engine gives only a part (0..1) of its thrust.
    sensor_time
        From when on the sensor of its goal fails.
    leaving_time
        From when on it is no longer one of its fleet: it flies the plan that is made for it then, straight on, and
        nobody waits for it.
    """

    thrust_time: Scalar
    thrust_ratio: Scalar
    sensor_time: Scalar
    departure_time: Scalar

    def thrust(self, time: ScalarLike) -> Scalar:
        """Part of the thrust that is left."""
        return jnp.where(time >= self.thrust_time, self.thrust_ratio, 1.0)

    def goal_sensor_works(self, time: ScalarLike) -> Flag:
        """Whether the goal can be sensed."""
        return jnp.asarray(time < self.sensor_time)

    def has_departed(self, time: ScalarLike) -> Flag:
        """Whether it has left its fleet."""
        return jnp.asarray(time >= self.departure_time)


def no_faults() -> Faults:
    """None."""
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
    """State one step (s) later, by the classical Runge-Kutta method; the quaternion is normalized after the step.

    Controls and disturbance (None: none) are held over the step.
    """

    def derivative(t: ScalarLike, y: AnyMotionState) -> AnyMotionState:
        return motion_derivative(airframe, environment, t, y, controls, disturbance)

    # jit: traced once for the four stages.
    after = rk4_step(jax.jit(derivative), jnp.asarray(time, state.velocity_b.dtype), state, step)
    return eqx.tree_at(lambda s: s.quaternion, after, normalize(after.quaternion))


class Mission(eqx.Module):
    """What an aircraft flies for: the truth about its goal, where it is to meet it, and what it flies afterwards.

    Attributes
    ----------
    goal
        Read by the sensors, never by the planner.
    airborne
        Whether the goal is in the air; otherwise it is on the surface.
    rendezvous
        How the goal is met.
    hold
        After the arrival, or after a break-off, whatever planner and guidance fly.
    """

    goal: GoalMotion
    airborne: Flag
    rendezvous: Rendezvous
    hold: HoldAroundGoal

    @property
    def distance_min(self) -> Scalar:
        """Least distance to the goal, m: the product's scope, which nothing in a flight can lower."""
        return jnp.where(self.airborne, AIRBORNE_STAND_OFF_MIN_M, SURFACE_STAND_OFF_MIN_M)

    def goal_at(self, time: ScalarLike) -> GoalState:
        """The goal's true place and velocity at a time (s)."""
        return GoalState(self.goal.position_n(time), self.goal.velocity_n(time))


class Vehicle(eqx.Module):
    """One aircraft: every part can be replaced by another of its kind, a user's own too.

    Attributes
    ----------
    airframe
        What flies.
    sensors, estimator
        From the truth to what it believes.
    guidance
        Source of its commands, up to the arrival where it has a mission.
    controller
        From commands to controls.
    mission
        None: it has no goal, nothing stops it and nobody plans for it.
    gusts
        That it meets beside the mean wind.
    faults
        That befall it.
    """

    airframe: AbstractAirframe
    sensors: AbstractSensors
    estimator: AbstractEstimator
    guidance: AbstractGuidance
    controller: AbstractController
    mission: Mission | None = None
    gusts: AbstractGusts = eqx.field(default_factory=NoGusts)
    faults: Faults = eqx.field(default_factory=no_faults)


class VehicleState(eqx.Module):
    """One aircraft between two steps.

    Attributes
    ----------
    aircraft
        As it is integrated over the environment's Earth.
    sensors, estimator, guidance, controller, gusts
        What each part carries along; the closed loop knows none of their insides.
    status
        Index into `STATUS_MESSAGES`; 0 while all is well.
    stopped
        Whether it stands still: it is at the ground, was not trimmed, or its state is no number.
    index
        Its place in the fleet, of which its random numbers are.
    """

    aircraft: MotionState
    sensors: Any
    estimator: Any
    guidance: Any
    controller: Any
    gusts: Any
    status: Count
    stopped: Flag
    index: Count
