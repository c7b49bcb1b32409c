"""Interfaces of an aircraft's sensors and estimator, and the signals between sensors, estimator and guidance.

The signals are the instant, the truth, the readings, and the belief, the aircraft's own estimate of its state and of
its goal. A new type of measurement needs a new field in `Reading`, and an estimator that uses the field.
Implementations are in `anser.sensing`.
"""

import abc
from typing import Any, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.aircraft.air_data import AirData, Disturbance, air_data, no_disturbance
from anser.aircraft.airframe import AbstractAirframe, AircraftState
from anser.aircraft.motion import AirDataAndForces
from anser.environment.environment import Environment
from anser.numerics.arrays import as_array
from anser.numerics.randomness import INITIAL_SAMPLE, AbstractRandomness
from anser.parts.part import AbstractPart
from anser.shapes import Flag, Integer, Matrix33, Scalar, Vector3
from anser.spatial.rotations import rotate_back
from anser.spatial.vectors import norm

# A line of sight is treated as vertical below this ratio of horizontal distance to range.
_VERTICAL = 1e-12


class LineOfSight(eqx.Module):
    """Line of sight from an aircraft to its goal: range, azimuth and elevation, and their rates."""

    range: Scalar  #: Distance from the aircraft to the goal, m.
    azimuth: Scalar  #: Azimuth, clockwise from North, rad.
    elevation: Scalar  #: Elevation, up positive, rad; -pi/2 with the goal straight below.
    range_rate: Scalar  #: Rate of the range, m/s.
    #: Rate of the azimuth, rad/s; unbounded near the vertical, where range * cos(elevation) * rate stays bounded.
    azimuth_rate: Scalar
    elevation_rate: Scalar  #: Rate of the elevation, rad/s.


def _axes(azimuth: Scalar, elevation: Scalar) -> tuple[Vector3, Vector3, Vector3]:
    """Return three unit vectors (NED): along the line of sight, towards rising azimuth, towards rising elevation.

    The vectors are the rows of the matrix M of theory section 7.
    """
    ca, sa, ce, se = jnp.cos(azimuth), jnp.sin(azimuth), jnp.cos(elevation), jnp.sin(elevation)
    return (
        jnp.stack([ca * ce, sa * ce, -se]),
        jnp.stack([-sa, ca, jnp.zeros_like(ca)]),
        jnp.stack([-ca * se, -sa * se, -ce]),
    )


def measure_line_of_sight(
    vehicle_position_n: Vector3, vehicle_velocity_n: Vector3, goal_position_n: Vector3, goal_velocity_n: Vector3
) -> LineOfSight:
    """Compute the exact line of sight from an aircraft to its goal; inputs NED, m, and m/s over the ground.

    At zero range all angles and rates are 0. If the goal is exactly above or below, the azimuth is the direction of the
    horizontal relative velocity, the azimuth rate is 0, and the elevation rate contains the whole relative motion. At
    any other elevation, `goal_from_line_of_sight` recovers position and velocity to rounding. Theory section 7.
    """
    relative, rate = goal_position_n - vehicle_position_n, goal_velocity_n - vehicle_velocity_n
    distance, horizontal_distance = norm(relative), norm(relative[:2])
    is_defined, vertical = distance > 0.0, horizontal_distance <= _VERTICAL * distance
    safe_distance = jnp.where(is_defined, distance, 1.0)

    has_horizontal_rate = norm(rate[:2]) > 0.0
    direction_n = jnp.where(vertical, jnp.where(has_horizontal_rate, rate[0], 1.0), relative[0])
    direction_e = jnp.where(vertical, jnp.where(has_horizontal_rate, rate[1], 0.0), relative[1])
    azimuth = jnp.where(is_defined, jnp.arctan2(direction_e, direction_n), 0.0)
    elevation = jnp.arctan2(-relative[2], jnp.where(is_defined, horizontal_distance, 1.0))

    along, across, above = _axes(azimuth, elevation)
    turn = jnp.where(vertical, 0.0, jnp.sum(across * rate))
    lever = jnp.where(vertical, 1.0, safe_distance * jnp.cos(elevation))
    return LineOfSight(
        range=distance,
        azimuth=azimuth,
        elevation=elevation,
        range_rate=jnp.where(is_defined, jnp.sum(along * rate), 0.0),
        azimuth_rate=turn / lever,
        elevation_rate=jnp.where(is_defined, jnp.sum(above * rate) / safe_distance, 0.0),
    )


