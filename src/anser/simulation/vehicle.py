"""One aircraft as a set of interchangeable parts, and what of it goes on from step to step."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp

from anser.aircraft import AbstractAirframe, MotionState
from anser.constants import AIRBORNE_STAND_OFF_MIN_M, SURFACE_STAND_OFF_MIN_M
from anser.control import AbstractController, AbstractGuidance
from anser.environment import AbstractGusts, NoGusts
from anser.planning import GoalMotion, Rendezvous
from anser.sensing import AbstractEstimator, AbstractSensors, GoalState
from anser.shapes import Count, Flag, Scalar, ScalarLike
from anser.simulation.faults import Faults, no_faults
from anser.simulation.hold import HoldAroundGoal


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
