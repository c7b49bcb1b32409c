"""Interfaces of sensors and estimators, and the signals between them.

The instant, the truth, line of sight and readings, the aircraft's own estimate (belief) of its state and its goal's.
"""

import abc
from typing import Any, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.aircraft.air_data import Disturbance, no_disturbance
from anser.aircraft.airframe import AbstractAirframe, AircraftState
from anser.aircraft.motion import FlightCondition
from anser.environment.environment import Environment
from anser.numerics.arrays import as_array
from anser.numerics.randomness import INITIAL_SAMPLE, AbstractRandomness
from anser.shapes import Count, Flag, Matrix33, Scalar, Vector3
from anser.spatial.rotations import rotate_back
from anser.spatial.vectors import norm

# A sight line is treated as vertical below this ratio of horizontal distance to range.
_VERTICAL = 1e-12


class LineOfSight(eqx.Module):
    """What the sensor gives, in axes North, East, up."""

    range: Scalar
    """m."""
    azimuth: Scalar
    """Clockwise from North, rad."""
    elevation: Scalar
    """Up positive, rad; -pi/2 with the goal straight below."""
    range_rate: Scalar
    """m/s."""
    azimuth_rate: Scalar
    """rad/s; grows without bound toward the vertical, its product with range and cos(elevation) does not."""
    elevation_rate: Scalar
    """rad/s."""


def _axes(azimuth: Scalar, elevation: Scalar) -> tuple[Vector3, Vector3, Vector3]:
    """Rows of theory's M, in NED: along the sight line, toward rising azimuth, toward rising elevation."""
    ca, sa, ce, se = jnp.cos(azimuth), jnp.sin(azimuth), jnp.cos(elevation), jnp.sin(elevation)
    return (
        jnp.stack([ca * ce, sa * ce, -se]),
        jnp.stack([-sa, ca, jnp.zeros_like(ca)]),
        jnp.stack([-ca * se, -sa * se, -ce]),
    )


def measure_line_of_sight(
    own_position_n: Vector3, own_velocity_n: Vector3, goal_position_n: Vector3, goal_velocity_n: Vector3
) -> LineOfSight:
    """Give what a perfect sensor on the aircraft sees of a goal.

    Parameters
    ----------
    own_position_n, goal_position_n
        NED, m. They must differ: at zero range there is no sight line, and all angles and rates are reported as 0.
    own_velocity_n, goal_velocity_n
        NED, m/s, both over the ground.

    Notes
    -----
    Theory section 7. On the exact vertical the azimuth is free: it is laid along the horizontal relative velocity, so
    that the azimuth rate is zero and the elevation rate holds the whole motion. Elsewhere the azimuth rate is formed
    with the rounded elevation, so that `recover` gives the velocity back to rounding however close the vertical is.
    """
    relative, rate = goal_position_n - own_position_n, goal_velocity_n - own_velocity_n
    distance, level = norm(relative), norm(relative[:2])
    seen, vertical = distance > 0.0, level <= _VERTICAL * distance
    safe_distance = jnp.where(seen, distance, 1.0)

    sweeping = norm(rate[:2]) > 0.0
    aside_n = jnp.where(vertical, jnp.where(sweeping, rate[0], 1.0), relative[0])
    aside_e = jnp.where(vertical, jnp.where(sweeping, rate[1], 0.0), relative[1])
    azimuth = jnp.where(seen, jnp.arctan2(aside_e, aside_n), 0.0)
    elevation = jnp.arctan2(-relative[2], jnp.where(seen, level, 1.0))

    along, across, above = _axes(azimuth, elevation)
    turn = jnp.where(vertical, 0.0, jnp.sum(across * rate))
    lever = jnp.where(vertical, 1.0, safe_distance * jnp.cos(elevation))
    return LineOfSight(
        range=distance,
        azimuth=azimuth,
        elevation=elevation,
        range_rate=jnp.where(seen, jnp.sum(along * rate), 0.0),
        azimuth_rate=turn / lever,
        elevation_rate=jnp.where(seen, jnp.sum(above * rate) / safe_distance, 0.0),
    )


def goal_from_line_of_sight(
    sight: LineOfSight, own_position_n: Vector3, own_velocity_n: Vector3
) -> tuple[Vector3, Vector3]:
    """Goal position (NED, m) and velocity over the ground (NED, m/s) from the sensor and one's own motion.

    Exact without noise (theory section 7): M is orthonormal, its inverse is its transpose.
    """
    along, across, above = _axes(sight.azimuth, sight.elevation)
    relative_rate = (
        sight.range_rate * along
        + sight.range * jnp.cos(sight.elevation) * sight.azimuth_rate * across
        + sight.range * sight.elevation_rate * above
    )
    return own_position_n + sight.range * along, own_velocity_n + relative_rate


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
    randomness
        Source of the random numbers of this aircraft in this flight; None where nothing may draw any.
    """

    environment: Environment
    number: Count
    step: Scalar
    randomness: AbstractRandomness | None = None

    @property
    def time(self) -> Scalar:
        """S."""
        return self.number * self.step

    def normals(self, part: int, count: int, *, once: bool = False) -> Array:
        """Standard normal numbers that a part of one aircraft draws, shape (count,).

        They follow from (seed, flight, aircraft, part, sample) alone.

        Parameters
        ----------
        part
            One of those in `anser.numerics.randomness`, or a user's own from 100 on.
        count
            How many.
        once
            Those that are drawn once, before the first sample; else those of this sample.

        Raises
        ------
        ValueError
            The flight has no seed.
        """
        drawn = self._source().normals(part, INITIAL_SAMPLE if once else self.number, count)
        return drawn.astype(self.step.dtype)

    def uniforms(self, part: int, count: int, *, once: bool = False) -> Array:
        """As `normals`, between 0 and 1."""
        drawn = self._source().uniforms(part, INITIAL_SAMPLE if once else self.number, count)
        return drawn.astype(self.step.dtype)

    def _source(self) -> AbstractRandomness:
        if self.randomness is None:
            raise ValueError("a part of the closed loop draws random numbers, but the flight has no seed")
        return self.randomness


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
    goal_sensor_works
        False once it has lost the sensor of its goal.
    disturbance
        Gust and thrust, as far as they are not in the mean wind and a sound engine.
    """

    airframe: AbstractAirframe
    state: AircraftState
    condition: FlightCondition
    goal: GoalState | None
    goal_sensor_works: Flag = eqx.field(default_factory=lambda: as_array(True, bool))
    disturbance: Disturbance = eqx.field(default_factory=no_disturbance)


