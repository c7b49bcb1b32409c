"""Estimator of one aircraft with optional filters for the motion of aircraft, air and goal."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft.air_data import Disturbance
from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.motion import air_data_and_forces, modelled_air_data_and_forces
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
from anser.spatial.wind_axes import air_direction_b


def goal_or_prediction(measured: GoalState, previous: GoalState, reading: Reading, instant: Instant) -> GoalState:
    """Return the measured goal motion, or `previous` moved by its velocity for a period if the sensor fails."""
    predicted = GoalState(previous.position_n + instant.step * previous.velocity_n, previous.velocity_n)
    return jax.tree.map(lambda new, old: jnp.where(reading.goal_sensor_works, new, old), measured, predicted)


def goal_from_sight(earth: AbstractEarth, sight: LineOfSight, position_n: Vector3, velocity_n: Vector3) -> GoalState:
    """Return a goal's position (m) and velocity (m/s) in the Earth's chart from an aircraft's line of sight.

    `position_n` is the aircraft's chart position, m; `velocity_n` the aircraft's velocity over the ground, NED, m/s.
    """
    line_n, goal_velocity_n = goal_from_line_of_sight(sight, jnp.zeros_like(velocity_n), velocity_n)
    return GoalState(*earth.motion_on_chart(position_n, line_n, goal_velocity_n))


class Briefing(eqx.Module):
    """Knowledge of the goal's motion at the start, given before the flight.

    The vertical standard deviations are a tenth of the horizontal standard deviations.
    """

    position_n: Vector3  #: True position of the goal at the start, NED, m.
    velocity_n: Vector3  #: True velocity of the goal at the start, NED, m/s.
    position_sigma: Scalar  #: Horizontal standard deviation of the briefed position per axis, m.
    velocity_sigma: Scalar  #: Horizontal standard deviation of the briefed velocity per axis, m/s.

    def sample(self, instant: Instant) -> tuple[Float[Array, "6"], Float[Array, "6"]]:
        """Return position and velocity with the errors of this flight, and standard deviations; (6,), NED, m, m/s."""
        axes = jnp.array([1.0, 1.0, _VERTICAL])
        sigmas = jnp.concatenate([self.position_sigma * axes, self.velocity_sigma * axes])
        truth = jnp.concatenate([self.position_n, self.velocity_n])
        return truth + sigmas * instant.normals(BRIEFING, 6, once=True), sigmas


_VERTICAL = 0.1  # vertical over horizontal uncertainty of a goal


class TrackingState(eqx.Module):
    """States of the filters of a `TrackingEstimator`."""

    vehicle: NavigationState | None  #: State of the navigation filter; None if there is no such filter.
    air: AirMotion | None  #: State of the filter of the air; None if there is no such filter.
    goal: Any  #: State of the goal filter; if there is no filter, the last goal motion. None: there is no goal.


class TrackingEstimator(AbstractEstimator):
    """Estimator of one aircraft with optional filters of the aircraft's motion, the air and the goal.

    Attitude and body rates always come from the readings.
    """

    vehicle: NavigationFilter | None = None  #: Filter of position and velocity; None: both come from the readings.
    #: Filter of wind and gusts. None: air data come from the readings, or from the true mean wind if `vehicle` is set.
    air: AirFilter | None = None
    #: Filter of the goal's motion; None: the motion follows from the reading's line of sight (theory section 7).
    goal: AbstractGoalFilter | None = None
    briefing: Briefing | None = None  #: Knowledge of the goal before the flight; must be set if `goal` is set.
    #: Airframe with which estimator and controller compute; None: the true airframe at the start of the flight.
    model: AbstractAirframe | None = None

    def init(self, reading: Reading, airframe: AbstractAirframe, instant: Instant) -> TrackingState:
        """Return the initial states of the filters."""
        state, condition, wind = reading.state, reading.condition, instant.environment.wind
        vehicle = goal = None
        if self.vehicle is not None:
            assert reading.fix is not None
            R_bn = rotation_from_quaternion(state.quaternion)
            vehicle = self.vehicle.init(reading.fix, acceleration_n(R_bn, reading.specific_force_b, condition.earth))
        if self.goal is not None:
            assert self.briefing is not None
            goal = self.goal.init(*self.briefing.sample(instant))
        elif reading.sight is not None:
            velocity_n = velocity_over_ground_n(condition, state)
            goal = goal_from_sight(instant.environment.earth, reading.sight, state.position_n, velocity_n)
        air = None if self.air is None else self.air.init(wind.at(state.position_n, instant.time))
        return TrackingState(vehicle, air, goal)

    def estimate(
        self, estimator_state: TrackingState, reading: Reading, airframe: AbstractAirframe, instant: Instant
    ) -> tuple[Belief, TrackingState]:
        """Return the belief at this sample, and the new states of the filters."""
        state, condition, step = reading.state, reading.condition, instant.step
        airframe = airframe if self.model is None else self.model
        vehicle = estimator_state.vehicle
        air = estimator_state.air
        goal = estimator_state.goal
        uncertainty = None
        seen_goal = None
        position_covariance = jnp.zeros((3, 3), step.dtype)
        if self.vehicle is not None and vehicle is not None:
            assert reading.fix is not None
            R_bn = rotation_from_quaternion(state.quaternion)
            earth = instant.environment.earth.local_earth(vehicle.position_n, vehicle.velocity_n)
            measured_acceleration_n = acceleration_n(R_bn, reading.specific_force_b, earth)
            updated = self.vehicle.step(vehicle, reading.fix, measured_acceleration_n, earth.chart_scale, step)
            vehicle = jax.tree.map(lambda new, old: jnp.where(instant.number > 0, new, old), updated, vehicle)
            state = eqx.tree_at(
                lambda s: (s.position_n, s.velocity_b), state, (vehicle.position_n, rotate(R_bn, vehicle.velocity_n))
            )
            position_covariance = vehicle.position_covariance
        if self.air is not None and air is not None:
            R_bn = rotation_from_quaternion(state.quaternion)
            velocity_n = rotate_back(R_bn, state.velocity_b)
            measured_b = reading.velocity_air_b
            if measured_b is None:
                data = reading.condition.air_data
                measured_b = data.V * air_direction_b(data.alpha, data.beta)
            air = self.air.step(air, R_bn, velocity_n, measured_b, step)
            environment = eqx.tree_at(lambda e: e.wind, instant.environment, SteadyWind(air.wind_n), is_leaf=_is_wind)
            disturbance = Disturbance(Gust(air.gust_b, jnp.zeros_like(air.gust_b)), jnp.ones_like(step))
            condition = air_data_and_forces(airframe, environment, instant.time, state, disturbance=disturbance)
        elif self.vehicle is not None:
            condition = air_data_and_forces(airframe, instant.environment, instant.time, state)
        elif self.model is not None or reading.velocity_air_b is not None:
            data = reading.air_data(instant.environment)
            condition = modelled_air_data_and_forces(airframe, condition, data, state)
        sight = reading.sight
        if self.goal is not None:
            assert reading.goal is not None
            velocity_n = velocity_over_ground_n(condition, state)
            motion = VehicleMotion(state.position_n, velocity_n)
            goal, goal_estimate = self.goal.step(goal, reading.goal, motion, instant)
            seen_goal = GoalState(goal_estimate.mean[:3], goal_estimate.mean[3:])
            sight = line_of_sight(instant.environment.earth, state.position_n, velocity_n, seen_goal)
            covariance = goal_estimate.covariance
            if reading.goal.kind == "sight":  # the line of sight starts at an uncertain position
                covariance = covariance + jnp.pad(position_covariance, (0, 3))
            uncertainty = Uncertainty(
                position_covariance, covariance, goal_estimate.is_measured, goal_estimate.nis, goal_estimate.status
            )
        elif sight is not None and goal is not None:
            velocity_n = velocity_over_ground_n(condition, state)
            measured_goal = goal_from_sight(instant.environment.earth, sight, state.position_n, velocity_n)
            seen_goal = goal = goal_or_prediction(measured_goal, goal, reading, instant)
        belief = Belief(airframe, state, condition, reading.specific_force_b, sight, seen_goal, uncertainty)
        return belief, TrackingState(vehicle, air, goal)


def _is_wind(value: Any) -> bool:
    return isinstance(value, AbstractWind)