def goal_from_line_of_sight(
    sight: LineOfSight, vehicle_position_n: Vector3, vehicle_velocity_n: Vector3
) -> tuple[Vector3, Vector3]:
    """Compute a goal's position (NED, m) and velocity over the ground (NED, m/s) from the line of sight to the goal.

    Position and velocity of the aircraft are NED, m and m/s over the ground. The result is exact if the line of sight
    has no error (theory section 7).
    """
    along, across, above = _axes(sight.azimuth, sight.elevation)
    relative_rate = (
        sight.range_rate * along
        + sight.range * jnp.cos(sight.elevation) * sight.azimuth_rate * across
        + sight.range * sight.elevation_rate * above
    )
    return vehicle_position_n + sight.range * along, vehicle_velocity_n + relative_rate


class Instant(eqx.Module):
    """Time, step and random numbers of one sample of a flight, the same for every part of the closed loop."""

    environment: Environment
    number: Integer  #: Number of the sample, from 0.
    step: Scalar  #: Sampling period, s.
    randomness: AbstractRandomness | None = None  #: Random numbers of this aircraft; None if the flight has no seed.

    @property
    def time(self) -> Scalar:
        """Time since the start of the flight, s."""
        return self.number * self.step

    def normals(self, part: int, count: int, *, once: bool = False) -> Array:
        """Return standard normal random numbers for a part of one aircraft at this sample, shape (count,).

        The numbers depend only on (seed, flight, aircraft, part, sample). `part` is a constant of
        `anser.numerics.randomness`, or a user's number >= 100. If `once` is True, the numbers are for the
        initialization, not for this sample. Raises ValueError if the flight has no seed.
        """
        numbers = self._source().normals(part, INITIAL_SAMPLE if once else self.number, count)
        return numbers.astype(self.step.dtype)

    def uniforms(self, part: int, count: int, *, once: bool = False) -> Array:
        """Return random numbers uniform in (0, 1) for a part of one aircraft at this sample, shape (count,).

        Arguments and errors: see `normals`.
        """
        numbers = self._source().uniforms(part, INITIAL_SAMPLE if once else self.number, count)
        return numbers.astype(self.step.dtype)

    def _source(self) -> AbstractRandomness:
        if self.randomness is None:
            raise ValueError("a part of the closed loop draws random numbers, but the flight has no seed")
        return self.randomness


class GoalState(eqx.Module):
    """Position (m) and velocity (m/s) of a goal, NED in the Earth's chart."""

    position_n: Vector3
    velocity_n: Vector3


class Truth(eqx.Module):
    """True state of one aircraft and its goal at one instant."""

    airframe: AbstractAirframe
    state: AircraftState
    condition: AirDataAndForces  #: Air data, forces and moments in the true state, gusts included.
    goal: GoalState | None  #: Motion of the goal; None if the aircraft has no goal.
    #: Whether the goal sensor works; false after its loss.
    goal_sensor_works: Flag = eqx.field(default_factory=lambda: as_array(True, bool))
    #: Gusts in addition to the mean wind, and loss of thrust.
    disturbance: Disturbance = eqx.field(default_factory=no_disturbance)


class GoalReading(eqx.Module):
    """Measurement of a goal by a sensor with errors at one sample, or an empty reading."""

    #: Kind "sight": range (m), azimuth, elevation (rad) in axes North, East, up, and the rates of the three. Kind
    #: "report": position (NED, m) and velocity (NED, m/s) in the Earth's chart.
    values: Float[Array, "6"]
    sigmas: Float[Array, "6"]  #: Standard deviations of the errors, in the units of `values`.
    measured: Bool[Array, "6"]  #: Flags of the measured components; all False in an empty reading.
    #: Number of the sample at which the measurement was made; the reading may arrive at a later sample.
    number: Integer
    #: "sight": the values are a line of sight; "report": the values are the goal's reported motion.
    kind: Literal["sight", "report"] = eqx.field(static=True)


class Fix(eqx.Module):
    """Position (m, in the Earth's chart) and velocity over the ground (m/s), NED, from satellite navigation.

    Between two fixes, `is_new` is False, and position and velocity are unchanged.
    """

    position_n: Vector3
    velocity_n: Vector3
    is_new: Flag


