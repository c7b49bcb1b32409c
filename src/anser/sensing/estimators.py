"""Estimators of one aircraft.

The readings taken as they are, and filters of the aircraft's motion, the air and the goal.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft.air_data import Disturbance
from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.motion import flight_condition
from anser.environment.earth import AbstractEarth
from anser.environment.environment import AbstractWind, SteadyWind
from anser.environment.gusts import Gust
from anser.numerics.randomness import BRIEFING
from anser.parts.perception import (
    AbstractEstimator,
    Belief,
    GoalState,
    Instant,
    LineOfSight,
    Reading,
    Uncertainty,
    goal_from_line_of_sight,
    velocity_over_ground_n,
)
from anser.sensing.goal_filters import AbstractGoalFilter, VehicleMotion
from anser.sensing.ideal_sensors import line_of_sight
from anser.sensing.navigation import AirFilter, AirMotion, NavigationFilter, NavigationState, acceleration_n
from anser.shapes import Scalar, Vector3
from anser.spatial.rotations import rotate, rotate_back, rotation_from_quaternion


class DirectEstimator(AbstractEstimator):
    """No filter: the state is the reading, the goal's motion is recovered from the line of sight (theory section 7).

    Attributes
    ----------
    model
        What the aircraft believes of its airframe; None: the airframe itself.
    """

    model: AbstractAirframe | None = None

    def init(self, reading: Reading, airframe: AbstractAirframe, instant: Instant) -> GoalState | None:
        """The goal as it is seen; None without one."""
        if reading.sight is None:
            return None
        velocity_n = velocity_over_ground_n(reading.condition, reading.state)
        return goal_from_sight(instant.environment.earth, reading.sight, reading.state.position_n, velocity_n)

    def estimate(
        self, estimator_state: GoalState | None, reading: Reading, airframe: AbstractAirframe, instant: Instant
    ) -> tuple[Belief, GoalState | None]:
        """Believe the reading; a goal that is no longer seen is taken to move on steadily."""
        now, model = reading.condition, airframe if self.model is None else self.model
        if self.model is not None:
            now = flight_condition(self.model, instant.environment, instant.time, reading.state)
        goal = self.init(reading, airframe, instant)
        if goal is not None and estimator_state is not None:
            goal = goal_or_prediction(goal, estimator_state, reading, instant)
        return Belief(model, reading.state, now, reading.specific_force_b, reading.sight, goal), goal


def goal_or_prediction(seen: GoalState, last: GoalState, reading: Reading, instant: Instant) -> GoalState:
    """A goal as it is seen; where its sensor has failed it is taken to have moved on steadily since the last sample."""
    ahead = GoalState(last.position_n + instant.step * last.velocity_n, last.velocity_n)
    return jax.tree.map(lambda new, old: jnp.where(reading.goal_sensor_works, new, old), seen, ahead)


def goal_from_sight(earth: AbstractEarth, sight: LineOfSight, position_n: Vector3, velocity_n: Vector3) -> GoalState:
    """Place and velocity of a goal in the Earth's chart, recovered from the line of sight and the own motion.

    `position_n` is the own place in the chart (3,), m, `velocity_n` the own velocity over ground (3,), NED, m/s.
    """
    line_n, goal_velocity_n = goal_from_line_of_sight(sight, jnp.zeros_like(velocity_n), velocity_n)
    return GoalState(*earth.motion_on_chart(position_n, line_n, goal_velocity_n))


class Briefing(eqx.Module):
    """What is known of a goal before the flight: its place and motion at the start, with an error that is drawn.

    Attributes
    ----------
    position_n, velocity_n
        True, NED, m and m/s.
    position_sigma, velocity_sigma
        Standard deviations per axis, horizontally, m and m/s; the altitude is known to a tenth of that.
    """

    position_n: Vector3
    velocity_n: Vector3
    position_sigma: Scalar
    velocity_sigma: Scalar

    def sample(self, instant: Instant) -> tuple[Float[Array, "6"], Float[Array, "6"]]:
        """Place and velocity as they are said to be, and their standard deviations."""
        axes = jnp.array([1.0, 1.0, _VERTICAL])
        sigmas = jnp.concatenate([self.position_sigma * axes, self.velocity_sigma * axes])
        truth = jnp.concatenate([self.position_n, self.velocity_n])
        return truth + sigmas * instant.normals(BRIEFING, 6, once=True), sigmas


_VERTICAL = 0.1  # of the uncertainty of a goal's altitude and climb, beside that in the plane


class TrackingState(eqx.Module):
    """What the estimator carries along; None where that part is exact, but for a goal: where it was last seen."""

    vehicle: NavigationState | None
    air: AirMotion | None
    goal: Any


class TrackingEstimator(AbstractEstimator):
    """Filters of the own motion, of the air and of the goal; each may be left out where its sensors are exact.

    Attributes
    ----------
    own
        None: position, velocity, attitude and rates are taken as they are read.
    air
        None: so is the air.
    goal
        Filter of the goal; None: its line of sight is exact, seen from where the aircraft takes itself to be.
    briefing
        What is known of the goal beforehand; with a filter of the goal only.
    model
        What the aircraft believes of its airframe; None: the airframe itself.
    """

    vehicle: NavigationFilter | None = None
    air: AirFilter | None = None
    goal: AbstractGoalFilter | None = None
    briefing: Briefing | None = None
    model: AbstractAirframe | None = None

    def init(self, reading: Reading, airframe: AbstractAirframe, instant: Instant) -> TrackingState:
        """After the first reading."""
        state, now, wind = reading.state, reading.condition, instant.environment.wind
        vehicle = goal = None
        if self.vehicle is not None:
            assert reading.fix is not None
            R_bn = rotation_from_quaternion(state.quaternion)
            vehicle = self.vehicle.init(reading.fix, acceleration_n(R_bn, reading.specific_force_b, now.earth))
        if self.goal is not None:
            assert self.briefing is not None
            goal = self.goal.init(*self.briefing.sample(instant))
        elif reading.sight is not None:
            velocity_n = velocity_over_ground_n(now, state)
            goal = goal_from_sight(instant.environment.earth, reading.sight, state.position_n, velocity_n)
        air = None if self.air is None else self.air.init(wind.at(state.position_n, instant.time))
        return TrackingState(vehicle, air, goal)

    def estimate(
        self, estimator_state: TrackingState, reading: Reading, airframe: AbstractAirframe, instant: Instant
    ) -> tuple[Belief, TrackingState]:
        """Take in a reading."""
        state, now, step = reading.state, reading.condition, instant.step
        airframe = airframe if self.model is None else self.model
        vehicle, air, goal, uncertainty, seen_goal = (
            estimator_state.vehicle,
            estimator_state.air,
            estimator_state.goal,
            None,
            None,
        )
        position_covariance = jnp.zeros((3, 3), step.dtype)
        if self.vehicle is not None and vehicle is not None:
            assert reading.fix is not None
            R_bn = rotation_from_quaternion(state.quaternion)
            earth = instant.environment.earth.local_earth(vehicle.position_n, vehicle.velocity_n)
            felt_n = acceleration_n(R_bn, reading.specific_force_b, earth)
            moved = self.vehicle.step(vehicle, reading.fix, felt_n, earth.chart_scale, step)
            vehicle = jax.tree.map(lambda new, old: jnp.where(instant.number > 0, new, old), moved, vehicle)
            state = eqx.tree_at(
                lambda s: (s.position_n, s.velocity_b), state, (vehicle.position_n, rotate(R_bn, vehicle.velocity_n))
            )
            position_covariance = vehicle.position_covariance
        if self.air is not None and air is not None:
            R_bn = rotation_from_quaternion(state.quaternion)
            velocity_n = rotate_back(R_bn, state.velocity_b)
            measured_b = reading.velocity_air_b
            if measured_b is None:
                measured_b = rotate(now.R_bn, velocity_over_ground_n(now, reading.state) - now.wind_n)
            air = self.air.step(air, R_bn, velocity_n, measured_b, step)
            environment = eqx.tree_at(lambda e: e.wind, instant.environment, SteadyWind(air.wind_n), is_leaf=_is_wind)
            disturbance = Disturbance(Gust(air.gust_b, jnp.zeros_like(air.gust_b)), jnp.ones_like(step))
            now = flight_condition(airframe, environment, instant.time, state, disturbance=disturbance)
        elif self.vehicle is not None or self.model is not None:
            now = flight_condition(airframe, instant.environment, instant.time, state)
        sight = reading.sight
        if self.goal is not None:
            assert reading.goal is not None
            velocity_n = velocity_over_ground_n(now, state)
            motion = VehicleMotion(state.position_n, velocity_n)
            goal, found = self.goal.step(goal, reading.goal, motion, instant)
            seen_goal = GoalState(found.mean[:3], found.mean[3:])
            sight = line_of_sight(instant.environment.earth, state.position_n, velocity_n, seen_goal)
            covariance = found.covariance
            if reading.goal.kind == "sight":  # seen from a place that is uncertain itself
                covariance = covariance + jnp.pad(position_covariance, (0, 3))
            uncertainty = Uncertainty(position_covariance, covariance, found.is_measured, found.nis, found.status)
        elif sight is not None and goal is not None:
            velocity_n = velocity_over_ground_n(now, state)
            seen = goal_from_sight(instant.environment.earth, sight, state.position_n, velocity_n)
            seen_goal = goal = goal_or_prediction(seen, goal, reading, instant)
        belief = Belief(airframe, state, now, reading.specific_force_b, sight, seen_goal, uncertainty)
        return belief, TrackingState(vehicle, air, goal)


def _is_wind(value: Any) -> bool:
    return isinstance(value, AbstractWind)
