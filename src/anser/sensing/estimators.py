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
    """Return the measured goal motion or, if the goal sensor does not work, the predicted one.

    The prediction moves `previous` on by one sampling period at constant velocity.
    """
    predicted = GoalState(previous.position_n + instant.step * previous.velocity_n, previous.velocity_n)
    return jax.tree.map(lambda new, old: jnp.where(reading.goal_sensor_works, new, old), measured, predicted)


def goal_from_sight(earth: AbstractEarth, sight: LineOfSight, position_n: Vector3, velocity_n: Vector3) -> GoalState:
    """Compute a goal's position (m) and velocity (m/s) in the Earth's chart from an aircraft's line of sight.

    `position_n` is the aircraft's position in the chart (3,), m; `velocity_n` is the aircraft's velocity over the
    ground (3,), NED, m/s.
    """
    line_n, goal_velocity_n = goal_from_line_of_sight(sight, jnp.zeros_like(velocity_n), velocity_n)
    return GoalState(*earth.motion_on_chart(position_n, line_n, goal_velocity_n))


class Briefing(eqx.Module):
    """Knowledge of the goal's start before the flight: true position and velocity, and the deviations of its errors.

    `position_n` and `velocity_n` are the true values, NED, m and m/s. `position_sigma` (m) and `velocity_sigma` (m/s)
    are the horizontal standard deviations of the errors per axis; the vertical standard deviations are a tenth.
    """

    # true values, NED, m and m/s
    position_n: Vector3
    velocity_n: Vector3
    # horizontal standard deviations per axis, m and m/s; the vertical standard deviations are a tenth
    position_sigma: Scalar
    velocity_sigma: Scalar

    def sample(self, instant: Instant) -> tuple[Float[Array, "6"], Float[Array, "6"]]:
        """Draw the briefed position and velocity (6,), NED, m and m/s; return them with their standard deviations (6,).

        The errors are drawn once per flight.
        """
        axes = jnp.array([1.0, 1.0, _VERTICAL])
        sigmas = jnp.concatenate([self.position_sigma * axes, self.velocity_sigma * axes])
        truth = jnp.concatenate([self.position_n, self.velocity_n])
        return truth + sigmas * instant.normals(BRIEFING, 6, once=True), sigmas


_VERTICAL = 0.1  # vertical over horizontal uncertainty of a goal


class TrackingState(eqx.Module):
    """States of the filters of a `TrackingEstimator`.

    Without a filter of the aircraft's motion or the air the state is None; without a filter of the goal, `goal` is the
    last measured or extrapolated goal motion, None for an aircraft without a goal.
    """

    vehicle: NavigationState | None
    air: AirMotion | None
    goal: Any


class TrackingEstimator(AbstractEstimator):
    """Estimator of one aircraft with filters of the aircraft's motion, the air and the goal; each filter is optional.

    Without a filter (None) of the motion, position and velocity are those of the reading; without a filter of the goal,
    the goal's motion follows from the line of sight of the reading (theory section 7). Without a filter of the air, the
    air data are those of the reading or, with a filter of the motion, follow from the true mean wind. Attitude and body
    rates are always those of the reading. `briefing` is required with a filter of the goal. `model` is the airframe in
    the belief; None: the true airframe at the start.
    """

    #: Navigation filter of position and velocity; None: both are taken from the readings. Attitude and body rates are
    #: always the readings.
    vehicle: NavigationFilter | None = None
    air: AirFilter | None = None  #: Filter of wind and gusts; None: air data are taken from the readings.
    #: Filter of the goal's motion; None: the line of sight is exact and starts at the estimated aircraft position.
    goal: AbstractGoalFilter | None = None
    #: Knowledge of the goal before the first measurement; required with a goal filter.
    briefing: Briefing | None = None
    model: AbstractAirframe | None = None  #: Nominal airframe; None: the true airframe.

    def init(self, reading: Reading, airframe: AbstractAirframe, instant: Instant) -> TrackingState:
        """Return the initial states of the filters, from the first reading, the briefing and the forecast wind."""
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
        """Return the belief at this sample from its reading, and the new states of the filters."""
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
        elif self.model is not None:
            condition = modelled_air_data_and_forces(airframe, condition, condition.air_data, state)
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