class Reading(eqx.Module):
    """All measurements of one aircraft at one instant; the input of its estimator.

    A measurement that the aircraft's sensors do not make is None.
    """

    state: AircraftState  #: Measured state of the aircraft.
    #: Air data, forces and moments of the true airframe: for ideal and delayed sensors in `state`; for sensors with
    #: errors in the true state. Their estimator computes the values for its own estimate, from `air_data` or the wind.
    condition: AirDataAndForces
    specific_force_b: Vector3  #: Specific force at the centre of gravity, body axes, m/s^2.
    #: Exact line of sight to the goal, at every sample; None if the aircraft has no goal, or if the goal sensor has
    #: errors (see `goal`).
    sight: LineOfSight | None
    goal: GoalReading | None = None  #: Measurement of a goal sensor with errors; None for an ideal sensor.
    fix: Fix | None = None  #: Fix of satellite navigation; None if the position in `state` is measured at every sample.
    #: Velocity through the air as measured by pitot tube and vanes, body axes, m/s; None: the velocity in `condition`.
    velocity_air_b: Vector3 | None = None
    #: Whether the goal sensor works; false after its loss, which the aircraft detects.
    goal_sensor_works: Flag = eqx.field(default_factory=lambda: as_array(True, bool))

    def air_data(self, environment: Environment) -> AirData:
        """Return the measured air data, gusts included; density and speed of sound are exact."""
        data = self.condition.air_data
        if self.velocity_air_b is None:
            return data
        return air_data(self.velocity_air_b, data.altitude, environment.atmosphere.at(data.altitude))


class Belief(eqx.Module):
    """An aircraft's own estimate of its state and of its goal: the only input of guidance and controller."""

    #: Airframe model that the aircraft assumes, estimated state, and air data, forces and moments from both.
    airframe: AbstractAirframe
    state: AircraftState
    condition: AirDataAndForces
    specific_force_b: Vector3  #: Measured specific force, body axes, m/s^2.
    #: Line of sight to the goal, measured or estimated, and estimated motion of the goal; None if no goal exists.
    sight: LineOfSight | None
    goal: GoalState | None
    #: Uncertainty of the estimated positions of aircraft and goal; None if they are exact.
    uncertainty: "Uncertainty | None" = None
    estimates: "AbstractEstimates | None" = None  #: Estimates of an adaptive estimator; None if not adaptive.


class AbstractEstimates(eqx.Module):
    """Interface of the results of an adaptive estimator, such as the estimated control effectiveness."""

    @property
    @abc.abstractmethod
    def effectiveness_uncertainty(self) -> Scalar:
        """Relative standard deviation of the control effectiveness: the greatest among roll, pitch and yaw."""

    @abc.abstractmethod
    def variables(self) -> dict[str, Array]:
        """Return the estimates and their standard deviations by the keys of `anser.variables`."""


class Uncertainty(eqx.Module):
    """Uncertainty of an aircraft's estimated position and of the estimated motion of its goal."""

    position_covariance: Matrix33  # covariance of the aircraft's position, NED, m^2
    # covariance of the goal's position and velocity, NED, m and m/s; if lines of sight are measured, the covariance
    # includes the uncertainty of the aircraft's position
    goal_covariance: Float[Array, "6 6"]
    goal_is_measured: Flag  # whether a measurement of the goal arrived at this sample
    # normalised innovation squared of the goal's last measurement, divided by the dimension; 1 on average
    nis: Scalar
    goal_status: Integer  # `GOAL_KNOWN`, `GOAL_NEVER_SEEN` or `GOAL_DIVERGED`


GOAL_KNOWN, GOAL_NEVER_SEEN, GOAL_DIVERGED = range(3)


class AbstractSensors(AbstractPart):
    """Interface of the complete set of sensors of one aircraft. Subclass this class directly, not a concrete set."""

    def init(self, truth: Truth, instant: Instant) -> Any:
        """Return the sensors' state after a long time in the present flight condition; by default None (no state)."""
        return None

    @abc.abstractmethod
    def read(self, sensor_state: Any, truth: Truth, instant: Instant) -> tuple[Reading, Any]:
        """Return the readings of this sample, and the sensors' new state, from the truth at this sample."""


class AbstractEstimator(AbstractPart):
    """Interface of the estimator of one aircraft. Subclass this class directly, not a concrete estimator."""

    def init(self, reading: Reading, airframe: AbstractAirframe, instant: Instant) -> Any:
        """Return the estimator's state before the first sample; by default None (no state)."""
        return None

    @abc.abstractmethod
    def estimate(
        self, estimator_state: Any, reading: Reading, airframe: AbstractAirframe, instant: Instant
    ) -> tuple[Belief, Any]:
        """Return the belief at this sample from its reading, and the estimator's new state.

        `airframe` is the true airframe at the start; an estimator may use another model in its place.
        """


def velocity_over_ground_n(condition: AirDataAndForces, state: AircraftState) -> Vector3:
    """Compute an aircraft's velocity over the ground, NED, m/s, from its attitude in `condition` and its state."""
    return rotate_back(condition.R_bn, state.velocity_b)