class GoalReading(eqx.Module):
    """One measurement of a goal, or none.

    Attributes
    ----------
    values
        Line of sight: range (m), azimuth, elevation (rad) in axes North, East, up, and their rates; or a goal's own
        report: its position (NED, m) and velocity (NED, m/s) in the Earth's chart.
    sigmas
        Standard deviations of their errors, same units.
    measured
        Which of them there are; none at a sample without a measurement.
    number
        Sample at which it was measured; it may arrive later.
    kind
        "sight" or "report".
    """

    values: Float[Array, "6"]
    sigmas: Float[Array, "6"]
    measured: Bool[Array, "6"]
    number: Count
    kind: Literal["sight", "report"] = eqx.field(static=True)


class Fix(eqx.Module):
    """Position and velocity by satellite navigation.

    Attributes
    ----------
    position_n, velocity_n
        NED, m in the Earth's chart and m/s over the ground; those of the last fix where there is no new one.
    new
        Whether it is of this sample.
    """

    position_n: Vector3
    velocity_n: Vector3
    is_new: Flag


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
        Line of sight to the goal with all rates at every sample; None for an aircraft without a goal, or whose sensor
        does less.
    goal
        What such a sensor gives.
    fix
        By satellite navigation; None: the position in the state is at hand at every sample.
    velocity_air_b
        Velocity through the air as pitot tube and vanes measure it, body axes, m/s; None: that in `now`.
    goal_sensor_works
        As `Truth` has it: an aircraft knows that its sensor has failed.
    """

    state: AircraftState
    condition: FlightCondition
    specific_force_b: Vector3
    sight: LineOfSight | None
    goal: GoalReading | None = None
    fix: Fix | None = None
    velocity_air_b: Vector3 | None = None
    goal_sensor_works: Flag = eqx.field(default_factory=lambda: as_array(True, bool))


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
        Line of sight to the goal as measured, or as it is taken to be; None for an aircraft without one.
    goal
        Where it takes its goal to be, and how it moves; None without one.
    uncertainty
        Of both; None where they are taken to be exact.
    """

    airframe: AbstractAirframe
    state: AircraftState
    condition: FlightCondition
    specific_force_b: Vector3
    sight: LineOfSight | None
    goal: GoalState | None
    uncertainty: "Uncertainty | None" = None


class Uncertainty(eqx.Module):
    """How well an aircraft knows its own place and its goal.

    Attributes
    ----------
    own_covariance
        Of the own position, NED, m^2.
    goal_covariance
        Of the goal's position and velocity, NED, m and m/s; the own place's is in it where the goal is seen from there.
    seen
        Whether a measurement of the goal came in at this sample.
    nis
        Normalised innovation squared of the last one, over its dimension: 1 in the mean.
    goal_status
        One of `GOAL_KNOWN`, `GOAL_NEVER_SEEN`, `GOAL_DIVERGED`.
    """

    position_covariance: Matrix33
    goal_covariance: Float[Array, "6 6"]
    goal_is_measured: Flag
    nis: Scalar
    goal_status: Count


GOAL_KNOWN, GOAL_NEVER_SEEN, GOAL_DIVERGED = range(3)


class AbstractSensors(eqx.Module):
    """Sensors of one aircraft; concrete ones are final."""

    @abc.abstractmethod
    def init(self, truth: Truth, instant: Instant) -> Any:
        """State of the sensors before the first sample, of an aircraft that has been in its present flight for long."""

    @abc.abstractmethod
    def read(self, sensor_state: Any, truth: Truth, instant: Instant) -> tuple[Reading, Any]:
        """Their reading now, and their state after it."""


class AbstractEstimator(eqx.Module):
    """Estimator of one aircraft; concrete ones are final."""

    @abc.abstractmethod
    def init(self, reading: Reading, airframe: AbstractAirframe, instant: Instant) -> Any:
        """State of the estimator before the first sample."""

    @abc.abstractmethod
    def estimate(
        self, estimator_state: Any, reading: Reading, airframe: AbstractAirframe, instant: Instant
    ) -> tuple[Belief, Any]:
        """What the aircraft believes now, and the estimator's state after that; `airframe` is what flies."""


def velocity_over_ground_n(condition: FlightCondition, state: AircraftState) -> Vector3:
    """Velocity over the ground, NED, m/s."""
    return rotate_back(condition.R_bn, state.velocity_b)
