"""Interfaces of sensors and estimators: from the truth to readings, from readings to what an aircraft believes."""

import abc
from typing import Any

import equinox as eqx
import jax
from jaxtyping import Array

from anser.aircraft import AbstractAirframe, AircraftState, Condition
from anser.environment import Environment
from anser.planning import LineOfSight
from anser.shapes import Count, Scalar, Vector3
from anser.spatial import rotate_back


class Instant(eqx.Module):
    """One sample of a flight, as every part of the closed loop gets it.

    Attributes
    ----------
    environment
        Atmosphere, wind and Earth.
    number
        Of the sample, from 0.
    step
        Sampling period, s.
    key
        Random key of this aircraft in this flight; None where the flight has no seed.
    """

    environment: Environment
    number: Count
    step: Scalar
    key: Array | None = None

    @property
    def time(self) -> Scalar:
        """S."""
        return self.number * self.step

    def random_key(self, part: int) -> Array:
        """Key for what a part of one aircraft draws at this sample: of (seed, flight, aircraft, part, sample) alone.

        Raises
        ------
        ValueError
            The flight has no seed.
        """
        if self.key is None:
            raise ValueError("a part of the closed loop draws random numbers, but the flight has no seed")
        return jax.random.fold_in(jax.random.fold_in(self.key, part), self.number)


class GoalState(eqx.Module):
    """Position (NED, m) and velocity (NED, m/s) of a goal in the Earth's chart."""

    position_n: Vector3
    velocity_n: Vector3


class Truth(eqx.Module):
    """What is true of one aircraft at one instant.

    Attributes
    ----------
    airframe
        What flies.
    state, now
        Its state, and the air data, forces and moments there.
    goal
        Its goal; None for an aircraft without one.
    """

    airframe: AbstractAirframe
    state: AircraftState
    now: Condition
    goal: GoalState | None


class Reading(eqx.Module):
    """Reading of the sensors of one aircraft at one instant.

    Attributes
    ----------
    state
        Its own state.
    now
        Air data at that state; its forces and moments are those that the aircraft itself would have there.
    specific_force_b
        Of accelerometers at the centre of gravity, body axes, m/s^2.
    sight
        Line of sight to the goal; None for an aircraft without one.
    """

    state: AircraftState
    now: Condition
    specific_force_b: Vector3
    sight: LineOfSight | None


class Belief(eqx.Module):
    """What one aircraft believes at one instant: all that guidance and controller know.

    Attributes
    ----------
    airframe
        Its model of itself.
    state
        Its own state.
    now
        Air data, and the forces and moments of the model at that state.
    specific_force_b
        As measured, m/s^2.
    sight
        Line of sight to the goal as measured; None for an aircraft without one.
    goal
        Where it takes its goal to be, and how it moves; None without one.
    """

    airframe: AbstractAirframe
    state: AircraftState
    now: Condition
    specific_force_b: Vector3
    sight: LineOfSight | None
    goal: GoalState | None


class AbstractSensors(eqx.Module):
    """Sensors of one aircraft; concrete ones are final."""

    @abc.abstractmethod
    def init(self, truth: Truth, instant: Instant) -> Any:
        """State of the sensors before the first sample, of an aircraft that has been in its present flight for long."""

    @abc.abstractmethod
    def read(self, memory: Any, truth: Truth, instant: Instant) -> tuple[Reading, Any]:
        """Their reading now, and their state after it."""


class AbstractEstimator(eqx.Module):
    """Estimator of one aircraft; concrete ones are final."""

    @abc.abstractmethod
    def init(self, reading: Reading, airframe: AbstractAirframe, instant: Instant) -> Any:
        """State of the estimator before the first sample."""

    @abc.abstractmethod
    def estimate(
        self, memory: Any, reading: Reading, airframe: AbstractAirframe, instant: Instant
    ) -> tuple[Belief, Any]:
        """What the aircraft believes now, and the estimator's state after that; `airframe` is what flies."""


def velocity_over_ground_n(now: Condition, state: AircraftState) -> Vector3:
    """Velocity over the ground, NED, m/s."""
    return rotate_back(now.R_bn, state.velocity_b)
